"""Brace a piece that sags on its pegs, by struts and leaning pegs that are wholly hidden."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.hold.beams import JOINT_RADII, Stiffness
from knotfab.hold.planner import PEGS, plan_members
from knotfab.hold.shade import HIDDEN_SHARE, MountShadows, Rays, hidden_struts
from knotfab.hold.struts import (
    GROUND,
    Candidates,
    Obstacles,
    Sites,
    Way,
    join_members,
    list_struts,
    no_members,
    sites_of,
)
from knotfab.knots import Knots
from knotfab.scene.camera import Camera

STARTS = 160  # starts of leaning pegs, evenly along all tubes, and as many ends
MOST_SLOPE = 1.0  # a leaning peg's slope: along the wall per mm towards it
LEAST_SLOPE = 0.15
MOST_COSINE = 0.75  # between a leaning peg and its tube


def hidden_braces(
    knots: Knots,
    camera: Camera,
    stiffness: Stiffness,
    sites: Sites,
    obstacles: Obstacles,
    shadows: MountShadows,
    pegs: Candidates,
) -> Candidates:
    """Find the members that keep a piece from sagging on its pegs.

    A strand often bars a light ray's way to the wall, but a strut to that strand is free. And a peg along a
    ray only bends, whereas one that leans is pulled or pressed, which it resists many times better. A member
    whose whole shadow lies in that of the knots shows as little as a peg along a ray, and draws nothing that
    the knots do not.

    Args:
        sites: that the pegs stand on (`sites_with`). obstacles: with the pegs.

    Returns:
        members of one radius: struts, and leaning pegs (their second site is `GROUND`).
    """
    pool = join_members(
        [
            hidden_struts(sites, shadows, knots.radius_mm),
            _list_leaning(sites, shadows, camera, knots.radius_mm),
        ]
    )
    pool = pool.take(shadows.behind_knots(pool))
    # a peg is taken to be no stiffer than its cone, so that the struts hold in the finer model too
    given = replace(pegs, radius=np.sqrt(pegs.radius * pegs.foot_radius), end_radius=None)
    none = np.zeros(len(pool), dtype=bool)
    braced = plan_members(
        knots, sites, obstacles, shadows, pool, none, given, stiffness, settled=True
    )
    return braced.members.take(np.arange(len(given), len(braced.members)))


def tie_to_held(
    knots: Knots, sites: Sites, obstacles: Obstacles, shadows: MountShadows, barred: tuple[int, ...]
) -> Candidates:
    """Tie each knot without a peg to one that is held, by the shortest strut that is hidden.

    Such a knot lies in front of another, as the dot of an i may lie before its stem. The strut runs from one
    to the other, as a peg would to the wall.

    Args:
        sites: that the pegs stand on (`sites_with`). obstacles: with the pegs; the struts are added.
        barred: the knots without a peg.

    Returns:
        one strut for each of them, which begins there.

    Raises:
        ValueError: a knot has no such strut; the message names it.
    """
    reach = 60.0 * knots.radius_mm  # the longest strut on which a knot hangs
    left, found = list(barred), no_members()
    while left:
        tie = next(
            (t for k in left if len(t := _tie_knot(k, left, sites, obstacles, shadows, reach))),
            None,
        )
        if tie is None:
            raise ValueError(
                f"no light ray from knot {left[0]} to the wall is free for a peg, nor is there a way for a "
                "strut from it to another knot"
            )
        left.remove(int(sites.knot[tie.first[0]]))
        obstacles.add(tie)
        found = join_members([found, tie])
    return found


def _tie_knot(
    knot: int,
    barred: list[int],
    sites: Sites,
    obstacles: Obstacles,
    shadows: MountShadows,
    reach: float,
) -> Candidates:
    """Find the shortest hidden strut from a knot to one that is not barred: one, or none."""
    own, held = np.flatnonzero(sites.knot == knot), np.flatnonzero(~np.isin(sites.knot, barred))
    gaps = np.linalg.norm(sites.point[own][:, None] - sites.point[held][None], axis=2)
    near = np.argwhere(gaps <= reach)
    pairs = np.column_stack([own[near[:, 0]], held[near[:, 1]]])
    tube = obstacles.tube
    ways = list_struts(sites, pairs, tube, HIDDEN_SHARE * tube)
    ways = ways.take(shadows.hidden(ways))
    ways = ways.take(shadows.behind_knots(ways))
    ways = ways.take(np.argsort(ways.length_mm, kind="stable"))
    for n in range(len(ways)):
        if obstacles.clear(one := ways.take([n]))[0]:
            return one
    return no_members()


def sites_with(knots: Knots, rays: Rays, chosen: Indices) -> Sites:
    """Return sites along all tubes, among them those where the chosen rays begin."""
    of = rays.knot[chosen]
    return sites_of(knots, also={k: rays.vertex[chosen][of == k] for k in range(len(knots.knots))})


def pegs_on(
    sites: Sites, rays: Rays, chosen: Indices, top_radius_mm: Array, foot_radius_mm: Array
) -> Candidates:
    """Make members of the chosen rays' pegs, with radii (n,) of each ray at tube and wall."""
    first = [
        int(np.flatnonzero((sites.knot == rays.knot[i]) & (sites.vertex == rays.vertex[i]))[0])
        for i in chosen
    ]
    return pegs_along(rays, chosen, top_radius_mm, foot_radius_mm, np.array(first))


def _list_leaning(
    sites: Sites, shadows: MountShadows, camera: Camera, tube_mm: float
) -> Candidates:
    """List pegs to the wall that lean so as to stay in the shadow of other sites."""
    normal = camera.receiver[:3]
    some = np.unique(np.linspace(0, len(sites.knot) - 1, STARTS).astype(np.int64))
    feet = camera.cast(sites.point[some])
    first = np.repeat(some, len(some))
    start, end = sites.point[first], np.tile(feet, (len(some), 1))
    along = end - start
    deep = -(along @ normal)
    slope = np.linalg.norm(along + deep[:, None] * normal, axis=1) / deep
    cosine = np.abs(np.einsum("ij,ij->i", along, sites.tangent[first]))
    fits = (slope >= LEAST_SLOPE) & (slope <= MOST_SLOPE)
    fits &= cosine <= MOST_COSINE * np.linalg.norm(along, axis=1)
    n = np.flatnonzero(fits)
    radius = np.full(len(n), HIDDEN_SHARE * tube_mm)
    every = Candidates(first[n], np.full(len(n), GROUND), start[n], end[n], radius)
    return every.take(shadows.hidden(every))


# Choose as few pegs as keep every knot from sagging: one for each, and those that `planner` adds.

APART_RADII = 4.0  # between the middles of two feet, so that each keeps its fillet
CANDIDATES = 192  # rays of one knot: in each stretch of its length the shortest free one


@dataclass(frozen=True)
class Pegs:
    """Chosen pegs, as numbers of rays, and the largest displacement (mm) with them, and where (3,).

    `barred` are the knots from which no ray to the wall is free: they have no peg, and do not count
    in the displacement.
    """

    rays: Indices
    sag_mm: float
    sag_at: Array
    barred: tuple[int, ...] = ()


def choose_pegs(
    knots: Knots, rays: Rays, top_radius_mm: Array, foot_radius_mm: Array, stiffness: Stiffness
) -> Pegs:
    """Choose rays for pegs until no point of any knot sags more than `max_sag_mm` (gravity: -y).

    Each knot starts with one peg, and gets more independently of the others (`plan_members`). If no free ray
    helps any more, the sag stays above the limit, which the caller must check.

    Args:
        knots: those that `rays` belong to, in scene coordinates.
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
        feet = Feet(APART_RADII * knots.radius_mm, pegs_along(rays, np.array(chosen, int), *radii))
        clear = feet.clear(pegs_along(rays, own, *radii))
        one = Knots((knot,), knots.radius_mm)
        own = _spread_rays(one, rays, own[clear] if clear.any() else own)
        sites = sites_of(one, JOINT_RADII, {0: rays.vertex[own]})
        pegs = pegs_along(rays, own, *radii, np.searchsorted(sites.vertex, rays.vertex[own]))
        feet.add(given := pegs.take([0]))
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
    """Pegs along free rays, which keep clear of each other if their feet are apart."""

    def __init__(self, apart_mm: float, members: Candidates) -> None:
        super().__init__(members)
        self.apart_mm = apart_mm

    def clear(self, some: Candidates, but: int | None = None) -> Mask:
        """Return whether the feet of pegs keep clear of those that are there, (n,)."""
        there = self.members.end if but is None else np.delete(self.members.end, but, axis=0)
        gaps = np.linalg.norm(some.end[:, None] - there[None], axis=2)
        return np.asarray((gaps >= self.apart_mm).all(axis=1))


def _spread_rays(one: Knots, rays: Rays, own: Indices) -> Indices:
    """Choose the shortest ray in each stretch of a knot; the first peg's comes first."""
    every = sites_of(one, JOINT_RADII, {0: rays.vertex[own]})
    arc = every.arc[np.searchsorted(every.vertex, rays.vertex[own])]
    bins = (arc / float(every.perimeter[0]) * CANDIDATES).astype(np.int64)
    order = np.lexsort((rays.length_mm[own], bins))
    shortest = own[order[np.flatnonzero(np.diff(bins[order], prepend=-1))]]
    near = np.linalg.norm(rays.top[shortest] - one.points.mean(axis=0), axis=1)
    first = int((near + rays.length_mm[shortest]).argmin())
    return np.concatenate([shortest[first : first + 1], np.delete(shortest, first)])


def pegs_along(
    rays: Rays, some: Indices, top: Array, foot: Array, sites: Indices | None = None
) -> Candidates:
    """Make pegs along rays, with radii (n,) at top and foot of each ray, from `sites` if given."""
    ground = np.full(len(some), GROUND)
    first = ground if sites is None else sites
    return Candidates(first, ground, rays.top[some], rays.foot[some], top[some], foot[some])
