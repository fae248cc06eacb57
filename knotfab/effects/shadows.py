"""The shadows of strands, from which every effect's magnitude is computed, found once for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.compiled import compiled
from knotfab.scene.camera import camera_of
from knotfab.scene.curved_wall import CurvedWall
from knotfab_formats.scene import ResolvedView

__all__ = ["OnWall", "Shadows"]


@dataclass(frozen=True)
class OnWall:
    """A view as its wall sees it: `axes` (3, 3) rows right, up and normal, in which the lamp is at `lamp`.

    Of a wall that is round those of the flat one that touches it. `middle` (3,): of the frame, in the same.
    """

    axes: Array
    foot: Array  # the foot of the wall's axes, in the scene
    lamp: Array
    middle: Array
    round: CurvedWall | None

    @staticmethod
    @lru_cache(maxsize=8)  # the same views are asked for many times
    def of(view: ResolvedView) -> OnWall:
        """Find where light and wall are."""
        camera = camera_of(view, 1, 1)
        axes = np.stack([camera.du, -camera.dv, camera.receiver[:3]])
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        foot = -camera.receiver[3] * camera.receiver[:3]
        lamp, middle = axes @ (camera.eye - foot), axes @ (camera.corner - foot)
        return OnWall(axes, foot, lamp, middle, CurvedWall.of(view))

    @property
    def bend(self) -> float:
        """One over the wall's radius without its sign, 1/mm; 0 of a flat one."""
        return 0.0 if self.round is None else 1 / abs(self.round.radius)

    def place(self, points: Array) -> Array:
        """Return (n, 3) points (n, 3) of the scene in the wall's axes."""
        return np.asarray((points - self.foot) @ self.axes.T)

    def cast(self, places: Array, lamp: Array | None = None) -> Array:
        """Cast points (n, 3) on the flat wall, in its axes, by its lamp or one at (3,) in them: (n, 2)."""
        return _cast(places, self.lamp if lamp is None else lamp)


@dataclass(frozen=True)
class Shadows:
    """The shadows of `places` (n, 3), in the axes of the wall that they fall on."""

    view: ResolvedView
    wall: OnWall
    places: Array

    @staticmethod
    def of(view: ResolvedView, points: Array) -> Shadows:
        """Return the shadows of points (n, 3) of the scene."""
        wall = OnWall.of(view)
        return Shadows(view, wall, wall.place(points))

    def of_places(self, places: Array) -> Shadows:
        """Return the shadows of other places (n, 3) before the same wall."""
        return Shadows(self.view, self.wall, places)

    @cached_property
    def span(self) -> tuple[Array, float]:
        """(3,) the middle of the places, and how far from it they reach, mm."""
        return _span(self.places)

    @property
    def feet(self) -> Array:
        """(n, 3) points of the wall where they fall."""
        return self._touched[0]

    @property
    def axes(self) -> Array:
        """(n, 3, 3) rows right, up and normal of the wall there, or (1, 3, 3) of a flat one."""
        return self._touched[1]

    @property
    def unrolled(self) -> Array:
        """(n, 2) where they fall, on the wall unrolled."""
        return self._touched[2]

    @cached_property
    def _touched(self) -> tuple[Array, Array, Array]:
        """Feet, axes and places on the wall unrolled.

        What casts no shadow on a column, beside it, is taken to the flat wall.
        """
        wall, flat = self.wall, self.wall.cast(self.places)
        if wall.round is None:
            return np.column_stack([flat, np.zeros(len(flat))]), np.eye(3)[None], flat
        line = wall.middle[:2] - [0.0, wall.round.frame_mm[2]]
        return _bend(flat, wall.round.unroll(flat - line), line, wall.round.radius)


@compiled
def _cast(places: Array, lamp: Array) -> Array:
    """Return (n, 2) shadows on the plane z = 0 of places (n, 3)."""
    found = np.empty((len(places), 2))
    for n in range(len(places)):
        share = lamp[2] / (lamp[2] - places[n, 2])
        for i in range(2):
            found[n, i] = lamp[i] + share * (places[n, i] - lamp[i])
    return found


@compiled
def _bend(flat: Array, on: Array, line: Array, radius: float) -> tuple[Array, Array, Array]:
    """Give feet, axes and places unrolled of (n, 2) on a flat wall; a round one has them `on` from a line."""
    feet, axes = np.zeros((len(flat), 3)), np.zeros((len(flat), 3, 3))
    unrolled = flat.copy()
    for n in range(len(flat)):
        feet[n, :2] = flat[n]
        axes[n, 0, 0] = axes[n, 1, 1] = axes[n, 2, 2] = 1.0
        if not np.isfinite(on[n, 0]):
            continue
        half = 0.5 * on[n, 0] / radius
        sine, cosine = 2 * np.sin(half) * np.cos(half), 1 - 2 * np.sin(half) ** 2
        feet[n, 0] = line[0] + radius * sine
        feet[n, 1] = unrolled[n, 1] = line[1] + on[n, 1]
        feet[n, 2] = 2 * radius * np.sin(half) ** 2
        unrolled[n, 0] = line[0] + on[n, 0]
        axes[n, 0, 0] = axes[n, 2, 2] = cosine
        axes[n, 0, 2], axes[n, 2, 0] = sine, -sine
    return feet, axes, unrolled


@compiled
def _span(places: Array) -> tuple[Array, float]:
    """Return the middle of the box about places (n, 3), and how far from it they reach."""
    low, high, square = places[0].copy(), places[0].copy(), 0.0
    for n in range(len(places)):
        for i in range(3):
            low[i], high[i] = min(low[i], places[n, i]), max(high[i], places[n, i])
    middle = 0.5 * (low + high)
    for n in range(len(places)):
        x, y, z = places[n, 0] - middle[0], places[n, 1] - middle[1], places[n, 2] - middle[2]
        square = max(square, x * x + y * y + z * z)
    return middle, np.sqrt(square)
