"""The shadow of a part as it is printed: a stack of its slices, each as thick as a layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.files.scene import Effects
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.sampling import number_runs
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.shadows.winding import Linework, winding_raster

__all__ = ["layer_shift_px", "layered_mask", "measure_layers", "shows_layers"]

LAYER_TOLERANCES = 2.0  # steps of an outline that are smaller are not looked at


def layer_shift_px(vertices: Array, geometry: ViewGeometry, layer_mm: float) -> float:
    """How far half a layer, along z, shifts the shadow of any of vertices (n, 3), px; all in print pose."""
    before = vertices[geometry.project(vertices)[1] < geometry.w_of_receiver]
    if len(before) == 0:
        return 0.0
    step = np.array([0.0, 0.0, 0.5 * layer_mm])
    here = geometry.project(before)[0]
    shifts = [np.linalg.norm(geometry.project(before + s)[0] - here, axis=1) for s in (step, -step)]
    return float(np.max(shifts))


def shows_layers(effects: Effects, shift_px: float) -> bool:
    """Whether the slices are looked at: the scene says so, or their steps exceed the threshold."""
    if effects.layers != "auto":
        return effects.layers == "on"
    return shift_px > LAYER_TOLERANCES * effects.tolerance_px


def _contours(mesh: Mesh, layer_mm: float) -> tuple[Array, Array, Ints]:
    """Starts and ends (k, 3) of all slices' edges, matter on their left from above, and their layers (k,).

    A slice is cut in the middle of its layer. Of a face that turns anticlockwise about its outward normal the
    slice runs from the side that leads down through it to the one that leads up. Both faces at a side cut it
    at the same point, to the last bit.
    """
    z = mesh.vertices[:, 2] / layer_mm - 0.5  # slices lie at whole numbers
    first = np.ceil(z).astype(np.int64)  # at and above which slices a corner is not above
    low, high = first[mesh.faces].min(axis=1), first[mesh.faces].max(axis=1)
    face, layer = number_runs(high - low)
    layer = layer + low[face]
    corners = mesh.faces[face]
    ends: dict[bool, Array] = {}
    for upward in (False, True):
        found = np.zeros((len(face), 3))
        for side in range(3):
            a, b = corners[:, side], corners[:, (side + 1) % 3]
            over_a, over_b = first[a] > layer, first[b] > layer
            some = (over_b & ~over_a) if upward else (over_a & ~over_b)
            one, other = np.minimum(a, b)[some], np.maximum(a, b)[some]
            share = ((layer[some] - z[one]) / (z[other] - z[one]))[:, None]
            cut = (1 - share) * mesh.vertices[one] + share * mesh.vertices[other]
            cut[:, 2] = (layer[some] + 0.5) * layer_mm
            found[some] = cut
        ends[upward] = found
    return ends[False], ends[True], layer


def layered_mask(mesh: Mesh, geometry: ViewGeometry, layer_mm: float) -> Mask:
    """(height, width) the shadow of a closed mesh's slices, each drawn up by half a layer and down by half.

    A ray meets a slice where it meets its upper face or one of its walls; the sum of all of these, each
    turned to positive area in the picture, is not zero exactly there. The boundary of an upper face is its
    contour. Slices that reach the receiver, or lie behind it, throw no shadow.

    Args:
        mesh: in print pose, z up. geometry: the view in the same coordinates.
    """
    start, end, layer = _contours(mesh, layer_mm)
    if len(layer) == 0:
        return np.zeros((geometry.height, geometry.width), dtype=bool)
    half = np.array([0.0, 0.0, 0.5 * layer_mm])
    corners = (start + half, end + half, end - half, start - half)
    seen = [geometry.project(c) for c in corners]
    behind = np.max([w for _, w in seen], axis=0) >= geometry.w_of_receiver
    number = layer - layer.min()
    kept = ~(np.bincount(number, behind) > 0)[number]
    a, b, c, d = (pixels[kept] for pixels, _ in seen)
    twice = np.bincount(number[kept], _cross(a, b))  # the contour's area in the picture
    turned = np.where(twice < 0, -1, 1)[number[kept]]
    wall = np.where(_cross(b - a, c - a) + _cross(c - a, d - a) < 0, -1, 1)
    lines = Linework(
        np.concatenate([a, a, b, c, d]),
        np.concatenate([b, b, c, d, a]),
        np.concatenate([turned, wall, wall, wall, wall]),
    )
    mask: Mask = winding_raster(lines, geometry.width, geometry.height) != 0
    return mask


def _cross(a: Array, b: Array) -> Array:
    """(n,) of vectors (n, 2)."""
    result: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result


def measure_layers(
    mesh: Mesh, geometry: ViewGeometry, layer_mm: float, target: Mask, smooth: Mask
) -> dict[str, Any]:
    """What the steps of a printed part do to its shadow, on the pixels of `target` (H, W).

    Returns:
        "layer_mm"; "shift_px", that half a layer shifts a shadow, at most; "iou" of the slices' shadow and
        the picture, "iou_smooth" of that of the mesh itself, `smooth` (H, W); "samples": slices.
    """
    layers = int(np.ceil(np.ptp(mesh.vertices[:, 2]) / layer_mm))
    return {
        "layer_mm": layer_mm,
        "shift_px": layer_shift_px(mesh.vertices, geometry, layer_mm),
        "iou": overlap(layered_mask(mesh, geometry, layer_mm), target).iou,
        "iou_smooth": overlap(smooth, target).iou,
        "samples": layers,
    }
