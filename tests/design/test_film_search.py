"""A frame of a sequence is the same search: it keeps the vertices, every limit, and its motion's bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from questions import ask_views
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Point, affinity, box
from validator_parts import trefoil

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design import film_search as starts
from knotfab.design.film_motion import Anchor, outline_motion
from knotfab.design.film_search import (
    Attempt,
    Following,
    FrameResult,
    PictureDifferences,
    Tie,
    Trial,
    double_vertices,
    finish_frame,
    is_far,
    list_attempts,
    list_retries,
    search_frame,
)
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knot, Knots
from knotfab.limits.feasibility import Feasibility
from knotfab.limits.terms import Limits
from knotfab.plan import Attempts, Steps
from knotfab.problem import CertificateLog, Problem, SearchResult, TargetView
from knotfab.search.search import search
from knotfab.start.start import make_start
from knotfab_formats.scene import ResolvedView, SettledRegion
from knotfab_formats.search import PRESETS, SearchSettings

RADIUS = 5.0
QUICK = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 64,
        "fine_px": 96,
        "coarse_iterations": 20,
        "fine_iterations": 20,
        "settle_iterations": 20,
        "depth_candidates": 2,
    }
)
DISC = MultiPolygon([Point(-4, 0).buffer(30.0)])
MOVED = affinity.translate(DISC, 8.0, 3.0)


T = TypeVar("T")


def carry_out(steps: Steps[T]) -> T:
    return Attempts(Progress("quiet")).carry_out(steps)


def ask_one(polygon: MultiPolygon) -> Problem:
    return replace(ask_views([polygon], 0.0), depth_mm=30.0)


@pytest.fixture(scope="module")
def first() -> SearchResult:
    """The first frame, from a template."""
    return search(ask_one(DISC), make_start(ask_one(DISC), RADIUS, QUICK), RADIUS, QUICK)


def logged_anew(result: SearchResult) -> SearchResult:
    return replace(result, log=CertificateLog("the first frame", ("unknot",)))


def rings_of(points: Array) -> Polylines:
    return polylines_of_sizes((len(points),))


def test_a_frame_follows_the_picture_within_its_bound(first: SearchResult) -> None:
    trefoil = replace(first.knots.knots[0], type="trefoil")
    before, rings = first.knots.points, rings_of(first.knots.points)
    assert first.feasible
    bound = outline_motion(DISC, MOVED) + RADIUS
    anchor = Anchor(before, bound, RADIUS)
    problems = ask_one(DISC), ask_one(MOVED)
    length = 1.1 * first.knots.knots[0].length_mm
    start = Knots((trefoil,), RADIUS)  # the type goes along, whatever it is
    found = carry_out(search_frame(start, rings, problems, RADIUS, QUICK, length, [anchor]))
    assert found.sound and found.result.feasible and found.beyond_mm <= 0
    assert found.points.shape == before.shape  # the same vertices, in their order
    assert found.result.knots.knots[0].type == "trefoil"
    assert found.result.log.certified and found.result.log.resamplings == 0
    assert 0 < found.transported <= 1
    # a frame that had stayed would draw little of the new picture
    stayed = problems[1].views[0].image_at(RADIUS, 96).iou(before, rings, RADIUS)
    assert found.result.iou_estimate > max(0.93, stayed + 0.1)


def test_a_finished_frame_has_twice_the_vertices_within_limits(first: SearchResult) -> None:
    """A limit that the doubled frame violates is repaired, and the frame it is tied to stays in reach."""
    points = first.knots.points
    bends = first.feasibility.bend_mm
    stiff = replace(ask_one(DISC), bend_radius=1.02 * bends)
    still = carry_out(
        finish_frame(logged_anew(first), rings_of(points), ask_one(DISC), RADIUS, QUICK, [])
    )
    anchor = Anchor(still.points, 2.0, RADIUS)
    found = carry_out(
        finish_frame(logged_anew(first), rings_of(points), stiff, RADIUS, QUICK, [anchor])
    )
    for frame in (still, found):
        assert len(frame.points) == 2 * len(points)
        assert frame.sound and frame.result.log.certified
        # the frame's own search is counted with its repair
        for name, guard in frame.result.guards.items():
            assert guard.calls >= first.guards[name].calls
            assert guard.seconds >= first.guards[name].seconds
    assert still.result.guards["bend"].calls > 0
    assert found.result.guards["bend"].calls > first.guards["bend"].calls
    assert found.result.log.repairs > 0
    assert found.result.feasibility.bend_mm >= 1.02 * bends
    assert anchor.kept(found.points)


@pytest.mark.slow
def test_a_bound_that_cannot_be_kept_is_told(first: SearchResult) -> None:
    points = first.knots.points
    far = np.repeat(points, 2, axis=0) + [40.0, 0.0, 0.0]
    held = [Anchor(far, 1.0, RADIUS)]
    torn = carry_out(
        finish_frame(logged_anew(first), rings_of(points), ask_one(DISC), RADIUS, QUICK, held)
    )
    assert not torn.sound and torn.beyond_mm > 0


def test_strands_that_the_picture_does_not_reach_are_far(first: SearchResult) -> None:
    points, light = first.knots.points, 500.0
    assert not is_far(points, rings_of(points), DISC, light, RADIUS)
    # a limb that is hidden behind the body in the new picture, and one that comes out
    limb = DISC.union(Point(45, 0).buffer(8.0))
    assert is_far(points, rings_of(points), MultiPolygon(limb.geoms), light, RADIUS)
    assert is_far(points + [25.0, 0.0, 0.0], rings_of(points), DISC, light, RADIUS)


def test_a_knot_that_stays_still_is_the_same_knot(first: SearchResult) -> None:
    points, problems = first.knots.points, (ask_one(DISC), ask_one(MOVED))
    anchor = Anchor(points, RADIUS, RADIUS)
    settings = QUICK.scaled(1.0)
    rings = rings_of(points)
    found = carry_out(
        search_frame(first.knots, rings, problems, RADIUS, settings, 1e9, [anchor], None, True)
    )
    assert np.array_equal(found.points, points)
    assert found.sound and found.result.log.certified and found.transported == 0.0


def test_new_vertices_halve_the_edges_and_round_the_corners() -> None:
    points = trefoil(90, 20.0)
    rings = polylines_of_sizes((90,))
    carried, both = double_vertices(points, rings)
    fine = carried.points
    assert carried.reached == 1.0 and carried.least_margin > 0
    assert both.sizes == (180,)
    ahead, behind = np.roll(points, -1, axis=0), np.roll(points, 1, axis=0)
    np.testing.assert_array_equal(fine[1::2], 0.5 * (points + ahead))
    # this is the mask of the uniform cubic B-spline, in full
    np.testing.assert_allclose(fine[::2], 0.75 * points + 0.125 * (ahead + behind), atol=1e-12)
    # the curve stays as near to the true one as the middles of the old edges were
    curve = cKDTree(trefoil(90 * 400, 20.0))
    middles = 0.5 * (points + ahead)
    assert curve.query(fine)[0].max() < 1.01 * curve.query(middles)[0].max()
    assert bend_radii(fine, both).min() > 0.97 * bend_radii(points, rings).min()


def test_bends_that_alternate_are_not_made_stronger() -> None:
    """A wide ring whose bends go up and down a little: a curve through its vertices bends far more."""
    around, tube_mm, ring_mm, zigzag = 240, 1.8, 33.0, 0.05
    t = np.linspace(0, 2 * np.pi, around, endpoint=False)
    edge = 2 * np.pi * ring_mm / around
    away = ring_mm + zigzag * (edge**2 / (4 * ring_mm)) * (-1.0) ** np.arange(around)
    points = np.stack([away * np.cos(t), away * np.sin(t), 0 * t], axis=1)
    rings = polylines_of_sizes((around,))
    before = bend_radii(points, rings).min()
    assert edge < 0.5 * tube_mm and 0.93 * ring_mm < before < 0.97 * ring_mm
    carried, both = double_vertices(points, rings)
    assert bend_radii(carried.points, both).min() > 0.999 * before
    spline = CubicSpline(
        np.arange(around + 1), np.concatenate([points, points[:1]]), bc_type="periodic"
    )
    through = np.asarray(spline(np.arange(2 * around) / 2))
    assert bend_radii(through, both).min() < 0.96 * before


def test_a_step_that_could_cross_is_not_taken() -> None:
    """A strand close inside a sharp turn, which would pass through it where its corner is cut."""
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    coarse = 30 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    # another ring goes around the first corner, just inside of it
    outward = coarse[0] / np.linalg.norm(coarse[0])
    s = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    at = coarse[0] - 0.15 * outward
    other = at + 4 * outward * (1 - np.cos(s)) + 4 * np.sin(s) * np.array([0.0, 0.0, 1.0])
    points, rings = np.concatenate([coarse, other]), polylines_of_sizes((12, 40))
    carried, _ = double_vertices(points, rings)
    # the corner would go 1 mm inwards; the other ring is 0.15 mm away, and less as it shrinks itself
    gone = float((coarse[0] - carried.points[0]) @ outward)
    assert 0.0 <= gone < 0.15
    assert carried.reached < 1.0 < carried.steps + carried.refused
    assert carried.steps == 0 or carried.least_margin > 0


# Which frame a frame begins as: pictures that return to an earlier one, and trials until one
# serves.


ROOM = SettledRegion(size_mm=(200.0, 200.0, 200.0))


def _legs(apart: int) -> NDArray[np.bool_]:
    """A body with two legs, so many pixels to either side."""
    mask = np.zeros((80, 80), dtype=bool)
    mask[5:40, 30:50] = True
    for foot in (-apart, apart):
        mask[40:75, 36 + foot : 44 + foot] = True
    return mask


def test_a_frame_begins_as_the_one_before() -> None:
    alike = PictureDifferences([_legs(n) for n in (20, 14, 8, 2)])
    assert [alike.start_of(k, k - 1, range(k)) for k in (1, 2, 3)] == [0, 1, 2]
    # going backwards it is as the one behind
    assert [alike.start_of(k, k + 1, range(k + 1, 4)) for k in (2, 1, 0)] == [3, 2, 1]


def test_legs_that_part_again_begin_where_they_were_apart() -> None:
    alike = PictureDifferences([_legs(n) for n in (20, 10, 0, 10, 20)])
    assert alike.start_of(3, 2, range(3)) == 1
    assert alike.start_of(4, 3, range(4)) == 0
    assert alike.same(1, 3) and not alike.same(1, 2)


Asked = tuple[int, bool, bool, bool]


class _Follow:
    """Stands for the search: an IoU for (start, whether it must close, has more iterations, stays still).

    `unsound`: what breaks a limit.
    """

    def __init__(self, seen: dict[Asked, float], unsound: Sequence[Asked] = ()) -> None:
        self.seen, self.unsound = seen, unsound
        self.asked: list[Asked] = []

    def __call__(
        self,
        before: Knots,
        rings: object,
        problems: object,
        radius: float,
        settings: SearchSettings,
        taut_mm: float,
        anchors: Sequence[Anchor],
        report: object,
        still: bool,
    ) -> Steps[FrameResult]:
        yield from ()
        more = settings.fine_iterations > 10
        asked = int(before.points[0, 0]), len(anchors) == 2, more, still
        self.asked.append(asked)
        limits = Limits(2.0, 0.4, 2.2, 1000.0, ROOM)
        at = np.zeros(3)
        bend = 1.0 if asked in self.unsound else 3.0
        measured = Feasibility(bend, at, 5.0, at, -1.0, at, 100.0, limits)
        seen = (self.seen.get(asked, 0.5),)
        return FrameResult(SearchResult(before, measured, CertificateLog(), {}, None, seen), -1.0)


def _search(
    monkeypatch: pytest.MonkeyPatch, follow: _Follow, attempts: Sequence[Attempt]
) -> tuple[Trial, list[Asked]]:
    """Search frame 3 after frames 0, 1 and 2, whose knots hold their numbers as coordinates."""
    monkeypatch.setattr(starts, "search_frame", follow)

    def finish(found: SearchResult, *_: object) -> Steps[FrameResult]:
        yield from ()
        return FrameResult(found, -1.0)

    monkeypatch.setattr(starts, "finish_frame", finish)
    monkeypatch.setattr(starts, "opening_iou", lambda *_: 0.99)
    view = ResolvedView(frame_width_mm=80.0, frame_height_mm=80.0)
    target = TargetView(view, _legs(10), MultiPolygon([box(0, 0, 9, 9)]))
    problem = Problem((target,), 0.4, None, 1000.0, ROOM)
    known = {k: Knots((Knot(np.full((4, 3), float(k))),), 2.0) for k in range(3)}
    fine = {k: knots.points for k, knots in known.items()}
    ties = (Tie(2, 3.0), Tie(0, 5.0, loop=True))
    settings = SearchSettings(fine_iterations=10)
    rings = polylines_of_sizes((4,))
    following = Following(
        3, known, fine, (problem,) * 4, rings, 2.0, settings, 100.0, ties, "simple"
    )
    return carry_out(following.search(attempts, lambda *_: None)), follow.asked


def test_the_first_trial_that_serves_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(1, True, False, False): 0.98})
    trial, asked = _search(monkeypatch, follow, list_attempts(1, 2, closes=True, same=False))
    assert asked == [(1, True, False, False)]
    assert trial.attempt == Attempt(1) and trial.ended is not None
    assert trial.found.result.log.template == "the knot of frame 2; of the first one: simple"


def test_closing_is_given_up_before_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {(2, True, False, False): 0.8, (2, False, False, False): 0.98}
    trial, asked = _search(monkeypatch, _Follow(seen), list_attempts(2, 2, closes=True, same=False))
    assert asked == list(seen)
    assert not trial.attempt.closes
    # where nothing is to close, nothing is bound to
    _, asked = _search(monkeypatch, _Follow(seen), list_attempts(2, 2, closes=False, same=False))
    assert asked == [(2, False, False, False)]


def test_the_best_of_poor_trials_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {
        (0, True, False, False): 0.7,
        (2, True, False, False): 0.9,
        (2, False, True, False): 0.8,
    }
    trial, asked = _search(monkeypatch, _Follow(seen), list_attempts(0, 2, closes=True, same=False))
    assert len(asked) == 5 and not any(still for *_, still in asked)
    assert (trial.attempt.origin, trial.found.result.iou_estimate) == (2, 0.9)


def test_a_frame_that_breaks_a_limit_ends_as_its_neighbour(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = [(2, c, more, False) for c, more in ((True, False), (False, False), (False, True))]
    follow = _Follow(dict.fromkeys(moved, 0.99), unsound=moved)
    trial, asked = _search(monkeypatch, follow, list_attempts(2, 2, closes=True, same=False))
    assert asked[:4] == [*moved, (2, True, False, True)]
    assert trial.attempt.still and trial.quality == (True, 0.5)
    # nothing keeps the limits: the best of all, finished all the same
    held = [(2, True, False, True), (2, False, False, True)]
    follow = _Follow({moved[0]: 0.99}, unsound=[*moved, *held])
    trial, asked = _search(monkeypatch, follow, list_attempts(2, 2, closes=True, same=False))
    assert asked == [*moved, *held]
    assert trial.found.result.iou_estimate == 0.99 and trial.ended is not None


def test_the_same_picture_once_more_needs_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(1, True, False, True): 0.98})
    trial, asked = _search(monkeypatch, follow, list_attempts(1, 2, closes=True, same=True))
    assert asked == [(1, True, False, True)]
    assert trial.attempt.still and trial.attempt.origin == 1


def test_a_retry_begins_elsewhere_with_more_iterations() -> None:
    assert list_retries([1, 2, 4], 2, closes=True) == [Attempt(1, True, 2.0), Attempt(4, True, 2.0)]
    # with one neighbour alone there is no other start, but more to do
    (only,) = list_retries([1, 1], 1, closes=True)
    assert only.origin == 1 and only.effort > 2.0 and not only.closes
