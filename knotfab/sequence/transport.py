"""Carrying a knot from one picture to the next along a smooth displacement, every step certified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.geometry.certificate import certify
from knotfab.geometry.neighbours import find_neighbours
from knotfab.geometry.polylines import Rings, dot
from knotfab.sequence.registration import register

__all__ = ["Transported", "transport"]

Array = NDArray[np.float64]

_SKIP = 6  # as in the flow: nearer pairs along the curve are always tested
_LONGEST = 0.5  # tube radii that a vertex goes in one step
_SHORTEST = 1e-3  # of the way


@dataclass(frozen=True)
class Transported:
    """Where the vertices (N, 3) came to, mm, and the account of the way."""

    points: Array
    reached: float  # share of the way
    steps: int
    refused: int
    least_margin: float  # mm


def transport(
    points: Array,
    rings: Rings,
    old: MultiPolygon,
    new: MultiPolygon,
    light_mm: float,
    radius: float,
    furthest_mm: float,
) -> Transported:
    """Move the vertices along their rays' displacement from silhouette `old` to `new`.

    A vertex keeps its depth; seen from the light it moves as the plane z = 0 does. Where a step is
    refused it is halved; where none is short enough the way ends there, and the flow goes on.

    Args:
        light_mm: of the light from the middle of the piece.
        furthest_mm: no vertex goes further than this.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    shift = register(old, new, 6.0 * radius).at(points[:, :2] / shrink) * shrink
    length = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, furthest_mm / np.maximum(length, 1e-12))[:, None]
    whole = np.column_stack([shift, np.zeros(len(points))])
    most = float(np.sqrt(dot(whole, whole).max()))
    stride = longest = min(1.0, _LONGEST * radius / max(most, 1e-12))
    here, share, steps, refused, margin = points, 0.0, 0, 0, np.inf
    while share < 1.0:
        ahead = min(1.0, share + stride)
        step = points + ahead * whole - here
        edge = here[rings.next] - here
        reach = 2.5 * float(np.sqrt(dot(edge, edge).max())) + 2.0 * radius
        verdict = certify(here, step, rings, find_neighbours(here, rings, reach, _SKIP))
        if not verdict.valid:
            refused += 1
            stride *= 0.5
            if stride < _SHORTEST:
                break
            continue
        here, share, steps = here + step, ahead, steps + 1
        margin = min(margin, verdict.margin)
        stride = min(longest, 1.5 * stride)
    return Transported(here, share, steps, refused, float(margin))
