"""A frame of a sequence is the same search: it keeps the vertices, every limit, and its motion's bound."""

from dataclasses import replace

import numpy as np
import pytest
from questions import ask_views
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Point, affinity
from validator_parts import trefoil

from knotfab.base.arrays import Array
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.problem import CertificateLog, Problem, SearchResult
from knotfab.render.forms import COMPILED
from knotfab.search.search import search
from knotfab.sequence.motion import Anchor, outline_motion
from knotfab.sequence.search import double_vertices, finish, follow, is_far
from knotfab.start.start import make_start
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
    found = follow(start, rings, problems, RADIUS, QUICK, length, [anchor])
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
    still = finish(logged_anew(first), rings_of(points), ask_one(DISC), RADIUS, QUICK, [])
    anchor = Anchor(still.points, 2.0, RADIUS)
    found = finish(logged_anew(first), rings_of(points), stiff, RADIUS, QUICK, [anchor])
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
    torn = finish(logged_anew(first), rings_of(points), ask_one(DISC), RADIUS, QUICK, held)
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
    found = follow(
        first.knots, rings, problems, RADIUS, settings, 1e9, [anchor], COMPILED, None, True
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
