"""The base of a stand: below the frame as the light sees it, and as large as the piece needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab.errors import SceneError
from knotfab.scene.camera import Camera

__all__ = ["CHAMFER_MM", "CORNER_MM", "Base", "Slope", "Weights", "base_for", "slope_below"]

Array = NDArray[np.float64]

CORNER_MM = 6.0
CHAMFER_MM = 0.6  # of the underside's edge: what stands on the desk is so much smaller
LIGHT_FILL = 0.25  # of a printed base's volume: it must stand whether it is filled or not
EDGE_MM = 2.0  # from a post's root to the edge of the base
WALL_GAP_MM = 2.0  # between base and wall
ROUNDS = 40  # of the search for a size, each of which nearly halves what is left


@dataclass(frozen=True)
class Slope:
    """The plane of the base's top, along which the light just looks below the frame.

    `axes` (3, 3) has rows: the view's right, up, and out (level, towards the light). In these
    coordinates the top is `up = height + rise * out`.
    """

    axes: Array
    height_mm: float
    rise: float

    def above(self, points: Array) -> Array:
        """(n,) how far above the plane points (n, 3) lie, straight up, mm."""
        own = points @ self.axes.T
        return np.asarray(own[:, 1] - self.height_mm - self.rise * own[:, 2])

    def lowered(self, by_mm: float) -> Slope:
        """The same plane farther down."""
        return Slope(self.axes, self.height_mm - by_mm, self.rise)


def slope_below(camera: Camera) -> Slope:
    """The plane through the light and the lower edge of the frame."""
    right = camera.du / np.linalg.norm(camera.du)
    up = np.array([0.0, 1.0, 0.0])
    axes = np.stack([right, up, np.cross(right, up)])
    edge = axes @ (camera.corner + (camera.height - 0.5) * camera.dv)
    light = axes @ camera.eye
    rise = float((light[1] - edge[1]) / (light[2] - edge[2]))
    return Slope(axes, float(edge[1] - rise * edge[2]), rise)


@dataclass(frozen=True)
class Weights:
    """Solids by volume and centre of mass: mm³ (n,) and (n, 3) in the scene."""

    volume: Array
    center: Array


@dataclass(frozen=True)
class Base:
    """A block on the desk, in the axes of its slope: right, up and out, mm.

    `left`, `right`, `back` and `front` bound it; `bottom` is the desk. `margin_mm` is how far inside its
    foot the centre of mass of the whole part lies, `height_mm` how high; `tip_deg` how far it can be
    tipped, whether the base is solid or printed with little infill.
    """

    slope: Slope
    left: float
    right: float
    back: float
    front: float
    bottom: float
    margin_mm: float
    height_mm: float
    tip_deg: float

    @property
    def size_mm(self) -> tuple[float, float, float, float]:
        """Width, depth, and height at the front and at the back."""
        front, back = (
            float(self.slope.height_mm + self.slope.rise * z - self.bottom)
            for z in (self.front, self.back)
        )
        return float(self.right - self.left), float(self.front - self.back), front, back


def base_for(
    slope: Slope,
    feet: Array,
    root_mm: float,
    weights: Weights,
    camera: Camera,
    thickness_mm: float,
    tip_deg: float,
) -> Base:
    """The smallest base that holds all feet and does not tip before `tip_deg`.

    Args:
        feet: (n, 3) where posts meet the top. root_mm: their radius there.
        weights: everything that stands on the base. thickness_mm: of the base at its back.

    Raises:
        SceneError: the wall is in the way of a base that deep.
    """
    own = feet @ slope.axes.T
    rim = root_mm + EDGE_MM
    least = 2 * CORNER_MM + 1.0
    left, right = own[:, 0].min() - rim, own[:, 0].max() + rim
    back, front = own[:, 2].min() - rim, own[:, 2].max() + rim
    piece = weights.center @ slope.axes.T
    for _ in range(ROUNDS):
        if right - left < least:
            left, right = (left + right - least) / 2, (left + right + least) / 2
        if front - back < least:
            back, front = (back + front - least) / 2, (back + front + least) / 2
        base = _measured(slope, left, right, back, front, weights.volume, piece, thickness_mm)
        need = base[1] * np.tan(np.deg2rad(tip_deg)) + CHAMFER_MM
        x, z = base[2]
        lacking = np.array([x[0] - left, right - x[1], z[0] - back, front - z[1]])
        lacking = np.maximum(need - lacking, 0.0)
        if lacking.max() < 1e-3:
            break
        lacking += 1e-3 * (lacking > 0)
        left, right = left - lacking[0], right + lacking[1]
        back, front = back - lacking[2], front + lacking[3]
    found = base[0]
    behind = np.array(
        [
            [x, y, found.back]
            for x in (left, right)
            for y in (found.bottom, found.bottom + thickness_mm)
        ]
    )
    room = behind @ slope.axes @ camera.receiver[:3] + camera.receiver[3]
    if float(room.min()) < WALL_GAP_MM or found.tip_deg < tip_deg - 0.01:
        raise SceneError(
            "the stand",
            f"a base that holds the piece reaches {found.front - found.back:.0f} mm deep, to within "
            f"{float(room.min()):.1f} mm of the wall",
            "Use a larger wall distance, less depth, or --mount wall",
        )
    return found


def _measured(
    slope: Slope,
    left: float,
    right: float,
    back: float,
    front: float,
    volume: Array,
    piece: Array,
    thickness: float,
) -> tuple[Base, float, tuple[tuple[float, float], tuple[float, float]]]:
    """A base, the largest height of the centre of mass, and the ranges of its place across and along."""
    bottom = slope.height_mm + slope.rise * back - thickness
    depth, width = front - back, right - left
    rear, fore = thickness, thickness + slope.rise * depth
    own = (width * depth - (4 - np.pi) * CORNER_MM**2) * (rear + fore) / 2
    # the middle of a trapezium, along and up
    along = back + depth / 3 * (rear + 2 * fore) / (rear + fore)
    up = bottom + (rear**2 + rear * fore + fore**2) / (3 * (rear + fore))
    middle = np.array([(left + right) / 2, up, along])
    centers = []
    for fill in (1.0, LIGHT_FILL):
        mass = np.append(volume, fill * own)
        centers.append(mass @ np.vstack([piece, middle]) / mass.sum())
    margins = [
        min(c[0] - left, right - c[0], c[2] - back, front - c[2]) - CHAMFER_MM for c in centers
    ]
    heights = [float(c[1] - bottom) for c in centers]
    tip = min(np.degrees(np.arctan2(m, h)) for m, h in zip(margins, heights, strict=True))
    base = Base(slope, left, right, back, front, bottom, float(margins[0]), heights[0], float(tip))
    x = tuple(sorted(float(c[0]) for c in centers))
    z = tuple(sorted(float(c[2]) for c in centers))
    return base, max(heights), ((x[0], x[1]), (z[0], z[1]))
