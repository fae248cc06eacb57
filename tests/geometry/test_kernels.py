"""The compiled loops over segments against brute force, and their slopes against finite differences."""

import numpy as np
import pytest
import torch

from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify, step_limits
from knotfab.geometry.kernels import bend_hinge, closest_parameters, gap_hinge
from knotfab.geometry.measures import (
    Neighbours,
    bend_radii,
    find_neighbours,
    segment_distance,
    strand_gap,
)
from knotfab.geometry.polylines import (
    Polylines,
    arc_lengths,
    polylines_of_sizes,
    row_lengths,
    sample_evenly,
    sum_rows,
)
from knotfab.render.device import known

SKIP = 6


def crumpled(seed: int, noise: float = 0.15) -> tuple[Array, Polylines]:
    """Two closed curves that run into each other."""
    rng = np.random.default_rng(seed)
    sizes = (40, int(rng.integers(8, 60)))
    parts = []
    for size in sizes:
        t = np.arange(size) / size * 2 * np.pi
        loop = np.column_stack([5 * np.cos(t), 4 * np.sin(2 * t), 2 * np.sin(3 * t)])
        parts.append(loop + rng.normal(size=3))
    points = np.concatenate(parts)
    return points + noise * rng.normal(size=points.shape), polylines_of_sizes(sizes)


def test_rows_are_summed_to_the_bit_as_by_numpy() -> None:
    for rows in (crumpled(0)[0], np.zeros((2, 3)), crumpled(1)[0] * [1e-9, 1e7, 1.0]):
        np.testing.assert_array_equal(sum_rows(rows), rows.sum(axis=1))
        np.testing.assert_array_equal(row_lengths(rows), np.linalg.norm(rows, axis=1))


def gaps(points: Array, rings: Polylines, i: Array, j: Array) -> Array:
    """Distances of segments, by many samples each and then exactly about the best."""
    ahead = points[rings.next]
    s, t = closest_parameters(points[i], (ahead - points)[i], points[j], (ahead - points)[j])
    apart = points[i] + s[:, None] * (ahead - points)[i]
    apart -= points[j] + t[:, None] * (ahead - points)[j]
    return np.asarray(np.linalg.norm(apart, axis=1))


def monotone(edges: Array, heading: Array) -> bool:
    return bool((edges @ heading > 0).all())


@pytest.mark.parametrize("seed", range(40))
def test_a_margin_is_below_that_of_every_pair_and_near_the_least(seed: int) -> None:
    points, rings = crumpled(seed)
    rng = np.random.default_rng(seed)
    step = rng.normal(size=points.shape) * 10 ** rng.uniform(-4, -1.5)
    near = find_neighbours(points, rings, 12.0, SKIP)
    verdict = certify(points, step, rings, near)
    if verdict.reason == "adjacent segments may fold back":
        old = points[rings.next] - points
        new = old + step[rings.next] - step
        unit = old / np.linalg.norm(old, axis=1)[:, None]
        towards = unit + unit[rings.next]
        folds = [(e * towards).sum(1).min() for x in (old, new) for e in (x, x[rings.next])]
        assert min(folds) <= 0
        return
    rows = np.arange(len(points))
    i, j = (x.ravel() for x in np.meshgrid(rows, rows))
    apart = rings.index_distance(i, j)
    i, j, apart = i[apart >= 2], j[apart >= 2], apart[apart >= 2]
    moved = np.zeros(len(i))
    for a in (i, rings.next[i]):
        for b in (j, rings.next[j]):
            moved = np.maximum(moved, np.linalg.norm(step[a] - step[b], axis=1))
    slack = gaps(points, rings, i, j) - moved
    edges = points[rings.next] - points
    after = edges + step[rings.next] - step
    for n in np.flatnonzero(apart < SKIP):
        first = i[n] if rings.ahead(int(apart[n]))[i[n]] == j[n] else j[n]
        run = [first]
        for _ in range(apart[n]):
            run.append(int(rings.next[run[-1]]))
        heading = points[rings.next[run[-1]]] - points[first]
        if monotone(edges[run], heading) and monotone(after[run], heading):
            slack[n] = np.inf  # they cannot meet, whatever their distance
    assert verdict.valid == (slack.min() > 0)
    assert verdict.margin <= slack.min() + 1e-12


def test_limits_are_shares_of_the_least_gap() -> None:
    points, rings = crumpled(3)
    near = find_neighbours(points, rings, 12.0, SKIP)
    wanted = np.full(len(points), 2.0)
    distance = gaps(points, rings, near.i, near.j)
    for rows in (near.i, rings.next[near.i], near.j, rings.next[near.j]):
        np.minimum.at(wanted, rows, 0.45 * distance)
    found = step_limits(points, rings, near, 2.0)
    np.testing.assert_allclose(found, np.minimum(wanted, 2.0), rtol=1e-12)
    assert found.min() < 1.0


def hinge_of_gaps(points: Array, rings: Polylines, near: Neighbours) -> tuple[float, Array]:
    lists = (rings.next, rings.start, rings.size, near.i, near.j)
    return gap_hinge(points, *lists, 20.0, 7.5, 2.0)


def test_the_hinge_of_gaps_sums_pairs_that_are_not_neighbours() -> None:
    points, rings = crumpled(5)
    near = find_neighbours(points, rings, 12.0, SKIP)
    far = rings.index_distance(near.i, near.j) > 7.5
    short = np.maximum(2.0 - gaps(points, rings, near.i[far], near.j[far]), 0.0)
    assert 0 < (short > 0).sum() < far.sum()
    assert hinge_of_gaps(points, rings, near)[0] == pytest.approx(float((short**2).sum()))


def test_the_hinge_of_bends_is_that_of_their_radii() -> None:
    points, rings = crumpled(6)
    over = np.maximum(1.3 / bend_radii(points, rings) - 1, 0.0)
    assert 0 < (over > 0).sum() < len(over)
    total, _ = bend_hinge(points, rings.next, 1.3)
    assert total == pytest.approx(float((over**2).sum()), rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_slopes_of_hinges_against_finite_differences(seed: int) -> None:
    points, rings = crumpled(seed)
    near = find_neighbours(points, rings, 12.0, SKIP)
    rng = np.random.default_rng(seed)
    for hinge in (
        lambda p: hinge_of_gaps(p, rings, near),
        lambda p: bend_hinge(p, rings.next, 1.3),
    ):
        _, gradient = hinge(points)
        for _ in range(3):
            way = rng.normal(size=points.shape)
            h = 1e-6
            slope = (hinge(points + h * way)[0] - hinge(points - h * way)[0]) / (2 * h)
            assert float((gradient * way).sum()) == pytest.approx(slope, rel=1e-4)


def test_a_known_gradient_is_scaled_and_cast() -> None:
    a = torch.ones(2, 3, requires_grad=True)
    b = torch.ones(3, dtype=torch.float64, requires_grad=True)
    value = known(2.5, (a, np.full((2, 3), 7.0)), (b, np.arange(3.0)))
    one, two = torch.autograd.grad(4 * value, (a, b))
    assert float(value.detach()) == 2.5 and one.dtype == torch.float32
    assert bool((one == 28).all()) and two.tolist() == [0.0, 4.0, 8.0]


@pytest.mark.parametrize("straight", [np.inf, 0.7])
def test_the_least_gap_is_among_pairs_that_are_not_neighbours(straight: float) -> None:
    for seed in range(10):
        points, rings = crumpled(seed, noise=0.02)
        rows = np.arange(len(points))
        i, j = (x.ravel() for x in np.meshgrid(rows, rows))
        keep = (i < j) & (rings.index_distance(i, j) >= 2)
        i, j = i[keep], j[keep]
        edge = np.linalg.norm(points[rings.next] - points, axis=1)
        middle = np.cumsum(edge) - 0.5 * edge
        around = np.array([edge[rings.ring == r].sum() for r in rings.ring])
        arc = np.abs(middle[i] - middle[j])
        arc = np.minimum(arc, around[i] - arc)
        gap, same = gaps(points, rings, i, j), rings.ring[i] == rings.ring[j]
        for separation in (0.05, 0.5, 3.0):
            far = ~same | (arc > 0.5 * np.pi * separation)
            far &= ~same | (gap <= straight * arc)
            wanted = min(gap[far].min(initial=np.inf), 3 * separation)
            found = strand_gap(points, rings, separation, 3 * separation, straight)
            assert found.gap == pytest.approx(wanted, rel=1e-12)
            if found.gap < 3 * separation:
                assert gaps(points, rings, [found.i], [found.j])[0] == pytest.approx(wanted)


# Even samples of closed polylines: on the curve, evenly, and as many as were asked for.


SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])


def test_arc_lengths_close_the_curve() -> None:
    assert arc_lengths(SQUARE).tolist() == [0.0, 4.0, 8.0, 12.0, 16.0]
    assert arc_lengths(SQUARE, closed=False).tolist() == [0.0, 4.0, 8.0, 12.0]


@pytest.mark.parametrize(
    ("step", "at_most", "count"),
    [(1.0, False, 16), (1.04, False, 15), (1.04, True, 16), (1.0, True, 16), (9.0, False, 8)],
)
def test_samples_of_a_square(step: float, at_most: bool, count: int) -> None:
    found = sample_evenly(SQUARE, step, at_most=at_most)
    assert len(found) == count and (found[0] == SQUARE[0]).all()
    inside = np.abs(found - 2.0).max(axis=1)
    assert inside == pytest.approx(2.0)  # each lies on one of the sides
    along = np.where(found[:, 1] == 0, found[:, 0], 0.0)
    sides = along[(found[:, 1] == 0) & (found[:, 0] < 4)]
    assert np.diff(sides) == pytest.approx(16.0 / count)


def test_samples_in_space_are_equally_far_along_an_uneven_circle() -> None:
    t = 2 * np.pi * np.sort(np.random.default_rng(0).random(4000))
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    found = sample_evenly(circle, 0.1)
    edges = np.linalg.norm(np.diff(found, axis=0, append=found[:1]), axis=1)
    assert edges == pytest.approx(np.full(63, 2 * np.pi / 63), rel=5e-3)


def test_the_fewest_samples() -> None:
    assert len(sample_evenly(SQUARE, 100.0, fewest=12)) == 12


# Distances of segments, against dense samples.


def test_segments_as_near_as_dense_samples_say() -> None:
    random = np.random.default_rng(3)
    a, b, c, d = random.normal(size=(4, 300, 3))
    d[:20] = c[:20] + (b - a)[:20] * 1.3  # parallel ones
    found = segment_distance(a, b, c, d)
    t = np.linspace(0, 1, 160)[:, None, None]
    p, q = a + t * (b - a), c + t * (d - c)
    dense = np.array(
        [np.linalg.norm(p[:, None, i] - q[None, :, i], axis=2).min() for i in range(300)]
    )
    assert (found <= dense + 1e-12).all() and (dense - found < 0.03).all()
    cross = segment_distance(
        *(np.array([x], dtype=float) for x in ([-1, 0, 0], [1, 0, 0], [0, -1, 2], [0, 1, 2]))
    )
    assert cross == pytest.approx([2.0])
