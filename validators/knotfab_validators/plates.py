"""Whether the plates on which a part is printed fit the printer, and whether they make up the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .check import Check, at_most, places, skipped
from .mesh_check import check_mesh
from .names import MESH, PRINTING
from .printability import printability_checks
from .read_mesh import Mesh
from .read_plates import Laid
from .read_scene import Printer
from .region import check_build_volume

__all__ = ["check_plates", "printability_of_plates"]

Array = NDArray[np.float64]

APART_MM = 0.05  # between the part's surface and that of its pieces, placed as the scene says
VOLUME_SHARE = 0.02  # of the part, that clearances at its connectors may take
LARGER_IS_BETTER = ("feature", "gap", "standing")


def check_plates(
    part: Mesh, plates: Sequence[Laid], build_volume_mm: tuple[float, float, float] | None
) -> list[Check]:
    """`build_volume`, of each plate instead of the part, and `names.PLATES`, all required.

    - `plate_mesh`: how many of the surface's checks any plate fails.
    - `plates`: with every body moved as the scene says, how far the part's vertices are from the
      bodies' surfaces, and how far those stick out of the part: at most `APART_MM`. What lies
      within the part (cuts, pins and holes) is free.
    - `plates_volume`: what the bodies lack of the part's volume, or have too much: at most
      `VOLUME_SHARE`. A body that is there twice is found so.
    """
    if build_volume_mm is None:
        why = "the scene names a printer without its build_volume_mm"
        checks = [skipped("build_volume", why)]
    else:
        found = [check_build_volume(plate.mesh, build_volume_mm) for plate in plates]
        checks = [_worst(found, plates)]
    return [*checks, _surface(plates), *_whole(part, plates)]


def printability_of_plates(
    plates: Sequence[Laid],
    printer: Printer,
    before: Sequence[Check],
    seconds: dict[str, float],
) -> list[Check]:
    """The checks of printability, each of the plate that comes out worst."""
    broken = [c for c in before if c.name == "plate_mesh" and c.status == "fail"]
    if broken:
        return [skipped(name, "the surface of a plate is broken") for name in PRINTING]
    each = [printability_checks(plate.mesh, printer, seconds=seconds) for plate in plates]
    return [_worst([checks[k] for checks in each], plates) for k in range(len(PRINTING))]


def _surface(plates: Sequence[Laid]) -> Check:
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


def _whole(part: Mesh, plates: Sequence[Laid]) -> list[Check]:
    wrong = [plate for plate in plates if plate.bodies != len(plate.to_part)]
    if wrong:
        first = wrong[0]
        why = (
            f"{first.name} holds {first.bodies} bodies, and the scene says where "
            f"{len(first.to_part)} of them go"
        )
        return [
            Check("plates", "fail", True, "unknown", APART_MM, "mm", why),
            skipped("plates_volume", why, required=True),
        ]
    vertices = np.concatenate([p.in_part(p.mesh.vertices, p.body) for p in plates])
    shift = np.cumsum([0] + [len(p.mesh.vertices) for p in plates[:-1]])
    faces = np.concatenate([p.mesh.faces + s for p, s in zip(plates, shift, strict=True)])
    pieces = Mesh(vertices, faces)
    missing, outside = _away(part.vertices, pieces), _away(vertices, part)
    beyond = np.flatnonzero(outside > APART_MM)
    if len(beyond):
        outside[beyond[_inside(vertices[beyond], part)]] = 0.0
    both = np.concatenate([missing, outside])
    points = np.concatenate([part.vertices, vertices])
    order = np.argsort(-both, kind="stable")[:20]
    worst = float(both[order[0]])
    what = "the part is farthest from any piece" if order[0] < len(missing) else ""
    what = what or "a piece sticks out of the part"
    x, y, z = points[order[0]]
    count = sum(plate.bodies for plate in plates)
    checks = [
        at_most(
            "plates",
            worst,
            APART_MM,
            "mm",
            f"between the part's surface and the {count} pieces on {len(plates)} plates, put where "
            f"they belong: most where {what}, at ({x:.2f}, {y:.2f}, {z:.2f}) mm",
            at=points[order[both[order] > min(APART_MM, worst / 2)]],
        )
    ]
    whole, sum_ = _volume(part), _volume(pieces)
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


def _away(points: Array, mesh: Mesh) -> Array:
    """(n,) distance of points from a surface."""
    from igl import point_mesh_squared_distance

    squared = point_mesh_squared_distance(
        np.ascontiguousarray(points),
        np.ascontiguousarray(mesh.vertices),
        np.ascontiguousarray(mesh.faces),
    )[0]
    found: Array = np.sqrt(np.maximum(squared, 0.0))
    return found


def _inside(points: Array, mesh: Mesh) -> NDArray[np.bool_]:
    from igl import fast_winding_number

    winding = fast_winding_number(
        np.ascontiguousarray(mesh.vertices),
        np.ascontiguousarray(mesh.faces),
        np.ascontiguousarray(points),
    )
    inside: NDArray[np.bool_] = np.asarray(winding) > 0.5
    return inside


def _volume(mesh: Mesh) -> float:
    corner = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    return float(np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6)


def _worst(found: Sequence[Check], plates: Sequence[Laid]) -> Check:
    """The one that fails, or came nearest to it; its places are brought to the part."""

    def badness(number: int) -> tuple[int, float]:
        check = found[number]
        value = check.measured if isinstance(check.measured, float) else float("-inf")
        sign = -1.0 if check.name in LARGER_IS_BETTER else 1.0
        if not isinstance(check.measured, float):
            sign = 1.0
        return ("pass", "skipped", "fail").index(check.status), sign * value

    number = max(range(len(found)), key=badness)
    check, plate = found[number], plates[number]
    at = places(plate.places(np.array(check.at))) if check.at else ()
    return replace(check, detail=f"{plate.name}: {check.detail}", at=at)
