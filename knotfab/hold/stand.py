"""A stand for a desk: a base below all pictures, posts into their shadow, hidden struts.

Matter behind what is dark in every view, or below every view's frame, changes no picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.hold.beams import Stiffness, sag_moves, worst_of
from knotfab.hold.planner import MemberHolder, plan_members
from knotfab.hold.plinth import (
    CHAMFER_MM,
    CORNER_MM,
    EDGE_MM,
    HUNG,
    WALL_GAP_MM,
    Base,
    Masses,
    Rectangle,
    Slope,
    base_for,
    slope_below,
)
from knotfab.hold.shade import MountShadows, hidden_struts
from knotfab.hold.struts import (
    GROUND,
    ROOT_SHARE,
    Candidates,
    Obstacles,
    Sites,
    join_members,
    list_struts,
    no_members,
    sites_of,
)
from knotfab.knots import Knots
from knotfab.scene.camera import Camera

VISIBLE_SHARES = (0.6, 0.8)  # radii over the tube's: thin members show less, thick ones hold more
MOST_COSINE = 0.75  # between a post and its tube
# how far the base's top lies below the light's view of the frame, so that roots stay out of it
DROP_MM = 4.0
LEAN = (0.0, -0.2, 0.2, -0.4, 0.4)  # a post's lean, across and along the view: per mm of its height
LEAST_POSTS = 3  # fewer would let a push turn the piece about one of them
APART_RADII = 5.0  # between their feet
STRETCHES = 50  # stretches of about equal length along the tubes
BRIDGES = 200  # visible struts between two knots, likewise
FINE_RADII = 0.5  # between the joints of the frame that is the second opinion
COARSE = 24  # samples of a member whose cost is first guessed
# share of its sides by which a base about the strands of a start may be too near: a search moves them so far
START_PLAY = 0.005
LENGTH_WEIGHT = 0.02  # pixels: among members that show equally little the shortest is taken


@dataclass(frozen=True)
class StandSettings:
    """Settings of a stand: `base_thickness_mm` at the back, the `tip_deg` from which the part must still
    come back, and the least radius of a member that the printer can make."""

    base_thickness_mm: float
    tip_deg: float
    min_radius_mm: float


@dataclass(frozen=True, kw_only=True)
class StandMount(MemberHolder):
    """A stand in scene coordinates, whose posts end on the base."""

    base: Base


def plan_stand(
    knots: Knots,
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
    clearance_mm: float,
    stiffness: Stiffness,
    settings: StandSettings,
    ends: bool = False,
    *,
    thoroughly: bool = True,
) -> StandMount:
    """Choose posts, struts and a base for knots in scene coordinates (gravity: -y).

    First every knot is joined to the base through as few lit pixels as possible, by Prim's spanning
    tree: a member costs nothing where earlier ones have darkened the picture. Then members are
    added until nothing sags (`plan_members`), and the base is made as large as the piece needs to
    stay upright.

    Args:
        cameras, targets: each view's camera, and its picture's silhouette (H, W) over the whole
            frame.
        ends: whether screens end at their frames, beside which no shadow is seen.
        thoroughly: whether to keep it from sagging, and the base off the wall to the last millimetre. If not,
            the knots are those that a search begins with, and what matters is whether there is room.

    Raises:
        SceneError: a knot cannot be reached, a wall is too near for the base, or a light looks down too
            steeply.
    """
    tube = knots.radius_mm
    thin, thick = (max(s * tube, min(settings.min_radius_mm, tube)) for s in VISIBLE_SHARES)
    sites = sites_of(knots)
    shadows = MountShadows(knots, cameras, targets, ends)
    obstacles = Obstacles(knots, sites, clearance_mm)
    footprint = _footprint(knots, cameras, settings)
    slope = slope_below(cameras, footprint).no_fall(footprint[3]).lower(DROP_MM)
    lowest = float(slope.above(knots.points).min()) - tube * np.hypot(1.0, slope.rise)
    slope = slope.lower(max(0.0, clearance_mm + 1.0 - lowest))
    hidden = hidden_struts(sites, shadows, tube)

    def shown(*radii: float) -> list[Candidates]:
        parts = []
        for radius in radii:
            parts.append(_list_posts(sites, slope, cameras, shadows, radius))
            parts.append(list_bridges(sites, shadows, tube, radius))
        return parts

    pool = join_members([hidden, *shown(thin)])
    chosen, holds = join_knots(len(knots.knots), sites, pool, obstacles, shadows)
    # a member in the shadow of the chosen ones shows no more now
    pool = join_members([hidden, *shown(thin, thick)])
    more = _add_posts(chosen, pool, obstacles, shadows, APART_RADII * tube)
    holds = np.concatenate([holds, sites.knot[more.first]])
    chosen = join_members([chosen, more])
    members = chosen
    if thoroughly:
        how = pool, np.arange(len(pool)) >= len(hidden), chosen, stiffness
        members = plan_members(knots, sites, obstacles, shadows, *how).members
    post = members.second == GROUND
    base = base_for(
        slope,
        members.end[post],
        ROOT_SHARE * float(members.radius[post].max()),
        masses_of(knots, members),
        cameras,
        settings.base_thickness_mm,
        settings.tip_deg,
        0.0 if thoroughly else START_PLAY,
    )
    moves = sag_moves(knots, sites, members, stiffness, step_radii=FINE_RADII)
    sag, at = worst_of(moves, knots.points)
    return StandMount(
        members=members,
        holds=np.concatenate([holds, sites.knot[members.first[len(chosen) :]]]),
        base=base,
        sag_mm=sag,
        sag_at=at,
        predicted_intrusion=shadows.darken(members),
        moves=moves,
    )


def _footprint(knots: Knots, cameras: Sequence[Camera], settings: StandSettings) -> Rectangle:
    """Bound the area that a base may cover: below the piece, and more to keep it from tipping."""
    axes = slope_below(cameras).axes
    own = knots.points @ axes.T
    low, high = own.min(axis=0) - 2 * CORNER_MM, own.max(axis=0) + 2 * CORNER_MM
    below = slope_below(cameras, (low[0], high[0], low[2], high[2]))
    least = float((below.height_mm + below.rise * own[:, 2]).min()) - DROP_MM
    tubes = masses_of(knots, no_members())
    middle = tubes.volume @ tubes.center @ axes.T / tubes.volume.sum()
    # posts and base, which are lower, only lower the middle of all mass
    tall = float(middle[1]) - least + settings.base_thickness_mm
    need = tall * float(np.tan(np.deg2rad(settings.tip_deg))) + CORNER_MM
    low, high = np.minimum(low, middle - need), np.maximum(high, middle + need)
    return float(low[0]), float(high[0]), float(low[2]), float(high[2])


def _list_posts(
    sites: Sites, slope: Slope, cameras: Sequence[Camera], shadows: MountShadows, radius: float
) -> Candidates:
    """List the posts from every site to the base, upright or leaning a little, that show least."""
    right, up, out = slope.axes
    deep = sites.point @ out
    parts = []
    for across in LEAN:
        for along in LEAN:
            axis = -up + across * right + along * out
            # the top is up = height + rise * out
            fall = float(axis @ (up - slope.rise * out))
            foot = sites.point + (slope.above(sites.point) / -fall)[:, None] * axis
            fits = np.abs(sites.tangent @ (axis / np.linalg.norm(axis))) <= MOST_COSINE
            for camera in cameras:
                wall = foot @ camera.receiver[:3] + camera.receiver[3]
                fits &= wall >= ROOT_SHARE * radius + EDGE_MM + CHAMFER_MM + WALL_GAP_MM
                fits &= slope_below([camera]).above(foot) <= -DROP_MM / 2
            # feet outside the piece would make the base deeper
            fits &= (foot @ out >= deep.min()) & (foot @ out <= deep.max())
            n = np.flatnonzero(fits)
            parts.append(
                Candidates(
                    n, np.full(len(n), GROUND), sites.point[n], foot[n], np.full(len(n), radius)
                )
            )
    # candidates that show least: half of all, half of each stretch
    return least_shown(join_members(parts), shadows, 1600, len(sites.knot))


def least_shown(every: Candidates, shadows: MountShadows, count: int, sites: int) -> Candidates:
    """Keep the members that show least, both overall and in each stretch of the tubes."""
    cost = shadows.cost(every, COARSE, (0.0,)) + LENGTH_WEIGHT * every.length_mm
    order = np.argsort(cost, kind="stable")
    stretch = every.first[order] * STRETCHES // sites
    by_stretch = np.argsort(stretch, kind="stable")
    begins = np.searchsorted(stretch[by_stretch], np.arange(STRETCHES))
    rank = np.empty(len(order), dtype=np.int64)
    rank[by_stretch] = np.arange(len(order)) - begins[stretch[by_stretch]]
    kept = (rank < max(1, count // (2 * STRETCHES))) | (np.arange(len(order)) < count // 2)
    return every.take(order[kept])


def list_bridges(sites: Sites, shadows: MountShadows, tube: float, radius: float) -> Candidates:
    """List for each two knots the struts that show least, however much that is."""
    parts = [no_members()]
    for a in range(len(sites.perimeter)):
        for b in range(a):
            one, other = np.flatnonzero(sites.knot == a), np.flatnonzero(sites.knot == b)
            pairs = np.column_stack([np.repeat(one, len(other)), np.tile(other, len(one))])
            parts.append(
                least_shown(
                    list_struts(sites, pairs, tube, radius), shadows, BRIDGES, len(sites.knot)
                )
            )
    return join_members(parts)


def join_knots(
    knots: int,
    sites: Sites,
    candidates: Candidates,
    obstacles: Obstacles,
    shadows: MountShadows,
    root: int | None = None,
) -> tuple[Candidates, Indices]:
    """Join every knot to the ground; return the members and the knot that each was taken for.

    Args:
        root: the knot to which all others are joined instead, where there is no ground.

    Raises:
        SceneError: a knot cannot be reached.
    """
    held = np.zeros(knots + 1, dtype=bool)
    held[GROUND] = True
    if root is not None:
        held[root] = True
    ends = np.stack(
        [
            np.where(site == GROUND, GROUND, sites.knot[site])
            for site in (candidates.first, candidates.second)
        ]
    )
    chosen: list[int] = []
    holds: list[int] = []
    while not held.all():
        links = np.flatnonzero(held[ends[0]] != held[ends[1]])
        some = candidates.take(links)
        cost = shadows.cost(some) + LENGTH_WEIGHT * some.length_mm
        order = links[np.argsort(cost, kind="stable")]
        for begin in range(0, len(order), 64):
            part = order[begin : begin + 64]
            free = obstacles.clear(candidates.take(part))
            if free.any():
                number = int(part[free.argmax()])
                break
        else:
            lost = int(np.flatnonzero(~held[:-1])[0])
            what, member, other = (
                ("stand", "neither a post nor a strut", HUNG)
                if root is None
                else ("hanger", "no strut", "Use --mount none")
            )
            # where some knot is held, a bridge from it holds the others
            fewer = ", or --knots 1" if held[:-1].any() else ""
            why = f"{member} reaches knot {lost} past the other strands"
            raise SceneError(f"the {what}", why, other + fewer)
        one = candidates.take([number])
        obstacles.add(one)
        shadows.add(one)
        chosen.append(number)
        holds.append(int(next(k for k in ends[:, number] if not held[k])))
        held[holds[-1]] = True
    return candidates.take(np.array(chosen, dtype=np.int64)), np.array(holds, dtype=np.int64)


def _add_posts(
    chosen: Candidates,
    pool: Candidates,
    obstacles: Obstacles,
    shadows: MountShadows,
    apart_mm: float,
) -> Candidates:
    """Add posts until there are `LEAST_POSTS`, with their feet apart, where they show least and have room."""
    more = no_members()
    while True:
        there = join_members([chosen, more])
        feet = there.end[there.second == GROUND]
        if len(feet) >= LEAST_POSTS:
            return more
        far = np.linalg.norm(pool.end[:, None] - feet[None], axis=2).min(axis=1) >= apart_mm
        some = pool.take(far & (pool.second == GROUND))
        cost = shadows.cost(some) + LENGTH_WEIGHT * some.length_mm
        some = some.take(np.argsort(cost, kind="stable"))
        clear = obstacles.clear(some)
        if not clear.any():
            return more
        one = some.take([int(clear.argmax())])
        obstacles.add(one)
        shadows.add(one)
        more = join_members([more, one])


def masses_of(knots: Knots, members: Candidates) -> Masses:
    """Return the volume and centre of mass of each tube, post and strut."""
    volume, center = [], []
    for knot in knots.knots:
        after = np.roll(knot.points, -1, axis=0)
        length = np.linalg.norm(after - knot.points, axis=1)
        volume.append(np.pi * knots.radius_mm**2 * length.sum())
        center.append(length @ (knot.points + after) / (2 * length.sum()))
    volume += list(np.pi * members.radius**2 * members.length_mm)
    center += list((members.start + members.end) / 2)
    return Masses(np.array(volume), np.array(center))
