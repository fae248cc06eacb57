"""Frames of several pictures: equally high silhouettes, at the size that is asked for."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.design.frames import frame_view, framed_alike, size_frames, spread_views
from knotfab.scene.model import Scene
from knotfab.target.read import Target


def target(width: int, height: int, top: int, bottom: int) -> Target:
    """A bar in a picture."""
    mask = np.zeros((height, width), dtype=bool)
    mask[top:bottom, width // 4 : width // 2] = True
    return Target("bar", mask, b"", width, height)


TARGETS = [target(100, 200, 20, 180), target(300, 100, 10, 60)]


@pytest.mark.parametrize("key", ["frame_width_mm", "frame_height_mm"])
def test_one_size_for_all_is_that_of_the_first(key: str) -> None:
    scene = spread_views(Scene(), 2)
    sized = scene.model_copy(
        update={"views": tuple(v.model_copy(update={key: 240.0}) for v in scene.views)}
    )
    alike = framed_alike(scene, TARGETS).views
    views = size_frames(sized, TARGETS).views
    assert getattr(frame_view(views[0], TARGETS[0]), key) == pytest.approx(240.0)
    scale = getattr(frame_view(views[0], TARGETS[0]), key) / getattr(alike[0], key)
    for view, before, picture in zip(views, alike, TARGETS, strict=True):
        assert view.frame_up_mm == pytest.approx(scale * before.frame_up_mm)
        assert view.frame_width_mm == pytest.approx(scale * (before.frame_width_mm or 0))
        assert view.frame_width_mm / picture.width == pytest.approx(
            (view.frame_height_mm or 0) / picture.height
        )
    tall = [
        (v.frame_height_mm or 0) * t.mask.any(1).sum() / t.height
        for v, t in zip(views, TARGETS, strict=True)
    ]
    assert tall[0] == pytest.approx(tall[1])


def test_sizes_of_their_own_stay() -> None:
    scene = spread_views(Scene(), 2)
    own = tuple(
        v.model_copy(update={"frame_width_mm": mm})
        for v, mm in zip(scene.views, (100.0, 150.0), strict=True)
    )
    scene = scene.model_copy(update={"views": own})
    assert size_frames(scene, TARGETS) is scene
