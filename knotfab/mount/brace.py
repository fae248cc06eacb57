"""Members that stiffen the piece: each where it helps most and shows least, until nothing sags too far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.knots import Knots
from knotfab.mount.frame_model import SpaceFrame, round_beams, stiffness_of
from knotfab.mount.piece_frame import Stiffness, piece_frame
from knotfab.mount.shade import MountShadows
from knotfab.mount.struts import GROUND, Candidates, Obstacles, Sites, join

__all__ = ["Braced", "brace"]


NORM = 12.0  # the norm of the displacements: nearly their largest, but smooth
TRIED = 5  # hidden members that are tried before one is added
TRIED_VISIBLE = 6
LOOKED_AT = 400  # candidates of highest promise among which those are sought
IDLE_ROUNDS = 4  # rounds in which nothing helps, before the search ends
APART_RADII = 4.0  # tube radii between the ends of members that are tried together
DEAR_SHARE = 1e-5  # a share of the frame: a member that darkens so much must help twice as much
LEAST_GAIN = 0.01  # a member must take away at least this share of the displacement
THICKER = 1.15  # factor of a visible member's radius when it is thickened
MOST_SHARE = 0.95  # a member's largest radius over the tube's
SEEN_SHARE = 1e-5  # a share of the frame: a member that darkens more shows
MOST = 100  # members that are added
WANTED = 0.92  # a share of the limit, so that the second model meets it too


@dataclass(frozen=True)
class Braced:
    """The members (the given ones first), and the largest displacement (mm) and where (3,) it is."""

    members: Candidates
    sag_mm: float
    sag_at: Array


def brace(
    knots: Knots,
    sites: Sites,
    obstacles: Obstacles,
    shadows: MountShadows,
    candidates: Candidates,
    visible: Mask,
    given: Candidates,
    stiffness: Stiffness,
    *,
    settled: bool = False,
) -> Braced:
    """Add members, or thicken those that show, until nothing sags more than `max_sag_mm` (gravity: -y).

    Each step ranks all candidates by the derivative of the largest displacement (its `NORM`-norm)
    with respect to a stiff link there: the product of how far its ends move apart under the weight
    and how far they do under the norm's gradient as a load. The best few that are clear, and every
    visible member made thicker, are then worked out exactly, as springs on the solved frame. In the
    end those are taken away that the limit does not need.

    Args:
        obstacles, shadows: hold the given members already; more are added.
        visible: (n,) which candidates may darken pixels; only these have their cost computed.
        given: hold every knot already; they stay, and where `settled` they are not thickened either.
    """
    dear = DEAR_SHARE * shadows.pixels
    shown = np.flatnonzero(visible)
    cost = np.zeros(len(candidates))
    cost[shown] = shadows.cost(candidates.of(shown))
    search = _Search(candidates, obstacles, APART_RADII * knots.radius_mm)
    limit = WANTED * stiffness.max_sag_mm
    members, best = given, given
    least, idle = np.inf, 0
    # the share of the frames that each member alone darkens, summed; none is asked once that is settled
    seen = np.zeros(len(given) if settled else 0)
    while True:
        frame = piece_frame(knots, sites, members, stiffness)
        moved = frame.displacements()[: len(sites.knot)]
        sag = float(np.linalg.norm(moved[:, :3], axis=1).max())
        if sag < least:
            least, best = sag, members
        if sag <= limit or len(members) >= len(given) + MOST or idle >= IDLE_ROUNDS:
            break
        promise = _promise(frame, sites, candidates, moved) / (1 + cost / dear)
        for n in range(len(seen), len(members)):
            seen = np.append(seen, shadows.darken(members.of([n])).sum())
        old = np.flatnonzero(seen > SEEN_SHARE)
        thicker = members.of(old).thicken(THICKER, MOST_SHARE * knots.radius_mm)
        clear = np.array(
            [obstacles.clear(thicker.of([i]), but=int(n))[0] for i, n in enumerate(old)]
        )
        use = np.flatnonzero(clear & (thicker.radius > members.radius[old])) if len(old) else old
        old, thicker = old[use], thicker.of(use)
        dark = seen[old] * shadows.pixels
        while idle < IDLE_ROUNDS:
            hidden = search.best(promise, ~visible, TRIED)
            tried = np.concatenate([hidden, search.best(promise, visible, TRIED_VISIBLE)])
            every = join([candidates.of(tried), thicker])
            before = np.concatenate([np.zeros(len(tried)), members.radius[old]])
            gain = _gains(frame, every, before, moved, stiffness)
            price = np.concatenate(
                [cost[tried], (thicker.radius / before[len(tried) :] - 1) * dark]
            )
            worth = np.where(gain >= LEAST_GAIN, gain, 0.0) / (1 + price / dear)
            if len(worth) and worth.max() > 0:
                break
            search.spoil(tried)
            idle += 1
        else:
            continue
        idle = 0
        pick = int(worth.argmax())
        one = every.of([pick])
        if pick < len(tried):
            search.take(int(tried[pick]))
            obstacles.add(one)
            members = join([members, one])
        else:
            number = int(old[pick - len(tried)])
            members = members.with_radius(number, float(one.radius[0]))
            obstacles.members = members
            seen[number] = shadows.darken(one).sum()
            search.afresh()
        if price[pick] > 0:
            shadows.add(one)
            cost[shown] = shadows.cost(candidates.of(shown))
    thinnest = float(candidates.radius[shown].min()) if len(shown) else np.inf
    shown_by = np.array(
        [
            0.0 if settled and n < len(given) else shadows.darken(best.of([n])).sum()
            for n in range(len(best))
        ]
    )
    return _prune(knots, sites, best, len(given), shown_by, stiffness, limit, thinnest)


class _Search:
    """The candidates that are still open, by the results so far."""

    def __init__(self, candidates: Candidates, obstacles: Obstacles, apart_mm: float) -> None:
        self.candidates, self.obstacles, self.apart = candidates, obstacles, apart_mm
        self.blocked = np.zeros(len(candidates), dtype=bool)  # something is in the way, for good
        self.free = np.zeros(len(candidates), dtype=bool)  # nothing is in the way by now
        self.spoiled: list[int] = []  # members of no use by now, with their neighbours

    def best(self, promise: Array, group: Mask, most: int) -> Indices:
        """Up to `most` clear candidates of a group, of high promise, and well apart."""
        open_ones = np.flatnonzero(group & ~self.blocked & (promise > 0))
        count = min(LOOKED_AT, len(open_ones))
        if not count:
            return np.empty(0, dtype=np.int64)
        order = open_ones[np.argpartition(-promise[open_ones], count - 1)[:count]]
        order = order[np.argsort(-promise[order], kind="stable")]
        found: list[int] = []
        for number in order:
            if self._near(number, found) or self._near(number, self.spoiled):
                continue
            if not self.free[number]:
                self.free[number] = self.obstacles.clear(self.candidates.of([number]))[0]
                self.blocked[number] = not self.free[number]
            if self.free[number]:
                found.append(int(number))
            if len(found) == most:
                break
        return np.array(found, dtype=np.int64)

    def _near(self, number: int, others: list[int]) -> bool:
        c = self.candidates
        start = np.linalg.norm(c.start[others] - c.start[number], axis=1)
        end = np.linalg.norm(c.end[others] - c.end[number], axis=1)
        return bool(((start < self.apart) & (end < self.apart)).any())

    def spoil(self, tried: Indices) -> None:
        """These are of no use, until something is added."""
        self.spoiled += [int(n) for n in tried]

    def take(self, number: int) -> None:
        """This one is a member now."""
        self.blocked[number] = True
        self.afresh()

    def afresh(self) -> None:
        """The members have changed."""
        self.free[:] = False
        self.spoiled = []


def _norm(moved: Array) -> Array:
    """(...,) the `NORM`-norm of displacements (..., n, 3)."""
    size = np.linalg.norm(moved, axis=-1)
    largest = size.max(axis=-1, keepdims=True)
    found: Array = largest[..., 0] * ((size / largest) ** NORM).sum(axis=-1) ** (1 / NORM)
    return found


def _promise(frame: SpaceFrame, sites: Sites, candidates: Candidates, moved: Array) -> Array:
    """(n,) how much a stiff link at each candidate would take from the norm, to first order."""
    n = len(sites.knot)
    size = np.linalg.norm(moved[:, :3], axis=1)
    pull = np.zeros((frame.joints, 6))
    pull[:n, :3] = (size / size.max())[:, None] ** (NORM - 2) * moved[:, :3] / size.max()
    virtual = frame.response(pull)[:n]
    lever = candidates.end - candidates.start
    real = candidates.second != GROUND
    apart = []
    for u in (moved, virtual):
        there = np.where(real[:, None], u[candidates.second, :3], 0.0)
        here = u[candidates.first]
        apart.append(there - here[:, :3] - np.cross(here[:, 3:], lever))
    promise: Array = np.einsum("ij,ij->i", apart[0], apart[1])
    return promise


def _gains(
    frame: SpaceFrame, tried: Candidates, before: Array, moved: Array, stiffness: Stiffness
) -> Array:
    """(n,) the share of the norm that each member would take away, its own weight left out.

    A member of stiffness K between joints that moved by u, of flexibility F, leaves them at
    (I + F K)⁻¹ u and pushes with -K times that. For one that is there, with radius `before` (n,),
    K is what it gains; 0 for a new one.
    """
    if not len(tried):
        return np.empty(0)
    n = len(moved)
    joints, inverse = np.unique(np.concatenate([tried.first, tried.second]), return_inverse=True)
    grounded = joints == GROUND
    flexibility = np.zeros((frame.joints, 6, len(joints), 6))
    real = frame.flexibility(joints[~grounded])
    flexibility[:, :, ~grounded] = real.reshape(frame.joints, 6, -1, 6)
    flexibility = flexibility[:n]
    m = len(tried)
    ends_of = np.column_stack([np.arange(m), m + np.arange(m)])
    springs = np.zeros((m, 12, 12))
    for radius, sign in ((tried.radius, 1.0), (before, -1.0)):
        beams = round_beams(np.concatenate([tried.start, tried.end]), ends_of, radius)
        springs += sign * stiffness_of(beams, stiffness.young_mpa)
    norm = float(_norm(moved[:, :3]))
    gains = np.zeros(m)
    for i in range(m):
        a, b = int(inverse[i]), int(inverse[m + i])
        ends = [int(tried.first[i]), int(tried.second[i])]
        u, f = np.zeros(12), np.zeros((12, 12))
        columns = np.concatenate([flexibility[:, :, a], flexibility[:, :, b]], axis=2)
        for side, joint in enumerate(ends):
            if joint != GROUND:
                rows = slice(6 * side, 6 * side + 6)
                u[rows], f[rows] = moved[joint], columns[joint]
        left = np.linalg.solve(np.eye(12) + f @ springs[i], u)
        after = moved[:, :3] - columns[:, :3] @ (springs[i] @ left)
        gains[i] = 1 - float(_norm(after)) / norm
    return gains


def _prune(
    knots: Knots,
    sites: Sites,
    members: Candidates,
    given: int,
    dark: Array,
    stiffness: Stiffness,
    limit: float,
    thinnest_mm: float,
) -> Braced:
    """Take away added members that the limit does not need, and thin those that show.

    Args:
        dark: (n,) the share of the frames, summed, that each member alone darkens.
    """

    def solve(some: Candidates) -> tuple[float, Array]:
        frame = piece_frame(knots, sites, some, stiffness)
        size = np.linalg.norm(frame.displacements()[: len(sites.knot), :3], axis=1)
        return float(size.max()), sites.point[int(size.argmax())]

    sag, at = solve(members)
    needed = max(limit, sag)
    dearest = np.argsort(-dark, kind="stable")
    left = np.arange(len(members))
    for number in dearest[dearest >= given]:
        without = left[left != number]
        found = solve(members.of(without))
        if found[0] <= needed:
            left, (sag, at) = without, found
    for number in dearest[dark[dearest] > SEEN_SHARE]:
        while number in left and members.radius[number] / THICKER >= thinnest_mm * (1 - 1e-9):
            thinner = members.with_radius(number, float(members.radius[number]) / THICKER)
            found = solve(thinner.of(left))
            if found[0] > needed:
                break
            members, (sag, at) = thinner, found
    return Braced(members.of(left), sag, at)
