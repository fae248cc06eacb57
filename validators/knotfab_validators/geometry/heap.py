"""Estimate a mesh's work: about how many pairs of its faces have bounding boxes that overlap."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.compiled import compiled
from knotfab_validators.geometry.mesh import Mesh, bound_triangles

__all__ = ["TooMuchWork", "bound_work", "overlapping_boxes", "tell_heap"]

# faces of each of some sizes whose boxes are compared with all others
SAMPLES = 6
MOST_BOXES = 10_000_000  # pairs of overlapping boxes that are tested, or as many as
MOST_A_FACE = 100  # factor to the number of faces: a good part has some 10 to 40 a face


class TooMuchWork(Exception):
    """A part asks a check for more than the check may do; the message says of what."""


def bound_work(count: float, most: int, what: str) -> None:
    """Let a check go on as long as it has no more than so much to do.

    Raises:
        TooMuchWork: there is more of `what`.
    """
    if count > most:
        raise TooMuchWork(f"{count:.0f} {what}, more than {most}")


def tell_heap(mesh: Mesh, boxes: float | None = None) -> str | None:
    """Say why a mesh is such a heap of faces that no tree of boxes helps; None where it is not.

    Args:
        boxes: about how many pairs of boxes overlap, where that is known.
    """
    boxes = overlapping_boxes(mesh) if boxes is None else boxes
    if boxes <= max(MOST_BOXES, MOST_A_FACE * len(mesh.faces)):
        return None
    return f"some {boxes:.1g} pairs of faces have boxes that overlap"


@compiled
def _count_met(low: Array, high: Array, face: int) -> int:
    """Count how many boxes, from low to high (m, 3), meet that of one face, itself among them."""
    met = 0
    for k in range(len(low)):
        apart = False
        for axis in range(3):
            apart |= low[k, axis] > high[face, axis] or high[k, axis] < low[face, axis]
        met += not apart
    return met


def overlapping_boxes(mesh: Mesh) -> float:
    """Return about how many pairs of faces have bounding boxes that overlap, from a few faces of every size.

    A few long faces aslant may have more overlaps than all others together: by size the faces are told
    apart in layers, each 16 times as many as the one before.
    """
    low, high = bound_triangles(*mesh.vertices[mesh.faces].swapaxes(0, 1))
    count = len(mesh.faces)
    order = np.argsort(-np.linalg.norm(high - low, axis=1), kind="stable")
    draw = np.random.default_rng(0)
    total, first = 0.0, 0
    while first < count:
        layer = order[first : max(SAMPLES, 16 * first)]
        met = 0
        chosen = draw.permutation(layer)[:SAMPLES]
        for face in chosen:
            met += _count_met(low, high, int(face)) - 1
        total += met / len(chosen) * len(layer)
        first += len(layer)
    return total / 2
