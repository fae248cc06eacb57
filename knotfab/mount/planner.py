"""Members that hold or stiffen a piece: each where it helps most and shows least, till nothing sags much."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.knots import Knots
from knotfab.mount.held_frame import HeldFrame, springs_of
from knotfab.mount.piece_frame import Stiffness, piece_frame
from knotfab.mount.shade import MountShadows
from knotfab.mount.struts import GROUND, Candidates, Sites, Way, join

__all__ = ["PEGS", "Planned", "plan_members"]


TRIED_VISIBLE = 6  # candidates that darken pixels are tried before one is added
LOOKED_AT = 400  # candidates of highest promise among which those are sought
IDLE_ROUNDS = 4  # rounds in which nothing helps, before the search ends
DEAR_SHARE = 1e-5  # a share of the frame: a member that darkens so much must help twice as much
THICKER = 1.15  # factor of a visible member's radius when it is thickened
MOST_SHARE = 0.95  # a member's largest radius over the tube's
SEEN_SHARE = 1e-5  # a share of the frame: a member that darkens more shows
MOST = 100  # members that are added


@dataclass(frozen=True)
class Planned:
    """The members (the given ones first), and the largest displacement (mm) and where (3,) it is.

    `taken` (n,) are the candidates that the members after the given ones were.
    """

    members: Candidates
    taken: Indices
    sag_mm: float
    sag_at: Array


def plan_members(
    knots: Knots,
    sites: Sites,
    way: Way,
    shadows: MountShadows,
    candidates: Candidates,
    visible: Mask,
    given: Candidates,
    stiffness: Stiffness,
    manner: Manner | None = None,
    *,
    settled: bool = False,
) -> Planned:
    """Add members, or thicken those that show, until nothing sags more than allowed (gravity: -y).

    Each step ranks all candidates (`Manner.rank`). The best few that are clear, and every visible member made
    thicker, are then worked out exactly, as springs on the solved frame. In the end those are taken away
    that the limit does not need.

    Args:
        way, shadows: hold the given members already; more are added.
        visible: (n,) which candidates may darken pixels; only these have their cost computed.
        given: hold every knot already; they stay, and where `settled` they are not thickened either.
        manner: how candidates are weighed; `BRACES` by default.
    """
    manner = manner or BRACES
    dear = DEAR_SHARE * max(shadows.pixels, 1.0)
    shown = np.flatnonzero(visible)
    cost = np.zeros(len(candidates))
    cost[shown] = shadows.cost(candidates.of(shown))
    search = _Search(candidates, way, manner.apart_radii * knots.radius_mm)
    piece = _Piece(knots, sites, given, stiffness)
    limit = manner.wanted * stiffness.max_sag_mm
    members, taken = given, list[int]()
    best, least, idle = (members, taken), np.inf, 0
    # the share of the frames that each member alone darkens, summed; none is asked once that is settled
    seen = np.zeros(len(given) if settled else 0)
    while True:
        moved, sag, _ = piece.on(members)
        if sag < least:
            least, best = sag, (members, taken)
        if sag <= limit or len(members) >= len(given) + MOST or idle >= IDLE_ROUNDS:
            break
        promise = manner.rank(piece.frame, sites, candidates, moved, manner.norm)
        promise = promise / (1 + cost / dear)
        for n in range(len(seen), len(members)):
            seen = np.append(seen, shadows.darken(members.of([n])).sum())
        old = np.flatnonzero(seen > SEEN_SHARE)
        thicker = members.of(old).thicken(THICKER, MOST_SHARE * knots.radius_mm)
        clear = np.array([way.clear(thicker.of([i]), but=int(n))[0] for i, n in enumerate(old)])
        use = np.flatnonzero(clear & (thicker.radius > members.radius[old])) if len(old) else old
        old, thicker = old[use], thicker.of(use)
        dark = seen[old] * shadows.pixels
        while idle < IDLE_ROUNDS:
            hidden = search.best(promise, ~visible, manner.tried)
            tried = np.concatenate([hidden, search.best(promise, visible, TRIED_VISIBLE)])
            every = join([candidates.of(tried), thicker])
            before = np.concatenate([np.zeros(len(tried)), members.radius[old]])
            gain = piece.gains(every, before, moved, manner)
            price = np.concatenate(
                [cost[tried], (thicker.radius / before[len(tried) :] - 1) * dark]
            )
            worth = np.where(gain >= manner.least_gain, gain, 0.0) / (1 + price / dear)
            if len(worth) and worth.max() > 0:
                break
            search.spoiled += tried.tolist()
            idle += 1
        else:
            continue
        idle = 0
        pick = int(worth.argmax())
        one = every.of([pick])
        if pick < len(tried):
            taken = [*taken, int(tried[pick])]
            search.blocked[taken[-1]] = True
            way.add(one)
            members = join([members, one])
        else:
            number = int(old[pick - len(tried)])
            members = members.with_radius(number, float(one.radius[0]))
            way.members = members
            seen[number] = shadows.darken(one).sum()
        search.afresh()
        if price[pick] > 0:
            shadows.add(one)
            cost[shown] = shadows.cost(candidates.of(shown))
    thinnest = float(candidates.radius[shown].min()) if len(shown) else np.inf
    members, taken = best
    shown_by = np.array(
        [
            0.0 if settled and n < len(given) else shadows.darken(members.of([n])).sum()
            for n in range(len(members))
        ]
    )
    left, members = _prune(piece, members, shown_by, limit, thinnest)
    _, sag, at = piece.on(members, left)
    return Planned(
        members.of(left), np.array(taken, dtype=np.int64)[left[len(given) :] - len(given)], sag, at
    )


class _Piece:
    """The piece on the given members, solved once, and what it moves on others as well."""

    def __init__(self, knots: Knots, sites: Sites, given: Candidates, stiffness: Stiffness) -> None:
        self.sites, self.given, self.stiffness = sites, given, stiffness
        self.frame = HeldFrame(piece_frame(knots, sites, given, stiffness))

    def on(self, members: Candidates, left: Indices | None = None) -> tuple[Array, float, Array]:
        """(n, 6) how the sites move, how far at most (mm), and where (3,); on those of `left`, or on all."""
        before = np.zeros(len(members))
        before[: len(self.given)] = self.given.radius
        changed = members.radius != before
        if left is not None:
            changed &= np.isin(np.arange(len(members)), left)
        some = members.of(changed)
        self.frame.hold(some, *springs_of(some, before[changed], self.stiffness))
        moved = self.frame.displacements()[: len(self.sites.knot)]
        size = np.linalg.norm(moved[:, :3], axis=1)
        return moved, float(size.max()), self.sites.point[int(size.argmax())]

    def gains(self, tried: Candidates, before: Array, moved: Array, manner: Manner) -> Array:
        """(m,) the share of the displacements' norm that each takes away, of radius `before` till now."""
        springs, loads = springs_of(tried, before, self.stiffness)
        loads *= manner.weighed
        after = self.frame.displacements_with_each(tried, springs, loads)[:, : len(moved), :3]
        return np.asarray(1 - _norm(after, manner.norm) / _norm(moved[:, :3], manner.norm))


class _Search:
    """The candidates that are still open, by the results so far."""

    def __init__(self, candidates: Candidates, way: Way, apart_mm: float) -> None:
        self.candidates, self.way, self.apart = candidates, way, apart_mm
        self.blocked = np.zeros(len(candidates), dtype=bool)  # something is in the way, for good
        self.free = np.zeros(len(candidates), dtype=bool)  # nothing is in the way by now
        self.spoiled: list[
            int
        ] = []  # candidates that help nothing till the members change; nor do their neighbours

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
                self.free[number] = self.way.clear(self.candidates.of([number]))[0]
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

    def afresh(self) -> None:
        """The members have changed."""
        self.free[:] = False
        self.spoiled = []


def _norm(moved: Array, norm: float) -> Array:
    """(...,) the norm of displacements (..., n, 3)."""
    size = np.linalg.norm(moved, axis=-1)
    largest = size.max(axis=-1, keepdims=True)
    found: Array = largest[..., 0] * ((size / largest) ** norm).sum(axis=-1) ** (1 / norm)
    return found


def _promise(
    frame: HeldFrame, sites: Sites, candidates: Candidates, moved: Array, norm: float
) -> Array:
    """(n,) how much a stiff link at each candidate would take from the norm, to first order.

    The product of how far its ends move apart under the weight and how far they do under the norm's
    gradient as a load.
    """
    n = len(sites.knot)
    size = np.linalg.norm(moved[:, :3], axis=1)
    pull = np.zeros((frame.joints, 6))
    pull[:n, :3] = (size / size.max())[:, None] ** (norm - 2) * moved[:, :3] / size.max()
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


def _nearness(
    frame: HeldFrame, sites: Sites, candidates: Candidates, moved: Array, norm: float
) -> Array:
    """(n,) larger where a candidate begins nearer, along its knot, to the site that moves farthest."""
    worst = int(np.linalg.norm(moved[:, :3], axis=1).argmax())
    gap = np.abs(sites.arc[candidates.first] - sites.arc[worst])
    gap = np.minimum(gap, sites.perimeter[sites.knot[worst]] - gap)
    return np.where(sites.knot[candidates.first] == sites.knot[worst], 1 / (1 + gap), 0.0)


@dataclass(frozen=True)
class Manner:
    """How candidates are weighed.

    Attributes:
        rank: those of highest rank are tried first; `tried` of those that show nothing at a time, with
            ends that are `apart_radii` tube radii apart.
        norm: of the displacements, which a member is to lower: a large one is nearly the largest of them, but
            smooth.
        least_gain: the share of it that a member must take away; its own weight counts where `weighed`.
        wanted: the share of the allowed sag at which no more is added.
    """

    rank: Callable[[HeldFrame, Sites, Candidates, Array, float], Array]
    norm: float
    tried: int
    apart_radii: float
    least_gain: float
    weighed: bool
    wanted: float


# a finer model must find what braces bring it to as well
BRACES = Manner(_promise, 12.0, 5, 4.0, 0.01, False, 0.92)
# a peg bends, as no stiff link does; one of many alone hardly lowers the largest displacement
PEGS = Manner(_nearness, 4.0, 32, 0.0, 0.005, True, 1.0)


def _prune(
    piece: _Piece, members: Candidates, dark: Array, limit: float, thinnest_mm: float
) -> tuple[Indices, Candidates]:
    """Which members the limit needs, the given ones among them, and all, those that show made thin.

    Args:
        dark: (n,) the share of the frames, summed, that each member alone darkens.
    """
    needed = max(limit, piece.on(members)[1])
    dearest = np.argsort(-dark, kind="stable")
    left = np.arange(len(members))
    for number in dearest[dearest >= len(piece.given)]:
        without = left[left != number]
        if piece.on(members, without)[1] <= needed:
            left = without
    for number in dearest[dark[dearest] > SEEN_SHARE]:
        while number in left and members.radius[number] / THICKER >= thinnest_mm * (1 - 1e-9):
            thinner = members.with_radius(number, float(members.radius[number]) / THICKER)
            if piece.on(thinner, left)[1] > needed:
                break
            members = thinner
    return left, members
