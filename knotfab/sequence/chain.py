"""The chain of a sequence: the first frame from a template, every other one from the frame before."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from shapely import MultiPolygon

from knotfab.design.design import Design, design_knots, price_design, settle_design
from knotfab.design.free_view import place_start
from knotfab.design.question import Question, ask, silhouette_polygon
from knotfab.design.radius import RadiusChoice, choose_radius
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.progress import Progress
from knotfab.scene.model import ResolvedScene, Scene
from knotfab.scene.settings import SearchSettings, search_settings
from knotfab.sequence.motion import Anchor, Motion, measure, outline_motion
from knotfab.sequence.require import require_sequence
from knotfab.sequence.search import finish
from knotfab.sequence.starts import Following, Likeness
from knotfab.target.opening import opening_iou
from knotfab.target.read import Target

__all__ = ["Frame", "chain", "radius_for_all"]

_SLACK = 1.1  # length of a frame's knot over the first one's, for a picture of the same area
_GIVE = (
    0.01  # IoU that a frame's opening may lose against the first one's before the tube is thinner
)
_THINNER = 0.93
_OF_FIRST = 0.8  # time of a later frame's search and finish over the first one's search


@dataclass(frozen=True)
class Frame:
    """One frame: its design in scene coordinates, and how it moved there from the frame before.

    `motion` is None for the first. `transported`: share of the displacement between the pictures that
    could be certified; the flow did the rest. `origin`: the frame (from 0) whose knot it began as.
    """

    made: Design
    motion: Motion | None
    transported: float
    origin: int = 0


def radius_for_all(
    question: Question, polygons: Sequence[MultiPolygon], settings: SearchSettings
) -> tuple[float, RadiusChoice | None]:
    """A tube radius (mm) that draws the first frame well, and no other much worse.

    Args:
        question: of the first frame. polygons: the silhouettes of the others.
    """
    given = question.scene.piece.tube_radius_mm
    if not isinstance(given, str):
        return given, None
    choice = choose_radius(question, settings, 1)
    radius, thinnest = choice.radius_mm, question.scene.printer.min_tube_radius_mm
    wanted = question.opening(radius) - _GIVE
    while radius * _THINNER >= thinnest and any(
        opening_iou(polygon, radius) < wanted for polygon in polygons
    ):
        radius *= _THINNER
    return round(radius, 4), choice


def chain(
    scene: Scene,
    targets: Sequence[Target],
    device: str = "cpu",
    progress: Progress | None = None,
    budget_s: float | None = None,
) -> Iterator[Frame]:
    """The frames one after the other, each final as it comes.

    All are one knot with the same vertices: the radius, their number and their order are those of the
    first frame. A vertex keeps within the motion bound of the frame before; and, so that the sequence
    may close, within what the outlines' motion back to the first frame allows.

    Args:
        scene: of one view, as for `design_knots`. A free view is found with the first frame: lamp and wall
            stand where they are while the frames change.
        budget_s: seconds that all searches may take; the iterations are set to fit, on the first frame.

    Raises:
        SceneError, InputError: as `design_knots`.
    """
    begun = time.perf_counter()
    require_sequence(scene)
    progress = progress or Progress("quiet")
    settings = search_settings(scene.accuracy.name, scene.search)
    if settings.free_view:
        scene, settings = place_start(scene, settings)
    with progress.stage("radius"):
        question = ask(scene, targets[:1])
        others = [silhouette_polygon(question.views[0], target) for target in targets[1:]]
        radius, choice = radius_for_all(question, others, settings)
    piece = scene.piece.model_copy(update={"knots": 1, "tube_radius_mm": radius})
    view = scene.views[0].model_copy(update={"name": targets[0].name})
    asked = scene.model_copy(update={"piece": piece, "views": (view,)})
    share = None
    if budget_s is not None:
        share = (budget_s - (time.perf_counter() - begun)) / (1.0 + _OF_FIRST * (len(targets) - 1))
    first = design_knots(asked, targets[:1], device, progress, share)
    # the region as it was asked for: a mesh lies where the scene says, not yet beside the result; and what is
    # required of the IoU, unless it was given, follows from the frame's own picture
    update = {"region": question.problem.region, "accuracy": scene.accuracy}
    within = first.scene.model_copy(update=update)
    with progress.stage("search"):
        questions = [ask(_rename_view(within, t), [t]) for t in targets]
        problems = [question.problem for question in questions]
        polygons = [problem.polygons[0] for problem in problems]
        outlines = [
            outline_motion(p, q)
            for p, q in zip(polygons, [*polygons[1:], polygons[0]], strict=True)
        ]
    start = first.knots.points
    rings = polylines_of_sizes((len(start),))
    with progress.stage("search"):
        ended = finish(first.result, rings, problems[0], radius, first.settings, [], device)
    made = settle_design(questions[0], ended.result, first.settings)
    yield Frame(replace(made, radius=choice, unmet=first.unmet, binding=first.binding), None, 1.0)
    length, area = first.knots.knots[0].length_mm, polygons[0].area
    known, fine, fine_start = [first.knots], ended.points, ended.points
    alike, closing = Likeness([t.mask for t in targets]), True
    for k in range(1, len(targets)):
        following = Following(
            tuple(known),
            tuple(problems[: k + 1]),
            rings,
            radius,
            first.settings,
            _SLACK * length * max(1.0, polygons[k].area / area),
            Anchor(start, sum(outlines[k:]) + radius, radius) if closing else None,
            outlines[k - 1],
            device,
        )
        with progress.stage("search"):
            trial = following.search(
                alike.before(k),
                lambda part, _, base=k: progress.update((base + part) / len(targets)),  # type: ignore[misc]
            )
            found, closing = trial.found, trial.back is not None
            held = [Anchor(fine, outlines[k - 1] + radius, radius)]
            if trial.back is not None:
                held.append(Anchor(fine_start, trial.back.limit_mm, radius))
            ended = finish(found.result, rings, problems[k], radius, first.settings, held, device)
        motion = measure(fine, ended.points, outlines[k - 1], radius)
        made = settle_design(questions[k], ended.result, first.settings)
        made = price_design(made, questions[k], None, None, progress, device)
        yield Frame(made, motion, found.transported, trial.origin)
        known.append(found.result.knots)
        fine = ended.points


def _rename_view(scene: ResolvedScene, target: Target) -> Scene:
    """A resolved scene whose view is that of another frame."""
    view = scene.views[0].model_copy(
        update={"name": target.name, "picture": f"picture-{target.name}{target.suffix}"}
    )
    return scene.model_copy(update={"views": (view,)})
