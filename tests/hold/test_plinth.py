"""The base of a stand: the highest plane below all frames, and no base in a picture."""

from __future__ import annotations

import numpy as np
import pytest
from rings import VIEW, camera

from knotfab.base.errors import SceneError
from knotfab.hold.plinth import WALL_GAP_MM, Base, Masses, Slope, base_for, slope_below
from knotfab.scene.camera import CurvedWall

AZIMUTHS = (0.0, 90.0)


CAMERAS = [camera(azimuth_deg=a) for a in AZIMUTHS]


@pytest.mark.parametrize("seed", range(6))
def test_the_top_is_the_highest_plane_below_all_frames(seed: int) -> None:
    random = np.random.default_rng(seed)
    cameras = [
        camera(
            azimuth_deg=float(random.uniform(-180, 180)),
            elevation_deg=float(random.uniform(-20, 30)),
            frame_up_mm=float(random.uniform(-10, 10)),
        )
        for _ in range(1 + seed % 3)
    ]
    rectangle = (-40.0, 55.0, -30.0, 45.0)
    top = slope_below(cameras, rectangle)
    right, up, out = top.axes
    x, z = (np.linspace(*ends, 20) for ends in (rectangle[:2], rectangle[2:]))
    on = np.array([u * right + v * out for u in x for v in z])
    on = on - top.above(on)[:, None] * up
    edges = np.stack([slope_below([c]).above(on) for c in cameras])
    assert edges.max() <= 1e-9
    # it touches at both ends: no plane that is level across is higher
    for end in rectangle[2:]:
        there = np.isclose(on @ out, end)
        assert edges[:, there].max() == pytest.approx(0.0, abs=1e-9)
    again = slope_below([cameras[0], *cameras], rectangle)
    assert (again.height_mm, again.rise) == pytest.approx((top.height_mm, top.rise))


def test_a_base_in_a_picture_is_refused() -> None:
    """A top that the first light alone allows stands in the second's frame."""
    cameras = [CAMERAS[0], camera(azimuth_deg=90.0, frame_up_mm=-20.0)]
    feet = np.array([[-30.0, 0.0, -30.0], [30.0, 0.0, -30.0], [0.0, 0.0, 30.0]])
    weights = Masses(np.array([5000.0]), np.zeros((1, 3)))

    def base(slope: Slope) -> None:
        base_for(slope, feet, 2.0, weights, cameras, 4.0, 10.0)

    base(slope_below(cameras, (-60.0, 60.0, -60.0, 60.0)))
    with pytest.raises(SceneError, match="in a picture"):
        base(slope_below(cameras[:1]))


def test_a_base_in_a_hollow_wall_is_refused() -> None:
    """A hollow wall comes forward beside the picture: a base that is wide enough stands in it."""
    feet = np.array([[-75.0, 0.0, -30.0], [75.0, 0.0, -30.0], [0.0, 0.0, 30.0]])
    weights = Masses(np.array([5000.0]), np.zeros((1, 3)))
    cameras = [camera()]
    slope = slope_below(cameras)

    def base(radius: float) -> Base:
        wall = CurvedWall.of(VIEW.model_copy(update={"wall_radius_mm": radius}))
        assert wall is not None
        return base_for(slope, feet, 2.0, weights, cameras, 4.0, 10.0, [wall])

    flat = base_for(slope, feet, 2.0, weights, cameras, 4.0, 10.0)
    x, before = flat.corners[:, 0], flat.corners[:, 2] + VIEW.wall_distance_mm
    # the circle about (0, R) that passes WALL_GAP_MM beside the outermost corner (x, before)
    least = ((x**2 + before**2 - WALL_GAP_MM**2) / (2 * (before - WALL_GAP_MM))).max()
    assert base(1.001 * least) == flat and base(-60.0) == flat
    with pytest.raises(SceneError, match="hollow wall") as told:
        base(0.999 * least)
    assert "wall_radius_mm" in told.value.remedy


def test_a_top_before_a_low_light_is_level_and_below_it() -> None:
    low, high = (slope_below([camera(light_up_mm=up)]) for up in (-400.0, 100.0))
    assert low.rise < 0 < high.rise and high.no_fall(60.0) is high
    level = low.no_fall(60.0)
    right, _, out = low.axes
    on = np.array([x * right + z * out for x in (-30.0, 30.0) for z in (-50.0, 0.0, 60.0)])
    assert level.rise == 0 and (level.above(on) >= low.above(on) - 1e-9).all()
    assert level.above(on)[2] == pytest.approx(low.above(on)[2])  # at its front
