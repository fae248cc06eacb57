"""The design for several views: from a scene and its pictures to knots that draw all of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from shapely import MultiPolygon

from knotfab.design.budget import within
from knotfab.design.contradictions import contradictions
from knotfab.design.design import Design, opening_iou, silhouette_polygon
from knotfab.design.fineness import VERIFIED_PX, fine_enough
from knotfab.design.frames import framed_alike
from knotfab.design.hull import HullBound, hull_bounds
from knotfab.design.prices import Price, prices_several
from knotfab.errors import InputError, SceneError
from knotfab.mount.mount import require_mount
from knotfab.progress import Progress
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Region, Scene, View
from knotfab.scene.settings import SearchSettings, search_settings
from knotfab.search.search import Infeasible
from knotfab.search.several import SeveralProblem, SeveralResult, Shot, search_several
from knotfab.start.several import Start, start_of
from knotfab.target.read import Target

__all__ = ["SeveralDesign", "design_several", "require_several"]

Array = NDArray[np.float64]

_THINNEST = 0.0125  # tube radius over the longest frame side, where the pictures ask for no less
_THICKEST = 0.022
_OF_MANY = 0.01056  # with three views or more, and no thicker: more is asked of every strand
_RADII = 4
_OPEN_GIVE = 0.006  # opening IoU that a thicker tube may cost
_START_GIVE = 0.012  # the start's IoU that a thicker tube may cost


@dataclass(frozen=True)
class SeveralDesign(Design):
    """A design with the bound of each view, what the hull says of it, and the start's IoU."""

    bounds: tuple[HullBound, ...] = ()
    start_ious: tuple[float, ...] = ()


def require_several(scene: Scene) -> None:
    """Refuse what makes no sense for several views, or is not there for them.

    Raises:
        InputError: naming the key and what to do.
    """
    if scene.piece.depth != "auto":
        raise InputError(
            "scene key piece.depth",
            "with several views the pictures decide the depth",
            'Leave it out, or write "auto"',
        )
    if scene.piece.knot != "unknot":
        raise InputError(
            "scene key piece.knot",
            "no knot can be tied in where several views look on",
            "Leave it out, or give one picture",
        )
    if scene.search.get("method", "flow") != "flow":
        raise InputError(
            "scene key [search] method", "several views take the flow alone", 'Use "flow"'
        )
    if scene.search.get("free_view", False):
        raise InputError(
            "a free view (--free view)",
            "it is for one picture, and this piece has several views",
            "Leave it out",
        )
    if scene.region.kind == "mesh":
        raise InputError(
            "scene key region.kind",
            "several views need a plain region",
            "Use box, cylinder or sphere",
        )
    require_mount(scene)


def _region(region: Region, bounds: Sequence[HullBound], radius: float) -> Region:
    """The region with its size settled: the hull's extents about its middle, with some play."""
    if region.size_mm != "auto":
        return region
    low = np.min([b.low for b in bounds], 0)
    high = np.max([b.high for b in bounds], 0)
    half = np.maximum(np.abs(low), np.abs(high)) + radius
    size = tuple(round(float(2 * h), 4) for h in half)
    if region.kind == "box":
        x, y, z = size
        return region.model_copy(update={"size_mm": (x, y, z)})
    around = round(float(2 * np.hypot(half[0], half[2])), 4)
    if region.kind == "sphere":
        around = round(float(2 * np.linalg.norm(half)), 4)
    return region.model_copy(update={"size_mm": (around, size[1], around)})


def _reach(views: Sequence[View]) -> float:
    """How far from the middle matter may stand: clear of every wall and light, mm."""
    return min(
        min(0.97 * v.wall_distance_mm if v.kind == "shadow" else np.inf, 0.5 * v.light_distance_mm)
        for v in views
    )


def _opening(polygons: Sequence[MultiPolygon], radius: float) -> float:
    return min(opening_iou(p, radius) for p in polygons)


def _radius_and_start(
    scene: Scene,
    problem: SeveralProblem,
    polygons: Sequence[MultiPolygon],
    drawable: Sequence[MultiPolygon],
    settings: SearchSettings,
    progress: Progress,
) -> tuple[float, Start]:
    """The thickest tube that neither the pictures' detail nor the start forbids, and its start."""
    given = scene.piece.tube_radius_mm
    thinnest = scene.printer.min_tube_radius_mm
    if given != "auto":
        if given < thinnest:
            raise SceneError(
                "scene key piece.tube_radius_mm",
                f"{given:g} mm is thinner than {scene.printer.name} prints",
                f"Use at least {thinnest:g} mm, or another printer",
            )
        return given, start_of(problem.shots, polygons, given, settings, drawable)
    if settings.network_start == "circle":
        raise InputError(
            "scene key piece.tube_radius_mm",
            "a start at a circle says nothing of how thick the tube may be",
            "Give the radius in mm",
        )
    side = max(
        max(s.view.frame_width_mm or 0.0, s.view.frame_height_mm or 0.0) for s in problem.shots
    )
    many = len(problem.shots) > 2
    usual = max(thinnest, (_OF_MANY if many else _THINNEST) * side)
    count = 1 if many else _RADII
    radii = np.geomspace(usual, max(_THICKEST * side, 1.2 * usual), count).round(4).tolist()
    opened = {r: _opening(polygons, r) for r in radii}
    if opened[radii[0]] < 0.95 and thinnest < usual:
        radii = [*np.geomspace(thinnest, usual, 4)[:-1].round(4).tolist(), *radii]
        opened = {r: _opening(polygons, r) for r in radii}
    allowed = [r for r in radii if opened[r] >= opened[radii[0]] - _OPEN_GIVE]
    starts: dict[float, Start] = {}
    why: SceneError | None = None
    for done, r in enumerate(allowed, start=1):
        try:
            starts[r] = start_of(problem.shots, polygons, r, settings, drawable)
        except SceneError as error:
            why = error
        progress.update(done / len(allowed), None)
    if not starts:
        assert why is not None
        raise why
    best = max(min(s.ious) for s in starts.values())
    radius = max(r for r, s in starts.items() if min(s.ious) >= best - _START_GIVE)
    return radius, starts[radius]


def _allowed_mm(views: Sequence[View], limit_px: float) -> float:
    """How far the outline's limit is on the piece, in the view where that is least (see design.py)."""
    pixels = [max(v.frame_width_mm or 0.0, v.frame_height_mm or 0.0) / VERIFIED_PX for v in views]
    each = zip(pixels, views, strict=True)
    return min(0.8 * limit_px * pixel / v.magnification for pixel, v in each)


def _level_polygon(view: View, target: Target) -> MultiPolygon:
    """The silhouette in the plane through the middle of the piece, along the view's own axes, mm."""
    own = view.model_copy(update={"azimuth_deg": 0.0, "elevation_deg": 0.0})
    return silhouette_polygon(own, target)


def _own_polygon(view: View, target: Target) -> MultiPolygon:
    """The same, and an error where there is nothing left of it."""
    polygon = _level_polygon(view, target)
    if polygon.is_empty:
        raise InputError(
            f"picture {target.name}", "its silhouette vanishes when traced", "Use a bolder picture"
        )
    return polygon


def _left_by_others(view: View, target: Target, bound: HullBound) -> MultiPolygon:
    """What of the silhouette lies in the hull's shadow, as `_level_polygon` gives it."""
    cell = max(1.0, max(target.mask.shape) / max(bound.covered.shape))
    wide = binary_dilation(bound.covered, np.ones((3, 3)))  # an edge where nothing is missing stays
    rows, columns = (
        np.minimum(((np.arange(n) + 0.5) / cell).astype(int), m - 1)
        for n, m in zip(target.mask.shape, wide.shape, strict=True)
    )
    left = target.mask & wide[np.ix_(rows, columns)]
    return _level_polygon(view, replace(target, mask=left)) if left.any() else MultiPolygon()


def design_several(
    scene: Scene,
    targets: Sequence[Target],
    device: str = "cpu",
    progress: Progress | None = None,
    budget_s: float | None = None,
) -> SeveralDesign:
    """From a scene with several views and their pictures, in their order, to feasible knots.

    Raises:
        SceneError: the scene cannot be met; InputError: the scene or a picture is wrong.
    """
    begun = time.perf_counter()
    progress = progress or Progress("quiet")
    scene = framed_alike(scene, targets)
    scene = resolve(scene, [(t.width, t.height) for t in targets])
    views = tuple(
        v.model_copy(update={"picture": f"picture-{v.name}{t.suffix}"})
        for v, t in zip(scene.views, targets, strict=True)
    )
    settings = search_settings(scene.accuracy.name, scene.search)
    if "coarse_iterations" not in scene.search:  # a build's own scene has them resolved already
        # each view adds wishes that pull against the others'
        settings = settings.scaled(len(views))
    masks = [t.mask for t in targets]
    with progress.stage("hull"):
        cameras = [camera_of(v, t.width, t.height) for v, t in zip(views, targets, strict=True)]
        bounds = hull_bounds(cameras, masks, _reach(views))
        for line in contradictions(views, bounds):
            progress.say(line)
        polygons = [_own_polygon(v, t) for v, t in zip(views, targets, strict=True)]
        drawable = [
            _left_by_others(v, t, b) for v, t, b in zip(views, targets, bounds, strict=True)
        ]
    shots = tuple(Shot(v, m) for v, m in zip(views, masks, strict=True))
    bend = scene.material.min_bend_radius_mm
    region = _region(scene.region, bounds, scene.printer.min_tube_radius_mm)
    problem = SeveralProblem(
        shots,
        scene.piece.clearance_mm,
        None if bend == "auto" else float(bend),
        scene.material.max_length_mm,
        region,
        # a third picture leaves the others little room; two are drawn best as equals
        tuple(b.iou for b in bounds) if len(views) > 2 else None,
    )
    with progress.stage("template"):
        radius, start = _radius_and_start(scene, problem, polygons, drawable, settings, progress)
    limits = problem.limits(radius)
    allowed = _allowed_mm(views, scene.accuracy.max_outline_error_px)
    settings = fine_enough(settings, radius, limits.bend_radius, allowed)
    if budget_s is not None:
        with progress.stage("calibrate"):
            settings = within(
                budget_s - (time.perf_counter() - begun),
                settings,
                lambda few: search_several(
                    problem, start.curves, start.why, radius, few, device, repairs=0
                ),
            )
    with progress.stage("search"):
        try:
            result = search_several(
                problem, start.curves, start.why, radius, settings, device, progress.update
            )
        except Infeasible as error:
            assert isinstance(error.result, SeveralResult)
            result = error.result
    opened = _opening(polygons, radius)
    floor = scene.accuracy.iou_floor
    if floor == "auto":
        floor = settings.floor(min(opened, *(b.iou for b in bounds)))
    binding: tuple[Price, ...] = ()
    if result.standing.violations or result.iou_estimate < float(floor):
        with progress.stage("limits"):
            roomy = _region(Region(), bounds, radius)
            binding = prices_several(
                problem, start.curves, start.why, result, settings, roomy, device
            )
    resolved = scene.model_copy(
        update={
            "views": views,
            "piece": scene.piece.model_copy(
                update={"tube_radius_mm": radius, "knots": len(result.knots.knots)}
            ),
            "region": region,
            "material": scene.material.model_copy(
                update={"min_bend_radius_mm": limits.bend_radius}
            ),
            "accuracy": scene.accuracy.model_copy(update={"iou_floor": floor}),
            "search": settings.model_dump(),
        }
    )
    return SeveralDesign(
        resolved,
        result.knots,
        result,
        None,
        opened,
        settings,
        binding=binding,
        bounds=bounds,
        start_ious=start.ious,
    )
