"""As few pegs as keep every knot from sagging: added where they help most, taken away where they idle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab.knots import Knots
from knotfab.mount.frame_model import Beams, frame_of, round_beams
from knotfab.mount.rays import Rays
from knotfab.mount.struts import GROUND, Candidates, Sites

__all__ = ["Pegs", "Stiffness", "choose_pegs", "mounted_frame", "sag_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

JOINT_RADII = 2.0  # distance of the frame model's joints along a tube, in tube radii
APART_RADII = 4.0  # between the middles of two feet, so that each keeps its fillet
CANDIDATES = 192  # of one knot: in each stretch of its length the shortest free ray
TRIED = 32  # of them when a peg is added: those nearest to where it sags most
STUCK = 4  # pegs in a row that hardly help
# Of the displacements whose sum a further peg is to lower; the largest alone may stay the same
# wherever one peg is put.
POWER = 4
PIECES = 4  # of a tapering peg, each taken as round
DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Stiffness:
    """What the piece is made of and how far it may sag: MPa, g/cm³, mm."""

    young_mpa: float
    density_g_cm3: float
    max_sag_mm: float


@dataclass(frozen=True)
class Pegs:
    """Chosen pegs, as numbers of rays, and the largest displacement (mm) with them, and where (3,)."""

    rays: Ints
    sag_mm: float
    sag_at: Array


def choose_pegs(
    knots: Knots,
    rays: Rays,
    top_radius_mm: float,
    foot_radius_mm: Array,
    stiffness: Stiffness,
    *,
    most: int = 60,
) -> Pegs:
    """Choose rays for pegs until no point of any knot sags more than `max_sag_mm` (gravity: -y).

    Each knot starts with one peg. Then the peg is added that leaves the least sag, and in the end
    those are taken away that the limit does not need. Where no free ray is left, or a knot has
    `most`, the sag is what it is: the caller compares.

    Args:
        knots: in scene coordinates, those that `rays` belong to.
        top_radius_mm, foot_radius_mm: of a peg, at the tube and (n,) at the wall, for each ray.

    Raises:
        ValueError: a knot has no free ray at all; the message names it.
    """
    chosen: list[int] = []
    worst, at = 0.0, knots.points[0]
    for k in range(len(knots.knots)):
        own = np.flatnonzero(rays.free & (rays.knot == k))
        if not len(own):
            raise ValueError(f"no light ray from knot {k} to the wall is free for a peg")
        apart = _apart(rays, own, chosen, knots.radius_mm)
        model = _Model(
            knots, rays, k, apart if len(apart) else own, top_radius_mm, foot_radius_mm, stiffness
        )
        pegs, sag, place = _of_knot(model, rays, chosen, knots.radius_mm, stiffness, most)
        chosen += pegs
        if sag >= worst:
            worst, at = sag, place
    return Pegs(np.array(chosen, dtype=np.int64), worst, at)


def _of_knot(
    model: _Model, rays: Rays, others: list[int], radius: float, stiffness: Stiffness, most: int
) -> tuple[list[int], float, Array]:
    """Pegs of one knot, its sag and where it is."""
    pegs = [0]  # numbers of the model's candidates; the first always stays
    now = model.sag(pegs)
    history = [now.all_mm]
    while now.sag_mm > stiffness.max_sag_mm and len(pegs) < most:
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
        tried = [[*pegs, int(p)] for p in free[np.argsort(gap, kind="stable")[:TRIED]]]
        outcomes = [model.sag(t) for t in tried]
        best = int(np.argmin([o.all_mm for o in outcomes]))
        pegs, now = tried[best], outcomes[best]
        history.append(now.all_mm)
    needed = max(stiffness.max_sag_mm, now.sag_mm)
    for peg in pegs[1:]:
        without = [p for p in pegs if p != peg]
        found = model.sag(without)
        if found.sag_mm <= needed:
            pegs, now = without, found
    return [int(model.candidates[p]) for p in pegs], now.sag_mm, now.at


def _apart(rays: Rays, own: Ints, taken: list[int], radius: float) -> Ints:
    """Those rays whose feet keep away from those taken."""
    if not taken:
        return own
    gaps = np.linalg.norm(rays.foot[own][:, None] - rays.foot[taken][None], axis=2).min(axis=1)
    apart: Ints = own[gaps >= APART_RADII * radius]
    return apart


def sag_of(
    knots: Knots,
    rays: Rays,
    chosen: Ints,
    top_radius_mm: float,
    foot_radius_mm: Array,
    stiffness: Stiffness,
    braces: tuple[Sites, Candidates] | None = None,
) -> tuple[float, Array]:
    """Largest displacement (mm) of all knots on the chosen pegs, and where (3,), by one whole frame.

    What `choose_pegs` finds by adding pegs to a solved frame.

    Args:
        braces: the sites that they join, and struts and leaning pegs.
    """
    beams, fixed, n = mounted_frame(knots, rays, chosen, top_radius_mm, foot_radius_mm, braces)
    frame = frame_of(beams, fixed, stiffness.young_mpa, stiffness.density_g_cm3, DOWN)
    size = np.linalg.norm(frame.moved()[:n, :3], axis=1)
    worst = int(size.argmax())
    return float(size[worst]), beams.joints[worst]


def mounted_frame(
    knots: Knots,
    rays: Rays,
    chosen: Ints,
    top_radius_mm: float,
    foot_radius_mm: Array,
    braces: tuple[Sites, Candidates] | None = None,
) -> tuple[Beams, Ints, int]:
    """The beams of tubes, pegs and braces, the joints that the wall holds, and how many are the tubes'.

    Tubes have joints `JOINT_RADII` apart and wherever something meets them; a peg is a chain of
    `PIECES` round beams.
    """
    places, links, radii, vertices, starts = [], [], [], [], []
    count = 0
    for k, curve in enumerate(knots.knots):
        own = [_joints(curve.points, knots.radius_mm), rays.vertex[chosen][rays.knot[chosen] == k]]
        if braces is not None:
            sites, struts = braces
            met = np.concatenate([struts.first, struts.second])
            met = met[met != GROUND]
            own.append(sites.vertex[met][sites.knot[met] == k])
        vertices.append(np.unique(np.concatenate(own)))
        joints, ring, radius = _tube(curve.points, vertices[k], knots.radius_mm)
        places.append(joints)
        links.append(ring + count)
        radii.append(radius)
        starts.append(count)
        count += len(joints)
    n, fixed = count, []

    def joint(knot: int, vertex: int) -> int:
        return starts[knot] + int(np.searchsorted(vertices[knot], vertex))

    for ray in chosen:
        first, last = rays.top[ray], rays.foot[ray]
        share = (np.arange(PIECES) + 1)[:, None] / PIECES
        new = count + np.arange(PIECES)
        chain = np.concatenate([[joint(int(rays.knot[ray]), int(rays.vertex[ray]))], new])
        places.append(first + share * (last - first))
        links.append(np.column_stack([chain[:-1], chain[1:]]))
        radii.append(_taper(top_radius_mm, float(foot_radius_mm[ray])))
        fixed.append(int(new[-1]))
        count += PIECES
    if braces is not None:
        sites, struts = braces
        leaning = struts.second == GROUND
        second = [joint(int(sites.knot[s]), int(sites.vertex[s])) for s in struts.second[~leaning]]
        ends = np.empty((len(struts), 2), dtype=np.int64)
        ends[:, 0] = [joint(int(sites.knot[s]), int(sites.vertex[s])) for s in struts.first]
        ends[~leaning, 1] = second
        ends[leaning, 1] = count + np.arange(int(leaning.sum()))
        places.append(struts.end[leaning])
        fixed += ends[leaning, 1].tolist()
        links.append(ends)
        radii.append(struts.radius)
    beams = round_beams(np.concatenate(places), np.concatenate(links), np.concatenate(radii))
    return beams, np.array(fixed, dtype=np.int64), n


def _joints(points: Array, radius: float) -> Ints:
    """Vertices about `JOINT_RADII` apart."""
    arc, perimeter = _arc(points)
    count = max(6, int(perimeter / (JOINT_RADII * radius)))
    at = np.searchsorted(arc, np.arange(count) * perimeter / count)
    joints: Ints = np.unique(at[at < len(points)])
    return joints


def _arc(points: Array) -> tuple[Array, float]:
    """(n,) arc length at each vertex, and all around."""
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    arc: Array = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(arc[:-1]), float(arc[-1])


def _tube(points: Array, vertices: Ints, radius: float) -> tuple[Array, Ints, Array]:
    n = len(vertices)
    ring = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
    return points[vertices], ring, np.full(n, radius)


def _taper(top: float, foot: float) -> Array:
    """(PIECES,) radii of a cone cut into round pieces."""
    return top + (np.arange(PIECES) + 0.5) / PIECES * (foot - top)


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
    exert: a dense problem of six unknowns a peg instead of the whole frame.
    """

    def __init__(
        self,
        knots: Knots,
        rays: Rays,
        k: int,
        own: Ints,
        top_radius: float,
        foot_radius: Array,
        stiffness: Stiffness,
    ) -> None:
        points, radius = knots.knots[k].points, knots.radius_mm
        arc, self.perimeter = _arc(points)
        bins = (arc[rays.vertex[own]] / self.perimeter * CANDIDATES).astype(np.int64)
        order = np.lexsort((rays.length_mm[own], bins))
        shortest = own[order[np.flatnonzero(np.diff(bins[order], prepend=-1))]]
        middle = points.mean(axis=0)
        near = np.linalg.norm(rays.top[shortest] - middle, axis=1) + rays.length_mm[shortest]
        first = int(near.argmin())
        self.candidates = np.concatenate([shortest[first : first + 1], np.delete(shortest, first)])
        self.arc_of = arc[rays.vertex[self.candidates]]
        vertices = np.union1d(_joints(points, radius), rays.vertex[self.candidates])
        self.arc, self.n = arc[vertices], len(vertices)
        pegs = [self._peg(rays, r, top_radius, foot_radius, stiffness) for r in self.candidates]
        self.spring = np.array([p[0] for p in pegs])
        self.push = np.array([p[1] for p in pegs])
        joints, ends, radii = _tube(points, vertices, radius)
        self.places = joints
        tops = np.searchsorted(vertices, rays.vertex[self.candidates])
        frame = frame_of(
            round_beams(joints, ends, radii),
            np.array([], dtype=np.int64),
            stiffness.young_mpa,
            stiffness.density_g_cm3,
            DOWN,
            springs={int(tops[0]): (self.spring[0], self.push[0])},
        )
        self.own = frame.moved()  # (n, 6)
        flexibility = frame.flexibility(tops).reshape(6 * self.n, -1)
        at_tops = (6 * tops[:, None] + np.arange(6)).ravel()
        self.among = flexibility[at_tops]  # (6 c, 6 c)
        self.at_rest = self.own.reshape(-1)[at_tops]
        moves = flexibility.reshape(self.n, 6, -1)[:, :3].reshape(3 * self.n, -1)
        self.moves = np.ascontiguousarray(moves.T)  # (6 c, 3 n)

    @staticmethod
    def _peg(
        rays: Rays, ray: int, top: float, foot: Array, stiffness: Stiffness
    ) -> tuple[Array, Array]:
        """A peg as its top feels it: (6, 6) stiffness and (6,) load."""
        share = np.arange(PIECES + 1)[:, None] / PIECES
        joints = rays.top[ray] + share * (rays.foot[ray] - rays.top[ray])
        chain = np.column_stack([np.arange(PIECES), np.arange(1, PIECES + 1)])
        beams = round_beams(joints, chain, _taper(top, float(foot[ray])))
        frame = frame_of(
            beams, np.array([PIECES]), stiffness.young_mpa, stiffness.density_g_cm3, DOWN
        )
        spring = np.asarray(
            np.linalg.inv(frame.flexibility(np.array([0]))[:6, 0]), dtype=np.float64
        )
        return spring, spring @ frame.moved()[0]

    def sag(self, pegs: list[int]) -> _Sag:
        """How the tube moves on these pegs."""
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
        size = np.linalg.norm(moved, axis=1)
        worst = int(size.argmax())
        largest = float(size[worst])
        together = largest * float(((size / largest) ** POWER).sum()) ** (1 / POWER)
        return _Sag(largest, self.places[worst], float(self.arc[worst]), together)
