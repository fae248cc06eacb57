"""Pegs are chosen until nothing sags, and none of them idles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pieces import PLA, RADIUS, camera, knots, ring

from knotfab.hold.beams import HeldFrame, Stiffness, piece_frame, sag_moves, springs_of, worst_of
from knotfab.hold.pegs import choose_pegs, pegs_on, sites_with
from knotfab.hold.shade import Rays, free_rays
from knotfab.hold.struts import Candidates, join_members

ONE = knots(ring(50.0))


def sag_on(
    rays: Rays, chosen: np.ndarray, top: np.ndarray, foot: np.ndarray, stiffness: Stiffness
) -> tuple[float, np.ndarray]:
    """What `ONE` sags on the pegs of some rays."""
    sites = sites_with(ONE, rays, chosen)
    members = pegs_on(sites, rays, chosen, top, foot)
    return worst_of(sag_moves(ONE, sites, members, stiffness), ONE.points)


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


@pytest.mark.parametrize("tapers", [False, True])
def test_members_held_on_a_solved_frame_are_members_of_a_frame_solved_anew(tapers: bool) -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top = np.full(len(rays.top), 0.9 * RADIUS)
    chosen = np.flatnonzero(rays.free)[:: rays.free.sum() // 5]
    sites = sites_with(ONE, rays, chosen)
    pegs = pegs_on(sites, rays, chosen, top, 1.2 * top)
    far = len(sites.knot) // 2
    ends = sites.point[[0]], sites.point[[far]]
    strut = Candidates(np.array([0]), np.array([far]), *ends, top[:1])
    members = join_members([pegs if tapers else replace(pegs, end_radius=None), strut])
    given, rest = members.of([0]), members.of(np.arange(1, len(members)))
    held = HeldFrame(piece_frame(ONE, sites, given, PLA))
    n = len(sites.knot)
    for number in range(len(rest)):
        some, one = rest.of(np.arange(number)), rest.of([number])
        held.hold(some, *springs_of(some, np.zeros(number), PLA))
        more = held.displacements_with_each(one, *springs_of(one, np.zeros(1), PLA))[0, :n]
        anew = piece_frame(ONE, sites, join_members([given, some, one]), PLA).displacements()[:n]
        assert more == pytest.approx(anew, abs=1e-7 * np.abs(anew).max())
        force = np.random.default_rng(number).normal(size=(held.joints, 6))
        force[n:] = 0
        other = piece_frame(ONE, sites, join_members([given, some]), PLA)
        load = np.zeros((other.joints, 6))
        load[:n] = force[:n]
        want = other.response(load)[:n]
        assert held.response(force)[:n] == pytest.approx(want, abs=1e-7 * np.abs(want).max())


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
