"""The design as plain functions: from a scene and its picture to feasible knots."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from knotfab.design.budget import within
from knotfab.design.fineness import VERIFIED_PX, fine_enough
from knotfab.design.free_view import free_start, freed
from knotfab.design.prices import Price, prices, sparser
from knotfab.design.radius import RadiusChoice, choose_radius
from knotfab.errors import InputError, SceneError
from knotfab.knots import Knots
from knotfab.progress import Progress
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Region, Scene, View
from knotfab.scene.settings import SearchSettings, search_settings
from knotfab.search.feasibility import Standing
from knotfab.search.search import Infeasible, Problem, SearchResult, search
from knotfab.start.filling import fill
from knotfab.target.read import Target
from knotfab.target.silhouette import polygon_of

__all__ = ["Design", "design", "problem_of", "resolve_view", "silhouette_polygon"]

Array = NDArray[np.float64]

REGION_FILE = "region.stl"
DEPTH_RATIO = 0.66  # of the extent across: the contract asks for 0.6, the flow may take a little


@dataclass(frozen=True)
class Design:
    """A finished search: knots in scene coordinates, and the scene with every value resolved.

    Where the picture's own filling could not meet a limit, `unmet` says which and where, and the result is
    the best that meets them all, or if there is none the one that broke them. `binding` says which
    limits keep the picture from its IoU.
    """

    scene: Scene
    knots: Knots
    result: SearchResult
    radius: RadiusChoice | None
    opening_iou: float
    settings: SearchSettings
    region_stl: bytes | None = None  # of a region that is a mesh: the file that the scene names
    unmet: Standing | None = None
    binding: tuple[Price, ...] = ()


def resolve_view(view: View, target: Target) -> View:
    """A view with its frame's size settled, checked against its picture.

    Raises:
        InputError: the frame would squash the picture.
    """
    w, h = view.frame_width_mm, view.frame_height_mm
    assert w is not None and h is not None
    if abs((w / target.width) / (h / target.height) - 1) > 0.01:
        raise InputError(
            f"scene view {view.name}",
            f"a frame of {w:g} x {h:g} mm would squash a picture of {target.width} x {target.height} px",
            "Leave out frame_width_mm or frame_height_mm",
        )
    if view.azimuth_deg != 0:
        raise InputError(
            "scene key views.azimuth_deg",
            "with one view it is 0",
            "Turn the finished piece instead",
        )
    return view.model_copy(update={"picture": f"picture-{view.name}{target.suffix}"})


def silhouette_polygon(view: View, target: Target) -> MultiPolygon:
    """The silhouette as a polygon in the plane z = 0 (mm), along the light's rays from the receiver."""
    camera = camera_of(view, target.width, target.height)

    def to_plane(pixels: Array) -> Array:
        at = camera.corner + pixels[:, :1] * camera.du + pixels[:, 1:] * camera.dv
        share = camera.eye[2] / (camera.eye[2] - at[:, 2])
        return np.asarray((camera.eye + (at - camera.eye) * share[:, None])[:, :2])

    moved = shapely.transform(polygon_of(target.mask), to_plane)
    parts = [p for p in shapely.get_parts(moved.buffer(0)) if isinstance(p, Polygon)]
    return MultiPolygon([shapely.geometry.polygon.orient(p) for p in parts if p.area > 0])


def _region(region: Region, view: View) -> Region:
    """The region with its size settled: clear of wall and lamp, a quarter wider than the picture."""
    if region.kind == "mesh":
        least, most = _mesh_bounds(region)
        extents = tuple(round(float(s), 4) for s in most - least)
        return region.model_copy(update={"size_mm": extents})
    if region.size_mm != "auto":
        return region
    assert view.frame_width_mm is not None and view.frame_height_mm is not None
    shrink = 1.0 / view.magnification
    deep = 2.0 * min(0.9 * view.wall_distance_mm, 0.25 * view.light_distance_mm)
    wide, high = 1.25 * shrink * view.frame_width_mm, 1.25 * shrink * view.frame_height_mm
    if region.kind == "box":
        size = (wide, high, deep)
    else:
        around = min(max(wide, deep, high), 1.9 * view.light_distance_mm)
        size = (around, high, around) if region.kind == "cylinder" else (around, around, around)
    return region.model_copy(update={"size_mm": tuple(round(s, 4) for s in size)})


def _mesh_bounds(region: Region) -> tuple[Array, Array]:
    """Least and largest coordinates (3,) of a region that is a mesh; InputError if it is unfit."""
    from knotfab.effects.region_mesh import region_mesh

    assert region.file is not None
    return region_mesh(region.file, region.center_mm).bounds


def problem_of(scene: Scene, target: Target) -> Problem:
    """What the search is asked, from a scene with one resolved view."""
    view = scene.views[0]
    region = _region(scene.region, view)
    polygon = silhouette_polygon(view, target)
    if polygon.is_empty:
        raise InputError(
            f"picture {target.name}", "its silhouette vanishes when traced", "Use a bolder picture"
        )
    bend = scene.material.min_bend_radius_mm
    return Problem(
        view,
        target.mask,
        polygon,
        scene.piece.clearance_mm,
        None if bend == "auto" else float(bend),
        scene.material.max_length_mm,
        region,
        _depth(scene, polygon, region, scene.printer.min_tube_radius_mm),
        scene.piece.knot,
    )


def _depth(scene: Scene, polygon: MultiPolygon, region: Region, radius: float) -> float | None:
    """Extent of the centre lines along the axis in mm, None for a flat piece."""
    if scene.piece.depth == "flat":
        return None
    assert not isinstance(region.size_mm, str)
    low_x, low_y, high_x, high_y = polygon.bounds
    wanted = (
        DEPTH_RATIO * (max(high_x - low_x, high_y - low_y) + 2 * radius)
        if scene.piece.depth == "auto"
        else float(scene.piece.depth)
    )
    if region.kind == "mesh":
        least, most = _mesh_bounds(region)
        across = 2 * float(min(most[2], -least[2]))
    else:
        across = region.size_mm[2] - 2 * abs(region.center_mm[2])
    room = across - 4.0 * radius
    if room <= 0:
        raise SceneError(
            "the region",
            f"a tube of {radius:g} mm radius has no room between the light and the wall",
            "Move the wall away (wall_distance_mm), or enlarge the region.",
        )
    if scene.piece.depth != "auto" and wanted > room + 1e-3:
        raise SceneError(
            "scene key piece.depth",
            f"{wanted:g} mm do not fit a region that is {room:.1f} mm deep for it",
            "Ask for less depth, or enlarge the region and the distance to the wall",
        )
    # an auto depth is rounded down, so that a rebuild from the number finds the same room
    return float(np.floor(min(wanted, room) * 1e4) / 1e4) if scene.piece.depth == "auto" else wanted


def opening_iou(polygon: MultiPolygon, radius: float) -> float:
    """IoU of the silhouette with its morphological opening: what a tube draws without spilling."""
    opened = polygon.buffer(-radius).buffer(radius)
    return float(opened.intersection(polygon).area / polygon.union(opened).area)


def _allowed_mm(view: View, radius: float, deep: float, limit_px: float) -> float:
    """How far the outline's limit is on the piece, where the shadow is largest."""
    assert view.frame_width_mm is not None and view.frame_height_mm is not None
    pixel = max(view.frame_width_mm, view.frame_height_mm) / VERIFIED_PX
    light = view.light_distance_mm
    largest = (light + view.wall_distance_mm) / max(light - 0.5 * deep - radius, 0.1 * light)
    return limit_px * pixel / largest


def design(
    scene: Scene,
    target: Target,
    device: str = "cpu",
    progress: Progress | None = None,
    budget_s: float | None = None,
) -> Design:
    """From scene and picture to feasible knots, with every "auto" resolved.

    Args:
        scene: as a person wrote it, or resolved by an earlier build: that gives the same knots.
        budget_s: seconds that the design may take; the iterations are set to fit.

    Raises:
        SceneError: the scene cannot be met; InputError: the scene or picture is wrong.
    """
    begun = time.perf_counter()
    scene = resolve(scene, [(target.width, target.height)])
    view = resolve_view(scene.views[0], target)
    settings = search_settings(scene.accuracy.name, scene.search)
    if settings.free_view:
        scene, view, settings = free_start(scene, view, settings, device, budget_s)
    scene = scene.model_copy(update={"views": (view,)})
    problem = problem_of(scene, target)
    count = None if scene.piece.knots == "auto" else int(scene.piece.knots)
    progress = progress or Progress("quiet")
    choice = None
    if scene.piece.tube_radius_mm == "auto":
        assert view.frame_width_mm is not None
        with progress.stage("radius"):
            choice = choose_radius(
                problem,
                view.frame_width_mm,
                scene.printer.min_tube_radius_mm,
                count,
                settings,
                progress.update,
                device,
            )
        radius, template = choice.radius_mm, choice.template
    else:
        radius = float(scene.piece.tube_radius_mm)
        if radius < scene.printer.min_tube_radius_mm:
            raise SceneError(
                "scene key piece.tube_radius_mm",
                f"{radius:g} mm is thinner than {scene.printer.name} prints",
                f"Use at least {scene.printer.min_tube_radius_mm:g} mm, or another printer",
            )
        with progress.stage("template"):
            template = fill(problem.polygon, radius, count)
    depth = _depth(scene, problem.polygon, problem.region, radius)
    problem = replace(problem, depth_mm=depth)
    bend = problem.limits(radius).bend_radius
    outline = scene.accuracy.max_outline_error_px
    allowed = _allowed_mm(view, radius, depth or 0.0, outline)
    settings = fine_enough(settings, radius, bend, allowed)
    if budget_s is not None:
        with progress.stage("calibrate"):
            settings = within(
                budget_s - (time.perf_counter() - begun),
                settings,
                lambda few: search(problem, template, radius, few, device, repairs=0),
            )
    unmet: SearchResult | None = None
    with progress.stage("search"):
        try:
            if settings.free_view:
                found, settings = freed(scene, problem, template, radius, settings, progress.update)
                result, view, radius = found.result, found.view, found.knots.radius_mm
                problem = replace(problem, view=view, polygon=silhouette_polygon(view, target))
                allowed = _allowed_mm(view, radius, depth or 0.0, outline)
                fine = fine_enough(settings, radius, bend, allowed)
                settings = settings.model_copy(update={"mesh_sides": fine.mesh_sides})
            else:
                result = search(problem, template, radius, settings, device, progress.update)
        except Infeasible as error:
            result = unmet = error.result
            if not settings.free_view:
                result = sparser(problem, radius, count, settings, device) or unmet
    opened = opening_iou(problem.polygon, radius)
    floor = scene.accuracy.iou_floor
    if floor == "auto":
        floor = settings.floor(opened)
    binding: tuple[Price, ...] = ()
    if not settings.free_view and (unmet is not None or result.iou_estimate < float(floor)):
        with progress.stage("limits"):
            roomy, first = _region(Region(), view), unmet or result
            iou = None if unmet is None else result.iou_estimate
            binding = prices(problem, template, first, settings, roomy, device, iou)
    limits = problem.limits(radius)
    region, region_stl = problem.region, None
    if region.file is not None:  # the build writes it beside the scene
        region_stl = Path(region.file).read_bytes()
        region = region.model_copy(update={"file": REGION_FILE})
    resolved = scene.model_copy(
        update={
            "views": (view,),
            "piece": scene.piece.model_copy(
                update={
                    "tube_radius_mm": radius,
                    "depth": "flat" if depth is None else depth,
                    "knots": len(result.knots.knots),
                }
            ),
            "region": region,
            "material": scene.material.model_copy(
                update={"min_bend_radius_mm": limits.bend_radius}
            ),
            "accuracy": scene.accuracy.model_copy(update={"iou_floor": floor}),
            "search": settings.model_dump(),
        }
    )
    standing = None if unmet is None else unmet.standing
    return Design(
        resolved, result.knots, result, choice, opened, settings, region_stl, standing, binding
    )
