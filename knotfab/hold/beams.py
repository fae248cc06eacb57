"""A piece as a frame under its own weight: its tubes, and the members that hold or stiffen them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.effects.shifts import allow_sag_mm
from knotfab.hold.space_frame import (
    Beams,
    SpaceFrame,
    assemble_frame,
    loads_of,
    round_beams,
    stiffness_of,
)
from knotfab.hold.struts import GROUND, Candidates, Sites, sites_of
from knotfab.knots import Knots
from knotfab_formats.scene import SettledScene
from knotfab_formats.slicer_ini import plan_walls

JOINT_RADII = 2.0  # distance of the joints along a tube, in tube radii
PIECES = 4  # pieces of a tapering member, each taken as round
_MEET_MM = 1e-3  # ends of members that are no farther apart meet
# makes of beams and their ends at the ground others, and which of their unknowns are held (6 n,)
Hold = Callable[[Beams, Indices], tuple[Beams, Mask]]
DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Stiffness:
    """The piece's material, how far it may sag, and the wall that it is printed with: MPa, g/cm³, mm."""

    young_mpa: float
    density_g_cm3: float
    max_sag_mm: float
    wall_mm: float = np.inf  # no core

    @classmethod
    def from_scene(cls, scene: SettledScene, knots: Knots) -> Stiffness:
        """Read a scene's material, and how far its mount may let these knots sag."""
        material, most = scene.material, scene.mount.max_sag_mm
        if most is None:
            points = np.concatenate([knot.points for knot in knots.knots])
            most = allow_sag_mm(scene.views, points, knots.radius_mm)
        wall = np.inf
        if {scene.printer.process, material.process} == {"filament"}:
            wall = plan_walls(scene.printer, knots.radius_mm).thick_mm
        return cls(material.young_modulus_mpa, material.density_g_cm3, most, wall)


@dataclass(frozen=True, kw_only=True)
class Holder:
    """What holds a piece, and how the piece sags on it, computed from a frame with all members.

    It sags most at `sag_at`; `moves` (N, 3) tells how far each vertex of the knots moves.
    """

    sag_mm: float
    sag_at: Array
    moves: Array = field(default_factory=lambda: np.empty((0, 3)))


def taper(top: Array, foot: Array, pieces: int = PIECES) -> Array:
    """Cut cones into round pieces: their radii (..., pieces) from tops to feet (...,)."""
    share = (np.arange(pieces) + 0.5) / pieces
    return np.asarray(top[..., None] + share * (foot - top)[..., None])


def piece_beams(
    radius_mm: float, sites: Sites, members: Candidates, pieces: int = 1, wall_mm: float = np.inf
) -> tuple[Beams, Indices]:
    """Return the beams of tubes and members, and the joints that the ground (desk or wall) holds.

    The sites are the first joints, in their order.

    Args:
        pieces: how many beams stand for each member; those that taper need several.
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
        wall_mm,
    )
    return beams, feet


def piece_frame(
    knots: Knots, sites: Sites, members: Candidates, stiffness: Stiffness, hold: Hold | None = None
) -> HeldFrame:
    """Solve the frame of a piece with joints at the sites and along members that taper.

    Args:
        hold: as for `sag_moves`; posts that are added later end at the nearest place that is held.
    """
    pieces = 1 if members.end_radius is None else PIECES
    beams, fixed = piece_beams(knots.radius_mm, sites, members, pieces, stiffness.wall_mm)
    held, feet = None, fixed[:0]
    if hold is not None:
        beams, held = hold(beams, fixed)
        feet = np.intersect1d(fixed, beams.ends)
    frame = assemble_frame(beams, fixed, stiffness.young_mpa, stiffness.density_g_cm3, DOWN, held)
    return HeldFrame(frame, feet, beams.joints[feet])


def sag_moves(
    knots: Knots,
    sites: Sites,
    members: Candidates,
    stiffness: Stiffness,
    step_radii: float = JOINT_RADII,
    hold: Hold | None = None,
) -> Array:
    """Compute how far each vertex moves on the members, mm (N, 3), from a new, finer frame.

    Its joints are `step_radii` tube radii apart and wherever a member ends, and members are cut into
    pieces: a second opinion on members that were chosen by a coarser frame. Moves are interpolated
    between joints by the vertices' numbers.

    Args:
        sites: those that the members join. hold: makes of the beams and their ends at the ground others, and
            which of their unknowns are held (`hold_by_threads`); None: nothing moves or turns at those ends.
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
    beams, fixed = piece_beams(knots.radius_mm, fine, moved, PIECES, stiffness.wall_mm)
    held = None
    if hold is not None:
        beams, held = hold(beams, fixed)
    frame = assemble_frame(beams, fixed, stiffness.young_mpa, stiffness.density_g_cm3, DOWN, held)
    moves = frame.displacements()[: len(fine.knot), :3]
    found = []
    for k, knot in enumerate(knots.knots):
        own, count = fine.knot == k, len(knot.points)
        each = (np.interp(range(count), fine.vertex[own], m, period=count) for m in moves[own].T)
        found.append(np.column_stack(list(each)))
    return np.concatenate(found)


def hold_by_threads(beams: Beams, feet: Indices) -> tuple[Beams, Mask]:
    """Merge the feet that meet at two points, and hold six unknowns there, as many as a rigid body has.

    They carry no force but the threads' upward pull, since a piece whose centre of mass is between and below
    the threads is in balance. Also return which unknowns are held, (6 n,).
    """
    first = beams.joints[feet[0]]
    second = np.linalg.norm(beams.joints[feet] - first, axis=1) > _MEET_MM
    ends = beams.ends.copy()
    two = feet[0], feet[int(second.argmax())]
    for foot, there in zip(feet, second, strict=True):
        ends[ends == foot] = two[int(there)]
    held = np.zeros((len(beams.joints), 6), dtype=bool)
    held[feet] = True  # those that were joined to another have no beams left
    along = beams.joints[two[1]] - beams.joints[two[0]]
    x, z = (0, 2) if abs(along[0]) >= abs(along[2]) else (2, 0)
    # the first does not move, nor turn about the line of both; the second does not move across it
    held[two[0]], held[two[1]] = False, False
    held[two[0], [0, 1, 2, 3 + x]] = True
    held[two[1], [1, z]] = True
    return replace(beams, ends=ends), held.ravel()


def worst_of(moves: Array, points: Array) -> tuple[float, Array]:
    """Return the largest of moves (N, 3), mm, and the point where it occurs (3,)."""
    size = np.linalg.norm(moves, axis=1)
    worst = int(size.argmax())
    return float(size[worst]), points[worst]


# A frame that was solved once, on members that were added since.


def springs_of(some: Candidates, before: Array, stiffness: Stiffness) -> tuple[Array, Array]:
    """Compute what members add to the stiffness at their ends, (m, 12, 12), and to the loads, (m, 12).

    Args:
        before: (m,) mm, the radius that each had before; 0 for a new one.
    """
    springs, loads = _of_bars(some, stiffness)
    springs_then, loads_then = _of_bars(replace(some, radius=before, end_radius=None), stiffness)
    return springs - springs_then, loads - loads_then


def _of_bars(some: Candidates, stiffness: Stiffness) -> tuple[Array, Array]:
    """Compute stiffness and loads of members; the inner joints of tapered ones are condensed."""
    pieces = 1 if some.end_radius is None else PIECES
    m, every = len(some), 6 * (pieces + 1)
    share = np.arange(pieces + 1)[:, None] / pieces
    joints = some.start[:, None] + share * (some.end - some.start)[:, None]
    first = (np.arange(m)[:, None] * (pieces + 1) + np.arange(pieces)).ravel()
    radius = taper(some.radius, some.foot_radius, pieces).ravel()
    ends = np.column_stack([first, first + 1])
    beams = round_beams(joints.reshape(-1, 3), ends, radius, stiffness.wall_mm)
    stiff = stiffness_of(beams, stiffness.young_mpa).reshape(m, pieces, 12, 12)
    weight = loads_of(beams, stiffness.density_g_cm3, DOWN).reshape(m, pieces, 12)
    springs, loads = np.zeros((m, every, every)), np.zeros((m, every))
    for n in range(pieces):
        own = slice(6 * n, 6 * n + 12)
        springs[:, own, own] += stiff[:, n]
        loads[:, own] += weight[:, n]
    inner, ends = np.arange(6, every - 6), np.delete(np.arange(every), slice(6, every - 6))
    there = springs[:, inner[:, None], ends]
    passed = np.linalg.solve(springs[:, inner[:, None], inner], there)
    loads = loads[:, ends] - np.einsum("mie,mi->me", passed, loads[:, inner])
    return springs[:, ends[:, None], ends] - np.swapaxes(there, 1, 2) @ passed, loads


class HeldFrame:
    """A solved frame to which members are added as springs, without solving it again.

    With the frame's flexibility F at the ends of members of stiffness K and own loads f, these move
    by u = (I + F K)⁻¹ (u0 + F f), and all joints by what the members then exert, f - K u (Woodbury
    1950). Posts end at the nearest of the joints `feet` (k,), at `places` (k, 3); without any, nothing moves
    or turns at their ends.
    """

    def __init__(self, frame: SpaceFrame, feet: Indices, places: Array) -> None:
        self.frame, self.joints, self._feet, self._places = frame, frame.joints, feet, places
        self._at_rest = frame.displacements().ravel()
        self._moves: dict[int, Array] = {}  # the flexibility of each joint that was asked for

    def hold(self, members: Candidates, springs: Array, loads: Array) -> None:
        """Hold the frame by only these members: springs (m, 12, 12) and loads (m, 12)."""
        ends = self._ends_of(members).ravel()
        self._forget(ends)
        self._rows, self._by, own = self._moved_by(ends)
        block = np.zeros((12 * len(members), 12 * len(members)))
        for n, spring in enumerate(springs):
            block[12 * n : 12 * n + 12, 12 * n : 12 * n + 12] = spring
        block = block[np.ix_(own, own)]
        among = self._by[:, self._rows]
        self._stiff = np.linalg.solve(np.eye(len(own)) + block @ among, block)
        force = loads.ravel()[own]
        exerted = force - self._stiff @ (among @ force + self._at_rest[self._rows])
        self._now = self._at_rest + exerted @ self._by

    def displacements(self) -> Array:
        """Return joints' moves and turns under the weight of frame and members, (n, 6)."""
        return self._now.reshape(self.joints, 6)

    def response(self, force: Array) -> Array:
        """Return moves and turns (n, 6) under forces and couples (n, 6), without the weight."""
        moved = self.frame.response(force).ravel()
        return (moved - (self._stiff @ moved[self._rows]) @ self._by).reshape(self.joints, 6)

    def displacements_with_each(self, members: Candidates, springs: Array, loads: Array) -> Array:
        """Return displacements and turns with each of these members added alone, (m, n, 6)."""
        moved = np.repeat(self._now[None], len(members), axis=0)
        back = np.zeros((len(members), len(self._rows)))
        for n, ends in enumerate(self._ends_of(members)):
            rows, by, own = self._moved_by(ends)
            met = by[:, self._rows] @ self._stiff
            among = by[:, rows] - met @ self._by[:, rows]
            spring, load = springs[n][np.ix_(own, own)], loads[n][own]
            there = moved[n, rows] + among @ load
            force = load - spring @ np.linalg.solve(np.eye(len(own)) + among @ spring, there)
            moved[n] += force @ by
            back[n] = force @ met
        return (moved - back @ self._by).reshape(len(members), self.joints, 6)

    def _ends_of(self, members: Candidates) -> Indices:
        """Return the joints at the members' ends, (m, 2)."""
        second = members.second.copy()
        post = np.flatnonzero((second == GROUND) & (len(self._feet) > 0))
        if len(post):
            away = np.linalg.norm(members.end[post, None] - self._places, axis=2)
            second[post] = self._feet[away.argmin(axis=1)]
        return np.column_stack([members.first, second])

    def _moved_by(self, ends: Indices) -> tuple[Indices, Array, Indices]:
        """Find the ends' free unknowns (e,), and what a unit load on each of them moves.

        The last value says which of all the ends' unknowns they are, (e,).
        """
        real = ends != GROUND
        new = np.array([j for j in np.unique(ends[real]) if j not in self._moves], dtype=np.int64)
        if len(new):
            found = self.frame.flexibility(new)
            self._moves |= {int(j): found[:, n].T.copy() for n, j in enumerate(new)}
        rows = (6 * ends[real].astype(np.int64)[:, None] + np.arange(6)).ravel()
        by = [np.empty((0, 6 * self.joints)), *(self._moves[j] for j in ends[real].tolist())]
        return rows, np.concatenate(by), np.flatnonzero(np.repeat(real, 6))

    def _forget(self, ends: Indices) -> None:
        """Drop the cached responses to all loads but those on these ends, once there are many."""
        if len(self._moves) > 300:  # joints whose flexibility is kept: some 100 MB of a large piece
            self._moves = {j: self._moves[j] for j in set(ends.tolist()) & set(self._moves)}
