"""Check a surface: closed, wound outwards, the expected bodies and volume, no crossing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from knotfab_formats.libraries import took_part
from knotfab_formats.verdict import MESH, Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_most, places, skip_check, spot
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, winding_numbers
from knotfab_validators.geometry.surface import Surface, overlapping_boxes, survey, tell_heap

BESIDE = 1e-3  # how far behind a face to probe, as a share of its size (in single precision)


def check_mesh(
    mesh: Mesh,
    curves: Curves | None = None,
    *,
    bodies: int | None = None,
    genus: Sequence[int] | None = None,
) -> list[Check]:
    """Make all checks of the surface, in the order of `names.MESH`; void ones are skipped.

    Args:
        mesh: the part.
        curves: the centre lines, if the part is nothing but the tubes about them: then the volume
            must be that of Pappus within 0.5 %, and every body's positive. A part that is more than
            its tubes, or has no known ones, may have cavities (bodies turned inwards that lie in
            the matter of another); its bodies must not lie in each other's matter.
        bodies: how many there must be. Left out: one for each curve; without curves any number.
        genus: genus of each body, in any order. Left out: 1 for the tube of a closed curve and 0
            for that of an open one; without curves any. Where nothing is expected, `mesh_bodies`
            and `mesh_genus` are there to inform: they pass, and are not required.
    """
    if not mesh.usable:
        why = "coordinates that are not finite" if len(mesh.faces) else "no faces"
        closed = Check("mesh_closed", "fail", True, why, None, "", f"the mesh has {why}")
        return [closed, *_skip_all(MESH[1:], f"the mesh has {why}")]
    found = survey(mesh)
    if curves is not None:
        bodies = len(curves.polygons) if bodies is None else bodies
        genus = [1 if closed else 0 for closed in curves.closed] if genus is None else genus
    checks, crossings = _count_defects(mesh, found), _check_crossings(mesh, found)
    if found.manifold:
        largest = _largest_faces(mesh, found)
        where = _centres(mesh, largest)
        checks += [_check_bodies(found, bodies, where), _check_genus(found, genus, where)]
        crossing = crossings.status == "fail"
        checks.append(_check_volume(mesh, found, curves, largest, crossing=crossing))
    else:
        lacking = "a surface everywhere" if found.closed else "closed and consistently wound"
        checks += _skip_all(MESH[5:8], f"the mesh is not {lacking}")
    return [*checks, crossings]


def _count_defects(mesh: Mesh, found: Surface) -> list[Check]:
    """Make the checks that count defective edges, corners and faces."""
    rims, crowded = found.open_edges, found.crowded_edges
    folded, pinched = found.flipped_edges, found.pinched
    manifold = np.concatenate([_middles(mesh, crowded), mesh.vertices[pinched]])
    return [
        _check_none(
            "mesh_closed",
            _middles(mesh, rims),
            "edges",
            f"edges of one face alone (or another odd number), of {len(mesh.faces)} faces",
        ),
        _check_none(
            "mesh_winding",
            _middles(mesh, folded),
            "edges",
            "edges whose faces are wound against each other",
        ),
        _check_none(
            "mesh_degenerate", _centres(mesh, found.flat), "faces", "faces without an area"
        ),
        _check_none(
            "mesh_duplicate",
            _centres(mesh, found.duplicate),
            "faces",
            "faces with the same three corners as another",
        ),
        _check_none(
            "mesh_manifold",
            manifold,
            "places",
            f"{len(crowded)} edges of more than two faces, and {len(pinched)} corners where "
            "surfaces meet in a point",
        ),
    ]


def _check_none(name: str, at: Array, unit: str, detail: str) -> Check:
    """Make a check that passes if the count is 0; `at` (k, 3) are the places."""
    if len(at):
        detail += f", the first at {spot(at[0])}"
    return at_most(name, len(at), 0, unit, detail, at=at)


def _check_bodies(found: Surface, wanted: int | None, where: Array) -> Check:
    """Check the number of bodies; if it is wrong, the smallest ones are named first."""
    count = len(found.volumes_mm3)
    holds = wanted is None or count == wanted
    detail = "closed surfaces" if wanted is None else "closed surfaces, and how many there must be"
    smallest = where[np.argsort(np.abs(found.volumes_mm3), kind="stable")]
    return Check(
        "mesh_bodies",
        "pass" if holds else "fail",
        wanted is not None,
        count,
        wanted,
        "",
        detail,
        () if holds else places(smallest),
    )


def _check_genus(found: Surface, wanted: Sequence[int] | None, where: Array) -> Check:
    """Check the genera of the bodies, in any order, against the expected ones."""
    if wanted is None:
        several = ", ".join(str(g) for g in found.genus[:10])
        more = ", ..." if len(found.genus) > 10 else ""
        detail = "handles of each body (0: a ball, 1: a ring)"
        return Check("mesh_genus", "pass", False, several + more, None, "", detail)
    left, wrong = list(wanted), []
    for body, g in enumerate(found.genus.tolist()):
        if g in left:
            left.remove(g)
        else:
            wrong.append(body)
    kinds = sorted(set(wanted))
    limit = kinds[0] if len(kinds) == 1 else ", ".join(str(g) for g in wanted)
    if not wrong:
        # missing bodies are reported by another check
        measured = int(found.genus[0]) if len(kinds) == 1 else ", ".join(map(str, found.genus))
        detail = "handles of each body (1: the tube of a closed curve, 0: of an open one)"
        return Check("mesh_genus", "pass", True, measured, limit, "", detail)
    detail = f"{len(wrong)} of {len(found.genus)} bodies have another number of handles"
    detail += f", the first at {spot(where[wrong[0]])}"
    measured = int(found.genus[wrong[0]])
    return Check(
        "mesh_genus", "fail", True, measured, limit, "", detail, places(where[i] for i in wrong)
    )


def _check_volume(
    mesh: Mesh, found: Surface, curves: Curves | None, largest: Ints, crossing: bool
) -> Check:
    """Check that bodies enclose matter or, unless the part is a plain tube, cavities.

    Bodies that cross each other are partly in each other's matter, which another check reports.
    """
    inverted, where = ~(found.volumes_mm3 > 0), _centres(mesh, largest)
    if curves is None and len(where) > 1 and not crossing:
        inverted = _find_misplaced(mesh, largest)
    bad = np.flatnonzero(inverted)
    if len(bad):
        what = "are turned inside out" if curves is not None or len(where) == 1 else ""
        what = what or "are turned inside out, or lie in the matter of others"
        return Check(
            "mesh_volume",
            "fail",
            True,
            float(found.volumes_mm3[bad[0]]),
            0.0,
            "mm³",
            f"{len(bad)} of {len(where)} bodies {what}, the first at {spot(where[bad[0]])}",
            places(where[i] for i in bad),
        )
    if curves is None or curves.radius_mm is None:
        volume = float(found.volumes_mm3.sum())
        return Check("mesh_volume", "pass", True, volume, 0.0, "mm³", "what the mesh encloses")
    return _check_pappus(found, curves, curves.radius_mm, where)


def _check_pappus(found: Surface, curves: Curves, radius: float, where: Array) -> Check:
    """Check a tube's volume: the section's area times the length of its centre line (Pappus, Guldin).

    The ends of an open tube may be flat, or balls that add 4/3 pi r³: whichever is nearer counts.
    """
    lengths = np.array(curves.lengths_mm)
    tubes, by_volume = np.pi * radius**2 * lengths, np.argsort(found.volumes_mm3, kind="stable")
    balls = np.where(curves.closed, 0.0, 4 / 3 * np.pi * radius**3)
    order = np.argsort(tubes, kind="stable")
    wanted, round_ends, bodies = tubes[order], balls[order], found.volumes_mm3[by_volume]
    each, at = "", where[by_volume]
    if len(bodies) != len(wanted):  # then only the sums can be compared
        bodies, wanted, round_ends = (a.sum(keepdims=True) for a in (bodies, wanted, round_ends))
    elif len(bodies) > 1:
        each = ", the worst of all knots"
    flat = np.abs(bodies - wanted) / wanted
    rounded = np.abs(bodies - wanted - round_ends) / (wanted + round_ends)
    difference = np.minimum(flat, rounded)
    worst = int(difference.argmax())
    full = wanted + np.where(rounded < flat, round_ends, 0.0)
    return at_most(
        "mesh_volume",
        float(difference[worst]),
        0.005,  # relative difference from Pappus' volume
        "relative",
        f"{bodies[worst]:.6g} mm³ against {full[worst]:.6g} mm³, the tube's section times its "
        f"length{each}",
        at=at[worst : worst + 1],
    )


def _find_misplaced(mesh: Mesh, largest: Ints) -> Mask:
    """Mark bodies (b,) that are inside out or lie in the matter of others.

    Behind a face of a sound solid the winding number is 1, also behind that of a cavity, or of a
    body inside a cavity. It is 0 if the body is inside out (-1 in front of its faces), and 2 if it
    lies in matter, which slicers interpret in different ways.

    Args:
        largest: (b,) a face of each body.
    """
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[largest]], 1, 0)
    normal = np.cross(b - a, c - a)  # twice the area as its length, so the square root is a length
    step = normal * (BESIDE / np.sqrt(np.linalg.norm(normal, axis=1)))[:, None]
    winding = winding_numbers((a + b + c) / 3 - step, mesh, exact=False)
    return np.asarray(np.rint(winding) != 1)


def _check_crossings(mesh: Mesh, found: Surface) -> Check:
    """Check that both libraries find no crossing; if only one finds any, the check fails and says so."""
    name = "mesh_self_intersection"
    kept = np.delete(np.arange(len(mesh.faces)), found.flat)
    if not len(kept):
        return skip_check(name, "faces without an area cannot be tested")
    asked = opinions(Mesh(mesh.vertices, mesh.faces[kept]))
    if asked.pairs is None:
        return Check(name, "fail", True, "untested", 0, "pairs", f"not tested: {asked.why}")
    number = len(asked.pairs)
    by_igl = f"{'' if asked.counted or not number else 'at least '}{number} by libigl"
    detail = f"pairs of faces that meet elsewhere than in a shared edge or corner: {by_igl}"
    if asked.seen is None:
        if number == 0:
            return skip_check(name, f"{detail}; {asked.why}", required=True)
        detail += f"; {asked.why}"
        seen = kept[:0]
    else:
        seen = kept[asked.seen]
        if asked.counted or not number:
            detail += f", {len(seen)} faces that cross others by pymeshlab"
        else:
            detail += ", and pymeshlab agrees" if len(seen) else ", which pymeshlab does not see"
        if number and not len(seen):
            detail += " (the two do not agree; faces that only touch count for libigl alone)"
        elif len(seen) and not number:
            detail += " (the two do not agree)"
    bad = kept[asked.pairs[:, 0]] if number else seen
    at = _centres(mesh, bad)
    if len(at):
        detail += f", the first at {spot(at[0])}"
    return at_most(name, max(number, len(seen) if not number else 0), 0, "pairs", detail, at=at)


def _largest_faces(mesh: Mesh, found: Surface) -> Ints:
    """Return the index of each body's largest face (b,), behind which it is probed."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    order = np.lexsort([-area, found.body])
    _, first = np.unique(found.body[order], return_index=True)
    return np.asarray(order[first], dtype=np.int64)


def _middles(mesh: Mesh, edges: Ints) -> Array:
    """Return the midpoints (k, 3) of edges (k, 2)."""
    return np.asarray(mesh.vertices[edges].mean(axis=1), dtype=np.float64)


def _centres(mesh: Mesh, faces: Ints) -> Array:
    """Return the centres (k, 3) of the faces with indices (k,)."""
    return np.asarray(mesh.vertices[mesh.faces[faces]].mean(axis=1), dtype=np.float64)


def _skip_all(names: tuple[str, ...], why: str) -> list[Check]:
    return [skip_check(name, why) for name in names]


# Faces that meet where they must not, by libigl's exact predicates and, as a second opinion, pymeshlab.

MOST_COUNTED = 5_000_000  # crossings beyond which finding the first one is enough
TURNS = Rotation.from_euler(
    "xyz", [(1, 2, 3), (2, 3, 1), (3, 1, 2), (4, 5, 6)]
).as_matrix()  # radians


@dataclass(frozen=True)
class Opinions:
    """What the two libraries find in one mesh.

    `pairs` (k, 2) are faces that meet by libigl: all of them or, unless `counted`, the first one.
    `seen` are faces that cross others by pymeshlab; None if it could not be asked, and `why` says
    so. Both are None if the mesh is such a heap of faces that neither was asked.
    """

    pairs: Ints | None
    counted: bool
    seen: Ints | None
    why: str = ""


def opinions(mesh: Mesh) -> Opinions:
    """Look for faces that meet by both libraries; faces without area must have been removed.

    libigl (AABB tree, Shewchuk's exact predicates) reports faces that merely touch: a corner, an edge or a
    plane in common that the index does not share is enough. pymeshlab (Möller's test in floating point)
    reports faces that each lie on both sides of the other. So only libigl finds faces that touch.
    Neither reports faces with the same three corners: another check finds these duplicates.
    """
    boxes = overlapping_boxes(mesh)
    if why := tell_heap(mesh, boxes):
        return Opinions(None, False, None, why)
    counted = boxes <= MOST_COUNTED
    pairs = self_intersections(mesh, first_only=not counted)
    asked = mesh if counted or not len(pairs) else Mesh(mesh.vertices, mesh.faces[pairs[0]])
    try:
        seen = crossing_faces(asked)
    except ImportError as error:
        return Opinions(pairs, counted, None, f"pymeshlab cannot be loaded here ({error})")
    if not len(pairs):
        seen = _ask_again(mesh, seen)
    return Opinions(pairs, counted, seen if asked is mesh else pairs[0][seen])


def _ask_again(mesh: Mesh, seen: Ints) -> Ints:
    """Keep the faces that pymeshlab still finds to cross when only they are tested again, rotated.

    In planes oblique to the axes, rounding makes it report long thin neighbours. A real crossing
    remains in any orientation.
    """
    for turn in TURNS:
        if not len(seen):
            break
        used, faces = np.unique(mesh.faces[seen], return_inverse=True)
        corners = mesh.vertices[used]
        turned = (corners - corners.mean(axis=0)) @ turn.T
        seen = seen[crossing_faces(Mesh(turned, faces.reshape(-1, 3)))]
    return seen


def self_intersections(mesh: Mesh, first_only: bool = False) -> Ints:
    """Return pairs (k, 2) of faces that meet outside shared corners and edges, by exact predicates."""
    from igl import predicates

    took_part("libigl", "looked for faces that cross")
    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64),
        np.ascontiguousarray(mesh.faces, dtype=np.int64),
        first_only,
    )
    return np.asarray(pairs, dtype=np.int64).reshape(-1, 2)


def crossing_faces(mesh: Mesh) -> Ints:
    """Return the faces that cross others by pymeshlab's filter, which repairs nothing.

    Raises:
        ImportError: pymeshlab, or a library of the system that it needs, is missing.
    """
    import pymeshlab

    took_part("pymeshlab", "looked for faces that cross")
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(
        pymeshlab.Mesh(
            vertex_matrix=np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            face_matrix=np.ascontiguousarray(mesh.faces, dtype=np.int32),
        )
    )
    meshes.apply_filter("compute_selection_by_self_intersections_per_face")
    found = meshes.current_mesh()
    if found.selected_face_number() == 0:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(np.asarray(found.face_selection_array()))
