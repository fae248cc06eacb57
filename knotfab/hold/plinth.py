"""The base of a stand: below every view's frame, seen from its light, and as large as the piece needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.scene.camera import Camera

Rectangle = tuple[float, float, float, float]  # left, right, back and front, mm

CORNER_MM = 6.0  # radius of the base's corners
# the underside's edge is cut off by this: the print on the desk is so much smaller
CHAMFER_MM = 0.6
EDGE_MM = 2.0  # the least from a post's root to the edge of the base
WALL_GAP_MM = 2.0  # between base and wall
UNIT: Rectangle = (-1.0, 1.0, -1.0, 1.0)
HUNG = "Use --mount hang, or --mount none"  # what needs no base
# a wall farther away leaves a piece more depth, which takes this share of what it gives; and whole 5 mm
DEEPER, STEP_MM = 0.5, 5.0
FARTHEST = 3.0  # times its distance, within which a farther wall is advised
ROUNDS = 40  # rounds of the search for a size, each of which nearly halves the range


@dataclass(frozen=True)
class Slope:
    """The plane of the base's top, which no light sees inside its frame.

    `axes` (3, 3) has rows: the first view's right, up, and out (level, towards the light). In these
    coordinates the top is `up = height + rise * out`.
    """

    axes: Array
    height_mm: float
    rise: float

    @property
    def normal(self) -> Array:
        """Unit vector upwards, (3,)."""
        up: Array = self.axes[1] - self.rise * self.axes[2]
        return np.asarray(up / np.linalg.norm(up))

    def above(self, points: Array) -> Array:
        """Return how far above the plane points (n, 3) lie, straight up, mm."""
        own = points @ self.axes.T
        return np.asarray(own[:, 1] - self.height_mm - self.rise * own[:, 2])

    def lower(self, by_mm: float) -> Slope:
        """Return the plane `by_mm` farther down."""
        return Slope(self.axes, self.height_mm - by_mm, self.rise)

    def no_fall(self, front: float) -> Slope:
        """Return the plane, made level at the height of its front if it falls towards a low light."""
        if self.rise >= 0:
            return self
        return Slope(self.axes, self.height_mm + self.rise * front, 0.0)


def slope_below(cameras: Sequence[Camera], rectangle: Rectangle = UNIT) -> Slope:
    """Find the highest plane, level across the first view, below all frames over a rectangle.

    With one view that is the plane through the light and the lower edge of the frame, wherever the
    rectangle is.

    Args:
        rectangle: left, right, back and front, in the first view's axes, mm.

    Raises:
        SceneError: a light looks down so steeply that whatever stands below the piece is in its
            picture.
    """
    own = [_slope_of(camera) for camera in cameras]
    axes = own[0].axes
    left, right, back, front = rectangle
    # a plane is least at an end of an edge
    low, high = (
        min(
            -float(slope.above(np.array([[x, 0.0, z]]) @ axes)[0])
            for slope in own
            for x in (left, right)
        )
        for z in (back, front)
    )
    rise = (high - low) / (front - back)
    return Slope(axes, low - rise * back, rise)


def _slope_of(camera: Camera) -> Slope:
    """Return the plane through one light and the lower edge of its frame."""
    axes = camera.level_axes
    edge = axes @ (camera.corner + (camera.height - 0.5) * camera.dv)
    light = axes @ camera.eye
    before = float(light[2] - edge[2])
    if before <= 0:
        raise SceneError(
            "the stand",
            "a view looks down so steeply that a base below the piece would stand in its picture",
            f"{HUNG}, or a smaller elevation_deg",
        )
    rise = float(light[1] - edge[1]) / before
    return Slope(axes, float(edge[1] - rise * edge[2]), rise)


@dataclass(frozen=True)
class Masses:
    """Solids, each by its volume, mm³ (n,), and its centre of mass (n, 3) in the scene."""

    volume: Array
    center: Array


@dataclass(frozen=True)
class Base:
    """A block on the desk, in the axes of its slope: right, up and out, mm.

    `left`, `right`, `back` and `front` bound it; `bottom` is the desk. `margin_mm` is how far
    inside its foot the centre of mass of the whole part lies, `height_mm` how high it lies. `tip_deg` is how
    far the part can be tipped, whether the base is solid or printed with little infill.
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

    @property
    def corners(self) -> Array:
        """The corners in the scene, (8, 3), mm."""
        own = [
            [x, y, z]
            for x in (self.left, self.right)
            for z in (self.back, self.front)
            for y in (self.bottom, self.slope.height_mm + self.slope.rise * z)
        ]
        return np.array(own) @ self.slope.axes


def base_for(
    slope: Slope,
    feet: Array,
    root_mm: float,
    weights: Masses,
    cameras: Sequence[Camera],
    thickness_mm: float,
    tip_deg: float,
    play: float = 0.0,
) -> Base:
    """Find the smallest base that holds all feet and does not tip before `tip_deg`.

    Args:
        feet: (n, 3) where posts meet the top. root_mm: their radius there.
        weights: everything that stands on the base. thickness_mm: of the base at its back.
        play: share of its sides by which it may come nearer to a wall.

    Raises:
        SceneError: a wall is in the way of a base that large, or it would stand in a picture.
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
        base = _measure_base(slope, left, right, back, front, weights.volume, piece, thickness_mm)
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
    corners = found.corners
    room = min(float((corners @ c.receiver[:3] + c.receiver[3]).min()) for c in cameras)
    size = f"a base that holds the piece is {right - left:.0f} x {front - back:.0f} mm large"
    room += play * (right - left + front - back)
    if room < WALL_GAP_MM or found.tip_deg < tip_deg - 0.01:
        wall = max(float(c.receiver[3]) for c in cameras)
        far = STEP_MM * np.ceil((wall + (1 + DEEPER) * (WALL_GAP_MM - room)) / STEP_MM + DEEPER)
        raise SceneError(
            "the stand",
            f"{size}, and comes to within {room:.1f} mm of the wall",
            f"Use --wall-distance {far:g}" if wall < far < FARTHEST * wall else HUNG,
        )
    if max(float(_slope_of(c).above(corners).max()) for c in cameras) > 1e-6:
        raise SceneError("the stand", f"{size}, and would stand in a picture", HUNG)
    return found


def _measure_base(
    slope: Slope,
    left: float,
    right: float,
    back: float,
    front: float,
    volume: Array,
    piece: Array,
    thickness: float,
) -> tuple[Base, float, tuple[tuple[float, float], tuple[float, float]]]:
    """Measure a base of this outline; return it, and the bounds of the part's centre of mass."""
    bottom = slope.height_mm + slope.rise * back - thickness
    depth, width = front - back, right - left
    rear, fore = thickness, thickness + slope.rise * depth
    own = (width * depth - (4 - np.pi) * CORNER_MM**2) * (rear + fore) / 2
    # (along, up) is the middle of a trapezium
    along = back + depth / 3 * (rear + 2 * fore) / (rear + fore)
    up = bottom + (rear**2 + rear * fore + fore**2) / (3 * (rear + fore))
    middle = np.array([(left + right) / 2, up, along])
    centers = []
    # a share of a printed base's volume: it must stand whether it is filled or not
    for fill in (1.0, 0.25):
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
