"""Design the frames of a sequence: the first from a template, each other one from a neighbour's knots."""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.budget import Budget
from knotfab.design.design import Design, plan_searches, price_design, settle_design
from knotfab.design.film_motion import outline_motion
from knotfab.design.film_search import (
    Attempt,
    Following,
    PictureDifferences,
    Tie,
    finish_frame,
    list_attempts,
    list_retries,
)
from knotfab.design.kept import KeptFrames
from knotfab.design.question import Question, ask, silhouette_polygon
from knotfab.design.radius import RadiusChoice, choose_radius
from knotfab.design.settings import place_start
from knotfab.knots import Knots
from knotfab.picture.frames import count_knots
from knotfab.picture.opening import opening_iou
from knotfab.picture.read import Target
from knotfab.plan import Attempts
from knotfab.scene.require import require_sequence
from knotfab_formats.scene import ResolvedScene, SettledScene
from knotfab_formats.search import PRESETS, SearchSettings

_SLACK = 1.1  # length that a frame's knots may have over the first ones, for pictures of equal area
_THINNER = 0.93  # ratio of the next radius to the last


@dataclass(frozen=True)
class SequenceFrame:
    """One frame's design in scene coordinates, and how it was found. Frames are numbered from 0.

    `searched`: the knots before their vertices were doubled. `transported`: the share of the displacement
    between the pictures that was certified; the flow did the rest. `origin`: the frame whose knots the search
    began from. `closes`: whether the knots were held near the frame across the loop's seam.
    """

    number: int
    made: Design
    searched: Knots
    transported: float = 1.0
    origin: int | None = None
    closes: bool = True


@dataclass(frozen=True)
class _Common:
    """The scene (except for the view's name), settings and radius that all frames take from the first."""

    scene: SettledScene
    settings: SearchSettings
    radius_mm: float


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


class Chain:
    """Search the frames of a sequence, so that all have the same knots, vertices and tube radius.

    The frame with the most ink comes first (`pick_first`); the others follow, neighbour by neighbour, to the
    end and then back to the beginning. Each vertex keeps within the motion bound of its neighbours, and in a
    loop also within that across the seam.

    Args:
        scene: of one view, as for `design_knots`. A free view is settled on the first frame, since
            lamp and wall stay in place.
        budget: limits the iterations, as measured on the first frame.
        kept: frames from an interrupted build of the same sequence.

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
        kept: KeptFrames | None = None,
    ) -> None:
        require_sequence(scene)
        self._scene, self._targets, self._device = scene, targets, device
        self._attempts = attempts or Attempts(Progress("quiet"))
        self._progress = self._attempts.progress
        self._budget = budget
        self._closing, self._kept = scene.sequence.loop, kept
        self.resumed = 0  # number of frames taken from an interrupted build
        self._count = count_knots(targets, scene.piece.knots)
        self._first = pick_first(targets)
        self._alike = PictureDifferences([t.mask for t in targets])
        self._known: dict[int, Knots] = {}
        self._fine: dict[int, Array] = {}
        self._origins: dict[int, int | None] = {}

    def frames(self) -> Iterator[SequenceFrame]:
        """Yield the frames as they are found, first the one with the most ink; none changes afterwards."""
        common, frame = self._recall(self._first) or self._begin()
        self._settle(common)
        self._why = frame.made.result.log.template
        yield self._add(common, frame)
        count = len(self._targets)
        for number in (*range(self._first + 1, count), *range(self._first - 1, -1, -1)):
            recalled = self._recall(number)
            yield self._add(common, recalled[1] if recalled else self._follow(number))

    def retry(self, number: int) -> SequenceFrame:
        """Search a failed frame again from another start, near its neighbours.

        It replaces the failed one once `accept` gets it.
        """
        neighbours = [j for j in (number - 1, number + 1) if j in self._known]
        others = [j for j in self._known if j != number]
        nearest = self._alike.start_of(number, neighbours[0], others)
        attempts = list_retries([nearest, *neighbours], self._origins[number], self._closing)
        return self._search(number, attempts)

    def accept(self, frame: SequenceFrame) -> None:
        """Enter a frame in the chain: frames searched from now on stay near it."""
        self._known[frame.number] = frame.searched
        self._fine[frame.number] = frame.made.knots.points
        self._origins[frame.number] = frame.origin
        self._closing = self._closing and frame.closes

    def _add(self, common: _Common, frame: SequenceFrame) -> SequenceFrame:
        self.accept(frame)
        if self._kept is not None:
            self._kept.store(frame.number, (common, frame))
        return frame

    def _recall(self, number: int) -> tuple[_Common, SequenceFrame] | None:
        """Return a frame that an interrupted build had finished, None if there is none."""
        found: tuple[_Common, SequenceFrame] | None = None
        if self._kept is not None:
            found = self._kept.load(number)
        self.resumed += found is not None
        return found

    def _begin(self) -> tuple[_Common, SequenceFrame]:
        """Search the first frame from a template; return it with what all frames share."""
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
        view = scene.views[0].but(name=target.name)
        asked = scene.but(piece=piece, views=(view,))
        share = None
        if self._budget is not None:
            left = self._budget.search_s(0)
            # a later frame takes 0.8 of the first one's time
            frame_s = left / (1.0 + 0.8 * (len(targets) - 1))
            share = Budget(time.perf_counter() + frame_s)
        first = self._attempts.carry_out(
            plan_searches(asked, [target], self._device, progress, share)
        )
        # keep the region's file as the scene names it, and let each frame's picture set its required IoU
        update = {"region": question.problem.region, "accuracy": scene.accuracy}
        within = first.scene.but(**update)
        question = ask(_rename_view(within, target), [target])
        rings = first.knots.rings
        with progress.stage("search"):
            ended = self._attempts.carry_out(
                finish_frame(first.result, rings, question.problem, radius, first.settings, [])
            )
        made = settle_design(question, ended.result, first.settings)
        made = replace(made, radius=choice, unmet=first.unmet, binding=first.binding)
        return _Common(within, first.settings, radius), SequenceFrame(
            self._first, made, first.knots
        )

    def _settle(self, common: _Common) -> None:
        """Pose each frame's question, and measure the outlines' motion between frames."""
        self._common = common
        with self._progress.stage("search"):
            self._questions = [ask(_rename_view(common.scene, t), [t]) for t in self._targets]
            self._problems = [question.problem for question in self._questions]
            polygons = [problem.polygons[0] for problem in self._problems]
            self._outlines = [
                outline_motion(p, q, self._count)
                for p, q in zip(polygons, [*polygons[1:], polygons[0]], strict=True)
            ]

    def _follow(self, number: int) -> SequenceFrame:
        """Search a frame from its neighbour, or from a known frame more like it."""
        neighbour = number - 1 if number > self._first else number + 1
        nearest = self._alike.start_of(number, neighbour, self._known)
        same = self._alike.same(nearest, number)
        return self._search(number, list_attempts(nearest, neighbour, self._closing, same))

    def _search(self, number: int, attempts: Sequence[Attempt]) -> SequenceFrame:
        """Search a frame by several attempts, and settle the best."""
        first, count, common = self._first, len(self._targets), self._common
        areas = [problem.polygons[0].area for problem in self._problems]
        longest = _SLACK * sum(knot.length_mm for knot in self._known[first].knots)
        following = Following(
            number,
            self._known,
            self._fine,
            self._problems,
            self._known[first].rings,
            common.radius_mm,
            common.settings,
            longest * max(1.0, areas[number] / areas[first]),
            list_ties(number, self._known, self._outlines),
            self._why,
        )
        done = len(self._known)
        with self._progress.stage("search"):
            trial = self._attempts.carry_out(
                following.search(
                    attempts, lambda part, _: self._progress.update((done + part) / count)
                )
            )
        assert trial.ended is not None
        question = self._questions[number]
        made = settle_design(question, trial.ended.result, common.settings)
        made = self._attempts.carry_out(price_design(made, question, None, None, self._progress))
        return SequenceFrame(
            number,
            made,
            trial.found.result.knots,
            trial.found.transported,
            trial.attempt.origin,
            trial.attempt.closes,
        )


def _rename_view(scene: SettledScene, target: Target) -> ResolvedScene:
    """Return the scene with its view named after another frame's picture."""
    view = scene.views[0].but(
        name=target.name, title=target.name, picture=f"picture-{target.name}{target.suffix}"
    )
    return scene.but(views=(view,))
