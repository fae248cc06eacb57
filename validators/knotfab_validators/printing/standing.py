"""Check that a part reaches the bed, and that it stands there without toppling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_most
from knotfab_validators.geometry.mesh import Mesh, number_bodies, winding_numbers
from knotfab_validators.geometry.surface import bound_work
from knotfab_validators.printing.bridges import Columns

MOST_BODIES = 100_000
MOST_AROUND = 2_000_000_000  # pairs of a cavity and a face that may be around it
FLAT = 1e-9  # width of a footprint, as a share of its length, below which it is a line


@dataclass(frozen=True)
class Body:
    """A closed surface with the cavities inside it.

    `faces` (m, 3) are all its faces, `volume_mm3` what they enclose, `center` (3,) the middle of
    that volume, `lowest` (3,) its lowest vertex.
    """

    faces: Ints
    volume_mm3: float
    center: Array
    lowest: Array


def bodies(mesh: Mesh) -> list[Body]:
    """Return the bodies of a closed, consistently wound mesh, in the order of their first faces.

    Volume and middle are sums over the signed tetrahedra between the faces and one point. A surface
    that is wound inwards is a hollow and belongs to the body around it, which is found by its
    winding number.

    Raises:
        TooMuchWork: there are too many bodies, or hollows.
    """
    label, count = number_bodies(mesh)
    bound_work(count, MOST_BODIES, "bodies")
    by_face = label[mesh.faces[:, 0]]
    middle = mesh.vertices.mean(axis=0)
    corner = mesh.vertices[mesh.faces] - middle
    six = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))
    volume = np.bincount(by_face, six, minlength=count) / 6
    moment = np.column_stack(
        [
            np.bincount(by_face, six * corner[:, :, k].sum(axis=1), minlength=count) / 24
            for k in range(3)
        ]
    )
    order = np.argsort(by_face, kind="stable")
    ends = np.cumsum(np.bincount(by_face, minlength=count))[:-1]
    faces = [mesh.faces[some] for some in np.split(order, ends)]
    solid = [k for k in range(count) if volume[k] > 0]
    hollows = (count - len(solid)) * float(len(mesh.faces))
    bound_work(hollows, MOST_AROUND, "pairs of a hollow and a face")
    # so that the smallest solid around a cavity is found first
    solid.sort(key=lambda k: float(volume[k]))
    parts: dict[int, list[int]] = {k: [k] for k in solid}
    for k in range(count):
        if volume[k] <= 0:
            owner = _find_container(mesh.vertices, faces, solid, mesh.vertices[faces[k][:1, 0]])
            if owner is not None:
                parts[owner].append(k)
    found = []
    for k in sorted(solid):
        own = np.concatenate([faces[j] for j in parts[k]])
        total = float(volume[parts[k]].sum())
        used = mesh.vertices[np.unique(own)]
        center = middle + moment[parts[k]].sum(axis=0) / (total if total > 0 else volume[k])
        found.append(Body(own, total, center, used[used[:, 2].argmin()]))
    return found


def footprint(vertices: Array, faces: Ints, layer_mm: float) -> Array:
    """Return the points (n, 2) of a body's first layer (z <= `layer_mm`) that may be corners of its hull.

    These are its vertices there, and the points where its edges leave the layer.
    """
    first, second = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    low = vertices[first, 2] <= layer_mm
    leaves = low & (vertices[second, 2] > layer_mm)
    start, end = vertices[first[leaves]], vertices[second[leaves]]
    t = (layer_mm - start[:, 2]) / (end[:, 2] - start[:, 2])
    cut = start + t[:, None] * (end - start)
    points: Array = np.concatenate([vertices[np.unique(first[low])], cut])[:, :2]
    return points


def margin(center: Array, points: Array) -> float:
    """Measure how far a body's `center` (3,) lies inside the convex hull of its footprint (n, 2), mm.

    Seen from above: the distance to the nearest side of the hull, negative outside. A footprint
    that is a line or a point holds nothing: minus the distance to it. NaN without a footprint.
    """
    from shapely import MultiPoint, Point

    if not len(points):
        return float("nan")
    hull = MultiPoint(points).convex_hull
    middle = Point(center[:2])
    if hull.geom_type != "Polygon" or hull.area <= FLAT * hull.length**2:
        return -float(hull.distance(middle))
    away = float(hull.exterior.distance(middle))
    return away if hull.covers(middle) else -away


def _find_container(
    vertices: Array, faces: list[Ints], solid: list[int], point: Array
) -> int | None:
    """Find the smallest body around a point (1, 3) that lies on none of them."""
    around = (k for k in solid if winding_numbers(point, Mesh(vertices, faces[k]))[0] > 0.5)
    return next(around, None)


# Check that a part that hangs by its eyelets hangs level.

MOST_TILT_DEG = 1.0
PROBE_MM = 0.4  # matter is looked for this far above a thread, and a hole this far below
LEAST_LOAD = 0.1  # share of the weight on either of two threads: one that is slack holds nothing


def check_level(mesh: Mesh, threads: Array, up: Array) -> Check:
    """Check `level`: the tilt at which the part hangs, from its centre of mass at uniform density.

    Below two threads it swings about the line through both, and its centre of mass must be between them.

    Args:
        threads: (1 or 2, 3) where threads carry the part; up: the unit vector (3,) that should be
            upright, both in the part's coordinates.
    """

    def failed(why: str) -> Check:
        return Check("level", "fail", True, float("nan"), MOST_TILT_DEG, "deg", why)

    parts = bodies(mesh)
    if len(parts) != 1:
        return failed(f"{len(parts)} bodies do not hang together on threads")
    for thread in threads:
        above, below = winding_numbers(thread + PROBE_MM * np.outer([1.0, -1.0], up), mesh)
        if above < 0.5 or below > 0.5:
            missing = "no matter above" if above < 0.5 else "no hole below"
            return failed(f"there is {missing} the place of a thread: no eyelet carries the part")
    hung, where = threads[0], "beside its line"
    if len(threads) > 1:
        line = threads[1] - threads[0]
        level = line - (line @ up) * up
        share = float((parts[0].center - threads[0]) @ level / max(level @ level, 1e-12))
        if not LEAST_LOAD <= share <= 1 - LEAST_LOAD:
            return failed(
                f"one of two threads would carry {max(share, 1 - share):.0%} of the weight"
            )
        hung, where = threads[0] + share * line, "beside the plane of both"
    off = hung - parts[0].center
    high = float(off @ up)
    aside = float(np.linalg.norm(off - high * up))
    tilt = float(np.degrees(np.arctan2(aside, high)))
    detail = f"the centre of mass hangs {high:.1f} mm below the thread, {aside:.2f} mm {where}"
    return at_most("level", tilt, MOST_TILT_DEG, "deg", detail)


# Undersides that need support: their area, and the support under them.

ANGLE_TOLERANCE = 1e-5  # the rounding of a normal's z in single precision
BED_MM = 1e-3  # tolerance of the first layer's height


def overhang_areas(mesh: Mesh, max_overhang_deg: float, layer_mm: float) -> Array:
    """Return the area of each face that overhangs beyond the limit, off the bed, (m,) mm².

    A face overhangs by 90° less the angle between its normal and straight down: a vertical wall by
    0°, a ceiling by 90°. It counts from above the first layer on (z > `layer_mm`), where it is cut.
    """
    normals, areas = mesh.normals
    steep = _steep(normals, max_overhang_deg)
    over: Array = np.zeros(len(areas))
    over[steep] = areas[steep] * share_above(mesh.vertices[mesh.faces[steep], 2], layer_mm + BED_MM)
    return over


def support_volume(
    mesh: Mesh, grid: Columns, max_overhang_deg: float, layer_mm: float
) -> tuple[float, Array]:
    """Return the volume of the columns from overhanging faces down to the surface below or the bed, mm³.

    Columns count as solid, although a slicer prints a sparse grating. Each column of the grid adds its
    height times the cell's area (the midpoint rule: off by about half a cell along the rim of each
    overhang). Also return the place (3,) of the tallest one's top, NaN if there is none.
    """
    normals, _ = mesh.normals
    needs = _steep(normals, max_overhang_deg)[grid.face] & (grid.low > layer_mm + BED_MM)
    same = np.diff(grid.column, prepend=-1) == 0
    floor = np.where(same, np.concatenate([[0.0], grid.high[:-1]]), 0.0)
    height = np.where(needs, grid.low - np.maximum(floor, 0.0), 0.0).clip(min=0.0)
    if not height.any():
        return 0.0, np.full(3, np.nan)
    tallest = np.array([height.argmax()])
    return float(height.sum()) * grid.cell**2, grid.places(tallest)[0]


def share_above(z: Array, level: float) -> Array:
    """Return the share of each triangle that lies above a level, from its corners' heights (k, 3)."""
    low, middle, high = np.sort(z, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        upper = (high - level) ** 2 / ((high - low) * (high - middle))
        lower = 1 - (level - low) ** 2 / ((high - low) * (middle - low))
    share: Array = np.where(middle <= level, upper, lower)
    share = np.where(low >= level, 1.0, share)
    return np.where(high <= level, 0.0, share)


def _steep(normals: Array, max_overhang_deg: float) -> Mask:
    limit = np.sin(np.radians(max_overhang_deg))
    steep: Mask = -normals[:, 2] > limit + ANGLE_TOLERANCE
    return steep
