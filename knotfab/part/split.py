"""Facts about each body of a piece that are needed to print, or cut, it by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from knotfab.base.arrays import Array, Indices
from knotfab.knots import Knots
from knotfab.mount.mount import Mounted
from knotfab.part.cut import Line
from knotfab.part.plates import Printable
from knotfab.scene.camera import Camera

__all__ = ["can_be_split", "list_printables", "measure_hiding"]


# radii of the tube's shadow from the outline, from which on a place is well inside
FULLY_RADII = 3.0
CROSS = np.concatenate([np.eye(3), -np.eye(3)])


def can_be_split(mounted: Mounted) -> bool:
    """Tell whether every knot is a body of its own: without a mount, or on dowels."""
    return mounted.stand is None and (mounted.wall is None or mounted.wall.settings.foot == "dowel")


def list_printables(
    mounted: Mounted,
    knots: Knots,
    cameras: Sequence[Camera],
    masks: Sequence[NDArray[np.bool_]],
) -> list[Printable]:
    """List the bodies of a piece that can be split, with their centre lines (scene coordinates).

    Args:
        masks: (H, W) the silhouette of each view, in its camera's pixels.
    """
    found = []
    for number, (body, name) in enumerate(zip(mounted.bodies, mounted.names, strict=True)):
        points = knots.knots[number].points
        barred, beside, beside_of = _pegs(mounted, number, points, knots.radius_mm)
        shown = np.min(
            [
                measure_hiding(points, knots.radius_mm, c, m)
                for c, m in zip(cameras, masks, strict=True)
            ],
            axis=0,
        )
        line = Line(points, knots.radius_mm, shown, barred, beside, beside_of)
        found.append(Printable(name, body, line))
    return found


def measure_hiding(
    points: Array, radius_mm: float, camera: Camera, mask: NDArray[np.bool_]
) -> Array:
    """Measure (n,) from 0 on the picture's outline, or off the picture, to 1 three tube radii inside it."""
    pixel = float(np.linalg.norm(camera.du))
    depth = np.asarray(distance_transform_edt(mask)) * pixel
    uv = np.rint(camera.project(points)).astype(np.int64)
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] < mask.shape[1]) & (uv[:, 1] < mask.shape[0])
    value = np.zeros(len(points))
    value[inside] = depth[uv[inside, 1], uv[inside, 0]]
    return (value / (FULLY_RADII * radius_mm)).clip(max=1.0)


def _pegs(
    mounted: Mounted, knot: int, points: Array, radius: float
) -> tuple[NDArray[np.bool_], Array, Indices]:
    """Find the vertices next to a peg, the points that bound the knot's pegs, and their vertices."""
    barred = np.zeros(len(points), dtype=np.bool_)
    beside, beside_of = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for peg in mounted.wall.pegs if mounted.wall is not None else ():
        way = peg.foot - peg.top
        length = float(np.linalg.norm(way))
        way = way / length
        at = ((points - peg.top) @ way).clip(0.0, length)
        away = np.linalg.norm(points - peg.top - at[:, None] * way, axis=1)
        wide = max(peg.root_radius_mm, peg.foot_radius_mm, peg.top_radius_mm)
        # the pin and hole of a cut must also not lie under the peg's top
        near = np.linalg.norm(points - peg.top, axis=1) <= 4.0 * radius + wide
        if peg.knot == knot:
            assert mounted.wall is not None
            end = peg.foot + mounted.wall.settings.dowel_depth_mm * way
            box = np.concatenate([end + wide * CROSS, peg.foot + wide * CROSS])
            vertex = int(np.linalg.norm(points - peg.top, axis=1).argmin())
            beside.append(box)
            beside_of.append(np.full(len(box), vertex, dtype=np.int64))
            barred |= near
        barred |= away <= 2.0 * radius + wide  # tube radii from a peg's side
    return barred, np.concatenate(beside), np.concatenate(beside_of)
