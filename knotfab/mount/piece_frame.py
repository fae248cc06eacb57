"""The frame of a whole piece under its own weight: its tubes, and the members that hold or stiffen them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.knots import Knots
from knotfab.mount.frame_model import Beams, SpaceFrame, frame_of, round_beams
from knotfab.mount.struts import GROUND, Candidates, Sites, sites_of
from knotfab_formats.scene import ResolvedScene

__all__ = [
    "DOWN",
    "JOINT_RADII",
    "PIECES",
    "Stiffness",
    "piece_beams",
    "piece_frame",
    "sag_moves",
    "taper",
    "worst_of",
]


JOINT_RADII = 2.0  # distance of the joints along a tube, in tube radii
PIECES = 4  # pieces of a tapering member, each taken as round
DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Stiffness:
    """The piece's material and how far it may sag: MPa, g/cm³, mm."""

    young_mpa: float
    density_g_cm3: float
    max_sag_mm: float

    @classmethod
    def of(cls, scene: ResolvedScene) -> Stiffness:
        """Return the stiffness of a scene's material and mount."""
        material = scene.material
        return cls(material.young_modulus_mpa, material.density_g_cm3, scene.mount.max_sag_mm)


def taper(top: Array, foot: Array, pieces: int = PIECES) -> Array:
    """Return (..., pieces) radii of cones cut into round pieces, from their tops (...,) to their feet."""
    share = (np.arange(pieces) + 0.5) / pieces
    return np.asarray(top[..., None] + share * (foot - top)[..., None])


def piece_beams(
    radius_mm: float,
    sites: Sites,
    members: Candidates,
    pieces: int = 1,
) -> tuple[Beams, Indices]:
    """Return the beams of tubes and members, and the joints that the ground (desk or wall) holds.

    The sites are the first joints, in their order.

    Args:
        pieces: that each member is cut into; those that taper need several.
    """
    n, m, inner = len(sites.knot), len(members), pieces - 1
    share = np.arange(pieces + 1)[:, None] / pieces
    points = members.start[:, None] + share * (members.end - members.start)[:, None]
    grounded = members.second == GROUND
    feet = n + m * inner + np.arange(int(grounded.sum()))
    joints = np.empty((m, pieces + 1), dtype=np.int64)
    joints[:, 0], joints[:, -1] = members.first, members.second
    joints[:, 1:-1] = n + np.arange(m * inner).reshape(m, inner)
    joints[grounded, -1] = feet
    beams = round_beams(
        np.concatenate([sites.point, points[:, 1:-1].reshape(-1, 3), members.end[grounded]]),
        np.concatenate(
            [
                np.column_stack([np.arange(n), sites.following]),
                np.stack([joints[:, :-1], joints[:, 1:]], axis=2).reshape(-1, 2),
            ]
        ),
        np.concatenate(
            [np.full(n, radius_mm), taper(members.radius, members.foot_radius, pieces).ravel()]
        ),
    )
    return beams, feet


def piece_frame(
    knots: Knots, sites: Sites, members: Candidates, stiffness: Stiffness
) -> SpaceFrame:
    """Give the frame of a piece with joints at the sites, and along members that taper, ready to be asked."""
    pieces = 1 if members.end_radius is None else PIECES
    beams, fixed = piece_beams(knots.radius_mm, sites, members, pieces)
    return frame_of(beams, fixed, stiffness.young_mpa, stiffness.density_g_cm3, DOWN)


def sag_moves(
    knots: Knots,
    sites: Sites,
    members: Candidates,
    stiffness: Stiffness,
    step_radii: float = JOINT_RADII,
) -> Array:
    """Return (N, 3) how far each vertex of the knots moves on their members, mm, by a frame built anew.

    Its joints are `step_radii` tube radii apart and wherever a member ends, and members are cut in
    pieces: a second opinion on those who choose members by a coarser frame. Between joints moves are
    interpolated by the vertices' numbers.

    Args:
        sites: that the members join.
    """
    met = np.concatenate([members.first, members.second])
    met = met[met != GROUND]
    also = {k: sites.vertex[met][sites.knot[met] == k] for k in range(len(knots.knots))}
    fine = sites_of(knots, step_radii, also)
    # sites come knot by knot, and in the order of their vertices
    most = 1 + int(max(fine.vertex.max(), sites.vertex.max()))
    place = np.searchsorted(fine.knot * most + fine.vertex, sites.knot * most + sites.vertex)
    there = np.append(place, GROUND)  # the last of them stands for the ground
    moved = replace(members, first=there[members.first], second=there[members.second])
    beams, fixed = piece_beams(knots.radius_mm, fine, moved, PIECES)
    frame = frame_of(beams, fixed, stiffness.young_mpa, stiffness.density_g_cm3, DOWN)
    moves = frame.displacements()[: len(fine.knot), :3]
    found = []
    for k, knot in enumerate(knots.knots):
        own, count = fine.knot == k, len(knot.points)
        each = (np.interp(range(count), fine.vertex[own], m, period=count) for m in moves[own].T)
        found.append(np.column_stack(list(each)))
    return np.concatenate(found)


def worst_of(moves: Array, points: Array) -> tuple[float, Array]:
    """Return the largest of moves (N, 3), mm, and at which of the points (3,)."""
    size = np.linalg.norm(moves, axis=1)
    worst = int(size.argmax())
    return float(size[worst]), points[worst]
