"""The chain of frames: what the first frame finds holds for all, and each frame is judged by itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.scene.model import Material, Piece, Scene
from knotfab.sequence.chain import chain
from knotfab.sequence.frames import read_frames
from knotfab.target.read import Target

QUICK = {
    "coarse_px": 64,
    "fine_px": 64,
    "coarse_iterations": 12,
    "fine_iterations": 8,
    "settle_iterations": 8,
    "depth_candidates": 2,
}


def discs(folder: Path, sizes: Sequence[int]) -> tuple[Target, ...]:
    """A disc in the middle, of so many pixels' radius in each frame."""
    names = []
    for number, size in enumerate(sizes):
        image = Image.new("L", (128, 128), 255)
        ImageDraw.Draw(image).ellipse((64 - size, 64 - size, 64 + size, 64 + size), fill=0)
        names.append(str(folder / f"{number}.png"))
        image.save(names[-1])
    return read_frames(names)


@pytest.mark.slow
def test_the_view_is_found_with_the_first_frame_and_stays(tmp_path: Path) -> None:
    """Lamp and wall stand still while the frames change; and what was found can be repeated."""
    targets = discs(tmp_path, (40, 42))
    asked = Scene(piece=Piece(tube_radius_mm=12.0), search={**QUICK, "free_view": True})
    first, second = (frame.made for frame in chain(asked, targets))
    views = [made.scene.views[0] for made in (first, second)]
    found = {(v.light_distance_mm, v.wall_distance_mm) for v in views}
    assert len(found) == 1 and found != {(500.0, 100.0)}
    assert [v.name for v in views] == ["frame-01", "frame-02"]
    assert first.result.log.certified and second.result.log.certified
    assert min(made.result.iou_estimate for made in (first, second)) > 0.7
    again = next(chain(first.scene, targets)).made
    assert np.array_equal(again.knots.points, first.knots.points)
    assert again.scene.views == first.scene.views


@pytest.mark.slow
def test_each_frame_has_its_own_floor_and_prices(tmp_path: Path) -> None:
    """Only the large disc lacks length: the limit is priced there, and for the small one it is not."""
    targets = discs(tmp_path, (24, 40))
    material = Material(max_length_mm=250.0)
    asked = Scene(piece=Piece(tube_radius_mm=12.0), material=material, search=QUICK)
    first, second = (frame.made for frame in chain(asked, targets))
    assert first.binding == ()
    assert [price.limits for price in second.binding] == [("length",)]
    assert second.binding[0].needed[0] > 250.0 > second.knots.knots[0].length_mm
    floors = {made.scene.accuracy.iou_floor for made in (first, second)}
    assert len(floors) == 2  # of each picture's own opening
