"""Choose members where they help most and show least, until nothing of the piece sags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.hold.beams import HeldFrame, Hold, Holder, Stiffness, piece_frame, springs_of
from knotfab.hold.shade import MountShadows
from knotfab.hold.struts import GROUND, Candidates, Sites, Way, join_members
from knotfab.knots import Knots

THICKER = 1.15  # factor of a visible member's radius when it is thickened
MOST_SHARE = 0.95  # a member's largest radius over the tube's
SEEN_SHARE = 1e-5  # a share of the frame: a member that darkens more shows
MOST = 100  # members that are added


@dataclass(frozen=True, kw_only=True)
class MemberHolder(Holder):
    """A holder made of members.

    `holds` (n,) names the knot that each member was added for; posts lead to the ground, their `second`.
    `predicted_intrusion` (views,) is the share of each frame that is darkened outside picture and knots.
    """

    members: Candidates
    holds: Indices
    predicted_intrusion: Array

    @property
    def posts(self) -> Candidates:
        return self.members.take(self.members.second == GROUND)

    @property
    def struts(self) -> Candidates:
        return self.members.take(self.members.second != GROUND)


@dataclass(frozen=True)
class Planned:
    """The members, given ones first, and the largest displacement (mm) and where it is (3,).

    `taken` (n,) are the candidates that became members, in the order in which they follow the given
    ones.
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
    begun: Sequence[int] = (),
    hold: Hold | None = None,
    swing: Callable[[Array], Array] = lambda moved: moved,
) -> Planned:
    """Add members, or thicken those that show, until nothing sags more than allowed (gravity: -y).

    Each step ranks all candidates (`Manner.rank`). The best few that are clear, and every visible
    member made thicker, are then worked out exactly, as springs on the solved frame. In the end
    members that the limit does not need are taken away.

    Args:
        way, shadows: hold the given members already, those first that are in the way; more are added.
        visible: (n,) which candidates may darken pixels; only these have their cost computed.
        given: hold every knot already; they stay, and where `settled` they are not thickened
            either.
        manner: how candidates are weighed; `BRACES` by default.
        begun: candidates to begin with, those that are clear; `taken` of an earlier plan, say.
        hold: as for `sag_moves`. swing: makes of the sites' moves and turns (..., n, 6) those that count.
    """
    manner = manner or BRACES
    piece = _Piece(
        sites, given, stiffness, piece_frame(knots, sites, given, stiffness, hold), swing
    )
    search = _Search(candidates, way, manner.apart_radii * knots.radius_mm)
    unasked = np.zeros(len(given) if settled else 0)  # what settled members darken matters no more
    most_mm = MOST_SHARE * knots.radius_mm
    plan = _Plan(way, shadows, candidates, visible, manner, given, unasked, search, most_mm)
    plan.begin(begun)
    limit = manner.wanted * stiffness.max_sag_mm
    best, least = (given, plan.taken), np.inf
    while True:
        moved, sag, _ = piece.deflect(plan.members)
        if sag < least:
            least, best = sag, (plan.members, plan.taken)
        if sag <= limit or len(plan.members) >= len(given) + MOST:
            break
        change = plan.find_change(piece, moved)
        if change is None:
            break
        plan.make(change)
    members, taken = best
    thinnest = float(candidates.radius[visible].min(initial=np.inf))
    left, members = _prune(piece, members, plan.seen_of(members, unasked), limit, thinnest)
    _, sag, at = piece.deflect(members, left)
    new = left[len(given) :] - len(given)
    return Planned(members.take(left), np.array(taken, dtype=np.int64)[new], sag, at)


@dataclass(frozen=True)
class _Change:
    """A candidate to add, or a member to thicken: its number, and the member that results."""

    number: int
    added: bool
    member: Candidates
    pixels: float  # that the change darkens


@dataclass
class _Plan:
    """The members so far, the candidates that became members, and what all of these darken."""

    way: Way
    shadows: MountShadows
    candidates: Candidates
    visible: Mask
    manner: Manner
    members: Candidates
    seen: Array  # what each of the first members alone darkens, as `seen_of` says
    search: _Search
    most_mm: float  # no member is made thicker than this radius
    taken: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        # a share of the frame: a member that darkens so much must help twice as much
        self.dear = 1e-5 * max(self.shadows.pixels, 1.0)
        self.given = len(self.members)
        self.others = len(self.way.members) - self.given
        self.shown = np.flatnonzero(self.visible)
        self.cost = np.zeros(len(self.candidates))
        self.cost[self.shown] = self.shadows.cost(self.candidates.take(self.shown))

    def seen_of(self, members: Candidates, known: Array) -> Array:
        """Return the summed share of frames that each member darkens, (n,); `known` come first."""
        asked = range(len(known), len(members))
        return np.append(known, [self.shadows.darken(members.take([n])).sum() for n in asked])

    def begin(self, numbers: Sequence[int]) -> None:
        """Add these candidates, but for those that something is in the way of."""
        for number in numbers:
            one = self.candidates.take([number])
            if self.way.clear(one)[0]:
                self.make(_Change(int(number), True, one, float(self.cost[number])))

    def find_change(self, piece: _Piece, moved: Array) -> _Change | None:
        """Find the change that helps most for its price; None if none helps."""
        manner, search = self.manner, self.search
        promise = manner.rank(piece.frame, piece.sites, self.candidates, moved, manner.norm)
        promise = promise / (1 + self.cost / self.dear)
        old, thicker, dearer = self._thicker()
        for _ in range(4):  # times that nothing helps, one after another, before the search ends
            hidden = search.best(promise, ~self.visible, manner.tried)
            # some candidates that darken pixels are tried before one is added
            tried = np.append(hidden, search.best(promise, self.visible, 6))
            every = join_members([self.candidates.take(tried), thicker])
            before = np.append(np.zeros(len(tried)), self.members.radius[old])
            price = np.append(self.cost[tried], dearer)
            gain = piece.gains(every, before, moved, manner)
            worth = np.where(gain >= manner.least_gain, gain, 0.0) / (1 + price / self.dear)
            if len(worth) and worth.max() > 0:
                pick = int(worth.argmax())
                number = int(np.append(tried, old)[pick])
                return _Change(number, pick < len(tried), every.take([pick]), float(price[pick]))
            search.spoiled += tried.tolist()
        return None

    def _thicker(self) -> tuple[Indices, Candidates, Array]:
        """Thicken members that show and have room; return their numbers, themselves, and prices in pixels."""
        self.seen = self.seen_of(self.members, self.seen)
        old = np.flatnonzero(self.seen > SEEN_SHARE)
        thicker = self.members.take(old).thicken(THICKER, self.most_mm)
        room = [
            self.way.clear(thicker.take([i]), but=self._in_way(int(n)))[0]
            for i, n in enumerate(old)
        ]
        use = np.array(room, dtype=bool) & (thicker.radius > self.members.radius[old])
        old, thicker = old[use], thicker.take(use)
        more = thicker.radius / self.members.radius[old] - 1
        return old, thicker, more * (self.seen[old] * self.shadows.pixels)

    def _in_way(self, number: int) -> int:
        """Return a member's number in the way, which has its other bodies after the given members."""
        return number + (self.others if number >= self.given else 0)

    def make(self, change: _Change) -> None:
        """Add the candidate, or thicken the member; pixels that it darkens cost nothing from now on."""
        one, number = change.member, change.number
        if change.added:
            self.taken = [*self.taken, number]
            self.search.blocked[number] = True
            self.way.add(one)
            self.members = join_members([self.members, one])
        else:
            self.members = self.members.with_radius(number, float(one.radius[0]))
            self.way.members = self.way.members.with_radius(
                self._in_way(number), float(one.radius[0])
            )
            self.seen[number] = self.shadows.darken(one).sum()
        self.search.afresh()
        if change.pixels > 0:
            self.shadows.add(one)
            self.cost[self.shown] = self.shadows.cost(self.candidates.take(self.shown))


@dataclass(frozen=True)
class _Piece:
    """The piece on the given members, solved once, to which others are added as springs."""

    sites: Sites
    given: Candidates
    stiffness: Stiffness
    frame: HeldFrame
    swing: Callable[[Array], Array]

    def deflect(
        self, members: Candidates, left: Indices | None = None
    ) -> tuple[Array, float, Array]:
        """Return how the sites move, (n, 6), the largest displacement, mm, and its place (3,).

        All `members` hold the piece, or only those numbered in `left` beside the given ones."""
        before = np.zeros(len(members))
        before[: len(self.given)] = self.given.radius
        changed = members.radius != before
        if left is not None:
            changed &= np.isin(np.arange(len(members)), left)
        some = members.take(changed)
        self.frame.hold(some, *springs_of(some, before[changed], self.stiffness))
        moved = self.swing(self.frame.displacements()[: len(self.sites.knot)])
        size = np.linalg.norm(moved[:, :3], axis=1)
        return moved, float(size.max()), self.sites.point[int(size.argmax())]

    def gains(self, tried: Candidates, before: Array, moved: Array, manner: Manner) -> Array:
        """Return by what share each member alone, thicker than `before`, lowers the norm, (m,)."""
        springs, loads = springs_of(tried, before, self.stiffness)
        loads *= manner.weighed
        after = self.frame.displacements_with_each(tried, springs, loads)[:, : len(moved)]
        norms = _norm(self.swing(after)[..., :3], manner.norm)
        return np.asarray(1 - norms / _norm(moved[:, :3], manner.norm))


class _Search:
    """What trials have told of the candidates: which are blocked, free now, or of no help now."""

    def __init__(self, candidates: Candidates, way: Way, apart_mm: float) -> None:
        self.candidates, self.way, self.apart = candidates, way, apart_mm
        self.blocked = np.zeros(len(candidates), dtype=bool)  # something is in the way, for good
        self.free = np.zeros(len(candidates), dtype=bool)  # nothing is in the way by now
        # candidates that help nothing till the members change; nor do their neighbours
        self.spoiled: list[int] = []

    def best(self, promise: Array, group: Mask, most: int) -> Indices:
        """Pick up to `most` clear candidates of a group, of high promise and well apart."""
        open_ones = np.flatnonzero(group & ~self.blocked & (promise > 0))
        # candidates of highest promise among which those are sought
        count = min(400, len(open_ones))
        if not count:
            return np.empty(0, dtype=np.int64)
        order = open_ones[np.argpartition(-promise[open_ones], count - 1)[:count]]
        order = order[np.argsort(-promise[order], kind="stable")]
        found: list[int] = []
        for number in order:
            if self._has_neighbour(number, found) or self._has_neighbour(number, self.spoiled):
                continue
            if not self.free[number]:
                self.free[number] = self.way.clear(self.candidates.take([number]))[0]
                self.blocked[number] = not self.free[number]
            if self.free[number]:
                found.append(int(number))
            if len(found) == most:
                break
        return np.array(found, dtype=np.int64)

    def _has_neighbour(self, number: int, others: list[int]) -> bool:
        c = self.candidates
        start = np.linalg.norm(c.start[others] - c.start[number], axis=1)
        end = np.linalg.norm(c.end[others] - c.end[number], axis=1)
        return bool(((start < self.apart) & (end < self.apart)).any())

    def afresh(self) -> None:
        """Forget which candidates were free or no help, since the members have changed."""
        self.free[:] = False
        self.spoiled = []


def _norm(moved: Array, norm: float) -> Array:
    """Return the p-norm of the sizes of displacements (..., n, 3), with p = `norm`."""
    size = np.linalg.norm(moved, axis=-1)
    largest = size.max(axis=-1, keepdims=True)
    return np.asarray(largest[..., 0] * ((size / largest) ** norm).sum(axis=-1) ** (1 / norm))


def _promise(
    frame: HeldFrame, sites: Sites, candidates: Candidates, moved: Array, norm: float
) -> Array:
    """Estimate to first order how much a stiff link at each candidate would lower the norm, (n,).

    That is the product of how far its ends move apart under the weight, and how far they would under the
    norm's gradient as a load.
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
    return np.asarray(np.einsum("ij,ij->i", apart[0], apart[1]))


def _nearness(
    frame: HeldFrame, sites: Sites, candidates: Candidates, moved: Array, norm: float
) -> Array:
    """Rank candidates by how near along its knot each is to the site that moves most, (n,)."""
    worst = int(np.linalg.norm(moved[:, :3], axis=1).argmax())
    gap = np.abs(sites.arc[candidates.first] - sites.arc[worst])
    gap = np.minimum(gap, sites.perimeter[sites.knot[worst]] - gap)
    return np.where(sites.knot[candidates.first] == sites.knot[worst], 1 / (1 + gap), 0.0)


@dataclass(frozen=True)
class Manner:
    """How candidates are weighed.

    Attributes:
        rank: ranks candidates; those of highest rank are tried first. Of those that show nothing, `tried` are
            tried at a time, with ends at least `apart_radii` tube radii apart.
        norm: the p of the displacements' p-norm, which members are to lower; for a large p it is a smooth
            version of the largest displacement.
        least_gain: the least share by which a member must lower it. `weighed`: whether its weight counts.
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
    """Remove the members that the limit does not need, and thin those that show.

    Return the numbers of those that stay, the given ones included, and these members themselves.

    Args:
        dark: (n,) the share of the frames, summed, that each member alone darkens.
    """
    needed = max(limit, piece.deflect(members)[1])
    dearest = np.argsort(-dark, kind="stable")
    left = np.arange(len(members))
    for number in dearest[dearest >= len(piece.given)]:
        without = left[left != number]
        if piece.deflect(members, without)[1] <= needed:
            left = without
    for number in dearest[dark[dearest] > SEEN_SHARE]:
        while number in left and members.radius[number] / THICKER >= thinnest_mm * (1 - 1e-9):
            thinner = members.with_radius(number, float(members.radius[number]) / THICKER)
            if piece.deflect(thinner, left)[1] > needed:
                break
            members = thinner
    return left, members
