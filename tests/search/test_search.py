"""The search: feasible ends, and clear verdicts where it cannot be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from questions import ask_heart, ask_views, start_and_search
from shapely import MultiPolygon, Point

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.room import depth_extent
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.knots import Knots
from knotfab.limits.feasibility import measure_feasibility
from knotfab.limits.terms import Felt, State
from knotfab.problem import Problem, Start
from knotfab.search import search as module
from knotfab.search.flow import plan_of, repair_phase, three_phases
from knotfab.search.objective import Term, Weights
from knotfab.search.search import Pace, find_stretches, mend_stretches, search
from knotfab.search.state import SearchState, begin_search
from knotfab.start.start import make_start
from knotfab_formats.errors import InputError
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS, search_settings

QUICK = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 96, "coarse_iterations": 30, "depth_candidates": 4},
        **{"fine_px": 160, "fine_iterations": 25},
    }
)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


@pytest.mark.slow
def test_the_search_ends_feasible_and_certified(problem: Problem) -> None:
    result = start_and_search(problem, 3.0, QUICK)
    assert result.feasible and result.feasibility.violations == []
    assert result.log.certified
    assert result.iou_estimate > 0.97
    points = result.knots.points
    across = np.ptp(points[:, :2], axis=0).max()
    assert np.ptp(points[:, 2]) / across > 0.6


@pytest.mark.slow
def test_the_same_seed_gives_the_same_knots(problem: Problem) -> None:
    short = QUICK.model_copy(update={"coarse_iterations": 10, "fine_iterations": 5})
    seen: list[tuple[Knots, bool]] = []
    told: list[float | None] = []
    one = start_and_search(problem, 4.0, short, repairs=0)
    two = start_and_search(  # watched, which must change nothing
        problem,
        4.0,
        short,
        repairs=0,
        watch=lambda knots, certified: seen.append((knots(), certified)),
        report=lambda _, iou: told.append(iou),
    )
    assert (one.knots.points == two.knots.points).all()
    assert len(seen) == short.iterations and all(certified for _, certified in seen)
    assert (seen[-1][0].points == two.knots.points).all()
    assert told[-1] == pytest.approx(two.iou_estimate, abs=0.02)
    coarse = short.but(fine_iterations=0, settle_iterations=0)
    begun = start_and_search(problem, 4.0, coarse, repairs=0).state
    rest = start_and_search(problem, 4.0, short.but(coarse_iterations=0), repairs=0, begun=begun)
    assert (rest.knots.points == one.knots.points).all() and rest.ended == one.ended
    other = start_and_search(problem, 4.0, short.model_copy(update={"seed": 5}), repairs=0)
    assert other.knots.points.shape != one.knots.points.shape or not np.allclose(
        other.knots.points, one.knots.points
    )


@pytest.mark.slow
def test_an_impossible_bend_limit_is_told_with_its_place(problem: Problem) -> None:
    stiff = replace(problem, bend_radius=60.0)
    result = start_and_search(stiff, 4.0, QUICK, repairs=1)
    assert not result.feasible
    (told,) = [v for v in result.feasibility.violations if "bend" in v]
    assert re.search(r"bend radius .* below 60\.000 mm at \(", told)
    assert result.log.certified and result.log.repairs == 1 + plan_of(QUICK).mendings


@pytest.mark.slow
def test_a_length_budget_below_need_is_told(problem: Problem) -> None:
    result = start_and_search(replace(problem, length=200.0), 4.0, QUICK, repairs=1)
    assert not result.feasible
    assert "exceeds the budget of 200 mm" in " ".join(result.feasibility.violations)


def test_bend_radius_of_a_regular_polygon_is_its_inradius() -> None:
    n = 30
    t = np.arange(n) * 2 * np.pi / n
    polygon = np.column_stack([np.cos(t), np.sin(t), 0 * t]) * 7.0
    found = bend_radii(polygon, polylines_of_sizes((n,)))
    np.testing.assert_allclose(found, 7.0 * np.cos(np.pi / n), rtol=1e-12)


@pytest.mark.slow
def test_feasibility_finds_each_violation(problem: Problem) -> None:
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ring = np.column_stack([40 * np.cos(t), 40 * np.sin(t), 0 * t])
    both = np.concatenate([ring, ring + [0, 0, 4.3]])
    rings = polylines_of_sizes((400, 400))
    limits = replace(problem.limits(2.0), region=SettledRegion(size_mm=(100.0, 100.0, 100.0)))
    assert "within 4.300 mm" in measure_feasibility(both, rings, limits).violations[0]
    assert measure_feasibility(both, rings, replace(limits, clearance=0.2)).violations == []
    outside = replace(limits, clearance=0.2, region=SettledRegion(size_mm=(83.9, 100.0, 100.0)))
    assert "leaves the region by 0.05" in measure_feasibility(both, rings, outside).violations[0]
    bent = replace(limits, clearance=0.2, bend_radius=41.0)
    assert "bend radius 39.99" in measure_feasibility(both, rings, bent).violations[0]


def test_unknown_search_keys_are_refused() -> None:
    with pytest.raises(InputError, match="iteration"):
        search_settings("standard", {"iteration": 5})
    with pytest.raises(InputError, match="fine_px"):
        search_settings("standard", {"fine_px": 3})
    assert search_settings("fine", {"seed": 7}).seed == 7
    standard = PRESETS["standard"]
    assert standard.scaled(0.5).coarse_iterations == standard.coarse_iterations / 2


@pytest.mark.slow
def test_a_large_clearance_is_felt_from_far_enough(problem: Problem) -> None:
    # neighbour lists of four radii would miss strands that must keep 5.2 radii apart
    wide = replace(problem, clearance=4.0)
    sparse = make_start(wide, 2.5, QUICK, spacing=3.0)
    result = start_and_search(wide, 2.5, QUICK, sparse)
    assert result.feasibility.gap_mm >= 9.0


def test_a_resolved_depth_is_found_again(problem: Problem) -> None:
    (polygon,) = problem.polygons
    region = SettledRegion(size_mm=(200.0, 200.0, 72.0))
    depth = depth_extent(None, polygon, region, 1.836)
    assert depth is not None
    assert depth_extent(depth, polygon, region, 1.836) == depth
    with pytest.raises(SceneError, match="no room"):
        depth_extent(None, polygon, SettledRegion(size_mm=(200.0, 200.0, 7.0)), 2.0)


# Iterations by the clock: the last phase makes up for the others, and timing leaves no trace.


SETTINGS = PRESETS["draft"].model_copy(update={"coarse_px": 48, "fine_px": 64})
PHASES = three_phases(SETTINGS)


@pytest.fixture(scope="module")
def state() -> SearchState:
    turn = np.linspace(0, 2 * np.pi, 121)[:-1]
    ring = 30.0 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    return begin_search(ask_heart(), Start((ring,), "a circle"), 2.5, SETTINGS)


@pytest.mark.slow
def test_timing_a_phase_leaves_the_search_where_it_was(state: SearchState) -> None:
    points, calls = state.points.copy(), {n: g.calls for n, g in state.guards.items()}
    steps = state.log.accepted
    for number in range(3):
        Pace(lambda _: 1.0).fit(state, PHASES, number)
    np.testing.assert_array_equal(state.points, points)
    assert {n: g.calls for n, g in state.guards.items()} == calls and state.log.accepted == steps


@pytest.mark.slow
def test_the_last_phase_gets_what_the_others_left(
    state: SearchState, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock is played: the first phases cost half as much again as was timed."""
    monkeypatch.setattr(Pace, "_seconds_each", lambda *_: 0.02)
    clock = [6.0]
    pace = Pace(lambda vertices: clock[0])
    for number, dearer in enumerate((1.5, 1.5, 1.0)):
        before = clock[0]
        fitted = pace.fit(state, PHASES, number)
        assert pace.iterations[number] == fitted.iterations
        assert fitted.walk.rate == PHASES[number].walk.rate
        clock[0] -= dearer * 0.02 * fitted.iterations
    kept = module._MENDING / (1.0 + module._MENDING)  # for repairs
    assert clock[0] == pytest.approx(kept * before, abs=0.02)


@pytest.mark.parametrize(("left", "bound"), [(-5.0, "least"), (1e6, "most")])
def test_there_is_a_least_and_a_most(
    left: float, bound: str, state: SearchState, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pace, "_seconds_each", lambda *_: 0.02)
    pace = Pace(lambda _: left)
    for number, phase in enumerate(PHASES):
        count = pace.fit(state, PHASES, number).iterations
        most = round(module._MOST * phase.iterations)
        assert count == (module._LEAST[number] if bound == "least" else most)


# Repairs of single stretches: what violates a limit is mended, and the rest of the curve stays.


COUNT, RADIUS = 240, 3.0
EDGE = 2 * np.pi * 30 / COUNT
DRAFT = PRESETS["draft"].model_copy(update={"grace": 0.0})  # it would mend bends by itself


def room(side: float = 100.0, length: float = 1e4) -> Problem:
    """A ring's own shadow, and limits that a ring keeps."""
    band = Point(0, 0).buffer(33.0, quad_segs=64).difference(Point(0, 0).buffer(27.0, quad_segs=64))
    asked = ask_views([MultiPolygon([band])], 0.0, side_mm=90.0, length=length)
    return replace(asked, region=SettledRegion(size_mm=(side,) * 3))


def ring(kink_mm: float) -> Array:
    """A circle of 30 mm radius with one vertex pushed outwards."""
    t = 2 * np.pi * np.arange(COUNT) / COUNT
    points = np.column_stack([30 * np.cos(t), 30 * np.sin(t), np.zeros(COUNT)])
    points[0, 0] += kink_mm
    return points


class Stiffness(Term):
    """Smooths a kink, and shrinks a circle if it is let."""

    def __call__(self, state: State, weights: Weights) -> Felt:
        p = state.points
        bent = np.roll(p, -1, 0) - 2 * p + np.roll(p, 1, 0)
        slope = 20.0 * (np.roll(bent, 1, 0) - 2 * bent + np.roll(bent, -1, 0))
        return 10.0 * float((bent**2).sum()), slope


class Nothing(Term):
    """A slope of zero everywhere."""

    def __call__(self, state: State, weights: Weights) -> Felt:
        return 0.0, np.zeros_like(state.points)


WITHOUT_LIMITS = Weights(image=0.0, clearance=0.0, bend=0.0, region=0.0, length=0.0)


def begun(points: Array, problem: Problem | None = None, term: Term | None = None) -> SearchState:
    settings = DRAFT.model_copy(update={"settle_edge_radii": EDGE / 0.87 / RADIUS})
    terms = (term or Stiffness(),)
    return begin_search(problem or room(), Start((points,), "a circle"), RADIUS, settings, terms)


def mend(state: SearchState, rounds: int) -> int:
    phase = replace(repair_phase(state.settings, 0), pixels=64, weights=WITHOUT_LIMITS)
    return mend_stretches(state, phase, rounds)


def test_a_kink_is_mended_and_the_far_side_stays() -> None:
    state = begun(ring(0.6))
    start = state.points
    assert state.feasibility().broken == ["bend"]
    rounds = mend(state, 8)
    assert state.feasibility().violations == []
    assert 1 <= rounds <= 8
    assert state.log.accepted > 0 and state.log.certified
    moved = np.linalg.norm(state.points - start, axis=1)
    assert moved[[-1, 0, 1]].max() > 0.1
    assert moved[60:180].max() < 0.005  # more than 30 mm from the kink


def test_what_holds_every_limit_is_left_alone() -> None:
    state = begun(ring(0.0))
    assert mend(state, 8) == 0 and state.log.accepted == 0
    assert np.array_equal(state.points, ring(0.0))


def test_a_stretched_edge_is_cut_before_its_bends_are_judged() -> None:
    """Long edges may turn far by the bend radius, and their mitres stood out of the outline by 0.6 px."""
    kept = np.r_[0:COUNT:2][:4].tolist() + list(range(7, COUNT))
    state, whole = begun(ring(0.0)[kept]), begun(ring(0.0)[kept])
    assert state.feasibility().violations == []
    mend(state, 4)
    assert len(state.points) > len(kept) and state.rings.sizes == (len(state.points),)
    edges = np.linalg.norm(state.points[state.rings.next] - state.points, axis=1)
    assert edges.max() < 1.31 * EDGE
    assert state.feasibility().violations == []
    # but not where the vertices are those of other frames too
    whole.keep_vertices = True
    mend(whole, 4)
    assert len(whole.points) == len(kept)


def test_what_the_rounds_do_not_mend_is_left_as_it_stands() -> None:
    state = begun(ring(0.6), term=Nothing())
    assert mend(state, 2) == 2
    assert state.feasibility().violations


def test_the_stretches_are_those_about_the_violations() -> None:
    kinked = begun(ring(0.6))
    loose = find_stretches(kinked.points, kinked.rings, kinked.feasibility())
    apart = np.linalg.norm(kinked.points - kinked.points[0], axis=1)
    assert loose[apart < 11.0].all() and not loose[apart > 14.0].any()
    # a region that the ring pokes out of at four places: the furthest alone is let go, for now
    outside = begun(ring(0.0), room(side=65.9))
    assert outside.feasibility().broken == ["region"]
    loose = find_stretches(outside.points, outside.rings, outside.feasibility())
    assert 0 < loose.sum() < COUNT / 4
    long = begun(ring(0.0), room(length=10.0))
    assert long.feasibility().broken == ["length"]
    assert not find_stretches(long.points, long.rings, long.feasibility()).any()


def test_one_view_is_mended_gently_by_the_search_itself() -> None:
    """A kink in a ring that draws its picture: the search mends it, and no repair touches the rest."""
    still = {"coarse_iterations": 0, "fine_iterations": 0, "settle_iterations": 0, "fine_px": 160}
    settings = DRAFT.model_copy(update={**still, "settle_edge_radii": EDGE / 0.87 / RADIUS})
    plan = plan_of(settings)
    start = Start((ring(0.6),), "a circle")
    result = search(room(), start, RADIUS, settings, plan=plan)
    assert result.feasible and result.log.certified
    assert 1 <= result.log.repairs <= plan.mendings
    assert result.log.resamplings == 0
    moved = np.linalg.norm(result.knots.points - ring(0.6), axis=1)
    assert moved[60:180].max() < 0.005 < moved[0]
    without = search(room(), start, RADIUS, settings, plan=replace(plan, repairs=0))
    assert not without.feasible and np.array_equal(without.knots.points, ring(0.6))
