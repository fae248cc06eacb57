"""An eyelet: the ring by which a thread carries a piece, where it has room, and what keeps clear of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.legs import BAR_MM, Bar
from knotfab.geometry.measures import segment_distance
from knotfab.hold.plinth import Masses
from knotfab.hold.shade import MountShadows
from knotfab.hold.solids import motion_along
from knotfab.hold.stand import LENGTH_WEIGHT, MOST_COSINE
from knotfab.hold.struts import (
    GROUND,
    Candidates,
    Obstacles,
    Sites,
    join_members,
    no_members,
    off_segments,
    opens_slowly,
)
from knotfab.knots import Knots
from knotfab_formats.slicer_ini import FLANK_DEG
from knotfab_formats.upright import longest_free_leg_mm

_HEIGHTS = 24  # heights of the eyelet that are tried
_ABOVE = 0.15  # a share of the piece's height: the least from its centre of mass to the eyelet
_AT_ONCE = 400  # posts that are looked at together, from those that show least on
THREAD_MM = 1.0  # across the thread's way, with some room
_FAR_MM = 1e4  # above every piece
_SIDES = 48  # places along a ring at which it is told how far a post is
UP = np.array([0.0, 1.0, 0.0])
UNSUPPORTED = "Use --supports slicer, or leave out --mount"


@dataclass(frozen=True)
class Eyelet:
    """A ring of round wire, mm: its middle (3,), and the unit vector (3,) through its hole."""

    middle: Array
    through: Array
    ring_mm: float  # radius of the wire's centre line
    wire_mm: float  # radius of the wire

    @property
    def thread(self) -> Array:
        """Where the thread carries the piece: the top of the hole, (3,)."""
        return np.asarray(self.middle + (self.ring_mm - self.wire_mm) * UP)

    def outline(self, sides: int) -> Array:
        """Sample the wire's centre line, (sides, 3)."""
        turn, angle = motion_along(self.through, self.middle), 2 * np.pi * np.arange(sides) / sides
        across = np.outer(np.cos(angle), turn[:, 0]) + np.outer(np.sin(angle), turn[:, 1])
        return np.asarray(self.middle + self.ring_mm * across)

    @property
    def masses(self) -> Masses:
        """The ring's volume and centre of mass."""
        volume = 2 * np.pi**2 * self.ring_mm * self.wire_mm**2
        return Masses(np.array([volume]), self.middle[None])


@dataclass(frozen=True)
class Bed:
    """The bed on which a piece prints without supports: `up` (3,) from it, and the material's modulus.

    `bars` hold legs while they print; of legs, `free_mm` (n,) below `places` (n, 3) stand free. All are in
    the scene. An eyelet's posts meet in its lowest place.
    """

    up: Array
    young_mpa: float
    radius_mm: float
    bars: tuple[Bar, ...]
    places: Array
    free_mm: Array

    @property
    def blocks(self) -> Candidates:
        """The bars as members, for others to keep clear of."""
        start, end = (
            np.array([(b.start, b.end) for b in self.bars]).reshape(-1, 2, 3).swapaxes(0, 1)
        )
        none = np.zeros(len(start), dtype=np.int64)
        return Candidates(none, none, start, end, np.full(len(start), BAR_MM[0] / 2))

    def carries(self, some: Candidates) -> Mask:
        """Return which members rise from a leg so steeply, and are so stiff with it while they print, (n,).

        A post rises to its end, a strut from either end to the other.
        """
        from scipy.spatial import cKDTree

        rise = (some.end - some.start) @ self.up
        low = np.where(
            (rise >= 0)[:, None] | (some.second == GROUND)[:, None], some.start, some.end
        )
        rise = np.where(some.second == GROUND, rise, np.abs(rise))
        steep = rise >= np.sin(np.radians(FLANK_DEG)) * some.length_mm
        # a cantilever's tip moves by its free length cubed over the fourth power of its radius
        below, own = self.free_mm[cKDTree(self.places).query(low)[1]], some.length_mm
        limp = ((below + own) ** 3 - own**3) / self.radius_mm**4 + own**3 / some.radius**4
        return np.asarray(steep & (limp <= longest_free_leg_mm(1.0, self.young_mpa) ** 3))


def bound_ring(ring: Eyelet) -> Candidates:
    """Return a member as thick as the whole ring is wide, for struts to keep clear of."""
    reach = ring.ring_mm + ring.wire_mm
    beside = ring.through * ring.wire_mm
    none = np.array([GROUND])
    return Candidates(
        none, none, (ring.middle - beside)[None], (ring.middle + beside)[None], np.array([reach])
    )


def draw_thread(ring: Eyelet) -> Candidates:
    """Return the thread above a ring as a bar, for members to keep clear of."""
    none, start = np.array([GROUND]), ring.thread[None]
    return Candidates(none, none, start, start + _FAR_MM * UP, np.array([0.5 * THREAD_MM]))


def ring_bars(ring: Eyelet) -> Candidates:
    """Return bars along the ring, for its shadow."""
    across = np.cross(UP, ring.through)
    turn = np.linspace(0.0, 2 * np.pi, 9)[:, None]
    at = ring.middle + ring.ring_mm * (np.cos(turn) * UP + np.sin(turn) * across)
    none = np.full(8, GROUND)
    return Candidates(none, none, at[:-1], at[1:], np.full(8, ring.wire_mm))


def centre_eyelet(
    posts: Candidates, ring: Eyelet, middle: Array, bed: Bed | None = None
) -> tuple[Candidates, Eyelet]:
    """Move eyelet and posts so that the eyelet is straight above the centre of mass `middle`.

    All posts end where the first one meets the ring.
    """
    at = np.array([middle[0], ring.middle[1], middle[2]])
    if bed is not None:
        end = np.tile(at - ring.ring_mm * bed.up, (len(posts), 1))
        return replace(posts, end=end), replace(ring, middle=at)
    axis = (at - posts.start[0]) / np.linalg.norm(at - posts.start[0])
    level = np.cross(axis, UP)
    # the post must lie in the ring's plane; a post that stands upright does so in any
    through = level / np.linalg.norm(level) if np.linalg.norm(level) > 0.05 else ring.through
    ring = replace(ring, middle=at, through=through)
    return replace(posts, end=np.tile(at - ring.ring_mm * axis, (len(posts), 1))), ring


def has_room(obstacles: Obstacles, *rings: Eyelet) -> Mask:
    """Return whether no strand is in the way of each ring and the thread above it, (n,).

    Nor may a member come near the ring, or run through its hole.
    """
    tube, points, bars = obstacles.tube, obstacles.points, obstacles.members
    i, j = np.divmod(np.arange(_SIDES * len(bars)), max(len(bars), 1))
    apart = bars.radius[j] + obstacles.clearance
    free = np.ones(len(rings), dtype=bool)
    for n, ring in enumerate(rings):
        off = points - ring.middle
        near = np.linalg.norm(off, axis=1)
        level = np.hypot(off[:, 0], off[:, 2])
        reach = tube + obstacles.clearance + obstacles.slack
        free[n] = near.min() >= reach + ring.ring_mm + ring.wire_mm
        free[n] &= not ((level < reach + 0.5 * THREAD_MM) & (off[:, 1] > 0)).any()
        middle, spokes = np.broadcast_to(ring.middle, (len(i), 3)), ring.outline(_SIDES)[i]
        gaps = segment_distance(middle, spokes, bars.start[j], bars.end[j])
        free[n] &= (gaps >= apart + ring.wire_mm).all()
    return free


def choose_post(
    knots: Knots,
    sites: Sites,
    middle: Array,
    ring: Eyelet,
    radius: float,
    obstacles: Obstacles,
    shadows: MountShadows,
    bed: Bed | None = None,
) -> tuple[Candidates, Eyelet]:
    """Choose the post and the eyelet above `middle` (3,) that show least.

    Raises:
        SceneError: there is none.
    """
    low, high = float(knots.points[:, 1].min()), float(knots.points[:, 1].max())
    reach = 2.0 * (ring.ring_mm + ring.wire_mm + knots.radius_mm)
    heights = np.linspace(middle[1] + _ABOVE * (high - low), high + reach, _HEIGHTS)
    rings = [replace(ring, middle=np.array([middle[0], y, middle[2]])) for y in heights]
    parts, at = [no_members()], [np.empty(0, dtype=np.int64)]
    free = has_room(obstacles, *rings)
    free &= obstacles.clear(join_members([draw_thread(one) for one in rings]))
    for n in np.flatnonzero(free):
        to = rings[n].middle if bed is None else rings[n].middle - ring.ring_mm * bed.up
        along = to - sites.point
        length = np.linalg.norm(along, axis=1)
        square = np.abs(np.einsum("ij,ij->i", along, sites.tangent)) <= MOST_COSINE * length
        some = np.flatnonzero(square & (length >= ring.ring_mm + ring.wire_mm + knots.radius_mm))
        end = np.tile(to, (len(some), 1))
        if bed is None:
            end -= ring.ring_mm * along[some] / length[some, None]
        ground = np.full(len(some), GROUND)
        start, thick = sites.point[some], np.full(len(some), radius)
        parts.append(Candidates(some, ground, start, end, thick))
        at.append(np.full(len(some), n))
    every, number = join_members(parts), np.concatenate(at)
    if bed is not None:
        carried = bed.carries(every)
        every, number = every.take(carried), number[carried]
    if not len(every):
        raise no_place(bed)
    shown = np.array([shadows.cost(ring_bars(one)).sum() for one in rings])
    cost = shadows.cost(every) + shown[number] + LENGTH_WEIGHT * every.length_mm
    order = np.argsort(cost, kind="stable")
    for begin in range(0, len(order), _AT_ONCE):
        clear = obstacles.clear(every.take(order[begin : begin + _AT_ONCE]))
        if clear.any():
            best = int(order[begin + clear.argmax()])
            return centre_eyelet(every.take([best]), rings[number[best]], middle, bed)
    raise no_place(bed)


def list_posts(
    sites: Sites, post: Candidates, least_mm: float, bed: Bed | None = None
) -> Candidates:
    """List further posts to the end of an eyelet's first `post`, of at least this length."""
    along = post.end[0] - sites.point
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    # a share of a further post's length, by which it may come down to the eyelet
    from_below = along[:, 1] >= -0.3 * length
    square = np.abs(np.einsum("ij,ij->i", along, sites.tangent)) <= MOST_COSINE * length
    some = np.flatnonzero(from_below & square & (length >= least_mm))
    end, ground = np.tile(post.end, (len(some), 1)), np.full(len(some), GROUND)
    every = Candidates(some, ground, sites.point[some], end, np.full(len(some), post.radius[0]))
    return every if bed is None else every.take(bed.carries(every))


def meet_well(posts: Candidates, ring: Eyelet, clearance_mm: float) -> Mask:
    """Return which posts leave the thread its place in the ring that they end on, (n,).

    They also part from the ring so fast that no gap prints closed.
    """
    at, half = ring.outline(_SIDES), np.arange(_SIDES // 2 + 1)
    joint = int(np.linalg.norm(at - posts.end[0], axis=1).argmin())
    i, j = np.divmod(np.arange(len(posts) * _SIDES), _SIDES)
    unit = (posts.end - posts.start) / posts.length_mm[:, None]
    off = off_segments(at[j], posts.start[i], unit[i], posts.length_mm[i])[1].reshape(-1, _SIDES)
    contact, step = posts.radius[:, None] + ring.wire_mm, np.linalg.norm(at[1:2] - at[:1], axis=1)
    threads = np.tile(ring.thread - 0.5 * THREAD_MM * UP, (len(posts), 1))
    beside = off_segments(threads, posts.start, unit, posts.length_mm)[1]
    free = np.asarray(beside >= posts.radius + 0.5 * THREAD_MM)
    for way in (1, -1):
        walk = off[:, (joint + way * half) % _SIDES]
        here, there = walk[:, :-1], walk[:, 1:]
        slow = opens_slowly(here, there, step, contact, clearance_mm)
        free &= ~(slow & (here < contact + clearance_mm)).any(axis=1)
    return free


def keep_free(ring: Eyelet) -> Candidates:
    """Return what other members keep clear of: the ring and its thread."""
    return join_members([bound_ring(ring), draw_thread(ring)])


def no_place(bed: Bed | None = None) -> SceneError:
    return SceneError(
        "the hanger",
        "no eyelet has room straight above the centre of mass, with a post to a strand beside it",
        "Use --mount stand, or --mount none" if bed is None else UNSUPPORTED,
    )
