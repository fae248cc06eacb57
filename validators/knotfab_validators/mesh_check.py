"""A part's surface: closed, wound outwards, bodies of genus 1, right volume, nothing crossing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .check import Check, at_most, skipped
from .read_knots import Curves
from .read_mesh import Mesh

__all__ = ["Surface", "check_mesh", "self_intersections", "survey"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

VOLUME_LIMIT = 0.005  # relative difference from Pappus' volume

NAMES = (
    "mesh_closed",
    "mesh_winding",
    "mesh_degenerate",
    "mesh_bodies",
    "mesh_genus",
    "mesh_volume",
    "mesh_self_intersection",
)


@dataclass(frozen=True)
class Surface:
    """What a mesh is made of.

    `open_edges` are edges that not exactly two faces share, `flipped_edges` those that two faces
    share in the same direction; `where` is the middle of the first bad edge, mm. `body` (m,) is
    each face's body; `genus` and `volumes_mm3` have one value per body (signed volumes).
    """

    open_edges: int
    flipped_edges: int
    where: Array | None
    degenerate: Ints
    body: Ints
    genus: Ints
    volumes_mm3: Array


def survey(mesh: Mesh) -> Surface:
    """Edges, bodies, genera and volumes of a mesh with finite vertices.

    The genus follows from V - E + F = 2 - 2g per body and means something only where the mesh is
    closed; so does the volume.
    """
    faces, vertices = mesh.faces, mesh.vertices
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * np.int64(len(vertices)) + high
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(first, append=len(key))
    forward = np.add.reduceat((start < end)[order].astype(np.int64), first)
    is_open, is_flipped = count != 2, (count == 2) & (forward != 1)
    where = None
    bad = np.flatnonzero(is_open | is_flipped)
    if len(bad):
        edge = order[first[bad[0]]]
        where = (vertices[start[edge]] + vertices[end[edge]]) / 2

    body_of_vertex, bodies = _components(low[order[first]], high[order[first]], len(vertices))
    body = body_of_vertex[faces[:, 0]]
    used = np.unique(faces)
    euler = (
        np.bincount(body_of_vertex[used], minlength=bodies)
        - np.bincount(body_of_vertex[low[order[first]]], minlength=bodies)
        + np.bincount(body, minlength=bodies)
    )
    corner = vertices[faces] - vertices.mean(axis=0)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    flat = ~normal.any(axis=1) | repeated
    # corner · normal is six times the tetrahedron between face and middle: corner × corner is 0.
    volumes = np.bincount(body, np.einsum("ij,ij->i", corner[:, 0], normal), minlength=bodies) / 6
    return Surface(
        open_edges=int(is_open.sum()),
        flipped_edges=int(is_flipped.sum()),
        where=where,
        degenerate=np.flatnonzero(flat),
        body=body,
        genus=1 - euler // 2,
        volumes_mm3=volumes,
    )


def self_intersections(mesh: Mesh) -> Ints:
    """Pairs (k, 2) of faces that meet elsewhere than in what they share, by exact predicates.

    libigl's `find_self_intersections` (AABB tree, Shewchuk's predicates) decides alone: it needs
    0.6 s for 300,000 faces. Faces without area have no side to test, so they must be excluded
    before.
    """
    from igl import predicates

    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
    )
    found: Ints = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    return found


def check_mesh(mesh: Mesh, curves: Curves | None = None, *, only_knots: bool = True) -> list[Check]:
    """All checks of the surface; those that a failure before makes meaningless are skipped.

    Args:
        mesh: the part. curves: its knots, where they are known: one body each, and the volume by
            Pappus (pi r² L within 0.5 %).
        only_knots: the part is nothing but tubes; otherwise number and volume of its bodies are
            not known beforehand.
    """
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        why = "coordinates that are not finite" if len(mesh.faces) else "no faces"
        closed = Check("mesh_closed", "fail", True, why, None, "", f"the mesh has {why}")
        return [closed, *_not_run(NAMES[1:], f"the mesh has {why}")]
    found = survey(mesh)
    place = "" if found.where is None else f", the first at {_place(found.where)}"
    checks = [
        at_most(
            "mesh_closed",
            found.open_edges,
            0,
            "edges",
            f"edges that are not shared by exactly two faces, of {len(mesh.faces)} faces{place}",
        ),
        at_most(
            "mesh_winding",
            found.flipped_edges,
            0,
            "edges",
            f"edges whose two faces are wound against each other{place}",
        ),
        at_most("mesh_degenerate", len(found.degenerate), 0, "faces", "faces without an area"),
    ]
    if found.open_edges or found.flipped_edges:
        return checks + _not_run(NAMES[3:], "the mesh is not closed and consistently wound")
    known = curves if only_knots else None
    checks += [_bodies(found, known), _genus(found, only_knots), _volume(found, known)]
    if len(found.degenerate):
        return checks + _not_run(NAMES[6:], "faces without an area cannot be tested")
    return [*checks, _apart(mesh)]


def _bodies(found: Surface, curves: Curves | None) -> Check:
    count = len(found.volumes_mm3)
    wanted = None if curves is None else len(curves.polygons)
    holds = wanted is None or count == wanted
    detail = "closed surfaces" + ("" if wanted is None else ", one for each knot")
    return Check("mesh_bodies", "pass" if holds else "fail", True, count, wanted, "", detail)


def _genus(found: Surface, only_knots: bool) -> Check:
    if not only_knots:
        return skipped("mesh_genus", "the part is more than tubes")
    wrong = np.flatnonzero(found.genus != 1)
    worst = int(found.genus[wrong[0]]) if len(wrong) else 1
    detail = "every body is a closed tube (genus 1)"
    if len(wrong):
        detail = f"{len(wrong)} of {len(found.genus)} bodies are no closed tubes (genus 1)"
    return Check("mesh_genus", "fail" if len(wrong) else "pass", True, worst, 1, "", detail)


def _volume(found: Surface, curves: Curves | None) -> Check:
    """Against Pappus: a tube's volume is the section's area times the way of its centre."""
    volume = float(found.volumes_mm3.sum())
    inverted = np.flatnonzero(~(found.volumes_mm3 > 0))
    if len(inverted):
        return Check(
            "mesh_volume",
            "fail",
            True,
            float(found.volumes_mm3[inverted[0]]),
            0.0,
            "mm³",
            f"{len(inverted)} of {len(found.volumes_mm3)} bodies are turned inside out",
        )
    if curves is None or curves.radius_mm is None:
        return Check("mesh_volume", "pass", True, volume, 0.0, "mm³", "every body's is positive")
    wanted = np.sort(np.pi * curves.radius_mm**2 * np.array(curves.lengths_mm))
    bodies = np.sort(found.volumes_mm3)
    each = ""
    if len(bodies) != len(wanted):  # then they can be compared in sum only
        bodies, wanted = bodies.sum(keepdims=True), wanted.sum(keepdims=True)
    elif len(bodies) > 1:
        each = ", the worst of all knots"
    difference = np.abs(bodies - wanted) / wanted
    worst = int(difference.argmax())
    return at_most(
        "mesh_volume",
        float(difference[worst]),
        VOLUME_LIMIT,
        "relative",
        f"{bodies[worst]:.6g} mm³ against {wanted[worst]:.6g} mm³, the tube's section times its "
        f"length{each}",
    )


def _apart(mesh: Mesh) -> Check:
    pairs = self_intersections(mesh)
    detail = "pairs of faces that meet elsewhere than in a shared edge or corner"
    if len(pairs):
        middle = mesh.vertices[mesh.faces[pairs[0, 0]]].mean(axis=0)
        detail += f", the first at {_place(middle)}"
    return at_most("mesh_self_intersection", len(pairs), 0, "pairs", detail)


def _not_run(names: tuple[str, ...], why: str) -> list[Check]:
    return [skipped(name, why) for name in names]


def _components(start: Ints, end: Ints, count: int) -> tuple[Ints, int]:
    """The number of each vertex's body, and how many bodies have edges; lone vertices get 0."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    bodies = np.unique(label[start])
    return np.searchsorted(bodies, label).clip(max=len(bodies) - 1).astype(np.int64), len(bodies)


def _place(point: Array) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) mm"
