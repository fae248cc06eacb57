"""A piece that its pegs do not hold is moved to its wall, and made flatter if that is not enough."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pieces import PLA, PLATE, VIEW, camera, knots, ring
from shapely import MultiPolygon, box

from knotfab.base.arrays import Array
from knotfab.design.candidates import line_radius, most_radius, usual_radii
from knotfab.design.room import depth_extent, resolve_region
from knotfab.hold.beams import Stiffness
from knotfab.hold.wall import NotHeldError, plan_wall, sag_on_pegs
from knotfab.knots import Knot, Knots
from knotfab.pipeline.settle import AIM, LEAST_PEG_MM, SHARES, Place, _move_knots, propose_place
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.piece import Region
from knotfab_formats.scene import ResolvedView

LOOSE = Knots(knots(ring(12.0, 30.0, 40, 3.0), ring(20.0, -30.0, 60, 3.0)).knots, 0.8)
DEPTH = float(np.ptp(LOOSE.points[:, 2]))
SQUARE = MultiPolygon([box(-70, -70, 70, 70)])
SOFT = replace(PLA, young_mpa=400.0)


def propose(
    stiffness: Stiffness,
    *,
    shallower: bool = True,
    nearer: bool = True,
    view: ResolvedView = VIEW,
    pieces: Knots = LOOSE,
    most: float = 0.8,
) -> Place | None:
    asks = {"shallower": shallower, "nearer": nearer}
    return propose_place(pieces, view, 0.4, stiffness, **asks, most_radius_mm=most)


def sag_at(place: Place, share: float, stiffness: Stiffness) -> float:
    moved, there = _move_knots(LOOSE, VIEW, share, place)
    return sag_on_pegs(moved, camera_of(there, 64, 64), 0.4, stiffness)


@pytest.mark.slow
def test_pegs_that_sag_before_a_far_wall_hold_before_a_near_one() -> None:
    with pytest.raises(NotHeldError, match=r"sags by \d\.\d\d mm on its pegs \(0\.2 allowed\)"):
        plan_wall(LOOSE, camera(), 0.4, PLA, PLATE, thoroughly=False)
    place = propose(PLA)
    assert place is not None and place.wall_mm < VIEW.wall_distance_mm
    share = next(s for s in SHARES if abs(s * DEPTH - place.depth_mm) <= 0.1)
    assert sag_at(place, share, replace(PLA, max_sag_mm=AIM * 0.2)) <= AIM * 0.2
    moved, there = _move_knots(LOOSE, VIEW, share, place)
    assert plan_wall(moved, camera_of(there, 90, 90), 0.4, PLA, PLATE).sag_mm <= 0.2


def test_only_a_softer_material_asks_for_less_depth() -> None:
    places = [propose(replace(PLA, young_mpa=e)) for e in (2300.0, 1000.0, 400.0)]
    depths = [place.depth_mm for place in places if place is not None]
    assert len(depths) == 3 and depths == sorted(depths, reverse=True) and depths[-1] < depths[0]
    for place in places:  # and it never touches its wall
        assert place is not None and place.wall_mm >= 0.5 * place.depth_mm + LEAST_PEG_MM


@pytest.mark.slow
def test_what_is_given_stays() -> None:
    assert propose(SOFT, shallower=False, nearer=False) is None
    near, flat = propose(SOFT, shallower=False), propose(PLA, nearer=False)
    assert near is not None and near.depth_mm == pytest.approx(DEPTH, abs=0.1)
    assert flat is not None and flat.wall_mm == VIEW.wall_distance_mm


def test_what_no_place_holds_is_moved_once_and_not_flattened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("knotfab.pipeline.settle.sag_on_pegs", lambda *_: 1.0)
    place = propose(PLA)
    assert place is not None and place.depth_mm == pytest.approx(DEPTH, abs=0.1)
    moved, there = _move_knots(LOOSE, VIEW, 1.0, place)
    for aside in (0.0, 0.5):  # the strands that a search lays there are as deep, about
        view = there.model_copy(update={"wall_distance_mm": there.wall_distance_mm + aside})
        assert propose(PLA, view=view, pieces=moved) is None
    assert propose(PLA, nearer=False) is None


@pytest.mark.parametrize(
    ("frame_mm", "radius", "depth_mm", "keys"),
    [
        (180.0, 4.0, 100.0, {}),
        (300.0, 3.06, 168.0, {"wall_distance_mm": 150.0}),
        (300.0, 5.0, 117.0, {}),
        (420.0, 4.0, 230.0, {"wall_distance_mm": 200.0}),  # the lamp is what is near
        (180.0, 2.0, 110.0, {"thicken_mm": 5.0, "lines": True}),
    ],
)
@pytest.mark.parametrize("share", SHARES[::2])
def test_the_proposed_wall_has_room_for_depth_and_any_tube(
    frame_mm: float,
    radius: float,
    depth_mm: float,
    keys: dict[str, Any],
    share: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    view = VIEW.model_copy(update={"frame_width_mm": frame_mm, "frame_height_mm": frame_mm, **keys})
    half = 0.5 * depth_mm - 3.0
    pieces = Knots(knots(ring(12.0, half, 40, 3.0), ring(20.0, -half, 60, 3.0)).knots, radius)
    most = most_radius(None, view, 0.8)
    sags = iter([1.0] * SHARES.index(share) + [0.0])
    monkeypatch.setattr("knotfab.pipeline.settle.sag_on_pegs", lambda *_: next(sags))
    place = propose(PLA, view=view, pieces=pieces, most=most)
    assert place is not None and place.wall_mm < view.wall_distance_mm
    there = view.model_copy(update={"wall_distance_mm": place.wall_mm})
    chosen = [line_radius(there)] if "lines" in keys else usual_radii([there], 0.8, 16)[0]
    for r in (radius, *chosen):
        region = resolve_region(Region(), [there], [], r)
        extent = depth_extent(place.depth_mm, SQUARE, region, r)
        assert r > most or extent == place.depth_mm
    assert max(chosen) <= most + 1e-6


@pytest.mark.parametrize("keys", [{}, {"azimuth_deg": 40.0, "elevation_deg": 20.0}])
def test_the_shadow_of_what_is_moved_stays(keys: dict[str, float]) -> None:
    view = VIEW.model_copy(update=keys)
    turned = Knots(tuple(Knot(k.points @ view_axes(view)) for k in LOOSE.knots), 0.8)
    place = propose(SOFT, view=view, pieces=turned)
    assert place is not None
    moved, there = _move_knots(turned, view, 0.5, place)
    assert pixels(moved, there) == pytest.approx(pixels(turned, view), abs=0.01)
    assert np.ptp(moved.points @ view_axes(view)[2]) == pytest.approx(0.5 * DEPTH)


def pixels(some: Knots, view: ResolvedView) -> Array:
    """Find where the light sends each vertex on a picture of 90 px."""
    p = camera_of(view, 90, 90).projection
    seen = some.points @ p[:, :3].T + p[:, 3]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def test_a_wall_that_leans_keeps_clear() -> None:
    view = VIEW.model_copy(update={"wall_tilt_deg": 15.0})
    place = propose(PLA, view=view)
    upright = propose(PLA)
    assert place is not None and upright is not None
    leans = place.wall_mm - 0.5 * place.depth_mm
    assert leans > upright.wall_mm - 0.5 * upright.depth_mm + 20.0


@pytest.mark.parametrize(
    ("height_mm", "up_mm"), [(180.0, 0.0), (60.0, 0.0), (180.0, 40.0), (180.0, -40.0)]
)
def test_a_leaning_wall_keeps_clear_of_all_before_the_frame(height_mm: float, up_mm: float) -> None:
    tilted = {"wall_tilt_deg": 10.0, "frame_height_mm": height_mm, "frame_up_mm": up_mm}
    view = VIEW.model_copy(update={"wall_distance_mm": 150.0, **tilted})
    place = propose(PLA, view=view)
    assert place is not None and place.wall_mm < 150.0
    there = camera_of(view.model_copy(update={"wall_distance_mm": place.wall_mm}), 90, 90)
    corners = there.corner + np.outer([0, 89.5], there.dv)
    near = 0.5 * place.depth_mm + LOOSE.radius_mm
    # the gap is that of the frame's nearest edge behind the deepest strand
    gap = -near - corners[:, 2].max()
    assert LEAST_PEG_MM <= gap < LEAST_PEG_MM + 3.0
