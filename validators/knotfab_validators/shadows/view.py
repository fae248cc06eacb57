"""A view in one coordinate system: the light, the receiver and the pixel grid, from scene and pose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from knotfab_validators.arrays import Array, compiled
from knotfab_validators.geometry.curves import view_axes
from knotfab_validators.shadows.frame import WorkingFrame

ON_RECEIVER_MM = 2e-2
"""What is no farther before the receiver plane lies on it: a plate's face, as cleaning a mesh leaves it."""


FRAME_MM = 180.0
"""The longer side of a frame whose size the scene leaves open."""


class SceneView(Protocol):
    """What a scene's view says about its geometry (mm, degrees); None where it is left open."""

    @property
    def frame_width_mm(self) -> float | None: ...
    @property
    def frame_height_mm(self) -> float | None: ...
    @property
    def light_distance_mm(self) -> float: ...
    @property
    def wall_distance_mm(self) -> float: ...
    @property
    def wall_tilt_deg(self) -> float: ...
    @property
    def azimuth_deg(self) -> float: ...
    @property
    def elevation_deg(self) -> float: ...
    @property
    def frame_up_mm(self) -> float: ...
    @property
    def light_right_mm(self) -> float: ...
    @property
    def light_up_mm(self) -> float: ...


@dataclass(frozen=True)
class ViewGeometry:
    """One light (or eye), its receiver plane and its pixel grid, in one coordinate system (mm).

    A pixel (u, v) is the point `origin + u * du + v * dv` of the receiver; `du` points to the right
    and `dv` down as seen from the light, both are one pixel long. `up` and `right` are the unit
    axes of someone at the light who looks along the view's axis (they lie across that axis, also
    where the wall is tilted).
    """

    light: Array  # (3,)
    origin: Array  # (3,) centre of pixel (0, 0)
    du: Array  # (3,)
    dv: Array  # (3,)
    right: Array  # (3,) unit
    up: Array  # (3,) unit
    width: int
    height: int

    @property
    def middle(self) -> Array:
        """The middle (3,) of the pixels on the receiver."""
        right, down = (self.width - 1) / 2 * self.du, (self.height - 1) / 2 * self.dv
        return np.asarray(self.origin + right + down)

    @property
    def normal(self) -> Array:
        """Unit normal (3,) of the receiver, towards the light."""
        n = np.cross(self.dv, self.du)
        n = n / np.linalg.norm(n)
        return n if n @ (self.light - self.origin) > 0 else -n

    @property
    def axis(self) -> Array:
        """Unit vector (3,) along the view's axis, towards the light."""
        return np.cross(self.right, self.up)

    @property
    def receiver(self) -> Array:
        """Plane (a, b, c, d) with unit normal; positive on the light's side."""
        n = self.normal
        return np.append(n, -n @ self.origin)

    @property
    def light_height(self) -> float:
        """Distance of the light from the receiver plane, mm."""
        return float(self.normal @ (self.light - self.origin))

    @property
    def w_of_receiver(self) -> float:
        """The w (see `projection`) at and beyond which matter lies on or behind the receiver."""
        return 1.0 - ON_RECEIVER_MM / self.light_height

    @property
    def pixel_mm(self) -> float:
        """Size of a pixel on the receiver, mm: the smaller of its two sides."""
        return float(min(np.linalg.norm(self.du), np.linalg.norm(self.dv)))

    @property
    def projection(self) -> Array:
        """(3, 4): `(u w, v w, w) = P (x, y, z, 1)`, with w = 1 on the receiver plane.

        A point X on the ray from the light L through Q = O + u du + v dv is L + w (Q - L), so
        X - L = [du dv O-L] (u w, v w, w).
        """
        inverse = np.linalg.inv(np.column_stack([self.du, self.dv, self.origin - self.light]))
        return np.column_stack([inverse, -inverse @ self.light])

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixel coordinates (n, 2) and w (n,) of points (n, 3); 0 < w < 1 before the receiver."""
        h = self.lift(points)
        w = h[:, 2]
        return h[:, :2] / w[:, None], w

    def lift(self, points: Array) -> Array:
        """Project points (n, 3) to (u w, v w, w); lines stay straight."""
        return _lift(np.ascontiguousarray(points, dtype=np.float64), self.projection)

    def on_receiver(self, pixels: Array) -> Array:
        """Return the receiver's points (n, 3), mm, under pixel coordinates (n, 2)."""
        return np.asarray(self.origin + pixels[:, :1] * self.du + pixels[:, 1:] * self.dv)

    def resample(self, frame: WorkingFrame) -> ViewGeometry:
        """Return this view on the padded working frame's pixels."""
        scale_u, scale_v = self.width / frame.width, self.height / frame.height
        u0, v0 = (0.5 - frame.pad_x) * scale_u - 0.5, (0.5 - frame.pad_y) * scale_v - 0.5
        return replace(
            self,
            origin=self.origin + u0 * self.du + v0 * self.dv,
            du=self.du * scale_u,
            dv=self.dv * scale_v,
            width=frame.padded_width,
            height=frame.padded_height,
        )

    def in_part(self, pose: Array) -> ViewGeometry:
        """Return this view in the part's coordinates, where `x_scene = pose @ x_part` (4, 4)."""
        rotation, shift = pose[:3, :3], pose[:3, 3]
        return replace(
            self,
            light=(self.light - shift) @ rotation,
            origin=(self.origin - shift) @ rotation,
            du=self.du @ rotation,
            dv=self.dv @ rotation,
            right=self.right @ rotation,
            up=self.up @ rotation,
        )


@compiled
def _lift(points: Array, matrix: Array) -> Array:
    """Return `matrix` (3, 4) times (x, y, z, 1) for points (n, 3)."""
    lifted = np.empty((len(points), 3))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        for i in range(3):
            lifted[k, i] = matrix[i, 0] * x + matrix[i, 1] * y + matrix[i, 2] * z + matrix[i, 3]
    return lifted


def view_geometry(view: SceneView, width: int, height: int) -> ViewGeometry:
    """Return a view in scene coordinates, for a picture of `width` x `height` pixels.

    The light stands at `light_distance_mm` from the scene's origin in the direction of the azimuth, raised
    by the elevation, and `light_right_mm` and `light_up_mm` beside that axis; the receiver's centre lies
    opposite, `wall_distance_mm` behind the origin; a positive tilt leans its top edge towards the light.
    The frame's middle lies `frame_up_mm` above that centre, on the receiver. Where one side of the frame
    is left open the picture's proportions decide it, where both are, the longer one has `FRAME_MM`.
    """
    wide, high = _frame_size(view, width, height)
    right, up, axis = view_axes(view.azimuth_deg, view.elevation_deg)
    tilt = np.radians(view.wall_tilt_deg)
    upwards = np.cos(tilt) * up + np.sin(tilt) * axis
    du = right * wide / width
    dv = -upwards * high / height
    centre = view.frame_up_mm * upwards - view.wall_distance_mm * axis
    light = view.light_distance_mm * axis + view.light_right_mm * right + view.light_up_mm * up
    return ViewGeometry(
        light=light,
        origin=centre - (width - 1) / 2 * du - (height - 1) / 2 * dv,
        du=du,
        dv=dv,
        right=right,
        up=up,
        width=width,
        height=height,
    )


def _frame_size(view: SceneView, width: int, height: int) -> tuple[float, float]:
    """Return the width and height, mm, of the frame for a picture of `width` x `height` pixels."""
    wide, high = view.frame_width_mm, view.frame_height_mm
    if wide is None and high is None:
        scale = FRAME_MM / max(width, height)
        return width * scale, height * scale
    if wide is None:
        assert high is not None
        return high * width / height, high
    return wide, wide * height / width if high is None else high
