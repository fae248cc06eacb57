"""Design the frames of a sequence: the first from a template, each other one from a neighbour's knots.

A frame is the same search as any: its start is an earlier frame's knots, which the pictures' displacement
carries along, its terms hold each vertex near its places in the frames beside it, and no vertex is added.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.budget import Budget
from knotfab.design.design import Design, plan_searches, price_design, settle_design
from knotfab.design.film_motion import Anchor, Tautness, outline_motion, transport
from knotfab.design.question import Question, ask, silhouette_polygon
from knotfab.design.radius import RadiusChoice, choose_radius
from knotfab.design.settings import place_start
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.picture.frames import count_knots
from knotfab.picture.opening import opening_iou
from knotfab.picture.read import Target
from knotfab.plan import Attempts, Search, Steps
from knotfab.problem import CertificateLog, Problem, Report, SearchResult, Start
from knotfab.scene.require import require_sequence
from knotfab.search.flow import FlowSettings, Phase, Plan, repair_phase, three_phases
from knotfab.start.profiles import lower
from knotfab_formats.scene import ResolvedScene, SettledScene
from knotfab_formats.search import PRESETS, SearchSettings

POOR = 0.025  # another attempt is made where the IoU is this far below that of the opening
_SLACK = 1.1  # length that a frame's knots may have over the first ones, for pictures of equal area
_THINNER = 0.93  # ratio of the next radius to the last
_FAR = 2.0  # distance, in tube radii, at which a strand no longer feels the silhouette
_ROOM = (
    1.04  # factor on the bend radius, which leaves room for the vertices that `finish_frame` adds
)
_SHORTEST = 1 / 32  # shortest certified step of `double_vertices`, as a share of the way
_MORE = 2.0  # factor on the iterations of a further attempt
_ALIKE = (
    0.5  # another frame is the better start if it differs less than this share of the neighbour
)


@dataclass(frozen=True)
class FrameResult:
    """One frame's knots, whose vertices have the same order in all frames.

    `beyond_mm`: the largest excess over the motion bound; negative while it is kept. `transported`: the share
    of the displacement between the pictures that was certified; the flow did the rest.
    """

    result: SearchResult
    beyond_mm: float
    transported: float = 1.0

    @property
    def sound(self) -> bool:
        """Whether every limit holds, the bound on motion included."""
        return self.result.feasible and self.beyond_mm <= 0


@dataclass(frozen=True)
class Attempt:
    """One way to search a frame: from the knots of frame `origin` (from 0).

    `closes`: whether the knots are held near the frame across the loop's seam. `effort`: factor on the
    iterations. `still`: whether the knots are only repaired.
    """

    origin: int
    closes: bool = True
    effort: float = 1.0
    still: bool = False
    why: str = field(default="", compare=False)  # the attempt before did not do


@dataclass(frozen=True)
class Trial:
    """The result of one attempt; `ended`, with twice the vertices, is None if `found` breaks a limit."""

    attempt: Attempt
    found: FrameResult
    ended: FrameResult | None

    @property
    def quality(self) -> tuple[bool, float]:
        if self.ended is None:
            return False, self.found.result.iou_estimate
        return self.ended.sound, self.ended.result.iou_estimate

    @property
    def lack(self) -> str:
        """Why another attempt follows."""
        sound, iou = self.quality
        return (
            f"it comes to an IoU of {iou:.3f}"
            if sound
            else "it breaks a limit or its motion's bound"
        )


@dataclass(frozen=True)
class Tie:
    """A known frame that another must stay near, and the motion of the outlines between the two, mm.

    `loop`: whether the seam between the last frame and the first lies between them.
    """

    frame: int
    outline_mm: float
    loop: bool = False


@dataclass(frozen=True)
class SequenceFrame:
    """One frame's design in scene coordinates, and the trial that found it; None for the first.

    Frames are numbered from 0. `searched`: the knots before their vertices were doubled.
    """

    number: int
    made: Design
    searched: Knots
    trial: Trial | None = None


class Chain:
    """Search the frames of a sequence, so that all have the same knots, vertices and tube radius.

    The frame with the most ink comes first (`pick_first`); the others follow, neighbour by neighbour, to the
    end and then back to the beginning. Each vertex keeps within the motion bound of its neighbours, and in a
    loop also within that across the seam.

    Args:
        scene: of one view, as for `design_knots`. A free view is settled on the first frame, since
            lamp and wall stay in place.
        device: where the paper's network searches the first frame.
        budget: limits the iterations, as measured on the first frame.

    Raises:
        SceneError, InputError: as `design_knots`.
    """

    def __init__(
        self,
        scene: ResolvedScene,
        targets: Sequence[Target],
        device: str = "cpu",
        attempts: Attempts | None = None,
        budget: Budget | None = None,
    ) -> None:
        require_sequence(scene)
        self._scene, self._targets, self._device = scene, targets, device
        self._attempts = attempts or Attempts(Progress("quiet"))
        self._progress, self._budget = self._attempts.progress, budget
        self._closing = scene.sequence.loop
        self._count = count_knots(targets, scene.piece.knots)
        self._first = pick_first(targets)
        self._frames: dict[int, SequenceFrame] = {}

    def frames(self) -> Iterator[SequenceFrame]:
        """Yield the frames as they are found, first the one with the most ink; none changes afterwards."""
        first = self._begin()
        self.accept(first)
        yield first
        count = len(self._targets)
        for number in (*range(self._first + 1, count), *range(self._first - 1, -1, -1)):
            neighbour = number - 1 if number > self._first else number + 1
            nearest = self._start_of(number, neighbour, self._frames)
            same = bool(np.array_equal(self._targets[nearest].mask, self._targets[number].mask))
            ways = list_attempts(nearest, neighbour, self._closing, same)
            found = self._search(number, ways)
            self.accept(found)
            yield found

    def retry(self, number: int) -> SequenceFrame:
        """Search a failed frame again from another start, near its neighbours.

        It replaces the failed one once `accept` gets it.
        """
        neighbours = [j for j in (number - 1, number + 1) if j in self._frames]
        nearest = self._start_of(number, neighbours[0], [j for j in self._frames if j != number])
        trial = self._frames[number].trial
        used = None if trial is None else trial.attempt.origin
        return self._search(number, list_retries([nearest, *neighbours], used, self._closing))

    def accept(self, frame: SequenceFrame) -> None:
        """Enter a frame in the chain: frames searched from now on stay near it."""
        self._frames[frame.number] = frame
        self._closing = self._closing and (frame.trial is None or frame.trial.attempt.closes)

    def _begin(self) -> SequenceFrame:
        """Search the first frame from a template, and settle what all frames take from it."""
        scene, targets, progress = self._scene, self._targets, self._progress
        settings = scene.settings
        if settings.free_view:
            scene, settings = place_start(scene, settings)
        target = targets[self._first]
        with progress.stage("radius"):
            question = ask(scene, [target])
            others = [
                silhouette_polygon(question.views[0], other)
                for other in targets
                if other is not target
            ]
            radius, choice = radius_for_all(question, others, settings, self._count)
        piece = scene.piece.but(
            knots=self._count, knots_asked=scene.piece.asks_for_bridges, tube_radius_mm=radius
        )
        asked = scene.but(piece=piece, views=(scene.views[0].but(name=target.name),))
        share = None
        if self._budget is not None:
            # a later frame takes 0.8 of the first one's time
            frame_s = self._budget.search_s(0) / (1.0 + 0.8 * (len(targets) - 1))
            share = Budget(time.perf_counter() + frame_s)
        first = self._attempts.carry_out(
            plan_searches(asked, [target], self._device, progress, share)
        )
        # keep the region's file as the scene names it, and let each frame's picture set its required IoU
        within = first.scene.but(region=question.problem.region, accuracy=scene.accuracy)
        self._settings, self._radius = first.settings, radius
        self._rings, self._why = first.knots.rings, first.result.log.template
        with progress.stage("search"):
            self._questions = [ask(_rename_view(within, t), [t]) for t in targets]
            self._problems = [question.problem for question in self._questions]
            polygons = [problem.polygons[0] for problem in self._problems]
            self._outlines = [
                outline_motion(p, q, self._count)
                for p, q in zip(polygons, [*polygons[1:], polygons[0]], strict=True)
            ]
            ended = self._attempts.carry_out(self._finish(self._first, first.result, []))
        made = settle_design(self._questions[self._first], ended.result, first.settings)
        made = replace(made, radius=choice, unmet=first.unmet, binding=first.binding)
        return SequenceFrame(self._first, made, first.knots)

    def _search(self, number: int, ways: Sequence[Attempt]) -> SequenceFrame:
        """Search a frame by several attempts, and settle the best."""
        ties, done, count = (
            list_ties(number, self._frames, self._outlines),
            len(self._frames),
            len(self._targets),
        )
        wanted = opening_iou(self._problems[number].polygons[0], self._radius) - POOR

        def report(part: float, _: float | None) -> None:
            self._progress.update((done + part) / count)

        with self._progress.stage("search"):
            best = self._attempts.carry_out(
                plan_best(ways, lambda way: self._try(number, way, ties, report), wanted)
            )
            ended = best.ended or self._attempts.carry_out(
                self._finish(number, best.found.result, self._anchors(ties, best.attempt, True))
            )
        made = settle_design(self._questions[number], ended.result, self._settings)
        made = self._attempts.carry_out(
            price_design(made, self._questions[number], None, None, self._progress)
        )
        return SequenceFrame(number, made, best.found.result.knots, best)

    def _try(self, number: int, way: Attempt, ties: Sequence[Tie], report: Report) -> Steps[Trial]:
        areas = [self._problems[k].polygons[0].area for k in (self._first, number)]
        longest = _SLACK * sum(k.length_mm for k in self._frames[self._first].searched.knots)
        found = yield from search_frame(
            self._frames[way.origin].searched,
            self._rings,
            (self._problems[way.origin], self._problems[number]),
            self._radius,
            self._settings.scaled(way.effort),
            longest * max(1.0, areas[1] / areas[0]),
            self._anchors(ties, way, False),
            report,
            way.still,
            way.why,
        )
        log = found.result.log
        log.template = f"the knot of frame {way.origin + 1}; of the first one: {self._why}"
        ended = None
        if found.sound:
            ended = yield from self._finish(number, found.result, self._anchors(ties, way, True))
        return Trial(way, found, ended)

    def _finish(
        self, number: int, found: SearchResult, anchors: Sequence[Anchor]
    ) -> Steps[FrameResult]:
        problem = self._problems[number]
        return finish_frame(found, self._rings, problem, self._radius, self._settings, anchors)

    def _anchors(self, ties: Sequence[Tie], way: Attempt, fine: bool) -> list[Anchor]:
        """Return the terms that hold a frame near others, as they were searched or, `fine`, as finished."""
        found = []
        for tie in ties:
            frame = self._frames[tie.frame]
            points = frame.made.knots.points if fine else frame.searched.points
            if way.closes or not tie.loop:
                found.append(Anchor(points, tie.outline_mm + self._radius, self._radius))
        return found

    def _start_of(self, number: int, neighbour: int, known: Iterable[int]) -> int:
        return pick_start([t.mask for t in self._targets], number, neighbour, known)


def radius_for_all(
    question: Question, polygons: Sequence[MultiPolygon], settings: SearchSettings, knots: int = 1
) -> tuple[float, RadiusChoice | None]:
    """Return a tube radius (mm) that draws the first frame well and no other frame much worse.

    Args:
        question: of the frame that is searched first. polygons: silhouettes of the others.
    """
    given = question.scene.piece.tube_radius_mm
    if given is not None:
        return given, None
    # another frame may need the IoU that the first one can spare
    if "radius_give" not in question.scene.search:
        give = min(settings.radius_give, PRESETS["standard"].radius_give)
        settings = settings.but(radius_give=give)
    choice = choose_radius(question, settings, knots)
    radius, thinnest = choice.radius_mm, question.scene.printer.min_tube_radius_mm
    # a frame's opening may lose 0.01 IoU against the first one's before the tube gets thinner
    wanted = question.opening(radius) - 0.01
    while radius * _THINNER >= thinnest and any(
        opening_iou(polygon, radius) < wanted for polygon in polygons
    ):
        radius *= _THINNER
    return round(radius, 4), choice


def pick_first(targets: Sequence[Target]) -> int:
    """Choose the frame to search first: the one with the most ink, or frame 0 if it has nearly as much.

    A limb that the first silhouette hides would get no strand, and could not appear in later frames.
    """
    inks = [int(target.mask.sum()) for target in targets]
    return 0 if inks[0] >= 0.98 * max(inks) else inks.index(max(inks))


def pick_start(
    masks: Sequence[NDArray[np.bool_]], number: int, neighbour: int, known: Iterable[int]
) -> int:
    """Choose the known frame to begin another from: its neighbour, or one that is much more like it.

    When limbs part that the neighbour's silhouette merges, the knots of a frame that shows them apart
    have a strand for each.
    """
    step = max(1, max(masks[0].shape) // 256)
    few = [mask[::step, ::step] for mask in masks]
    unlike = {j: float((few[j] ^ few[number]).mean()) for j in known}
    nearest = min(unlike, key=lambda j: (unlike[j], j))
    return nearest if unlike[nearest] < _ALIKE * unlike[neighbour] else neighbour


def list_ties(number: int, known: Container[int], outlines: Sequence[float]) -> tuple[Tie, ...]:
    """Return the nearest known frames on both sides around the loop, which frame `number` must stay near.

    Args:
        outlines: motion of the outlines from each frame to the next, and from the last to the first, mm.
    """
    count, ties = len(outlines), []
    for step in (1, -1):
        away, loop, k = 0.0, False, number
        while True:
            between = k if step > 0 else (k - 1) % count
            away, loop = away + outlines[between], loop or between == count - 1
            k = (k + step) % count
            if k in known or k == number:
                break
        if k != number:
            ties.append(Tie(k, away, loop))
    return tuple(ties)


def list_attempts(nearest: int, neighbour: int, closes: bool, same: bool) -> list[Attempt]:
    """List the attempts at a frame in their order.

    They begin from the frame most alike, then from the neighbour; first held near the frame across the seam,
    then not, then with more iterations. Last come the neighbour's knots unchanged, which draw the wrong
    picture but keep every limit.

    Args:
        closes: whether the loop is closed. same: whether the nearest frame has the same picture.
    """
    bound = [Attempt(nearest), Attempt(neighbour)] if closes else []
    free = [Attempt(nearest, False), Attempt(neighbour, False), Attempt(neighbour, False, _MORE)]
    held = [Attempt(neighbour, c, still=True) for c in ((True, False) if closes else (False,))]
    before = [replace(held[0], origin=nearest)] if same else []
    return list(dict.fromkeys([*before, *bound, *free, *held]))


def list_retries(origins: Iterable[int], used: int | None, closes: bool) -> list[Attempt]:
    """List attempts with more iterations, from each frame but the one that was used before."""
    found = [Attempt(j, closes, _MORE) for j in dict.fromkeys(origins) if j != used]
    return found or [Attempt(j, False, 2 * _MORE) for j in dict.fromkeys(origins)]


def plan_best(
    ways: Iterable[Attempt], plan: Callable[[Attempt], Steps[Trial]], wanted: float
) -> Steps[Trial]:
    """Plan attempts until one keeps every limit with at least the IoU `wanted`; return the best."""
    best: Trial | None = None
    for way in ways:
        if way.still and best is not None and best.quality[0]:
            continue  # the last resort for a frame that breaks a limit
        trial = yield from plan(way if best is None else replace(way, why=best.lack))
        if best is None or trial.quality > best.quality:
            best = trial
        if best.quality >= (True, wanted):
            break
    assert best is not None
    return best


def search_frame(
    before: Knots,
    rings: Polylines,
    problems: tuple[Problem, Problem],
    radius: float,
    settings: SearchSettings,
    taut_mm: float,
    anchors: Sequence[Anchor],
    report: Report | None = None,
    still: bool = False,
    why: str = "",
) -> Steps[FrameResult]:
    """Plan the search of a frame from the knots of an earlier one, `before`, whose vertices it keeps.

    The knots are transported by the displacement between the silhouettes. The search on the new picture
    follows, with the motion bound in its objective.

    Args:
        problems: of the earlier frame and of this one.
        taut_mm: length beyond which the knots are pulled taut.
        anchors: places that the vertices must stay near.
        still: keep the knots as they are, and repair only the limits that they break.
    """
    old, new = problems
    log = CertificateLog("the knot of an earlier frame", tuple(knot.type for knot in before.knots))
    if still:
        points, what = before.points, "another frame's knots"
        more = {"terms": tuple(anchors), "plan": _plan(settings, ())}
        far, transported = False, 0.0
    else:
        # `finish_frame` adds vertices, which bend more where edges are uneven
        new = replace(new, bend_radius=_ROOM * new.limits(radius).bend_radius)
        (was,), (now,) = old.polygons, new.polygons
        furthest = outline_motion(was, now, len(rings.sizes)) + 0.5 * radius
        light, axes = new.views[0].view.light_distance_mm, new.views[0].axes
        moved = transport(before.points @ axes.T, rings, was, now, light, radius, furthest)
        log.accepted, log.refused = moved.steps, moved.refused
        log.add_margin(moved.least_margin)
        far, transported = is_far(moved.points, rings, now, light, radius), moved.reached
        points, what = moved.points @ axes, "another frame's knots, carried along"
        # the transport has done half of the work
        phases = three_phases(settings.scaled(0.5), rates=(0.12, 0.06, 0.02))
        terms = (*anchors, Tautness(taut_mm, radius))
        more = {"terms": terms, "plan": _plan(settings, phases), "report": report}
    start = Start(tuple(rings.split(points)), log.template, log.types, far=far)
    what = f"{new.views[0].view.name} from {what}"
    result = yield Search(what, new, start, radius, settings, why, {**more, "log": log})
    return FrameResult(result, _largest_excess(result, anchors), transported)


def finish_frame(
    earlier: SearchResult,
    rings: Polylines,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    anchors: Sequence[Anchor],
) -> Steps[FrameResult]:
    """Double the vertices of a frame for its part, and plan the repair of the limits that this breaks.

    Args:
        earlier: the search that found the frame; its log is continued, and its work added to the result's.
    """
    log = earlier.log
    doubled, both = double_vertices(earlier.knots.points, rings)
    if doubled.steps:
        log.resamplings += 1
        log.add_margin(doubled.least_margin)
    else:
        log.resamplings_refused += 1
    start = Start(tuple(both.split(doubled.points)), log.template, log.types)
    more = {"terms": tuple(anchors), "plan": _plan(settings, ()), "log": log}
    what = f"{problem.views[0].view.name} with twice the vertices"
    result = yield Search(what, problem, start, radius, settings, more=more)
    result.add_work(earlier)
    return FrameResult(result, _largest_excess(result, anchors))


def double_vertices(points: Array, rings: Polylines) -> tuple[Carried, Polylines]:
    """Add a vertex in the middle of each edge of closed polylines, and round the old ones, (2 N, 3).

    A frame's search cannot add vertices, so stretched knots have long edges, which show in the outline. Each
    old vertex moves an eighth of its second difference inwards: one subdivision step towards the uniform
    cubic B-spline (Lane and Riesenfeld, "A theoretical development for the computer generation and display
    of piecewise polynomial surfaces", IEEE TPAMI 2(1), 1980). The motion is certified, and stops where it
    cannot be. Vertex 2i is the old vertex i, and 2i + 1 the new one after it.

    With even edges the new second differences average the old ones, so no bend gets sharper. A curve through
    the old vertices would double bends that alternate from vertex to vertex, too small for a repair to see.
    """
    ahead, behind = points[rings.next], points[rings.previous]
    start, step = np.empty((2 * len(points), 3)), np.zeros((2 * len(points), 3))
    start[::2], start[1::2] = points, 0.5 * (points + ahead)
    step[::2] = (ahead + behind - 2.0 * points) / 8.0
    both = polylines_of_sizes(tuple(2 * n for n in rings.sizes))
    whole = carry(start, both, lambda at, share: start + share * step, np.inf, _SHORTEST, 1.0)
    return whole, both


def is_far(
    points: Array, rings: Polylines, polygon: MultiPolygon, light_mm: float, radius: float
) -> bool:
    """Return whether some strand and the silhouette are too far apart for the image's pull."""
    seen = lower(points, light_mm)
    outside = shapely.distance(polygon, shapely.points(seen))
    lines = [shapely.LinearRing(ring) for ring in rings.split(seen)]
    covered = shapely.union_all([line.buffer(_FAR * radius) for line in lines])
    return bool(outside.max() > _FAR * radius) or not polygon.difference(covered).is_empty


def _plan(settings: SearchSettings, phases: Sequence[Phase]) -> Plan:
    # few vertices share a step whose length counts over all, so repairs take short steps
    def repair(number: int) -> Phase:
        rate = 0.01 * 0.7**number
        walk = FlowSettings(iterations=60, rate=rate, rate_end=0.1 * rate)
        return replace(repair_phase(settings, number), walk=walk)

    return Plan(tuple(phases), repair, repairs=6, keep_vertices=True)


def _largest_excess(result: SearchResult, anchors: Sequence[Anchor]) -> float:
    return max((a.excess(result.knots.points) for a in anchors), default=-np.inf)


def _rename_view(scene: SettledScene, target: Target) -> ResolvedScene:
    """Return the scene with its view named after another frame's picture."""
    view = scene.views[0].but(
        name=target.name, title=target.name, picture=f"picture-{target.name}{target.suffix}"
    )
    return scene.but(views=(view,))
