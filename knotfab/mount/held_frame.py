"""A frame that was solved once, on members that were added since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.mount.frame_model import SpaceFrame, loads_of, round_beams, stiffness_of
from knotfab.mount.piece_frame import DOWN, PIECES, Stiffness, taper
from knotfab.mount.struts import GROUND, Candidates

__all__ = ["HeldFrame", "springs_of"]


def springs_of(some: Candidates, before: Array, stiffness: Stiffness) -> tuple[Array, Array]:
    """Return (m, 12, 12) what members add to the stiffness at their ends, (m, 12) their weight's loads there.

    Args:
        before: (m,) mm, the radius that each had; 0 where it was not there.
    """
    springs, loads = _of_bars(some, stiffness)
    springs_then, loads_then = _of_bars(replace(some, radius=before, end_radius=None), stiffness)
    return springs - springs_then, loads - loads_then


def _of_bars(some: Candidates, stiffness: Stiffness) -> tuple[Array, Array]:
    """Give stiffness and loads of members; those that taper are chains, whose inner joints are worked out."""
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
    """The answers of a frame whose joints further members hold as springs, without solving it anew.

    With the frame's flexibility F at the ends of members of stiffness K and own loads f, these move
    by u = (I + F K)⁻¹ (u0 + F f), and all joints by what the members then exert, f - K u (Woodbury 1950).
    """

    def __init__(self, frame: SpaceFrame) -> None:
        self.frame, self.joints = frame, frame.joints
        self._at_rest = frame.displacements().ravel()
        self._moves: dict[int, Array] = {}  # the flexibility of each joint that was asked for

    def hold(self, members: Candidates, springs: Array, loads: Array) -> None:
        """Be held by these members alone: springs (m, 12, 12) and loads (m, 12) at their ends."""
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
        """Return (n, 6) displacements and turns of the joints under the weight of frame and members."""
        return self._now.reshape(self.joints, 6)

    def response(self, force: Array) -> Array:
        """Return (n, 6) displacements and turns under forces and couples (n, 6) instead of the weight."""
        moved = self.frame.response(force).ravel()
        return (moved - (self._stiff @ moved[self._rows]) @ self._by).reshape(self.joints, 6)

    def displacements_with_each(self, members: Candidates, springs: Array, loads: Array) -> Array:
        """Return (m, n, 6) displacements and turns with each one of these members besides."""
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
        """Return the unknowns (e,) of ends that the ground does not hold, and what a unit load on each moves.

        And which of all ends' unknowns they are, (e,).
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
        """Keep what loads on these ends move, where much else is known."""
        if len(self._moves) > 300:  # joints whose flexibility is kept: some 100 MB of a large piece
            self._moves = {j: self._moves[j] for j in set(ends.tolist()) & set(self._moves)}
