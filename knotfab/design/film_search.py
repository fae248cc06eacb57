"""A frame of a sequence is the same search, from the frame before and with terms that hold it near."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.design.design import add_work
from knotfab.design.film_motion import Anchor, Tautness, outline_motion, transport
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.picture.opening import opening_iou
from knotfab.problem import CertificateLog, Problem, SearchResult, Start
from knotfab.search.flow import FlowSettings, Phase, Plan, repair_phase, three_phases
from knotfab.search.objective import Term
from knotfab.search.search import search
from knotfab.start.depth import lower
from knotfab_formats.search import SearchSettings

_FAR = 2.0  # tube radii
_ROOM = 1.04  # factor of the bend radius that the part must keep


@dataclass
class FrameResult:
    """One frame's knots, their vertices in the same order in all frames."""

    result: SearchResult
    beyond_mm: float  # the worst excess over the motion bound; negative where the bound is kept
    transported: float = 1.0  # share of the displacement that could be certified

    @property
    def points(self) -> Array:
        """(N, 3) mm, scene coordinates."""
        return self.result.knots.points

    @property
    def sound(self) -> bool:
        """True if every limit holds, the motion's among them."""
        return self.result.feasible and self.beyond_mm <= 0


def _plan(settings: SearchSettings, phases: Sequence[Phase]) -> Plan:
    """Few vertices take all of a step that is measured over all: short ones end where they should."""

    def repair(number: int) -> Phase:
        rate = 0.01 * 0.7**number
        walk = FlowSettings(iterations=60, rate=rate, rate_end=0.1 * rate)
        return replace(repair_phase(settings, number), walk=walk)

    return Plan(tuple(phases), repair, repairs=6, keep_vertices=True)


def follow(
    before: Knots,
    rings: Polylines,
    problems: tuple[Problem, Problem],
    radius: float,
    settings: SearchSettings,
    taut_mm: float,
    anchors: Sequence[Anchor],
    device: str = "cpu",
    report: Callable[[float, float | None], None] | None = None,
    still: bool = False,
) -> FrameResult:
    """Search a frame's knot from the knot of an earlier one, `before`.

    Transport along the displacement between the two silhouettes, then the search on the new picture with
    the motion bound in its objective; vertices keep their number and order.

    Args:
        problems: problems of the earlier frame and of this one.
        taut_mm: a longer knot is drawn taut: no vertices can be added, and long edges show.
        anchors: frames that this one must stay near.
        still: the knot stays as it is, and only limits that it breaks are repaired.
    """
    old, new = problems
    log = CertificateLog("the knot of an earlier frame", tuple(knot.type for knot in before.knots))
    terms: tuple[Term, ...] = tuple(anchors)
    if still:
        result = search(
            new,
            Start(tuple(rings.split(before.points)), log.template, log.types),
            radius,
            settings,
            terms=terms,
            plan=_plan(settings, ()),
            log=log,
            device=device,
        )
        return FrameResult(result, _beyond(result, anchors), 0.0)
    # room for the vertices that `finish` adds: where edges are uneven those bend more in places
    new = replace(new, bend_radius=_ROOM * new.limits(radius).bend_radius)
    (was,), (now,) = old.polygons, new.polygons
    furthest = outline_motion(was, now, len(rings.sizes)) + 0.5 * radius
    light, axes = new.views[0].view.light_distance_mm, new.views[0].axes
    moved = transport(before.points @ axes.T, rings, was, now, light, radius, furthest)
    log.accepted, log.refused = moved.steps, moved.refused
    log.add_margin(moved.least_margin)
    # half as many iterations as from a template: the transport has done the rest
    phases = three_phases(settings.scaled(0.5), rates=(0.12, 0.06, 0.02))
    result = search(
        new,
        Start(
            tuple(rings.split(moved.points @ axes)),
            log.template,
            log.types,
            far=is_far(moved.points, rings, now, light, radius),
        ),
        radius,
        settings,
        terms=(*terms, Tautness(taut_mm, radius)),
        plan=_plan(settings, phases),
        log=log,
        device=device,
        report=report,
    )
    return FrameResult(result, _beyond(result, anchors), moved.reached)


def is_far(
    points: Array, rings: Polylines, polygon: MultiPolygon, light_mm: float, radius: float
) -> bool:
    """Tell whether strands, or parts of the silhouette, stand where no image pulls them together."""
    seen = lower(points, light_mm)
    outside = shapely.distance(polygon, shapely.points(seen))
    lines = [shapely.LinearRing(ring) for ring in rings.split(seen)]
    covered = shapely.union_all([line.buffer(_FAR * radius) for line in lines])
    return bool(outside.max() > _FAR * radius) or not polygon.difference(covered).is_empty


def finish(
    earlier: SearchResult,
    rings: Polylines,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    anchors: Sequence[Anchor],
    device: str = "cpu",
) -> FrameResult:
    """Return a frame for its part: twice as many vertices, and the limits repaired where that broke one.

    Args:
        earlier: the search that found the frame, whose log goes on, and whose calls are counted with these.
    """
    log = earlier.log
    doubled, both = double_vertices(earlier.knots.points, rings)
    if doubled.steps:
        log.resamplings += 1
        log.add_margin(doubled.least_margin)
    else:
        log.resamplings_refused += 1
    result = search(
        problem,
        Start(tuple(both.split(doubled.points)), log.template, log.types),
        radius,
        settings,
        terms=tuple(anchors),
        plan=_plan(settings, ()),
        log=log,
        device=device,
    )
    add_work(result, earlier)
    return FrameResult(result, _beyond(result, anchors))


def _beyond(result: SearchResult, anchors: Sequence[Anchor]) -> float:
    return max((a.beyond(result.knots.points) for a in anchors), default=-np.inf)


_SHORTEST = 1 / 32  # the shortest step, as a share of the way to the spline


def double_vertices(points: Array, rings: Polylines) -> tuple[Carried, Polylines]:
    """Return closed polylines with a vertex more on each edge (2 N, 3), and the certificate of the way there.

    The new vertices lie in the middles of the edges, which changes nothing; then the old ones move.
    Where that cannot be certified they stop on the way.

    The search moves few vertices and cannot add any: where a knot is stretched its edges are long, and a
    tube about them has corners in its outline. The old vertices move an eighth of their second difference
    inwards: one step of the subdivision that leads to the uniform cubic B-spline (Lane and Riesenfeld, "A
    theoretical development for the computer generation and display of piecewise polynomial surfaces", IEEE
    TPAMI 2(1), 1980). Vertex 2 i belongs to the old vertex i, and 2 i + 1 is the new one after it.

    Where edges are even, each second difference over the square of the edge is an average of the polygon's
    own, so it bends nowhere more than before. A curve through all old vertices does: bends that alternate
    from vertex to vertex come out twice as strong, and no later repair sees so small a zigzag.
    """
    ahead, behind = points[rings.next], points[rings.previous]
    start, step = np.empty((2 * len(points), 3)), np.zeros((2 * len(points), 3))
    start[::2], start[1::2] = points, 0.5 * (points + ahead)
    step[::2] = (ahead + behind - 2.0 * points) / 8.0
    both = polylines_of_sizes(tuple(2 * n for n in rings.sizes))
    whole = carry(start, both, lambda at, share: start + share * step, np.inf, _SHORTEST, 1.0)
    return whole, both


# Choose the earlier frame whose knot a frame begins as, and the next tries where that does not
# serve.


_MORE = 2.0  # factor of the iterations, where a frame did not come out
POOR = 0.025  # another start is tried where the IoU is so far below what the radius allows
_ALIKE = 0.5  # a frame that differs less than this share of the neighbour's difference is the better start


class PictureDifferences:
    """Measure the share of the frame in which the pictures differ."""

    def __init__(self, masks: Sequence[NDArray[np.bool_]]) -> None:
        step = max(1, max(masks[0].shape) // 256)  # the longer side of pictures that are compared
        self._masks = np.stack([m[::step, ::step] for m in masks])
        self._whole = masks

    def start_of(self, k: int, neighbour: int, known: Iterable[int]) -> int:
        """Return the known frame to begin frame k from: its neighbour, or one much more like it.

        Where limbs part that one silhouette had hidden, the knot of a frame in which they were apart
        knows which strand goes where.
        """
        unlike = {j: float((self._masks[j] ^ self._masks[k]).mean()) for j in known}
        nearest = min(unlike, key=lambda j: (unlike[j], j))
        return nearest if unlike[nearest] < _ALIKE * unlike[neighbour] else neighbour

    def same(self, one: int, other: int) -> bool:
        """Tell whether two frames have one picture."""
        return bool(np.array_equal(self._whole[one], self._whole[other]))


@dataclass(frozen=True)
class Attempt:
    """One way to search a frame: the frame (from 0) whose knot it begins as, and with what effort.

    `closes`: it is bound to the frame that leads back around the loop. `still`: the knot stays as it was.
    """

    origin: int
    closes: bool = True
    effort: float = 1.0
    still: bool = False


def list_attempts(nearest: int, neighbour: int, closes: bool, same: bool) -> list[Attempt]:
    """Yield tries in their order: the frame most alike, the neighbour, not bound to close, more iterations.

    Last the neighbour's knot as it is, which draws the wrong picture and keeps every limit.

    Args:
        closes: whether the frame may be bound to close at all. same: the nearest has the same picture.
    """
    bound = [Attempt(nearest), Attempt(neighbour)] if closes else []
    free = [Attempt(nearest, False), Attempt(neighbour, False), Attempt(neighbour, False, _MORE)]
    held = [Attempt(neighbour, c, still=True) for c in ((True, False) if closes else (False,))]
    before = [replace(held[0], origin=nearest)] if same else []
    return list(dict.fromkeys([*before, *bound, *free, *held]))


def list_retries(origins: Iterable[int], used: int | None, closes: bool) -> list[Attempt]:
    """Yield tries with more iterations from each frame but the one that the frame had begun as."""
    found = [Attempt(j, closes, _MORE) for j in dict.fromkeys(origins) if j != used]
    return found or [Attempt(j, False, 2 * _MORE) for j in dict.fromkeys(origins)]


@dataclass(frozen=True)
class Tie:
    """A frame found before that this one must stay near, and how far the outlines go in between, mm.

    `loop`: around the end of the sequence, from its last frame to its first.
    """

    frame: int
    outline_mm: float
    loop: bool = False


@dataclass(frozen=True)
class Trial:
    """A frame's knot by one attempt; `ended` with twice the vertices, where it was good enough for that."""

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
    """All that a search of one more frame, `number`, needs: the knots known, as searched and as finished.

    `why`: the type of the first of them, and so of all, is known.
    """

    number: int
    known: Mapping[int, Knots]
    fine: Mapping[int, NDArray[np.float64]]  # (2 N, 3) mm
    problems: Sequence[Problem]
    rings: Polylines
    radius: float
    settings: SearchSettings
    taut_mm: float
    ties: tuple[Tie, ...]
    why: str
    device: str = "cpu"

    def search(
        self, attempts: Iterable[Attempt], report: Callable[[float, float | None], None]
    ) -> Trial:
        """Return the first trial that keeps every limit and draws the picture well, else the best of all."""
        wanted = opening_iou(self.problems[self.number].polygons[0], self.radius) - POOR
        best: Trial | None = None
        for attempt in attempts:
            if attempt.still and best is not None and best.quality[0]:
                continue  # the last resort for a frame that breaks a limit
            trial = self._try(attempt, report)
            if best is None or trial.quality > best.quality:
                best = trial
            if best.quality >= (True, wanted):
                break
        assert best is not None
        if best.ended is None:
            best = replace(best, ended=self._finish(best.found, best.attempt))
        return best

    def _try(self, attempt: Attempt, report: Callable[[float, float | None], None]) -> Trial:
        found = follow(
            self.known[attempt.origin],
            self.rings,
            (self.problems[attempt.origin], self.problems[self.number]),
            self.radius,
            self.settings.scaled(attempt.effort),
            self.taut_mm,
            self._anchors({j: knots.points for j, knots in self.known.items()}, attempt.closes),
            self.device,
            report,
            attempt.still,
        )
        log = found.result.log
        log.template = f"the knot of frame {attempt.origin + 1}; of the first one: {self.why}"
        return Trial(attempt, found, self._finish(found, attempt) if found.sound else None)

    def _finish(self, found: FrameResult, attempt: Attempt) -> FrameResult:
        return finish(
            found.result,
            self.rings,
            self.problems[self.number],
            self.radius,
            self.settings,
            self._anchors(self.fine, attempt.closes),
            self.device,
        )

    def _anchors(self, points: Mapping[int, NDArray[np.float64]], closes: bool) -> list[Anchor]:
        return [
            Anchor(points[tie.frame], tie.outline_mm + self.radius, self.radius)
            for tie in self.ties
            if closes or not tie.loop
        ]
