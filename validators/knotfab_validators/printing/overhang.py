"""Undersides that need support: their area, and the support that would stand under them."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.columns import Columns

__all__ = ["ANGLE_TOLERANCE", "above", "overhang_areas", "support_volume"]


ANGLE_TOLERANCE = 1e-5  # the rounding of a normal's z in single precision
BED_MM = 1e-3  # the first layer's top may be read so far off the bed


def overhang_areas(mesh: Mesh, max_overhang_deg: float, layer_mm: float) -> Array:
    """Return (m,) mm², how much of each face overhangs: looks down, steeper than the limit, off the bed.

    A face overhangs by 90° less the angle between its normal and straight down: a vertical wall by
    0°, a ceiling by 90°. It counts from above the first layer on (z > `layer_mm`), where it is cut.
    """
    normals, areas = mesh.normals
    steep = _steep(normals, max_overhang_deg)
    over: Array = np.zeros(len(areas))
    over[steep] = areas[steep] * above(mesh.vertices[mesh.faces[steep], 2], layer_mm + BED_MM)
    return over


def support_volume(
    mesh: Mesh, grid: Columns, max_overhang_deg: float, layer_mm: float
) -> tuple[float, Array]:
    """Return volume, mm³, of the columns from overhanging faces down to the surface below or the bed.

    Solid columns: what a slicer prints of them is a sparse grating. Per column of the grid its
    height times the cell's area (the midpoint rule: off by about half a cell along the rim of each
    overhang). Also the place (3,) of the tallest one's top, NaN where there is none.
    """
    normals, _ = mesh.normals
    needs = _steep(normals, max_overhang_deg)[grid.face] & (grid.low > layer_mm + BED_MM)
    same = np.diff(grid.column, prepend=-1) == 0
    floor = np.where(same, np.concatenate([[0.0], grid.high[:-1]]), 0.0)
    height = np.where(needs, grid.low - np.maximum(floor, 0.0), 0.0).clip(min=0.0)
    if not height.any():
        return 0.0, np.full(3, np.nan)
    tallest = np.array([height.argmax()])
    return float(height.sum()) * grid.cell**2, grid.places(tallest)[0]


def above(z: Array, level: float) -> Array:
    """Return (k,) the share of triangles, heights of corners (k, 3), that lies above a level."""
    low, middle, high = np.sort(z, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        upper = (high - level) ** 2 / ((high - low) * (high - middle))
        lower = 1 - (level - low) ** 2 / ((high - low) * (middle - low))
    share: Array = np.where(middle <= level, upper, lower)
    share = np.where(low >= level, 1.0, share)
    return np.where(high <= level, 0.0, share)


def _steep(normals: Array, max_overhang_deg: float) -> Mask:
    limit = np.sin(np.radians(max_overhang_deg))
    steep: Mask = -normals[:, 2] > limit + ANGLE_TOLERANCE
    return steep
