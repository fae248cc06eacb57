"""Pose a search's question from a scene and its pictures: frames, silhouettes, bounds and limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.ndimage import binary_dilation
from shapely import MultiPolygon, Polygon

from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.agree import agree
from knotfab.design.frames import frame_view, framed_alike
from knotfab.design.hull import HullBound, contradictions, hull_bounds
from knotfab.design.lamps import depth_apart
from knotfab.design.moves import bounds_of, reach_of
from knotfab.design.room import depth_extent, plate_depth_mm, plate_wall_mm, resolve_region
from knotfab.effects.base import World
from knotfab.picture.opening import opening_iou
from knotfab.picture.read import Target
from knotfab.picture.silhouette import polygon_iou, trace_polygon
from knotfab.picture.strokes import trace_strokes
from knotfab.problem import Problem, Start, TargetView
from knotfab.scene.camera import camera_of, cameras_of, walls_of
from knotfab.scene.require import require_several
from knotfab.search.state import goals_of
from knotfab.start.filling import template_iou
from knotfab.start.start import make_template
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Region
from knotfab_formats.scene import ResolvedScene, ResolvedView, SettledRegion

# how far a piece may reach to a lamp's side, in the lamp's distances: beyond, strands are too near it
_BESIDE = 2.0
_ROOM = 0.03  # room for a tube beyond the hull of its lamp's mask, as a share of the frame's longer side


@dataclass(frozen=True, repr=False)
class Question:
    """A search problem, and the scene that it comes from with printer and material filled in.

    `bounds` are the visual hull's, for several views. `likeness` is the least IoU between the silhouette that
    is drawn and the one that the shadow is judged by, which differ if the picture is drawn smoothed.
    """

    scene: ResolvedScene
    problem: Problem
    bounds: tuple[HullBound, ...] = ()
    likeness: float = 1.0

    @property
    def views(self) -> tuple[ResolvedView, ...]:
        """The views with their frames resolved."""
        return tuple(v.view for v in self.problem.views)

    def opening(self, radius: float) -> float:
        """Return the lowest IoU, over all silhouettes, of the opening by a tube of this radius (mm)."""
        return min(opening_iou(p, radius) for p in self.problem.polygons)

    def most_iou(self, radius: float) -> float:
        """Return an upper bound on the IoU of a tube of this radius (mm) in its worst view.

        It is approximate for pictures that are drawn smoothed, along their lines, or bridged.
        """
        most = min(self.opening(radius), *(b.iou for b in self.bounds), 1.0) * self.likeness
        view, knots = self.problem.views[0], self.scene.piece.knots
        if view.lines:  # the search may draw a little more than tubes along the lines
            most = min(most, template_iou(make_template(view, radius, knots), view.polygon))
        elif len(self.problem.views) == 1 and knots and knots < len(view.polygon.geoms):
            bridged = shapely.make_valid(make_template(view, radius, knots).tube)
            most = min(most, polygon_iou(view.polygon.union(bridged), view.polygon))
        return most

    def roomy(self) -> SettledRegion:
        """Return a region large enough not to constrain the pictures."""
        thinnest = self.scene.printer.min_tube_radius_mm
        return resolve_region(Region(), self.views, self.bounds, thinnest, self.scene.mount)

    def with_depth(self, radius: float) -> Question:
        """Return the question with the depth that its region leaves a tube of this radius (mm)."""
        if len(self.problem.views) > 1:
            return self
        region, polygon = self.problem.region, self.problem.polygons[0]
        asked, ahead = self.scene.piece.depth, self.problem.views[0].axes[2]
        if self.scene.mount.on_feet:
            depth: float | None = plate_depth_mm(self.scene.mount, self.views[0], radius)
        else:
            depth = depth_extent(asked, polygon, region, radius, ahead)
        is_open = asked is None and not self.scene.mount.on_feet
        kept = replace(self.problem, depth_mm=depth, depth_open=is_open)
        return replace(self, problem=kept)

    def as_started(self, start: Start) -> Question:
        """Return the question with the depth that the start chose, if it was open."""
        if not self.problem.depth_open or start.depth is None:
            return self
        depth = start.depth.extent_mm or self.problem.depth_mm
        return replace(self, problem=replace(self.problem, depth_mm=depth, depth_open=False))

    def seen_from(self, views: Sequence[ResolvedView], targets: Sequence[Target]) -> Question:
        """Return the same question with other views of the same pictures."""
        seen = tuple(
            TargetView(v, t.mask, silhouette_polygon(v, t), lines=_strokes(v, t))
            for v, t in zip(views, targets, strict=True)
        )
        bounds = self.bounds
        if bounds:
            masks = [t.mask for t in targets]
            bounds = hull_bounds(
                cameras_of(views, targets), masks, reach_of(views), walls=walls_of(views)
            )
        return replace(self, problem=replace(self.problem, views=seen), bounds=bounds)


def ask(
    scene: ResolvedScene, targets: Sequence[Target], progress: Progress | None = None
) -> Question:
    """Pose the question of a scene and the pictures of its views, in the views' order.

    Raises:
        InputError: a frame would squash its picture, or the scene asks for what several views cannot have.
    """
    several = len(targets) > 1
    if several:
        require_several(scene)
        agreed = agree(scene, targets)
        for line in agreed.lines:
            (progress or Progress("quiet")).say(line)
        scene, targets = framed_alike(agreed.scene, agreed.targets), agreed.targets
    views = _frame_views(scene, targets)
    seen = [
        TargetView(v, t.mask, _trace(v, t), lines=_strokes(v, t), ends=scene.screen_ends)
        for v, t in zip(views, targets, strict=True)
    ]
    thinnest = scene.printer.min_tube_radius_mm
    bounds: tuple[HullBound, ...] = ()
    apart = None
    room = thinnest
    if scene.share_wall:
        masks = [t.mask for t in targets]
        apart = depth_apart(views, masks) if scene.screen_ends else None
        reach = reach_of(views) if apart is None else 0.5 * apart
        bounds = hull_bounds(cameras_of(views, targets), masks, reach, ends=scene.screen_ends)
        room = thinnest if apart is None else _ROOM * views[0].longer_mm
    elif several:
        _require_lamps(seen)
        bounds = agreed.bounds or bounds_of(scene.views, targets, extents=True)
        for line in contradictions(views, bounds):
            (progress or Progress("quiet")).say(line)
        seen = [
            replace(s, left=_crop_to_hull(s.view, t, b))
            for s, t, b in zip(seen, targets, bounds, strict=True)
        ]
    arched = scene.piece.supports == "none"
    problem = Problem(
        tuple(seen),
        scene.piece.clearance_mm,
        scene.material.min_bend_radius_mm,
        scene.material.max_length_mm,
        resolve_region(scene.region, views, bounds, room, scene.mount),
        apart_mm=apart,
        overhang_deg=None if arched else _overhang_deg(scene),
        arched=arched,
        knot=scene.piece.knot,
        # three pictures leave each other little room; two are drawn best with equal goals
        goals=goals_of([b.iou for b in bounds]) if len(views) > 2 and apart is None else None,
        switches=dict(scene.effects),
        world=World.from_scene(scene),
    )
    return Question(scene, problem, bounds, _likeness(targets)).with_depth(thinnest)


def _require_lamps(views: Sequence[TargetView]) -> None:
    """Refuse pictures so large that strands for one of them stand far beyond the lamp of another.

    Raises:
        InputError: names the distance and the size that do.
    """
    across = [float(np.abs(np.array(v.polygon.bounds)[[0, 2]]).max()) for v in views]
    for one in views:
        asked = [
            wide * float(np.linalg.norm(np.cross(one.axes[2], other.axes[2])))
            for wide, other in zip(across, views, strict=True)
        ]
        far, light = max(asked), one.view.light_distance_mm
        if far > _BESIDE * light:
            size = views[0].view.longer_mm * light / far
            raise InputError(
                f"pictures of {views[0].view.longer_mm:.4g} mm (--size)",
                f"their piece would reach {far:.0f} mm towards the lamp of view {one.view.name}, which is "
                f"{light:g} mm away",
                f"Move the lamps away (--lamp-distance {np.ceil(2 * far / 100) * 100:g}), or make the "
                f"pictures smaller (--size {np.floor(size / 10) * 10:g}).",
            )


def _overhang_deg(scene: ResolvedScene) -> float | None:
    """Return the largest overhang from the vertical that prints unsupported; None if none needs supports."""
    unsupported = "powder" in (scene.printer.process, scene.material.process)
    if unsupported or scene.printer.max_overhang_deg >= 90:
        return None
    return scene.printer.max_overhang_deg


def _likeness(targets: Sequence[Target]) -> float:
    """Return the least IoU between a drawn silhouette and the one that its shadow is judged by."""
    return min(float((t.mask & t.judged).sum() / (t.mask | t.judged).sum()) for t in targets)


def _frame_views(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[ResolvedView, ...]:
    """Resolve the views' frames, and refuse those that would squash their pictures."""
    if len(targets) == 1 and scene.views[0].azimuth_deg != 0:
        raise InputError(
            "scene key views.azimuth_deg",
            "with one view it is 0",
            "Turn the finished piece instead",
        )
    views = []
    for view, target in zip(scene.views, targets, strict=True):
        framed = frame_view(view, target)
        w, h = framed.frame_mm
        if abs((w / target.width) / (h / target.height) - 1) > 0.01:
            raise InputError(
                f"scene view {view.name}",
                f"a frame of {w:g} x {h:g} mm would squash a picture of {target.width} x {target.height} px",
                "Give one of --width and --height (frame_width_mm, frame_height_mm): the other follows.",
            )
        if scene.mount.on_feet and "wall_distance_mm" not in view.model_fields_set:
            thinnest = scene.piece.tube_radius_mm or scene.printer.min_tube_radius_mm
            tallest = scene.printer.build_volume_mm[2]
            wall = plate_wall_mm(scene.mount, framed, scene.piece.depth, thinnest, tallest)
            framed = framed.but(wall_distance_mm=wall)
        views.append(framed)
    return tuple(views)


def _trace(view: ResolvedView, target: Target) -> MultiPolygon:
    """Return `silhouette_polygon`, and refuse a picture of which it leaves nothing."""
    polygon = silhouette_polygon(view, target)
    if polygon.is_empty:
        raise InputError(
            f"picture {target.shown}", "its silhouette vanishes when traced", "Use a bolder picture"
        )
    return polygon


def _strokes(view: ResolvedView, target: Target) -> tuple[Array, ...]:
    """Trace the strokes' centre lines in the plane of `silhouette_polygon`; none if areas are filled."""
    if not view.lines or not view.thicken_mm:
        return ()
    width = view.thicken_mm * target.width / view.frame_width_mm
    to_plane = _plane_of(view, target)
    return tuple(to_plane(line) for line in trace_strokes(target.mask, width))


def silhouette_polygon(view: ResolvedView, target: Target) -> MultiPolygon:
    """Trace the silhouette as a polygon in the plane through the origin, along the view's axes, mm."""
    moved = shapely.transform(trace_polygon(target.mask), _plane_of(view, target))
    parts = [p for p in shapely.get_parts(moved.buffer(0)) if isinstance(p, Polygon)]
    return MultiPolygon([shapely.geometry.polygon.orient(p) for p in parts if p.area > 0])


def _plane_of(view: ResolvedView, target: Target) -> Callable[[Array], Array]:
    """Return the map from pixels (n, 2) to the plane through the origin, along the view's axes, mm."""
    own = view.but(azimuth_deg=0.0, elevation_deg=0.0)
    camera = camera_of(own, target.width, target.height)

    def to_plane(pixels: Array) -> Array:
        at = camera.corner + pixels[:, :1] * camera.du + pixels[:, 1:] * camera.dv
        share = camera.eye[2] / (camera.eye[2] - at[:, 2])
        return np.asarray((camera.eye + (at - camera.eye) * share[:, None])[:, :2])

    return to_plane


def _crop_to_hull(view: ResolvedView, target: Target, bound: HullBound) -> MultiPolygon:
    """Return the polygon of the part of a silhouette within the hull's shadow."""
    cell = max(1.0, max(target.mask.shape) / max(bound.covered.shape))
    wide = binary_dilation(bound.covered, np.ones((3, 3)))  # keep edges where nothing is missing
    rows, columns = (
        np.minimum(((np.arange(n) + 0.5) / cell).astype(int), m - 1)
        for n, m in zip(target.mask.shape, wide.shape, strict=True)
    )
    left = target.mask & wide[np.ix_(rows, columns)]
    return silhouette_polygon(view, replace(target, mask=left)) if left.any() else MultiPolygon()
