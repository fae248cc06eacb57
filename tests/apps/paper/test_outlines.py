"""The paper's renderers as the search sees them: the same silhouette, and a slope that is the error's own."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from knotfab.apps.paper.outlines import OutlineImage
from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.render.image import ViewImage, image_at
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import Renderer

pytestmark = pytest.mark.slow

VIEW = ResolvedView(
    frame_width_mm=120.0, frame_height_mm=90.0, azimuth_deg=30.0, light_distance_mm=600.0
)
RADIUS = 3.0
RINGS = polylines_of_sizes((90, 40))


def disc() -> Mask:
    y, x = np.mgrid[:60, :80]
    return np.asarray(np.hypot(x - 40, y - 30) < 22)


def tangle() -> Array:
    t, u = (2 * np.pi * np.arange(n) / n for n in RINGS.sizes)
    one = np.column_stack([30 * np.cos(t), 24 * np.sin(t), 8 * np.cos(3 * t)])
    return np.concatenate([one, np.column_stack([9 * np.cos(u), 3 * np.sin(u), 9 * np.sin(u)])])


def image(renderer: Renderer, view: ResolvedView = VIEW) -> ViewImage:
    return image_at(view, disc(), RADIUS, 96, "double", renderer)


@pytest.mark.study
def test_capsules_have_the_silhouette_of_rays() -> None:
    rays, capsules, ellipses = (
        image(kind).seen(tangle(), RINGS, RADIUS) for kind in ("ray", "capsule", "ellipse")
    )
    # one may differ where an outline passes a pixel's middle
    assert (rays ^ capsules).sum() <= 2 and rays.sum() > 500
    assert not (ellipses & ~capsules).any()
    assert 0 < (capsules & ~ellipses).sum() < 0.1 * rays.sum()


@pytest.mark.parametrize("renderer", ["capsule", "ellipse"])
@pytest.mark.parametrize("kept", [False, True])
def test_the_slope_is_the_errors_own(renderer: Renderer, kept: bool) -> None:
    points, seen = tangle(), image(renderer)
    won = seen.find_winners(points, RINGS, RADIUS, 1.0) if kept else None
    _, slope = seen.squared_error(points, RINGS, RADIUS, 1.0, won)
    assert slope.shape == points.shape and np.isfinite(slope).all()
    rng = np.random.default_rng(3)
    way, step = rng.normal(size=points.shape), 1e-6
    ends = (
        seen.squared_error(points + s * step * way, RINGS, RADIUS, 1.0, won)[0] for s in (1, -1)
    )
    ahead, behind = ends
    # a pixel within the cutoff, of which sigmoid leaves 0.7 %, may come or go where winners are found anew
    assert (ahead - behind) / (2 * step) == pytest.approx(float((slope * way).sum()), rel=2e-3)


def test_near_the_outline_the_errors_are_those_of_rays() -> None:
    points = tangle()
    rays, capsules = (
        image(kind).squared_error(points, RINGS, RADIUS, 4.0) for kind in ("ray", "capsule")
    )
    assert capsules[0] == pytest.approx(rays[0], rel=1e-2)
    cosine = (capsules[1] * rays[1]).sum() / np.sqrt(
        (capsules[1] ** 2).sum() * (rays[1] ** 2).sum()
    )
    assert cosine > 0.98


def test_another_pose_keeps_the_renderer() -> None:
    turned = VIEW.model_copy(update={"azimuth_deg": 50.0})
    here, there = image("capsule"), image("capsule", turned)
    moved = here.from_frame(there.frame)
    drawn = [cast(OutlineImage, image._drawn) for image in (moved, here)]
    assert drawn[0].target is drawn[1].target
    one, other = (i.squared_error(tangle(), RINGS, RADIUS, 1.0) for i in (moved, there))
    assert one[0] == other[0] and (one[1] == other[1]).all()
