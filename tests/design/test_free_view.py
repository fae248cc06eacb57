"""Free views: the frame as a function of its numbers, poses found again, joint searches."""

import numpy as np
import pytest
import torch
from knotfab.render.free_frame import FreeFrame, Sheet, free_frame, render_free, turn_matrix
from knotfab.search.free_search import FreeObjective, free_search

from examples.paper.curves import torus_knot
from knotfab.design.design import design, problem_of, resolve_view
from knotfab.effects.base import Situation
from knotfab.effects.survey import survey
from knotfab.errors import InputError
from knotfab.geometry.neighbours import find_neighbours
from knotfab.geometry.polylines import Rings, rings_of_sizes
from knotfab.render.frame import frame_of
from knotfab.render.picture import picture_at
from knotfab.render.tiled import render_tiled
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Piece, Scene, View
from knotfab.scene.settings import PRESETS
from knotfab.search.objective import Weights
from knotfab.search.phases import SETTLE
from knotfab.search.pose import ALL, Bounds, Unknowns, ViewNumbers, fit_view
from knotfab.search.search import Problem, search
from knotfab.start.filling import fill
from knotfab.target.read import read_target

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


def _frame(values: torch.Tensor, sheet: Sheet = SHEET) -> FreeFrame:
    """From azimuth, elevation, roll, light, wall and radius."""
    return free_frame(sheet, values[:3], values[3], values[4], values[5])


def _numbers(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_without_elevation_and_roll_it_is_the_camera_of_the_scene() -> None:
    view = View(
        frame_width_mm=192.0,
        frame_height_mm=160.0,
        light_distance_mm=420.0,
        wall_distance_mm=90.0,
        wall_tilt_deg=20.0,
        azimuth_deg=35.0,
    )
    known = frame_of(camera_of(view, 48, 40), torch.float64)
    free = _frame(_numbers(35.0, 0.0, 0.0, 420.0, 90.0, 4.0)).fixed()
    torch.testing.assert_close(free.axes, known.axes)
    torch.testing.assert_close(free.eye, known.eye)
    assert (free.u0, free.v0, free.step) == pytest.approx((known.u0, known.v0, known.step))
    points = torch.as_tensor(TREFOIL)
    one = render_tiled(points, points.roll(-1, 0), known, 4.0, 1.0)
    other = render_free(
        points, points.roll(-1, 0), _frame(_numbers(35.0, 0.0, 0.0, 420.0, 90.0, 4.0)), 1.0
    )
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
    turned = torch.as_tensor(TREFOIL @ numbers.turn)
    points = torch.as_tensor(TREFOIL)
    one = render_free(
        points, points.roll(-1, 0), _frame(_numbers(20, -15, 30, 400, 100, 4), SHEET), 1.0
    )
    other = render_free(
        turned, turned.roll(-1, 0), _frame(_numbers(0, 0, 0, 400, 100, 4), SHEET), 1.0
    )
    torch.testing.assert_close(one, other)


def test_gradient_in_every_number_against_finite_differences() -> None:
    at = _numbers(12.0, -8.0, 15.0, 400.0, 90.0, 4.0)
    points = torch.as_tensor(TREFOIL)
    weights = torch.rand(40, 48, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def value(numbers: torch.Tensor) -> torch.Tensor:
        return (render_free(points, points.roll(-1, 0), _frame(numbers), 1.0, 20.0) * weights).sum()

    variable = at.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    for k in range(6):
        way = torch.zeros(6, dtype=torch.float64)
        way[k] = 1e-5
        slope = float(value(at + way) - value(at - way)) / 2e-5
        assert float(gradient[k]) == pytest.approx(slope, rel=2e-4), ALL[k]


def _shadow(points: np.ndarray, numbers: ViewNumbers, sheet: Sheet) -> torch.Tensor:
    n = numbers
    at = _numbers(n.azimuth_deg, n.elevation_deg, n.roll_deg)
    frame = free_frame(sheet, at, *_numbers(n.light_distance_mm, n.wall_distance_mm, n.radius_mm))
    p = torch.as_tensor(points)
    return (render_free(p, p.roll(-1, 0), frame, 10.0) > 0.5).float()


def _angle_deg(one: ViewNumbers, other: ViewNumbers) -> float:
    cosine = 0.5 * (np.trace(one.turn.T @ other.turn) - 1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_pose_and_light_distance_are_found_again(share: float) -> None:
    sheet = Sheet(112, 112, 1.8)
    truth = ViewNumbers(400.0, 100.0, 3.0, 8.0, -14.0, 11.0)
    start = ViewNumbers(400.0 * share, 100.0, 3.0, 20.0, -2.0, -1.0)
    assert _angle_deg(start, truth) > 15
    rings = rings_of_sizes((len(TREFOIL),))
    bounds = Bounds(("azimuth", "elevation", "roll", "light"))
    found = fit_view(TREFOIL, rings, sheet, _shadow(TREFOIL, truth, sheet), start, bounds, 60)
    assert _angle_deg(found.numbers, truth) < 0.5
    assert found.numbers.light_distance_mm == pytest.approx(400.0, rel=0.02)
    assert (found.numbers.wall_distance_mm, found.numbers.radius_mm) == (100.0, 3.0)


def test_bounds_hold_whatever_is_asked() -> None:
    start = ViewNumbers(400.0, 100.0, 3.0)
    bounds = Bounds(turn_deg=5.0, least_radius_mm=2.0, most_radius_mm=3.5)
    unknowns = Unknowns(start, bounds)
    for way in (1.0, -1.0):
        for _ in range(400):
            pull = torch.full((3,), way, dtype=torch.float64)
            unknowns.move((pull, pull), TREFOIL, 0.0)
        n = unknowns.numbers()
        depth = TREFOIL @ n.turn[:, 2]
        assert n.light_distance_mm * 0.25 >= depth.max() + n.radius_mm - 1e-6
        assert n.wall_distance_mm * 0.9 >= -depth.min() + n.radius_mm - 1e-6
        assert 2.0 - 1e-9 <= n.radius_mm <= 3.5 + 1e-9
        assert max(abs(n.azimuth_deg), abs(n.elevation_deg), abs(n.roll_deg)) <= 5.0 + 1e-9
        assert 200.0 - 1e-6 <= n.light_distance_mm <= 800.0 + 1e-6
    # pulled down: at the least of each
    assert unknowns.radius_mm == pytest.approx(3.5)


def test_what_is_not_free_stays() -> None:
    start = ViewNumbers(400.0, 100.0, 3.0, 7.0)
    unknowns = Unknowns(start, Bounds(("elevation", "wall")))
    pull = torch.ones(3, dtype=torch.float64)
    for _ in range(20):
        unknowns.move((pull, pull), TREFOIL, 0.0)
    n = unknowns.numbers()
    kept = (n.azimuth_deg, n.roll_deg, n.light_distance_mm, n.radius_mm)
    assert kept == pytest.approx((7.0, 0.0, 400.0, 3.0))
    assert n.elevation_deg < -1 and n.wall_distance_mm < 95


def test_wrong_bounds_are_told() -> None:
    with pytest.raises(InputError, match="no such number"):
        Bounds(("azimuth", "colour"))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="above"):
        Bounds(least_radius_mm=3.0, most_radius_mm=2.0)
    with pytest.raises(InputError, match="outside its bounds"):
        Unknowns(ViewNumbers(400.0, 100.0, 0.5), Bounds())


@pytest.fixture(scope="module")
def problem() -> Problem:
    target = read_target("text:♥")
    scene = resolve(Scene(), [(target.width, target.height)])
    scene = scene.model_copy(update={"views": (resolve_view(scene.views[0], target),)})
    return problem_of(scene, target)


def _objective(problem: Problem, points: np.ndarray, rings: Rings) -> FreeObjective:
    situation = Situation(problem.view, problem.limits(4.0), points, rings, 0.7, 0.25)
    effects = survey(situation)
    for decision in effects.values():
        decision.simulated = True
    unknowns = Unknowns(ViewNumbers(500.0, 100.0, 4.0, 6.0, 3.0), Bounds())
    target = torch.zeros(64, 64, dtype=torch.float64)
    sheet = Sheet(64, 64, 3.0)
    return FreeObjective(problem, unknowns, sheet, target, rings, effects, Weights(), (3.0, 3.0), 1)


def test_the_joint_objective_has_the_value_and_slope_of_the_plain_one(problem: Problem) -> None:
    # strands near each other, so that every limit has a slope
    points = 0.25 * TREFOIL
    rings = rings_of_sizes((len(points),))
    near = find_neighbours(points, rings, 40.0, 6)
    held, free = (_objective(problem, points, rings) for _ in range(2))
    held.held = True
    gradients, values = [], []
    for objective in (held, free):
        variable = torch.tensor(points, requires_grad=True)
        loss = objective(variable, near, 0.0)
        gradients.append(torch.autograd.grad(loss, variable)[0])
        values.append(float(loss.detach()))
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    torch.testing.assert_close(gradients[0], gradients[1])
    assert held.unknowns.numbers() == ViewNumbers(500.0, 100.0, 4.0, 6.0, 3.0)
    assert free.unknowns.numbers() != held.unknowns.numbers()


def test_a_thicker_tube_costs_clearance_and_bends(problem: Problem) -> None:
    # the trefoil's strands come within 2 radii of each other, and its bends below one
    points = 0.25 * TREFOIL
    rings = rings_of_sizes((len(points),))
    near = find_neighbours(points, rings, 40.0, 6)
    objective = _objective(problem, points, rings)
    with torch.no_grad():
        more, less = (
            float(objective.limit_terms(torch.as_tensor(points), near, r, SETTLE))
            for r in (4.04, 3.96)
        )
    slope = objective.radius_slope(torch.as_tensor(points), near)
    assert slope > 1.0
    assert slope == pytest.approx((more - less) / 0.02, rel=0.01)


@pytest.mark.slow
def test_a_joint_search_ends_feasible_as_a_fixed_scene(problem: Problem) -> None:
    template = fill(problem.polygon, 4.0)
    fixed = search(problem, template, 4.0, QUICK)
    found = free_search(problem, template, 4.0, QUICK, Bounds())
    assert found.result.standing.violations == []
    assert found.result.account.least_margin_mm > 0
    assert found.result.iou_estimate > fixed.iou_estimate - 0.002
    # the numbers are a scene's: no turn is left in the view, and the knots look right in it
    assert found.view.azimuth_deg == 0
    assert found.knots.radius_mm != 4.0 and found.knots.radius_mm == round(found.knots.radius_mm, 4)
    frame, target, _ = picture_at(found.view, problem.mask, 160, True, "cpu")
    p = torch.as_tensor(found.knots.points).float()
    seen = render_tiled(p, p.roll(-1, 0), frame, found.knots.radius_mm, 10.0) > 0.5
    wanted = target > 0.5
    iou = float((seen & wanted).sum() / (seen | wanted).sum())
    assert iou == pytest.approx(found.result.iou_estimate, abs=0.001)


TINY = {
    **QUICK.model_dump(),
    "coarse_iterations": 8,
    "fine_iterations": 6,
    "settle_iterations": 20,
    "radius_candidates": 2,
    "free_view": True,
}


@pytest.mark.build
def test_a_build_with_a_free_view_writes_a_scene_that_gives_the_same_knots() -> None:
    target = read_target("text:\u2665")
    first = design(Scene(search=TINY), target)
    view, found = first.scene.views[0], first.scene.search
    assert (found["free_light_mm"], found["free_wall_mm"]) == (500.0, 100.0)
    assert view.light_distance_mm != 500.0 and view.wall_distance_mm != 100.0
    assert first.scene.piece.tube_radius_mm == first.knots.radius_mm != found["free_radius_mm"]
    again = design(first.scene, target)
    np.testing.assert_array_equal(first.knots.points, again.knots.points)
    assert again.scene == first.scene


def test_a_radius_that_is_given_stays_given() -> None:
    piece = Piece(tube_radius_mm=4.0)
    made = design(Scene(piece=piece, search=TINY), read_target("text:\u2665"))
    assert made.knots.radius_mm == 4.0 and made.scene.search["free_radius_mm"] == 0


@pytest.mark.parametrize(
    ("search", "device", "budget", "word"),
    [({"method": "inn"}, "cpu", None, "inn"), ({}, "cuda", None, "cuda"), ({}, "cpu", 9.0, "time")],
)
def test_what_a_free_view_does_not_go_with(
    search: dict[str, str], device: str, budget: float | None, word: str
) -> None:
    scene = Scene(search={**TINY, **search})
    with pytest.raises(InputError, match=word):
        design(scene, read_target("text:\u2665"), device, budget_s=budget)
