"""Measure how much of one silhouette is in another, and how well the picture is read from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.renderer import Renderer
from knotfab_validators.shadows.view import ViewGeometry

__all__ = ["ANGLES_DEG", "Overlap", "depth_ratio", "legibility", "overlap", "turn_view"]


ANGLES_DEG = (15, 30, 45, 60)


@dataclass(frozen=True)
class Overlap:
    """Intersection over union, and what share of the shadow, and of the target, they share."""

    iou: float
    precision: float
    recall: float


def overlap(shadow: Mask, target: Mask) -> Overlap:
    """Compare two masks (H, W) of one grid. Two empty masks are alike (1.0)."""
    both = int(np.count_nonzero(shadow & target))
    n, m = int(np.count_nonzero(shadow)), int(np.count_nonzero(target))
    either = n + m - both
    return Overlap(
        iou=both / either if either else 1.0,
        precision=both / n if n else float(m == 0),
        recall=both / m if m else float(n == 0),
    )


def depth_ratio(points: Array, geometry: ViewGeometry) -> float:
    """Return the extent of points (n, 3) along the view's axis over the larger of their extents across it."""
    along = float(np.ptp(points @ geometry.axis))
    across = max(float(np.ptp(points @ geometry.right)), float(np.ptp(points @ geometry.up)))
    return along / across if across > 0 else float("inf")


def legibility(
    renderer: Renderer,
    vertices: Array,
    geometry: ViewGeometry,
    target: Mask,
    *,
    angles_deg: tuple[int, ...] = ANGLES_DEG,
    size: int = 384,
) -> dict[str, float]:
    """Measure how much of the target is left when the part is turned: angle -> largest IoU.

    The part is turned about the middle of its bounding box to both sides (about the view's
    upright axis) and up and down (about its horizontal one); both silhouettes are cropped and
    stretched to their bounding boxes, here to `size` x `size` pixels.

    Args:
        renderer: renderer of the mesh whose `vertices` (n, 3) these are, in scene coordinates.
        geometry: the view, in the same coordinates. target: (H, W), the picture's silhouette.
    """
    if not (target.any() and len(vertices)):
        return {str(angle): 0.0 for angle in angles_deg}
    wanted = _stretch(target, size)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    geometry = geometry.flat  # nobody looks at a wall
    result = {}
    for angle in angles_deg:
        best = 0.0
        for axis in (geometry.up, geometry.right):
            for signed in (angle, -angle):
                turned = turn_view(geometry, middle, axis, np.radians(signed))
                pixels, w = turned.project(vertices)
                if (w <= 0).any():
                    continue  # turned into the light: there is no silhouette to read
                # columns are summed: numpy takes twenty times as long for rows of two numbers
                low, high = (np.array([f(c) for c in pixels.T]) for f in (np.min, np.max))
                seen = renderer.render(_window(turned, low, high, size), behind=True)
                best = max(best, overlap(seen, wanted).iou)
        result[str(angle)] = best
    return result


def turn_view(geometry: ViewGeometry, middle: Array, axis: Array, angle: float) -> ViewGeometry:
    """Return the view as the part sees it when turned by `angle` (radians): turned the other way instead."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)  # Rodrigues
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = middle - rotation @ middle
    return geometry.in_part(pose)


def _window(geometry: ViewGeometry, low: Array, high: Array, size: int) -> ViewGeometry:
    """Return the view of the rectangle `low` to `high` (pixels) alone, on `size` x `size` pixels."""
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
    """Return the mask's bounding box on `size` x `size` pixels, each the pixel square under its centre."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    at = (np.arange(size) + 0.5) / size
    i = rows[0] + (at * (rows[-1] - rows[0] + 1)).astype(int)
    j = columns[0] + (at * (columns[-1] - columns[0] + 1)).astype(int)
    return mask[np.ix_(i, j)]
