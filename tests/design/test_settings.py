"""What a design makes of the presets before it searches: more grace where it is asked for, unless given."""

import json
import time
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from questions import ask_heart, ask_views, start_and_search
from shapely import MultiPolygon, Point

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design import design
from knotfab.design.budget import Budget, cut_settings, require_budget
from knotfab.design.design import Design, design_knots, price_design
from knotfab.design.question import Question
from knotfab.design.retries import SHORT, is_better, plan_prices, start_without_bumps
from knotfab.design.settings import outline_mm, outline_px, refine_mesh, suit_settings
from knotfab.geometry.tube import sweep
from knotfab.knots import Knot, Knots
from knotfab.part.assemble import sweep_knots
from knotfab.picture.read import read_target
from knotfab.plan import Attempts
from knotfab.problem import Problem
from knotfab.report.report import check_limits, tell_binding
from knotfab.scene.catalogue import resolve
from knotfab.start.start import make_start
from knotfab_formats.errors import InputError, plain
from knotfab_formats.piece import Accuracy, Piece
from knotfab_formats.scene import ResolvedView, Scene, SettledAccuracy
from knotfab_formats.search import PRESETS, SearchSettings, search_settings

PLAIN = SearchSettings()


def ask_of(lines: bool = False, views: int = 1) -> Question:
    view = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0, thicken_mm=3.0)
    target = SimpleNamespace(view=view, lines=("a stroke",) if lines else ())
    problem = SimpleNamespace(views=(target,) * views)
    return cast(Question, SimpleNamespace(problem=problem, views=(view,) * views))


ASKED = {"lines": (ask_of(lines=True), 4.0), "two views": (ask_of(views=2), 2.65)}


def test_one_picture_of_filament_takes_the_preset_as_it_is() -> None:
    assert suit_settings(PLAIN, ask_of(), {}) == PLAIN


@pytest.mark.parametrize("what", ASKED)
def test_what_asks_for_smoother_strands_gets_them_in_proportion(what: str) -> None:
    question, factor = ASKED[what]
    for grace in (PLAIN.grace, 0.3, 0.0):
        settings = PLAIN.model_copy(update={"grace": grace})
        found = suit_settings(settings, question, {})
        assert found.grace == pytest.approx(factor * grace)


@pytest.mark.parametrize("what", ASKED)
def test_what_the_scene_gives_means_the_same_whatever_is_asked(what: str) -> None:
    question, _ = ASKED[what]
    given = {"grace": 0.07, "fine_px": 100, "coarse_px": 50, "settle_iterations": 7}
    settings = PLAIN.model_copy(update=given)
    found = suit_settings(settings, question, given)
    assert {key: getattr(found, key) for key in given} == given
    # a build's own scene gives everything, and that is searched again
    assert suit_settings(found, question, found.model_dump()) == found


def test_lines_get_finer_pictures_and_several_views_more_steps() -> None:
    lines = suit_settings(PLAIN, ask_of(lines=True), {})
    wanted = 5 * 180 / 3.0
    assert lines.fine_px >= wanted and lines.coarse_px >= 0.5 * wanted
    assert lines.coarse_iterations == PLAIN.coarse_iterations
    three = suit_settings(PLAIN, ask_of(views=3), {})
    assert (three.fine_px, three.coarse_px) == (PLAIN.fine_px, PLAIN.coarse_px)
    assert three.coarse_iterations == 3 * PLAIN.coarse_iterations
    assert three.settle_iterations == 3 * PLAIN.settle_iterations


COARSE = SearchSettings(mesh_sides=8, settle_edge_radii=0.79)


def stand_out(points: Array, radius: float, vertices: Array) -> float:
    """The most by which corners of a mesh leave the round tube about a closed polyline's edges, mm."""
    start, edge = points, np.roll(points, -1, axis=0) - points
    share = np.einsum("vkj,kj->vk", vertices[:, None] - start, edge) / (edge * edge).sum(axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * edge
    return float(np.linalg.norm(vertices[:, None] - nearest, axis=2).min(axis=1).max()) - radius


@pytest.mark.parametrize("allowed_mm", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("radius_mm", [0.8, 1.5, 4.0])
def test_the_mesh_stands_out_no_further_at_the_sharpest_bend(
    radius_mm: float, allowed_mm: float
) -> None:
    bend_mm = 1.15 * radius_mm
    fine = refine_mesh(COARSE, radius_mm, bend_mm, allowed_mm)
    # a circle on which `bend_radii` is the limit: its edges touch one of that radius from outside
    count = int(np.ceil(np.pi / np.arctan(0.5 * fine.settle_edge_radii * radius_mm / bend_mm)))
    turn = 2.0 * np.pi * np.arange(count) / count
    around = bend_mm / np.cos(np.pi / count)
    ring = around * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    found = stand_out(ring, radius_mm, sweep(ring, radius_mm, fine.mesh_sides)[0])
    assert found <= 0.9 * allowed_mm  # some is kept for edges that are not quite even
    assert found >= 0.3 * allowed_mm or fine.settle_edge_radii == COARSE.settle_edge_radii


def test_what_is_fine_enough_stays() -> None:
    fine = SearchSettings(mesh_sides=64, settle_edge_radii=0.2)
    assert refine_mesh(fine, 1.5, 1.8, 0.2) == fine


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.study
def test_corners_of_presets_stay_within_the_clearance_check(name: str) -> None:
    """Corners of 14 sides took .02 mm of a gap of .4 mm on either side: a knight in 5 s was rejected."""
    thick = refine_mesh(PRESETS[name], 3.0, 3.5, 10.0)
    straight = np.zeros((400, 3))
    turn = 2.0 * np.pi * np.arange(400) / 400
    straight[:, :2] = 1000.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    assert stand_out(straight, 3.0, sweep(straight, 3.0, thick.mesh_sides)[0]) <= 0.0105 * 3.0


@pytest.mark.parametrize("frame_mm", [8.0, 180.0])
def test_the_smaller_a_picture_the_nearer_its_tubes_keep_to_their_line(frame_mm: float) -> None:
    """A dot of 9 mm in the wall's frame was a tube whose outline lay 1.3 px off: no printer could mend it."""
    radius = 0.8
    view = ResolvedView(frame_width_mm=frame_mm, frame_height_mm=frame_mm)
    scene = SimpleNamespace(
        views=(view,), accuracy=SettledAccuracy(iou_floor=0.9), piece=Piece(depth=4.0)
    )
    turn = 2 * np.pi * np.arange(100) / 100
    ring = 3.0 * np.column_stack([np.cos(turn), np.sin(turn), 0.2 * np.sin(3 * turn)])
    allowed = outline_mm((view,), scene.accuracy.max_outline_error_px, 4.0, radius)
    sides = refine_mesh(COARSE, radius, 1.0, allowed).mesh_sides
    knots = Knots((Knot(ring),), radius)
    made = SimpleNamespace(scene=scene, knots=knots, settings=SimpleNamespace(mesh_sides=sides))
    ((vertices, _),) = sweep_knots(cast(Design, made))
    assert stand_out(ring, radius, vertices) <= allowed
    fewer = len(vertices) < 100 * sides  # rings than vertices
    assert fewer == (frame_mm > 100.0)


def test_the_accuracy_sets_the_outline_limit_of_a_scene() -> None:
    """A limit that the scene gives is kept; the resolved scene holds the number in either case."""
    for given, name, expected in (
        ({}, "sketch", 1.5),
        ({}, "standard", 0.5),
        ({"max_outline_error_px": 0.3}, "sketch", 0.3),
    ):
        accuracy = Accuracy(name=name, **given)
        assert outline_px(accuracy, search_settings(name, {})) == expected


# Time budgets: the least, what is spared, and a search by the clock that its scene repeats.


TINY = {"coarse_px": 64, "fine_px": 96, "depth_candidates": 4, "radius_candidates": 2}


@pytest.mark.parametrize(
    ("least", "asked"),
    [
        (5.0, {"views": 1, "free": False}),
        (12.0, {"views": 2, "free": False}),
        (12.0, {"views": 1, "free": True}),
        (24.0, {"views": 1, "free": False, "frames": 6}),
    ],
)
def test_less_than_the_least_is_refused(least: float, asked: dict[str, Any]) -> None:
    require_budget(least, **asked)
    with pytest.raises(InputError, match=f"at least {least:g} s") as caught:
        require_budget(0.99 * least, **asked)
    assert caught.value.exit_code == 2


def test_what_is_spared_is_never_more_and_never_what_is_given() -> None:
    for own in PRESETS.values():
        for seconds in (0.1, 4.0, 9.0, 100.0):
            less = cut_settings(own, seconds, given={"fine_px"})
            assert less.fine_px == own.fine_px
            assert all(
                getattr(less, key) <= getattr(own, key)
                for key in ("coarse_px", "depth_candidates", "radius_candidates", "mesh_sides")
            )
    assert cut_settings(PRESETS["fine"], 100.0) == PRESETS["fine"]
    for seconds, like in ((0.1, "sketch"), (4.0, "draft"), (100.0, "standard")):
        less = cut_settings(PRESETS["standard"], seconds)
        assert less.radius_give == PRESETS[like].radius_give
        assert less.settle_edge_radii == PRESETS[like].settle_edge_radii
        assert cut_settings(PRESETS["standard"], seconds, {"radius_give"}).radius_give == 0.004
    assert cut_settings(PRESETS["sketch"], 4.0) == PRESETS["sketch"]  # never a thinner tube either


def test_what_follows_the_search_is_kept_back() -> None:
    budget = Budget(time.perf_counter() + 20.0, after_s=4.0, after_vertex_s=0.001)
    assert budget.search_s(2000) == pytest.approx(14.0, abs=0.5)


def test_more_is_given_only_while_what_follows_does_not_fit() -> None:
    def vertices(give: float) -> int:  # a thicker tube has fewer
        return int(4000 * (1.0 - 20.0 * give))

    asked = []
    for left in (30.0, 5.0, 2.6, 0.0):
        budget = Budget(time.perf_counter() + left, after_s=1.0, after_vertex_s=0.001)
        given = budget.thicker(0.0, vertices)
        count = vertices(given)
        asked.append(given)
        assert given == 0.03 or budget.search_s(count) > 0.0
        assert budget.thicker(0.04, vertices) == 0.04  # never less than what is given anyway
    assert asked == sorted(asked) and asked[0] == 0.0 and asked[-1] == 0.03


def test_no_price_is_asked_once_the_budget_is_spent(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []

    def plan_prices(*_: object) -> Any:
        yield from ()
        asked.append(True)
        return ()

    monkeypatch.setattr(design, "plan_prices", plan_prices)
    quiet = Progress("quiet")
    knots = SimpleNamespace(radius_mm=2.0, knots=[SimpleNamespace(points=np.zeros((9, 3)))])
    made = design.Design(None, knots, None, None, 1.0, PRESETS["draft"])  # type: ignore[arg-type]
    unmet: Any = SimpleNamespace(feasible=False, feasibility="broken", iou_estimate=0.5)
    question: Any = SimpleNamespace(problem=None, roomy=lambda: None)
    made = replace(made, result=unmet)
    for left, prices in ((-1.0, 0), (60.0, 1)):
        budget = Budget(time.perf_counter() + left)
        start: Any = object()
        plan = price_design(made, question, start, unmet, quiet, budget)
        found = Attempts(quiet).carry_out(plan)
        assert found.unmet == unmet.feasibility and len(asked) == prices


@pytest.mark.slow
def test_the_scene_of_a_build_by_the_clock_repeats_it() -> None:
    target = read_target("text:♥")
    made = design_knots(
        resolve(Scene(search=TINY)), [target], budget=Budget(time.perf_counter() + 0.7)
    )
    again = design_knots(made.scene, [target])
    np.testing.assert_array_equal(made.knots.points, again.knots.points)
    assert again.scene == made.scene


# What a limit costs: named with its price, in one view and in several.


pytestmark = pytest.mark.slow


def test_several_views_have_their_prices_too(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"coarse_px": 64, "fine_px": 64, "coarse_iterations": 40, "settle_iterations": 20}
    for name, value in {**few, "fine_iterations": 0}.items():
        monkeypatch.setitem(SHORT, name, value)
    settings = PRESETS["draft"].model_copy(update=few)
    disc = MultiPolygon([Point(0, 0).buffer(40.0)])
    problem = ask_views([disc, disc], 0.0, 90.0, pixels=100, length=480.0)
    start = make_start(problem, 5.0, settings)
    result = start_and_search(problem, 5.0, settings, start, repairs=0)
    plan = plan_prices(problem, start, result, settings, problem.region)
    [price] = Attempts(Progress("quiet")).carry_out(plan)
    assert price.limits == ("length",)
    assert price.asked[0] == 480.0 and price.needed[0] > 600.0
    assert price.iou_without > price.iou + 0.05
    assert "the length budget" in price.sentence.lower()


def test_a_length_budget_below_need_is_named_with_its_price(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = {"coarse_px": 96, "fine_px": 96, "coarse_iterations": 12, "settle_iterations": 8}
    for name, value in {**few, "fine_iterations": 4, "depth_candidates": 1}.items():
        monkeypatch.setitem(SHORT, name, value)
    given = {
        "schema": 1,
        "piece": {"tube_radius_mm": 5.0},
        "material": {"max_length_mm": 600.0},
        "accuracy": {"name": "draft"},
        "search": {
            **{"coarse_px": 96, "fine_px": 128, "depth_candidates": 4},
            **{"coarse_iterations": 20, "fine_iterations": 10, "settle_iterations": 10},
        },
        "views": [{"picture": "heart.png"}],
    }
    made = design_knots(resolve(Scene.model_validate(given)), [read_target("text:♥")])
    [price] = made.binding
    assert price.limits == ("length",) and price.met_without
    assert price.iou_without > price.iou + 0.2
    assert price.needed[0] > 600.0
    assert made.result.feasible
    assert made.result.feasibility.length_mm <= 600.0
    assert "max_length_mm = 600 mm" in tell_binding(made)[0]
    assert json.loads(json.dumps(plain(price)))["keys"] == ["[material] max_length_mm"]
    assert check_limits(made).status == ("pass" if made.unmet is None else "fail")


# A search that came to bumps gets another start, which draws the same picture; no other search
# does.


RADIUS = 3.0
FEW = PRESETS["draft"].model_copy(update={"depth_candidates": 4})


@dataclass(frozen=True)
class Ended:
    """What is asked of how a search ended."""

    knots: Knots
    feasible: bool = True
    iou_estimate: float = 0.9


def ended(problem: Problem, beside_mm: float) -> Ended:
    """A curve in the middle of the picture, one point of which stands so far outside it."""
    middle = problem.polygons[0].representative_point()
    right = problem.polygons[0].bounds[2]
    points = np.array([[middle.x, middle.y, 0.0]] * 3)
    points[:2, 0] += (1.0, -1.0)
    points[2, :2] = _beside(problem, right, beside_mm)
    return Ended(Knots((Knot(points @ problem.views[0].axes, closed=True),), RADIUS))


def _beside(problem: Problem, right: float, beside_mm: float) -> tuple[float, float]:
    from shapely import Point
    from shapely.ops import nearest_points

    shape = problem.polygons[0]
    edge = nearest_points(shape, Point(right + 10.0, shape.centroid.y))[0]
    return (edge.x + beside_mm, edge.y)


@pytest.mark.slow
def test_a_strand_beside_the_picture_asks_for_another_start() -> None:
    problem = ask_heart()
    start = start_without_bumps(problem, ended(problem, RADIUS), RADIUS, FEW, None)  # type: ignore[arg-type]
    assert start is not None and start.types == ("unknot",) * len(start.curves)
    assert start.depth is not None
    heights = np.concatenate(start.depth.depths)
    assert np.ptp(heights) <= problem.depth_mm + 1e-6  # type: ignore[operator]


@pytest.mark.slow
def test_no_bump_no_other_start_nor_where_the_start_was_given() -> None:
    problem = ask_heart()
    inside, bump = ended(problem, 0.3 * RADIUS), ended(problem, RADIUS)
    cases: list[tuple[Problem, Ended, SearchSettings]] = [
        (problem, inside, FEW),
        (replace(problem, depth_mm=None), bump, FEW),
        (problem, bump, FEW.model_copy(update={"start": "knots.json"})),
        (problem, bump, FEW.model_copy(update={"free_view": True})),
        (problem, bump, FEW.model_copy(update={"network_start": "circle"})),
    ]
    for asked, came_to, settings in cases:
        assert start_without_bumps(asked, came_to, RADIUS, settings, None) is None  # type: ignore[arg-type]


@pytest.mark.slow
def test_limits_come_before_pictures() -> None:
    knots = ended(ask_heart(), 0.0).knots
    good, kept = Ended(knots, feasible=False, iou_estimate=0.99), Ended(knots, iou_estimate=0.9)
    assert is_better(kept, good) and not is_better(good, kept)  # type: ignore[arg-type]
    assert is_better(replace(kept, iou_estimate=0.95), kept)  # type: ignore[arg-type]
    assert not is_better(kept, kept)  # type: ignore[arg-type]
