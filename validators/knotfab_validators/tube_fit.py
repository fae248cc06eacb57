"""Whether part and knots belong together: the part's surface lies one tube radius from the centre lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .check import Check, at_most, skipped
from .read_knots import Curves
from .read_mesh import Mesh

__all__ = ["TubeFit", "check_tube", "tube_fit"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LIMIT = 0.1  # of the radius: facets, and rings between long edges in a tight bend, cost 2 to 5 %
REACH = 4.0  # radii; what is farther away is said to be that far, since trees are slow far out
MOST_SAMPLES = 2_000_000  # on absurdly long curves


@dataclass(frozen=True)
class TubeFit:
    """Both in radii, no more than is told apart (`REACH`), with the place (3,), mm, of the worst.

    `off` is the largest |distance - radius| of a mesh vertex from the centre lines; `bare` how much
    farther than a radius the nearest mesh vertex is from a point of the centre lines, at most.
    """

    off: float
    off_at: Array
    bare: float
    bare_at: Array


def tube_fit(mesh: Mesh, curves: Curves) -> TubeFit:
    """How well the surface of a bare tube fits its centre lines; the radius must be known."""
    from scipy.spatial import cKDTree

    if curves.radius_mm is None:
        raise ValueError("the tube's radius is not known")
    radius = curves.radius_mm
    vertices = mesh.vertices[np.unique(mesh.faces)]
    start = np.concatenate(curves.polygons)
    end = np.concatenate([np.roll(p, -1, axis=0) for p in curves.polygons])
    distance = _distance(vertices, start, end, radius / 4, REACH * radius)
    off = np.abs(distance - radius) / radius
    # A straight stretch needs no ring of its own, so its middle may be far from all vertices; at
    # the points of the polygon the tube must have one.
    near, _ = cKDTree(vertices).query(start, distance_upper_bound=REACH * radius)
    bare = np.minimum(near / radius, REACH) - 1
    i, j = _worst(off), _worst(bare)
    return TubeFit(float(off[i]), vertices[i], float(bare[j]), start[j])


def check_tube(mesh: Mesh, curves: Curves | None) -> Check:
    """`tube`: the mesh is the tube about these curves, within a tenth of its radius.

    What is proved of the knots (thickness, bend, type) holds for the part only if it is.
    """
    if curves is None or curves.radius_mm is None:
        lacking = "the knots" if curves is None else "the tube's radius"
        return skipped("tube", f"not given {lacking}")
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        return skipped("tube", "the mesh has no faces, or coordinates that are not finite")
    fit = tube_fit(mesh, curves)
    radius = curves.radius_mm
    if fit.bare > max(fit.off, LIMIT):
        measured, at = fit.bare, fit.bare_at
        what = "a knot without a tube about it"
    else:
        measured, at = fit.off, fit.off_at
        what = "largest deviation of the surface from one radius about the knots"
    return at_most(
        "tube",
        measured * radius,
        LIMIT * radius,
        "mm",
        f"{what}, at ({at[0]:.2f}, {at[1]:.2f}, {at[2]:.2f}) mm",
    )


def _distance(points: Array, start: Array, end: Array, step: float, reach: float) -> Array:
    """(n,) distance of points (n, 3) to segments `start` - `end` (k, 3), `reach` where farther.

    The tree holds samples at most `step` apart along the segments; the segments of the nearest
    samples are then measured exactly. A nearest segment that all of them miss would cost less
    than step² / (8 distance).
    """
    from scipy.spatial import cKDTree

    edge = end - start
    length = np.linalg.norm(edge, axis=1)
    step = max(step, float(length.sum()) / MOST_SAMPLES)
    pieces = np.maximum(np.ceil(length / step), 1).astype(np.int64)
    which = np.repeat(np.arange(len(start)), pieces)
    number = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    samples = start[which] + ((number + 0.5) / pieces[which])[:, None] * edge[which]
    _, nearest = cKDTree(samples).query(
        points, k=min(3, len(samples)), distance_upper_bound=reach + step
    )
    nearest = nearest.reshape(len(points), -1)
    best = np.full(len(points), reach)
    for column in range(nearest.shape[1]):
        found = nearest[:, column] < len(samples)
        at, p = which[nearest[found, column]], points[found]
        along = np.einsum("ij,ij->i", p - start[at], edge[at]) / length[at] ** 2
        foot = start[at] + np.clip(along, 0.0, 1.0)[:, None] * edge[at]
        best[found] = np.minimum(best[found], np.linalg.norm(p - foot, axis=1))
    return best


def _worst(values: Array) -> int:
    """The index of the largest value, or of a NaN."""
    return int(np.argmax(np.where(np.isnan(values), np.inf, values)))
