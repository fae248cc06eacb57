"""Knot types: proofs on curves whose type is known, and promises that must be refuted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from knotfab_validators.knot_invariants import determinant, linking_number
from knotfab_validators.knot_reduction import reduce_polygons
from knotfab_validators.knot_type import check_knot_type, knot_types
from knotfab_validators.read_knots import Curves

Array = NDArray[np.float64]


def curves(*polygons: Array, types: tuple[str, ...] | None = None) -> Curves:
    n = len(polygons)
    return Curves(polygons, types or ("unknot",) * n, (True,) * n, 1.0)


def circle(n: int = 100, radius: float = 1.0) -> Array:
    s = 2 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(s), np.sin(s), 0 * s])


def torus_knot(p: int, q: int, n: int = 400) -> Array:
    s = 2 * np.pi * np.arange(n) / n
    r = 2 + np.cos(q * s)
    return np.column_stack([r * np.cos(p * s), r * np.sin(p * s), np.sin(q * s)])


def figure_eight(n: int = 400) -> Array:
    s = 2 * np.pi * np.arange(n) / n
    r = 2 + np.cos(2 * s)
    return np.column_stack([r * np.cos(3 * s), r * np.sin(3 * s), np.sin(4 * s)])


def turned(points: Array, seed: int) -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return points @ q.T


def filling(n: int, seed: int, rows: int = 24) -> Array:
    """A comb that fills a square: simple from above, at a random smooth depth; so an unknot."""
    rng = np.random.default_rng(seed)
    corners = [(0.0, 0.0)]
    for k in range(rows):
        corners += [(8.0, k * 4.0), (100.0, k * 4.0)][:: 1 if k % 2 == 0 else -1]
    corners += [(0.0, corners[-1][1]), (0.0, 0.0)]
    path = np.array(corners)
    length = np.concatenate([[0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
    s = np.linspace(0, length[-1], n, endpoint=False)
    angle = 2 * np.pi * s / length[-1]
    waves = [rng.normal() * np.cos(k * angle + rng.uniform(0, 7)) for k in range(1, 60)]
    depth = np.sum(waves, axis=0)
    flat = [np.interp(s, length, path[:, 0]), np.interp(s, length, path[:, 1])]
    return np.column_stack([*flat, 30 * depth / depth.std()])


def seen_from_a_lamp(points: Array, distance: float = 150.0) -> Array:
    """A projective map of space, so that the curve is simple from one point and from no side."""
    return np.column_stack([points[:, :2] * (1 - points[:, 2:] / distance), points[:, 2]])


# --- proofs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [3, 4, 5, 100])
def test_a_flat_polygon_is_an_unknot_however_it_lies(n: int) -> None:
    for seed in range(3):
        found = check_knot_type(curves(turned(circle(n), seed)))
        assert (found.status, found.measured, found.limit) == ("pass", "unknot, proved", "unknot")


@pytest.mark.parametrize("seed", range(3))
def test_a_tangle_of_4000_vertices_is_proved_to_be_an_unknot(seed: int) -> None:
    """Crossings in every projection along an axis: it takes the reduction to see it."""
    for tangle in (turned(filling(4000, seed), seed), seen_from_a_lamp(filling(4000, seed))):
        found = check_knot_type(curves(tangle))
        assert (found.status, found.measured) == ("pass", "unknot, proved")


def test_the_reduction_alone_suffices_where_a_projection_would() -> None:
    assert reduce_polygons([filling(1500, 7)]).vertices == 0


def test_a_coil_closed_beside_or_along_its_axis_is_an_unknot() -> None:
    s = np.linspace(0, 1, 400)
    turns = 2 * np.pi * 12 * s
    coil = np.column_stack([np.cos(turns), np.sin(turns), 10 * s])
    for back in ([[0.0, 0, 11], [5, 0, 5], [0, 0, -1]], [[0.0, 0, 11], [0, 0, -1]]):
        closed = turned(np.concatenate([coil, back]), 1)
        assert check_knot_type(curves(closed)).measured == "unknot, proved"


def test_unlinks_are_proved() -> None:
    apart = curves(circle(), turned(circle(), 1) + np.array([3.0, 0, 0]), circle() * 0.5)
    found = check_knot_type(apart)
    assert found.status == "pass" and found.measured == "unlink of 3 unknots, proved"
    assert found.limit == "unlink of 3 unknots"
    halves = [turned(filling(1000, 1), 2), turned(filling(1000, 2) + np.array([0, 0, 60.0]), 2)]
    above = check_knot_type(curves(halves[0], halves[1] + np.array([0.13, 0.17, 300])))
    assert above.status == "pass" and above.measured == "unlink of 2 unknots, proved"


# --- promises that must be refuted ----------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_rejects_a_trefoil_promised_as_an_unknot(seed: int) -> None:
    for knot, number in ((torus_knot(2, 3), 3), (figure_eight(), 5), (torus_knot(2, 5), 5)):
        found = check_knot_type(curves(turned(knot, seed)))
        assert found.status == "fail" and found.required and found.name == "knot_type"
        assert found.measured == f"not an unknot (determinant {number})"


@pytest.mark.parametrize("seed", range(3))
def test_rejects_a_small_trefoil_tied_into_a_big_tangle(seed: int) -> None:
    """On the comb's free side, one of some 4000 vertices' stretches is replaced by a knot."""
    tangle = filling(4000, seed)
    stretch = np.flatnonzero((tangle[:, 0] == 0) & (np.abs(tangle[:, 1] - 46) < 3))
    t = np.linspace(-2.1, 2.1, 60)
    along, aside, up = t**3 - 3 * t, t**4 - 4 * t**2, t**5 / 5 - 2 * t  # an open trefoil
    middle = tangle[stretch].mean(axis=0)
    knot = middle + np.column_stack([0.5 * (aside - 2), -0.8 * along, 0.3 * up])
    tied = np.concatenate([tangle[: stretch[0]], knot, tangle[stretch[-1] + 1 :]])
    found = check_knot_type(curves(turned(tied, seed)))
    assert found.status == "fail" and found.measured == "not an unknot (determinant 3)"
    assert check_knot_type(curves(turned(tied, seed), types=("3_1",))).status == "pass"
    assert check_knot_type(curves(turned(tangle, seed))).status == "pass"


def test_rejects_linked_rings_promised_as_an_unlink() -> None:
    hopf = curves(circle(200), circle(200)[:, [0, 2, 1]] + np.array([1.0, 0, 0]))
    found = check_knot_type(hopf)
    assert found.status == "fail" and "linked" in str(found.measured)
    assert "knots 0 and 1" in found.detail
    beside = circle() + np.array([0, 9.0, 0])
    assert check_knot_type(curves(beside, *hopf.polygons)).status == "fail"


def test_rejects_an_unknot_promised_as_a_trefoil() -> None:
    found = check_knot_type(curves(turned(circle(), 1), types=("trefoil",)))
    assert found.status == "fail" and found.measured == "unknot, proved"
    other = check_knot_type(curves(figure_eight(), types=("trefoil",)))
    assert other.status == "fail" and other.measured == "not a trefoil (determinant 5)"


def test_rejects_polygons_that_touch() -> None:
    crossing = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    assert check_knot_type(curves(crossing)).status == "fail"
    touching = circle(100) + np.array([2.0, 0, 0])  # vertices of both at (1, 0, 0)
    assert check_knot_type(curves(circle(100), touching)).status == "fail"


# --- what is only consistent, and what cannot be told ---------------------------------------


@pytest.mark.parametrize(
    ("kind", "knot"),
    [("trefoil", torus_knot(2, 3)), ("3_1", torus_knot(3, 2)), ("figure-eight", figure_eight())],
)
def test_knots_are_consistent_with_their_names(kind: str, knot: Array) -> None:
    found = check_knot_type(curves(turned(knot, 4), types=(kind,)))
    assert found.status == "pass" and found.measured == f"{kind}, consistent"


def test_borromean_rings_are_not_called_proved() -> None:
    """Each pair is unlinked, all three not. No number here refutes them."""
    s = 2 * np.pi * np.arange(120) / 120
    a = np.column_stack([2 * np.cos(s), np.sin(s), 0 * s])
    rings = [a, a[:, [2, 0, 1]], a[:, [1, 2, 0]]]
    found = knot_types(curves(*rings))
    assert all(knot.verdict == "proved" for knot in found.knots)
    assert not found.split and not found.linked
    assert check_knot_type(curves(*rings)).measured == "unlink of 3 unknots, consistent"


def test_skips_what_it_does_not_know() -> None:
    unknown = check_knot_type(curves(torus_knot(2, 3), types=("12n_242",)))
    assert unknown.status == "skipped" and not unknown.required
    line = Curves((circle(),), ("unknot",), (False,), 1.0)
    assert check_knot_type(line).status == "skipped"


# --- the numbers ----------------------------------------------------------------------------


def test_determinants_of_torus_knots() -> None:
    for q in (3, 5, 7, 9):
        assert determinant(torus_knot(2, q)) == q  # T(2, q) has determinant q
    assert determinant(torus_knot(3, 4)) == 3
    assert determinant(circle()) == 1


def test_linking_number_of_two_strands_of_a_torus() -> None:
    s = 2 * np.pi * np.arange(300) / 300
    for turns in (-3, -1, 0, 2):
        r = 3 + np.cos(turns * s)
        one = np.column_stack([r * np.cos(s), r * np.sin(s), np.sin(turns * s)])
        core = circle(100, 3.0)
        found = linking_number(one, core)
        assert abs(found) == abs(turns) and found == linking_number(core, one)
        mirrored = linking_number(one * [1, 1, -1], core * [1, 1, -1])
        assert mirrored == -found
