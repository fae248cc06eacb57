"""Straight members between strands, or from strand to ground, that run clear of all else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.geometry.measures import segment_distance
from knotfab.geometry.polylines import arc_lengths, number_runs, sample_evenly
from knotfab.knots import Knots

GROUND = -1  # the second site of a post
SITE_RADII = 1.5  # between sites along a tube
SAMPLE_RADII = 0.35  # between samples of the centre lines
LEAST_SINE = 0.65  # between tube and member: one that leaves along its tube would graze it
JOINT_RADII = 3.5  # tube radii of arc on each side of a member's end that belong to its joint
LEAN_MM = 1.0  # leaning roots come so much nearer to each other than their middles say
ROOT_SHARE = 1.5  # the root's radius over the post's, where it meets the base


@dataclass(frozen=True)
class Sites:
    """Places on the centre lines where a member may end: vertices of the knots, (n,), knot by knot.

    `vertex` (n,) of the knot, `point` (n, 3) mm, `tangent` (n, 3) unit, `arc` (n,) mm from the
    knot's first vertex; `perimeter` (k,) of each knot; `following` (n,) the next site along the
    same knot.
    """

    knot: Indices
    vertex: Indices
    point: Array
    tangent: Array
    arc: Array
    perimeter: Array
    following: Indices


def sites_of(
    knots: Knots, step_radii: float = SITE_RADII, also: Mapping[int, Indices] | None = None
) -> Sites:
    """Choose vertices about `step_radii` tube radii apart, at least 8 a knot, and those in `also`."""
    knot, vertex, point, tangent, arcs, following, perimeter = [], [], [], [], [], [], []
    first = 0
    for k, curve in enumerate(knots.knots):
        p = curve.points
        arc = arc_lengths(p)
        arc, whole = arc[:-1], float(arc[-1])
        count = max(8, int(whole / (step_radii * knots.radius_mm)))
        at = np.searchsorted(arc, np.arange(count) * whole / count).clip(0, len(p) - 1)
        at = np.union1d(at, np.asarray((also or {}).get(k, ()), dtype=np.int64))
        n = len(at)
        knot.append(np.full(n, k))
        vertex.append(at)
        point.append(p[at])
        tangent.append(tangents(p)[at])
        arcs.append(arc[at])
        following.append(first + (np.arange(n) + 1) % n)
        perimeter.append(whole)
        first += n
    return Sites(
        np.concatenate(knot),
        np.concatenate(vertex),
        np.concatenate(point),
        np.concatenate(tangent),
        np.concatenate(arcs),
        np.array(perimeter),
        np.concatenate(following),
    )


def tangents(points: Array) -> Array:
    """Return a closed polyline's unit directions at its vertices, by both neighbours, (n, 3)."""
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    return np.asarray(ahead / np.linalg.norm(ahead, axis=1)[:, None])


@dataclass(frozen=True)
class Candidates:
    """Round members, placed or only considered.

    `first`, `second` (n,) are the sites of their ends (`GROUND` for a post's foot), `start`, `end`
    (n, 3) where those are, `radius` (n,) mm; `end_radius` (n,) at the end of members that taper.
    """

    first: Indices
    second: Indices
    start: Array
    end: Array
    radius: Array
    end_radius: Array | None = None

    @property
    def foot_radius(self) -> Array:
        """The radius at the end, whether or not members taper, (n,) mm."""
        return self.radius if self.end_radius is None else self.end_radius

    def __len__(self) -> int:
        return len(self.first)

    def take(self, some: Indices | Mask | list[int]) -> Candidates:
        return Candidates(
            self.first[some],
            self.second[some],
            self.start[some],
            self.end[some],
            self.radius[some],
            None if self.end_radius is None else self.end_radius[some],
        )

    def thicken(self, times: float, most_mm: float) -> Candidates:
        """Return the members with their radius multiplied, up to `most_mm`."""
        return replace(
            self, radius=np.maximum(self.radius, np.minimum(times * self.radius, most_mm))
        )

    def with_radius(self, number: int, radius_mm: float) -> Candidates:
        """Return the members with another radius of one."""
        radius = self.radius.copy()
        radius[number] = radius_mm
        return replace(self, radius=radius)

    @property
    def length_mm(self) -> Array:
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


def no_members() -> Candidates:
    none = np.empty(0, dtype=np.int64)
    return Candidates(none, none, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


def join_members(parts: list[Candidates]) -> Candidates:
    """Concatenate members, in order."""
    return Candidates(
        np.concatenate([p.first for p in parts]),
        np.concatenate([p.second for p in parts]),
        np.concatenate([p.start for p in parts]),
        np.concatenate([p.end for p in parts]),
        np.concatenate([p.radius for p in parts]),
        None
        if all(p.end_radius is None for p in parts)
        else np.concatenate([p.foot_radius for p in parts]),
    )


def list_struts(sites: Sites, pairs: Indices, tube_mm: float, radius_mm: float) -> Candidates:
    """List members of one radius between pairs (m, 2) of sites that meet both tubes squarely."""
    a, b = pairs[:, 0], pairs[:, 1]
    gap = np.abs(sites.arc[a] - sites.arc[b])
    gap = np.minimum(gap, sites.perimeter[sites.knot[a]] - gap)
    far = (sites.knot[a] != sites.knot[b]) | (gap > 2 * JOINT_RADII * tube_mm)
    a, b = a[far], b[far]
    along = sites.point[b] - sites.point[a]
    length = np.linalg.norm(along, axis=1)
    square = length >= 2.5 * tube_mm  # tube radii of a strut between two centre lines
    for end in (a, b):
        cosine = np.abs(np.einsum("ij,ij->i", along, sites.tangent[end])) / np.maximum(length, 1e-9)
        square &= cosine <= np.sqrt(1 - LEAST_SINE**2)
    a, b = a[square], b[square]
    return Candidates(a, b, sites.point[a], sites.point[b], np.full(len(a), radius_mm))


def sample_strands(knots: Knots) -> tuple[Array, Indices, Array, Array]:
    """Sample all knots; return points (m, 3), their knots, their arc lengths, and each knot's length."""
    points, owner, arcs, lengths = [], [], [], []
    for i, k in enumerate(knots.knots):
        even = sample_evenly(k.points, SAMPLE_RADII * knots.radius_mm, at_most=True)
        whole = arc_lengths(k.points)[-1]
        points.append(even)
        owner.append(np.full(len(even), i))
        arcs.append(np.arange(len(even)) * whole / len(even))
        lengths.append(whole)
    return np.concatenate(points), np.concatenate(owner), np.concatenate(arcs), np.array(lengths)


class Way:
    """Bodies that members keep clear of, among them the `members` added so far."""

    def __init__(self, members: Candidates) -> None:
        self.members = members

    def add(self, some: Candidates) -> None:
        self.members = join_members([self.members, some])

    def clear(self, some: Candidates, but: int | None = None) -> Mask:
        """Return whether each member touches nothing, (n,); the existing one numbered `but` is ignored."""
        raise NotImplementedError


class Obstacles(Way):
    """All tubes, except at a member's own joints, and the members that are there."""

    def __init__(self, knots: Knots, sites: Sites, clearance_mm: float) -> None:
        from scipy.spatial import cKDTree

        super().__init__(no_members())
        self.sites, self.clearance, self.tube = sites, clearance_mm, knots.radius_mm
        self.points, self.owner, self.arc, _ = sample_strands(knots)
        self.beside = ring_neighbours(np.bincount(self.owner))
        self.tree = cKDTree(self.points)
        # between two samples a strand comes nearer by no more than this
        self.slack = (SAMPLE_RADII * knots.radius_mm) ** 2 / (8 * (knots.radius_mm + clearance_mm))

    def clear(self, some: Candidates, but: int | None = None) -> Mask:
        """Do what `Way.clear` says; at the ground posts are wider by `ROOT_SHARE`."""
        free = np.ones(len(some), dtype=bool)
        if not len(some):
            return free
        gap = self.tube + self.clearance + self.slack
        post = some.second == GROUND
        root = np.where(post, ROOT_SHARE, 1.0) * some.radius
        along = some.end - some.start
        length = np.linalg.norm(along, axis=1)
        unit = along / length[:, None]
        i, j = self._near(some, gap + root)
        _, apart = off_segments(self.points[j], some.start[i], unit[i], length[i])
        touched = apart < gap + some.radius[i]
        for site in (some.first[i], some.second[i]):
            perimeter = self.sites.perimeter[self.owner[j]]
            apart = (self.arc[j] - self.sites.arc[site]) % perimeter
            ahead = apart <= perimeter / 2
            apart = np.minimum(apart, perimeter - apart)
            own = (site != GROUND) & (self.sites.knot[site] == self.owner[j])
            joint = np.flatnonzero(own & touched & (apart <= JOINT_RADII * self.tube))
            if len(joint):
                touched[joint] = self._narrow(some, i[joint], j[joint], ahead[joint], unit, length)
        foot = np.linalg.norm(self.points[j] - some.end[i], axis=1)
        touched |= post[i] & (foot < gap + root[i])
        free[i[touched]] = False
        there = self.members
        if but is not None:
            there = there.take(np.delete(np.arange(len(there)), but))
        if len(there):
            n, m = len(some), len(there)
            i, j = np.repeat(np.arange(n), m), np.tile(np.arange(m), n)
            gaps = segment_distance(some.start[i], some.end[i], there.start[j], there.end[j])
            ok = gaps >= some.radius[i] + there.radius[j] + self.clearance
            feet = np.linalg.norm(some.end[i] - there.end[j], axis=1)
            both = post[i] & (there.second[j] == GROUND)
            ok &= ~both | (
                feet >= root[i] + ROOT_SHARE * there.radius[j] + self.clearance + LEAN_MM
            )
            free &= ok.reshape(n, m).all(axis=1)
        return free

    def _near(self, some: Candidates, reach: Array) -> tuple[Indices, Indices]:
        """Pair members with all points that come as near as `reach` (n,) to them, and with some others.

        A member is covered by balls about as wide as its reach, so a long one meets few points beside those.
        """
        along, length = some.end - some.start, some.length_mm
        balls = np.maximum(1, np.ceil(length / (2 * reach))).astype(np.int64)
        i, place = number_runs(balls)
        middle = some.start[i] + ((place + 0.5) / balls[i])[:, None] * along[i]
        wide = (length / (2 * balls) + reach)[i]
        # most balls of a thread, which has no end, are above the piece
        low, high = self.tree.mins, self.tree.maxes
        use = (np.abs(middle - (low + high) / 2) <= (high - low) / 2 + wide[:, None]).all(axis=1)
        near = self.tree.query_ball_point(middle[use], wide[use], return_sorted=False)
        counts = [len(n) for n in near]
        j = np.fromiter(chain.from_iterable(near), np.int64, sum(counts))
        return np.repeat(i[use], counts), j

    def _narrow(
        self, some: Candidates, i: Indices, j: Indices, ahead: Mask, unit: Array, length: Array
    ) -> Mask:
        """Return whether a strand leaves its joint with member i slowly, or comes back, (m,)."""
        onward = self.beside[np.where(ahead, 1, 0), j]
        (_, here), (_, there) = (
            off_segments(self.points[of], some.start[i], unit[i], length[i]) for of in (j, onward)
        )
        step = np.linalg.norm(self.points[onward] - self.points[j], axis=1)
        return opens_slowly(here, there, step, self.tube + some.radius[i], self.clearance)


def off_segments(points: Array, start: Array, unit: Array, length: Array) -> tuple[Array, Array]:
    """Return how far along its segment each point lies, and how far from it, (n,) each."""
    to = points - start
    along = np.clip(np.einsum("ij,ij->i", to, unit), 0.0, length)
    return along, np.asarray(np.linalg.norm(to - along[:, None] * unit, axis=1))


def ring_neighbours(counts: Indices) -> Indices:
    """Return the samples before and after each one, (2, n), on rings of so many samples."""
    ring, place = number_runs(counts)
    first, around = np.arange(len(place)) - place, counts[ring]
    return np.stack([first + (place - 1) % around, first + (place + 1) % around])


def opens_slowly(
    here: Array, there: Array, step: Array, contact: Array, clearance_mm: float
) -> Mask:
    """Return whether a strand and its member part so slowly that printing closes the gap, (n,).

    The gap must open along the strand from just before the two come apart until they are clear of
    each other.

    Args:
        here, there: (n,) distance between their middles at a sample and at the next one, `step`
            (n,) further from their joint; at `contact` (n,) they touch.
    """
    parted = here >= contact - 0.5 * clearance_mm
    # how fast a strand and its member part, mm per mm along the strand
    return np.asarray(parted & (there - here < 0.62 * step))
