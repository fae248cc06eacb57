"""Tell the tube's matter from the mount's; measure whether matter fills solids and the plate of a piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import shapely

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_most, places, spot
from knotfab_validators.geometry.curves import Curves, cut_edges
from knotfab_validators.geometry.mesh import Mesh, connect, winding_numbers
from knotfab_validators.tube.tube_fit import LIMIT

if TYPE_CHECKING:
    from knotfab_validators.geometry.curves import Slab


FACET_MM = 0.025  # how far inside a round face its facets may lie
PLUG_MM = 0.1  # how far matter may stand into a hole
SIDES = 32  # sides of the prism that represents a round hole
_FEW = 16  # one in so many planes of a hull is asked first


@dataclass(frozen=True)
class HalfSpaces:
    """The points p of a convex region, `normals @ p >= offsets`; normals (k, 3) have length 1."""

    normals: Array
    offsets: Array

    def depth(self, points: Array) -> Array:
        """Return how deep points (n, 3) lie inside, mm, (n,); negative outside."""
        return np.asarray((points @ self.normals.T - self.offsets).min(axis=1))

    def way_out(self, point: Array, along: Array) -> float:
        """Return the distance from a point (3,) inside along a unit vector (3,) to the surface, mm."""
        rate = self.normals @ along
        left = np.maximum(self.normals @ point - self.offsets, 0.0)
        leaves = rate < -1e-9
        # ignore a plane through the point that is nearly parallel to the direction
        return float((left[leaves] / -rate[leaves]).min()) if leaves.any() else 0.0


@dataclass(frozen=True)
class Solid:
    """What a part must fill: the hull of `corners` (n, 3), mm, less `openings`, which are hulls too."""

    name: str
    corners: Array
    openings: tuple[HalfSpaces, ...] = field(default=())

    @property
    def hull(self) -> HalfSpaces:
        return hull_of(self.corners)

    @property
    def middle(self) -> Array:
        """A point (3,) well inside, and in no opening."""
        centre = (self.corners.min(axis=0) + self.corners.max(axis=0)) / 2
        tried = np.concatenate([centre + t * (self.corners - centre) for t in (0.0, 0.5, 0.8)])
        deep = np.min([self.hull.depth(tried), *(-o.depth(tried) for o in self.openings)], axis=0)
        return np.asarray(tried[int(deep.argmax())])

    def covers(self, points: Array) -> Mask:
        """Return which points (n, 3) lie in its hull or on its surface."""
        hull = self.hull
        # a few of its planes leave most points out
        few = HalfSpaces(hull.normals[::_FEW], hull.offsets[::_FEW])
        found = few.depth(points) >= -PROUD_MM
        found[found] = hull.depth(points[found]) >= -PROUD_MM
        return np.asarray(found)

    @property
    def allowed_mm(self) -> float:
        """The depth at which a face may lie, set by its thickness as a tube's is by its radius."""
        widths = np.ptp(self.corners @ self.hull.normals.T, axis=0)
        return LIMIT * float(widths.min()) / 2 + FACET_MM


def hull_of(corners: Array) -> HalfSpaces:
    """Build the convex hull of points (n, 3).

    Raises:
        ValueError: they lie in one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        planes = ConvexHull(corners).equations
    except QhullError as error:
        raise ValueError("its corners enclose nothing") from error
    _, first = np.unique(np.round(planes, 9), axis=0, return_index=True)
    planes = planes[first]
    return HalfSpaces(-planes[:, :3], planes[:, 3])


def find_hollow(mesh: Mesh, solid: Solid) -> tuple[float, Array] | None:
    """Find the deepest face in a solid below `allowed_mm`: its depth, mm, and its place (3,).

    If no face lies in the solid and its `middle` is not in matter, all of it is missing: the depth is
    infinite.
    """
    hull, allowed = solid.hull, solid.allowed_mm
    corners = mesh.vertices[mesh.faces]
    for normal, offset in zip(hull.normals, hull.offsets, strict=True):
        corners = corners[(corners @ normal > offset + allowed).any(axis=1)]
    worst, at = 0.0, solid.middle
    for triangle in corners:
        piece = clip_all(triangle, hull, allowed)
        if not len(piece) or any(o.depth(piece).min() >= -allowed for o in solid.openings):
            continue
        # all corners may lie at the limit
        piece = np.concatenate([piece, piece.mean(axis=0)[None]])
        depth = hull.depth(piece)
        if depth.max() > worst:
            worst, at = float(depth.max()), piece[int(depth.argmax())]
    if worst > allowed:
        return worst, at
    if winding_numbers(solid.middle[None], mesh)[0] < 0.5:
        return np.inf, solid.middle
    return None


def clip_all(polygon: Array, hull: HalfSpaces, inset: float = 0.0) -> Array:
    """Clip a polygon (n, 3) to the inside of a hull, `inset` away from its faces; (0, 3) if nothing is
    left.
    """
    high = polygon @ hull.normals.T - hull.offsets - inset
    for k in np.flatnonzero((high < 0).any(axis=0)):
        polygon = clip(polygon, hull.normals[k], hull.offsets[k] + inset)
        if len(polygon) < 3:
            return np.empty((0, 3))
    return polygon


def clip(polygon: Array, normal: Array, offset: float) -> Array:
    """Clip a polygon (n, 3) to the half space `normal @ p >= offset`."""
    high = polygon @ normal - offset
    found = []
    for k, here in enumerate(polygon):
        after = (k + 1) % len(polygon)
        if high[k] >= 0:
            found.append(here)
        if (high[k] >= 0) != (high[after] >= 0):
            found.append(here + high[k] / (high[k] - high[after]) * (polygon[after] - here))
    return np.array(found).reshape(-1, 3)


def prism(outline: Array, low: float, high: float, motion: Array) -> Array:
    """Return the corners of a prism over an outline (n, 2), from z = low to high, moved by (3, 4)."""
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in (low, high)]
    return np.asarray(np.concatenate(ends) @ motion[:, :3].T + motion[:, 3])


def round_outline(at: Sequence[float], radius: float) -> Array:
    """Return a polygon (n, 2) around a circle."""
    t = 2 * np.pi * np.arange(SIDES) / SIDES
    return np.asarray(np.array(at) + radius / np.cos(np.pi / SIDES) * np.c_[np.cos(t), np.sin(t)])


@dataclass(frozen=True)
class Hole:
    """A round hole through a plate: its mouth's middle (3,), the unit vector (3,) out of it, its size."""

    middle: Array
    out: Array
    radius_mm: float
    deep_mm: float


def holes_of(plate: Slab) -> tuple[Hole, ...]:
    """Return the holes that a plate of knots.json lists."""
    size = plate.hole_mm / 2, plate.thickness_mm
    return tuple(Hole(middle, plate.out, *size) for middle in plate.holes)


def find_plug(mesh: Mesh, hole: Hole) -> Array | None:
    """Find a place (3,) of matter in a hole; None if it is open all through."""
    turn = _axes(hole.out)
    corners = ((mesh.vertices - hole.middle) @ turn.T)[mesh.faces]
    free = hole.radius_mm * np.cos(np.pi / SIDES) - PLUG_MM
    low, high = np.array([-free, -free, -hole.deep_mm - PROUD_MM]), np.array([free, free, PROUD_MM])
    near = ((corners.max(axis=1) > low) & (corners.min(axis=1) < high)).all(axis=1)
    up = np.array([0.0, 0.0, 1.0])
    for triangle in corners[near]:
        part = clip(clip(triangle, up, low[2]), -up, -high[2])
        if (
            len(part)
            and shapely.MultiPoint(part[:, :2]).convex_hull.distance(shapely.Point(0, 0)) < free
        ):
            return np.asarray(part.mean(axis=0) @ turn + hole.middle)
    return None


NAME = "mount"
PROUD_MM = 0.035  # how far a corner may stand out of the plate
LIMIT_MM = 0.06  # how far inside the plate's surface a face may lie
SPACING_MM = 8.0  # between places where matter is looked for
FOOT = 0.8  # radii above a plate's face: a centre line that is lower has its foot in the plate
SPLIT = 3  # sample points along each side of a face's part in the plate


def check_plate(mesh: Mesh, plate: Slab, reach: Array) -> Check:
    """Check `mount` of a piece in a plate: no face lies inside the plate, and matter is all over it.

    `reach` (n, 3) are points over which it must extend: the frame's corners, and the piece's feet.

    The union of the plate with feet that stand in it has no inner faces. A void, a slit between a
    foot and the plate, an unlisted hole or a thinner plate has some.
    """
    turn = _axes(plate.out)
    flat = plate.outline @ turn.T
    solid = _shape(plate, turn)
    sheet = _sheet(plate, turn).buffer(PROUD_MM)
    beside = ~shapely.contains_xy(sheet, (reach @ turn.T)[:, 0], (reach @ turn.T)[:, 1])
    if beside.any():
        detail = (
            f"the plate does not extend to the frame or under a foot, at {spot(reach[beside][0])}"
        )
        return Check(NAME, "fail", True, "misfit", None, "", detail, places(reach[beside]))
    local = mesh.vertices @ turn.T - (0.0, 0.0, float(flat[0, 2]))
    low, high = LIMIT_MM - plate.thickness_mm, -LIMIT_MM
    worst, at = 0.0, plate.outline[0]
    height = local[:, 2][mesh.faces]
    near = (height.min(axis=1) < high) & (height.max(axis=1) > low)
    points = _sample(local[mesh.faces[near]], low, high)
    if len(points):
        inside = shapely.contains_xy(solid, points[:, 0], points[:, 1])
        points = points[inside]
        sides = shapely.distance(solid.boundary, shapely.points(points[:, :2]))
        deep = np.minimum(sides, np.minimum(-points[:, 2], points[:, 2] + plate.thickness_mm))
        if len(deep):
            k = int(deep.argmax())
            worst = float(deep[k])
            at = (points[k] + (0.0, 0.0, float(flat[0, 2]))) @ turn
    detail = "how deep a face lies at most in the plate that the piece stands in"
    if worst > LIMIT_MM:
        detail += f", which has a hole, void or slit at {spot(at)}"
        return at_most(NAME, worst, LIMIT_MM, "mm", detail, at=[at])
    empty = _find_empty(mesh, solid, plate, turn, float(flat[0, 2]))
    if len(empty):
        detail = f"there is no matter in the plate, such as at {spot(empty[0])}"
        return Check(NAME, "fail", True, "missing", None, "", detail, places(empty))
    return at_most(NAME, worst, LIMIT_MM, "mm", detail)


def inside_plate(points: Array, plate: Slab) -> Mask:
    """Return which points (n, 3) lie in the plate or on its surface."""
    turn = _axes(plate.out)
    local = points @ turn.T
    height = local[:, 2] - float(plate.outline[0] @ plate.out)
    solid = _sheet(plate, turn).buffer(PROUD_MM)
    within = (height < PROUD_MM) & (height > -plate.thickness_mm - PROUD_MM)
    within &= shapely.contains_xy(solid, local[:, 0], local[:, 1])
    return np.asarray(within)


def list_feet(polygons: Sequence[Array], plate: Slab, radius: float) -> Array:
    """List the points (n, 3) of centre lines that lie so near to a plate's face that it must be there."""
    points = np.concatenate(polygons)
    return np.asarray(points[(points - plate.outline[0]) @ plate.out < FOOT * radius])


def _axes(out: Array) -> Array:
    """Return two directions along a plate, and its normal, as rows (3, 3)."""
    side = np.cross(np.eye(3)[int(np.abs(out).argmin())], out)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(out, side), out])


def _sheet(plate: Slab, turn: Array) -> shapely.Polygon:
    """Return the plate without its screw holes, along its own directions."""
    outline, *openings = ((ring @ turn.T)[:, :2] for ring in (plate.outline, *plate.openings))
    return shapely.Polygon(outline, openings)


def _shape(plate: Slab, turn: Array) -> shapely.Geometry:
    holes = (plate.holes @ turn.T)[:, :2]
    solid = _sheet(plate, turn)
    for hole in holes:
        solid = solid.difference(shapely.Point(hole).buffer(plate.hole_mm / 2, quad_segs=64))
    return solid


def _sample(corners: Array, low: float, high: float) -> Array:
    """Sample points (n, 3) all over the parts of triangles (m, 3, 3) between two heights."""
    weights = np.array(
        [(i, j, SPLIT - i - j) for i in range(SPLIT + 1) for j in range(SPLIT + 1 - i)]
    )
    found, up = [], np.array([0.0, 0.0, 1.0])
    for triangle in corners:
        part = clip(clip(triangle, up, low), -up, -high)
        for k in range(1, len(part) - 1):
            found.append(weights / SPLIT @ part[[0, k, k + 1]])
    return np.concatenate(found) if found else np.empty((0, 3))


def _find_empty(
    mesh: Mesh, solid: shapely.Geometry, plate: Slab, turn: Array, face: float
) -> Array:
    """Find places (k, 3) halfway through the plate that are not in matter."""
    inner = solid.buffer(-LIMIT_MM)
    x0, y0, x1, y1 = inner.bounds
    x, y = np.meshgrid(np.arange(x0, x1, SPACING_MM), np.arange(y0, y1, SPACING_MM))
    flat = np.column_stack([x.ravel(), y.ravel()])
    flat = flat[shapely.contains_xy(inner, flat[:, 0], flat[:, 1])]
    middle = np.full(len(flat), face - plate.thickness_mm / 2)
    points = np.column_stack([flat, middle]) @ turn
    return np.asarray(points[winding_numbers(points, mesh) < 0.5])


# Separate a part's vertices into the tube's and the mount's.

OFF = 1.06  # radii from the centre lines: facets and mitred rings stand out by less
REACH = 2.0  # radii from the centre lines: a mount reaches farther, a swollen tube does not
PROUD = 1.02  # radii from the centre lines: no facet of the tube stands out farther
BESIDE_MATTER = 3.0  # radii along a knot: a face that spans more leads from one strand to another
SPACING = 0.125  # radii between samples of the centre lines
ALONG = 1.05  # largest length of the strand between the ends of a face's side, over that side
# radii: mitres at its ends shorten an inner side, and its corners lie beside either edge
MITRED = 1.0


def tube_vertices(vertices: Array, faces: Ints, polygons: Sequence[Array], radius: float) -> Mask:
    """Return which vertices (n,) are the tube's: all but those of matter that leads away from it.

    A vertex within `OFF` radii of the centre lines lies on the tube. Those farther out are the mount's
    where some vertex that is joined to them by edges, without touching the tube, is farther than
    `REACH` radii away. So a tube that is swollen, or displaced by up to its own radius, stays a tube.

    Args:
        vertices, faces: (n, 3) and (m, 3), mm. polygons: closed, [(k, 3), ...] mm, one radius.
    """
    from scipy.spatial import cKDTree

    limit = REACH * radius
    tree = cKDTree(np.concatenate([_sample_strand(polygon, radius) for polygon in polygons]))
    distance, _ = tree.query(vertices, distance_upper_bound=limit)
    off = distance > OFF * radius
    own: Mask = ~off
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    both = off[start] & off[end]
    n = len(vertices)
    label, _ = connect(start[both], end[both], n)
    far = np.zeros(n, dtype=bool)
    far[label[off & ~(distance < limit)]] = True
    own |= off & ~far[label]
    return own


def strand_faces(
    mesh: Mesh, curves: Curves, *, proud: float = PROUD, beside: float = BESIDE_MATTER
) -> Mask:
    """Return which faces (m,) are the tube's surface: close to it, and to a single strand.

    Args:
        curves: closed, their radius known.
        proud: how far from the centre line a face may reach, in radii. beside: how far along it.
    """
    distance, span = _near_strands(mesh, curves)
    return np.asarray((distance <= proud) & (span <= beside))


@lru_cache(maxsize=1)  # `clearance` and `mount` ask it of the same part
def _near_strands(mesh: Mesh, curves: Curves) -> tuple[Array, Array]:
    """Measure faces (m,) in radii: how far their corners are from the centre lines, and span along one.

    The span is 0 where a face of that length may have it, and inf from knot to knot.
    """
    from scipy.spatial import cKDTree

    vertices, faces, radius = mesh.vertices, mesh.faces, curves.radius_mm
    assert radius is not None
    samples = [_sample_strand(polygon, radius) for polygon in curves.polygons]
    steps = [np.linalg.norm(np.roll(s, -1, axis=0) - s, axis=1) / radius for s in samples]
    along = np.concatenate([np.cumsum(step) - step for step in steps])
    around = np.array([step.sum() for step in steps])
    first = np.concatenate([[0], np.cumsum([len(s) for s in samples])])
    tree = cKDTree(np.concatenate(samples))
    distance, nearest = tree.query(vertices, distance_upper_bound=REACH * radius)
    place = np.minimum(nearest, first[-1] - 1)[faces]
    knot = np.searchsorted(first, place, side="right") - 1
    apart = np.abs(along[place] - along[place[:, [1, 2, 0]]])
    apart = np.minimum(apart, around[knot] - apart)
    # a long face along a straight strand spans as much of it as its corners are apart
    side = np.linalg.norm(vertices[faces] - vertices[faces[:, [1, 2, 0]]], axis=2) / radius
    apart[apart <= ALONG * side + MITRED] = 0.0
    apart[knot != knot[:, :1]] = np.inf
    return (distance / radius)[faces].max(axis=1), apart.max(axis=1)


def _sample_strand(polygon: Array, radius: float) -> Array:
    """Sample points (n, 3) along a closed polygon, at most `SPACING` radii apart."""
    end = np.roll(polygon, -1, axis=0)
    which, begin, _ = cut_edges(polygon, end, SPACING * radius)
    return np.asarray(polygon[which] + begin[:, None] * (end - polygon)[which])
