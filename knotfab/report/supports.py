"""How a piece lies on the bed, how it is held while it prints, and what another way would cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab.design.candidates import ARCHES, DEPTH_RATIO, PER_GRAM, ROOM, hours_of_plate, price_of
from knotfab.geometry.tube import face_normals, keep_faces, mesh_volume, split_shells
from knotfab.request import Request
from knotfab.scene.require import why_supported
from knotfab_formats.print_figures import (
    BarFigures,
    FeetFigures,
    Kept,
    PoseFigures,
    Print,
    SupportFigures,
    Way,
)
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import Check, View

if TYPE_CHECKING:
    from knotfab.part.assemble import Part
    from knotfab.part.orient import Flattening

_BED_MM = 1e-6  # what is no higher lies on the bed


def report_posing(
    print_: Print, part: Part, flattening: Flattening | None, *, printing: bool = False
) -> tuple[Print, list[str]]:
    """Add the pose to the figures of a piece, with notes on it."""
    pose = _pose_figures(part, flattening)
    scene, notes = part.mounted.scene, list[str]()
    if printing and pose.box_cm3 is not None and scene.printer.process == "powder":
        notes.append(
            "It is printed in powder, which carries it: no supports, and any pose will do. Its box of "
            f"{pose.box_cm3:.0f} cm³ is what it takes of the powder bed."
        )
    if (shrinkage := pose.shrinkage_percent) is not None:
        larger = 100 / (1 - shrinkage / 100) - 100
        notes.append(
            f"All files are written {larger:.2f} % larger, for the material shrinks "
            f"by {shrinkage:g} %: switch off what your slicer or print service does about it."
        )
    return replace(print_, pose=pose), [*notes, *_tell_flattening(flattening)]


def _pose_figures(part: Part, flattening: Flattening | None) -> PoseFigures:
    """Report how the piece lies and why, and its depth before it was made flatter."""
    weighed, box = part.pose.weighed, part.pose.size_mm
    if weighed is not None:
        found = weighed.estimate
        pose = PoseFigures(
            chosen_by="supports, height and footprint",
            height_mm=round(found.height_mm, 2),
            support_cm3_estimate=round(found.support_cm3, 2),
            support_filament_cm3_estimate=round(found.filament_cm3, 2),
        )
    else:
        powder = part.mounted.scene.printer.process == "powder"
        by = "the volume of its box" if powder else "least height"
        pose = PoseFigures(
            chosen_by="the mount" if part.mounted.upright is not None else by,
            height_mm=round(float(box[2]), 2),
            box_cm3=round(float(box.prod()) / 1000, 1),
        )
    depth = distance = None
    if flattening is not None:
        first, kept = round(flattening.from_mm, 2), round(flattening.to_mm, 2)
        depth = Kept(first, kept, flattening.proposed_mm)
        if flattening.unheld:
            distance = Kept(round(flattening.wall_mm[0], 2), round(flattening.wall_mm[1], 2))
    return replace(
        pose,
        shrinkage_percent=part.mounted.scene.material.shrinkage_percent or None,
        depth_mm=depth,
        wall_distance_mm=distance,
    )


def _tell_flattening(flattening: Flattening | None) -> list[str]:
    """Say that a piece was rebuilt nearer to the wall or flatter, or would have to be."""
    if flattening is None:
        return []
    notes = []
    if flattening.unheld:
        first, kept = flattening.wall_mm
        notes.append(
            f"At {first:.0f} mm from the wall, {flattening.from_mm:.0f} mm deep, {flattening.unheld}: "
            f"so it was rebuilt at {kept:.0f} mm, {flattening.to_mm:.0f} mm deep."
        )
    elif flattening.to_mm < flattening.from_mm:
        notes.append(
            f"Its depth was lowered from {flattening.from_mm:.0f} to {flattening.to_mm:.0f} mm, "
            "as no pose kept the printer's limit for supports."
        )
    if flattening.proposed_mm is not None:
        notes.append(
            "No pose keeps the printer's limit for supports: a depth of about "
            f"{flattening.proposed_mm:g} mm would (--depth {flattening.proposed_mm:g})."
        )
    return notes


def report_supports(
    print_: Print,
    request: Request,
    part: Part,
    checks: Sequence[Check],
    views: Sequence[View] = (),
    word: str = "faithful",
) -> Print:
    """Add to a sliced piece's figures how it is held while it prints, and what other ways would cost.

    Only prints of filament are held by anything.

    Args:
        word: of its verdict.
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
        ways=() if request.why_supported else list_ways(print_, scene, request.scene, views, word),
    )
    return replace(print_, supports=supports)


def _why(scene: ResolvedScene, free: bool) -> str:
    if free:
        return "every check of it without supports passes"
    if scene.mount.on_feet:
        return "it stands in its plate"
    return "asked for" if "supports" in scene.piece.model_fields_set else "the default"


def list_ways(
    print_: Print,
    scene: ResolvedScene,
    asked: ResolvedScene,
    views: Sequence[View] = (),
    word: str = "faithful",
) -> tuple[Way, ...]:
    """List the way in which a sliced piece is held and its price, and estimates of others, cheapest first.

    Strands in arches are longer by `ARCHES`; supports fill a share of the room, `ROOM`; the hours follow
    from the grams, and from how much slower the legs of arches print, `PER_GRAM`. What is told, and the word,
    are those of the piece. Eyelets and their posts count as strands; stands and pegs have no estimate.

    Args:
        scene: as built. asked: as a person wrote it, where the depth may be open.
    """
    seconds, grams, box, mount = (
        print_.time_s,
        print_.filament_g,
        print_.bounding_box_mm,
        scene.mount,
    )
    known = mount.on_feet or mount.kind in ("none", "hang")
    if seconds is None or not grams or box is None or not known:
        return ()
    told = max((view.told.worst.share for view in views if view.told), default=0.0)
    density = 1e-3 * scene.material.density_g_cm3

    def way(name: str, hours: float, grams: float, supports: float = 0.0) -> Way:
        price = round(price_of(hours, grams, told, word), 1)
        return Way(
            way=name,
            hours=round(hours, 2),
            grams=round(grams, 1),
            support_grams=round(supports, 1),
            price=price,
        )

    alone, hours = scene.piece.supports == "none", seconds / 3600
    held = print_.roots or print_.plate
    plate = 0.0 if held is None else held.mass_g / density
    own = hours_of_plate(plate, mount.thickness_mm, scene.printer)
    name = str(mount.plate) if mount.on_feet else "none" if alone else "slicer"
    taken, others = way(name, hours, grams, print_.support_g or 0.0), list[Way]()
    if mount.plate == "roots" and mount.on_feet:
        thin = mount.but(plate="rounded").thickness_mm
        rounded = (box[0] + 6.0) * (box[1] + 6.0) * thin
        later = hours_of_plate(rounded, thin, scene.printer) - own
        others.append(way("rounded", hours + later, grams + (rounded - plate) * density))
    bare, hours = grams - plate * density, hours - own
    if alone:
        seen = scene.views[0]
        frame = max(seen.frame_width_mm or 0, seen.frame_height_mm or 0) / seen.magnification
        longer = min(max(box[:2]), frame or np.inf)  # without the holder
        room = longer**2 * (asked.piece.depth or DEPTH_RATIO * longer)
        supports = ROOM * room * density
        other, slower = bare / ARCHES + supports, 1 / PER_GRAM
        others.append(way("slicer", slower * other / bare * hours, other, supports))
    elif why_supported(asked) is None:
        other = ARCHES * (bare - (print_.support_g or 0.0))
        others.append(way("none", PER_GRAM * other / bare * hours, other))
    return (taken, *sorted(others, key=lambda one: one.price))


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
        ways=(),
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
