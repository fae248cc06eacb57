"""Check that a part reaches the bed, and that it stands there without toppling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.heap import bound_work
from knotfab_validators.geometry.inside import winding_numbers
from knotfab_validators.geometry.mesh import Mesh, number_bodies

__all__ = ["Body", "bodies", "footprint", "margin"]


MOST_BODIES = 100_000
MOST_AROUND = 2_000_000_000  # pairs of a hollow and a face that may be around it
FLAT = 1e-9  # a footprint less wide than this share of its length is a line


@dataclass(frozen=True)
class Body:
    """A closed surface with the hollows inside it.

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
    # the smallest solid around a hollow is then found first
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
    """Return (n, 2) the points of a body's first layer (z <= `layer_mm`) that may be corners of its hull.

    Its vertices there, and where its edges leave the layer.
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
    """Measure how far inside the convex hull of `points` (n, 2) a body's `center` (3,) lies, mm.

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
