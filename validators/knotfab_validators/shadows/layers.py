"""The shadow of a part as it is printed: a stack of its slices, each as thick as a layer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Layers
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.compiled import compiled
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.shadows.winding import Linework, wound_mask

if TYPE_CHECKING:
    from knotfab_formats.scene import Switches

__all__ = ["layer_shift_px", "layered_mask", "measure_layers", "shows_layers"]

BLOCK = 64  # layers that are looked at together
LAYER_TOLERANCES = 2.0  # steps of an outline that are smaller are not looked at


def layer_shift_px(vertices: Array, geometry: ViewGeometry, layer_mm: float) -> float:
    """Measure how far half a layer along z shifts the shadow of any vertex (n, 3), px; all in print pose."""
    before = vertices[geometry.project(vertices)[1] < geometry.w_of_receiver]
    if len(before) == 0:
        return 0.0
    step = np.array([0.0, 0.0, 0.5 * layer_mm])
    here = geometry.project(before)[0]
    shifts = [np.linalg.norm(geometry.project(before + s)[0] - here, axis=1) for s in (step, -step)]
    return float(np.max(shifts))


def shows_layers(effects: Switches, shift_px: float, tolerance_px: float = 0.25) -> bool:
    """Tell whether the slices are looked at: the scene says so, or their steps exceed the threshold."""
    if effects.layers is not None:
        return effects.layers
    return shift_px > LAYER_TOLERANCES * tolerance_px


@compiled
def _contours(
    vertices: Array, faces: Ints, first: Ints, begin: int, stop: int, layer_mm: float
) -> tuple[Array, Array, Ints]:
    """Return starts and ends (k, 3) of slices' edges, matter on their left from above, and their layers (k,).

    A slice is cut in the middle of its layer. Of a face that turns anticlockwise about its outward normal the
    slice runs from the side that leads down through it to the one that leads up. Both faces at a side cut it
    at the same point, to the last bit.

    Args:
        first: for each vertex the layer in whose middle, or below which, it lies. begin, stop: the
            layers, from and up to.
    """
    low, high = np.empty(len(faces), dtype=np.int64), np.empty(len(faces), dtype=np.int64)
    count = 0
    for k in range(len(faces)):
        a, b, c = first[faces[k, 0]], first[faces[k, 1]], first[faces[k, 2]]
        low[k], high[k] = max(min(a, b, c), begin), min(max(a, b, c), stop)
        count += max(high[k] - low[k], 0)
    start, end = np.zeros((count, 3)), np.zeros((count, 3))
    number = np.empty(count, dtype=np.int64)
    cuts = 0
    for k in range(len(faces)):
        for layer in range(low[k], high[k]):
            number[cuts], height = layer, (layer + 0.5) * layer_mm
            for side in range(3):
                here, ahead = faces[k, side], faces[k, (side + 1) % 3]
                upward = first[ahead] > layer
                if (first[here] > layer) == upward:
                    continue
                one, other = vertices[min(here, ahead)], vertices[max(here, ahead)]
                share = (height - one[2]) / (other[2] - one[2])
                cut = end if upward else start
                cut[cuts, 0] = (1 - share) * one[0] + share * other[0]
                cut[cuts, 1] = (1 - share) * one[1] + share * other[1]
                cut[cuts, 2] = height
            cuts += 1
    return start, end, number


def layered_mask(mesh: Mesh, geometry: ViewGeometry, layer_mm: float) -> Mask:
    """Draw (height, width) the shadow of a closed mesh's slices, each drawn half a layer up and half down.

    A ray that meets a slice enters by that of its faces which is turned to the light, or by a wall that is.
    The sum of all of these, each turned to positive area in the picture, is not zero exactly there; the
    boundary of a face is its contour. Slices that reach the receiver, or lie behind it, throw no shadow.

    Args:
        mesh: in print pose, z up. geometry: the view in the same coordinates.
    """
    # the slices at and above which a vertex lies: slices lie half a layer above whole layers
    first = np.ceil(mesh.vertices[:, 2] / layer_mm - 0.5).astype(np.int64)
    vertices, faces = np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
    slices = (
        _contours(vertices, faces, first, begin, begin + BLOCK, layer_mm)
        for begin in range(int(first.min()), int(first.max()), BLOCK)
    )
    lines = (_slice_lines(*found, geometry, layer_mm) for found in slices)
    return wound_mask(lines, geometry.width, geometry.height)


def _slice_lines(
    start: Array, end: Array, layer: Ints, geometry: ViewGeometry, layer_mm: float
) -> Linework:
    """Return the boundaries of the parts of whole slices that rays meet, in the picture."""
    # the way to the face that is turned to the light
    half = np.where(geometry.light[2] > start[:, 2:], 0.5, -0.5) * [0.0, 0.0, layer_mm]
    number = layer - layer.min(initial=0)
    (a, nearer), (b, _) = geometry.project(start + half), geometry.project(end + half)
    _, farther = geometry.project(start - half)
    behind = np.maximum(nearer, farther) >= geometry.w_of_receiver
    kept = ~(np.bincount(number, behind) > 0)[number] if len(number) else behind
    along = end - start
    to_light = geometry.light - start
    turned = kept & (along[:, 1] * to_light[:, 0] - along[:, 0] * to_light[:, 1] > 0)
    c, d = (geometry.project((x - half)[turned])[0] for x in (end, start))
    p, q = a[turned], b[turned]
    a, b, number = a[kept], b[kept], number[kept]
    face = np.where(np.bincount(number, _cross(a, b)) < 0, -1, 1)[number]
    wall = np.where(_cross(q - p, c - p) + _cross(c - p, d - p) < 0, -1, 1)
    return Linework(
        np.concatenate([a, p, q, c, d]),
        np.concatenate([b, q, c, d, p]),
        np.concatenate([face, wall, wall, wall, wall]),
    )


def _cross(a: Array, b: Array) -> Array:
    """Return (n,) of vectors (n, 2)."""
    result: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result


def measure_layers(
    mesh: Mesh,
    geometry: ViewGeometry,
    layer_mm: float,
    target: Mask,
    smooth: Mask,
    shift_px: float,
    within: Mask | None = None,
) -> Layers:
    """Measure what the steps of a printed part do to its shadow, on the pixels of `target` (H, W).

    Args:
        shift_px: shift of `layer_shift_px`.
        smooth: (H, W) the shadow of the mesh itself.
        within: (H, W) where shadow counts, of a wall that ends; None: everywhere.
    """
    layers = int(np.ceil(np.ptp(mesh.vertices[:, 2]) / layer_mm))
    shadow = layered_mask(mesh, geometry, layer_mm)
    return Layers(
        layer_mm=layer_mm,
        shift_px=shift_px,
        iou=overlap(shadow if within is None else shadow & within, target).iou,
        iou_smooth=overlap(smooth, target).iou,
        samples=layers,
    )
