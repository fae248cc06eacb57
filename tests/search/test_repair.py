"""Repairs of single stretches: what violates a limit is mended, and the rest of the curve stays."""

from dataclasses import replace

import numpy as np
from questions import ask_views
from shapely import MultiPolygon, Point

from knotfab.base.arrays import Array
from knotfab.limits.base import Felt, State
from knotfab.problem import Problem, Start
from knotfab.search.objective import Term, Weights
from knotfab.search.phases import plan_of, repair_phase
from knotfab.search.repair import find_stretches, mend_stretches
from knotfab.search.search import search
from knotfab.search.state import SearchState, begin
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS

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
    return begin(problem or room(), Start((points,), "a circle"), RADIUS, settings, terms)


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
