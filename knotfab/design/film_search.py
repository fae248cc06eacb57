"""Search one more frame of a sequence: from an earlier frame's knots, held near the frames beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.design.film_motion import Anchor, Tautness, outline_motion, transport
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.picture.opening import opening_iou
from knotfab.plan import Search, Steps
from knotfab.problem import CertificateLog, Problem, SearchResult, Start
from knotfab.search.flow import FlowSettings, Phase, Plan, repair_phase, three_phases
from knotfab.search.objective import Term
from knotfab.start.profiles import lower
from knotfab_formats.search import SearchSettings

_FAR = 2.0  # distance, in tube radii, at which a strand no longer feels the silhouette
_ROOM = (
    1.04  # factor on the bend radius, which leaves room for the vertices that `finish_frame` adds
)
_SHORTEST = 1 / 32  # shortest certified step of `double_vertices`, as a share of the way
_MORE = 2.0  # factor on the iterations of a further attempt
POOR = 0.025  # another attempt is made where the IoU is this far below that of the opening
_ALIKE = (
    0.5  # another frame is the better start if it differs less than this share of the neighbour
)


@dataclass
class FrameResult:
    """One frame's knots, whose vertices have the same order in all frames."""

    result: SearchResult
    beyond_mm: float  # largest excess over the motion bound; negative while it is kept
    transported: float = 1.0  # share of the displacement that was certified

    @property
    def points(self) -> Array:
        """The vertices in scene coordinates, (N, 3) mm."""
        return self.result.knots.points

    @property
    def sound(self) -> bool:
        """Whether every limit holds, the bound on motion included."""
        return self.result.feasible and self.beyond_mm <= 0


def _plan(settings: SearchSettings, phases: Sequence[Phase]) -> Plan:
    # few vertices share a step whose length counts over all, so repairs take short steps
    def repair(number: int) -> Phase:
        rate = 0.01 * 0.7**number
        walk = FlowSettings(iterations=60, rate=rate, rate_end=0.1 * rate)
        return replace(repair_phase(settings, number), walk=walk)

    return Plan(tuple(phases), repair, repairs=6, keep_vertices=True)


def search_frame(
    before: Knots,
    rings: Polylines,
    problems: tuple[Problem, Problem],
    radius: float,
    settings: SearchSettings,
    taut_mm: float,
    anchors: Sequence[Anchor],
    report: Callable[[float, float | None], None] | None = None,
    still: bool = False,
) -> Steps[FrameResult]:
    """Search a frame from the knots of an earlier frame, `before`; vertices keep their number and order.

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
    terms: tuple[Term, ...] = tuple(anchors)
    if still:
        result = yield Search(
            "frame as it is",
            new,
            Start(tuple(rings.split(before.points)), log.template, log.types),
            radius,
            settings,
            more={"terms": terms, "plan": _plan(settings, ()), "log": log},
        )
        return FrameResult(result, _largest_excess(result, anchors), 0.0)
    # `finish_frame` adds vertices, which bend more where edges are uneven
    new = replace(new, bend_radius=_ROOM * new.limits(radius).bend_radius)
    (was,), (now,) = old.polygons, new.polygons
    furthest = outline_motion(was, now, len(rings.sizes)) + 0.5 * radius
    light, axes = new.views[0].view.light_distance_mm, new.views[0].axes
    moved = transport(before.points @ axes.T, rings, was, now, light, radius, furthest)
    log.accepted, log.refused = moved.steps, moved.refused
    log.add_margin(moved.least_margin)
    # the transport has done half of the work
    phases = three_phases(settings.scaled(0.5), rates=(0.12, 0.06, 0.02))
    result = yield Search(
        "frame from another's knots",
        new,
        Start(
            tuple(rings.split(moved.points @ axes)),
            log.template,
            log.types,
            far=is_far(moved.points, rings, now, light, radius),
        ),
        radius,
        settings,
        more={
            "terms": (*terms, Tautness(taut_mm, radius)),
            "plan": _plan(settings, phases),
            "log": log,
            "report": report,
        },
    )
    return FrameResult(result, _largest_excess(result, anchors), moved.reached)


def is_far(
    points: Array, rings: Polylines, polygon: MultiPolygon, light_mm: float, radius: float
) -> bool:
    """Return whether some strand and the silhouette are too far apart for the image's pull."""
    seen = lower(points, light_mm)
    outside = shapely.distance(polygon, shapely.points(seen))
    lines = [shapely.LinearRing(ring) for ring in rings.split(seen)]
    covered = shapely.union_all([line.buffer(_FAR * radius) for line in lines])
    return bool(outside.max() > _FAR * radius) or not polygon.difference(covered).is_empty


def finish_frame(
    earlier: SearchResult,
    rings: Polylines,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    anchors: Sequence[Anchor],
) -> Steps[FrameResult]:
    """Double the vertices of a frame for its part, and repair the limits that this breaks.

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
    result = yield Search(
        "frame with twice the vertices",
        problem,
        Start(tuple(both.split(doubled.points)), log.template, log.types),
        radius,
        settings,
        more={"terms": tuple(anchors), "plan": _plan(settings, ()), "log": log},
    )
    result.add_work(earlier)
    return FrameResult(result, _largest_excess(result, anchors))


def _largest_excess(result: SearchResult, anchors: Sequence[Anchor]) -> float:
    return max((a.excess(result.knots.points) for a in anchors), default=-np.inf)


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


class PictureDifferences:
    """Compare the frames' pictures, to choose the frame whose knots a search begins from."""

    def __init__(self, masks: Sequence[NDArray[np.bool_]]) -> None:
        step = max(1, max(masks[0].shape) // 256)
        self._masks = np.stack([m[::step, ::step] for m in masks])
        self._whole = masks

    def start_of(self, k: int, neighbour: int, known: Iterable[int]) -> int:
        """Return the known frame to begin frame k from: its neighbour, or one that is much more like it.

        When limbs part that the neighbour's silhouette merges, the knots of a frame that shows them apart
        have a strand for each.
        """
        unlike = {j: float((self._masks[j] ^ self._masks[k]).mean()) for j in known}
        nearest = min(unlike, key=lambda j: (unlike[j], j))
        return nearest if unlike[nearest] < _ALIKE * unlike[neighbour] else neighbour

    def same(self, one: int, other: int) -> bool:
        """Return whether two frames have equal pictures."""
        return bool(np.array_equal(self._whole[one], self._whole[other]))


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


@dataclass(frozen=True)
class Tie:
    """A known frame that another must stay near, and the motion of the outlines between the two, mm.

    `loop`: whether the seam between the last frame and the first lies between them.
    """

    frame: int
    outline_mm: float
    loop: bool = False


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


@dataclass(frozen=True)
class Following:
    """What the search of frame `number` needs: the frames known so far and the limits on this one.

    `why` says how the knot type of the first frame, and so of all, is known.
    """

    number: int
    known: Mapping[int, Knots]  # as searched
    fine: Mapping[int, NDArray[np.float64]]  # as finished, (2 N, 3) mm
    problems: Sequence[Problem]
    rings: Polylines
    radius: float
    settings: SearchSettings
    taut_mm: float
    ties: tuple[Tie, ...]
    why: str

    def search(
        self, attempts: Iterable[Attempt], report: Callable[[float, float | None], None]
    ) -> Steps[Trial]:
        """Return the first trial that keeps every limit and draws the picture well, or else the best."""
        wanted = opening_iou(self.problems[self.number].polygons[0], self.radius) - POOR
        best: Trial | None = None
        for attempt in attempts:
            if attempt.still and best is not None and best.quality[0]:
                continue  # the last resort for a frame that breaks a limit
            trial = yield from self._try(attempt, report)
            if best is None or trial.quality > best.quality:
                best = trial
            if best.quality >= (True, wanted):
                break
        assert best is not None
        if best.ended is None:
            best = replace(best, ended=(yield from self._finish(best.found, best.attempt)))
        return best

    def _try(self, attempt: Attempt, report: Callable[[float, float | None], None]) -> Steps[Trial]:
        found = yield from search_frame(
            self.known[attempt.origin],
            self.rings,
            (self.problems[attempt.origin], self.problems[self.number]),
            self.radius,
            self.settings.scaled(attempt.effort),
            self.taut_mm,
            self._anchors({j: knots.points for j, knots in self.known.items()}, attempt.closes),
            report,
            attempt.still,
        )
        log = found.result.log
        log.template = f"the knot of frame {attempt.origin + 1}; of the first one: {self.why}"
        ended = (yield from self._finish(found, attempt)) if found.sound else None
        return Trial(attempt, found, ended)

    def _finish(self, found: FrameResult, attempt: Attempt) -> Steps[FrameResult]:
        return finish_frame(
            found.result,
            self.rings,
            self.problems[self.number],
            self.radius,
            self.settings,
            self._anchors(self.fine, attempt.closes),
        )

    def _anchors(self, points: Mapping[int, NDArray[np.float64]], closes: bool) -> list[Anchor]:
        return [
            Anchor(points[tie.frame], tie.outline_mm + self.radius, self.radius)
            for tie in self.ties
            if closes or not tie.loop
        ]
