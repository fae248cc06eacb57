"""Free views: the frame as a function of its numbers, poses found again, joint searches."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from pieces import ring
from questions import ask_heart, start_and_search
from shapely import MultiPolygon, box

from knotfab.design.budget import Budget
from knotfab.design.design import design_knots
from knotfab.design.settings import place_start, without_arches
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of, polylines_of_sizes
from knotfab.picture.read import read_target
from knotfab.problem import Problem, Start, TargetView, ViewNumbers
from knotfab.render.capsules import posed_frame, tensor_frame, turn_matrix
from knotfab.render.device import render_torch
from knotfab.render.silhouette import Frame, Sheet, frame_of
from knotfab.scene.camera import camera_of, least_apart
from knotfab.scene.catalogue import resolve
from knotfab.search.flow import SETTLE, FlowSettings, Phase
from knotfab.search.free_pose import ALL, MOST_TURN_DEG, Bounds, FreeDirections, FreePose, turn_of
from knotfab.search.objective import Objective, Weights
from knotfab.search.state import SearchState, begin_search
from knotfab.start.start import make_start
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Mount, Piece
from knotfab_formats.scene import ResolvedView, Scene, SettledRegion
from knotfab_formats.search import PRESETS, SearchSettings
from tests.corpus.curves import torus_knot

QUICK = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 96,
        "fine_px": 160,
        "coarse_iterations": 25,
        "fine_iterations": 20,
        "settle_iterations": 20,
        "depth_candidates": 4,
    }
)
SHEET = Sheet(48, 40, 4.0, 20.0)
TREFOIL = torus_knot(2, 3, 35.0, 18.0, 120)


def _frame(values: torch.Tensor, sheet: Sheet = SHEET) -> Frame:
    """Pose a frame by (azimuth, elevation, roll, light, wall)."""
    return posed_frame(sheet, values[:3], values[3], values[4])


def _render(values: torch.Tensor, points: torch.Tensor, tau: float, *cutoff: float) -> torch.Tensor:
    """Draw by (azimuth, elevation, roll, light, wall, radius)."""
    return render_torch(points, points.roll(-1, 0), _frame(values), values[5], tau, *cutoff)


def _numbers(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_without_elevation_and_roll_it_is_the_scenes_camera() -> None:
    view = ResolvedView(
        frame_width_mm=192.0,
        frame_height_mm=160.0,
        light_distance_mm=420.0,
        wall_distance_mm=90.0,
        wall_tilt_deg=20.0,
        azimuth_deg=35.0,
    )
    known = tensor_frame(frame_of(camera_of(view, 48, 40)), torch.float64)
    free = tensor_frame(_frame(_numbers(35.0, 0.0, 0.0, 420.0, 90.0)).arrays(), torch.float64)
    torch.testing.assert_close(free.axes, known.axes)
    torch.testing.assert_close(free.eye, known.eye)
    assert (free.u0, free.v0, free.step) == pytest.approx((known.u0, known.v0, known.step))
    points = torch.as_tensor(TREFOIL)
    one = render_torch(points, points.roll(-1, 0), known, 4.0, 1.0)
    other = _render(_numbers(35.0, 0.0, 0.0, 420.0, 90.0, 4.0), points, 1.0)
    torch.testing.assert_close(one, other)


def test_turns_have_the_senses_that_are_documented() -> None:
    raised = turn_matrix(_numbers(0.0, 30.0, 0.0))
    torch.testing.assert_close(raised[:, 2], _numbers(0.0, 0.5, 0.75**0.5))  # the light is higher
    rolled = turn_matrix(_numbers(0.0, 0.0, 90.0))
    torch.testing.assert_close(rolled[:, 0], _numbers(0.0, 1.0, 0.0))  # its right is the scene's up
    aside = turn_matrix(_numbers(90.0, 0.0, 0.0))
    torch.testing.assert_close(aside[:, 2], _numbers(1.0, 0.0, 0.0))
    any_turn = turn_matrix(_numbers(20.0, -35.0, 50.0))
    torch.testing.assert_close(any_turn @ any_turn.T, torch.eye(3, dtype=torch.float64))
    assert torch.linalg.det(any_turn) > 0


def test_turning_the_knot_back_gives_the_same_picture() -> None:
    numbers = ViewNumbers(400.0, 100.0, 4.0, 20.0, -15.0, 30.0)
    turned = torch.as_tensor(TREFOIL @ turn_of(numbers))
    points = torch.as_tensor(TREFOIL)
    one = _render(_numbers(20, -15, 30, 400, 100, 4), points, 1.0)
    other = _render(_numbers(0, 0, 0, 400, 100, 4), turned, 1.0)
    torch.testing.assert_close(one, other)


def test_gradient_in_every_number_against_finite_differences() -> None:
    at = _numbers(12.0, -8.0, 15.0, 400.0, 90.0, 4.0)
    points = torch.as_tensor(TREFOIL)
    weights = torch.rand(40, 48, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def value(numbers: torch.Tensor) -> torch.Tensor:
        return (_render(numbers, points, 1.0, 20.0) * weights).sum()

    variable = at.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    for k in range(6):
        way = torch.zeros(6, dtype=torch.float64)
        way[k] = 1e-5
        slope = float(value(at + way) - value(at - way)) / 2e-5
        assert float(gradient[k]) == pytest.approx(slope, rel=2e-4), ALL[k]


@pytest.mark.slow
def test_bounds_hold_whatever_is_asked() -> None:
    start = ViewNumbers(400.0, 100.0, 3.0)
    bounds = Bounds(turn_deg=5.0, least_radius_mm=2.0, most_radius_mm=3.5)
    pose = FreePose(start, bounds)
    for way in (1.0, -1.0):
        for _ in range(400):
            pull = torch.full((3,), way, dtype=torch.float64)
            pose.move((pull, pull), TREFOIL, 0.0)
        n = pose.numbers()
        depth = TREFOIL @ turn_of(n)[:, 2]
        assert n.light_distance_mm * 0.25 >= depth.max() + n.radius_mm - 1e-6
        assert n.wall_distance_mm * 0.9 >= -depth.min() + n.radius_mm - 1e-6
        assert 2.0 - 1e-9 <= n.radius_mm <= 3.5 + 1e-9
        assert max(abs(n.azimuth_deg), abs(n.elevation_deg), abs(n.roll_deg)) <= 5.0 + 1e-9
        assert 200.0 - 1e-6 <= n.light_distance_mm <= 800.0 + 1e-6
    # pulled down: at the least of each
    assert pose.radius_mm == pytest.approx(3.5)


def test_what_is_not_free_stays() -> None:
    start = ViewNumbers(400.0, 100.0, 3.0, 7.0)
    pose = FreePose(start, Bounds(("elevation", "wall")))
    pull = torch.ones(3, dtype=torch.float64)
    for _ in range(20):
        pose.move((pull, pull), TREFOIL, 0.0)
    n = pose.numbers()
    kept = (n.azimuth_deg, n.roll_deg, n.light_distance_mm, n.radius_mm)
    assert kept == pytest.approx((7.0, 0.0, 400.0, 3.0))
    assert n.elevation_deg < -1 and n.wall_distance_mm < 95


def test_wrong_bounds_are_told() -> None:
    with pytest.raises(InputError, match="no such number"):
        Bounds(("azimuth", "colour"))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="above"):
        Bounds(least_radius_mm=3.0, most_radius_mm=2.0)
    with pytest.raises(InputError, match="outside its bounds"):
        FreePose(ViewNumbers(400.0, 100.0, 0.5), Bounds())


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


# strands near each other, so that every limit has a slope
TIGHT = 0.25 * TREFOIL
NEAR = find_neighbours(TIGHT, polylines_of_sizes((len(TIGHT),)), 40.0, 6)


def _state(problem: Problem, points: np.ndarray, pose: FreePose | None = None) -> SearchState:
    """The state at the start of a search."""
    return begin_search(problem, Start((points,), "for its slope alone"), 4.0, QUICK, pose=pose)


def _objective(state: SearchState) -> Objective:
    return state.objective(Phase(64, FlowSettings(), Weights(), (3.0, 3.0)))


def _value_and_slope(objective: Objective, points: np.ndarray) -> tuple[float, np.ndarray]:
    return objective(points, NEAR, 0.0)


@pytest.mark.slow
def test_from_a_pose_the_objective_is_that_of_the_turned_knot(problem: Problem) -> None:
    numbers = ViewNumbers(430.0, 120.0, 4.0, 6.0, 3.0, -20.0)
    free = _objective(_state(problem, TIGHT, FreePose(numbers, Bounds())))
    seen = problem.views[0]
    lengths = {"light_distance_mm": 430.0, "wall_distance_mm": 120.0}
    there = replace(seen, view=seen.view.model_copy(update=lengths))
    turned = TIGHT @ turn_of(numbers)
    fixed = _objective(_state(replace(problem, views=(there,)), turned))
    # the image's own scale is that of the view asked for, whatever the pose
    fixed.images = (replace(fixed.images[0], radius_px=free.images[0].radius_px),)
    one, other = _value_and_slope(free, TIGHT), _value_and_slope(fixed, turned)
    assert one[0] == pytest.approx(other[0], rel=1e-5)
    assert one[1] @ turn_of(numbers) == pytest.approx(other[1], abs=1e-4 * np.abs(other[1]).max())


def test_looking_moves_no_pose_and_descending_moves_it_alone(problem: Problem) -> None:
    start = ViewNumbers(500.0, 100.0, 4.0, 6.0, 3.0)
    pose = FreePose(start, Bounds())
    objective = _objective(_state(problem, TIGHT, pose))
    before = _value_and_slope(objective, TIGHT)
    assert pose.numbers() == start
    again = _value_and_slope(objective, TIGHT)
    assert before[0] == again[0] and (before[1] == again[1]).all()
    points = TIGHT.copy()
    pose.descend(objective, problem, points, NEAR, 0.0)
    assert (points == TIGHT).all()
    moved = pose.numbers()
    for name in ("azimuth_deg", "elevation_deg", "light_distance_mm", "radius_mm"):
        assert getattr(moved, name) != getattr(start, name), name
    # the objective looks from there
    assert objective.limits.radius == pytest.approx(pose.radius_mm)
    assert _value_and_slope(objective, TIGHT)[0] != before[0]


class _Watched(FreePose):
    """Remembers what it was moved against."""

    def move(
        self, gradients: tuple[torch.Tensor, torch.Tensor], points: np.ndarray, progress: float
    ) -> None:
        self.slopes = gradients
        super().move(gradients, points, progress)


def test_a_thicker_tube_costs_clearance_and_bends(problem: Problem) -> None:
    # the trefoil's strands come within 2 radii of each other, and its bends below one
    pose = _Watched(ViewNumbers(500.0, 100.0, 4.0), Bounds())
    objective = _objective(_state(problem, TIGHT, pose))

    def limits_at(radius: float) -> float:
        return objective.limit_terms(TIGHT, NEAR, problem.limits(radius), SETTLE, np.eye(3))[0]

    slope = (limits_at(4.04) - limits_at(3.96)) / 0.02  # the slope in the radius's logarithm
    (picture,) = torch.autograd.grad(pose.picture_term(objective, TIGHT), pose.logs)
    pose.descend(objective, problem, TIGHT, NEAR, 0.0)
    assert slope > 1.0
    assert float(pose.slopes[1][2] - picture[2]) == pytest.approx(slope, rel=0.01)


@pytest.mark.slow
def test_a_joint_search_ends_feasible_as_a_fixed_scene(problem: Problem) -> None:
    start = make_start(problem, 4.0, QUICK)
    fixed = start_and_search(problem, 4.0, QUICK, start)
    pose = FreePose(ViewNumbers(500.0, 100.0, 4.0), Bounds())
    found = start_and_search(problem, 4.0, QUICK, start, pose=pose)
    assert found.feasible
    assert found.log.certified and found.log.least_margin_mm > 0
    assert found.iou_estimate > fixed.iou_estimate - 0.002
    # the numbers are a scene's: no turn is left in the view, and the knots look right in it
    (view,), knots = found.views, found.knots
    assert view.azimuth_deg == 0
    assert knots.radius_mm != 4.0 and knots.radius_mm == round(knots.radius_mm, 4)
    assert found.numbers is not None and found.numbers.radius_mm == knots.radius_mm
    assert found.numbers.light_distance_mm == view.light_distance_mm != 500.0
    image = replace(problem.views[0], view=view).image_at(knots.radius_mm, 160)
    rings = polylines_of_sizes(tuple(len(k.points) for k in knots.knots))
    iou = image.iou(knots.points, rings, knots.radius_mm)
    assert iou == pytest.approx(found.iou_estimate, abs=0.001)
    assert fixed.numbers is None and fixed.views == (problem.views[0].view,)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "least"), [pytest.param("inn", 0.85, marks=pytest.mark.study), ("inn+flow", 0.95)]
)
def test_the_network_finds_the_view_along(problem: Problem, method: str, least: float) -> None:
    few = {"network_depth": 4, "network_width": 16, "network_iterations": 30, "method": method}
    # a profile that leaves strands no room to be smoothed has no certificate: take a good one
    settings = QUICK.model_copy(update={**few, "depth_candidates": 300})
    start = make_start(problem, 5.0, settings)
    pose = FreePose(ViewNumbers(500.0, 100.0, 5.0), Bounds())
    found = start_and_search(problem, 5.0, settings, start, repairs=0, pose=pose)
    assert found.log.certified and "invertible network" in found.log.template
    assert found.numbers is not None and found.numbers.light_distance_mm != 500.0
    assert found.views[0].light_distance_mm == found.numbers.light_distance_mm
    assert found.iou_estimate > least


TINY = {
    **QUICK.model_dump(), "coarse_iterations": 8, "fine_iterations": 6, "settle_iterations": 20,
    "radius_candidates": 2, "free_view": True,
}  # fmt: skip


@pytest.mark.build
def test_the_scene_of_a_free_view_gives_the_same_knots() -> None:
    target = read_target("text:\u2665")
    first = design_knots(resolve(Scene(search=TINY)), [target])
    view, found = first.scene.views[0], first.scene.search
    assert (found["free_light_mm"], found["free_wall_mm"]) == (500.0, 100.0)
    assert view.light_distance_mm != 500.0 and view.wall_distance_mm != 100.0
    assert first.scene.piece.tube_radius_mm == first.knots.radius_mm != found["free_radius_mm"]
    again = design_knots(first.scene, [target])
    np.testing.assert_array_equal(first.knots.points, again.knots.points)
    assert again.scene == first.scene


@pytest.mark.build
@pytest.mark.parametrize("plate", ["pegs", "outline"])
@pytest.mark.study
def test_arches_stand_along_the_axis_of_a_view_found_before(plate: Any) -> None:
    """In a plate the wall stays where the piece ends; the scene has the view, and gives the same knots."""
    target = read_target("text:\u2665")
    piece = Piece(supports="none", tube_radius_mm=5.0)
    scene = resolve(Scene(search=TINY, piece=piece, mount=Mount(kind="auto", plate=plate)))
    made = design_knots(scene, [target])
    (view,), (ordinary,) = (
        made.scene.views,
        design_knots(without_arches(scene), [target]).scene.views,
    )
    assert view.light_distance_mm == ordinary.light_distance_mm != 500.0
    assert (view.wall_distance_mm == ordinary.wall_distance_mm) == (plate == "pegs")
    assert not made.scene.settings.free_view
    again = design_knots(made.scene, [target])
    np.testing.assert_array_equal(made.knots.points, again.knots.points)


@pytest.mark.slow
def test_a_radius_that_is_given_stays_given() -> None:
    piece = Piece(tube_radius_mm=4.0)
    made = design_knots(
        resolve(Scene(piece=piece, search=TINY)), [read_target("text:\u2665")], device="cpu"
    )
    assert made.knots.radius_mm == 4.0 and made.scene.search["free_radius_mm"] == 0


@pytest.mark.slow
@pytest.mark.study
def test_a_time_budget_holds_for_a_free_view_too() -> None:
    """The few iterations that time it leave no trace in the pose that the search starts from."""
    budget = Budget(time.perf_counter() + 0.5)
    made = design_knots(
        resolve(Scene(search=TINY)), [read_target("text:\u2665")], budget=budget, device="cpu"
    )
    resolved = made.scene.search
    assert (resolved["free_light_mm"], resolved["free_wall_mm"]) == (500.0, 100.0)
    again = design_knots(made.scene, [read_target("text:\u2665")])
    np.testing.assert_array_equal(made.knots.points, again.knots.points)


def test_a_view_that_is_turned_by_the_scene_is_not_free() -> None:
    scene = Scene.model_validate({"views": [{"elevation_deg": 40.0}]})
    with pytest.raises(InputError, match="elevation_deg = 40"):
        place_start(scene, PRESETS["draft"])


# Directions of several views as unknowns: their slopes, their bounds, and that they are found.


RADIUS, PIXELS = 4.0, 128
SETTINGS = SearchSettings(precision="double")
POINTS = np.vstack([ring(40.0, n=160, wave=20.0) * [0.6, 1.0, 1.0] + [9.0, 0.0, 5.0]])

RINGS = polylines_of([POINTS])


def views(*azimuths: float) -> tuple[TargetView, ...]:
    found = []
    for n, azimuth in enumerate(azimuths):
        view = ResolvedView(
            name=f"v{n}", azimuth_deg=azimuth, frame_width_mm=160.0, frame_height_mm=160.0
        )
        mask = np.zeros((96, 96), dtype=bool)
        mask[20:80, 30:60] = True
        found.append(TargetView(view, mask, MultiPolygon([box(-20, -30, 20, 30)])))
    return tuple(found)


def question(seen: tuple[TargetView, ...]) -> tuple[Problem, Objective]:
    problem = Problem(seen, 0.4, None, 1e6, SettledRegion(size_mm=(200.0, 200.0, 200.0)))
    images = tuple(v.image_at(RADIUS, PIXELS) for v in seen)
    double = tuple(replace(i, target=i.target.astype(np.float64)) for i in images)
    objective = Objective(double, RINGS, problem.limits(RADIUS), {}, Weights(), (3.0, 3.0))
    return problem, objective


def test_the_slope_is_that_of_finite_differences() -> None:
    problem, objective = question(views(0.0, 70.0))
    directions = FreeDirections(problem.views, RADIUS, SETTINGS)
    at = np.array([[0.0, 0.0], [70.0, 25.0]])
    step, slopes = 1e-3, []
    for turn in np.eye(2):
        found = []
        for way in (1.0, -1.0):
            directions.places_deg = at + [[0.0, 0.0], way * step * turn]
            directions.show(objective, problem)
            found.append(objective.image_term(1, POINTS, objective.tau_px(1, 0.0))[0])
        slopes.append((found[0] - found[1]) / (2 * step))
    directions.places_deg = at
    directions.show(objective, problem)
    view = problem.views[1].view.but(azimuth_deg=70.0, elevation_deg=25.0)
    slope = directions.slope(objective, 1, view, POINTS, 0.0)
    assert slope == pytest.approx(slopes, rel=2e-3)


@pytest.mark.parametrize(("starts", "away"), [("", (64.0, 0.0)), ("0.0 0.0", (66.0, 7.0))])
@pytest.mark.slow
def test_a_view_turns_to_where_the_knots_draw_its_picture(
    starts: str, away: tuple[float, float]
) -> None:
    settings = SETTINGS.but(free_elevations_deg=starts)
    seen = tuple(v.image_at(RADIUS, 96).seen(POINTS, RINGS, RADIUS) for v in views(0.0, 70.0))
    drawn = tuple(
        replace(v, mask=mask[6:-6, 6:-6]) for v, mask in zip(views(0.0, 70.0), seen, strict=True)
    )
    turned = tuple(
        replace(v, view=v.view.but(azimuth_deg=a, elevation_deg=e))
        for v, (a, e) in zip(drawn, ((0.0, 0.0), away), strict=True)
    )
    problem, objective = question(turned)
    directions = FreeDirections(problem.views, RADIUS, settings)
    for n in range(240):
        directions.descend(objective, problem, POINTS, None, n / 240)  # type: ignore[arg-type]
    settled, points, numbers = directions.settle(problem, POINTS)
    assert points is POINTS and numbers is None
    assert settled.views[0].view.azimuth_deg == 0.0
    assert settled.views[1].view.azimuth_deg == pytest.approx(70.0, abs=0.5)
    assert settled.views[1].view.elevation_deg == pytest.approx(0.0, abs=0.5)


def test_directions_keep_their_bounds() -> None:
    problem, objective = question(views(0.0, 20.0, 45.0))
    directions = FreeDirections(problem.views, RADIUS, SETTINGS)
    least = least_apart([v.view for v in problem.views])
    for _ in range(80):
        directions.descend(objective, problem, POINTS, None, 0.0)  # type: ignore[arg-type]
    assert (np.abs(directions.places_deg - directions.first_deg) <= MOST_TURN_DEG).all()
    settled, _, _ = directions.settle(problem, POINTS)
    assert least_apart([v.view for v in settled.views]) >= 0.69 * least
