"""Reduction: every removal is an isotopy, so unknots vanish and knots stay; diagrams and linking numbers."""

from __future__ import annotations

import numpy as np
import pytest
from knot_curves import Array, diagram, random_markov
from validator_parts import circle, tangle, trefoil

from knotfab_validators.knots.alexander import colouring_number
from knotfab_validators.knots.invariants import invariants
from knotfab_validators.knots.names import Factor, braid_of, braid_word, known_knot, prime_names
from knotfab_validators.knots.planar_diagram import closed_braid
from knotfab_validators.knots.projection import diagram_of, seen_from
from knotfab_validators.knots.reduction import (
    Budget,
    Reduced,
    TooTangled,
    general_position,
    may_pierce,
    nearest_approach,
    orientation,
    reduce_polygons,
    touching_place,
)
from knotfab_validators.knots.rerouting import reroute, summands


def reduce_placed(*polygons: Array, shakes: int = 0) -> Reduced:
    placed = general_position(polygons)
    assert placed is not None
    return reduce_polygons(placed, shakes=shakes)


def determinant(polygon: Array) -> int:
    """Modulo 2^31 - 1, up to sign."""
    found = diagram_of([polygon], most=5000)
    assert found is not None
    return colouring_number(found)


def linking_number(one: Array, other: Array) -> int:
    found = diagram_of([one, other], most=5000)
    assert found is not None
    return found.linking_numbers().get((0, 1), 0)


def depth(n: int, rng: np.random.Generator, size: float = 30.0) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    terms = [rng.normal() * np.cos(k * t) + rng.normal() * np.sin(k * t) for k in range(1, 17)]
    return np.asarray(size / 4 * np.sum(terms, axis=0))


def spiral(n: int, turns: int, rng: np.random.Generator) -> Array:
    """A band wound up: simple seen along z, at random depths."""
    t = np.linspace(0.0, 1.0, n // 2)
    sides = []
    for inner in (0.0, 24.0 / turns):
        radius = 10 + 60 * t - inner
        angle = 2 * np.pi * turns * t
        sides.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    flat = np.concatenate([sides[0], sides[1][::-1]])
    return np.column_stack([flat, depth(len(flat), rng)])


@pytest.mark.parametrize("seed", range(6))
def test_a_simple_curve_at_random_depths_is_an_unknot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert reduce_placed(spiral(600 + 400 * seed, 4 + seed, rng), shakes=40).vertices == 0


@pytest.mark.parametrize("sides", [3, 4, 5, 100])
def test_a_plane_polygon_is_an_unknot_though_all_its_signs_are_0(sides: int) -> None:
    assert reduce_placed(circle(sides)).vertices == 0
    # many vertices lie on each side of a square
    s = np.linspace(0, 1, 20, endpoint=False)[:, None]
    corner = np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]])
    square = np.concatenate([a + s * (corner[(i + 1) % 4] - a) for i, a in enumerate(corner)])
    assert reduce_placed(square).vertices == 0


def test_random_smooth_curves_vanish_or_keep_their_determinant() -> None:
    for seed in range(8):
        curve = tangle(300, seed)
        rest = reduce_placed(curve)
        assert determinant(rest.polygons[0] if rest.vertices else circle(5)) == determinant(curve)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_tangled_polygons_keep_their_determinant(seed: int) -> None:
    """Polygons of random vertices: some are knotted; no wrong move may change the invariant."""
    curve = np.random.default_rng(seed).normal(size=(30, 3))
    rest = reduce_placed(curve, shakes=5)
    assert determinant(rest.polygons[0] if rest.vertices else circle(5)) == determinant(curve)


@pytest.mark.parametrize("seed", range(12))
def test_random_links_keep_their_linking_number(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(2, 12, 3))
    rest = reduce_placed(one, other)
    left = dict(zip(rest.components, rest.polygons, strict=True))
    now = linking_number(left[0], left[1]) if len(left) == 2 else 0
    assert now == linking_number(one, other)


def test_knots_do_not_vanish() -> None:
    assert 6 <= reduce_placed(trefoil(400), shakes=10).vertices < 20
    assert 6 <= reduce_placed(trefoil(400) @ np.diag([1, 1, -1]), shakes=10).vertices < 20


def test_links_do_not_vanish_and_unlinks_do() -> None:
    ring = circle(60, 10.0)
    through = ring[:, [2, 0, 1]] + [0.0, 10.0, 0.0]
    assert reduce_placed(ring, through, shakes=3).components == (0, 1)
    assert reduce_placed(ring, through + [0.0, 10.5, 0.0]).vertices == 0
    assert reduce_placed(ring, 2 * ring, 3 * ring).vertices == 0
    # the one that is apart goes, whatever its number
    assert reduce_placed(ring, ring + 50, through).components == (0, 2)


def test_borromean_rings_do_not_vanish() -> None:
    t = 2 * np.pi * np.arange(80) / 80
    oval = np.column_stack([3 * np.cos(t), 1.5 * np.sin(t), np.zeros(80)])
    rings = [oval, oval[:, [2, 0, 1]], oval[:, [1, 2, 0]]]
    pairs = [(0, 1), (1, 2), (2, 0)]
    assert all(linking_number(rings[i], rings[j]) == 0 for i, j in pairs)
    assert reduce_placed(*rings, shakes=5).components == (0, 1, 2)
    assert all(reduce_placed(rings[i], rings[j]).vertices == 0 for i, j in pairs)


def test_polygons_that_touch_have_no_general_position() -> None:
    cross = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0]])
    assert general_position([cross]) is None
    assert general_position([circle(40), circle(40) + [80.0, 0, 0]]) is None
    fold = np.array([[0.0, 0, 0], [5, 0, 0], [2, 1e-9, 0], [2, 3, 0]])
    assert general_position([fold]) is None
    near = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 1e-8], [-1, 1, 1e-8]])
    assert general_position([near]) is not None  # not quite: a smaller shift will do
    repeated = np.array([[0.0, 0, 0], [5, 0, 0], [5, 0, 0], [2, 3, 0]])
    assert general_position([repeated]) is None


def test_general_position_moves_little() -> None:
    curve = trefoil(200)
    edge = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1).min()
    placed = general_position([curve, curve + 200])
    assert placed is not None and len(placed) == 2
    moved = np.linalg.norm(placed[0] - curve, axis=1)
    assert 0 < moved.max() <= 1e-5 * edge * (1 + 1e-9)


def test_orientation_is_sure_or_says_0() -> None:
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 500, 3))
    weights = rng.dirichlet([1, 1, 1], 500).T[:, :, None]
    on_plane = weights[0] * a + weights[1] * b + weights[2] * c
    assert (orientation(a, b, c, on_plane) == 0).mean() > 0.9
    normal = np.cross(b - a, c - a)
    above, below = orientation(a, b, c, a + normal), orientation(a, b, c, a - normal)
    assert (above == -below).all() and (above == above[0]).all() and above[0] != 0


def test_a_segment_is_told_from_one_that_pierces() -> None:
    a, b, c = (np.array([p]) for p in ([0.0, 0, 0], [1.0, 2, 0], [2.0, 0, 0]))

    def meets(p: list[float], q: list[float]) -> bool:
        return bool(may_pierce(a, b, c, np.array([p], float), np.array([q], float))[0])

    assert meets([1, 0.5, -1], [1, 0.5, 1])
    assert not meets([1, 0.5, 0.1], [1, 0.5, 1])
    assert not meets([3, 3, -1], [3, 3, 1])
    assert meets([1, 0, -1], [1, 0, 1])  # through the side
    assert meets([1, 0.5, 0], [3, 3, 0])  # in its plane: not certain, so it counts
    assert not meets([2, 0, 0], [3, 0.1, 0.2])  # leaves from a corner
    assert meets([2, 0, 0], [1, 0.5, 0])  # leaves from a corner into the triangle


def test_where_polygons_touch_and_are_nearest() -> None:
    cross = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0]])
    assert touching_place([cross]) == pytest.approx([0, 0, 0], abs=1e-9)
    two = [circle(40), circle(40) + [80.0, 0, 0]]
    assert touching_place(two) == pytest.approx([40, 0, 0], abs=1e-9)
    fold = np.array([[0.0, 0, 0], [5, 0, 0], [2, 1e-9, 0], [2, 3, 0]])
    place = touching_place([fold])
    assert 2 <= place[0] <= 5 and place[1:] == pytest.approx([0, 0], abs=1e-8)
    repeated = np.array([[0.0, 0, 0], [5, 0, 0], [5, 0, 0], [2, 3, 0]])
    assert touching_place([repeated]) == pytest.approx([5, 0, 0])
    assert nearest_approach(circle(40), circle(40) + [90.0, 0, 0]) == pytest.approx([45, 0, 0])
    above = np.array([[-9.0, 0, 4], [9, 0, 4], [0, 0, 30]])
    below = np.array([[0.0, -9, 2], [0, 9, 2], [0, 0, -30]])
    assert nearest_approach(above, below) == pytest.approx([0, 0, 3], abs=1e-9)


def test_a_spent_budget_ends_the_work_and_not_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    rest = reduce_polygons([trefoil(400)], budget=Budget(2000))
    assert 20 < rest.vertices <= 400 and determinant(rest.polygons[0]) == 3
    budget = Budget(10)
    budget.spend(10)
    with pytest.raises(TooTangled):
        budget.spend(1)
    tangled = np.random.default_rng(0).normal(size=(300, 3))
    assert general_position([tangled]) is not None
    monkeypatch.setattr("knotfab_validators.knots.reduction.Budget", lambda: Budget(1000))
    with pytest.raises(TooTangled):
        general_position([tangled])


# Runs laid elsewhere: fewer crossings, and the same knot.


@pytest.mark.parametrize("name", [*prime_names()[5:80:9], *prime_names()[90::12]])
def test_braids_come_down_to_the_crossings_of_the_table(name: str) -> None:
    diagram = closed_braid(random_markov(list(braid_word(name)), 12, seed=1))
    least = int(name.split("_")[0])
    found = reroute(diagram, enough=least)
    assert len(found.crossings) == least
    assert invariants(found) == invariants(closed_braid(braid_word(name)))


def test_unknots_come_down_to_nothing() -> None:
    for seed in range(4):
        assert not reroute(closed_braid(random_markov([1, -2, 3], 60, seed))).crossings


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize(("p", "q"), [(2, 11), (3, 7)])
def test_no_diagram_has_fewer_crossings_than_its_knot(p: int, q: int) -> None:
    """A torus knot, drawn as the closed braid that no diagram has fewer crossings than."""
    assert len(reroute(closed_braid([*range(1, p)] * q)).crossings) == (p - 1) * q


@pytest.mark.usefixtures("brief")
def test_sums_fall_into_their_summands_and_prime_diagrams_do_not() -> None:
    knot = known_knot((Factor(3, 1, 1), Factor(4, 1, 0), Factor(5, 2, -1)))
    parts = summands(reroute(closed_braid(braid_of(knot)), enough=12))
    assert sorted(len(part.crossings) for part in parts) == [3, 4, 5]
    product = invariants(parts[0]) * invariants(parts[1]) * invariants(parts[2])
    assert product == knot.invariants
    (alone,) = summands(reroute(closed_braid(braid_word("10_123"))))
    assert len(alone.crossings) == 10


def test_linking_numbers_agree_with_gauss_integral() -> None:
    found = []
    for seed in range(20):
        one, other = np.random.default_rng(seed).normal(size=(2, 14, 3))
        found.append(diagram(one, other).linking_numbers().get((0, 1), 0))
        assert found[-1] == pytest.approx(gauss(one, other), abs=1e-9)
    assert min(found) < 0 < max(found)


def gauss(one: Array, other: Array) -> float:
    """Gauss' double integral over all pairs of edges, each in closed form as a solid angle."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    normals = [np.cross(c - a, d - a), np.cross(d - a, d - b)]
    normals += [np.cross(d - b, c - b), np.cross(c - b, c - a)]
    unit = [n / np.linalg.norm(n, axis=2, keepdims=True) for n in normals]
    angle = sum(
        np.arcsin(np.clip((unit[k] * unit[(k + 1) % 4]).sum(axis=2), -1, 1)) for k in range(4)
    )
    sign = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=2))
    return float((angle * sign).sum() / (4 * np.pi))


def test_a_direction_in_which_a_sign_is_uncertain_is_left_aside() -> None:
    cross = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 1], [0, 2, 1], [0, -2, 1], [-1, -2, 0.5]])
    assert seen_from([cross], np.array([0.0, 0.0, 1.0])) is not None
    for hit in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):  # along an edge
        assert seen_from([cross], np.array(hit)) is None
    over = cross.copy()
    over[3:5, 0] = 1.0  # three edges through one point of the picture
    assert seen_from([over], np.array([0.0, 0.0, 1.0])) is None
    assert diagram_of([np.random.default_rng(0).normal(size=(200, 3))], most=100) is None
