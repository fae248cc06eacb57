"""Compare silhouettes, and turn views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.view import ViewGeometry


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


def turn_view(geometry: ViewGeometry, middle: Array, axis: Array, angle: float) -> ViewGeometry:
    """Rotate the view by -`angle` (radians), which shows the part rotated by `angle`."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)  # Rodrigues
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = middle - rotation @ middle
    return geometry.in_part(pose)
