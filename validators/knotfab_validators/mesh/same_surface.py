"""Check that the 3MF files beside an STL hold its surface: the STL is verified, but the 3MF is printed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints
from knotfab_validators.check import BadFile, at_most, places, skip_check, spot, worst_apart
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import Mesh

NAME = "same_3mf"
LIMIT_MM = 1e-3  # single precision at a metre rounds by 3e-5 mm, six decimals by 5e-7
APART_MM = 5.0  # least distance between two places that are named


@dataclass(frozen=True)
class SurfaceDifference:
    """How two meshes differ.

    `away_mm` is the largest distance from a vertex of either to the nearest one of the other,
    infinite if one has none; `at` (k, 3), mm, are such places, worst first. `faces` counts faces
    that only one of them has, if all vertices match; otherwise it is 0.
    """

    away_mm: float
    faces: int
    at: Array


def compare_surfaces(mesh: Mesh, other: Mesh) -> SurfaceDifference:
    """Compare the vertices of two meshes, and then their faces with orientation.

    The order of bodies, vertices and faces, and the first corner of a face, do not matter. Multiplicity and
    orientation do. Faces in the same order are compared corner by corner first, which is quick.
    """
    if mesh.faces.shape == other.faces.shape:
        gap = np.abs(mesh.vertices[mesh.faces] - other.vertices[other.faces])
        # `most` is the largest difference of a coordinate
        if (most := float(gap.max(initial=0.0))) <= LIMIT_MM / 2:
            return SurfaceDifference(most, 0, np.empty((0, 3)))
    return _match(mesh, other)


def check_same_3mf(mesh: Mesh, part: Path) -> Check:
    """Check `same_3mf`: every 3MF beside the part is the same surface, faces with their sides.

    `measured` is the largest distance of a vertex from the other file's nearest, mm, or words if the faces
    differ between the same vertices, a file cannot be read, or slicers read it differently. The check is
    skipped if there are none, and required only of files that a build writes: another program's 3MF of the
    same name may be another part.

    Args:
        mesh: what the file `part` holds.
    """
    if part.suffix.lower() != ".stl":
        return skip_check(NAME, "the part is no STL, beside which a 3MF would be looked for")
    beside = find_3mf(part)
    if not beside:
        return skip_check(NAME, f"there is no {part.stem}.3mf beside {part.name}")
    worst, name, own = 0.0, beside[0].name, is_own(part)
    for path in beside:
        try:
            other = read_mesh(path, strict=own)
        except BadFile as error:
            moved = _tell_move(mesh, path) if own else ""
            return Check(NAME, "fail", own, "not read", LIMIT_MM, "mm", f"{error}{moved}")
        found = compare_surfaces(mesh, other)
        if found.faces:
            said = f"{found.faces} faces differ"
            detail = f"{path.name} has other faces than the part between the same vertices"
            detail += f", such as at {spot(found.at[0])}"
            return Check(NAME, "fail", own, said, LIMIT_MM, "mm", detail, places(found.at))
        if found.away_mm > LIMIT_MM:
            detail = (
                f"{path.name} is not the part's surface: a vertex of one of the two is so far from "
            )
            detail += f"all of the other's, at {spot(found.at[0])}{_tell_move(mesh, path)}"
            return at_most(NAME, found.away_mm, LIMIT_MM, "mm", detail, required=own, at=found.at)
        if found.away_mm >= worst:
            worst, name = found.away_mm, path.name
    names = " and ".join(path.name for path in beside)
    detail = f"{names} {'is' if len(beside) == 1 else 'are'} the part's surface, face by face; the "
    return at_most(
        NAME, worst, LIMIT_MM, "mm", f"{detail}farthest vertex is in {name}", required=own
    )


def _tell_move(mesh: Mesh, path: Path) -> str:
    """Say by how much the file's surface is moved, as slicers save it; empty if it is another."""
    try:
        other = read_mesh(path)
    except BadFile:
        return ""
    shift = other.vertices.min(axis=0) - mesh.vertices.min(axis=0)
    back = compare_surfaces(mesh, Mesh(other.vertices - shift, other.faces))
    if back.faces or not np.abs(shift).max() > LIMIT_MM or back.away_mm > 2 * LIMIT_MM:
        return ""
    return f"; it is the same surface, moved by {spot(shift)}: a slicer saved it; build it anew"


def _match(mesh: Mesh, other: Mesh) -> SurfaceDifference:
    from scipy.spatial import cKDTree

    tree = cKDTree(mesh.vertices)
    away, same = tree.query(other.vertices)
    back, _ = cKDTree(other.vertices).query(mesh.vertices)
    gap = np.concatenate([away, back])
    if gap.max() > LIMIT_MM:
        points = np.concatenate([other.vertices, mesh.vertices])
        worst = worst_apart(gap, points, APART_MM, LIMIT_MM)
        return SurfaceDifference(float(gap.max()), 0, points[worst])
    every = np.concatenate(
        [_first_corner_least(mesh.faces), _first_corner_least(same[other.faces])]
    )
    once = len(mesh.faces)
    _, first, number = np.unique(every, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    count = np.bincount(number[:once], minlength=len(first))
    odd = np.abs(count - np.bincount(number[once:], minlength=len(first)))
    where = mesh.vertices[every[first[odd > 0]]].mean(axis=1)
    return SurfaceDifference(float(gap.max()), int(odd.sum()), where)


def _first_corner_least(faces: Ints) -> Ints:
    """Rotate each face (m, 3) so that its lowest vertex index comes first."""
    first = faces.argmin(axis=1)[:, None]
    return np.asarray(np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1))


PART = re.compile(r"part(-\d+)?")
OWN = re.compile(r"part(-\d+)?")  # names that a build gives to its STL and 3MF


def is_own(part: Path) -> bool:
    """Return whether a build writes files of that name, so that the 3MF beside it must be the same part."""
    return OWN.fullmatch(part.stem) is not None


def find_3mf(part: Path) -> list[Path]:
    """List the 3MF files of the same part beside an STL, including a build's coloured one.

    Beside `part-03.stl` these are `part-03.3mf` and `part-colours-03.3mf`; other formats have none.
    """
    if part.suffix.lower() != ".stl":
        return []
    names = {part.with_suffix(".3mf").name}
    if own := PART.fullmatch(part.stem):
        names.add(f"part-colours{own[1] or ''}.3mf")
    wanted = {name.casefold() for name in names}  # slicers accept part.3MF too
    return sorted(path for path in part.parent.iterdir() if path.name.casefold() in wanted)
