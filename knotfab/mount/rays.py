"""Rays for pegs: from tube to wall along the light, in the tube's shadow, clear of all strands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.geometry.sampling import arc_lengths
from knotfab.knots import Knots
from knotfab.mount.struts import (
    SAMPLE_RADII,
    beside_on_rings,
    off_segments,
    opens_slowly,
    sample_strands,
    tangents,
)
from knotfab.scene.camera import Camera

__all__ = ["Rays", "free_rays"]


LEAST_SINE = 0.6  # between tube and ray: a peg that leaves along its tube would graze it
JOINT_RADII = 3.0  # tube radii of arc on each side of a peg's top that belong to its joint


@dataclass(frozen=True)
class Rays:
    """The light rays through the vertices of the knots, (n,) in the knots' order.

    `top` and `foot` (n, 3) are where a ray leaves the tube's middle and where it meets the wall, mm;
    `free` says that a peg may stand there whose radius is `share` of that of the tube's shadow; `tangent`
    (n, 3) are the tube's unit directions.
    """

    knot: Indices
    vertex: Indices
    top: Array
    foot: Array
    tangent: Array
    free: Mask
    share: Array

    @property
    def length_mm(self) -> Array:
        """(n,) from top to foot."""
        return np.asarray(np.linalg.norm(self.foot - self.top, axis=1))


def free_rays(knots: Knots, camera: Camera, peg_share: float, clearance_mm: float) -> Rays:
    """Find the rays on which a round peg is hidden and touches nothing but its own joint.

    Whatever lies on a ray behind a point of the tube, no farther from it than the tube's radius
    magnified from the light, is in the tube's shadow (design, section 8). A peg is a cone of which
    `peg_share` of that is filled. It is free when every other stretch of tube that lies behind its
    top stays `clearance_mm` away.

    Args:
        knots: in scene coordinates. camera: the light and its wall.
        peg_share: the peg's radius over that of the tube's shadow, above 0 and at most 1.

    Raises:
        ValueError: the peg would be thicker than the tube's shadow.
    """
    if not 0 < peg_share <= 1:
        raise ValueError(f"a peg of {peg_share} tubes does not hide behind the tube")
    knot = np.concatenate([np.full(len(k.points), i) for i, k in enumerate(knots.knots)])
    vertex = np.concatenate([np.arange(len(k.points)) for k in knots.knots])
    top = knots.points
    tangent = np.concatenate([tangents(k.points) for k in knots.knots])
    light, foot = camera.eye, camera.cast(top)
    away = top - light
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    sine = np.linalg.norm(np.cross(unit, tangent), axis=1)
    free = sine >= LEAST_SINE
    free &= _clear(knots, light, knot, top, foot, peg_share, clearance_mm)
    return Rays(knot, vertex, top, foot, tangent, free, np.full(len(knot), peg_share))


def _clear(
    knots: Knots,
    light: Array,
    knot: Indices,
    top: Array,
    foot: Array,
    share: float,
    clearance: float,
) -> Mask:
    """Tell (n,) whether all tubes but a peg's own joint keep their clearance from it.

    Seen from the light a ray is a point, and what may touch it lies near that point: samples of
    the centre lines are looked up on the unit sphere about the light, and measured in space.
    """
    from scipy.spatial import cKDTree

    samples, owner, arc, perimeter = sample_strands(knots)
    arc_of_vertex = np.concatenate([arc_lengths(k.points)[:-1] for k in knots.knots])
    distance_of = np.linalg.norm(samples - light, axis=1)
    unit = (foot - light) / np.linalg.norm(foot - light, axis=1)[:, None]
    length = np.linalg.norm(foot - top, axis=1)
    step = SAMPLE_RADII * knots.radius_mm
    # between two samples the line comes nearer by no more than the last term
    gap = knots.radius_mm + clearance
    gap += step**2 / (8 * gap)
    to_top = np.linalg.norm(top - light, axis=1)
    tree = cKDTree((samples - light) / distance_of[:, None])
    widest = gap / float(distance_of.min()) + share * knots.radius_mm / to_top
    near = tree.query_ball_point(unit, 1.01 * widest)
    ray = np.repeat(np.arange(len(top)), [len(n) for n in near])
    found = np.concatenate([np.asarray(n, dtype=np.int64) for n in near])
    along, distance = off_segments(samples[found], top[ray], unit[ray], length[ray])
    apart = np.abs(arc[found] - arc_of_vertex[ray])
    apart = np.minimum(apart, perimeter[owner[found]] - apart)
    own = (owner[found] == knot[ray]) & (apart <= JOINT_RADII * knots.radius_mm)
    clear = np.ones(len(top), dtype=bool)
    width = share * knots.radius_mm * (1 + along / to_top[ray])
    close = distance < gap + width
    clear[ray[close & ~own]] = False
    # within its joint a strand may touch the peg, but must leave it at once
    joint = np.flatnonzero(close & own)
    ray, found = ray[joint], found[joint]
    back, ahead = beside_on_rings(np.bincount(owner, minlength=len(knots.knots)))
    forward = (arc[found] - arc_of_vertex[ray]) % perimeter[owner[found]]
    onward = np.where(forward <= perimeter[owner[found]] / 2, ahead[found], back[found])
    _, there = off_segments(samples[onward], top[ray], unit[ray], length[ray])
    pace = np.linalg.norm(samples[onward] - samples[found], axis=1)
    contact = knots.radius_mm + width[joint]
    clear[ray[opens_slowly(distance[joint], there, pace, contact, clearance)]] = False
    return clear
