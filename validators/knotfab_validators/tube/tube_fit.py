"""Check that part and knots belong together: the part's surface is the tube around the centre lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_most, places, skip_check, spot, worst_apart
from knotfab_validators.geometry.curves import (
    CurveEdges,
    Curves,
    cut_edges,
    halve_sides,
    quarter_triangles,
)
from knotfab_validators.geometry.mesh import Mesh, surface_distance, winding_numbers

# share of the radius: facets cost knotfab's parts about 1 %, twelve flat sides 3.4 %
LIMIT = 0.04
REACH = 4.0  # radii: distances are capped here, since trees are slow far out
STEP = 1 / 6  # radii between samples of the curve, which find the nearest edge
MOST_SAMPLES = 2_000_000  # the limit on absurdly long curves
RING_STEP = 0.5  # radii between the rings of points on the exact tube
ANGLES = 8  # points of a ring
STRETCH = 8  # rings of a mounted part that are judged together
# share of a stretch's points that must lie on the surface; beside pegs and struts 0.78 do
SHARE = 0.5
PROUD = 1.0235  # radii: corners of twelve flat sides with the tube's volume stand out this far
SAME = 1e-6  # share by which the radii of two files may differ
BED_MM = 1e-3  # tolerance of the level underside of a foot read from a file
LEVELS = 4  # times that a face which may dip too deep is quartered


@dataclass(frozen=True)
class TubeFit:
    """Deviations between mesh and exact tube, both in radii, with places (k, 3), mm, worst first.

    `off` is the largest deviation of a point of the mesh from the exact tube; `bare` is the largest
    distance of a point of the exact tube from the mesh. Both are capped at `REACH`.
    """

    off: float
    off_at: Array
    bare: float
    bare_at: Array


def tube_fit(
    mesh: Mesh, curves: Curves, *, mounted: bool = False, bed: float | None = None
) -> TubeFit:
    """Measure the distances between a part's surface and the exact tube of known radius, both ways.

    The exact tube is all that lies one radius from the centre lines. Where the edges of a centre line
    meet at an angle it is round outside; the two edges' cylinders, extended until they meet (a mitre),
    will do as well, and so will the flat disc across an open end instead of the half ball about it.

    On a `mounted` part, pegs and struts grow out of the tube, so points of the exact tube that lie in matter
    do not count as bare, provided that in `STRETCH` consecutive rings at least the share `SHARE` of all
    points is on the surface. This tells a tube of another radius from one with a mount. Points of the mesh
    outside the tube may be the mount's, and do not count as off. Those inside do: where a mount joins a tube,
    their union has no faces, so a face in there is a slit or a cavity.

    If the tube is cut level at z = `bed`, so that it stands flat, nothing below is tube, and a point at that
    height is off only by how far it lies outside the tube.

    From the mesh: every vertex is measured, and faces that could dip deeper than `LIMIT` between
    their corners are cut into four and measured again (see `_may_dip`). To the mesh: `ANGLES` points
    on rings half a radius apart, but for those that lie inside the tube where it bends, are measured
    to the nearest face.
    """
    if curves.radius_mm is None:
        raise ValueError("the tube's radius is not known")
    line = _Line(curves.edges, curves.radius_mm, _open_ends(curves))
    points, off = _from_mesh(mesh, line, mounted, bed)
    rings, ring, curve = _on_tube(line)
    if bed is not None:
        kept = rings[:, 2] > bed
        rings, ring = np.ascontiguousarray(rings[kept]), ring[kept]
    bare = np.minimum(surface_distance(rings, mesh) / line.radius, REACH)
    if mounted:
        far = np.flatnonzero((bare > LIMIT) & ~_lacks_surface(bare <= LIMIT, ring, curve)[ring])
        bare[far[winding_numbers(rings[far], mesh) > 0.5]] = 0.0
    if not len(bare):  # the tube lies inside itself everywhere, so that no point is on its surface
        bare, rings = np.zeros(1), line.edges.start[:1]
    apart = 2 * line.radius
    i, j = worst_apart(off, points, apart, LIMIT), worst_apart(bare, rings, apart, LIMIT)
    return TubeFit(float(off[i[0]]), points[i], float(bare[j[0]]), rings[j])


def check_tube(
    mesh: Mesh,
    curves: Curves | None,
    *,
    mounted: bool = False,
    asked_mm: float | None = None,
    flat: bool = False,
) -> Check:
    """Check `tube`: the mesh is the tube around these curves, within 4 % of its radius both ways.

    What is proved of the knots (thickness, bend, type) holds for the part only if it is. A `mounted`
    part has more matter than the tube: then the exact tube must lie on its surface or, where the
    mount joins it, inside, and no face lies in the tube (`tube_fit`). `asked_mm`: the scene's radius, which
    must be that of the curves. `flat`: the part stands on feet that are cut level at its lowest corner.
    """
    if curves is None or curves.radius_mm is None:
        lacking = "the knots" if curves is None else "the tube's radius"
        return skip_check("tube", f"not given {lacking}")
    if not mesh.usable:
        return skip_check("tube", "the mesh has no faces, or coordinates that are not finite")
    bed = float(mesh.vertices[:, 2].min()) if flat else None
    fit = tube_fit(mesh, curves, mounted=mounted, bed=bed)
    radius = curves.radius_mm
    if fit.bare > max(fit.off, LIMIT):
        measured, at = fit.bare, fit.bare_at
        what = "the exact tube about the knots has a place that is so far from the surface"
    else:
        measured, at = fit.off, fit.off_at
        what = "largest deviation of the surface from one radius about the knots"
        if mounted:
            what = (
                "how deep the surface lies inside the tube about the knots, which matter must fill"
            )
    detail = f"{what}, at {spot(at[0])}"
    limit = LIMIT * radius
    if asked_mm is not None and abs(radius - asked_mm) > SAME * asked_mm and measured <= LIMIT:
        detail = "the knots' radius is not the scene's piece.tube_radius_mm"
        return Check("tube", "fail", True, radius, asked_mm, "mm", detail)
    return at_most("tube", measured * radius, limit, "mm", detail, tolerance=1e-9 * radius, at=at)


def check_cut(mesh: Mesh, curves: Curves) -> Check:
    """Check `cut`: feet are cut no higher than the centre line, and by as much as knots.json says.

    The shadow of a tube that is lit from above is then that of the whole tube.
    """
    assert curves.radius_mm is not None
    lowest = min((p[p[:, 2].argmin()] for p in curves.polygons), key=lambda p: float(p[2]))
    cut = curves.radius_mm - float(lowest[2] - mesh.vertices[:, 2].min())
    tolerance = (LIMIT + PROUD - 1) * curves.radius_mm  # facets stand out at the bottom too
    what = f"how much of the lowest foot is missing, at {spot(lowest)}"
    if abs(cut - curves.cut_mm) > tolerance:
        detail = f"{what}, and knots.json says {curves.cut_mm:.2f} mm"
        return Check("cut", "fail", True, cut, curves.cut_mm, "mm", detail, places([lowest]))
    limit = curves.radius_mm
    return at_most("cut", cut, limit, "mm", f"{what}; no more than the radius", at=[lowest])


def measure_proud(mesh: Mesh, curves: Curves, places: Array) -> Array:
    """Measure how far corners of the mesh near places (k, 3) stand out of the exact tube at most, mm (k,).

    Corners count within a diameter of each place and `PROUD` radii of a centre line.
    """
    from scipy.spatial import cKDTree

    assert curves.radius_mm is not None
    line = _Line(curves.edges, curves.radius_mm, _open_ends(curves))
    beside = cKDTree(mesh.vertices).query_ball_point(places, 2 * line.radius)
    found = np.zeros(len(places))
    for k, near in enumerate(beside):
        distance = line.distance(mesh.vertices[near])[0]
        out = distance[distance <= PROUD * line.radius] - line.radius
        found[k] = max(float(out.max(initial=0.0)), 0.0)
    return found


class _Line:
    """The centre lines with a search tree, for distances from them."""

    def __init__(self, edges: CurveEdges, radius: float, ends: list[tuple[Array, Array]]) -> None:
        from scipy.spatial import cKDTree

        self.edges, self.radius, self.ends = edges, radius, ends
        self.edge = edges.end - edges.start
        self.length = np.linalg.norm(self.edge, axis=1)
        self.unit = self.edge / self.length[:, None]
        total = float(self.length.sum())
        self.step = max(STEP * radius, total / MOST_SAMPLES)
        self.which, begin, part = cut_edges(edges.start, edges.end, self.step)
        middle = (begin + part / 2)[:, None] * self.edge[self.which]
        self.tree = cKDTree(edges.start[self.which] + middle)
        # each edge's neighbours along its curve; at an open end one of them is wrong, which does no harm:
        # the nearest of three edges is taken
        count = np.bincount(edges.curve)[edges.curve]
        first = np.searchsorted(edges.curve, edges.curve)
        place = np.arange(len(first)) - first
        self.before, self.after = first + (place - 1) % count, first + (place + 1) % count
        # a mitre reaches past either end of an edge by the radius times tan of half the turn
        cosine = np.einsum("ij,ij->i", self.unit, self.unit[self.after])
        joined = np.all(edges.end == edges.start[self.after], axis=1)
        tangent = np.sqrt(np.maximum(1 - cosine, 0.0) / np.maximum(1 + cosine, 1e-3))
        self.past_end = np.where(joined, radius * tangent, 0.0)
        self.past_start = np.where(joined[self.before], self.past_end[self.before], 0.0)

    def distance(self, points: Array) -> tuple[Array, Array, Ints]:
        """Return distances (n,) of points (n, 3), capped at `REACH` radii, mitred ones, and the edges.

        The mitred distance is that from the straight line through the edge for points that may
        belong to a mitre, and the distance itself for all others.

        The nearest sample\'s edge and its two neighbours are measured exactly. An edge of another
        strand that is nearer than all three is so by less than step² / (8 distance), a third of a
        percent of the radius at the tube\'s surface.
        """
        reach = REACH * self.radius
        _, sample = self.tree.query(points, distance_upper_bound=reach + self.step)
        found = np.flatnonzero(sample < len(self.which))
        best, mitred = np.full(len(points), reach), np.full(len(points), reach)
        edge = np.zeros(len(points), dtype=np.int64)
        nearest, p = self.which[sample[found]], points[found]
        for at in (nearest, self.before[nearest], self.after[nearest]):
            to = p - self.edges.start[at]
            along = np.einsum("ij,ij->i", to, self.unit[at])
            foot = np.clip(along, 0.0, self.length[at])
            gap = to - foot[:, None] * self.unit[at]
            far = np.sqrt(np.einsum("ij,ij->i", gap, gap))
            mitred[found[far < best[found] - 1e-9 * self.radius]] = reach
            nearer = far < best[found]
            best[found[nearer]] = far[nearer]
            edge[found[nearer]] = at[nearer]
            past_start, past_end = -along, along - self.length[at]
            mitre = (past_start > 0) & (past_start <= 1.05 * self.past_start[at])
            mitre |= (past_end > 0) & (past_end <= 1.05 * self.past_end[at])
            mitre &= far <= best[found] + 1e-9 * self.radius
            line = np.sqrt(np.maximum(np.einsum("ij,ij->i", to, to) - along**2, 0.0))
            mitred[found[mitre]] = np.where(
                np.abs(line - self.radius) < np.abs(mitred[found] - self.radius),
                line,
                mitred[found],
            )[mitre]
        return best, np.minimum(mitred, best), edge

    def off(self, points: Array, distance: Array, mitred: Array) -> Array:
        """Return the deviation (n,) of points from the exact tube, in radii, given their distances."""
        off = np.minimum(np.abs(distance - self.radius), np.abs(mitred - self.radius))
        for end, outwards in self.ends:
            near = np.flatnonzero(distance < 2 * self.radius)
            near = near[np.abs(points[near] - end).max(axis=1) < 2 * self.radius]
            to = points[near] - end
            axial = to @ outwards
            radial = np.linalg.norm(to - axial[:, None] * outwards, axis=1)
            disc = np.hypot(axial, np.maximum(radial - self.radius, 0.0))
            off[near] = np.minimum(off[near], disc)
        return np.asarray(off / self.radius)


def _open_ends(curves: Curves) -> list[tuple[Array, Array]]:
    """Return the ends of the open curves: point (3,) and outward unit vector (3,)."""
    ends = []
    for polygon, closed in zip(curves.polygons, curves.closed, strict=True):
        if closed:
            continue
        for end, inner in ((polygon[0], polygon[1]), (polygon[-1], polygon[-2])):
            ends.append((end, (end - inner) / np.linalg.norm(end - inner)))
    return ends


def _from_mesh(mesh: Mesh, line: _Line, mounted: bool, bed: float | None) -> tuple[Array, Array]:
    """Return points of the mesh (n, 3), vertices and more where needed, and how far off they are (n,).

    On a `mounted` part, points outside the tube count as 0; at the height of the `bed`, points inside do.
    """

    def measure(points: Array) -> tuple[Array, Array, Ints]:
        distance, mitred, edge = line.distance(points)
        off = line.off(points, distance, mitred)
        if bed is not None:
            inside = (distance < line.radius) & (points[:, 2] <= bed + BED_MM)
            off[inside] = 0.0
        return distance, np.where(distance < line.radius, off, 0.0) if mounted else off, edge

    distance, off, edge = measure(mesh.vertices)
    used = np.flatnonzero(np.bincount(mesh.faces.reshape(-1), minlength=len(off)))
    points, values = [mesh.vertices[used]], [off[used]]
    corner, far, at = mesh.vertices[mesh.faces], distance[mesh.faces], edge[mesh.faces]
    for _ in range(LEVELS):
        # a place that cannot exceed the known maximum needs no closer look
        deepest = max(LIMIT, *(float(v.max()) for v in values))
        dips = np.flatnonzero(_may_dip(corner, far.min(axis=1), at, line, deepest))[:50_000]
        if not len(dips):
            break
        middle = halve_sides(corner[dips])
        points.append(middle.reshape(-1, 3))
        distance, off, edge = measure(points[-1])
        values.append(off)
        corner = quarter_triangles(corner[dips], middle)
        far = quarter_triangles(far[dips], distance.reshape(-1, 3))
        at = quarter_triangles(at[dips], edge.reshape(-1, 3))
    return np.concatenate(points), np.concatenate(values)


def _may_dip(corner: Array, low: Array, at: Ints, line: _Line, deep: float) -> Mask:
    """Return which faces (m, 3, 3) may come nearer to the curve than radius (1 - `deep`).

    The distance d from a straight line is convex; its curvature is at most 1/d across the line and
    0 along it. A triangle with sides at most h long across the line lies in a circle of radius h /
    sqrt(3), so within it d dips by at most h² / 6d below its corners' values. If the corners are
    nearest to edges that are not neighbours, h is the whole side.
    """
    side = np.roll(corner, -1, axis=1) - corner
    along = np.einsum("mij,mj->mi", side, line.unit[at[:, 0]])
    square = np.einsum("mij,mij->mi", side, side)
    jumps = at.max(axis=1) - at.min(axis=1) > 2
    across = square - np.where(jumps[:, None], 0.0, along**2)
    lowest = np.maximum(low, 0.5 * line.radius)
    dip = across.max(axis=1) / (6 * lowest)
    may: Mask = low - dip < (1 - deep) * line.radius
    return may


def _on_tube(line: _Line) -> tuple[Array, Ints, Ints]:
    """Sample the exact tube in rings at even steps along the curves.

    Returns:
        (k, 3) the points, (k,) the ring of each, and (rings,) the curve of each ring.
    """
    total = float(line.length.sum())
    rings = int(np.clip(np.ceil(total / (RING_STEP * line.radius)), 1, 20_000))
    until = np.cumsum(line.length)
    arc = (np.arange(rings) + 0.5) * (total / rings)
    at = np.minimum(np.searchsorted(until, arc), len(until) - 1)
    along = line.unit[at]
    middle = line.edges.start[at] + (arc - until[at] + line.length[at])[:, None] * along
    least = np.eye(3)[np.abs(along).argmin(axis=1)]
    u = np.cross(along, least)
    u /= np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(along, u)
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    outwards = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    points = (middle[:, None] + line.radius * outwards).reshape(-1, 3)
    distance, _, _ = line.distance(points)
    shows = distance > (1 - 1e-3) * line.radius
    ring = np.repeat(np.arange(rings), ANGLES)[shows]
    return np.ascontiguousarray(points[shows]), ring, line.edges.curve[at]


def _lacks_surface(on: Mask, ring: Ints, curve: Ints) -> Mask:
    """Return which rings (rings,) are in a stretch of their curve with too few points on the surface.

    Args:
        on: (k,) of each point. ring: (k,) its ring. curve: (rings,) of each ring, in order.
    """
    every = np.bincount(ring, minlength=len(curve))
    found = np.bincount(ring, on, minlength=len(curve))
    lacks = np.zeros(len(curve), dtype=bool)
    for number in np.unique(curve):
        own = np.flatnonzero(curve == number)
        length = min(STRETCH, len(own))
        # also stretches that wrap around the curve's start
        turn = np.concatenate([own, own[: length - 1]])
        window = np.ones(length)
        bare = np.convolve(found[turn], window, "valid") < SHARE * np.convolve(
            every[turn], window, "valid"
        )
        for start in np.flatnonzero(bare):
            lacks[turn[start : start + length]] = True
    return lacks
