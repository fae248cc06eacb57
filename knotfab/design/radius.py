"""The tube radius by trying: the largest that still draws the picture well."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LinearRing, MultiPolygon, Polygon

from knotfab.errors import SceneError
from knotfab.render.threads import one_thread
from knotfab.scene.settings import SearchSettings
from knotfab.search.search import Problem, search
from knotfab.start.filling import Template, fill, simple_curves

__all__ = ["RadiusChoice", "RadiusTrial", "choose_radius", "template_iou"]

_USUAL = 0.0102  # of the frame's width: thinner only where the picture forbids this
_THICKEST = 0.035
_GIVE = 0.004  # IoU that a thicker tube may cost
_DRAWN = 0.94  # template IoU below which thinner tubes are tried as well
_HOPELESS = 0.06  # template IoU behind the best that no search makes up for
_NOTHING = 0.5  # IoU below which there is no picture
_TRIALS = 5
_HAIR = 1e-7  # of the radius
_WORKERS = 2  # trials side by side; their outcome does not depend on it
_SHORT = {
    "method": "flow",
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


def choose_radius(
    problem: Problem,
    frame_width: float,
    thinnest: float,
    knots: int | None,
    settings: SearchSettings,
    report: Callable[[float, float | None], None] | None = None,
    device: str = "cpu",
) -> RadiusChoice:
    """The largest tube radius whose short search comes within 0.004 of the best one's IoU.

    Args:
        problem: the picture and the limits; its polygon lies in the template's plane.
        frame_width: width of the picture's frame on the receiver, mm; the usual range is 1 to 3.5 % of it.
        thinnest: least radius that can be printed, mm.

    Raises:
        SceneError: when no printable radius draws anything of the picture.
    """
    usual = max(thinnest, _USUAL * frame_width)
    thick = max(_THICKEST * frame_width, 1.5 * usual)
    radii = np.geomspace(usual, thick, settings.radius_candidates).round(4).tolist()
    with ThreadPoolExecutor(_WORKERS) as pool:
        templates = dict(
            zip(radii, pool.map(lambda r: fill(problem.polygon, r, knots), radii), strict=True)
        )
    scores = {r: template_iou(t, problem.polygon) for r, t in templates.items()}
    if max(scores.values()) < _DRAWN and thinnest < usual:
        # the picture forbids the usual thickness: thinner ones, as far as the printer goes
        for r in np.geomspace(thinnest, usual, 5)[:-1].round(4).tolist():
            templates[r] = fill(problem.polygon, r, knots)
            scores[r] = template_iou(templates[r], problem.polygon)
    scores = {r: s for r, s in scores.items() if simple_curves(list(templates[r].curves))}
    if not scores:
        raise SceneError(
            "the picture",
            "no tube radius gives a template whose curves keep clear of each other",
            "Give a radius (--tube-radius), or use a simpler picture.",
        )
    if report is not None:
        report(0.2, None)
    # thicker tubes gain more in the search than their templates show
    promise = {r: s + 0.01 * np.log(r / usual) for r, s in scores.items()}
    few = sorted(promise, key=lambda r: promise[r], reverse=True)[:_TRIALS]
    few = [r for r in few if promise[r] > promise[few[0]] - _HOPELESS]
    short = settings.model_copy(update=_SHORT)
    found: dict[float, float] = {}
    untied: list[SceneError] = []

    def trial(r: float) -> float:
        try:
            found[r] = search(problem, templates[r], r, short, device, repairs=0).iou_estimate
        except SceneError as error:  # no place for the knot that is asked for
            untied.append(error)
            found[r] = 0.0
        if report is not None:
            report(0.2 + 0.8 * len(found) / len(few), max(found.values()))
        return found[r]

    with one_thread(), ThreadPoolExecutor(_WORKERS) as pool:
        list(pool.map(trial, few))
    top = max(found.values())
    if top == 0 and untied:
        raise untied[0]
    if top < _NOTHING:
        raise SceneError(
            "the picture",
            f"it is too fine for any printable tube: at a radius of {min(templates):.2f} mm the shadow "
            f"reaches an IoU of {top:.2f}",
            "Use a bolder picture, a larger frame (scene key frame_width_mm), or a printer with a "
            "finer nozzle.",
        )
    chosen = max(r for r, iou in found.items() if iou >= top - _GIVE)
    trials = tuple(RadiusTrial(r, scores[r], found.get(r, float("nan"))) for r in sorted(scores))
    return RadiusChoice(chosen, templates[chosen], trials)
