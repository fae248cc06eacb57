"""Measure by rays how thick the walls of a part are, and how wide the gaps between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from knotfab_formats.libraries import took_part
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.curves import number_runs
from knotfab_validators.geometry.mesh import Mesh, corner_faces, face_tree
from knotfab_validators.geometry.surface import bound_work
from knotfab_validators.geometry.triangles import point_triangle, triangle_triangle

SAMPLE_MM = 1.2  # distance between samples; see `Probe`
MOST_SAMPLES = 200_000
# the two sides of a wall or gap are at least this parallel
FACING = float(np.cos(np.radians(30.0)))
SLIVER_MM = 1e-2  # a lower face has no reliable normal: nothing is measured from it
SLANTING = float(np.cos(np.radians(75.0)))  # a face that slants more does not even hint at a gap
TRIED = 64  # one sample of so many tells how thick the walls are
SEED_MM = 3.0  # around narrower places, all faces are sampled
MOST_SEEDS = 300
NEAR_MM = 1.2  # only the narrowest of the wider gaps is refined by a walk
BATCH = 64
MOST_BATCHES = 16
MOST_HOPS = 60
MOST_PAIRS = 50_000_000  # pairs of faces, or of a face and a narrow place, that are examined
MET_MM = 1e-9  # faces nearer than this touch
START_MM = 1e-6  # distance off its face at which a ray starts


@dataclass(frozen=True)
class Facing:
    """Pairs of places that face each other.

    A ray from `point` (n, 3) on `face` along its normal meets the face `other` (n,) at `hit` (n,
    3), `width` (n,) away.
    """

    point: Array
    face: Ints
    hit: Array
    other: Ints
    width: Array

    def take(self, which: Ints) -> Facing:
        return Facing(*(field[which] for field in self._fields()))

    def join(self, other: Facing) -> Facing:
        pairs = zip(self._fields(), other._fields(), strict=True)
        return Facing(*(np.concatenate(pair) for pair in pairs))

    def _fields(self) -> tuple[Any, ...]:
        return self.point, self.face, self.hit, self.other, self.width


@dataclass(frozen=True)
class LocalThickness:
    """The thinnest wall or gap, mm (infinite if there is none).

    `widths` (k,) and `at` (k, 3) are the narrowest places, one in each sampling cube, worst first.
    """

    value: float
    widths: Array
    at: Array


class Probe:
    """Samples of a closed mesh's surface from which walls and gaps are measured.

    From a sample a ray runs along the face's normal, into the material (walls) or out of it
    (gaps), up to the next face. It counts when the two faces are parallel within 30°: a box's edge
    is not a thin wall, nor its inner corner a gap. The width is the ray's length.

    Samples: a lattice of `spacing` on every face that is larger, one in the middle of each smaller one, of
    which those that share a cube of that size and look the same way (of six) are thinned to one. So a wall
    or gap is found if one side of it has a place, away from all others, as large as a cube's diagonal, 2.1
    mm (more where 200,000 samples do not suffice); a smaller one is found only by chance, and what meets as
    corner or edge against a face, or at more than 30°, is not seen.
    """

    def __init__(self, mesh: Mesh, spacing: float = SAMPLE_MM) -> None:
        took_part("libigl", "measured walls and gaps")
        self.mesh = mesh
        self.vertices, self.faces = mesh.contiguous
        self.normals, areas = mesh.normals
        corner = mesh.vertices[mesh.faces]
        sides = corner - corner[:, [1, 2, 0]]
        edges = np.sqrt(np.einsum("fki,fki->fk", sides, sides))
        self.height = 2 * areas / np.maximum(edges.max(axis=1), 1e-300)
        self.usable = self.height > SLIVER_MM
        self.spacing = max(spacing, float(np.sqrt(4 * areas.sum() / MOST_SAMPLES)))
        self.point, self.face = _thin(
            *_sample_lattice(corner, edges, self.height, self.usable, self.spacing),
            self.normals,
            self.spacing,
        )
        self._around: tuple[Ints, Ints] | None = None
        self._pairs = 0  # pairs of faces examined so far

    def wall(self) -> LocalThickness:
        """Return the thinnest wall: the smallest width seen through the material.

        A tube's is its diameter between opposite sides; an edge sharper than 30° counts as a wall
        that thins out, as thin as at the nearest sample.
        """
        some = slice(None, None, TRIED)
        tried, _ = self._cast(self.point[some], self.face[some], -1.0)
        # rays that end soon cost less, and the narrowest places are all that is told
        reach = max(SEED_MM, 1.5 * float(np.median(tried.width))) if len(tried.width) else np.inf
        seen = self._facing(-1.0, reach)
        if (seen.width < 0.99 * reach).sum() < BATCH * MOST_BATCHES:
            seen = self._facing(-1.0)
        return self._narrowest(seen.width, (seen.point + seen.hit) / 2)

    def gap(self, near_mm: float = NEAR_MM) -> LocalThickness:
        """Return the thinnest gap: the smallest width seen through the air.

        From each narrow place the pair of faces walks to neighbours as long as they come closer,
        by exact distances between triangles. Where it ends in a true local minimum that distance
        is the gap: two tubes are measured where they are closest, wherever the samples lie. Where
        the sides meet, so that the gap narrows to nothing, it is a crease and no gap: a nozzle
        fills it, and nothing is lost. In all other cases (a hole, a slot with a round end, the
        inside of a bend) the width at the sample counts.

        Places wider than `near_mm` are walked from only as far as the narrowest one needs.
        """
        reach = max(SEED_MM, 2 * near_mm)
        found, enough = self._walk(self._facing(1.0, reach), near_mm)
        return found if enough else self._walk(self._facing(1.0), near_mm)[0]

    def _walk(self, seen: Facing, near_mm: float) -> tuple[LocalThickness, bool]:
        """Walk from the narrowest places seen; also tell whether wider ones could change nothing."""
        order = np.argsort(seen.width, kind="stable")
        order = order[self._first_in_cube((seen.point[order] + seen.hit[order]) / 2)]
        best, value, enough = np.full(0, np.inf), np.inf, True
        at = np.empty((0, 3))
        for start in range(0, min(len(order), MOST_BATCHES * BATCH), BATCH):
            some = seen.take(order[start : start + BATCH])
            if some.width[0] > value + self.spacing / 4 or (
                np.isfinite(value) and some.width[0] > max(near_mm, value)
            ):
                break
            width, middle = self._closest(some)
            best, at = np.concatenate([best, width]), np.concatenate([at, middle])
            value = float(best.min())
        else:
            enough = False
            rest = order[MOST_BATCHES * BATCH :]  # the rest is measured at the samples
            best = np.concatenate([best, seen.width[rest]])
            at = np.concatenate([at, (seen.point[rest] + seen.hit[rest]) / 2])
        real = np.isfinite(best)
        return self._narrowest(best[real], at[real]), enough

    def _narrowest(self, width: Array, middle: Array) -> LocalThickness:
        order = np.argsort(width, kind="stable")[: BATCH * MOST_BATCHES]
        if not len(order):
            return LocalThickness(np.inf, np.empty(0), np.empty((0, 3)))
        order = order[self._first_in_cube(middle[order])][:BATCH]
        return LocalThickness(float(width[order[0]]), width[order], middle[order])

    def _facing(self, side: float, reach: float = np.inf) -> Facing:
        """Find what the samples face, outside (1) or through the material (-1), up to a `reach`.

        All faces near the narrowest places are sampled too: the sample that was kept there may
        look past what its neighbours face.
        """
        seen, cosine = self._cast(self.point, self.face, side, reach)
        order = np.flatnonzero(seen.width <= SEED_MM)
        order = order[np.argsort(seen.width[order], kind="stable")]
        seeds = order[self._first_in_cube(seen.point[order])][:MOST_SEEDS]
        good = np.flatnonzero(cosine >= FACING)
        if not len(seeds):
            return seen.take(good)
        around = seen.point[seeds], 1.5 * self.spacing
        beside = self._middles.query_ball_point(*around, return_length=True).sum()
        bound_work(beside, MOST_PAIRS, "faces beside the narrowest places")
        near = self._middles.query_ball_point(*around)
        face = np.unique(np.concatenate([np.asarray(n, dtype=np.int64) for n in near]))
        face = face[self.usable[face]]
        more, cosine = self._cast(self._middles.data[face], face, side, reach)
        one, two = seen.take(good), more.take(np.flatnonzero(cosine >= FACING))
        return one.join(two)

    def _first_in_cube(self, point: Array) -> Ints:
        """Return the indices, ascending, of the first of points on or in the part in each cube."""
        return _first_in_cube(point, self.spacing, self.vertices.min(axis=0))

    @cached_property
    def _middles(self) -> Any:
        """A search tree of the faces' centres."""
        from scipy.spatial import cKDTree

        return cKDTree(self.vertices[self.faces].mean(axis=1))

    def _cast(
        self, point: Array, face: Ints, side: float, reach: float = np.inf
    ) -> tuple[Facing, Array]:
        """Cast rays along the normals; return what they meet, and the cosine of the planes."""
        direction = side * self.normals[face]
        start = np.ascontiguousarray(point + START_MM * direction)
        other, _, _ = face_tree(self.mesh).intersect_ray_first(
            self.vertices, self.faces, start, np.ascontiguousarray(direction), reach
        )
        other = np.asarray(other, dtype=np.int64)
        cosine = -np.einsum("ij,ij->i", self.normals[face], self.normals[other])
        good = np.flatnonzero((other >= 0) & (other != face) & (cosine >= SLANTING))
        # intersect the other face's plane again: the tree's lengths are in single precision
        way = self.vertices[self.faces[other[good], 0]] - point[good]
        t = -side * np.einsum("ij,ij->i", way, self.normals[other[good]]) / cosine[good]
        hit = point[good] + t[:, None] * direction[good]
        return Facing(point[good], face[good], hit, other[good], t), cosine[good]

    def _closest(self, some: Facing) -> tuple[Array, Array]:
        """Return the gap (k,) between faces, infinite if they touch, and its midpoint (k, 3)."""
        corner = self.mesh.vertices[self.mesh.faces]
        one, two = some.face.copy(), some.other.copy()
        distance, p, q = triangle_triangle(corner[one], corner[two])
        active = np.arange(len(one))
        for _ in range(MOST_HOPS):
            active = active[distance[active] > MET_MM]
            if not len(active):
                break
            owner, f, g = self._neighbouring(active, one, two)
            good = self._nearly_parallel(f, g)
            owner, f, g = owner[good], f[good], g[good]
            d, a, b = triangle_triangle(corner[f], corner[g])
            # it must lead through air; where the faces touch, that cannot be told
            good = (np.einsum("ij,ij->i", b - a, self.normals[f]) > 0) | (d <= MET_MM)
            owner, f, g, d, a, b = owner[good], f[good], g[good], d[good], a[good], b[good]
            order = np.lexsort((d, owner))
            first = order[np.flatnonzero(np.diff(owner[order], prepend=-1))]
            less = first[d[first] < distance[owner[first]] * (1 - 1e-9) - 1e-12]
            active = owner[less]
            one[active], two[active], distance[active] = f[less], g[less], d[less]
            p[active], q[active] = a[less], b[less]
        true = self._is_minimum(one, two, p, q, distance)
        met = distance <= MET_MM
        width = np.where(true, distance, np.where(met, np.inf, some.width))
        middle = np.where(true[:, None], (p + q) / 2, (some.point + some.hit) / 2)
        return width, middle

    def _neighbouring(self, active: Ints, one: Ints, two: Ints) -> tuple[Ints, Ints, Ints]:
        """Replace one face of each pair by each of its neighbours: the pair's index, and both faces."""
        a, f = self._ring(one[active])
        b, g = self._ring(two[active])
        self._pairs += len(f) + len(g)
        bound_work(self._pairs, MOST_PAIRS, "pairs of faces beside gaps")
        return (
            np.concatenate([active[a], active[b]]),
            np.concatenate([f, one[active[b]]]),
            np.concatenate([two[active[a]], g]),
        )

    def _nearly_parallel(self, f: Ints, g: Ints) -> Mask:
        """Return whether faces are parallel within 30°; slivers pass, since their normals are unreliable."""
        facing = -np.einsum("ij,ij->i", self.normals[f], self.normals[g]) >= FACING
        mask: Mask = (f != g) & (facing | ~self.usable[f] | ~self.usable[g])
        return mask

    def _is_minimum(self, one: Ints, two: Ints, p: Array, q: Array, distance: Array) -> Mask:
        """Return whether p is the nearest to q of all points on the faces around `one`, and the reverse."""
        corner = self.mesh.vertices[self.mesh.faces]
        true = distance > MET_MM
        for face, point in ((one, q), (two, p)):
            owner, f = self._ring(face)
            d, _ = point_triangle(point[owner], corner[f])
            least = np.full(len(face), np.inf)
            np.minimum.at(least, owner, d)
            true &= least >= distance * (1 - 1e-6)
        return true

    def _ring(self, face: Ints) -> tuple[Ints, Ints]:
        """Return all faces at a corner of `face` (k,): the index into `face`, and the face."""
        if self._around is None:
            self._around = corner_faces(self.mesh)
        faces, first = self._around
        vertex = self.mesh.faces[face].reshape(-1)
        count = first[vertex + 1] - first[vertex]
        corner, number = number_runs(count)
        return corner // 3, faces[first[vertex][corner] + number]


def _sample_lattice(
    corner: Array, edges: Array, height: Array, usable: Mask, spacing: float
) -> tuple[Array, Ints]:
    """Place points (n, 3) on the usable faces, in rows along the longest edge; also return their faces."""
    face = np.flatnonzero(usable)
    longest = edges[face].argmax(axis=1)
    a, b, c = (corner[face, (longest + k) % 3] for k in range(3))
    length = edges[face, longest]
    rows = np.ceil(height[face] / spacing).astype(np.int64)
    at, number = number_runs(rows)
    up = (number + 0.5) / rows[at]
    # with one row, its height is that of the centroid, a third of the way up
    up = np.where(rows[at] == 1, 1 / 3, up)
    count = np.maximum(np.ceil(length[at] * (1 - up) / spacing), 1).astype(np.int64)
    row, number = number_runs(count)
    along = (number + 0.5) / count[row]
    k, s = at[row], up[row]
    t = along * (1 - s)
    point = a[k] + t[:, None] * (b[k] - a[k]) + s[:, None] * (c[k] - a[k])
    return point, face[k]


def _thin(point: Array, face: Ints, normals: Array, spacing: float) -> tuple[Array, Ints]:
    """Keep one sample in each cube of `spacing` for each of the six sides to which its face may look."""
    normal = normals[face]
    axis = np.abs(normal).argmax(axis=1)
    way = 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)
    # a random choice: the first in each cube would be the same facet all along a tube
    lot = np.random.default_rng(0).permutation(len(point))
    # keep faces in order, which makes rays faster
    keep = np.sort(
        lot[_first_in_cube(point[lot], spacing, point.min(axis=0, initial=np.inf), way[lot])]
    )
    return point[keep], face[keep]


def _first_in_cube(point: Array, size: float, origin: Array, way: Ints | None = None) -> Ints:
    """Return the indices, ascending, of the first point in each cube of `size` mm (and of each `way`).

    Args:
        origin: (3,) a corner of the cubes, below all points.
    """
    if not len(point):
        return np.empty(0, dtype=np.int64)
    cell = np.floor((point - origin) / size).astype(np.int64)
    wide = cell.max(axis=0) + 1
    key = (cell[:, 2] * wide[1] + cell[:, 1]) * wide[0] + cell[:, 0]
    if way is not None:
        key = key * 6 + way
    _, first = np.unique(key, return_index=True)
    return np.sort(first)
