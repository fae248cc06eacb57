"""Compare silhouettes and greys, and measure how readable the picture is from other directions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.render import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    pass

ANGLES_DEG = (15, 30, 45, 60)


@dataclass(frozen=True)
class Overlap:
    """Intersection over union, and the shares of the shadow and of the target that they have in common."""

    iou: float
    precision: float
    recall: float


def overlap(shadow: Mask, target: Mask) -> Overlap:
    """Compare two masks (H, W) on one grid. Two empty masks count as equal (1.0)."""
    both = int(np.count_nonzero(shadow & target))
    n, m = int(np.count_nonzero(shadow)), int(np.count_nonzero(target))
    either = n + m - both
    return Overlap(
        iou=both / either if either else 1.0,
        precision=both / n if n else float(m == 0),
        recall=both / m if m else float(n == 0),
    )


def depth_ratio(points: Array, geometry: ViewGeometry) -> float:
    """Return the extent of points (n, 3) along the view's axis over their larger extent across it."""
    along = float(np.ptp(points @ geometry.axis))
    across = max(float(np.ptp(points @ geometry.right)), float(np.ptp(points @ geometry.up)))
    return along / across if across > 0 else float("inf")


def see_aside(
    renderer: Renderer,
    vertices: Array,
    geometry: ViewGeometry,
    *,
    angles_deg: tuple[int, ...] = ANGLES_DEG,
    size: int = 384,
) -> dict[str, list[Mask]]:
    """Return the part's silhouettes by turning angle, each stretched to its bounding box.

    The part is turned about the middle of its bounding box to both sides (about the view's
    upright axis) and up and down (about its horizontal one); silhouettes are `size` x `size` pixels.

    Args:
        renderer: renderer of the mesh whose `vertices` (n, 3) these are, in scene coordinates.
        geometry: the view, in the same coordinates.
    """
    if not len(vertices):
        return {str(angle): [] for angle in angles_deg}
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    seen: dict[str, list[Mask]] = {}
    for angle in angles_deg:
        own = seen[str(angle)] = []
        for axis in (geometry.up, geometry.right):
            for signed in (angle, -angle):
                turned = turn_view(geometry, middle, axis, np.radians(signed))
                pixels, w = turned.project(vertices)
                if (w <= 0).any():
                    continue  # turned into the light: no silhouette to read
                # sum columns: numpy is twenty times slower on rows of two numbers
                low, high = (np.array([f(c) for c in pixels.T]) for f in (np.min, np.max))
                own.append(renderer.render(_window(turned, low, high, size), behind=True))
    return seen


def legibility(seen: Mapping[str, Sequence[Mask]], target: Mask) -> dict[str, float]:
    """Measure how much of the target (H, W) is left in the turned silhouettes: angle -> largest IoU.

    Both are cropped and stretched to their bounding boxes.
    """
    if not target.any():
        return dict.fromkeys(seen, 0.0)
    return {
        angle: max((overlap(m, _stretch(target, len(m))).iou for m in masks), default=0.0)
        for angle, masks in seen.items()
    }


def turn_view(geometry: ViewGeometry, middle: Array, axis: Array, angle: float) -> ViewGeometry:
    """Rotate the view by -`angle` (radians), which shows the part rotated by `angle`."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)  # Rodrigues
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = middle - rotation @ middle
    return geometry.in_part(pose)


def _window(geometry: ViewGeometry, low: Array, high: Array, size: int) -> ViewGeometry:
    """Restrict the view to the rectangle `low` to `high` (pixels), on `size` x `size` pixels."""
    su, sv = np.maximum(high - low, 1e-9) / size
    return replace(
        geometry,
        origin=geometry.origin + (low[0] + su / 2) * geometry.du + (low[1] + sv / 2) * geometry.dv,
        du=geometry.du * su,
        dv=geometry.dv * sv,
        width=size,
        height=size,
    )


def _stretch(mask: Mask, size: int) -> Mask:
    """Resample the mask's bounding box to `size` x `size` pixels, each from the pixel under its centre."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    at = (np.arange(size) + 0.5) / size
    i = rows[0] + (at * (rows[-1] - rows[0] + 1)).astype(int)
    j = columns[0] + (at * (columns[-1] - columns[0] + 1)).astype(int)
    return mask[np.ix_(i, j)]
