"""Validate written files: part, knots and scene are read from disk and measured anew."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .check import Check
from .compare import depth_ratio
from .failure_picture import draw_failures
from .part_checks import part_checks
from .penumbra import blur_px, penumbra
from .pictures import write_compare, write_shadow
from .read_knots import Curves, read_knots
from .read_mesh import BadFile, Mesh, read_mesh
from .read_scene import Scene, read_scene
from .render import CannotRender, SilhouetteRenderer
from .shadow_checks import shadow_checks, skipped_shadow_checks
from .silhouette import read_silhouette
from .verdict import Verdict, verdict_of
from .verify_view import VerifiedView, verify_view
from .view import ViewGeometry, view_geometry

__all__ = ["Verdict", "geometry_of", "validate"]

Array = NDArray[np.float64]
FilePath = str | PathLike[str]

FRAME_MM = 180.0  # the longer side of a frame whose size the scene leaves open
BLUR_PX = 1.0  # a lamp that blurs the outline by less is taken as a point
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


def validate(
    part: FilePath | None,
    knots: FilePath | None = None,
    scene: FilePath | None = None,
    skip: Collection[str] = (),
    pictures_dir: FilePath | None = None,
    failures: FilePath | None = None,
) -> Verdict:
    """Measure written files; whatever the given ones allow is checked, the rest is said to be not.

    Args:
        part: STL or 3MF in print coordinates. knots: knots.json. scene: scene.toml; its pictures
            lie beside it, and its pose takes part and knots to the scene.
        skip: names of checks to leave out; "shadow-render" lets the exact polygons alone decide
            about the shadow.
        pictures_dir: where to write shadow-NAME.png and compare-NAME.png of each view.
        failures: the PNG to write when a required check fails: the part with the places marked.

    Raises:
        ValueError: a file cannot be read, or the part reaches the light (each error of the
            readers is a ValueError with one sentence).
    """
    seconds: dict[str, float] = {}
    with _timed(seconds, "read"):
        mesh = read_mesh(Path(part)) if part is not None else None
        curves = read_knots(Path(knots)) if knots is not None else None
        setting = read_scene(Path(scene)) if scene is not None else None
    checks = part_checks(mesh, curves, setting, seconds)
    views: list[dict[str, Any]] = []
    if mesh is None or setting is None:
        lacking = "the part" if mesh is None else "the scene"
        checks += skipped_shadow_checks(f"not given {lacking}", required=False)
    else:
        assert scene is not None
        folder = Path(scene).parent
        checks += _shadows(mesh, curves, setting, folder, skip, pictures_dir, views, seconds)
    checks = [_left_out(c) if c.name in skip else c for c in checks]
    drawn = False
    if failures is not None:
        with _timed(seconds, "failures"):
            try:
                drawn = draw_failures(Path(failures), checks, mesh, curves)
            except OSError as error:
                raise BadFile(f"{failures}: cannot be written ({error.strerror})") from error
    return verdict_of(checks, views, seconds, picture=str(failures) if drawn else None)


def _shadows(
    mesh: Mesh,
    curves: Curves | None,
    scene: Scene,
    folder: Path,
    skip: Collection[str],
    pictures_dir: FilePath | None,
    views: list[dict[str, Any]],
    seconds: dict[str, float],
) -> list[Check]:
    """The shadow's checks; appends a report of each view to `views`."""
    pose = np.eye(4) if scene.pose is None else np.asarray(scene.pose, dtype=np.float64)
    vertices = _moved(mesh.vertices, pose)
    polygons = [_moved(p, pose) for p in curves.polygons] if curves is not None else None
    radius = curves.radius_mm if curves is not None else None
    renderer, why = None, "left out on request"
    if SKIP_RENDER not in skip:
        with _timed(seconds, "renderer"):
            try:
                renderer = SilhouetteRenderer(vertices, mesh.faces)
            except CannotRender as error:
                why = str(error)
    verified: dict[str, VerifiedView] = {}
    try:
        for view in scene.views:
            with _timed(seconds, f"view {view.name}"):
                target = read_silhouette(folder / view.picture, invert=view.invert)
                geometry = geometry_of(view, target.shape[1], target.shape[0])
                found = verify_view(
                    vertices,
                    mesh.faces,
                    target,
                    geometry,
                    polygons=polygons,
                    radius=radius,
                    renderer=renderer,
                )
            verified[view.name] = found
            soft = None
            fine = geometry.resampled(found.frame)
            lamp = view.light_diameter_mm if view.kind == "shadow" else 0.0
            if renderer is not None and blur_px(vertices, fine, lamp) > BLUR_PX:
                with _timed(seconds, "penumbra"):
                    soft = penumbra(renderer, vertices, fine, found.target, lamp)
            points = np.concatenate(polygons) if polygons is not None else vertices
            views.append(_report(view, found, geometry, pose, depth_ratio(points, geometry)))
            if soft is not None:
                views[-1]["penumbra"] = {"widest_px": soft.widest_px, "iou": soft.iou}
            if pictures_dir is not None:
                with _timed(seconds, "pictures"):
                    into = Path(pictures_dir)
                    write_shadow(into / f"shadow-{view.name}.png", found.shadow, found.frame)
                    write_compare(
                        into / f"compare-{view.name}.png", found.target, found.shadow, found.frame
                    )
    finally:
        if renderer is not None:
            renderer.close()
    floor = scene.accuracy.iou_floor
    return shadow_checks(
        verified,
        mesh.vertices,
        iou_floor=floor if isinstance(floor, float) else None,
        max_outline_px=scene.accuracy.max_outline_error_px,
        no_rendering=None if renderer is not None else why,
        polygons_decide=SKIP_RENDER in skip,
    )


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
        "iou_tube": found.tube.iou if found.tube is not None else None,
        "precision": found.whole.precision,
        "recall": found.whole.recall,
        "outline_error_px": found.outline_px,
        "outline_error_mm": found.outline.largest_mm if found.outline is not None else None,
        "outline_stretch_px": found.wrong.length_px,
        "outline_stretch_mm": found.wrong.length_px * fine_mm,
        "outline_stretch_off_px": found.wrong.off_px,
        "legibility": found.legibility or {},
        "depth_ratio": depth,
    }


def _moved(points: Array, pose: Array) -> Array:
    moved: Array = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def _left_out(check: Check) -> Check:
    return Check(
        name=check.name,
        status="skipped",
        required=False,
        measured=check.measured,
        limit=check.limit,
        unit=check.unit,
        detail="left out on request",
    )


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start
