"""Choose as few pegs as keep every knot from sagging: one for each, and those that `planner` adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.knots import Knots
from knotfab.mount.piece_frame import JOINT_RADII, Stiffness
from knotfab.mount.planner import PEGS, plan_members
from knotfab.mount.rays import Rays
from knotfab.mount.shade import MountShadows
from knotfab.mount.struts import GROUND, Candidates, Way, sites_of

__all__ = ["Pegs", "choose_pegs"]


APART_RADII = 4.0  # between the middles of two feet, so that each keeps its fillet
CANDIDATES = 192  # rays of one knot: in each stretch of its length the shortest free one


@dataclass(frozen=True)
class Pegs:
    """Chosen pegs, as numbers of rays, and the largest displacement (mm) with them, and where (3,).

    `barred` are the knots from which no ray to the wall is free: without a peg, and not in the displacement.
    """

    rays: Indices
    sag_mm: float
    sag_at: Array
    barred: tuple[int, ...] = ()


def choose_pegs(
    knots: Knots,
    rays: Rays,
    top_radius_mm: Array,
    foot_radius_mm: Array,
    stiffness: Stiffness,
) -> Pegs:
    """Choose rays for pegs until no point of any knot sags more than `max_sag_mm` (gravity: -y).

    Each knot starts with one peg, and gets more by itself (`plan_members`). Where no free ray helps any more,
    the sag is what it is: the caller compares.

    Args:
        knots: in scene coordinates, those that `rays` belong to.
        top_radius_mm, foot_radius_mm: (n,) of a peg along each ray, at the tube and at the wall.

    Raises:
        ValueError: no knot has a free ray.
    """
    chosen: list[int] = []
    barred: list[int] = []
    worst, at = 0.0, knots.points[0]
    radii = top_radius_mm, foot_radius_mm
    unseen = MountShadows(knots, (), ())  # a peg hides behind its strand
    for k, knot in enumerate(knots.knots):
        own = np.flatnonzero(rays.free & (rays.knot == k))
        if not len(own):
            barred.append(k)
            continue
        feet = Feet(APART_RADII * knots.radius_mm, along(rays, np.array(chosen, int), *radii))
        clear = feet.clear(along(rays, own, *radii))
        one = Knots((knot,), knots.radius_mm)
        own = _spread(one, rays, own[clear] if clear.any() else own)
        sites = sites_of(one, JOINT_RADII, {0: rays.vertex[own]})
        pegs = along(rays, own, *radii, np.searchsorted(sites.vertex, rays.vertex[own]))
        feet.add(given := pegs.of([0]))
        none = np.zeros(len(pegs), dtype=bool)
        found = plan_members(
            one, sites, feet, unseen, pegs, none, given, stiffness, PEGS, settled=True
        )
        chosen += own[[0, *found.taken]].tolist()
        if found.sag_mm >= worst:
            worst, at = found.sag_mm, found.sag_at
    if not chosen:
        raise ValueError("no light ray from any knot to the wall is free for a peg")
    return Pegs(np.array(chosen, dtype=np.int64), worst, at, tuple(barred))


class Feet(Way):
    """Pegs along free rays keep clear of each other where their feet are apart."""

    def __init__(self, apart_mm: float, members: Candidates) -> None:
        super().__init__(members)
        self.apart_mm = apart_mm

    def clear(self, some: Candidates, but: int | None = None) -> Mask:
        """Tell (n,) whether the feet of pegs are apart from those that are there."""
        there = self.members.end if but is None else np.delete(self.members.end, but, axis=0)
        gaps = np.linalg.norm(some.end[:, None] - there[None], axis=2)
        return np.asarray((gaps >= self.apart_mm).all(axis=1))


def _spread(one: Knots, rays: Rays, own: Indices) -> Indices:
    """Give the shortest of a knot's rays in each stretch of its length; that of its first peg comes first."""
    every = sites_of(one, JOINT_RADII, {0: rays.vertex[own]})
    arc = every.arc[np.searchsorted(every.vertex, rays.vertex[own])]
    bins = (arc / float(every.perimeter[0]) * CANDIDATES).astype(np.int64)
    order = np.lexsort((rays.length_mm[own], bins))
    shortest = own[order[np.flatnonzero(np.diff(bins[order], prepend=-1))]]
    near = np.linalg.norm(rays.top[shortest] - one.points.mean(axis=0), axis=1)
    first = int((near + rays.length_mm[shortest]).argmin())
    return np.concatenate([shortest[first : first + 1], np.delete(shortest, first)])


def along(
    rays: Rays, some: Indices, top: Array, foot: Array, sites: Indices | None = None
) -> Candidates:
    """Return pegs along rays, of radii (n,) at top and foot of each ray, from sites where those are given."""
    ground = np.full(len(some), GROUND)
    first = ground if sites is None else sites
    return Candidates(first, ground, rays.top[some], rays.foot[some], top[some], foot[some])
