"""Cut a body where its tube is cut, and give the pieces pins and holes that hold them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.meshes import Mesh, as_manifold, as_mesh
from knotfab.mount.solids import place_along
from knotfab.part.cut import CLEARANCE_MM, Cut

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["KERF_MM", "CutPiece", "cut_body"]

KERF_MM = 0.01  # the matter that is lost at a cut
DEEPER_MM = 0.3  # a hole is deeper than its pin is long, by this
SIDES = 32


@dataclass(frozen=True)
class CutPiece:
    """A piece of a cut body: its mesh, and the stretch (n, 3) of centre line that it holds."""

    mesh: Mesh
    points: Array


def cut_body(
    body: Mesh, points: Array, radius: float, gap_mm: float, cuts: Sequence[Cut]
) -> list[CutPiece]:
    """Cut a tube (and what hangs on it) at two or more places; the pieces in order of the cuts.

    A slice of `KERF_MM` is taken out at each cut. Of the pieces beside it, one gets a pin with a
    chamfered tip, the other a hole that is wider by `CLEARANCE_MM` all round and a little deeper.

    Args:
        body: closed mesh, whose tube has the centre line `points` (n, 3).
        gap_mm: to the nearest other strand, which the slice must not touch.
        cuts: in order of their vertices.

    Raises:
        SceneError: the cuts do not part the body into that many pieces.
    """
    from manifold3d import Manifold, OpType

    solid = as_manifold(body)
    slices = [
        place_along(
            Manifold.cylinder(KERF_MM, radius + 0.45 * gap_mm, -1, SIDES, True),
            cut.along,
            cut.point,
        )
        for cut in cuts
    ]
    parts = Manifold.batch_boolean([solid, *slices], OpType.Subtract).decompose()
    found = _in_order(parts, points, radius, cuts)
    lost = solid.volume() - sum(part.volume() for part in parts)
    section = np.pi * radius**2 * KERF_MM * len(cuts)
    if found is None or any(p.genus() != 0 for p in found) or not 0.8 < lost / section < 1.2:
        raise SceneError(
            "the cut of a knot",
            f"{len(cuts)} cuts came out as {len(parts)} pieces, "
            f"and take {lost:.4g} mm³ away instead of {section:.4g}",
            "Use a larger printer or a smaller frame, or report this scene",
        )
    for number, cut in enumerate(cuts):
        before, after = (number - 1) % len(cuts), number
        pinned, holed = (before, after) if cut.side > 0 else (after, before)
        outward = cut.along * cut.side
        pin, hole = _connector(cut, radius)
        found[pinned] = found[pinned] + place_along(pin, outward, cut.point)
        found[holed] = found[holed] - place_along(hole, outward, cut.point)
    pieces = []
    for number, (part, cut) in enumerate(zip(found, cuts, strict=True)):
        last = cuts[(number + 1) % len(cuts)].vertex
        count = (last - cut.vertex) % len(points)
        own = points[(cut.vertex + np.arange(count + 1)) % len(points)]
        if part.genus() != 0 or len(part.decompose()) != 1:
            raise SceneError(
                "the cut of a knot",
                f"piece {number + 1} is not one ball with its pin and hole",
                "Use a larger printer or a smaller frame, or report this scene",
            )
        pieces.append(CutPiece(as_mesh(part), own))
    return pieces


def _connector(cut: Cut, radius: float) -> tuple[Manifold, Manifold]:
    """Return the pin and the hole along z, the cut at z = 0."""
    from manifold3d import CrossSection

    pin, long = cut.pin_radius, cut.pin_length
    chamfer = 0.3 * pin  # a share of the pin's radius, at its tip
    root = 0.5 * radius  # a pin goes so far back into its own piece
    profile = [(0, -root), (pin, -root), (pin, long - chamfer), (pin - chamfer, long), (0, long)]
    wide = pin + CLEARANCE_MM
    # a polygon's flats lie inside its circle: the hole's must not come nearer than the clearance
    wide /= np.cos(np.pi / SIDES)
    deep = long + DEEPER_MM
    hole = [(0.0, -root), (wide, -root), (wide, deep), (0.0, deep)]
    return (
        CrossSection([np.array(profile, dtype=np.float64)]).revolve(SIDES),
        CrossSection([np.array(hole, dtype=np.float64)]).revolve(SIDES),
    )


def _in_order(
    parts: list[Manifold], points: Array, radius: float, cuts: Sequence[Cut]
) -> list[Manifold] | None:
    """Return the parts by the cut that each begins at; None where they are not one for each cut."""
    if len(parts) != len(cuts):
        return None
    tree = cKDTree(points)
    starts = np.array([cut.vertex for cut in cuts])
    order: dict[int, Manifold] = {}
    for part in parts:
        vertices, _ = as_mesh(part)
        away, nearest = tree.query(vertices[:: max(1, len(vertices) // 500)])
        nearest = nearest[away <= 1.1 * radius]
        stretch = (np.searchsorted(starts, nearest, side="right") - 1) % len(cuts)
        order[int(np.bincount(stretch, minlength=len(cuts)).argmax())] = part
    return [order[k] for k in range(len(cuts))] if len(order) == len(cuts) else None
