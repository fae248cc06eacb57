"""Polygons carried along a motion: every step is certified, a crossing or a polygon too coarse is refused."""

import numpy as np
import pytest
from knot_curves import mirror
from validator_parts import trefoil

from knotfab.geometry.carry import Curves, carry, certify_same_type, refine_parameters, space_evenly
from knotfab.geometry.polylines import polylines_of_sizes


def test_splines_pass_through_their_polygons() -> None:
    curves = Curves.through([trefoil(60, 1.0), 3 * trefoil(40, 1.0)])
    for at, polygon in zip(
        curves.at(curves.knots), (trefoil(60, 1.0), 3 * trefoil(40, 1.0)), strict=True
    ):
        np.testing.assert_allclose(at, polygon, atol=1e-12)
    where = space_evenly(curves.knots, curves.at(curves.knots), curves.periods, 0.2)
    edges = np.linalg.norm(np.diff(curves.at(where)[1], axis=0), axis=1)
    assert abs(edges / 0.2 - 1).max() < 0.05
    finer = refine_parameters(where, curves.periods)
    for coarse, fine, period in zip(where, finer, curves.periods, strict=True):
        assert len(fine) == 2 * len(coarse)
        assert (np.diff(fine) > 0).all()
        assert 0 <= fine[0] < fine[-1] < period
        assert np.isin(coarse, fine).all()


def test_a_refinement_agrees_unless_too_coarse() -> None:
    curves = Curves.through([trefoil(400, 1.0)])

    def agrees(count: int) -> bool:
        where = (np.linspace(0, curves.periods[0], count, endpoint=False),)
        finer = refine_parameters(where, curves.periods)
        motion = curves.at(where), where, curves.at(finer), finer, curves.periods
        return certify_same_type(*motion).reached == 1

    assert agrees(60)
    assert not agrees(5)  # cannot be knotted: a trefoil takes six edges


def test_a_trefoil_and_its_mirror_do_not_agree() -> None:
    where, periods = (np.arange(90.0),), (90.0,)
    one, other = [trefoil(90, 1.0)], [mirror(trefoil(90, 1.0))]
    assert certify_same_type(one, where, one, where, periods).reached == 1
    stuck = certify_same_type(one, where, other, where, periods)
    assert 0.4 < stuck.reached < 0.5  # flat half way


@pytest.mark.parametrize("turn_deg", [60, 120, 150])
def test_a_sharp_corner_is_rounded_in_several_certified_steps(turn_deg: float) -> None:
    # by one step the ends of its shortest edges would go further than those are long
    run, turn = np.arange(6.0)[:, None], np.radians(turn_deg)
    before = -run[::-1] * [1, 0, 0]
    after = run[1:] * [np.cos(turn), np.sin(turn), 0]
    ends = after[-1], before[0]
    back = [ends[0] + [0, 2, 2], (ends[0] + ends[1]) / 2 + [0, 3, 4], ends[1] + [-2, 1, 2]]
    corner = np.concatenate([before, after, back])
    curves = Curves.through([corner])
    where = (np.linspace(0, curves.periods[0], 900, endpoint=False),)
    way = certify_same_type([corner], curves.knots, curves.at(where), where, curves.periods)
    assert way.reached == 1
    assert way.least_margin > 0
    assert way.steps > 1


def test_carrying_proves_a_motion_and_refuses_a_crossing() -> None:
    knot, rings = trefoil(120, 1.0), polylines_of_sizes((120,))

    def turn(points: np.ndarray, share: float) -> np.ndarray:
        c, s = np.cos(3 * share), np.sin(3 * share)
        return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1 + share]]) + 5 * share

    way = carry(knot, rings, turn, 0.3)
    assert way.reached == 1
    np.testing.assert_array_equal(way.points, turn(knot, 1.0))
    assert way.least_margin > 0
    assert way.steps >= 10  # no vertex goes further than 0.3 in one of them

    def untie(points: np.ndarray, share: float) -> np.ndarray:
        return points * [1, 1, 1 - 2 * share]

    stuck = carry(knot, rings, untie, 0.3)
    assert 0.45 < stuck.reached < 0.5  # flat half way
    np.testing.assert_array_equal(stuck.points, untie(knot, stuck.reached))


def test_a_polygon_too_coarse_for_the_map_is_refused() -> None:
    # two rings side by side; the map waves both, and keeps every curve clear of every other
    def ring(vertices: int, y: float) -> np.ndarray:
        x = np.linspace(-8, 8, vertices)
        side = np.column_stack([x, np.full(vertices, y), 0 * x])
        return np.concatenate([side, side[::-1] + [0, np.sign(y) * 3, 0]])

    def wave(points: np.ndarray, share: float) -> np.ndarray:
        wave = share * np.sin(np.pi * points[:, 0])
        return points + np.stack([0 * wave, wave, 0 * wave], axis=1)

    fine = ring(161, 0.1)
    coarse = ring(9, -0.1)  # vertices where the map stands still
    both = polylines_of_sizes((len(fine), len(coarse)))
    assert carry(np.concatenate([fine, coarse]), both, wave, 0.5).reached < 0.5
    even = polylines_of_sizes((len(fine), len(fine)))
    assert carry(np.concatenate([fine, ring(161, -0.1)]), even, wave, 0.5).reached == 1
