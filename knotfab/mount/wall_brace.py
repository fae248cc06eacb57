"""Brace a piece that sags on its pegs: struts, and pegs that lean, in the shadow from end to end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.knots import Knots
from knotfab.mount.choose import along
from knotfab.mount.piece_frame import Stiffness
from knotfab.mount.planner import plan_members
from knotfab.mount.rays import Rays
from knotfab.mount.shade import HIDDEN_SHARE, MountShadows, hidden_struts
from knotfab.mount.struts import (
    GROUND,
    Candidates,
    Obstacles,
    Sites,
    join,
    nothing,
    sites_of,
    struts,
)
from knotfab.scene.camera import Camera

__all__ = ["hidden_braces", "pegs_on", "sites_with", "tie_to_held"]


STARTS = 160  # starts of leaning pegs, evenly along all tubes, and as many ends
MOST_SLOPE = 1.0  # a leaning peg's slope: along the wall per mm towards it
LEAST_SLOPE = 0.15
MOST_COSINE = 0.75  # between a leaning peg and its tube


def hidden_braces(
    knots: Knots,
    camera: Camera,
    target: Mask,
    clearance_mm: float,
    stiffness: Stiffness,
    sites: Sites,
    pegs: Candidates,
    root_radius_mm: Array,
) -> Candidates:
    """Return the members that keep a piece on its pegs from sagging.

    A light ray to the wall is often barred by a strand behind; a strut to that strand is not. And a
    peg along a ray only bends, where one that leans is pulled or pressed, which it resists many
    times better. A member whose whole shadow lies in that of the knots shows as little as a peg along a
    ray does, and draws nothing that the knots do not.

    Args:
        target: (H, W) the picture's silhouette. sites: that the pegs stand on (`sites_with`).
        root_radius_mm: (n,) of the pegs at the wall, with their fillets.

    Returns:
        members of one radius: struts, and leaning pegs (their second site is `GROUND`).
    """
    obstacles = Obstacles(knots, sites, clearance_mm)
    obstacles.add(replace(pegs, radius=root_radius_mm, end_radius=None))
    shadows = MountShadows(knots, (camera,), (target,))
    pool = join(
        [
            hidden_struts(sites, shadows, knots.radius_mm),
            _leaning(sites, shadows, camera, knots.radius_mm),
        ]
    )
    pool = pool.of(shadows.behind_knots(pool))
    # a peg is taken to be no stiffer than its cone, so that the struts hold in the finer model too
    given = replace(pegs, radius=np.sqrt(pegs.radius * pegs.foot_radius), end_radius=None)
    none = np.zeros(len(pool), dtype=bool)
    braced = plan_members(
        knots, sites, obstacles, shadows, pool, none, given, stiffness, settled=True
    )
    return braced.members.of(np.arange(len(given), len(braced.members)))


def tie_to_held(
    knots: Knots,
    camera: Camera,
    target: Mask,
    clearance_mm: float,
    sites: Sites,
    pegs: Candidates,
    root_radius_mm: Array,
    barred: tuple[int, ...],
) -> Candidates:
    """Return a strut from each knot that has no peg to one that is held: the shortest that is hidden.

    Such a knot lies in front of another, as the dot of an i may before its stem: the strut runs from one to
    the other, as a peg would to the wall.

    Args:
        target: (H, W) the picture's silhouette. sites: that the pegs stand on (`sites_with`).
        root_radius_mm: (n,) of the pegs, with their fillets. barred: the knots without one.

    Returns:
        one strut for each of them, which begins there.

    Raises:
        ValueError: for a knot there is none; the message names it.
    """
    obstacles = Obstacles(knots, sites, clearance_mm)
    obstacles.add(replace(pegs, radius=root_radius_mm, end_radius=None))
    # tube radii: the longest strut on which a knot hangs
    shadows, reach = MountShadows(knots, (camera,), (target,)), 60.0 * knots.radius_mm
    left, found = list(barred), nothing()
    while left:
        tie = next(
            (t for k in left if len(t := _tie(k, left, sites, obstacles, shadows, reach))), None
        )
        if tie is None:
            raise ValueError(
                f"no light ray from knot {left[0]} to the wall is free for a peg, nor is there a way for a "
                "strut from it to another knot"
            )
        left.remove(int(sites.knot[tie.first[0]]))
        obstacles.add(tie)
        found = join([found, tie])
    return found


def _tie(
    knot: int,
    barred: list[int],
    sites: Sites,
    obstacles: Obstacles,
    shadows: MountShadows,
    reach: float,
) -> Candidates:
    """Return the shortest hidden strut from a knot to one that is not barred: one, or none."""
    own, held = np.flatnonzero(sites.knot == knot), np.flatnonzero(~np.isin(sites.knot, barred))
    gaps = np.linalg.norm(sites.point[own][:, None] - sites.point[held][None], axis=2)
    near = np.argwhere(gaps <= reach)
    pairs = np.column_stack([own[near[:, 0]], held[near[:, 1]]])
    tube = obstacles.tube
    ways = struts(sites, pairs, tube, HIDDEN_SHARE * tube)
    ways = ways.of(shadows.hidden(ways))
    ways = ways.of(shadows.behind_knots(ways))
    ways = ways.of(np.argsort(ways.length_mm, kind="stable"))
    for n in range(len(ways)):
        if obstacles.clear(one := ways.of([n]))[0]:
            return one
    return nothing()


def sites_with(knots: Knots, rays: Rays, chosen: Indices) -> Sites:
    """Return sites along all tubes, and those where the chosen rays begin."""
    of = rays.knot[chosen]
    return sites_of(knots, also={k: rays.vertex[chosen][of == k] for k in range(len(knots.knots))})


def pegs_on(
    sites: Sites, rays: Rays, chosen: Indices, top_radius_mm: Array, foot_radius_mm: Array
) -> Candidates:
    """Give the pegs along the chosen rays as members: radii (n,) of each ray at the tube and at the wall."""
    first = [
        int(np.flatnonzero((sites.knot == rays.knot[i]) & (sites.vertex == rays.vertex[i]))[0])
        for i in chosen
    ]
    return along(rays, chosen, top_radius_mm, foot_radius_mm, np.array(first))


def _leaning(sites: Sites, shadows: MountShadows, camera: Camera, tube_mm: float) -> Candidates:
    """Lead pegs from sites to the wall so that they stay in the shadow of other sites all the way."""
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
    return every.of(shadows.hidden(every))
