"""A piece as a frame under its own weight: its tubes, and the members that hold or stiffen them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.effects.shifts import allow_sag_mm
from knotfab.hold.struts import GROUND, Candidates, Sites, sites_of
from knotfab.knots import Knots
from knotfab_formats.scene import SettledScene

JOINT_RADII = 2.0  # distance of the joints along a tube, in tube radii
PIECES = 4  # pieces of a tapering member, each taken as round
DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Stiffness:
    """The piece's material, and how far it may sag: MPa, g/cm³, mm."""

    young_mpa: float
    density_g_cm3: float
    max_sag_mm: float

    @classmethod
    def of(cls, scene: SettledScene, knots: Knots) -> Stiffness:
        """Read a scene's material, and how far its mount may let these knots sag."""
        material, most = scene.material, scene.mount.max_sag_mm
        if most is None:
            points = np.concatenate([knot.points for knot in knots.knots])
            most = allow_sag_mm(scene.views, points, knots.radius_mm)
        return cls(material.young_modulus_mpa, material.density_g_cm3, most)


def taper(top: Array, foot: Array, pieces: int = PIECES) -> Array:
    """Cut cones into round pieces: their radii (..., pieces) from tops to feet (...,)."""
    share = (np.arange(pieces) + 0.5) / pieces
    return np.asarray(top[..., None] + share * (foot - top)[..., None])


def piece_beams(
    radius_mm: float, sites: Sites, members: Candidates, pieces: int = 1
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
    )
    return beams, feet


def piece_frame(
    knots: Knots, sites: Sites, members: Candidates, stiffness: Stiffness
) -> SpaceFrame:
    """Assemble the frame of a piece with joints at the sites and along members that taper."""
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
    """Compute how far each vertex moves on the members, mm (N, 3), by a frame of its own.

    Its joints are `step_radii` tube radii apart and wherever a member ends, and members are cut in
    pieces: a second opinion where members were chosen by a coarser frame. Moves are interpolated
    between joints by the vertices' numbers.

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
    """Return the largest of moves (N, 3), mm, and the point where it occurs (3,)."""
    size = np.linalg.norm(moves, axis=1)
    worst = int(size.argmax())
    return float(size[worst]), points[worst]


# A frame that was solved once, on members that were added since.


def springs_of(some: Candidates, before: Array, stiffness: Stiffness) -> tuple[Array, Array]:
    """Compute members' stiffness at their ends, (m, 12, 12), and loads by their weight, (m, 12).

    Args:
        before: (m,) mm, the radius that each had; 0 where it was not there.
    """
    springs, loads = _of_bars(some, stiffness)
    springs_then, loads_then = _of_bars(replace(some, radius=before, end_radius=None), stiffness)
    return springs - springs_then, loads - loads_then


def _of_bars(some: Candidates, stiffness: Stiffness) -> tuple[Array, Array]:
    """Compute stiffness and loads of members; of a tapered one its inner joints are condensed."""
    pieces = 1 if some.end_radius is None else PIECES
    m, every = len(some), 6 * (pieces + 1)
    share = np.arange(pieces + 1)[:, None] / pieces
    joints = some.start[:, None] + share * (some.end - some.start)[:, None]
    first = (np.arange(m)[:, None] * (pieces + 1) + np.arange(pieces)).ravel()
    radius = taper(some.radius, some.foot_radius, pieces).ravel()
    beams = round_beams(joints.reshape(-1, 3), np.column_stack([first, first + 1]), radius)
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
    1950).
    """

    def __init__(self, frame: SpaceFrame) -> None:
        self.frame, self.joints = frame, frame.joints
        self._at_rest = frame.displacements().ravel()
        self._moves: dict[int, Array] = {}  # the flexibility of each joint that was asked for

    def hold(self, members: Candidates, springs: Array, loads: Array) -> None:
        """Hold the frame by these members alone: springs (m, 12, 12) and loads (m, 12)."""
        ends = np.column_stack([members.first, members.second]).ravel()
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
        for n in range(len(members)):
            rows, by, own = self._moved_by(np.array([members.first[n], members.second[n]]))
            met = by[:, self._rows] @ self._stiff
            among = by[:, rows] - met @ self._by[:, rows]
            spring, load = springs[n][np.ix_(own, own)], loads[n][own]
            there = moved[n, rows] + among @ load
            force = load - spring @ np.linalg.solve(np.eye(len(own)) + among @ spring, there)
            moved[n] += force @ by
            back[n] = force @ met
        return (moved - back @ self._by).reshape(len(members), self.joints, 6)

    def _moved_by(self, ends: Indices) -> tuple[Indices, Array, Indices]:
        """Find the ends' free unknowns (e,), and what a unit load on each of them moves.

        Returned last: which of all the ends' unknowns they are, (e,).
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


# A space frame of straight beams under its own weight: how far each joint moves.


GRAVITY_M_S2 = 9.81
POISSON = 0.35  # Poisson's ratio of filament plastics; it enters through the twist alone


@dataclass(frozen=True)
class Beams:
    """Euler-Bernoulli beams of one material between joints.

    Attributes:
        joints: (n, 3) mm. ends: (m, 2) joints of each beam.
        area: (m,) mm². inertia: (m,) second moment of area, mm⁴, the same about every axis of the
            section (round or square). twist: (m,) torsion constant, mm⁴.
    """

    joints: Array
    ends: Indices
    area: Array
    inertia: Array
    twist: Array


def round_beams(joints: Array, ends: Indices, radius: Array) -> Beams:
    """Make beams of round section, `radius` (m,) mm."""
    area = np.pi * radius**2
    return Beams(joints, ends, area, np.pi / 4 * radius**4, np.pi / 2 * radius**4)


@dataclass(frozen=True)
class SpaceFrame:
    """A frame with its stiffness factored: forces in, displacements and turns out.

    Each joint has six unknowns: three displacements in mm, three turns in radians. `loose` numbers
    the free ones, `weight` (6 n,) is the frame's own load.
    """

    joints: int
    loose: Indices
    weight: Array
    factor: Any

    def displacements(self) -> Array:
        """Return the joints' displacements and turns under the frame's own weight, (n, 6)."""
        return self._solve(self.weight[:, None]).reshape(self.joints, 6)

    def flexibility(self, joints: Indices) -> Array:
        """Return all moves for a unit force or couple on each of c joints, (6 n, c, 6)."""
        unit = np.zeros((6 * self.joints, len(joints), 6))
        for number, joint in enumerate(joints):
            unit[6 * joint + np.arange(6), number, np.arange(6)] = 1.0
        solved = self._solve(unit.reshape(6 * self.joints, -1))
        moves: Array = solved.reshape(6 * self.joints, len(joints), 6)
        return moves

    def response(self, force: Array) -> Array:
        """Return moves and turns (n, 6) under forces and couples (n, 6), without the weight."""
        return self._solve(force.reshape(-1, 1)).reshape(self.joints, 6)

    def _solve(self, force: Array) -> Array:
        moved = np.zeros_like(force)
        moved[self.loose] = self.factor.solve(np.ascontiguousarray(force[self.loose]))
        return moved


def frame_of(
    beams: Beams, fixed: Indices, young_mpa: float, density_g_cm3: float, down: Array
) -> SpaceFrame:
    """Assemble and factor the frame of these beams, loaded by their own weight.

    The direct stiffness method with 12 x 12 element matrices and consistent loads (Przemieniecki,
    "Theory of Matrix Structural Analysis", 1968, ch. 5): exact at the joints for small
    displacements of slender beams, however long they are. Shear is left out.

    Args:
        fixed: joints that neither move nor turn. down: (3,) unit vector of gravity.

    Raises:
        ValueError: something is not held (the stiffness is singular), or a beam has no length.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    n = len(beams.joints)
    if not (_lengths_and_axes(beams)[0] > 0).all():
        raise ValueError("a beam has no length")
    load = loads_of(beams, density_g_cm3, down)
    freedom = (6 * beams.ends[:, :, None] + np.arange(6)).reshape(len(load), 12)
    force = np.zeros(6 * n)
    np.add.at(force, freedom.ravel(), load.ravel())
    rows, columns = np.repeat(freedom, 12, axis=1).ravel(), np.tile(freedom, (1, 12)).ravel()
    values = stiffness_of(beams, young_mpa).ravel()
    held = np.zeros(6 * n, dtype=bool)
    held[(6 * np.asarray(fixed, dtype=np.int64)[:, None] + np.arange(6)).ravel()] = True
    if not held.any():
        raise ValueError("nothing is held")
    matrix = coo_matrix((values, (rows, columns)), shape=(6 * n, 6 * n)).tocsc()
    loose = np.flatnonzero(~held)
    try:
        factor = splu(matrix[loose][:, loose], permc_spec="MMD_AT_PLUS_A")
    except RuntimeError as error:
        raise ValueError("a joint is not held") from error
    return SpaceFrame(n, loose, force, factor)


def stiffness_of(beams: Beams, young_mpa: float) -> Array:
    """Return stiffness matrices in common axes, for six unknowns of each end, (m, 12, 12)."""
    length, axes = _lengths_and_axes(beams)
    turn = _turns(axes)
    found: Array = np.swapaxes(turn, 1, 2) @ _stiffness(beams, length, young_mpa) @ turn
    return found


def _turns(axes: Array) -> Array:
    """Return rotations from common axes to the beams' (m, 3, 3), for both ends: (m, 12, 12)."""
    turn = np.zeros((len(axes), 12, 12))
    for block in range(4):
        turn[:, 3 * block : 3 * block + 3, 3 * block : 3 * block + 3] = axes
    return turn


def _lengths_and_axes(beams: Beams) -> tuple[Array, Array]:
    """Return the beams' lengths (m,), mm, and axes (m, 3, 3) in rows: along, and two across."""
    along = beams.joints[beams.ends[:, 1]] - beams.joints[beams.ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, 1e-300)[:, None]
    helper = np.zeros_like(unit)
    helper[np.arange(len(unit)), np.abs(unit).argmin(axis=1)] = 1.0
    second = np.cross(unit, helper)
    second /= np.maximum(np.linalg.norm(second, axis=1), 1e-300)[:, None]
    return length, np.stack([unit, second, np.cross(unit, second)], axis=1)


def _stiffness(beams: Beams, length: Array, young: float) -> Array:
    """Return the element matrices in the beams' own axes, (m, 12, 12)."""
    shear = young / (2 * (1 + POISSON))
    k = np.zeros((len(length), 12, 12))
    stretch, twist = young * beams.area / length, shear * beams.twist / length
    for i, j, sign in ((0, 0, 1), (6, 6, 1), (0, 6, -1), (6, 0, -1)):
        k[:, i, j] = sign * stretch
        k[:, i + 3, j + 3] = sign * twist
    bend = young * beams.inertia
    for move, rotate, s in ((1, 5, 1.0), (2, 4, -1.0)):
        a, b = 12 * bend / length**3, s * 6 * bend / length**2
        c, d = 4 * bend / length, 2 * bend / length
        at = [move, rotate, move + 6, rotate + 6]
        block = [[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]]
        for p, row in enumerate(block):
            for q, value in enumerate(row):
                k[:, at[p], at[q]] = value
    return k


def loads_of(beams: Beams, density_g_cm3: float, down: Array) -> Array:
    """Return the consistent loads of the beams' weight at their ends, in common axes, (m, 12)."""
    length, axes = _lengths_and_axes(beams)
    weight = beams.area * density_g_cm3 * 1e-6 * GRAVITY_M_S2  # N/mm
    q = axes @ down * weight[:, None]  # (m, 3) along the beams' own axes
    f = np.zeros((len(length), 12))
    for axis in range(3):
        f[:, axis] = f[:, axis + 6] = q[:, axis] * length / 2
    f[:, 5] = q[:, 1] * length**2 / 12
    f[:, 11] = -f[:, 5]
    f[:, 4] = -q[:, 2] * length**2 / 12
    f[:, 10] = -f[:, 4]
    loads: Array = np.einsum("mij,mi->mj", _turns(axes), f)
    return loads
