"""The tube radius by trying: the largest that still draws the pictures well."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LinearRing, MultiPolygon, Polygon

from knotfab.design.candidates import range_of, too_fine, usual_radii
from knotfab.design.question import Question
from knotfab.errors import SceneError
from knotfab.problem import Report, Start
from knotfab.render.threads import one_thread
from knotfab.scene.settings import SearchSettings
from knotfab.search.phases import plan_of
from knotfab.search.search import search
from knotfab.start.filling import Template, fill, simple_curves
from knotfab.start.start import make_start
from knotfab.target.silhouette import trace_polygon

__all__ = ["RadiusChoice", "RadiusTrial", "choose_radius", "template_iou"]

_NOTHING = 0.5  # IoU below which there is no picture
_HAIR = 1e-7  # of the radius
_WORKERS = 2  # trials side by side; their outcome does not depend on it
_SHORT = {
    "method": "flow",
    "network_start": "filling",
    "coarse_px": 160,
    "fine_px": 224,
    "coarse_iterations": 32,
    "fine_iterations": 16,
    "settle_iterations": 0,
    "edge_radii": 0.6,
    "winners_every": 4,
    "depth_candidates": 4,
}


@dataclass(frozen=True)
class RadiusTrial:
    """One radius tried: what it can draw of the pictures, and what its trial reached (NaN: not run)."""

    radius_mm: float
    template_iou: float
    trial_iou: float


@dataclass(frozen=True)
class RadiusChoice:
    """The radius taken, all that were tried, and what of its start is known already."""

    radius_mm: float
    trials: tuple[RadiusTrial, ...]
    template: Template | None = None
    start: Start | None = None


@dataclass
class _Trials:
    """What has been made of each radius so far."""

    question: Question
    settings: SearchSettings
    knots: int | None
    device: str
    templates: dict[float, Template] = field(default_factory=dict)
    starts: dict[float, Start] = field(default_factory=dict)
    failures: list[SceneError] = field(default_factory=list)

    @property
    def one_view(self) -> bool:
        return len(self.question.problem.views) == 1

    def score(self, radius: float) -> float:
        """What a tube of this radius can draw, in the view that it draws worst; -inf: nothing."""
        if not self.one_view:
            return self.question.opening(radius)
        polygon = self.question.problem.polygons[0]
        template = self.templates[radius] = fill(polygon, radius, self.knots)
        if not simple_curves(list(template.curves)):
            return -np.inf
        return template_iou(template, polygon)

    def trial(self, radius: float) -> float:
        """The IoU of a short search, or of a start that is drawn already; 0 where there is no start."""
        problem, template = self.question.problem, self.templates.get(radius)
        steps = _SHORT if self.one_view else {"network_start": "filling"}
        short = self.settings.model_copy(update=steps)
        try:
            start = make_start(problem, radius, short, self.knots, template=template)
        except SceneError as error:  # no place for the knot that is asked for, or no such curve
            self.failures.append(error)
            return 0.0
        if not self.one_view:
            if self.settings.network_start == "filling":
                self.starts[radius] = start
            return min(start.ious)
        plan = replace(plan_of(short), repairs=0)
        return search(problem, start, radius, short, plan=plan, device=self.device).iou_estimate


def choose_radius(
    question: Question,
    settings: SearchSettings,
    knots: int | None = None,
    report: Report | None = None,
    device: str = "cpu",
) -> RadiusChoice:
    """The largest tube radius whose trial comes near the best one's IoU.

    Args:
        knots: as for `fill`.
        report: called with (share done, best IoU).

    Raises:
        SceneError: no printable radius draws anything of the pictures.
    """
    views = question.views
    trials = _Trials(question, settings, knots, device)
    span = range_of(len(views))
    thinnest = question.scene.printer.min_tube_radius_mm
    radii, thin = usual_radii(views, thinnest, settings.radius_candidates)
    usual = radii[0]
    with ThreadPoolExecutor(_WORKERS) as pool:
        scores = dict(zip(radii, pool.map(trials.score, radii), strict=True))
        if max(scores.values()) < span.drawn:  # the picture forbids the usual thickness
            scores |= dict(zip(thin, pool.map(trials.score, thin), strict=True))
    scores = {r: s for r, s in scores.items() if np.isfinite(s)}
    if not scores:
        raise SceneError(
            "the picture",
            "no tube radius gives a template whose curves keep clear of each other",
            "Give a radius (--tube-radius), or use a simpler picture.",
        )
    if report is not None:
        report(0.2, None)
    # thicker tubes gain more in the search than their templates show
    promise = {r: s + 0.01 * np.log(r / usual) * trials.one_view for r, s in scores.items()}
    few = sorted(promise, key=lambda r: promise[r], reverse=True)[: span.trials]
    few = [r for r in few if promise[r] > promise[few[0]] - span.hopeless]
    found: dict[float, float] = {}

    def attempt(radius: float) -> None:
        found[radius] = trials.trial(radius)
        if report is not None:
            report(0.2 + 0.8 * len(found) / len(few), max(found.values()))

    with one_thread(), ThreadPoolExecutor(_WORKERS) as pool:
        list(pool.map(attempt, few))
    top = max(found.values())
    if top == 0 and trials.failures:
        raise trials.failures[0]
    if top < _NOTHING and trials.one_view:
        view = question.problem.views[0]
        height, width = view.mask.shape
        raise too_fine(
            trace_polygon(view.mask),
            view.view,
            (width, height),
            question.scene.printer,
            f"it is too fine for any printable tube: at a radius of {min(scores):.2f} mm the shadow "
            f"reaches an IoU of {top:.2f}",
        )
    chosen = max(r for r, iou in found.items() if iou >= top - span.give)
    return RadiusChoice(
        chosen,
        tuple(RadiusTrial(r, scores[r], found.get(r, float("nan"))) for r in sorted(scores)),
        trials.templates.get(chosen),
        trials.starts.get(chosen),
    )


def template_iou(template: Template, polygon: MultiPolygon) -> float:
    """IoU of the planar tube with the silhouette, exact on polygons."""
    tube = shapely.union_all([_band(c, template.radius) for c in template.curves])
    return float(tube.intersection(polygon).area / tube.union(polygon).area)


def _band(curve: NDArray[np.float64], radius: float) -> Polygon | MultiPolygon:
    """What a closed planar curve covers, drawn with a pen of this radius.

    Where strands of a picture with straight sides just touch, GEOS gives an invalid polygon of a wrong
    area, which no union takes, on a grid or off it: a pen that is a hair slimmer leaves gaps instead.
    """
    line = LinearRing(curve)
    band = line.buffer(radius)
    return band if band.is_valid else line.buffer(radius * (1 - _HAIR)).buffer(0)
