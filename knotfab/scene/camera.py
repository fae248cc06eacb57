"""The pinhole camera of a view: pixel to ray, point to pixel (docs/conventions.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import project
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
            plane[3] -= view.wall_distance_mm - _CLEAR * view.wall_distance_mm
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
