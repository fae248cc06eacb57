"""The report on how a piece is held while it prints, and what the alternative would cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab.design.candidates import ARCHES, DEPTH_RATIO
from knotfab.geometry.tube import face_normals, keep_faces, mesh_volume, split_shells
from knotfab.request import Request
from knotfab.scene.require import why_supported
from knotfab_formats.print_figures import BarFigures, FeetFigures, OtherWay, Print, SupportFigures
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import Check

if TYPE_CHECKING:
    from knotfab.part.assemble import Part

# Measured, as ARCHES is, on pieces that were built both ways; docs/prints.md has the ratios.
PER_GRAM = 1.08  # hours per gram of arches over hours per gram of strands and supports
# share of the room about a piece that supports fill: the picture's longer side squared, times the depth
ROOM = 0.02
_BED_MM = 1e-6  # what is no higher lies on the bed


def report_supports(print_: Print, request: Request, part: Part, checks: Sequence[Check]) -> Print:
    """Add to a sliced piece's figures how it is held while it prints.

    Only prints of filament are held by anything.
    """
    scene = part.mounted.scene
    if {scene.printer.process, scene.material.process} != {"filament"}:
        return print_
    print_ = replace(print_, bars=_weigh_bars(part), feet=_measure_feet(part, checks))
    free = request.otherwise is not None or bool(request.why_supported)
    way = "none" if scene.piece.supports == "none" else "slicer"
    hours = None if print_.time_s is None else print_.time_s / 3600
    supports = SupportFigures(
        asked="auto" if free else request.scene.piece.supports,
        way=way,
        why=request.why_supported or _why(scene, free),
        hours=hours,
        grams=print_.filament_g,
        other=None if request.why_supported else estimate_other(print_, scene, request.scene),
    )
    return replace(print_, supports=supports)


def _why(scene: ResolvedScene, free: bool) -> str:
    if free:
        return "every check of it without supports passes"
    if scene.mount.on_feet:
        return "it stands in its plate"
    return "asked for" if "supports" in scene.piece.model_fields_set else "the default"


def estimate_other(print_: Print, scene: ResolvedScene, asked: ResolvedScene) -> OtherWay | None:
    """Estimate what a bare sliced piece would take if it were held the other way; None if that is impossible.

    Strands in arches are longer by `ARCHES`; supports fill a share of the room, `ROOM`; the hours follow
    from the grams, and from how much slower the legs of arches print, `PER_GRAM`.

    Args:
        scene: as built. asked: as a person wrote it, where the depth may be open.
    """
    hours, grams, box = print_.time_s, print_.filament_g, print_.bounding_box_mm
    if hours is None or not grams or box is None or scene.mount.kind != "none":
        return None
    if scene.piece.supports == "none":
        longer = max(box[:2])
        room = longer**2 * (asked.piece.depth or DEPTH_RATIO * longer)
        supports = ROOM * room * 1e-3 * scene.material.density_g_cm3
        other, slower = grams / ARCHES + supports, 1 / PER_GRAM
    elif why_supported(asked) is None:
        supports = 0.0
        other, slower = ARCHES * (grams - (print_.support_g or 0.0)), PER_GRAM
    else:
        return None
    share = slower * other / grams
    return OtherWay(
        hours=round(share * hours / 3600, 2),
        grams=round(other, 1),
        support_grams=round(supports, 1),
    )


def sum_supports(frames: Sequence[SupportFigures | None]) -> SupportFigures | None:
    """Sum hours and grams over the frames of a sequence, all held in one way."""
    known = [frame for frame in frames if frame is not None]
    if not known:
        return None
    hours, grams = [f.hours for f in known], [f.grams for f in known]
    return replace(
        known[0],
        hours=None if None in hours else sum(h for h in hours if h is not None),
        grams=None if None in grams else sum(g for g in grams if g is not None),
        other=None,
    )


def _weigh_bars(part: Part) -> BarFigures | None:
    """Count and weigh the bars of a piece; None where there are none."""
    standing = part.standing
    if standing is None or not standing.bars:
        return None
    volume = sum(mesh_volume(*bar.make_body()) for bar in standing.bars)
    return BarFigures(
        count=len(standing.bars),
        grams=round(volume * 1e-3 * part.mounted.scene.material.density_g_cm3, 3),
        longest_mm=round(max(bar.gap_mm for bar in standing.bars), 2),
    )


def _measure_feet(part: Part, checks: Sequence[Check]) -> FeetFigures | None:
    """Measure on the mesh the feet that stand flat on the bed; None if there are none of its own."""
    standing = part.standing
    if standing is None or part.mounted.scene.mount.on_feet:
        return None
    areas = list[float]()
    for vertices, faces in part.bodies[: len(part.bodies) - len(standing.bars)]:
        flat = faces[(vertices[faces, 2] <= _BED_MM).all(axis=1)]
        if len(flat):
            areas += [
                float(np.linalg.norm(face_normals(v[f]), axis=1).sum() / 2)
                for v, f in split_shells(keep_faces(vertices, flat))
            ]
    if not areas:
        return None
    tip = next((c.measured for c in checks if c.name == "tipping"), None)
    return FeetFigures(
        count=len(areas),
        area_mm2=round(sum(areas), 1),
        least_mm2=round(min(areas), 2),
        tip_deg=round(tip, 1) if isinstance(tip, float) else None,
    )
