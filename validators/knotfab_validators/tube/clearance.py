"""Measure on the mesh itself how near the surfaces of two strands come."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_least, skip_check, spot
from knotfab_validators.geometry.curves import Curves, number_runs, point_segment, segment_segment
from knotfab_validators.geometry.mesh import (
    Mesh,
    bound_triangles,
    collision_body,
    collision_distance,
    number_bodies,
)
from knotfab_validators.geometry.surface import tell_heap
from knotfab_validators.geometry.triangles import nearest_edges, triangle_triangle, triangles_cross
from knotfab_validators.tube.thickness import (
    Samples,
    StrandPairs,
    arc_between,
    sample_curves,
    strand_pairs,
)

MOST_BODIES = 500
SPACING = 0.5  # radii between the samples of the centre lines
OWN = 1.25  # radii from the centre lines: a face farther away belongs to a mount
LOOK = 8.0  # radii: distances between strands are measured up to this
# share of the radius by which corners stand out of the exact tube at most; those of twelve flat sides
# with its volume do so by 0.0233
FACETS = 0.0235
MOST_AT_ONCE = 2_000_000  # pairs of faces that are compared without a tree
MOST_NEAR = 20_000_000  # pairs of two edges that are examined
SINGLE = 1e-6  # relative rounding of an STL's single-precision coordinates


@dataclass(frozen=True)
class Gap:
    """The smallest distance between the surfaces of two strands, mm.

    `points` (2, 3) are the nearest points, `edges` the edges of the centre lines there (counted
    over all knots). If the strands interpenetrate, `distance` is negative: by how much their centre
    lines are too near. `proud` is how far the corners of the two facets stand out of the exact tube,
    together.
    """

    distance: float
    points: Array
    edges: tuple[int, int]
    proud: float


@dataclass(frozen=True)
class _Surface:
    """The faces that belong to strands, sorted by the nearest edge of the centre lines."""

    corners: Array  # (m, 3, 3)
    centre: Array  # (m, 3)
    size: Array  # (m,) radius of the ball that holds the face
    first: Ints  # (edges + 1,) where each edge's faces begin
    after: Ints  # (edges,) the next edge along the curve
    start: Array  # (edges, 3)
    end: Array  # (edges, 3)
    reach: Array  # (edges,) distance from the edge to the farthest corner of its faces
    left_out: int


def check_clearance(mesh: Mesh, curves: Curves | None, required_mm: float | None) -> Check:
    """Check `clearance`: surfaces of two strands are at least `required_mm` apart; None measures only.

    With curves, strands are told apart by them (`strand_gap`); without, only the distance between
    separate bodies is seen. A tube of flat facets with rings of m corners at radius r has gaps up
    to 2 r (1 - cos(pi/m)) wider than the exact tube's 2 (half chord - r), and narrower by as much
    as corners stand out of the exact tube (`Gap.proud`), as they do where the facets keep its
    volume: that much, up to 2.4 % of the radius a facet, is allowed for.
    """
    name = "clearance"
    if not mesh.usable:
        return skip_check(name, "the mesh has no faces, or coordinates that are not finite")
    if curves is not None and not all(curves.closed):
        return skip_check(name, "the gaps of open curves are not measured")
    rounding = SINGLE * float(np.abs(mesh.vertices).max())
    if curves is None or curves.radius_mm is None:
        lacking = "centre lines" if curves is None else "the tube's radius"
        blind = f"not given {lacking}: gaps within one body were not looked for"
        found = nearest_bodies(mesh)
        if isinstance(found, str):
            return skip_check(name, f"{found}; {blind}")
        distance, points = found
        detail = f"between two bodies, {_spots(points)}; {blind}"
        if distance <= 0:
            detail = f"two bodies touch or interpenetrate, {_spots(points)}; {blind}"
        tolerance = rounding if distance > 0 else 0.0
        at = [points.mean(axis=0)]
        return at_least(name, distance, required_mm, "mm", detail, tolerance=tolerance, at=at)
    try:
        gap, cap, left_out = strand_gap(mesh, curves, required_mm or 0.0)
    except ValueError as error:
        return skip_check(name, str(error), required=True)
    if left_out == len(mesh.faces):
        detail = "no face of the mesh is near the centre lines"
        return Check(name, "fail", True, "no strand", required_mm, "mm", detail)
    rest = f"; {left_out} faces belong to no strand and were left out" if left_out else ""
    if gap is None:
        detail = f"no strands face each other within {cap:.2f} mm{rest}"
        return at_least(name, cap, required_mm, "mm", detail)
    tolerance = rounding + gap.proud if gap.distance > 0 else 0.0
    word = "interpenetrate" if gap.distance < 0 else "touch" if gap.distance == 0 else "are nearest"
    detail = f"{_name_edges(curves, gap.edges)} {word}, {_spots(gap.points)}{rest}"
    at = [gap.points.mean(axis=0)]
    return at_least(name, gap.distance, required_mm, "mm", detail, tolerance=tolerance, at=at)


def strand_gap(
    mesh: Mesh, curves: Curves, required_mm: float = 0.0
) -> tuple[Gap | None, float, int]:
    """Find the smallest distance between surfaces of strands that face each other.

    Every face belongs to the edge of the centre lines that its middle is nearest to. Triangles of
    two edges are measured exactly if places on these edges face each other (`strand_pairs`), that
    is, are not neighbours along one strand. A bend is measured as well if it is tighter than it
    may be: places at least pi (radius + required_mm / 2) apart along a knot count where their
    surfaces are nearer than `required_mm`, since a tube with that thickness has none. What counts are the
    nearest points' own places: a long face reaches past its edge.

    Two edges' faces keep the distance of the edges less the farthest corner on either side, so
    pairs of edges are taken in the order of that bound, until it exceeds the least distance found.

    Raises:
        ValueError: the radius is not known, or there is too much within reach to be measured.

    Returns:
        The gap, or None; the distance up to which was looked (a gap of None is larger); and the
        number of faces that belong to no strand.
    """
    if curves.radius_mm is None:
        raise ValueError("the tube's radius is not known")
    radius = curves.radius_mm
    samples = sample_curves(curves.polygons, SPACING * radius)
    surface = _sort_faces(mesh, curves, samples, radius)
    cap = max(LOOK * radius, 2 * required_mm)
    look = max(2 * required_mm, radius / 4)
    apart = np.pi * (radius + required_mm / 2)
    thick = 2 * float(surface.reach.max(initial=0.0))
    while True:
        pairs = strand_pairs(samples, thick + look + samples.step, apart)
        facing = _find_smallest(surface, samples, pairs, pairs.facing, look, radius)
        bend = _find_smallest(surface, samples, pairs, pairs.far, required_mm, radius, apart)
        if bend is not None and bend.distance >= required_mm:
            bend = None
        found = [gap for gap in (facing, bend) if gap is not None]
        if found or look >= cap:
            gap = min(found, key=lambda g: g.distance) if found else None
            return gap, cap, surface.left_out
        look = min(2 * look, cap)


def _sort_faces(mesh: Mesh, curves: Curves, samples: Samples, radius: float) -> _Surface:
    """Sort the mesh's faces by edge; faces near no strand are left out."""
    from scipy.spatial import cKDTree

    start, end = curves.edges.start, curves.edges.end
    last = np.cumsum([len(p) for p in curves.polygons])
    after = np.arange(1, len(start) + 1)
    after[last - 1] = np.concatenate([[0], last[:-1]])
    corners = mesh.vertices[mesh.faces]
    middle = corners.mean(axis=1)
    bound = (OWN + SPACING) * radius
    tree = cKDTree(samples.point)
    _, near = tree.query(middle, k=2, distance_upper_bound=bound)
    known = near < len(samples.point)
    near = np.where(known, near, 0)
    # a sample begins its piece of the curve: the nearest place may be on the piece before
    options = np.concatenate([samples.edge[near], samples.edge[samples.behind[near]]], axis=1)
    edge, distance, to_corner = nearest_edges(
        corners, middle, options, np.tile(known, 2), start, end
    )
    near_edge = distance <= OWN * radius
    own = near_edge & (to_corner <= OWN * radius)
    if 2 * own.sum() < near_edge.sum():
        # a coarse tube's faces are longer than the edges, and have corners nearer to other edges
        away, _ = tree.query(corners[near_edge].reshape(-1, 3))
        limit = np.hypot(OWN, SPACING / 2) * radius
        own[near_edge] = away.reshape(-1, 3).max(axis=1) <= limit
    order = np.flatnonzero(own)[np.argsort(edge[own], kind="stable")]
    reach = np.zeros(len(start))
    np.maximum.at(reach, edge[order], to_corner[order])
    corners = corners[order]
    low, high = bound_triangles(*corners.swapaxes(0, 1))
    centre = (low + high) / 2
    size = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    first = np.searchsorted(edge[order], np.arange(len(start) + 1))
    left_out = int(len(mesh.faces) - len(order))
    return _Surface(corners, centre, size, first, after, start, end, reach, left_out)


def _find_smallest(
    surface: _Surface,
    samples: Samples,
    pairs: StrandPairs,
    which: Mask,
    most: float,
    radius: float,
    apart_mm: float = 0.0,
) -> Gap | None:
    """Find the nearest triangles, up to `most` apart, on the edges of pairs of samples.

    Their nearest points are at least `apart_mm` apart along one knot, to the step of the samples.
    """
    count = np.int64(len(surface.start))
    # the edge before a sample is as near to it as the one after
    here = [samples.edge[pairs.i[which]], samples.edge[samples.behind[pairs.i[which]]]]
    there = [samples.edge[pairs.j[which]], samples.edge[samples.behind[pairs.j[which]]]]
    keys = np.unique(np.concatenate([a * count + b for a in here for b in there]))
    e, f = keys // count, keys % count
    apart = segment_segment(surface.start[e], surface.end[e], surface.start[f], surface.end[f])
    bound = apart - surface.reach[e] - surface.reach[f]
    adjacent = (e == f) | (surface.after[e] == f) | (surface.after[f] == e)
    keep = ~adjacent & (bound <= most)
    order = np.argsort(bound[keep])
    e, f, bound, apart = (x[keep][order] for x in (e, f, bound, apart))
    best: Gap | None = None
    sizes = surface.first[e + 1] - surface.first[e] + surface.first[f + 1] - surface.first[f]
    portion = np.cumsum(sizes) // 20_000
    for begin, stop in _find_runs(portion):
        if bound[begin] > most:
            break
        a, b, own = _pairs_of_faces(surface, e[begin:stop], f[begin:stop], most)
        own += begin
        if not len(a):
            continue
        one, other = surface.corners[a], surface.corners[b]
        distance, p, q = triangle_triangle(one, other)
        crossed = triangles_cross(one, other)
        # deeper means less: the distance is by how much the centre lines are too near
        deep = np.minimum(apart[own] - 2 * radius, 0.0)
        distance = np.where(crossed, deep, distance)
        if apart_mm > 0:
            near = np.flatnonzero(distance <= most)
            i, j = (
                _find_places(samples, points[near], edges[own[near]], 2 * surface.size[face[near]])
                for points, edges, face in ((p, e, a), (q, f, b))
            )
            along = arc_between(samples, i, j)
            own_strand = samples.knot[i] == samples.knot[j]
            distance[near[own_strand & (along < apart_mm - samples.step)]] = np.inf
        k = int(distance.argmin())
        if distance[k] <= most:
            ends = (int(e[own[k]]), int(f[own[k]]))
            proud = sum(
                _measure_proud(surface, corners[k], edge, radius)
                for corners, edge in zip((one, other), ends, strict=True)
            )
            best = Gap(float(distance[k]), np.stack([p[k], q[k]]), ends, proud)
            most = best.distance
    return best


def _find_places(samples: Samples, points: Array, edges: Ints, reach: Array) -> Ints:
    """Find the sample nearest to each point (n, 3), of those within `reach` (n,) along from its edge."""
    begin = np.searchsorted(samples.edge, edges)
    best, least = begin.copy(), np.linalg.norm(points - samples.point[begin], axis=1)
    for step in (samples.ahead, samples.behind):
        at, on = begin.copy(), np.arange(len(begin))
        while len(on):
            at[on] = step[at[on]]
            on = on[(at[on] != begin[on]) & (arc_between(samples, begin[on], at[on]) <= reach[on])]
            away = np.linalg.norm(points[on] - samples.point[at[on]], axis=1)
            less = away < least[on]
            best[on[less]], least[on[less]] = at[on[less]], away[less]
    return best


def _find_runs(portion: Ints) -> list[tuple[int, int]]:
    """Return where runs of equal numbers begin and end."""
    cuts = np.flatnonzero(np.diff(portion)) + 1
    ends = [0, *cuts.tolist(), len(portion)]
    return [(a, b) for a, b in pairwise(ends) if b > a]


def _pairs_of_faces(surface: _Surface, e: Ints, f: Ints, most: float) -> tuple[Ints, Ints, Ints]:
    """Return pairs of faces at edges e and f that may lie within `most` mm, and the pair of edges of each."""
    (row, one), (column, other) = _faces_near(surface, e, f, most), _faces_near(surface, f, e, most)
    rows, columns = np.bincount(row, minlength=len(e)), np.bincount(column, minlength=len(e))
    sizes = rows * columns
    if sizes.sum() > MOST_AT_ONCE:
        if len(e) == 1:
            a, b = _centres_near(surface, one, other, most)
            return a, b, np.zeros(len(a), dtype=np.int64)
        parts = [_pairs_of_faces(surface, e[[k]], f[[k]], most) for k in range(len(e))]
        lengths = [len(part[0]) for part in parts]
        a, b = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
        return a, b, np.repeat(np.arange(len(e)), lengths)
    own, number = number_runs(sizes)
    width = columns[own]
    a = one[(np.cumsum(rows) - rows)[own] + number // width]
    b = other[(np.cumsum(columns) - columns)[own] + number % width]
    apart = np.linalg.norm(surface.centre[a] - surface.centre[b], axis=1)
    near = apart - surface.size[a] - surface.size[b] <= most
    return a[near], b[near], own[near]


def _centres_near(surface: _Surface, one: Ints, other: Ints, most: float) -> tuple[Ints, Ints]:
    """Return pairs of faces of two long lists that may be `most` apart, by trees of their centres."""
    from scipy.spatial import cKDTree

    reach = most + float(surface.size[one].max() + surface.size[other].max())
    first, second = cKDTree(surface.centre[one]), cKDTree(surface.centre[other])
    if first.count_neighbors(second, reach) > MOST_NEAR:
        raise ValueError("the surface is so finely cut that its gaps cannot be measured")
    near = first.sparse_distance_matrix(second, reach, output_type="ndarray")
    keep = near["v"] - surface.size[one[near["i"]]] - surface.size[other[near["j"]]] <= most
    return one[near["i"][keep]], other[near["j"][keep]]


def _faces_near(surface: _Surface, e: Ints, f: Ints, most: float) -> tuple[Ints, Ints]:
    """Return faces of edges e that may be `most` from a face of edges f, and the index of their edge."""
    counts = surface.first[e + 1] - surface.first[e]
    own, number = number_runs(counts)
    face, to = surface.first[e][own] + number, f[own]
    distance = point_segment(surface.centre[face], surface.start[to], surface.end[to])
    near = distance - surface.size[face] - surface.reach[to] <= most
    return own[near], face[near]


def _measure_proud(surface: _Surface, corners: Array, edge: int, radius: float) -> float:
    start, end = surface.start[[edge] * 3], surface.end[[edge] * 3]
    out = float(point_segment(corners, start, end).max()) - radius
    return min(max(out, 0.0), FACETS * radius)


def _name_edges(curves: Curves, edges: tuple[int, int]) -> str:
    counts = np.cumsum([len(p) for p in curves.polygons])
    names = []
    for edge in edges:
        knot = int(np.searchsorted(counts, edge, side="right"))
        vertex = edge - (int(counts[knot - 1]) if knot else 0)
        names.append(f"knot {knot} vertex {vertex}")
    return " and ".join(names)


def _spots(points: Array) -> str:
    return " and ".join(map(spot, points))


def nearest_bodies(mesh: Mesh) -> tuple[float, Array] | str:
    """Return the least distance of two connected surfaces, 0 if they cross, and the nearest points (2, 3).

    FCL's trees of boxes give exact triangle distances. Pairs are taken by the distance of their
    bounding boxes. If there is only one body, or more than 500, or the faces are such a heap that
    trees do not help, a sentence is returned instead.
    """
    # faces that lie on each other are equally far from everything
    once = np.unique(np.sort(mesh.faces, axis=1), axis=0)
    if len(once) < len(mesh.faces):
        mesh = Mesh(mesh.vertices, once)
    label, count = number_bodies(mesh)
    if count == 1:
        return "the part is one body"
    if count > MOST_BODIES:
        return f"the part falls into {count} bodies, more than {MOST_BODIES}"
    if why := tell_heap(mesh):
        return why
    models, low, high = [], [], []
    for body in range(count):
        faces = mesh.faces[label[mesh.faces[:, 0]] == body]
        used, index = np.unique(faces, return_inverse=True)
        points = mesh.vertices[used]
        low.append(points.min(axis=0))
        high.append(points.max(axis=0))
        models.append(collision_body(Mesh(points, index.reshape(-1, 3))))
    i, j = np.triu_indices(count, 1)
    a, b = np.array(low), np.array(high)
    gap = np.linalg.norm(np.maximum(np.maximum(a[i] - b[j], a[j] - b[i]), 0.0), axis=1)
    best, points = np.inf, np.zeros((2, 3))
    for k in np.argsort(gap):
        if gap[k] >= best:
            break
        distance, nearest = collision_distance(models[i[k]], models[j[k]])
        if distance < best:
            best, points = distance, nearest
    return best, points
