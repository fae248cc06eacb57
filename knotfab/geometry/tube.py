"""Sweep a centre line: one watertight tube of mitred prisms around a closed polyline.

manifold3d revolves the section into a torus, and carries the torus along the line. Each ring lies in
the plane that bisects the angle at its vertex. A reflection in that plane carries the section of one
segment onto the next, so the perpendicular section stays one and the same regular polygon, every side
face is plane, and the volume is (area of the polygon) x (length). One reflection per vertex is what
double reflection (Wang, Jüttler, Zheng and Liu, "Computation of rotation minimizing frames", ACM TOG
27(1), 2008) becomes on a polyline: the other one, across the segment itself, leaves the section alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, ceil, pi, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    from manifold3d import Manifold

Faces = NDArray[np.int32]


WITHIN_MM = 0.02  # from the centre line: a ring for each vertex would be finer than any layer
_GENTLE = 2.0  # tube radii: where a line bends more than this, every vertex keeps its ring
# tube radii: the least bend radius that a thinner line may have where the line has more
_ROOM = 1.05


def sweep(
    points: Array, radius_mm: float, sides: int, within_mm: float = 0.0
) -> tuple[Array, Faces]:
    """Return the tube of `radius_mm` around the closed polyline `points`, as a watertight mesh.

    Polylines have `sides` corners on a circle that is larger than the tube's by sqrt(a / sin a),
    a = 2 pi / sides, so that the section has the tube's area. What the frame lacks to close is
    first reduced by the section's own symmetry, to half a corner at most, and the rest is spread
    evenly along the length. The volume is that of the whole line, whichever vertices have rings.

    Args:
        points: (n, 3) mm, n >= 3; the last point joins the first.
        radius_mm: radius of the tube, > 0.
        sides: corners of a ring, >= 3.
        within_mm: vertices that lie so close to the chord of their neighbours get no ring (`thin_line`).

    Returns:
        vertices (n * sides, 3) float64 mm, in the order in which manifold3d keeps them, and faces
        (2 * n * sides, 3) int32, turned outwards: the enclosed volume is positive. A line of fewer
        points than sides may get several rings a segment.

    Raises:
        ValueError: wrong shapes, or numbers that cannot be lengths.
        SceneError: the polyline bends too tightly for the radius, so that a mitre would fold.
    """
    points = _check_points(points, radius_mm, sides)
    length = _length(points)
    if within_mm > 0:
        points = points[thin_line(points, radius_mm, within_mm)]
        radius_mm *= sqrt(length / _length(points))
    rings, offset = place_rings(points, radius_mm, sides)
    return carry_torus(rings, offset, pi * radius_mm**2 * _length(points))


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())


def thin_line(points: Array, radius_mm: float, within_mm: float) -> NDArray[np.int64]:
    """Choose vertices of a closed line (n, 3) whose polygon passes within `within_mm` of all others.

    Every second vertex goes where it may, round after round, so that edges stay about even. Where the polygon
    would bend too tightly for the tube all the same, the line's own vertices come back.
    """
    count, kept = len(points), np.arange(len(points))
    while len(kept) >= 6:
        odd = np.arange(1, len(kept), 2)
        start, end = kept[odd - 1], kept[(odd + 1) % len(kept)]
        chord = points[end] - points[start]
        square = np.einsum("ij,ij->i", chord, chord)
        span = (end - start) % count
        far = np.zeros(len(odd))
        for step in range(1, int(span.max())):
            off = points[(start + step) % count] - points[start]
            share = np.clip(np.einsum("ij,ij->i", off, chord) / np.maximum(square, 1e-300), 0, 1)
            apart = np.linalg.norm(off - share[:, None] * chord, axis=1)
            far = np.where(step < span, np.maximum(far, apart), far)
        # a chord c at the height h of an arc bends to the radius c² / 8h
        gone = odd[(far <= within_mm) & (square >= 8 * _GENTLE * radius_mm * far)]
        if not len(gone):
            break
        kept = np.delete(kept, gone)
    while True:
        bends = bend_radii(points[kept], polylines_of_sizes((len(kept),)))
        tight = kept[bends < _ROOM * radius_mm]
        wider = np.unique(np.concatenate([kept, tight - 1, tight + 1]) % count)
        if len(wider) == len(kept):
            return kept
        kept = wider


def place_rings(points: Array, radius_mm: float, sides: int) -> tuple[Array, int]:
    """Return the corners (n, sides, 3) of the rings of `sweep`, and how they close.

    Corner k of the last ring is joined to corner k + offset of the first.
    """
    p = _check_points(points, radius_mm, sides)
    edges = np.roll(p, -1, axis=0) - p
    lengths = np.sqrt(np.einsum("ij,ij->i", edges, edges))
    _require_room(p, edges, lengths, radius_mm)
    along = edges / lengths[:, None]
    before = np.roll(along, 1, axis=0)
    mitre = along + before  # normal of the bisecting plane
    mitre /= np.sqrt(np.einsum("ij,ij->i", mitre, mitre))[:, None]

    u, turn = _transport(along, mitre)
    v = np.cross(along, u)
    step = 2 * pi / sides
    # After one round u stands at angle `turn` from where it began. A whole number of corners of
    # that is taken up by joining the last ring to the first with an offset.
    offset = round(turn / step)
    untwist = turn - offset * step
    arc = np.concatenate([[0.0], np.cumsum(lengths[:-1])]) / lengths.sum()
    angle = (np.arange(sides) * step)[None, :] - (untwist * arc)[:, None]

    ring_radius = _ring_radius(radius_mm, sides)
    across, upward = ring_radius * np.cos(angle), ring_radius * np.sin(angle)  # (n, sides)
    # Each corner slides along its segment into the bisecting plane.
    slope = -1.0 / np.einsum("ij,ij->i", along, mitre)
    slope_u = slope * np.einsum("ij,ij->i", u, mitre)
    slope_v = slope * np.einsum("ij,ij->i", v, mitre)
    slide = across * slope_u[:, None] + upward * slope_v[:, None]
    # In the bisecting plane the next ring's corner has slid by as much against this segment as along
    # the next one.
    following = np.concatenate([slide[1:], np.roll(slide[:1], -offset, axis=1)])
    _require_unfolded(lengths, slide, following, p)

    rings = np.empty((len(p), sides, 3))
    for axis in range(3):
        rings[..., axis] = (
            p[:, axis, None]
            + across * u[:, axis, None]
            + upward * v[:, axis, None]
            + slide * along[:, axis, None]
        )
    return rings, offset


def carry_torus(rings: Array, offset: int, volume_mm3: float) -> tuple[Array, Faces]:
    """Return the mesh through corners and offset of `place_rings`: a torus of manifold3d, carried there.

    All side faces of the torus are split by the same diagonal, from corner k to k - 1 of the next ring. In
    some segments these diagonals serve as the edges along the tube, and the former edges as diagonals that
    lean the other way. There are as many such segments as `offset` needs, and nearly half of all, so that
    what the twist takes from faces of one kind it gives to the others.

    Raises:
        RuntimeError: what came out is not one handle of about this volume.
    """
    from manifold3d import CrossSection, Error

    took_part("manifold3d", "swept the tubes")
    sides = rings.shape[1]
    if (-offset) % sides > len(rings):
        # too few segments for the offset: each is divided, along the lines of its own surface
        parts = -(-sides // len(rings))
        ends = np.concatenate([rings[1:], np.roll(rings[:1], -offset, axis=1)])
        share = (np.arange(parts) / parts)[:, None, None]
        rings = (rings[:, None] + share * (ends - rings)[:, None]).reshape(-1, sides, 3)
    count = len(rings)
    choices = np.arange((-offset) % sides, count + 1, sides)
    leaning = int(choices[np.abs(2 * choices - count).argmin()])
    shift = np.arange(count) * leaning // count  # of the segments before each ring

    def carry(torus: Array) -> Array:
        ring = _nth(torus[:, 1], torus[:, 0], count)
        corner = _nth(-torus[:, 2], np.hypot(torus[:, 0], torus[:, 1]) - 2.0, sides)
        return np.asarray(rings[ring, (corner + shift[ring]) % sides])

    section = CrossSection.circle(1.0, sides).translate((2.0, 0.0))
    tube = section.revolve(count).warp_batch(carry)
    vertices, faces = as_mesh(tube)
    whole = tube.status() == Error.NoError and tube.genus() == 1 and np.isfinite(vertices).all()
    if not whole or not 0.5 * volume_mm3 < tube.volume() < 2.0 * volume_mm3:
        raise RuntimeError(
            f"manifold3d's tube is none: {tube.status().name}, genus {tube.genus()}, "
            f"{tube.volume():.6g} mm³ instead of {volume_mm3:.6g}"
        )
    return vertices, faces


def _nth(sine: Array, cosine: Array, count: int) -> NDArray[np.int64]:
    """Return the index of each direction among `count` evenly spaced angles, the first of which is 0."""
    return np.rint(np.arctan2(sine, cosine) * (count / (2 * pi))).astype(np.int64) % count


def reach_mm(points: Array, radius_mm: float, sides: int) -> float:
    """Return the largest distance of a corner of `sweep`'s mesh from its vertex of the line, mm."""
    along = np.roll(points, -1, axis=0) - points
    along /= np.linalg.norm(along, axis=1)[:, None]
    # the cosine is that of half the turn from one edge to the next
    cosine = 0.5 * np.linalg.norm(along + np.roll(along, 1, axis=0), axis=1)
    return _ring_radius(radius_mm, sides) / float(cosine.min())


def _ring_radius(radius_mm: float, sides: int) -> float:
    """Return the radius of the circle on which a section has its corners."""
    step = 2 * pi / sides
    return radius_mm * sqrt(step / sin(step))


def sides_for(radius_mm: float, tolerance_mm: float, least: int = 16, most: int = 256) -> int:
    """Return the even number of corners whose ring stays within `tolerance_mm` of the round tube's outline.

    A corner stands out by radius * a² / 12 in lowest order, twice as far as a face stays behind.
    """
    step = sqrt(12.0 * max(tolerance_mm, 1e-12) / radius_mm)
    return int(min(max(2 * ceil(pi / step), least), most))


def mesh_volume(vertices: Array, faces: Faces) -> float:
    """Return the signed volume (mm³) of a closed mesh; positive when the faces are turned outwards."""
    corner = (vertices - vertices.mean(axis=0))[faces]
    return float(np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0)


def _check_points(points: Array, radius_mm: float, sides: int) -> Array:
    """Return the points as (n, 3) float64; raise ValueError if they, the radius or the sides make no tube."""
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1:] != (3,) or len(p) < 3 or not np.isfinite(p).all():
        raise ValueError(f"points must be (n >= 3, 3) and finite, got shape {p.shape}")
    if not (radius_mm > 0 and np.isfinite(radius_mm)) or sides < 3:
        raise ValueError(f"radius {radius_mm} and {sides} sides do not make a tube")
    return p


def _require_room(p: Array, edges: Array, lengths: Array, radius_mm: float) -> None:
    """Refuse a vertex whose MinRad (Rawdon 1998) does not exceed the radius."""
    if lengths.min() <= 1e-9 * lengths.max():
        i = int(lengths.argmin())
        raise SceneError(
            "the centre line",
            f"vertices {i} and {(i + 1) % len(p)} coincide at {_format_point(p[i])}",
            "Resample the polyline",
        )
    back = np.roll(edges, 1, axis=0)
    shorter = np.minimum(lengths, np.roll(lengths, 1))
    product = lengths * np.roll(lengths, 1)
    # 2 tan(turning angle / 2) = 2 sin / (1 + cos) loses no digits near 0, as an arc cosine would
    sine = np.linalg.norm(np.cross(back, edges), axis=1) / product
    cosine = np.einsum("ij,ij->i", back, edges) / product
    opening = np.maximum(1.0 + cosine, 0.0)
    tight = (2.0 * sine * radius_mm >= shorter * opening) & ((sine > 0) | (cosine < 0))
    if tight.any():
        bend = np.where(tight, shorter * opening / np.maximum(2.0 * sine, 1e-9), np.inf)
        i = int(bend.argmin())
        raise SceneError(
            "the centre line",
            f"at vertex {i} {_format_point(p[i])} it bends to a radius of {bend[i]:.4g} mm, and a tube of "
            f"radius {radius_mm:.4g} mm would fold there ({int(tight.sum())} vertices in all)",
            "Use a thinner tube, or smooth the line",
        )


def _require_unfolded(lengths: Array, slide: Array, following: Array, p: Array) -> None:
    """Refuse rings that cross, which even a bend wider than the tube allows, since corners stand out of it.

    `slide` and `following` (segments, sides): how far the corners at a segment's start and at its end have
    slid into it.
    """
    least = (lengths[:, None] - slide - following).min(axis=1)
    if least.min() <= 0:
        i = int(least.argmin())
        raise SceneError(
            "the tube's mesh",
            f"rings {i} and {(i + 1) % len(p)} cross near {_format_point(p[i])}",
            "Use a thinner tube, more sides, or smooth the line",
        )


def _format_point(point: Array) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) mm"


def _transport(along: Array, mitre: Array) -> tuple[Array, float]:
    """Carry a vector across the first segment around the line.

    Returns (n, 3) unit vectors across each segment, each the reflection of the one before, and the
    angle in (-pi, pi] by which the last, carried on to the first segment, is ahead of the first.
    """
    first = np.zeros(3)
    first[np.abs(along[0]).argmin()] = 1.0
    first -= (first @ along[0]) * along[0]
    first /= np.linalg.norm(first)

    # A recurrence over thousands of 3-vectors: plain floats are ten times as fast as small arrays.
    x, y, z = (float(c) for c in first)
    rows = [(x, y, z)]
    for a, b, c in [*mitre[1:].tolist(), mitre[0].tolist()]:
        s = 2.0 * (x * a + y * b + z * c)
        x, y, z = x - s * a, y - s * b, z - s * c
        rows.append((x, y, z))
    u = np.array(rows)
    carried, u = u[-1], u[:-1]
    # Rounding errors of thousands of reflections: square the frame again.
    u -= np.einsum("ij,ij->i", u, along)[:, None] * along
    u /= np.sqrt(np.einsum("ij,ij->i", u, u))[:, None]
    return u, atan2(float(carried @ np.cross(along[0], u[0])), float(carried @ u[0]))


# Several closed surfaces as one mesh, and back again; meshes as solids that can be united.

Mesh = tuple[Array, NDArray[np.int32]]
"""Vertices (n, 3) mm and faces (m, 3)."""


def as_manifold(mesh: Mesh) -> Manifold:
    """Return a watertight mesh as a solid of manifold3d, in double precision."""
    from manifold3d import Manifold, Mesh64

    vertices, faces = mesh
    return Manifold(
        Mesh64(
            np.ascontiguousarray(vertices, dtype=np.float64),
            np.ascontiguousarray(faces, dtype=np.uint64),
        )
    )


def as_mesh(solid: Manifold) -> Mesh:
    """Return the surface of a solid."""
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return vertices, np.array(mesh.tri_verts, dtype=np.int32)


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return all meshes as one, in their order; no vertex is shared between them."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + shift for (_, faces), shift in zip(meshes, first, strict=True)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces).astype(np.int32)


def box_of(meshes: Sequence[Mesh]) -> tuple[Array, Array]:
    """Return lowest and highest corner (3,) of all meshes together, mm."""
    low = np.min([vertices.min(axis=0) for vertices, _ in meshes], axis=0)
    return low, np.max([vertices.max(axis=0) for vertices, _ in meshes], axis=0)


def face_normals(corners: Array) -> Array:
    """Return outward normals (m, 3) of triangles (m, 3, 3), each twice as long as the triangle's area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def unit(vectors: Array) -> Array:
    """Normalise vectors (..., 3) to length 1; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-300))


def keep_faces(vertices: Array, faces: NDArray[np.int32]) -> Mesh:
    """Return the mesh of some faces (k, 3), with only the vertices that they use."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def split_shells(mesh: Mesh) -> list[Mesh]:
    """Return the connected surfaces of a mesh, in the order of their first faces.

    Faces that share a vertex are connected; vertices that belong to no face are dropped.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, faces = mesh
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    n = len(vertices)
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    of_faces = label[faces[:, 0]]
    names, first = np.unique(of_faces, return_index=True)
    return [keep_faces(vertices, faces[of_faces == name]) for name in names[np.argsort(first)]]
