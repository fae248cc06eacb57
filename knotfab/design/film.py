"""Design the frames of a sequence: each is searched from the knots of a frame beside it.

A frame is the same search as any. Its start is an earlier frame's knots, and its terms hold each vertex near
its places in the frames beside it. No vertex is added.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon, affinity

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.budget import Budget
from knotfab.design.design import Design, plan_searches, price_design, settle_design
from knotfab.design.motion import lay_over, pair_pieces, wall_motion
from knotfab.design.question import Question, ask, silhouette_polygon
from knotfab.design.radius import RadiusChoice, choose_radius
from knotfab.design.settings import place_start
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines, polylines_of
from knotfab.knots import Knots
from knotfab.limits.terms import Felt, State, total_length
from knotfab.picture.frames import count_knots
from knotfab.picture.opening import opening_iou
from knotfab.picture.read import Target
from knotfab.picture.silhouette import signed_distance
from knotfab.plan import Search, Steps
from knotfab.problem import CertificateLog, Problem, Start
from knotfab.scene.require import require_sequence
from knotfab.search.flow import FlowSettings, Phase, Plan, repair_phase, three_phases
from knotfab.search.objective import Term, Weights
from knotfab.search.state import SearchResult
from knotfab.start.profiles import lower
from knotfab_formats.report import Motion
from knotfab_formats.scene import ResolvedScene, SettledScene
from knotfab_formats.search import PRESETS, SearchSettings

POOR = 0.025  # another attempt is made where the IoU is this far below that of the opening
_EDGE = 0.45  # longest spacing of vertices in tube radii, since strands stretch and none is added
_SLACK = 1.1  # length that a frame's knots may have over the first ones, for pictures of equal area
_TAUT = 0.05  # weight of the length beyond that
_THINNER = 0.93  # ratio of the next radius to the last
_FAR = 2.0  # distance, in tube radii, at which a strand no longer feels the silhouette
_MORE = 2.0  # factor on the iterations of the last attempt
# another frame is the better start if it differs less than this share of the neighbour
_ALIKE = 0.5
_GRID = 144  # grid points on the longer side of a displacement
_CLIP = 6.0  # clip of the distances from an outline, grid points
_FITS = 0.98  # IoU above which a shifted or stretched silhouette is taken as it is


@dataclass(frozen=True)
class Way:
    """A start of a frame's search: the knots of frame `origin` (from 0).

    `closes`: whether the knots are held near the frame across the loop's seam. `effort`: factor on the
    iterations.
    """

    origin: int
    closes: bool = True
    effort: float = 1.0


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
    """One frame's design in scene coordinates; its vertices have the same order in all frames.

    Frames are numbered from 0. `way` is None for the first that was searched. `beyond_mm`: the largest excess
    over the motion bound; negative while it is kept.
    """

    number: int
    made: Design
    way: Way | None = None
    beyond_mm: float = -np.inf

    @property
    def quality(self) -> tuple[bool, float]:
        """Whether every limit holds, the bound on motion included; and the IoU."""
        result = self.made.result
        return result.feasible and self.beyond_mm <= 0, result.iou_estimate

    @property
    def lack(self) -> str:
        """Why another attempt follows."""
        sound, iou = self.quality
        return (
            f"it comes to an IoU of {iou:.3f}"
            if sound
            else "it breaks a limit or its motion's bound"
        )


class Chain:
    """Plan the searches of a sequence's frames, so that all have the same knots, vertices and tube radius.

    In the `order` of their numbers the frame with the most ink comes first (`pick_first`); the others
    follow, neighbour by neighbour, to the end and then back to the beginning. Each vertex keeps within the
    motion bound of its neighbours, and in a loop also within that across the seam. `outlines_mm`: how far
    outlines move from each frame to the next, and from the last to the first.

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
        progress: Progress | None = None,
        budget: Budget | None = None,
    ) -> None:
        require_sequence(scene)
        self._scene, self._targets, self._device = scene, targets, device
        self._progress, self._budget = progress or Progress("quiet"), budget
        self._closing = scene.sequence.loop
        self._count = count_knots(targets, scene.piece.knots)
        self._frames: dict[int, SequenceFrame] = {}
        first, count = pick_first(targets), len(targets)
        self.order = (*range(first, count), *range(first - 1, -1, -1))

    def plan(self, number: int, why: str = "") -> Steps[SequenceFrame]:
        """Plan the searches of a frame, the next in the `order`; `why` is for the first one's."""
        if self._frames:
            neighbour = number - 1 if number > self.order[0] else number + 1
            found = yield from self._plan(number, neighbour)
        else:
            found = yield from self._plan_first(number, why)
        self._frames[number] = found
        self._closing = self._closing and (found.way is None or found.way.closes)
        return found

    def _plan_first(self, number: int, why: str) -> Steps[SequenceFrame]:
        """Plan the search of the first frame from a template, and settle what all take from it."""
        scene, targets, progress = self._scene, self._targets, self._progress
        settings = scene.settings
        if settings.free_view:
            scene, settings = place_start(scene, settings)
        target = targets[number]
        with progress.stage("radius"):
            question = ask(scene, [target])
            others = [silhouette_polygon(question.views[0], t) for t in targets if t is not target]
            radius, choice = radius_for_all(question, others, settings, self._count)
        piece = scene.piece.but(
            knots=self._count, knots_asked=scene.piece.asks_for_bridges, tube_radius_mm=radius
        )
        edge = min(settings.settle_edge_radii, _EDGE)
        asked = scene.but(
            piece=piece,
            views=(scene.views[0].but(name=target.name),),
            search={**scene.search, "settle_edge_radii": edge},
        )
        share = None
        if self._budget is not None:
            # a later frame takes 0.8 of the first one's time
            frame_s = self._budget.search_s(0) / (1.0 + 0.8 * (len(targets) - 1))
            share = Budget(time.perf_counter() + frame_s)
        first = yield from plan_searches(asked, [target], self._device, progress, share, why)
        # keep the region's file as the scene names it, and let each frame's picture set its required IoU
        within = first.scene.but(region=question.problem.region, accuracy=scene.accuracy)
        with progress.stage("search"):
            self._questions = [ask(_rename_view(within, t), [t]) for t in targets]
            polygons = [question.problem.polygons[0] for question in self._questions]
            self.outlines_mm = [
                wall_motion(first.scene.views[0], p, q, self._count)
                for p, q in zip(polygons, [*polygons[1:], polygons[0]], strict=True)
            ]
        self._settings, self._radius, self._why = first.settings, radius, first.result.log.template
        length = sum(knot.length_mm for knot in first.knots.knots)
        self._longest = [
            _SLACK * length * max(1.0, p.area / polygons[number].area) for p in polygons
        ]
        return SequenceFrame(number, replace(first, radius=choice))

    def _plan(self, number: int, neighbour: int) -> Steps[SequenceFrame]:
        """Plan a frame's attempts until one keeps every limit and draws the picture; return the best."""
        question = self._questions[number]
        masks = [target.mask for target in self._targets]
        nearest = pick_start(masks, number, neighbour, self._frames)
        wanted = opening_iou(question.problem.polygons[0], self._radius) - POOR
        best: SequenceFrame | None = None
        for way in list_ways(nearest, neighbour, self._closing):
            anchors = [
                Anchor(
                    self._frames[tie.frame].made.knots.points,
                    tie.outline_mm + self._radius,
                    self._radius,
                )
                for tie in list_ties(number, self._frames, self.outlines_mm)
                if way.closes or not tie.loop
            ]
            before = self._frames[way.origin].made
            with self._progress.stage("search"):
                result: SearchResult = yield frame_search(
                    before.knots,
                    f"the knot of frame {way.origin + 1}; of the first one: {self._why}",
                    (self._questions[way.origin].problem, question.problem),
                    self._settings.scaled(way.effort),
                    (*anchors, Tautness(self._longest[number], self._radius)),
                    "" if best is None else best.lack,
                )
            beyond = max((a.excess(result.knots.points) for a in anchors), default=-np.inf)
            made = settle_design(question, result, self._settings)
            found = SequenceFrame(number, made, way, beyond)
            best = found if best is None or found.quality > best.quality else best
            if best.quality >= (True, wanted):
                break
        assert best is not None
        return replace(
            best, made=(yield from price_design(best.made, question, None, None, self._progress))
        )


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


def list_ways(nearest: int, neighbour: int, closes: bool) -> list[Way]:
    """List the ways to search a frame in their order.

    They begin from the frame most alike, then from the neighbour; first held near the frame across the seam,
    if the loop `closes`, then not, then with more iterations.
    """
    bound = [Way(nearest), Way(neighbour)] if closes else []
    free = [Way(nearest, False), Way(neighbour, False), Way(neighbour, False, _MORE)]
    return list(dict.fromkeys([*bound, *free]))


def frame_search(
    before: Knots,
    why_known: str,
    problems: tuple[Problem, Problem],
    settings: SearchSettings,
    terms: tuple[Term, ...],
    why: str = "",
) -> Search:
    """Return the search of a frame from the knots of an earlier one, whose vertices it keeps.

    The motion of the picture carries them along.

    Args:
        problems: of the earlier frame and of this one.
        why_known: why the knots' type is known.
        terms: hold the vertices near other frames.
        why: why another attempt is made.
    """
    problem = problems[1]
    types, radius = tuple(knot.type for knot in before.knots), before.radius_mm
    rings, log = polylines_of([k.points for k in before.knots]), CertificateLog(why_known, types)
    (old, new), axes = (one.polygons[0] for one in problems), problem.views[0].axes
    view = problem.views[0].view
    light = view.light_distance_mm
    furthest = wall_motion(view, old, new, len(types)) + 0.5 * radius
    moved = transport(before.points @ axes.T, rings, old, new, light, radius, furthest)
    log.accepted, log.refused = moved.steps, moved.refused
    log.add_margin(moved.least_margin)
    far = is_far(moved.points, rings, new, light, radius)
    start = Start(tuple(rings.split(moved.points @ axes)), why_known, types, far=far)
    # the transport has done half of the work
    phases = three_phases(settings.scaled(0.5), rates=(0.12, 0.06, 0.02))

    # few vertices share a step whose length counts over all, so repairs take short steps
    def repair(number: int) -> Phase:
        rate = 0.01 * 0.7**number
        walk = FlowSettings(iterations=60, rate=rate, rate_end=0.1 * rate)
        return replace(repair_phase(settings, number), walk=walk)

    plan = Plan(phases, repair, repairs=6, keep_vertices=True)
    what = f"{problem.views[0].view.name} from another frame's knots, carried along"
    more = {"terms": terms, "plan": plan, "log": log}
    return Search(what, problem, start, radius, settings, why, more)


def is_far(
    points: Array, rings: Polylines, polygon: MultiPolygon, light_mm: float, radius: float
) -> bool:
    """Return whether some strand and the silhouette are too far apart for the image's pull."""
    seen = lower(points, light_mm)
    outside = shapely.distance(polygon, shapely.points(seen))
    lines = [shapely.LinearRing(ring) for ring in rings.split(seen)]
    covered = shapely.union_all([line.buffer(_FAR * radius) for line in lines])
    return bool(outside.max() > _FAR * radius) or not polygon.difference(covered).is_empty


def _rename_view(scene: SettledScene, target: Target) -> ResolvedScene:
    """Return the scene with its view named after another frame's picture."""
    view = scene.views[0].but(
        name=target.name, title=target.name, picture=f"picture-{target.name}.png"
    )
    return scene.but(views=(view,))


@dataclass(frozen=True)
class Anchor(Term):
    """A hard limit on each vertex's distance from its place in another frame, (N, 3) mm.

    As a term of the objective it is the sum of squared excesses, in tube radii.
    """

    points: Array
    limit_mm: float
    radius_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        away = state.points - self.points
        # the small term keeps the root's slope finite at 0, where the hinge is inactive anyway
        length = np.sqrt((away * away).sum(axis=1) + 1e-12)
        # the pull begins a little before the limit
        beyond = np.maximum(length - 0.97 * self.limit_mm, 0.0) / self.radius_mm
        slope = (2.0 * weights.hold / self.radius_mm * beyond / length)[:, None] * away
        return weights.hold * float((beyond * beyond).sum()), slope

    def kept(self, points: Array) -> bool:
        return self.excess(points) <= 0

    def excess(self, points: Array) -> float:
        """Return the largest excess over the limit, mm; negative while all vertices keep it."""
        return float(np.linalg.norm(points - self.points, axis=1).max()) - self.limit_mm


@dataclass(frozen=True)
class Tautness(Term):
    """Penalise knots longer than `length_mm`, whose fixed number of vertices would leave visible edges."""

    length_mm: float
    radius_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        length, slope = total_length(state)
        excess = max(0.0, length - self.length_mm) / self.radius_mm
        return _TAUT * excess**2, 2.0 * _TAUT * excess / self.radius_mm * slope


def measure_motion(old: Array, new: Array, outline_mm: float, radius: float) -> Motion:
    """Measure the vertices' motion from `old` to `new` (N, 3) against its bound, `outline_mm` + `radius`."""
    length = np.linalg.norm(new - old, axis=1)
    largest, limit = float(length.max()), outline_mm + radius
    return Motion(largest_mm=largest, outline_mm=outline_mm, limit_mm=limit, held=largest <= limit)


# the picture's motion, which carries a knot along


def transport(
    points: Array,
    rings: Polylines,
    old: MultiPolygon,
    new: MultiPolygon,
    light_mm: float,
    radius: float,
    furthest_mm: float,
) -> Carried:
    """Move the vertices (N, 3) by the displacement that takes silhouette `old` to `new`, step by step.

    Each step is certified to keep the knots' type; the way ends where no step can be. Each of several knots
    follows its own piece. A vertex keeps its depth, and its projection from the light onto z = 0 moves.

    Args:
        light_mm: distance of the light from the middle of the piece.
        furthest_mm: longest way of a vertex.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    seen = rings.split(points[:, :2] / shrink)
    pairs = pair_pieces(old, new, len(seen))
    if len(pairs) < len(seen):
        pairs = pairs * len(seen)
    away = [
        [float(shapely.distance(p, shapely.points(at)).mean()) for p, _ in pairs] for at in seen
    ]
    _, drawn = linear_sum_assignment(away)
    shift = shrink * np.concatenate(
        [displace(at, *pairs[int(k)], 6.0 * radius) for at, k in zip(seen, drawn, strict=True)]
    )
    length = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, furthest_mm / np.maximum(length, 1e-12))[:, None]
    whole = np.column_stack([shift, np.zeros(len(points))])
    return carry(points, rings, lambda at, share: points + share * whole, 0.5 * radius, 1e-3)


def displace(at: Array, old: MultiPolygon, new: MultiPolygon, margin: float) -> Array:
    """Return the smooth displacement that takes silhouette `old` to `new`, at points (n, 2) mm.

    What a shift or a stretch does not lay over it the optical flow between their distances does.

    Args:
        margin: width of the border around both, mm.
    """
    import skimage.registration as untyped

    registration: Any = untyped

    stretch, offset, overlap = lay_over(old, new)
    there = stretch * at + offset
    if overlap > _FITS:
        return there - at
    moved = affinity.affine_transform(old, [stretch[0], 0, 0, stretch[1], *offset])
    both = np.array([moved.bounds, new.bounds])
    low, high = both[:, :2].min(0) - margin, both[:, 2:].max(0) + margin
    pitch = float((high - low).max()) / _GRID
    x, y = (np.arange(a, b + pitch, pitch) for a, b in zip(low, high, strict=True))
    images = []
    for polygon in (moved, new):
        shapely.prepare(polygon)
        inside = shapely.contains_xy(polygon, *np.meshgrid(x, y))
        images.append(np.tanh(gaussian_filter(signed_distance(inside), 0.7) / _CLIP))
    flow = registration.optical_flow_tvl1(*images, num_warp=10, num_iter=20)
    where = ((there - low) / pitch).T[::-1]
    found = [map_coordinates(pitch * part, where, order=1, mode="nearest") for part in flow[::-1]]
    return np.asarray(there - at + np.stack(found, axis=1))
