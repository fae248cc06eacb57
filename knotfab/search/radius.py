"""The tube radius by trying: the largest that still draws the picture well (design, section 4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LinearRing, MultiPolygon

from knotfab.errors import SceneError
from knotfab.search.search import Problem, search
from knotfab.search.settings import SearchSettings
from knotfab.template.filling import Template, fill

__all__ = ["RadiusChoice", "RadiusTrial", "choose_radius", "template_iou"]

_USUAL = 0.0102  # of the frame's width: thinner only where the picture forbids this
_THICKEST = 0.035
_GIVE = 0.003  # IoU that a thicker tube may cost
_WELL = 0.955  # trial IoU below which thinner tubes are tried as well
_TRIALS = 5


@dataclass(frozen=True)
class RadiusTrial:
    """One radius tried: the planar template's IoU, and that of a short search (NaN: not run)."""

    radius_mm: float
    template_iou: float
    trial_iou: float


@dataclass(frozen=True)
class RadiusChoice:
    """The radius taken, its template, and all that were tried."""

    radius_mm: float
    template: Template
    trials: tuple[RadiusTrial, ...]


def template_iou(template: Template, polygon: MultiPolygon) -> float:
    """IoU of the planar tube with the silhouette, exact on polygons."""
    tube = shapely.union_all([LinearRing(c).buffer(template.radius) for c in template.curves])
    return float(tube.intersection(polygon).area / tube.union(polygon).area)


def choose_radius(
    problem: Problem,
    frame_width: float,
    thinnest: float,
    knots: int | None,
    settings: SearchSettings,
    report: Callable[[float, float | None], None] | None = None,
) -> RadiusChoice:
    """The largest tube radius whose short search comes within 0.003 of the best one's IoU.

    Args:
        problem: the picture and the limits; its polygon lies in the template's plane.
        frame_width: width of the picture's frame on the receiver, mm; the usual range is 1 to 3.5 % of it.
        thinnest: least radius that can be printed, mm.

    Raises:
        SceneError: when no printable radius draws anything of the picture.
    """
    usual = max(thinnest, _USUAL * frame_width)
    thick = max(_THICKEST * frame_width, 1.5 * usual)
    radii = np.geomspace(usual, thick, settings.radius_candidates).round(4)
    trials, best = _try(problem, radii, knots, settings, report)
    if max(t.trial_iou for t in trials if t.trial_iou == t.trial_iou) < _WELL and thinnest < usual:
        # the picture forbids the usual thickness: thinner ones, as far as the printer goes
        thin = np.geomspace(thinnest, usual, 6)[:-1].round(4)
        more, other = _try(problem, thin, knots, settings, report)
        trials, best = [*trials, *more], {**best, **other}
    tried = [t for t in trials if t.trial_iou == t.trial_iou]
    top = max(t.trial_iou for t in tried)
    if top < 0.5:
        raise SceneError(
            "the picture",
            f"it is too fine for any printable tube: at a radius of {thinnest:.2f} mm the shadow reaches "
            f"an IoU of {top:.2f}",
            "Use a bolder picture, a larger frame (scene key frame_width_mm), or a printer with a "
            "finer nozzle",
        )
    chosen = max((t for t in tried if t.trial_iou >= top - _GIVE), key=lambda t: t.radius_mm)
    return RadiusChoice(chosen.radius_mm, best[chosen.radius_mm], tuple(trials))


def _try(
    problem: Problem,
    radii: NDArray[np.float64],
    knots: int | None,
    settings: SearchSettings,
    report: Callable[[float, float | None], None] | None,
) -> tuple[list[RadiusTrial], dict[float, Template]]:
    """Template scores for all radii, short searches for the most promising."""
    templates: dict[float, Template] = {}
    scores: dict[float, float] = {}
    for n, radius in enumerate(radii.tolist()):
        templates[radius] = fill(problem.polygon, radius, knots)
        scores[radius] = template_iou(templates[radius], problem.polygon)
        if report is not None:
            report(0.3 * (n + 1) / len(radii), None)
    # thicker tubes gain more in the search than their templates show
    promise = {r: s + 0.01 * np.log(r / radii[0]) for r, s in scores.items()}
    few = sorted(promise, key=lambda r: promise[r], reverse=True)[:_TRIALS]
    short = settings.model_copy(
        update={
            "coarse_px": 160,
            "fine_px": 256,
            "coarse_iterations": 40,
            "fine_iterations": 20,
            "settle_iterations": 0,
            "depth_candidates": 4,
        }
    )
    found: dict[float, float] = {}
    for n, radius in enumerate(few):
        found[radius] = search(problem, templates[radius], radius, short, repairs=0).iou_estimate
        if report is not None:
            report(0.3 + 0.7 * (n + 1) / len(few), max(found.values()))
    trials = [RadiusTrial(r, scores[r], found.get(r, float("nan"))) for r in radii.tolist()]
    return trials, templates
