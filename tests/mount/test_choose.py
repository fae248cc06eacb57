"""Pegs are chosen until nothing sags, and none of them idles."""

from itertools import pairwise

import numpy as np
import pytest
from rings import PLA, RADIUS, camera, knots, ring

from knotfab.mount.choose import _Model, choose_pegs
from knotfab.mount.piece_frame import Stiffness, sag_moves, worst_of
from knotfab.mount.rays import Rays, free_rays
from knotfab.mount.wall_brace import pegs_on, sites_with

ONE = knots(ring(50.0))


def sag_on(
    rays: Rays, chosen: np.ndarray, top: np.ndarray, foot: np.ndarray, stiffness: Stiffness
) -> tuple[float, np.ndarray]:
    """What `ONE` sags on the pegs of some rays."""
    sites = sites_with(ONE, rays, chosen)
    members = pegs_on(sites, rays, chosen, top)
    return worst_of(sag_moves(ONE, sites, members, stiffness, foot[chosen]), ONE.points)


@pytest.mark.slow
def test_pegs_are_added_until_the_sag_is_small_and_none_is_idle() -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top = np.full(len(rays.top), 0.9 * RADIUS)
    foot = 1.2 * top
    soft = Stiffness(400.0, 1.24, 0.2)
    chosen = choose_pegs(ONE, rays, top, foot, soft)
    assert chosen.sag_mm <= 0.2 and len(chosen.rays) > 1
    again, _ = sag_on(rays, chosen.rays, top, foot, soft)
    assert again == pytest.approx(chosen.sag_mm, rel=0.02)  # other joints, same frame
    for peg in chosen.rays[1:]:
        left = chosen.rays[chosen.rays != peg]
        assert sag_on(rays, left, top, foot, soft)[0] > 0.19
    stiff = choose_pegs(ONE, rays, top, foot, PLA)
    assert len(stiff.rays) <= len(chosen.rays)


def test_pegs_held_one_by_one_are_the_pegs_held_at_once() -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top = np.full(len(rays.top), 0.9 * RADIUS)
    model = _Model(ONE, rays, 0, np.flatnonzero(rays.free), top, 1.2 * top, PLA)
    pegs = [0]
    for peg in range(1, len(model.candidates), len(model.candidates) // 6):
        one_more, at_once = model.sag_with(peg), model.sag([*pegs, peg])
        assert one_more.sag_mm == pytest.approx(at_once.sag_mm, rel=1e-9)
        assert one_more.all_mm == pytest.approx(at_once.all_mm, rel=1e-9)
        model.hold(peg)
        pegs.append(peg)


def test_more_pegs_sag_less_and_a_softer_material_more() -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top, foot = np.full(len(rays.top), 1.8), np.full(len(rays.top), 2.0)
    free = np.flatnonzero(rays.free)
    some = free[:: len(free) // 4][:4]
    sags = [sag_on(rays, some[: n + 1], top, foot, PLA)[0] for n in range(4)]
    assert all(b <= a + 1e-12 for a, b in pairwise(sags))
    soft, _ = sag_on(rays, some, top, foot, Stiffness(1150.0, 1.24, 0.2))
    assert soft == pytest.approx(2 * sags[-1], rel=1e-6)
