"""A frame of a sequence is the same search: it keeps the vertices, every limit, and its motion's bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, TypeVar
from unittest.mock import ANY

import numpy as np
import pytest
from numpy.typing import NDArray
from questions import ask_views
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Point, affinity
from validator_parts import trefoil

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.film import (
    Attempt,
    FrameResult,
    Trial,
    double_vertices,
    finish_frame,
    is_far,
    list_attempts,
    list_retries,
    pick_start,
    plan_best,
    search_frame,
)
from knotfab.design.film_motion import Anchor, outline_motion
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.plan import Attempts, Steps
from knotfab.problem import CertificateLog, Problem, SearchResult
from knotfab.search.search import search
from knotfab.start.start import make_start
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS

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
    assert found.result.knots.points.shape == before.shape  # the same vertices, in their order
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
    anchor = Anchor(still.result.knots.points, 2.0, RADIUS)
    found = carry_out(
        finish_frame(logged_anew(first), rings_of(points), stiff, RADIUS, QUICK, [anchor])
    )
    for frame in (still, found):
        assert len(frame.result.knots.points) == 2 * len(points)
        assert frame.sound and frame.result.log.certified
        # the frame's own search is counted with its repair
        for name, guard in frame.result.guards.items():
            assert guard.calls >= first.guards[name].calls
            assert guard.seconds >= first.guards[name].seconds
    assert still.result.guards["bend"].calls > 0
    assert found.result.guards["bend"].calls > first.guards["bend"].calls
    assert found.result.log.repairs > 0
    assert found.result.feasibility.bend_mm >= 1.02 * bends
    assert anchor.kept(found.result.knots.points)


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
    assert np.array_equal(found.result.knots.points, points)
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


def test_a_frame_begins_as_the_one_before_or_as_one_much_more_like_it() -> None:
    masks = [_legs(n) for n in (20, 14, 8, 2)]
    assert [pick_start(masks, k, k - 1, range(k)) for k in (1, 2, 3)] == [0, 1, 2]
    # going backwards it is as the one behind
    assert [pick_start(masks, k, k + 1, range(k + 1, 4)) for k in (2, 1, 0)] == [3, 2, 1]
    # legs that part again begin where they were apart
    masks = [_legs(n) for n in (20, 10, 0, 10, 20)]
    assert pick_start(masks, 3, 2, range(3)) == 1 and pick_start(masks, 4, 3, range(4)) == 0


def _best(
    seen: dict[Attempt, float], ways: Sequence[Attempt], unsound: Sequence[Attempt] = ()
) -> tuple[Trial, list[Attempt]]:
    """Try ways whose searches come to the IoU `seen`, or break a limit; return the best and all that ran."""
    asked: list[Attempt] = []

    def plan(way: Attempt) -> Steps[Trial]:
        yield from ()
        asked.append(way)
        result: Any = SimpleNamespace(iou_estimate=seen.get(way, 0.5), feasible=way not in unsound)
        found = FrameResult(result, -1.0)
        return Trial(way, found, found if found.sound else None)

    return carry_out(plan_best(ways, plan, 0.96)), asked


def test_the_first_trial_that_serves_is_taken() -> None:
    bound, free = Attempt(2), Attempt(2, False)
    more, still = Attempt(2, False, 2.0), [Attempt(2, c, still=True) for c in (True, False)]
    ways = list_attempts(2, 2, closes=True, same=False)
    assert ways == [bound, free, more, *still]
    assert _best({bound: 0.98}, ways) == (ANY, [bound])
    # closing is given up before the picture; where nothing is to close, nothing is bound to
    trial, asked = _best({bound: 0.8, free: 0.98}, ways)
    assert asked == [bound, free] and trial.attempt == free
    assert list_attempts(2, 2, closes=False, same=False) == [free, more, still[1]]
    # the best of poor trials is kept
    trial, asked = _best({bound: 0.7, free: 0.9, more: 0.8}, ways)
    assert asked == ways[:3] and trial.attempt == free
    # a frame that breaks a limit ends as its neighbour; where nothing keeps them, as the best of all
    trial, asked = _best(dict.fromkeys(ways[:3], 0.99), ways, ways[:3])
    assert asked == ways[:4] and trial.quality == (True, 0.5)
    trial, asked = _best({bound: 0.99}, ways, ways)
    assert asked == ways and trial.attempt == bound and trial.ended is None
    # the same picture once more needs no search
    assert list_attempts(1, 2, closes=True, same=True)[0] == Attempt(1, still=True)


def test_a_retry_begins_elsewhere_with_more_iterations() -> None:
    assert list_retries([1, 2, 4], 2, closes=True) == [Attempt(1, True, 2.0), Attempt(4, True, 2.0)]
    # with one neighbour alone there is no other start, but more to do
    (only,) = list_retries([1, 1], 1, closes=True)
    assert only.origin == 1 and only.effort > 2.0 and not only.closes
