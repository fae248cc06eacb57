"""What holds a piece that sags on its pegs: struts, and pegs that lean, in the shadow from end to end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.knots import Knots
from knotfab.mount.brace import brace
from knotfab.mount.choose import Stiffness
from knotfab.mount.rays import Rays
from knotfab.mount.shade import HIDDEN_SHARE, Shadows, hidden_struts
from knotfab.mount.struts import GROUND, Candidates, Obstacles, Sites, joined, sites_of
from knotfab.scene.camera import Camera

__all__ = ["hidden_braces"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

STARTS = 160  # of leaning pegs, evenly along all tubes, and as many ends
MOST_SLOPE = 1.0  # of a leaning peg: along the wall per mm towards it
LEAST_SLOPE = 0.15
MOST_COSINE = 0.75  # between a leaning peg and its tube


def hidden_braces(
    knots: Knots,
    camera: Camera,
    target: Mask,
    clearance_mm: float,
    stiffness: Stiffness,
    rays: Rays,
    chosen: Ints,
    radii_mm: tuple[float, Array, Array],
) -> tuple[Sites, Candidates]:
    """The members that keep a piece on its pegs from sagging, and the sites that they join.

    A light ray to the wall is often barred by a strand behind; a strut to that strand is not. And a
    peg along a ray only bends, where one that leans is pulled or pressed, which it resists many
    times better. A member whose whole shadow lies in that of the knots shows as little as a peg along a
    ray does, and draws nothing that the knots do not.

    Args:
        target: (H, W) the picture's silhouette. rays, chosen: the pegs.
        radii_mm: of a peg at the tube, and (n,) at the wall and at the root of each ray.

    Returns:
        sites, and members of one radius: struts, and leaning pegs (their second site is `GROUND`).
    """
    at = {k: rays.vertex[chosen][rays.knot[chosen] == k] for k in range(len(knots.knots))}
    sites = sites_of(knots, also=at)
    own = [
        int(np.flatnonzero((sites.knot == rays.knot[i]) & (sites.vertex == rays.vertex[i]))[0])
        for i in chosen
    ]
    top, foot, root = radii_mm

    def pegs(radius: Array) -> Candidates:
        ground = np.full(len(chosen), GROUND)
        return Candidates(np.array(own), ground, rays.top[chosen], rays.foot[chosen], radius)

    obstacles = Obstacles(knots, sites, clearance_mm)
    obstacles.add(pegs(root[chosen]))
    shadows = Shadows(knots, (camera,), (target,))
    pool = joined(
        [
            hidden_struts(sites, shadows, knots.radius_mm),
            _leaning(sites, shadows, camera, knots.radius_mm),
        ]
    )
    pool = pool.of(shadows.behind_knots(pool))
    # no stiffer than the cone: what is found must hold in the finer model too
    given = pegs(np.sqrt(top * foot[chosen]))
    none = np.zeros(len(pool), dtype=bool)
    braced = brace(knots, sites, obstacles, shadows, pool, none, given, stiffness, settled=True)
    return sites, braced.members.of(np.arange(len(given), len(braced.members)))


def _leaning(sites: Sites, shadows: Shadows, camera: Camera, tube_mm: float) -> Candidates:
    """Pegs from sites to the wall that end in the shadow of other sites, and stay in the dark on the way."""
    normal, offset = camera.receiver[:3], camera.receiver[3]
    some = np.unique(np.linspace(0, len(sites.knot) - 1, STARTS).astype(np.int64))
    away = sites.point[some] - camera.eye
    feet = camera.eye + away * ((normal @ camera.eye + offset) / -(away @ normal))[:, None]
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
