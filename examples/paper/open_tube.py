"""From an open centre line to a surface: mitred prisms as in `tube.py`, and a cap on either end.

A round cap makes the tube all points within the radius of the line, which is what the validators take
an open curve for. A flat one ends it where the line ends.
"""

from __future__ import annotations

from math import pi, sin, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from knotfab.arrays import Array
from knotfab.geometry.tube import (
    _check_points,
    _require_room,
    _require_unfolded,
    _side_faces,
    _transport,
)

Faces = NDArray[np.int32]
Cap = Literal["round", "flat"]


def open_volume(points: Array, radius_mm: float, cap: Cap = "round") -> float:
    """Volume of the tube about an open polyline, mm³: pi r² L, and a ball's with round caps."""
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return pi * radius_mm**2 * (length + (4.0 / 3.0 * radius_mm if cap == "round" else 0.0))


def sweep_open(
    points: Array, radius_mm: float, sides: int, cap: Cap = "round"
) -> tuple[Array, Faces]:
    """The tube of `radius_mm` around the open polyline `points`, as a watertight mesh.

    The section has the tube's area, as in `tube.sweep`, and a round cap, of `sides` // 4 rings and a
    tip, is made longer than the radius until it has the half ball's volume.

    Args:
        points: (n, 3) mm, n >= 2, both ends included.
        radius_mm: radius of the tube, > 0.
        sides: corners of a ring, >= 3.
        cap: "round" (about half a ball) or "flat".

    Returns:
        vertices (m, 3) float64 mm and faces (k, 3) int32, turned outwards.

    Raises:
        ValueError: wrong shapes or numbers that are no lengths.
        SceneError: the polyline bends too tightly for the radius, so that a mitre would fold.
    """
    p = _check_points(points, radius_mm, sides, least=2)
    edges = np.diff(p, axis=0)
    lengths = np.sqrt(np.einsum("ij,ij->i", edges, edges))
    _require_room(p, edges, lengths, radius_mm, closed=False)
    along = edges / lengths[:, None]
    mitre = np.concatenate([along[:1], along[1:] + along[:-1]])
    mitre /= np.sqrt(np.einsum("ij,ij->i", mitre, mitre))[:, None]
    u, _ = _transport(along, mitre)
    v = np.cross(along, u)
    step = 2 * pi / sides
    wide = sqrt(step / sin(step))
    angle = np.arange(sides) * step
    across = radius_mm * wide * np.cos(angle)
    upward = radius_mm * wide * np.sin(angle)
    # the corners of each segment's first ring slide along it into the plane of its mitre
    section = across[None, :, None] * u[:, None] + upward[None, :, None] * v[:, None]
    slope = -1.0 / np.einsum("ij,ij->i", along, mitre)
    slide = slope[:, None] * np.einsum("nsj,nj->ns", section, mitre)
    slide[0] = 0.0
    following = np.concatenate([slide[1:], np.zeros((1, sides))])
    _require_unfolded(lengths, slide, following, p)
    rings = [
        p[:-1, None] + section + slide[..., None] * along[:, None],
        p[None, -1:] + section[-1:],
    ]
    body = np.concatenate(rings)
    head, tail = _cap(radius_mm, sides, cap)
    first = [p[0] + s * section[0] - h * along[0] for s, h in head[::-1]]
    last = [p[-1] + s * section[-1] + h * along[-1] for s, h in head]
    rows = np.concatenate(
        [np.array(first).reshape(-1, sides, 3), body, np.array(last).reshape(-1, sides, 3)]
    )
    tips = np.stack([p[0] - tail * along[0], p[-1] + tail * along[-1]])
    vertices = np.concatenate([rows.reshape(-1, 3), tips])
    return vertices, _faces(len(rows), sides)


def _cap(radius: float, sides: int, cap: Cap) -> tuple[list[tuple[float, float]], float]:
    """Polylines of a cap as (share of the section, height), outwards, and the height of its tip."""
    if cap == "flat":
        return [], 0.0
    count = max(1, sides // 4)
    latitude = 0.5 * pi * np.arange(count + 1) / count
    share, height = np.cos(latitude), np.sin(latitude)
    share[-1] = 0.0
    # frusta between similar sections
    volume = np.diff(height) * (share[1:] ** 2 + share[1:] * share[:-1] + share[:-1] ** 2) / 3
    height *= radius * (2.0 / 3.0) / float(volume.sum())
    return list(zip(share[1:-1].tolist(), height[1:-1].tolist(), strict=True)), float(height[-1])


def _faces(rings: int, sides: int) -> Faces:
    """Sides between the rings, and a fan from either tip (the last two vertices)."""
    side = _side_faces(rings, sides, 0)[: 2 * (rings - 1) * sides]
    k = np.arange(sides)
    after = (k + 1) % sides
    base, tip = (rings - 1) * sides, rings * sides
    first = np.stack([after, k, np.full(sides, tip)], axis=1)
    last = np.stack([base + k, base + after, np.full(sides, tip + 1)], axis=1)
    return np.concatenate([side, first, last]).astype(np.int32)
