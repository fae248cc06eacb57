"""The pinhole camera of a view, flat or round wall: pixel to ray, point to pixel (docs/conventions.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import project
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Region
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import View

Plane = tuple[float, float, float, float]
_CLEAR = 0.97  # several pictures may take this share of the way to a wall


class _Sized(Protocol):
    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...


@dataclass(frozen=True)
class Camera:
    """A light (or eye) and the picture's frame on its receiver plane.

    Pixel (u, v) lies at `corner + u * du + v * dv` on the receiver; all vectors are (3,) in mm.
    """

    eye: Array
    corner: Array
    du: Array
    dv: Array
    width: int
    height: int

    @property
    def projection(self) -> Array:
        """(3, 4): scene point -> homogeneous pixel; w = 1 on the receiver, > 0 before the light."""
        frame = np.stack([self.du, self.dv, self.corner - self.eye], axis=1)
        inverse = np.linalg.inv(frame)
        return np.concatenate([inverse, -inverse @ self.eye[:, None]], axis=1)

    @property
    def receiver(self) -> Array:
        """(4,): unit normal towards the light, and offset."""
        normal = np.cross(self.dv, self.du)
        normal /= np.linalg.norm(normal)
        offset = -float(normal @ self.corner)
        plane = np.append(normal, offset)
        return plane if plane[:3] @ self.eye + offset > 0 else -plane

    @property
    def middle(self) -> Array:
        """The middle of the frame, on the receiver, (3,)."""
        half = self.corner + 0.5 * (self.width - 1) * self.du
        return np.asarray(half + 0.5 * (self.height - 1) * self.dv)

    @property
    def frame_mm(self) -> tuple[float, float]:
        """Width and height of the frame."""
        across, down = (float(np.linalg.norm(step)) for step in (self.du, self.dv))
        return self.width * across, self.height * down

    @property
    def wall_axes(self) -> Array:
        """The picture's right, up the receiver, and out of it, as rows (3, 3)."""
        right, out = self.du / np.linalg.norm(self.du), self.receiver[:3]
        return np.stack([right, np.cross(out, right), out])

    @property
    def level_axes(self) -> Array:
        """The picture's right, straight up, and level towards the light, as rows (3, 3)."""
        right, up = self.du / np.linalg.norm(self.du), np.array([0.0, 1.0, 0.0])
        return np.stack([right, up, np.cross(right, up)])

    def project(self, points: Array) -> Array:
        """Project points (n, 3), mm, to pixels (n, 2)."""
        return project(points, self.projection).places

    def cast(self, points: Array) -> Array:
        """Return where the rays through points (n, 3), mm, meet the receiver's plane (n, 3)."""
        plane = self.receiver
        away = points - self.eye
        height = plane[:3] @ self.eye + plane[3]
        return np.asarray(self.eye + away * (height / -(away @ plane[:3]))[:, None])

    def resized(self, width: int, height: int) -> Camera:
        """Return the same frame sampled with `width` x `height` pixels."""
        du, dv = self.du * (self.width / width), self.dv * (self.height / height)
        corner = self.corner - 0.5 * (self.du + self.dv) + 0.5 * (du + dv)
        return Camera(self.eye, corner, du, dv, width, height)

    def padded(self, pad_u: int, pad_v: int) -> Camera:
        """Return the frame grown by whole pixels on each side."""
        corner = self.corner - pad_u * self.du - pad_v * self.dv
        return Camera(
            self.eye, corner, self.du, self.dv, self.width + 2 * pad_u, self.height + 2 * pad_v
        )


def camera_of(view: ResolvedView, width: int, height: int) -> Camera:
    """Return the camera of `view` whose frame has `width` x `height` pixels."""
    right, across, back = view_axes(view)
    tilt = np.deg2rad(view.wall_tilt_deg)
    up = np.cos(tilt) * across + np.sin(tilt) * back
    centre = view.frame_up_mm * up - view.wall_distance_mm * back
    du = right * (view.frame_width_mm / width)
    dv = -up * (view.frame_height_mm / height)
    corner = centre - 0.5 * (width - 1) * du - 0.5 * (height - 1) * dv
    return Camera(light_of(view), corner, du, dv, width, height)


def light_of(view: View) -> Array:
    """Return the middle of the view's lamp (or its eye) in the scene, (3,)."""
    beside = (view.light_right_mm, view.light_up_mm, view.light_distance_mm)
    return np.asarray(beside @ view_axes(view))


def cameras_of(views: Iterable[ResolvedView], pictures: Iterable[_Sized]) -> list[Camera]:
    """Return the camera of each view, with the resolution of its picture."""
    return [camera_of(v, p.width, p.height) for v, p in zip(views, pictures, strict=True)]


def walls_of(views: Iterable[ResolvedView]) -> tuple[Plane, ...]:
    """Return each wall's plane (nx, ny, nz, d); n · p + d is the clearance of p before it, mm."""
    walls = []
    for view in views:
        if view.kind == "shadow":
            plane = camera_of(view, 1, 1).receiver
            plane[3] -= view.wall_distance_mm - _CLEAR * view.clear_mm
            walls.append(tuple(plane.tolist()))
    return tuple(walls)


def view_axes(view: View | Region) -> Array:
    """Return the view's right, up and towards its light, as rows (3, 3); a region's own axes."""
    azimuth, elevation = np.deg2rad(view.azimuth_deg), np.deg2rad(view.elevation_deg)
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    level = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    vertical = np.array([0.0, 1.0, 0.0])
    back = np.cos(elevation) * level + np.sin(elevation) * vertical
    across = np.cos(elevation) * vertical - np.sin(elevation) * level
    return np.stack([right, across, back])


NEAREST_DEG = 3.0  # nearer lines of sight count as one


def least_apart(views: Sequence[View]) -> float:
    """Return the least angle between two lines of sight, degrees; opposite directions count as one."""
    axes = np.array([view_axes(v)[2] for v in views])
    cosine = np.abs(axes @ axes.T)[np.triu_indices(len(axes), 1)]
    return float(np.rad2deg(np.arccos(np.clip(cosine.max(), 0.0, 1.0))))


def find_aligned(views: Sequence[View]) -> tuple[int, int] | None:
    """Find the first two views along one line, where a part has one silhouette and its mirror image."""
    for n, one in enumerate(views):
        for m, other in enumerate(views[:n]):
            if least_apart([one, other]) < NEAREST_DEG:
                return m, n
    return None


# A wall that is a cylinder, and the flat wall that touches it.

_SLANTED_DEG = 80.0  # light at a steeper angle from the normal hardly brightens a wall
_ACROSS = 65  # sample places over half of a frame's width


@dataclass(frozen=True)
class CurvedWall:
    """A cylinder along the receiver's up that touches the flat receiver where the view's axis meets it.

    Its axis is `radius` mm before that line, so a wall of positive radius is hollow towards the light. A
    place on it is (arc, up) from there, mm, as on the wall unrolled; light is straight, so each stands
    for one on the flat wall (x, up), on the same ray. `axes` (3, 3) are rows right, up and normal of the flat
    wall about `foot` (3,), in which the light is at `light` (3,); `frame_mm` across, up, and the middle's up.
    """

    radius: float
    axes: Array
    foot: Array
    light: Array
    frame_mm: tuple[float, float, float]

    @staticmethod
    def from_view(view: ResolvedView) -> CurvedWall | None:
        """Return the view's wall; None where it is flat."""
        if view.wall_radius_mm is None:
            return None
        camera, back = camera_of(view, 1, 1), view_axes(view)[2]
        axes = np.stack([camera.du, -camera.dv, camera.receiver[:3]])
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        foot = -view.wall_distance_mm * back
        frame = (*view.frame_mm, view.frame_up_mm)
        return CurvedWall(view.wall_radius_mm, axes, foot, axes @ (camera.eye - foot), frame)

    def flatten(self, places: Array) -> Array:
        """Map places (n, 2) of this wall along their rays to the flat wall (n, 2)."""
        turn = places[:, 0] / self.radius
        before = self.before(turn)
        on = before / (self.light[2] - before)
        across = self.radius * np.sin(turn) * (1 + on)
        return np.column_stack([across, places[:, 1] + (places[:, 1] - self.light[1]) * on])

    def unroll(self, flat: Array) -> Array:
        """Invert `flatten`: map places of the flat wall to this one; NaN where a ray passes a column.

        A ray to (x, y) is at x (1 - u) across and H u before the flat wall, and on the circle where
        (x² + H²) u² - 2 (x² + R H) u + x² = 0; of both roots the one near u = 0, from their product, since a
        wall may be so nearly flat that they cancel.
        """
        high, radius = self.light[2], self.radius
        square = flat[:, 0] ** 2
        with np.errstate(invalid="ignore"):
            root = np.sqrt((radius * high) ** 2 + square * high * (2 * radius - high))
        u = square / (square + radius * high + np.sign(radius) * root)
        across, before = flat[:, 0] * (1 - u), high * u
        arc = radius * np.arctan2(across / radius, 1 - before / radius)
        return np.column_stack([arc, flat[:, 1] - (flat[:, 1] - self.light[1]) * u])

    def areas(self, across: Array, half: float) -> Array:
        """Return how much larger each vertical strip of the flat wall is when cast on the round one, (n,).

        Strips reach `half` mm to either side of `across` (n,); 0 where no light arrives.
        """
        ends = [
            self.unroll(np.column_stack([x, np.zeros_like(x)]))
            for x in (across - half, across + half)
        ]
        above = self.unroll(np.column_stack([across, np.ones_like(across)]))[:, 1]
        level = self.unroll(np.column_stack([across, np.zeros_like(across)]))[:, 1]
        return np.nan_to_num((ends[1] - ends[0])[:, 0] / (2 * half) * (above - level))

    def stand(self, places: Array) -> tuple[Array, Array]:
        """Return the scene's points (n, 3) of places (n, 2), and the wall's unit normals (n, 3) there."""
        turn = places[:, 0] / self.radius
        before = self.before(turn)
        local = np.column_stack([self.radius * np.sin(turn), places[:, 1], before])
        normal = np.column_stack([-np.sin(turn), np.zeros_like(turn), np.cos(turn)])
        return self.foot + local @ self.axes, normal @ self.axes

    def before(self, turn: Array | float) -> Array:
        """Return how far in front of the flat wall this one is at angle `turn`, mm, without cancellation."""
        return np.asarray(2 * self.radius * np.sin(0.5 * turn) ** 2)

    def touching(self, points: Array) -> Array:
        """Return the planes tangent to the wall at the shadows of points (n, 3), (n, 4); NaN beside it."""
        local = (points - self.foot) @ self.axes.T
        share = self.light[2] / (self.light[2] - local[:, 2:])
        at, normal = self.stand(
            self.unroll(self.light[:2] + (local[:, :2] - self.light[:2]) * share)
        )
        return np.column_stack([normal, -(normal * at).sum(axis=1)])

    def room_mm(self, points: Array) -> float:
        """Return the least clearance of points (n, 3) before the wall, mm; negative behind it.

        For a hollow wall, nothing between the points comes nearer.
        """
        local = (points - self.foot) @ self.axes.T
        off = np.hypot(local[:, 0], local[:, 2] - self.radius)
        return float((np.sign(self.radius) * (abs(self.radius) - off)).min())

    @property
    def off_mm(self) -> float:
        """Bound how far the flat wall's picture lies from this one's within the frame, mm.

        About |x|³ / (2 R H) across, less what a bent wall is longer, |x|³ / (6 R²), and y x² / (2 R H) up.
        """
        wide, high, up = self.frame_mm
        arcs = np.linspace(0.0, 0.5 * wide, _ACROSS)
        if self.slant_deg(0.5 * wide) > _SLANTED_DEG:
            return float("inf")
        off = [
            self.flatten(at) - at
            for at in (
                np.column_stack([arcs, np.full(_ACROSS, up + s * high)]) for s in (-0.5, 0.5)
            )
        ]
        return float(np.linalg.norm(np.concatenate(off), axis=1).max())

    def slant_deg(self, arc: float) -> float:
        """Return the angle between light and the wall's normal at this arc length, level with the light."""
        turn = arc / self.radius
        if abs(turn) >= 0.5 * np.pi:
            return 180.0
        normal = np.array([-np.sin(turn), np.cos(turn)])
        at = np.array([self.radius * np.sin(turn), self.before(turn)])
        ray = np.array([0.0, self.light[2]]) - at
        return float(np.degrees(np.arccos(normal @ ray / np.linalg.norm(ray))))


def require_wall(view: ResolvedView) -> None:
    """Refuse a curved wall that is too narrow for its picture, or about the light.

    Raises:
        InputError: it is; the message says which.
    """
    wall = CurvedWall.from_view(view)
    if wall is None:
        return
    what, wide = f"scene view {view.name}", view.frame_width_mm
    reach = wall.light[2] + 0.5 * view.light_size_mm
    if wall.radius > 0 and reach >= 2 * wall.radius:
        raise InputError(
            what,
            f"the light, {wall.light[2]:g} mm before a hollow wall of wall_radius_mm = {wall.radius:g}, is "
            "not inside it",
            f"Use a radius above {reach / 2:.0f} mm, or move the light nearer",
        )
    if wall.slant_deg(0.5 * wide) > _SLANTED_DEG:
        arcs = np.linspace(0.0, 0.5 * wide, 200)
        seen = 2 * max(float(x) for x in arcs if wall.slant_deg(x) <= _SLANTED_DEG)
        raise InputError(
            what,
            f"a cylinder of wall_radius_mm = {wall.radius:g} is narrower than the picture: the light reaches "
            f"{seen:.0f} mm of it, and the frame is {wide:g} mm wide",
            "Make the picture narrower (--width), or the wall's radius larger",
        )
    if view.clear_mm <= 0:
        raise InputError(
            what,
            f"the hollow wall comes {view.wall_distance_mm - view.clear_mm:.0f} mm forward beside the "
            f"picture, and the middle of the piece is only {view.wall_distance_mm:g} mm before it",
            "Move the wall away (--wall-distance), or make its radius larger",
        )
