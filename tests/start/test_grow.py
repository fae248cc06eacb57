"""Curves grown in the hull of several views: their type, what they keep to, their pieces and bridges."""

from dataclasses import replace

import numpy as np
import pytest
from questions import ask_views
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Point, box

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.problem import Problem, Start
from knotfab.start.grow import Growth, _corners, _plan, _run, grow_curves
from knotfab.start.lattice import NUDGED, Lattice, draw_edges, lattice_in, sights_of
from knotfab.start.lattice_knots import lattice_knot
from knotfab.start.start import make_start
from knotfab.start.views import edge_worth, join_pieces, label_parts, seed_curves
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.search import SearchSettings
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_checks, knot_types

RADIUS = 4.0
DISC = MultiPolygon([Point(0, 0).buffer(38.0)])
SQUARE = MultiPolygon([box(-30, -40, 30, 40)])
RING = MultiPolygon([Point(0, 0).buffer(40.0).difference(Point(0, 0).buffer(16.0))])
APART = MultiPolygon([box(-30, -40, 30, -9), box(-30, 9, 30, 40)])
NECK = MultiPolygon([box(-30, -40, 30, -9).union(box(-2, -10, 2, 10)).union(box(-30, 9, 30, 40))])
DOTS = MultiPolygon([Point(x, y).buffer(12.0) for x in (-22, 22) for y in (-22, 22)])
EYE = box(-2.4, -3, 2.4, 11.6)  # so narrow that it is worth less than two edges
HOW = SearchSettings()


def lattice_of(problem: Problem) -> tuple[Lattice, Array]:
    """An upright lattice in the hull of the problem's views, and the worth of each cell."""
    limits = problem.limits(RADIUS)
    sights, worth = sights_of(problem.views, RADIUS)
    pitch = 1.001 * limits.separation
    return lattice_in(sights, np.eye(3), np.zeros(3), pitch, 60.0, limits, 0.5), worth


def blank(worth: Array) -> Indices:
    """Cells that belong to no piece of a picture."""
    return np.zeros(len(worth), dtype=np.int64)


def curves_of(start: Start) -> Curves:
    """The curves as the validators read them."""
    return Curves(start.curves, start.types, (True,) * len(start.curves), RADIUS)


def test_a_grown_curve_is_a_simple_lattice_polygon() -> None:
    lattice, worth = lattice_of(ask_views([RING, SQUARE], 0.0, 90.0))
    unit = edge_worth(lattice, worth)
    (curve,) = grow_curves(
        lattice, worth, unit, seed_curves(lattice, worth, blank(worth), None), Growth()
    )
    assert len(curve) > 100 and len(np.unique(curve)) == len(curve)  # no node twice: a pitch apart
    steps = np.abs(np.roll(curve, -1) - curve)
    assert np.isin(steps, lattice.strides).all()
    axis = (steps[:, None] == lattice.strides).argmax(1)
    assert lattice.open[3 * np.minimum(curve, np.roll(curve, -1)) + axis].all()


def test_moved_nodes_keep_strands_half_a_pitch_apart() -> None:
    """What the proof asks of a lattice whose nodes were moved: each by a quarter of the pitch at most."""
    problem = ask_views([RING, DISC], 0.0, 90.0)
    lattice, worth = lattice_of(problem)
    at = np.stack(np.unravel_index(np.arange(len(lattice.nodes)), lattice.shape), 1)
    away = lattice.nodes / lattice.pitch - at
    away = np.linalg.norm(away - np.median(away, axis=0), axis=1)
    assert 0.1 < away.max() <= NUDGED + 1e-9
    unit = edge_worth(lattice, worth)
    (curve,) = grow_curves(
        lattice, worth, unit, seed_curves(lattice, worth, blank(worth), None), Growth()
    )
    points, ahead = lattice.nodes[curve], lattice.nodes[np.roll(curve, -1)]
    along = np.linspace(0.0, 1.0, 9)[:, None, None]
    near = cKDTree((points + along * (ahead - points)).reshape(-1, 3))
    one, two = np.unique(
        np.sort(near.query_pairs(0.5 * lattice.pitch, output_type="ndarray") % len(curve)), axis=0
    ).T
    assert (np.minimum(two - one, len(curve) + one - two) <= 1).all()


def test_an_eye_gets_a_curve_however_little_it_draws() -> None:
    """It is most of a picture's piece, though two edges elsewhere draw more."""
    face = MultiPolygon([Point(0, 0).buffer(40.0).difference(box(-20, -20, 20, 20)), EYE])
    problem = ask_views([face, SQUARE], 0.0, 90.0)
    lattice, worth = lattice_of(problem)
    sights, _ = sights_of(problem.views, RADIUS)
    few, more = (
        seed_curves(lattice, worth, parts, None) for parts in (blank(worth), label_parts(sights))
    )
    middle = [lattice.nodes[seed].mean(0) @ problem.views[0].axes[:2].T for seed in more]
    assert len(more) == len(few) + 1 and sum(EYE.contains(Point(at)) for at in middle) == 1


def test_squares_that_share_a_node_are_two_pieces_until_joined() -> None:
    """A curve grows from square to square over an edge: round a node alone it comes nowhere."""
    lattice, worth = lattice_of(ask_views([SQUARE, SQUARE], 0.0, 90.0))
    squares = lattice.squares(lattice.open)
    first = squares[0]
    node = lattice.ends(first[2:3])[1][0]  # the far corner
    corners = np.stack([np.stack(lattice.ends(e)) for e in squares.T])
    other = next(
        s
        for s, c in zip(squares, corners.T, strict=True)
        if node in c and not np.isin(s, first).any()
    )
    opened = np.zeros_like(lattice.open)
    opened[first] = opened[other] = True
    sights, _ = sights_of(ask_views([SQUARE, SQUARE], 0.0, 90.0).views, RADIUS)
    parted = draw_edges(lattice, opened, sights, RADIUS)
    even = np.ones_like(worth)
    # the other has no square without the shared node
    (alone,) = seed_curves(parted, even, blank(even), None)
    with pytest.raises(ValueError, match="begin at one node"):
        grow_curves(parted, even, 1.0, [alone, np.append(alone[1:], node)], Growth())
    joined = join_pieces(parted, sights, even, blank(even), RADIUS, None)
    (seed,) = seed_curves(joined, even, blank(even), None)
    (curve,) = grow_curves(joined, even, 1.0, [seed], Growth())
    assert {*np.unique(lattice.ends(first))} | {*np.unique(lattice.ends(other))} <= {*curve}


def test_each_move_sweeps_a_square_that_no_curve_meets() -> None:
    lattice, worth = lattice_of(ask_views([SQUARE, SQUARE], 0.0, 90.0))
    seeds = seed_curves(lattice, worth, blank(worth), 2)
    count = len(lattice.nodes)
    curve, place = np.zeros(count, np.int64), np.full(count, -1)
    after, before = np.full(count, -1), np.full(count, -1)
    for k, seed in enumerate(seeds):
        after[seed], before[seed] = np.roll(seed, -1), np.roll(seed, 1)
        curve[4 * k : 4 * k + 4], place[seed] = seed, 4 * k + np.arange(4)
    owner = np.zeros(count, np.int64)
    loops = (curve, place, after, before, np.zeros(len(worth), np.int64), owner)
    drawing = (lattice.strides, lattice.open, lattice.starts, lattice.cells, worth)
    old, new, path = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(4, np.int64)
    size, moved, refused = 8, 0, 0
    pick = np.random.default_rng(0)

    def corners() -> int:
        on = curve[:size]
        return int((after[on] - on != on - before[on]).sum())

    for _ in range(4000):
        a = int(curve[pick.integers(size)])
        u = int(pick.choice([-1, 1]) * pick.choice(lattice.strides))
        if abs(int(after[a]) - a) == abs(u):
            continue
        square = [a, a + u, int(after[a]) + u, int(after[a])]
        taken = [node for node in square if after[node] >= 0]
        n = _plan(a, u, loops, drawing, old, new, path)
        # the square's part on a curve is one stretch of it
        joined = sum(after[p] == q or after[q] == p for p in taken for q in taken) // 2
        if n == 0:
            refused += 1
            continue
        assert joined == len(taken) - 1 and set(path[:n]) <= set(square)
        here, more = corners(), _corners(path, n, loops)
        size = _run(path, n, a, loops, size)
        assert corners() - here == more
        assert (after[before[curve[:size]]] == curve[:size]).all() and (after >= 0).sum() == size
        moved += 1
    assert moved > 500 and refused > 100


@pytest.mark.parametrize("pictures", [(RING, RING), (RING, SQUARE, RING)])
def test_what_grew_round_the_hulls_holes_is_proved_an_unknot(
    pictures: tuple[MultiPolygon, ...],
) -> None:
    azimuths = [180.0 / len(pictures) * n for n in range(len(pictures))]
    start = make_start(ask_views(pictures, *azimuths), RADIUS, HOW)
    found = knot_types(curves_of(start))
    assert [k.verdict for k in found.knots] == ["proved"] * len(start.curves)
    assert min(start.ious) > 0.7 and "isotopy" in start.why


@pytest.mark.slow
@pytest.mark.parametrize(("knots", "curves"), [(None, 2), (1, 1), (2, 2), (4, 4)])
def test_each_piece_of_the_hull_gets_a_curve_and_none_is_linked(
    knots: int | None, curves: int
) -> None:
    start = make_start(ask_views([APART, APART], 0.0, 90.0), RADIUS, HOW, knots)
    assert len(start.curves) == curves
    assert knot_checks(curves_of(start))[1].status == "pass"
    across = [c for c in start.curves if c[:, 1].min() < -9 and c[:, 1].max() > 9]
    assert len(across) == (1 if knots == 1 else 0)


def test_a_narrow_neck_parts_no_piece_of_the_hull() -> None:
    (curve,) = make_start(ask_views([NECK, NECK], 0.0, 90.0), RADIUS, HOW).curves
    assert curve[:, 1].min() < -20 and curve[:, 1].max() > 20


def test_pieces_are_bridged_where_it_shows_least() -> None:
    """One picture parts the hull, the other fills the gap: a bridge goes where it fills it, not beside."""
    problem = ask_views([APART, NECK], 0.0, 90.0)
    sights, worth = sights_of(problem.views, RADIUS)
    lattice, _ = lattice_of(problem)
    joined = join_pieces(lattice, sights, worth, blank(worth), RADIUS, 1)
    bridge = lattice.nodes[
        np.unique(np.concatenate(lattice.ends(np.flatnonzero(joined.open & ~lattice.open))))
    ]
    aside = bridge @ problem.views[1].axes[0]
    assert len(bridge) >= 4 and np.abs(aside[np.abs(bridge[:, 1]) < 4.0]).max() < 2.0 * RADIUS
    assert len(seed_curves(joined, worth, blank(worth), 1)) == 1


@pytest.mark.parametrize(
    ("pictures", "knots", "reason"),
    [
        ((MultiPolygon([box(-30, -40, 30, -10)]), MultiPolygon([box(-30, 10, 30, 40)])), None, "at once"),
        ((MultiPolygon([box(-9, -9, 9, 9)]), SQUARE), 60, "has room for"),
    ],
)  # fmt: skip
def test_what_has_no_start_says_why(
    pictures: tuple[MultiPolygon, ...], knots: int | None, reason: str
) -> None:
    with pytest.raises(SceneError, match=reason):
        make_start(ask_views(pictures, 0.0, 90.0), RADIUS, HOW, knots)


@pytest.mark.slow
def test_a_start_repeats_to_the_last_bit_with_its_knots_given() -> None:
    for second in (SQUARE, APART, DOTS):
        problem = ask_views([RING, second], 0.0, 90.0)
        one = make_start(problem, RADIUS, HOW).curves
        two = make_start(problem, RADIUS, HOW, len(one)).curves
        assert len(one) == len(two) and all(map(np.array_equal, one, two))


def test_a_piece_of_the_hull_is_joined_never_across_a_gap() -> None:
    """A slit narrower than the tube, closed at its top alone, in both pictures: bridges lie there."""
    slit = MultiPolygon([box(-34, -40, 34, 40).difference(box(-3, -41, 3, 33))])
    problem = ask_views([slit, slit], 0.0, 90.0)
    (curve,) = make_start(problem, RADIUS, HOW).curves
    for view in problem.views:
        seen = curve @ view.axes.T
        assert np.abs(seen[seen[:, 1] < 25.0, 0]).min() > 1.0
        assert seen[:, 0].min() < -20.0 and seen[:, 0].max() > 20.0


THIN = MultiPolygon([box(-3, -40, 3, 40)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pictures", "azimuths", "above", "curves", "least"),
    [
        ((DISC, SQUARE), (0.0, 20.0), 0.0, 1, 0.85),
        ((DISC, DISC), (0.0, 180.0), 0.0, 1, 0.85),
        ((DISC, SQUARE), (0.0, 0.0), 90.0, 1, 0.85),
        ((DISC,) * 6, (0.0, 30.0, 60.0, 90.0, 120.0, 150.0), 0.0, 1, 0.85),
        ((DOTS, SQUARE), (0.0, 90.0), 0.0, 4, 0.5),
        ((THIN, SQUARE), (0.0, 90.0), 0.0, 1, 0.4),
    ],
    ids=[
        "20 degrees apart",
        "one line",
        "from above",
        "six views",
        "many and one",
        "thin and wide",
    ],
)
def test_hard_sets_have_starts(
    pictures: tuple[MultiPolygon, ...],
    azimuths: tuple[float, ...],
    above: float,
    curves: int,
    least: float,
) -> None:
    problem = ask_views(pictures, *azimuths)
    last = problem.views[-1]
    raised = replace(last, view=last.view.model_copy(update={"elevation_deg": above}))
    start = make_start(replace(problem, views=(*problem.views[:-1], raised)), RADIUS, HOW)
    assert len(start.curves) == curves and min(start.ious) > least
    assert knot_checks(curves_of(start))[1].status in ("pass", "skip")


@pytest.mark.parametrize("name", ["trefoil", "left trefoil", "4_1", "8_19", "3_1#m4_1#m3_1"])
def test_a_lattice_knot_is_short_and_of_its_type(name: str) -> None:
    wanted = parse_knot_name(name)
    nodes = lattice_knot(wanted.factors)
    assert len(np.unique(nodes, axis=0)) == len(nodes) < 110
    assert (np.abs(np.roll(nodes, -1, axis=0) - nodes).sum(1) == 1).all()
    (found,) = knot_types(Curves((5.0 * nodes,), (wanted.promise,), (True,), 1.0)).knots
    assert found.verdict == "proved"
    if name == "trefoil":
        assert len(nodes) == 24  # none is shorter (Diao 1993)


@pytest.mark.slow
def test_of_several_curves_the_first_keeps_the_knot() -> None:
    problem = replace(ask_views([SQUARE, SQUARE], 0.0, 90.0), knot="trefoil")
    start = make_start(problem, 3.0, HOW, knots=3)
    assert start.types == ("right-handed 3_1", "unknot", "unknot")
    found = knot_types(curves_of(start))
    assert [k.verdict for k in found.knots] == ["proved"] * 3
    assert knot_checks(curves_of(start))[1].status == "pass"
