"""A receiver that is a cylinder: where rays meet it, and how it unrolls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.files.bad_file import BadFile

__all__ = ["Cylinder"]

MOST_SLANTED = np.cos(np.radians(80.0))  # light that falls on a wall at more is a glimmer


@dataclass(frozen=True)
class Cylinder:
    """A cylinder that touches the flat receiver along a line through `foot` (3,), `along` (3,) unit.

    Its axis lies `radius` mm before that line, towards the light: a positive radius is a hollow wall, a
    negative one a column. It unrolls onto the flat receiver.
    """

    foot: Array
    along: Array
    radius: float

    def in_part(self, pose: Array) -> Cylinder:
        """Return the same in a part's coordinates: `x_scene = pose @ x_part` (4, 4)."""
        turn = pose[:3, :3]
        return replace(self, foot=(self.foot - pose[:3, 3]) @ turn, along=self.along @ turn)

    def _parts(self, points: Array, normal: Array) -> tuple[Array, Array, Array]:
        """Measure how far points (n, 3) are to the right of the line, along it, and before it (n,)."""
        off = points - self.foot
        return off @ np.cross(self.along, normal), off @ self.along, off @ normal

    def roll(self, flat: Array, normal: Array) -> tuple[Array, Array]:
        """Find where points (n, 3) of the flat receiver come to lie, and the unit normals (n, 3) there."""
        arc, high, _ = self._parts(flat, normal)
        right, turn = np.cross(self.along, normal), arc / self.radius
        sine, cosine = np.sin(turn)[:, None], np.cos(turn)[:, None]
        middle = self.foot + self.radius * normal + high[:, None] * self.along
        normals = cosine * normal - sine * right
        return middle - self.radius * normals, normals

    def unroll(self, light: Array, flat: Array, normal: Array) -> Array:
        """Find where on the unrolled wall rays from the light (3,) to points (n, 3) of the flat one end, (n,
        3).

        A ray that passes beside a column ends where it is nearest to it: at its edge.
        """
        (a,), _, (c,) = self._parts(light[None], normal)
        x, high, z = self._parts(flat, normal)
        dx, dz = x - a, z - c
        # |(a + t dx, c + t dz - R)|² = R² gives a hollow wall's far crossing, and a column's near one
        square, half = dx * dx + dz * dz, a * dx + (c - self.radius) * dz
        rest = a * a + (c - self.radius) ** 2 - self.radius**2
        root = np.sqrt(np.maximum(half * half - square * rest, 0.0))
        t = (np.sign(self.radius) * root - half) / square
        right, before = a + t * dx, c + t * dz
        turn = np.arctan2(right / self.radius, 1 - before / self.radius)
        along = light @ self.along - self.foot @ self.along
        up = along + t * (high - along)
        arc = self.radius * turn
        place: Array = (
            self.foot + arc[:, None] * np.cross(self.along, normal) + up[:, None] * self.along
        )
        return place

    def is_beyond(self, points: Array, normal: Array) -> Mask:
        """Tell (n,) whether points (n, 3) before the flat receiver lie in or behind a hollow wall."""
        right, _, before = self._parts(points, normal)
        beyond: Mask = np.hypot(right, before - self.radius) > self.radius
        return beyond & (self.radius > 0) & (before > 0)

    def require(self, light: Array, normal: Array, wide: float) -> None:
        """Refuse a cylinder that does not hold the light, or is narrower than a frame of `wide` mm.

        Raises:
            BadFile: saying which.
        """
        high = float((light - self.foot) @ normal)
        if 0 < 2 * self.radius <= high:
            raise BadFile(
                f"the scene: the light is outside the hollow wall of radius {self.radius:g} mm"
            )
        turn = 0.5 * wide / self.radius
        normals = np.array([-np.sin(turn), np.cos(turn)])
        ray = np.array([0.0, high - self.radius]) + self.radius * normals
        slanted = normals @ ray / np.linalg.norm(ray) < MOST_SLANTED
        if abs(turn) >= np.pi / 2 or slanted:
            raise BadFile(
                f"the scene: a wall of radius {self.radius:g} mm is narrower than its picture of {wide:g} mm"
            )
