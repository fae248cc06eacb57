"""The shadows of a written part, view by view: checks, reports and pictures."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .check import Check
from .clock import timed
from .compare import depth_ratio
from .misplacement import misplacement
from .penumbra import blur_px, penumbra
from .pictures import write_compare, write_shadow
from .read_knots import Curves
from .read_mesh import Mesh
from .read_scene import Scene
from .render import CannotRender, SilhouetteRenderer
from .shadow_checks import shadow_checks
from .silhouette import padded_mask, read_silhouette, working_frame
from .verify_view import VerifiedView, verify_view
from .view import ViewGeometry, view_geometry

__all__ = ["SKIP_RENDER", "geometry_of", "shadows"]

Array = NDArray[np.float64]

FRAME_MM = 180.0  # the longer side of a frame whose size the scene leaves open
BLUR_PX = 1.0  # a lamp that blurs the outline by less is taken as a point
MISPLACED_PX = 512  # losses of a few per cent are told apart as well
SKIP_RENDER = "shadow-render"


@dataclass(frozen=True)
class _Frame:
    """A scene's view with the size of its frame settled."""

    frame_width_mm: float
    frame_height_mm: float
    light_distance_mm: float
    wall_distance_mm: float
    wall_tilt_deg: float
    azimuth_deg: float
    elevation_deg: float
    frame_up_mm: float


def shadows(
    mesh: Mesh,
    curves: Curves | None,
    scene: Scene,
    folder: Path,
    skip: Collection[str],
    pictures_dir: str | PathLike[str] | None,
    seconds: dict[str, float],
) -> tuple[list[Check], list[dict[str, Any]]]:
    """The checks of a part's shadows, and the report's record of each view.

    Args:
        folder: where the scene's pictures lie. skip: with `SKIP_RENDER` the exact polygons decide
            alone. pictures_dir: where to write each view's pictures; None: nowhere.

    Raises:
        ValueError: a picture cannot be read, or the part reaches the light.
    """
    views: list[dict[str, Any]] = []
    pose = np.eye(4) if scene.pose is None else np.asarray(scene.pose, dtype=np.float64)
    vertices = _moved(mesh.vertices, pose)
    polygons = [_moved(p, pose) for p in curves.polygons] if curves is not None else None
    radius = curves.radius_mm if curves is not None else None
    renderer, why = None, "left out on request"
    if SKIP_RENDER not in skip:
        with timed(seconds, "renderer"):
            try:
                renderer = SilhouetteRenderer(vertices, mesh.faces)
            except CannotRender as error:
                why = str(error)
    verified: dict[str, VerifiedView] = {}
    try:
        for view in scene.views:
            with timed(seconds, f"view {view.name}"):
                target = read_silhouette(folder / view.picture, invert=view.invert)
                geometry = geometry_of(view, target.shape[1], target.shape[0])
                found = verify_view(
                    vertices,
                    mesh.faces,
                    target,
                    geometry,
                    polygons=polygons,
                    radius=radius,
                    closed=curves.closed if curves is not None else None,
                    mounted=scene.mount.kind != "none",
                    stand=scene.mount.kind == "stand",
                    renderer=renderer,
                )
            verified[view.name] = found
            soft = None
            fine = geometry.resampled(found.frame)
            lamp = view.light_diameter_mm if view.kind == "shadow" else 0.0
            if renderer is not None and blur_px(vertices, fine, lamp) > BLUR_PX:
                with timed(seconds, "penumbra"):
                    soft = penumbra(renderer, vertices, fine, found.target, lamp)
            points = np.concatenate(polygons) if polygons is not None else vertices
            views.append(_report(view, found, geometry, pose, depth_ratio(points, geometry)))
            if renderer is not None:
                with timed(seconds, "misplacement"):
                    coarse = working_frame(target.shape[1], target.shape[0], MISPLACED_PX)
                    views[-1]["misplacement"] = misplacement(
                        renderer,
                        _middle(points),
                        geometry.resampled(coarse),
                        padded_mask(target, coarse),
                        turns=scene.mount.kind != "wall",
                    )
            if soft is not None:
                views[-1]["penumbra"] = {"widest_px": soft.widest_px, "iou": soft.iou}
            if pictures_dir is not None:
                with timed(seconds, "pictures"):
                    into = Path(pictures_dir)
                    write_shadow(into / f"shadow-{view.name}.png", found.shadow, found.frame)
                    write_compare(
                        into / f"compare-{view.name}.png", found.target, found.shadow, found.frame
                    )
    finally:
        if renderer is not None:
            renderer.close()
    floor = scene.accuracy.iou_floor
    checks = shadow_checks(
        verified,
        mesh.vertices,
        iou_floor=floor if isinstance(floor, float) else None,
        max_outline_px=scene.accuracy.max_outline_error_px,
        no_rendering=None if renderer is not None else why,
        polygons_decide=SKIP_RENDER in skip,
        mount=scene.mount.kind,
    )
    return checks, views


def geometry_of(view: Any, width: int, height: int) -> ViewGeometry:
    """The view's geometry; a frame without a size has 180 mm on its longer side."""
    w, h = view.frame_width_mm, view.frame_height_mm
    if w is None and h is None:
        scale = FRAME_MM / max(width, height)
        w, h = width * scale, height * scale
    frame = _Frame(
        frame_width_mm=h * width / height if w is None else w,
        frame_height_mm=w * height / width if h is None else h,
        light_distance_mm=view.light_distance_mm,
        wall_distance_mm=view.wall_distance_mm,
        wall_tilt_deg=view.wall_tilt_deg,
        azimuth_deg=view.azimuth_deg,
        elevation_deg=view.elevation_deg,
        frame_up_mm=view.frame_up_mm,
    )
    return view_geometry(frame, width, height)


def _report(
    view: Any, found: VerifiedView, geometry: ViewGeometry, pose: Array, depth: float
) -> dict[str, Any]:
    """The report's keys of a view; `projection` and `receiver` in part coordinates."""
    own = geometry.in_part(pose)
    fine_mm = geometry.resampled(found.frame).pixel_mm
    return {
        "name": view.name,
        "kind": view.kind,
        "picture": view.picture,
        "width": geometry.width,
        "height": geometry.height,
        "projection": own.projection.tolist(),
        "receiver": own.receiver.tolist(),
        "iou": found.whole.iou,
        "iou_frame": found.framed.iou,
        "iou_tube": found.tube.iou if found.tube is not None else None,
        "precision": found.whole.precision,
        "recall": found.whole.recall,
        "outline_error_px": found.outline_px,
        "outline_error_mm": found.outline.largest_mm if found.outline is not None else None,
        "intrusion": found.intrusion,
        "outline_stretch_px": found.wrong.length_px,
        "outline_stretch_mm": found.wrong.length_px * fine_mm,
        "outline_stretch_off_px": found.wrong.off_px,
        "legibility": found.legibility or {},
        "depth_ratio": depth,
    }


def _middle(points: Array) -> Array:
    middle: Array = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle


def _moved(points: Array, pose: Array) -> Array:
    moved: Array = points @ pose[:3, :3].T + pose[:3, 3]
    return moved
