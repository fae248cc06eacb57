"""Where a piece is moved that its pegs do not hold: to its wall, and flatter where that is not enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import VIEW, camera, knots, ring

from knotfab.arrays import Array
from knotfab.knots import Knot, Knots
from knotfab.mount.nearer import AIM, LEAST_PEG_MM, SHARES, Place, _move, propose_place
from knotfab.mount.piece_frame import Stiffness
from knotfab.mount.wall import NotHeldError, WallSettings, plan_wall, sag_on_pegs
from knotfab.scene.camera import camera_of, view_axes
from knotfab.scene.model import ResolvedView

PLATE = WallSettings("plate", 3.0, 8.0, 4.0, 10.0)
LOOSE = Knots(knots(ring(12.0, 30.0, 40, 3.0), ring(20.0, -30.0, 60, 3.0)).knots, 0.8)
DEPTH = float(np.ptp(LOOSE.points[:, 2]))
PLA = Stiffness(2300.0, 1.24, 0.2)
SOFT = replace(PLA, young_mpa=400.0)


def propose(stiffness: Stiffness, *, shallower: bool = True, nearer: bool = True) -> Place | None:
    return propose_place(LOOSE, VIEW, 0.4, stiffness, shallower=shallower, nearer=nearer)


def sag_at(place: Place, share: float, stiffness: Stiffness) -> float:
    moved, there = _move(LOOSE, VIEW, share, place)
    return sag_on_pegs(moved, camera_of(there, 64, 64), 0.4, stiffness)


@pytest.mark.slow
def test_pegs_that_sag_before_a_far_wall_hold_before_a_near_one() -> None:
    with pytest.raises(NotHeldError, match=r"sags \d\.\d\d mm on its pegs, 0\.2 are allowed"):
        plan_wall(LOOSE, camera(), 0.4, PLA, PLATE, thoroughly=False)
    place = propose(PLA)
    assert place is not None and place.wall_mm < VIEW.wall_distance_mm
    share = next(s for s in SHARES if abs(s * DEPTH - place.depth_mm) <= 0.1)
    assert sag_at(place, share, replace(PLA, max_sag_mm=AIM * 0.2)) <= AIM * 0.2
    moved, there = _move(LOOSE, VIEW, share, place)
    assert plan_wall(moved, camera_of(there, 90, 90), 0.4, PLA, PLATE).sag_again_mm <= 0.2


def test_only_a_softer_material_asks_for_less_depth() -> None:
    places = [propose(replace(PLA, young_mpa=e)) for e in (2300.0, 1000.0, 400.0)]
    depths = [place.depth_mm for place in places if place is not None]
    assert len(depths) == 3 and depths == sorted(depths, reverse=True) and depths[-1] < depths[0]
    for place in places:  # and it never touches its wall
        assert place is not None and place.wall_mm >= 0.5 * place.depth_mm + LEAST_PEG_MM


@pytest.mark.slow
def test_what_is_given_stays() -> None:
    assert propose(SOFT, shallower=False, nearer=False) is None
    near, flat = propose(SOFT, shallower=False), propose(SOFT, nearer=False)
    assert near is not None and near.depth_mm == pytest.approx(DEPTH, abs=0.1)
    assert flat is not None and flat.wall_mm == VIEW.wall_distance_mm


@pytest.mark.parametrize("keys", [{}, {"azimuth_deg": 40.0, "elevation_deg": 20.0}])
def test_the_shadow_of_what_is_moved_stays(keys: dict[str, float]) -> None:
    view = VIEW.model_copy(update=keys)
    turned = Knots(tuple(Knot(k.points @ view_axes(view)) for k in LOOSE.knots), 0.8)
    place = propose_place(turned, view, 0.4, SOFT, shallower=True, nearer=True)
    assert place is not None
    moved, there = _move(turned, view, 0.5, place)
    assert pixels(moved, there) == pytest.approx(pixels(turned, view), abs=0.01)
    assert np.ptp(moved.points @ view_axes(view)[2]) == pytest.approx(0.5 * DEPTH)


def pixels(some: Knots, view: ResolvedView) -> Array:
    """Where the light sends each vertex on a picture of 90 px."""
    p = camera_of(view, 90, 90).projection
    seen = some.points @ p[:, :3].T + p[:, 3]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def test_a_wall_that_leans_keeps_clear() -> None:
    view = VIEW.model_copy(update={"wall_tilt_deg": 15.0})
    place = propose_place(LOOSE, view, 0.4, PLA, shallower=True, nearer=True)
    upright = propose(PLA)
    assert place is not None and upright is not None
    leans = place.wall_mm - 0.5 * place.depth_mm
    assert leans > upright.wall_mm - 0.5 * upright.depth_mm + 20.0
