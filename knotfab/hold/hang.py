"""A hanger: an eyelet above the centre of mass, so that the piece hangs level on one thread.

Matter in the visual hull of all pictures, or above every frame, changes no picture (Mitra & Pauly
2009): the eyelet stands where it darkens least. A thread lets the piece turn, so that one of
several views shows its pictures in turn under a single lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh
from knotfab.hold.beams import HeldFrame, Stiffness, piece_frame, sag_moves, springs_of, worst_of
from knotfab.hold.planner import plan_members
from knotfab.hold.plinth import Masses
from knotfab.hold.shade import MountShadows, near_struts
from knotfab.hold.solids import Fixture, motion_along, strut, unite
from knotfab.hold.stand import (
    BRIDGES,
    FINE_RADII,
    LENGTH_WEIGHT,
    MOST_COSINE,
    VISIBLE_SHARES,
    join_knots,
    least_shown,
    list_bridges,
    masses_of,
)
from knotfab.hold.struts import (
    GROUND,
    Candidates,
    Obstacles,
    Sites,
    join_members,
    no_members,
    sites_of,
)
from knotfab.knots import Knots
from knotfab.scene.camera import Camera
from knotfab_fixtures.holders import eyelet

MOST_TILT_DEG = 1.0  # the piece may hang askew by this
HOLE_MM = 3.0  # across the eyelet's hole
THREAD_MM = 1.0  # across the thread's way, with some room
UP = np.array([0.0, 1.0, 0.0])
_HEIGHTS = 24  # heights of the eyelet that are tried
_ABOVE = 0.15  # a share of the piece's height: the least from its centre of mass to the eyelet
_TRIED = 400  # posts, from the one that shows least on
MOST_POSTS = 4  # posts from strands to the eyelet
# between the ends of further posts that are weighed, and how many are
_SPREAD_RADII, _WEIGHED = 6.0, 12
_PLANS = (
    4  # each about the centre of mass of the one before, with a post more where that sags too much
)
_ROUNDS = 4  # rounds of moving the eyelet above the centre of mass, to which post and eyelet add


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
class HangMount:
    """A hanger, in the scene.

    `members` are struts and posts, which lead to the eyelet (their `second` is `GROUND`); `holds`
    (n,) names the knot that each was added for. `tilt_deg` is how far askew the piece hangs. Other
    fields are as in `StandMount`.
    """

    members: Candidates
    holds: Indices
    eyelet: Eyelet
    tilt_deg: float
    sag_at: Array
    sag_again_mm: float
    predicted_intrusion: Array
    moves: Array = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def struts(self) -> Candidates:
        return self.members.of(self.members.second != GROUND)


def plan_hang(
    knots: Knots,
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
    clearance_mm: float,
    stiffness: Stiffness,
    least_radius_mm: float,
    ends: bool = False,
) -> HangMount:
    """Choose struts, posts and an eyelet for knots in scene coordinates (gravity: -y).

    The knots are joined to one piece. The eyelet goes above its centre of mass, where post and ring
    show least; struts are added until nothing sags (`plan_members`); then the eyelet is moved above
    the new centre of mass. If it meets something there, or the piece still sags, this is repeated.

    Args:
        cameras, targets: each view's camera, and its picture's silhouette (H, W) over the whole
            frame.
        least_radius_mm: of a member that the printer can make.
        ends: whether screens end at their frames, beside which no shadow is seen.

    Raises:
        SceneError: a knot cannot be reached, or no eyelet has a place.
    """
    tube = knots.radius_mm
    thin = max(VISIBLE_SHARES[0] * tube, min(least_radius_mm, tube))
    sites = sites_of(knots)
    shadows = MountShadows(knots, cameras, targets, ends)
    obstacles = Obstacles(knots, sites, clearance_mm)
    near = near_struts(sites, tube)
    unseen = shadows.hidden(near)
    seen = least_shown(near.of(~unseen), shadows, BRIDGES, len(sites.knot))
    pool = join_members([near.of(unseen), seen, list_bridges(sites, shadows, tube, thin)])
    visible = np.arange(len(pool)) >= unseen.sum()
    longest = int(np.argmax(sites.perimeter))
    joints, holds = join_knots(len(knots.knots), sites, pool, obstacles, shadows, root=longest)
    wire = max(thin, least_radius_mm)
    blank = Eyelet(np.zeros(3), cameras[0].level_axes[0], 0.5 * HOLE_MM + wire, wire)
    middle, number = _centre_of_mass(masses_of(knots, joints)), len(joints)
    best: HangMount | None = None
    fewest, firm = 1, stiffness
    for _ in range(_PLANS):
        way, dark = copy(obstacles), shadows.twin()
        post, ring = _choose_post(knots, sites, middle, blank, thin, way, dark)
        posts = _add_posts(knots, sites, joints, post, ring, firm, way, dark, fewest)
        way.add(join_members([posts, _bound_ring(ring)]))
        dark.add(join_members([posts, _ring_bars(ring)]))
        given = join_members([joints, posts])
        members = plan_members(knots, sites, way, dark, pool, visible, given, firm).members
        own = np.arange(len(members))
        is_post = (own >= number) & (own < number + len(posts))
        for _ in range(_ROUNDS):
            middle = _centre_of_mass(masses_of(knots, members), ring.masses)
            posts, ring = _centre_eyelet(members.of(is_post), ring, middle)
            parts = members.of(own < number), posts, members.of(own >= number + len(posts))
            members = join_members(list(parts))
        apart = Obstacles(knots, sites, clearance_mm)
        apart.add(members.of(~is_post))
        if not apart.clear(members.of(is_post)).all() or not _has_room(apart, ring)[0]:
            continue  # planned anew, about what has now come out as the centre of mass
        off = ring.thread - _centre_of_mass(masses_of(knots, members), ring.masses)
        tilt = float(np.degrees(np.arctan2(np.hypot(off[0], off[2]), off[1])))
        moves = sag_moves(knots, sites, members, stiffness, step_radii=FINE_RADII)
        moves = _let_swing(knots.points, moves, ring.thread)
        sag, at = worst_of(moves, knots.points)
        held = np.concatenate([holds, sites.knot[members.first[number:]]])
        if best is None or sag < best.sag_again_mm:
            dark_share = shadows.darken(join_members([members, _ring_bars(ring)]))
            best = HangMount(members, held, ring, tilt, at, sag, dark_share, moves)
        if sag <= stiffness.max_sag_mm:
            break
        # on its thread, by a finer frame, it sags more than the plan that is clamped says
        fewest = min(len(posts) + 1, MOST_POSTS)
        firm = replace(firm, max_sag_mm=firm.max_sag_mm * stiffness.max_sag_mm / sag)
    if best is None:
        raise _no_place()
    return best


def _let_swing(points: Array, moves: Array, thread: Array) -> Array:
    """Turn the moves (N, 3) of a piece clamped at its thread into those of one free to swing there.

    What sags to one side turns the piece until its centre of mass is below the thread again: by the
    two small angles about level axes that take the mean of the moves back to the plumb line.
    """
    lever = points - thread
    drop, aside = -float(lever[:, 1].mean()), moves.mean(axis=0)
    turn = np.array([aside[2], 0.0, -aside[0]]) / drop
    return np.asarray(moves + np.cross(turn, lever))


def _no_place() -> SceneError:
    return SceneError(
        "the hanger",
        "no eyelet has room straight above the centre of mass, with a post to a strand beside it",
        "Use --mount stand or none, or a thinner tube (--tube-radius)",
    )


def _centre_of_mass(*several: Masses) -> Array:
    """Return the common centre of mass, (3,)."""
    volume = np.concatenate([m.volume for m in several])
    return np.asarray(volume @ np.concatenate([m.center for m in several]) / volume.sum())


def _bound_ring(ring: Eyelet) -> Candidates:
    """Return a member as thick as the whole ring is wide, of which struts keep clear."""
    reach = ring.ring_mm + ring.wire_mm
    beside = ring.through * ring.wire_mm
    none = np.array([GROUND])
    return Candidates(
        none, none, (ring.middle - beside)[None], (ring.middle + beside)[None], np.array([reach])
    )


def _ring_bars(ring: Eyelet) -> Candidates:
    """Return bars along the ring, for its shadow."""
    across = np.cross(UP, ring.through)
    turn = np.linspace(0.0, 2 * np.pi, 9)[:, None]
    at = ring.middle + ring.ring_mm * (np.cos(turn) * UP + np.sin(turn) * across)
    none = np.full(8, GROUND)
    return Candidates(none, none, at[:-1], at[1:], np.full(8, ring.wire_mm))


def _centre_eyelet(posts: Candidates, ring: Eyelet, middle: Array) -> tuple[Candidates, Eyelet]:
    """Move eyelet and posts so that the eyelet is straight above the centre of mass `middle`.

    All posts end where the first one meets the ring.
    """
    at = np.array([middle[0], ring.middle[1], middle[2]])
    axis = (at - posts.start[0]) / np.linalg.norm(at - posts.start[0])
    level = np.cross(axis, UP)
    # the post must lie in the ring's plane; a post that stands upright does so in any
    through = level / np.linalg.norm(level) if np.linalg.norm(level) > 0.05 else ring.through
    ring = replace(ring, middle=at, through=through)
    return replace(posts, end=np.tile(at - ring.ring_mm * axis, (len(posts), 1))), ring


def _has_room(obstacles: Obstacles, *rings: Eyelet) -> Mask:
    """Tell (n,) whether no strand is near the ring or in the thread's way above it."""
    tube, points = obstacles.tube, obstacles.points
    free = np.ones(len(rings), dtype=bool)
    for n, ring in enumerate(rings):
        off = points - ring.middle
        near = np.linalg.norm(off, axis=1)
        level = np.hypot(off[:, 0], off[:, 2])
        reach = tube + obstacles.clearance + obstacles.slack
        free[n] = near.min() >= reach + ring.ring_mm + ring.wire_mm
        free[n] &= not ((level < reach + 0.5 * THREAD_MM) & (off[:, 1] > 0)).any()
    return free


def _choose_post(
    knots: Knots,
    sites: Sites,
    middle: Array,
    ring: Eyelet,
    radius: float,
    obstacles: Obstacles,
    shadows: MountShadows,
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
    for n in np.flatnonzero(_has_room(obstacles, *rings)):
        along = rings[n].middle - sites.point
        length = np.linalg.norm(along, axis=1)
        square = np.abs(np.einsum("ij,ij->i", along, sites.tangent)) <= MOST_COSINE * length
        some = np.flatnonzero(square & (length >= ring.ring_mm + ring.wire_mm + knots.radius_mm))
        end = rings[n].middle - ring.ring_mm * along[some] / length[some, None]
        ground = np.full(len(some), GROUND)
        start, thick = sites.point[some], np.full(len(some), radius)
        parts.append(Candidates(some, ground, start, end, thick))
        at.append(np.full(len(some), n))
    every, number = join_members(parts), np.concatenate(at)
    if not len(every):
        raise _no_place()
    shown = np.array([shadows.cost(_ring_bars(one)).sum() for one in rings])
    cost = shadows.cost(every) + shown[number] + LENGTH_WEIGHT * every.length_mm
    order = np.argsort(cost, kind="stable")[:_TRIED]
    clear = obstacles.clear(every.of(order))
    if not clear.any():
        raise _no_place()
    best = int(order[clear.argmax()])
    return _centre_eyelet(every.of([best]), rings[number[best]], middle)


def _add_posts(
    knots: Knots,
    sites: Sites,
    joints: Candidates,
    post: Candidates,
    ring: Eyelet,
    stiffness: Stiffness,
    obstacles: Obstacles,
    shadows: MountShadows,
    fewest: int,
) -> Candidates:
    """Add posts from elsewhere to where the first meets the ring, as long as they help.

    A single strand that carries all the weight yields under it. At least `fewest` posts are
    returned, if they have room.
    """
    end, tube = post.end[0], knots.radius_mm
    along = end - sites.point
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    # a share of a further post's length, by which it may come down to the eyelet
    from_below = along[:, 1] >= -0.3 * length
    square = np.abs(np.einsum("ij,ij->i", along, sites.tangent)) <= MOST_COSINE * length
    some = np.flatnonzero(from_below & square & (length >= ring.ring_mm + ring.wire_mm + tube))
    pool = Candidates(
        some,
        np.full(len(some), GROUND),
        sites.point[some],
        np.tile(end, (len(some), 1)),
        np.full(len(some), post.radius[0]),
    )
    pool = pool.of(obstacles.clear(pool))
    away = (pool.start - end) / pool.length_mm[:, None]

    held = HeldFrame(piece_frame(knots, sites, join_members([joints, post]), stiffness))

    def springs(some: Candidates) -> tuple[Array, Array]:
        return springs_of(some, np.zeros(len(some)), stiffness)

    def sag(moved: Array) -> float:
        moves = _let_swing(sites.point, moved[: len(sites.knot), :3], ring.thread)
        return worst_of(moves, sites.point)[0]

    posts, more = post, post.of([])
    held.hold(more, *springs(more))
    least = sag(held.displacements())
    while len(posts) < MOST_POSTS and least > stiffness.max_sag_mm:
        there = (posts.start - end) / posts.length_mm[:, None]
        parted = (away @ there.T).max(axis=1) <= 0.7  # cosine between posts that meet
        open_ones = pool.of(parted)
        cost = shadows.cost(open_ones) + LENGTH_WEIGHT * open_ones.length_mm
        spread: list[int] = []
        for n in np.argsort(cost, kind="stable").tolist():
            off = np.linalg.norm(open_ones.start[spread] - open_ones.start[n], axis=1)
            if (off >= _SPREAD_RADII * tube).all():
                spread.append(n)
            if len(spread) == _WEIGHED:
                break
        tried = open_ones.of(spread)
        sags = [sag(moved) for moved in held.displacements_with_each(tried, *springs(tried))]
        # a further post must leave at most this share of the sag before
        if not sags or (len(posts) >= fewest and min(sags) > 0.9 * least):
            break
        least = min(sags)
        one = tried.of([sags.index(least)])
        posts, more = join_members([posts, one]), join_members([more, one])
        held.hold(more, *springs(more))
    return posts


def hang_bodies(tubes: list[Mesh], mount: HangMount) -> list[Mesh]:
    """Unite tubes, struts, post and eyelet to one watertight body, in scene coordinates."""
    handles = len(mount.members) + 1  # the eyelet's hole
    return unite(tubes, hang_fixtures(mount), handles, "the hanger")


def hang_fixtures(mount: HangMount) -> list[Fixture]:
    """List struts, posts and eyelet as fixtures, in scene coordinates."""
    members, ring = mount.members, mount.eyelet
    ends = zip(members.start, members.end, members.radius, strict=True)
    bars = [strut(start, end, float(radius)) for start, end, radius in ends]
    motion = motion_along(ring.through, ring.middle)
    return [*bars, Fixture("eyelet", eyelet, (ring.ring_mm, ring.wire_mm), motion)]
