"""Design knots: from a scene and its pictures to feasible knots and a scene with every value settled."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.budget import (
    Budget,
    cut_settings,
    few_iterations,
    resolve_iterations,
    scale_to_budget,
)
from knotfab.design.hull import HullBound
from knotfab.design.question import Question, ask
from knotfab.design.radius import RadiusChoice, choose_radius, take_radius
from knotfab.design.retries import (
    has_valley_aloft,
    is_better,
    plan_prices,
    plan_sparser,
    start_on_more_legs,
    start_without_bumps,
)
from knotfab.design.settings import (
    fix_view,
    outline_mm,
    outline_px,
    place_directions,
    place_start,
    refine_mesh,
    start_pose,
    suit_settings,
    without_arches,
)
from knotfab.design.small import require_strokes
from knotfab.knots import Knots, read_start
from knotfab.limits.feasibility import Feasibility
from knotfab.picture.raster import silhouette_uri
from knotfab.picture.read import Target
from knotfab.plan import Attempts, Search, Steps
from knotfab.problem import Start
from knotfab.scene.require import require_tube
from knotfab.search.flow import plan_of
from knotfab.search.objective import Pose
from knotfab.search.search import Pace
from knotfab.search.state import SearchResult, SearchState
from knotfab.start.start import make_start, start_from_knots
from knotfab_formats.report import Price
from knotfab_formats.scene import (
    ResolvedScene,
    SettledAccuracy,
    SettledMaterial,
    SettledPiece,
    SettledRegion,
    SettledScene,
)
from knotfab_formats.search import SearchSettings

START_FILE = "start.json"
# searches at most for legs that all have a neighbour: each halves arches, and leaves others without one
_BRACINGS = 8
# share of the fine phase that fits arches which were added at the end of a search
_SHORTER = 1 / 6
_LOST = 0.002  # IoU that it may cost, or a whole search follows
_AMISS = "a leg has no neighbour to brace it, or is too flat"


@dataclass(frozen=True, repr=False)
class Design:
    """A finished search: knots in scene coordinates, and the scene with every value resolved.

    If the search could not meet a limit, `unmet` says which and where; the result is then a sparser one that
    meets all limits or, if none does, the one that broke them. `binding` lists the limits that cost the
    pictures IoU. `bounds` are the visual hull's, for several views.
    """

    scene: SettledScene
    knots: Knots
    result: SearchResult
    radius: RadiusChoice | None
    opening_iou: float
    settings: SearchSettings
    region_stl: bytes | None = None  # the file that the scene names, where the region is a mesh
    # the knots that the search started from, where the scene names them
    start_json: bytes | None = None
    unmet: Feasibility | None = None
    binding: tuple[Price, ...] = ()
    bounds: tuple[HullBound, ...] = ()
    start_ious: tuple[float, ...] = ()


def design_knots(
    scene: ResolvedScene,
    targets: Sequence[Target],
    device: str = "cpu",
    progress: Progress | None = None,
    budget: Budget | None = None,
) -> Design:
    """Design knots for a scene and the pictures of its views, in the views' order.

    Args:
        scene: as asked for, or as an earlier build settled it, which gives the same knots again.
        budget: limits the iterations to those that there is time for.

    Raises:
        SceneError: the scene cannot be met; InputError: the scene or a picture is wrong.
    """
    progress = progress or Progress("quiet")
    return Attempts(progress).carry_out(plan_searches(scene, targets, device, progress, budget))


def plan_searches(
    scene: ResolvedScene,
    targets: Sequence[Target],
    device: str,
    progress: Progress,
    budget: Budget | None = None,
    why: str = "",
) -> Steps[Design]:
    """Plan the searches of one design, as `design_knots` makes them.

    The first starts from a filling, on as many arches as its legs need after the coarse phase. Others start
    from what it lacks: sides that keep their order where a strand stands out, more arches where a leg is
    braced by none all the same, sparser strands where a limit is broken.

    Args:
        why: why this design is made after another one.
    """
    if scene.settings.free_view and scene.piece.supports == "none":
        # arches stand along the light's axis, so an ordinary search finds that first
        half = budget and replace(budget, ends=budget.ends - 0.5 * budget.view_s(1))
        bare = without_arches(scene)
        found = yield from plan_searches(bare, targets, device, progress, half, why)
        why = "the view is found"
        scene = fix_view(scene, found.scene.views[0], found.knots.radius_mm)
    scene, settings = _plan(scene, len(targets), budget)
    with progress.stage("question"):
        question = ask(scene, targets, progress)
    settings = suit_settings(settings, question, scene.search)
    question, radius, start, choice = choose_tube(question, settings, progress, budget)
    problem, knots = question.problem, question.scene.piece.knots
    _tell_scene(progress, question, radius)
    settings = refine_settings(question, settings, radius)
    if budget is not None and settings.method != "flow":
        with progress.stage("calibrate"):
            few, begun = few_iterations(settings), time.perf_counter()
            short = {"plan": replace(plan_of(few, len(problem.views)), repairs=0), "device": device}
            seconds = budget.search_s(sum(len(curve) for curve in start.curves))
            yield Search("a few iterations, to time them", problem, start, radius, few, why, short)
            lasted, why = time.perf_counter() - begun, "timed"
            settings = scale_to_budget(seconds, settings, lasted)
    with progress.stage("search"):
        pose, settings = _free_views(question, radius, settings)
        pace = None if budget is None else Pace(budget.search_s)
        first = Search(
            _name_search(question, radius),
            problem,
            start,
            radius,
            settings,
            why,
            {
                "pose": pose,
                "pace": pace,
                "device": device,
                "watch": progress.show,
                "report": progress.update if progress.watched else None,
            },
        )
        going = first
        if problem.arched and pace is None and settings.method == "flow":
            going = yield from _brace_start(first)
        start, result = going.start, (yield going)
        if pace is not None:
            settings = resolve_iterations(settings, pace.iterations)
        elif parted := start_without_bumps(problem, result, radius, settings, knots):
            what, why = "search from parted sides", "a strand stands out of the picture"
            other: SearchResult = yield replace(first, what=what, start=parted, why=why)
            if is_better(result, other):
                result.add_work(other)
            else:
                other.add_work(result)
                start, result = parted, other
        if problem.arched and pace is None:
            start, result = yield from _brace_end(first, start, result)
        unmet = None if result.feasible else result
        if unmet is not None:
            result = (yield from plan_sparser(problem, radius, knots, settings)) or unmet
            if result is not unmet:
                result.add_work(unmet)
    if settings.free_view:
        question = question.seen_from(result.views, targets)
    made = replace(settle_design(question, result, settings), radius=choice, start_ious=start.ious)
    return (yield from price_design(made, question, start, unmet, progress, budget))


def _brace_start(first: Search) -> Steps[Search]:
    """Plan coarse searches until no leg is amiss after one; return the search that goes on from there."""
    few = first.settings.but(fine_iterations=0, settle_iterations=0)
    short = {**first.more, "plan": replace(plan_of(few), repairs=0)}
    coarse, work = replace(first, what=f"coarse {first.what}", settings=few, more=short), None
    for _ in range(_BRACINGS):
        found: SearchResult = yield coarse
        if work is not None:
            found.add_work(work)
        work, start = found, start_on_more_legs(first.problem, coarse.start, found)
        if start is None:
            return replace(_go_on(first, first.what, found.state), start=coarse.start, why="")
        coarse = replace(coarse, what="coarse search from more arches", start=start, why=_AMISS)
    return replace(first, start=coarse.start, why=_AMISS)


def _brace_end(
    first: Search, start: Start, result: SearchResult
) -> Steps[tuple[Start, SearchResult]]:
    """Plan searches until no leg is amiss at the end of one; return its start and what it found.

    They go on from the strands as found where each such leg can be changed there; else, or where these then
    draw worse or leave a valley above the floor, they begin again.
    """
    for _ in range(_BRACINGS):
        braced = start_on_more_legs(first.problem, start, result, ended=True)
        if braced is None:
            break
        whole = replace(first, what="search from more arches", start=braced, why=_AMISS)
        searches = [whole]
        ended = result.state
        stood = replace(start, curves=tuple(ended.rings.split(ended.points)))
        if mended := start_on_more_legs(first.problem, stood, result, ended=True, every=True):
            state = replace(ended, points=np.concatenate(mended.curves))
            begun = replace(whole, start=start)
            short = _go_on(begun, "short search on more arches", state, _SHORTER)
            searches = [short, whole]
        for one in searches:
            further: SearchResult = yield one
            if result.feasible and not further.feasible:
                return start, result
            further.add_work(result)
            worse = further.iou_estimate < result.iou_estimate - _LOST
            start, result = one.start, further
            if not worse and not has_valley_aloft(result):
                break
    return start, result


def _go_on(search: Search, what: str, begun: SearchState, share: float = 1.0) -> Search:
    """Return the search that goes on from a state, by this share of the fine phase."""
    fine = round(share * search.settings.fine_iterations)
    rest = search.settings.but(coarse_iterations=0, fine_iterations=fine)
    return replace(search, what=what, settings=rest, more={**search.more, "begun": begun})


def _plan(
    scene: ResolvedScene, views: int, budget: Budget | None
) -> tuple[ResolvedScene, SearchSettings]:
    """Return the scene with starting values for free views, and the settings that the budget allows."""
    settings = scene.settings
    if budget is not None:
        settings = cut_settings(settings, budget.view_s(views), scene.search)
    if settings.free_view:
        return (place_start if views == 1 else place_directions)(scene, settings)
    return scene, settings


def _free_views(
    question: Question, radius: float, settings: SearchSettings
) -> tuple[Pose | None, SearchSettings]:
    """Return the pose or the directions to search for, if the settings leave them free."""
    if not settings.free_view:
        return None, settings
    if len(question.problem.views) == 1:
        return start_pose(question.scene, question.problem, radius, settings)
    from knotfab.search.free_pose import FreeDirections  # loads torch

    return FreeDirections(question.problem.views, radius, settings), settings


def _name_search(question: Question, radius: float) -> str:
    """Name a search by its supports, its tube, and for one view depth and wall."""
    piece, told = question.scene.piece, [f"a tube of {2 * radius:.2f} mm"]
    if len(question.views) == 1:
        told.append(f"{question.problem.depth_mm or 0.0:.0f} mm deep")
        told.append(f"{question.views[0].wall_distance_mm:.0f} mm from the wall")
    if piece.supports == "none":
        told.append("without supports")
    return f"search: {', '.join(told)}"


def price_design(
    made: Design,
    question: Question,
    start: Start | None,
    unmet: SearchResult | None,
    progress: Progress,
    budget: Budget | None = None,
) -> Steps[Design]:
    """Add the prices of the limits to a design that misses its IoU or a limit.

    Args:
        question: with the views that the search ended with.
        start: start of the short searches without a limit; None: made here.
        unmet: the first result, if it broke a limit.
        budget: once it is spent, no price is computed.
    """
    if unmet is None and made.result.iou_estimate >= made.scene.accuracy.iou_floor:
        return made
    vertices = sum(len(knot.points) for knot in made.knots.knots)
    if budget is not None and budget.search_s(vertices) <= 0.0:
        return replace(made, unmet=None if unmet is None else unmet.feasibility)
    with progress.stage("limits"):
        if start is None:
            try:
                radius, knots = made.knots.radius_mm, len(made.knots.knots)
                start = make_start(question.problem, radius, made.settings, knots)
            except SceneError:  # this picture alone has no such curve
                return made
        binding = yield from plan_prices(
            question.problem,
            start,
            unmet or made.result,
            made.settings,
            question.roomy(),
            None if unmet is None else made.result.iou_estimate,
        )
    feasibility = None if unmet is None else unmet.feasibility
    return replace(made, unmet=feasibility, binding=binding)


def settle_design(question: Question, result: SearchResult, settings: SearchSettings) -> Design:
    """Build the design from a search's result, with every value of its scene resolved.

    Args:
        question: with the views that the search ended with.
    """
    radius = result.knots.radius_mm
    fine = refine_settings(question, settings, radius)
    settings = settings.but(mesh_sides=fine.mesh_sides)
    region, region_stl = question.problem.region, None
    if region.file is not None:  # the build copies the mesh into the result's folder
        region_stl = Path(region.file).read_bytes()
        region = region.but(file="region.stl")
    start_json = None
    if settings.start:
        start_json = read_start(Path(settings.start)).dump_start().encode()
        settings = settings.but(start=START_FILE)
    asked = question.scene.accuracy.iou_floor
    floor = settings.floor(question.most_iou(radius)) if asked is None else asked
    return Design(
        _resolve(question, region, result, radius, floor, settings),
        result.knots,
        result,
        None,
        question.opening(radius),
        settings,
        region_stl,
        start_json,
        bounds=question.bounds,
    )


def choose_tube(
    question: Question, settings: SearchSettings, progress: Progress, budget: Budget | None = None
) -> tuple[Question, float, Start, RadiusChoice | None]:
    """Choose the tube radius, unless the scene gives it, and make the start of the search.

    Args:
        budget: as for `choose_radius`.

    Returns:
        The question with the start's depth, the radius in mm, the start, and the choice of the radius
        (None if the scene gave it).

    Raises:
        SceneError: the printer makes no tube this thin, or no tube draws the pictures.
    """
    piece = question.scene.piece
    knots = piece.knots
    choice: RadiusChoice | None = None
    if settings.start:
        knots_then = read_start(Path(settings.start))
        radius = piece.tube_radius_mm or knots_then.radius_mm
        require_tube(question.scene.but(piece=piece.but(tube_radius_mm=radius)))
        question = question.with_depth(radius)
        return question, radius, start_from_knots(question.problem, knots_then, radius), None
    if piece.tube_radius_mm is None:
        with progress.stage("radius"):
            _tell_scene(progress, question, None)
            choice = choose_radius(
                question, settings, knots, progress.update, progress.show, budget
            )
        radius = choice.radius_mm
    else:
        radius = piece.tube_radius_mm
        require_tube(question.scene)
    question = question.with_depth(radius)
    with progress.stage("template"):
        found = choice or take_radius(question, settings, knots, radius, placed=True)
        start = found.start or make_start(
            question.problem, radius, settings, knots, template=found.template
        )
    require_strokes(question, start)
    return question.as_started(start), radius, start, choice


def _tell_scene(progress: Progress, question: Question, radius: float | None) -> None:
    """Send listeners the views, silhouettes and radius with which they draw the knots."""
    masks = [view.mask for view in question.problem.views]
    progress.set_scene(question.views, lambda: [silhouette_uri(mask) for mask in masks], radius)


def refine_settings(question: Question, settings: SearchSettings, radius: float) -> SearchSettings:
    """Refine facets and vertices until the outline's error stays within its limit in every view."""
    problem, limit_px = question.problem, outline_px(question.scene.accuracy, settings)
    allowed = outline_mm(question.views, limit_px, problem.depth_mm or 0.0, radius)
    return refine_mesh(settings, radius, problem.limits(radius).bend_radius, allowed)


def _resolve(
    question: Question,
    region: SettledRegion,
    result: SearchResult,
    radius: float,
    floor: float,
    settings: SearchSettings,
) -> SettledScene:
    """Return the scene with every value resolved."""
    scene, problem = question.scene, question.problem
    depth = scene.piece.depth
    if len(problem.views) == 1:
        depth = 0.0 if problem.depth_mm is None else problem.depth_mm
    piece = {"tube_radius_mm": radius, "depth": depth, "knots": len(result.knots.knots)}
    piece["knots_asked"] = scene.piece.asks_for_bridges
    bend = problem.limits(radius).bend_radius
    resolved = {
        "views": question.views,
        "piece": SettledPiece(**scene.piece.but(**piece).model_dump()),
        "region": region,
        "material": SettledMaterial(
            **{**scene.material.model_dump(exclude_unset=True), "min_bend_radius_mm": bend}
        ),
        "accuracy": SettledAccuracy(
            **{
                **scene.accuracy.model_dump(),
                "iou_floor": floor,
                "max_outline_error_px": outline_px(scene.accuracy, settings),
            }
        ),
        "search": settings.model_dump(),
    }
    kept = {
        k: getattr(scene, k) for k in type(scene).model_fields if k not in ("schema_", *resolved)
    }
    return SettledScene.model_validate({"schema": 1, **kept, **resolved})
