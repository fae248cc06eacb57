"""Check that the plates of a part fit the printer, and that they make up the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import GROWN, MESH, PRINTING, Check
from knotfab_validators.check import at_most, places, skip_check, spot
from knotfab_validators.files.mesh import Plate
from knotfab_validators.geometry.mesh import (
    Mesh,
    enclosed_volume,
    surface_distance,
    winding_numbers,
)
from knotfab_validators.mesh.surface_checks import check_mesh
from knotfab_validators.printing.bars import part_bars
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.upright import Upright
from knotfab_validators.tube.region import check_build_volume

if TYPE_CHECKING:
    from knotfab_formats.piece import Printer

APART_MM = 0.05  # between the part's surface and that of its pieces, placed as the scene says
VOLUME_SHARE = 0.02  # share of the part's volume that clearances at its connectors may take


def check_plates(
    part: Mesh, plates: Sequence[Plate], build_volume_mm: tuple[float, float, float] | None
) -> list[Check]:
    """Make the checks `names.PLATES` and `build_volume`, the latter of each plate; all are required.

    - `plate_mesh`: how many of the surface's checks any plate fails.
    - `plates`: with every body moved as the scene says, how far the part's vertices are from the
      bodies' surfaces, and how far those stick out of the part: at most `APART_MM`. What lies
      within the part (cuts, pins and holes) is free.
    - `plates_volume`: what the bodies lack of the part's volume, or have too much: at most
      `VOLUME_SHARE`. A body that is there twice is found so.
    """
    if build_volume_mm is None:
        why = "the scene names a printer without its build_volume_mm"
        checks = [skip_check("build_volume", why)]
    else:
        found = [check_build_volume(plate.mesh, build_volume_mm) for plate in plates]
        checks = [_pick_worst(found, plates)]
    return [*checks, _check_surface(plates), *_check_whole(part, plates)]


def check_plates_printable(
    plates: Sequence[Plate],
    printer: Printer,
    before: Sequence[Check],
    seconds: dict[str, float],
    young_modulus_mpa: float | None = None,
) -> list[Check]:
    """Make the checks of printability, each from the plate that comes out worst.

    `young_modulus_mpa`: of a piece that is designed to print without supports.
    """
    names = PRINTING if young_modulus_mpa is None else (*PRINTING, *GROWN)
    broken = [c for c in before if c.name == "plate_mesh" and c.status == "fail"]
    if broken:
        return [skip_check(name, "the surface of a plate is broken") for name in names]
    each = []
    for plate in plates:
        upright, strands = None, plate.mesh
        if young_modulus_mpa is not None:
            upright, strands = Upright(plate.mesh, young_modulus_mpa), part_bars(plate.mesh).strands
        each.append(printability_checks(strands, printer, seconds=seconds, upright=upright))
    return [_pick_worst([checks[k] for checks in each], plates) for k in range(len(names))]


def _check_surface(plates: Sequence[Plate]) -> Check:
    failed, text, at = 0, "", []
    for plate in plates:
        for check in check_mesh(plate.mesh):
            if check.required and check.status == "fail":
                failed += 1
                text = text or f"; {plate.name}: {check.name}, {check.detail}"
                if check.at:
                    at += list(plate.places(np.array(check.at)))
    return at_most(
        "plate_mesh",
        failed,
        0,
        "checks",
        f"of the {len(MESH)} of a surface, failed by any of {len(plates)} plates{text}",
        at=at,
    )


def _check_whole(part: Mesh, plates: Sequence[Plate]) -> list[Check]:
    wrong = [plate for plate in plates if plate.bodies != len(plate.to_part)]
    if wrong:
        first = wrong[0]
        why = (
            f"{first.name} holds {first.bodies} bodies, and the scene says where "
            f"{len(first.to_part)} of them go"
        )
        return [
            Check("plates", "fail", True, "unknown", APART_MM, "mm", why),
            skip_check("plates_volume", why, required=True),
        ]
    vertices = np.concatenate([p.in_part(p.mesh.vertices, p.body) for p in plates])
    shift = np.cumsum([0] + [len(p.mesh.vertices) for p in plates[:-1]])
    faces = np.concatenate([p.mesh.faces + s for p, s in zip(plates, shift, strict=True)])
    pieces = Mesh(vertices, faces)
    missing, outside = surface_distance(part.vertices, pieces), surface_distance(vertices, part)
    beyond = np.flatnonzero(outside > APART_MM)
    if len(beyond):
        within = winding_numbers(vertices[beyond], part, exact=False) > 0.5
        outside[beyond[within]] = 0.0
    both = np.concatenate([missing, outside])
    points = np.concatenate([part.vertices, vertices])
    order = np.argsort(-both, kind="stable")[:20]
    worst = float(both[order[0]])
    what = "the part is farthest from any piece" if order[0] < len(missing) else ""
    what = what or "a piece sticks out of the part"
    count = sum(plate.bodies for plate in plates)
    checks = [
        at_most(
            "plates",
            worst,
            APART_MM,
            "mm",
            f"between the part's surface and the {count} pieces on {len(plates)} plates, put where "
            f"they belong: most where {what}, at {spot(points[order[0]])}",
            at=points[order[both[order] > min(APART_MM, worst / 2)]],
        )
    ]
    whole, sum_ = enclosed_volume(part), enclosed_volume(pieces)
    checks.append(
        at_most(
            "plates_volume",
            abs(sum_ - whole) / abs(whole) if whole else float("nan"),
            VOLUME_SHARE,
            "relative",
            f"the pieces enclose {sum_:.6g} mm³ and the part {whole:.6g} mm³; what is lacking is "
            "the clearance of their connectors",
        )
    )
    return checks


def _pick_worst(found: Sequence[Check], plates: Sequence[Plate]) -> Check:
    """Return the check of the plate that fails or nearly does, its places moved to the part."""

    def badness(number: int) -> tuple[int, float]:
        check = found[number]
        value = check.measured if isinstance(check.measured, float) else float("-inf")
        sign = (
            -1.0 if check.name in ("feature", "gap", "standing", "legs", "feet", "tipping") else 1.0
        )
        if not isinstance(check.measured, float):
            sign = 1.0
        return ("pass", "skipped", "fail").index(check.status), sign * value

    number = max(range(len(found)), key=badness)
    check, plate = found[number], plates[number]
    at = places(plate.places(np.array(check.at))) if check.at else ()
    return replace(check, detail=f"{plate.name}: {check.detail}", at=at)
