"""A piece that turns under one lamp: the angles are those at which the other lamps' shadows appear."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.render.part_picture import turn_upright
from knotfab.report.pictures import turns_of
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView, SettledScene


def scene(*views: dict[str, float]) -> SettledScene:
    size = {"frame_width_mm": 100.0, "frame_height_mm": 100.0}
    made = [ResolvedView(name=f"v{n}", **size, **view) for n, view in enumerate(views)]
    return SettledScene.model_construct(views=tuple(made))


@pytest.mark.parametrize("azimuth", [90.0, -60.0, 17.0])
def test_the_turned_piece_throws_the_other_shadow(azimuth: float) -> None:
    views = scene({}, {"azimuth_deg": azimuth}).views
    angle = turns_of(scene({}, {"azimuth_deg": azimuth}))["v1"]
    points = np.random.default_rng(3).normal(size=(40, 3)) * 20.0
    first, other = (camera_of(view, 64, 64) for view in views)
    turned = turn_upright(points, angle)
    assert first.project(turned) == pytest.approx(other.project(points), abs=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        {"azimuth_deg": 90.0, "elevation_deg": 20.0},
        {"azimuth_deg": 90.0, "light_distance_mm": 400.0},
    ],
)
def test_lamps_of_their_own_places_share_no_lamp(other: dict[str, float]) -> None:
    assert turns_of(scene({}, other)) == {}


def test_one_view_has_no_angles() -> None:
    assert turns_of(scene({})) == {}
