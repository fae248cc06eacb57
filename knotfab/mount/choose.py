"""Choose as few pegs as keep every knot from sagging: add them where they help most, take idle ones away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.knots import Knots
from knotfab.mount.frame_model import frame_of, round_beams
from knotfab.mount.piece_frame import DOWN, JOINT_RADII, PIECES, Stiffness, piece_beams, taper
from knotfab.mount.rays import Rays
from knotfab.mount.struts import nothing, sites_of

__all__ = ["Pegs", "choose_pegs"]


APART_RADII = 4.0  # between the middles of two feet, so that each keeps its fillet
CANDIDATES = 192  # rays of one knot: in each stretch of its length the shortest free one
TRIED = 32  # candidates when a peg is added: those nearest to where it sags most
MOST = 60  # pegs of one knot
STUCK = 4  # pegs in a row that hardly help
# Of the displacements whose sum a further peg is to lower; the largest alone may stay the same
# wherever one peg is put.
POWER = 4


@dataclass(frozen=True)
class Pegs:
    """Chosen pegs, as numbers of rays, and the largest displacement (mm) with them, and where (3,).

    `barred` are the knots from which no ray to the wall is free: without a peg, and not in the displacement.
    """

    rays: Indices
    sag_mm: float
    sag_at: Array
    barred: tuple[int, ...] = ()


def choose_pegs(
    knots: Knots,
    rays: Rays,
    top_radius_mm: Array,
    foot_radius_mm: Array,
    stiffness: Stiffness,
) -> Pegs:
    """Choose rays for pegs until no point of any knot sags more than `max_sag_mm` (gravity: -y).

    Each knot starts with one peg. Then the peg is added that leaves the least sag, and in the end
    those are taken away that the limit does not need. Where no free ray is left, or a knot has
    `MOST`, the sag is what it is: the caller compares.

    Args:
        knots: in scene coordinates, those that `rays` belong to.
        top_radius_mm, foot_radius_mm: (n,) of a peg along each ray, at the tube and at the wall.

    Raises:
        ValueError: no knot has a free ray.
    """
    chosen: list[int] = []
    barred: list[int] = []
    worst, at = 0.0, knots.points[0]
    for k in range(len(knots.knots)):
        own = np.flatnonzero(rays.free & (rays.knot == k))
        if not len(own):
            barred.append(k)
            continue
        apart = _apart(rays, own, chosen, knots.radius_mm)
        model = _Model(
            knots, rays, k, apart if len(apart) else own, top_radius_mm, foot_radius_mm, stiffness
        )
        pegs, sag, place = _of_knot(model, rays, chosen, knots.radius_mm, stiffness)
        chosen += pegs
        if sag >= worst:
            worst, at = sag, place
    if not chosen:
        raise ValueError("no light ray from any knot to the wall is free for a peg")
    return Pegs(np.array(chosen, dtype=np.int64), worst, at, tuple(barred))


def _of_knot(
    model: _Model, rays: Rays, others: list[int], radius: float, stiffness: Stiffness
) -> tuple[list[int], float, Array]:
    """Pegs of one knot, its sag and where it is."""
    pegs = [0]  # numbers of the model's candidates; the first always stays
    now = model.sag(pegs)
    history = [now.all_mm]
    while now.sag_mm > stiffness.max_sag_mm and len(pegs) < MOST:
        if len(history) > STUCK and now.all_mm > 0.98 * history[-1 - STUCK]:
            break  # no free ray where it would help
        taken = [*others, *(int(model.candidates[p]) for p in pegs)]
        free = np.flatnonzero(
            np.isin(model.candidates, _apart(rays, model.candidates, taken, radius))
        )
        if not len(free):
            break
        gap = np.abs(model.arc_of[free] - now.arc_mm)
        gap = np.minimum(gap, model.perimeter - gap)
        tried = free[np.argsort(gap, kind="stable")[:TRIED]]
        outcomes = [model.sag_with(int(p)) for p in tried]
        best = int(np.argmin([o.all_mm for o in outcomes]))
        pegs, now = [*pegs, int(tried[best])], outcomes[best]
        model.hold(pegs[-1])
        history.append(now.all_mm)
    needed = max(stiffness.max_sag_mm, now.sag_mm)
    for peg in pegs[1:]:
        without = [p for p in pegs if p != peg]
        found = model.sag(without)
        if found.sag_mm <= needed:
            pegs, now = without, found
    return [int(model.candidates[p]) for p in pegs], now.sag_mm, now.at


def _apart(rays: Rays, own: Indices, taken: list[int], radius: float) -> Indices:
    """Return the rays whose feet keep away from those taken."""
    if not taken:
        return own
    gaps = np.linalg.norm(rays.foot[own][:, None] - rays.foot[taken][None], axis=2).min(axis=1)
    apart: Indices = own[gaps >= APART_RADII * radius]
    return apart


@dataclass(frozen=True)
class _Sag:
    """Largest displacement (mm), where it is (3,), at what arc length, and the norm of all of them."""

    sag_mm: float
    at: Array
    arc_mm: float
    all_mm: float


class _Model:
    """One knot's frame on its first peg; further pegs are springs at their tops.

    With the frame's flexibility F at all candidates known, pegs S with stiffness k and loads f at
    their tops move them by u_S = (I + F_SS k)⁻¹ (u0_S + F_SS f), and the rest by what they then
    exert: a dense problem of six unknowns a peg instead of the whole frame. Pegs that are to stay are
    held: they stiffen F by F_·S k (I + F_SS k)⁻¹ F_S· (Woodbury 1950), and one more costs six unknowns.
    """

    def __init__(
        self,
        knots: Knots,
        rays: Rays,
        k: int,
        own: Indices,
        top_radius: Array,
        foot_radius: Array,
        stiffness: Stiffness,
    ) -> None:
        one = Knots((knots.knots[k],), knots.radius_mm)
        every = sites_of(one, JOINT_RADII, {0: rays.vertex[own]})
        arc = every.arc[np.searchsorted(every.vertex, rays.vertex[own])]
        self.perimeter = float(every.perimeter[0])
        bins = (arc / self.perimeter * CANDIDATES).astype(np.int64)
        order = np.lexsort((rays.length_mm[own], bins))
        shortest = own[order[np.flatnonzero(np.diff(bins[order], prepend=-1))]]
        middle = one.points.mean(axis=0)
        near = np.linalg.norm(rays.top[shortest] - middle, axis=1) + rays.length_mm[shortest]
        first = int(near.argmin())
        self.candidates = np.concatenate([shortest[first : first + 1], np.delete(shortest, first)])
        sites = sites_of(one, JOINT_RADII, {0: rays.vertex[self.candidates]})
        tops = np.searchsorted(sites.vertex, rays.vertex[self.candidates])
        self.arc, self.arc_of, self.n = sites.arc, sites.arc[tops], len(sites.arc)
        pegs = [self._peg(rays, r, top_radius, foot_radius, stiffness) for r in self.candidates]
        self.spring = np.array([p[0] for p in pegs])
        self.push = np.array([p[1] for p in pegs])
        self.places = sites.point
        frame = frame_of(
            *piece_beams(knots.radius_mm, sites, nothing()),
            stiffness.young_mpa,
            stiffness.density_g_cm3,
            DOWN,
            springs={int(tops[0]): (self.spring[0], self.push[0])},
        )
        self.own = frame.displacements()  # (n, 6)
        flexibility = frame.flexibility(tops).reshape(6 * self.n, -1)
        at_tops = (6 * tops[:, None] + np.arange(6)).ravel()
        self.among = flexibility[at_tops]  # (6 c, 6 c)
        self.at_rest = self.own.reshape(-1)[at_tops]
        moves = flexibility.reshape(self.n, 6, -1)[:, :3].reshape(3 * self.n, -1)
        self.moves = np.ascontiguousarray(moves.T)  # (6 c, 3 n)
        # the same on the pegs that are held
        self._moved, self._rest = self.own[:, :3].ravel(), self.at_rest
        self._among, self._moves = self.among.copy(), self.moves.copy()

    @staticmethod
    def _peg(
        rays: Rays, ray: int, top: Array, foot: Array, stiffness: Stiffness
    ) -> tuple[Array, Array]:
        """A peg as its top feels it: (6, 6) stiffness and (6,) load."""
        share = np.arange(PIECES + 1)[:, None] / PIECES
        joints = rays.top[ray] + share * (rays.foot[ray] - rays.top[ray])
        chain = np.column_stack([np.arange(PIECES), np.arange(1, PIECES + 1)])
        beams = round_beams(joints, chain, taper(top[ray], foot[ray]))
        frame = frame_of(
            beams, np.array([PIECES]), stiffness.young_mpa, stiffness.density_g_cm3, DOWN
        )
        spring = np.asarray(
            np.linalg.inv(frame.flexibility(np.array([0]))[:6, 0]), dtype=np.float64
        )
        return spring, spring @ frame.displacements()[0]

    def hold(self, peg: int) -> None:
        """Hold a peg for all later calls of `sag_with`."""
        rows = slice(6 * peg, 6 * peg + 6)
        exerted = self._exert(peg)
        among, moves = self._among[rows].copy(), self._moves[rows].copy()
        stiff = np.linalg.solve((np.eye(6) + among[:, rows] @ self.spring[peg]).T, self.spring[peg])
        self._moved = self._moved + exerted @ moves
        self._rest = self._rest + self._among[:, rows] @ exerted
        back = among.T @ stiff  # (6 c, 6): what the peg answers to a unit load at each candidate
        self._moves -= back @ moves
        self._among -= self._among[:, rows] @ back.T

    def sag_with(self, peg: int) -> _Sag:
        """Compute how the tube moves on the pegs that are held and one more."""
        moves = self._moves[6 * peg : 6 * peg + 6]
        return self._sag_of((self._moved + self._exert(peg) @ moves).reshape(-1, 3))

    def _exert(self, peg: int) -> Array:
        """(6,) force and couple of one more peg on the tube."""
        rows = slice(6 * peg, 6 * peg + 6)
        among, spring, push = self._among[rows, rows], self.spring[peg], self.push[peg]
        top = np.linalg.solve(np.eye(6) + among @ spring, self._rest[rows] + among @ push)
        return np.asarray(push - spring @ top)

    def sag(self, pegs: list[int]) -> _Sag:
        """Compute how the tube moves on these pegs, the first among them."""
        more = np.array(pegs[1:], dtype=np.int64)
        moved = self.own[:, :3]
        if len(more):
            rows = (6 * more[:, None] + np.arange(6)).ravel()
            among = self.among[np.ix_(rows, rows)]
            push = self.push[more]
            springs = np.einsum("rpi,pij->rpj", among.reshape(len(rows), -1, 6), self.spring[more])
            left = np.eye(len(rows)) + springs.reshape(len(rows), -1)
            right = self.at_rest[rows] + among @ push.ravel()
            top = np.linalg.solve(left, right).reshape(-1, 6)
            force = (push - np.einsum("pij,pj->pi", self.spring[more], top)).ravel()
            moved = moved + (force @ self.moves[rows]).reshape(-1, 3)
        return self._sag_of(moved)

    def _sag_of(self, moved: Array) -> _Sag:
        size = np.linalg.norm(moved, axis=1)
        worst = int(size.argmax())
        largest = float(size[worst])
        together = largest * float(((size / largest) ** POWER).sum()) ** (1 / POWER)
        return _Sag(largest, self.places[worst], float(self.arc[worst]), together)
