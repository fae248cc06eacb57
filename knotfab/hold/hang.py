"""A hanger: eyelets by which threads carry the piece, so that it hangs level.

Matter in the visual hull of all pictures, or above every frame, changes no picture (Mitra & Pauly
2009): an eyelet stands where it darkens least. One view hangs by two eyelets, as far to one side of
its centre of mass as to the other: two threads keep it from turning. So do several views to which a small
turn does harm; others have one straight above it, on whose thread the piece turns and shows its pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh
from knotfab.hold.beams import (
    Stiffness,
    hold_by_threads,
    piece_frame,
    sag_moves,
    springs_of,
    worst_of,
)
from knotfab.hold.eyelet import (
    UNSUPPORTED,
    UP,
    Bed,
    Eyelet,
    centre_eyelet,
    choose_post,
    draw_thread,
    has_room,
    keep_free,
    list_posts,
    meet_well,
    no_place,
    ring_bars,
)
from knotfab.hold.planner import MemberHolder, plan_members
from knotfab.hold.plinth import Masses
from knotfab.hold.shade import MountShadows, near_struts
from knotfab.hold.solids import Fixture, motion_along, strut, unite
from knotfab.hold.stand import (
    BRIDGES,
    FINE_RADII,
    LENGTH_WEIGHT,
    VISIBLE_SHARES,
    join_knots,
    least_shown,
    list_bridges,
    masses_of,
)
from knotfab.hold.struts import Candidates, Obstacles, Sites, join_members, no_members, sites_of
from knotfab.knots import Knots
from knotfab.picture.silhouette import fit_size, mask_iou, sample_mask
from knotfab.render.silhouette import cast, frame_of
from knotfab.scene.camera import Camera
from knotfab_fixtures.holders import eyelet

MOST_TILT_DEG = 1.0  # the piece may hang askew by this
HOLE_MM = 3.0  # across the eyelet's hole
SPANS = (0.7, 0.55, 0.4, 0.3)  # shares of the piece's width between two threads that are tried
LEAST_SPAN_MM = 15.0  # threads that are nearer to each other hardly keep a piece from turning
# loss of IoU by a turn of 1 degree, from which on two threads keep a piece from turning
TURN_LOSS = 0.005
# share of the tube's radius that posts have which stand alone while they print, and their rings' wire
_STANDING_SHARE = 0.85
MOST_POSTS = 4  # posts from strands to an eyelet
# between the ends of further posts that are weighed, and how many are
_SPREAD_RADII, _WEIGHED = 6.0, 12
# each about the centre of mass of the one before, with a post more where that sags too much
_PLANS = 4
# times the allowed sag: where every strut that helps leaves more, no further post is tried
_HOPELESS = 2.0
# share of a frame up to which a pair lies in all pictures' shadows, or beside them
_UNSEEN = 0.0001
_DARKER = 0.001  # share of a frame that two threads may darken beyond what one does
_TURNED_PX = 512  # longer side of the frame in which a turned piece is compared
_ROUNDS = 4  # rounds of moving the eyelets by the centre of mass, to which posts and eyelets add


@dataclass(frozen=True, kw_only=True)
class HangMount(MemberHolder):
    """A hanger in the scene; its posts lead to its eyelets. The piece hangs askew by `tilt_deg`."""

    eyelets: tuple[Eyelet, ...]
    tilt_deg: float

    @property
    def threads(self) -> Array:
        """Where threads carry the piece, (1 or 2, 3)."""
        return np.array([ring.thread for ring in self.eyelets])


def begin_hang(
    knots: Knots,
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
    clearance_mm: float,
    stiffness: Stiffness,
    least_radius_mm: float,
    ends: bool = False,
    bed: Bed | None = None,
) -> Hanger:
    """Join knots in scene coordinates (gravity: -y) to one piece, so that it can be hung.

    Args:
        cameras, targets: each view's camera, and its picture's silhouette (H, W) over the whole frame.
        least_radius_mm: of a member that the printer can make.
        ends: whether screens end at their frames, beside which no shadow is seen.
        bed: where it prints without supports: every member rises from a strand, and an eyelet stands on its
            posts, as high as the centre of mass. One flat on the bed would let the piece tip.

    Raises:
        SceneError: a knot cannot be reached.
    """
    tube = knots.radius_mm
    # what stands alone while it prints is thicker
    share = VISIBLE_SHARES[0] if bed is None else _STANDING_SHARE
    thin = max(share * tube, min(least_radius_mm, tube))
    sites = sites_of(knots)
    shadows = MountShadows(knots, cameras, targets, ends)
    obstacles = Obstacles(knots, sites, clearance_mm)
    near = near_struts(sites, tube)
    unseen = shadows.hidden(near)
    seen = least_shown(near.take(~unseen), shadows, BRIDGES, len(sites.knot))
    pool = join_members([near.take(unseen), seen, list_bridges(sites, shadows, tube, thin)])
    visible = np.arange(len(pool)) >= unseen.sum()
    if bed is not None:
        obstacles.add(bed.blocks)
        carried = bed.carries(pool)
        pool, visible = pool.take(carried), visible[carried]
    longest = int(np.argmax(sites.perimeter))
    try:
        joints, holds = join_knots(len(knots.knots), sites, pool, obstacles, shadows, root=longest)
    except SceneError as error:
        if bed is None:
            raise
        raise SceneError(
            "a piece of several knots on threads, without supports",
            "no strut rises from one knot to the next so steeply that it prints",
            UNSUPPORTED,
        ) from error
    wire = max(thin, least_radius_mm)
    blank = Eyelet(np.zeros(3), cameras[0].level_axes[0], 0.5 * HOLE_MM + wire, wire)
    return Hanger(
        knots,
        tuple(cameras),
        tuple(targets),
        sites,
        joints,
        holds,
        obstacles,
        shadows,
        pool,
        visible,
        stiffness,
        thin,
        blank,
        bed,
    )


def lost_by_turning(knots: Knots, cameras: Sequence[Camera], targets: Sequence[Mask]) -> float:
    """Return the IoU that a turn by 1 degree about the vertical costs the picture that it costs most."""
    middle, ahead = knots.points.mean(axis=0), knots.rings.next
    lost = []
    for camera, target in zip(cameras, targets, strict=True):
        width, height = fit_size(camera.width, camera.height, _TURNED_PX)
        frame = frame_of(camera.resized(width, height), np.float32, stretched=True)
        mask = sample_mask(target, width, height)
        iou = []
        for turn in np.radians([0.0, -1.0, 1.0]):
            about = np.array(
                [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
            )
            points = middle + (knots.points - middle) @ about.T
            shadow = cast(points, points[ahead], frame, knots.radius_mm)
            iou.append(mask_iou(mask, shadow) if mask.any() else 0.0)
        lost.append(iou[0] - 0.5 * (iou[1] + iou[2]))
    return float(max(lost))


@dataclass(frozen=True)
class Hanger:
    """What every way of hanging a piece starts from: its knots joined to one, and what may stiffen it."""

    knots: Knots
    cameras: tuple[Camera, ...]
    targets: tuple[Mask, ...]
    sites: Sites
    joints: Candidates
    holds: Indices
    obstacles: Obstacles
    shadows: MountShadows
    pool: Candidates
    visible: Mask
    stiffness: Stiffness
    thin: float
    blank: Eyelet
    bed: Bed | None

    @property
    def middle(self) -> Array:
        return _centre_of_mass(masses_of(self.knots, self.joints))

    def plan_best(self) -> HangMount:
        """Choose struts, posts and eyelets.

        Two eyelets are tried where the piece must not turn, the pair that shows least first, and one where no
        two hold it. For several pictures pairs are tried until one lies in the shadow of all of them, or
        beside them; where none does, the one that darkens least is taken.

        Raises:
            SceneError: no eyelet has a place.
        """
        found, most, one_view = list[HangMount](), self.stiffness.max_sag_mm, len(self.cameras) == 1
        seen = self.knots, self.cameras, self.targets
        fixed = one_view or lost_by_turning(*seen) >= TURN_LOSS
        for offsets in self.list_pairs() if fixed else []:
            try:
                found.append(self.plan(offsets))
            except SceneError:
                continue
            if found[-1].sag_mm <= most:
                if one_view:
                    return found[-1]
                if found[-1].predicted_intrusion.max() <= _UNSEEN:
                    break
        steady = [one for one in found if one.sag_mm <= most]
        try:
            single = self.plan(np.zeros((1, 3)))
            if steady:
                pair = min(steady, key=lambda one: float(one.predicted_intrusion.max()))
                darker = pair.predicted_intrusion.max() - single.predicted_intrusion.max()
                return pair if darker <= _DARKER else single
            if single.sag_mm <= most or not found:
                return single
        except SceneError:
            if not found:
                raise
        return min(found, key=lambda one: one.sag_mm)

    def list_pairs(self) -> list[Array]:
        """List offsets (2, 3) of two eyelets from the centre of mass, mm; pairs that show least first."""
        across, found = self.blank.through, list[tuple[float, Array]]()
        width = float(np.ptp(self.knots.points @ across))
        for share in SPANS:
            if share * width < LEAST_SPAN_MM:
                break
            offsets = 0.5 * share * width * np.array([-across, across])
            try:
                posts, rings = self.choose(self.middle, offsets)
            except SceneError:
                continue
            bars = join_members([*posts, *map(ring_bars, rings)])
            found.append((float(self.shadows.darken(bars).sum()), offsets))
        return [offsets for _, offsets in sorted(found, key=lambda one: one[0])]

    def require_place(self) -> None:
        """Refuse knots about which no eyelet has a place, neither alone nor as one of two.

        Raises:
            SceneError: none has.
        """
        try:
            self.choose(self.middle, np.zeros((1, 3)))
        except SceneError:
            if not self.list_pairs():
                raise

    def choose(self, middle: Array, offsets: Array) -> tuple[list[Candidates], list[Eyelet]]:
        """Choose an eyelet and its first post for each offset (k, 3) from the centre of mass.

        Raises:
            SceneError: one has no place.
        """
        way, dark = copy(self.obstacles), self.shadows.twin()
        posts, rings = list[Candidates](), list[Eyelet]()
        for at in middle + offsets:
            how = self.blank, self.thin, way, dark, self.bed
            post, ring = choose_post(self.knots, self.sites, at, *how)
            posts, rings = [*posts, post], [*rings, ring]
            way.add(join_members([post, keep_free(ring)]))
            dark.add(join_members([post, ring_bars(ring)]))
        return posts, rings

    def plan(self, offsets: Array) -> HangMount:
        """Plan with an eyelet at each offset (k, 3) from above the centre of mass.

        Each goes where post and ring show least; struts are added until nothing sags
        (`plan_members`); then the eyelets are moved by the new centre of mass. If one meets something
        there, or the piece still sags, this is repeated.

        Raises:
            SceneError: an eyelet has no place.
        """
        knots, sites, number = self.knots, self.sites, len(self.joints)
        limit = self.stiffness.max_sag_mm
        best: HangMount | None = None
        middle, fewest, firm, begun = self.middle, 1, self.stiffness, list[int]()
        for _ in range(_PLANS):
            first, rings = self.choose(middle, offsets)
            posts = self._add_posts(first, rings, firm, fewest)
            way, dark = copy(self.obstacles), self.shadows.twin()
            way.add(join_members([*posts, *map(keep_free, rings)]))
            dark.add(join_members([*posts, *map(ring_bars, rings)]))
            given, settings = join_members([self.joints, *posts]), (self.pool, self.visible)
            hold = hold_by_threads if len(rings) > 1 else None
            swing = partial(let_swing, sites.point, threads=np.array([r.thread for r in rings]))
            planned = plan_members(
                knots, sites, way, dark, *settings, given, firm, begun=begun, hold=hold, swing=swing
            )
            members, begun = planned.members, planned.taken.tolist()
            struts = members.take(np.r_[:number, len(given) : len(members)])
            # those that were thickened are found where they were given
            ends = number + np.cumsum([0, *map(len, posts)])
            posts = [members.take(np.arange(a, b)) for a, b in pairwise(ends)]
            for _ in range(_ROUNDS):
                masses = masses_of(knots, join_members([struts, *posts]))
                middle = _centre_of_mass(masses, *(ring.masses for ring in rings))
                moved = [
                    centre_eyelet(post, ring, middle + by, self.bed)
                    for post, ring, by in zip(posts, rings, offsets, strict=True)
                ]
                posts, rings = [post for post, _ in moved], [ring for _, ring in moved]
            if not self._is_clear(struts, posts, rings):
                continue  # planned again, about the centre of mass that came out
            members = join_members([struts, *posts])
            middle = _centre_of_mass(masses_of(knots, members), *(r.masses for r in rings))
            threads = np.array([ring.thread for ring in rings])
            moves = sag_moves(knots, sites, members, self.stiffness, FINE_RADII, hold)
            moves = let_swing(knots.points, moves, threads)
            sag, at = worst_of(moves, knots.points)
            held = np.concatenate([self.holds, sites.knot[members.first[number:]]])
            if best is None or sag < best.sag_mm:
                bars = join_members([members, *map(ring_bars, rings)])
                best = HangMount(
                    members=members,
                    holds=held,
                    eyelets=tuple(rings),
                    tilt_deg=_tilt_deg(threads, middle),
                    sag_mm=sag,
                    sag_at=at,
                    predicted_intrusion=self.shadows.darken(bars),
                    moves=moves,
                )
            if sag <= limit or planned.sag_mm > _HOPELESS * limit:
                break
            fewest = min(max(map(len, posts)) + 1, MOST_POSTS)
            # by a finer frame it may sag more than by the plan's
            firm = replace(firm, max_sag_mm=firm.max_sag_mm * min(1.0, planned.sag_mm / sag))
        if best is None:
            raise no_place(self.bed)
        return best

    def _is_clear(self, struts: Candidates, posts: list[Candidates], rings: list[Eyelet]) -> bool:
        """Return whether posts, rings and threads still touch nothing where they were moved to."""
        if self.bed is not None:
            struts = join_members([self.bed.blocks, struts])
        for k, ring in enumerate(rings):
            apart = copy(self.obstacles)
            apart.members = join_members(
                [struts, *posts[:k], *posts[k + 1 :], *map(keep_free, rings[:k] + rings[k + 1 :])]
            )
            clear = apart.clear(join_members([posts[k], draw_thread(ring)])).all()
            clear &= meet_well(posts[k], ring, apart.clearance).all()
            if not (clear and has_room(apart, ring)[0]):
                return False
        return True

    def _add_posts(
        self, first: list[Candidates], rings: list[Eyelet], stiffness: Stiffness, fewest: int
    ) -> list[Candidates]:
        """Add posts from elsewhere to where the first of an eyelet meets its ring, as long as they help.

        A single strand that carried all the weight would yield. One of the eyelets gets at least `fewest`
        posts, if they have room.
        """
        sites, tube = self.sites, self.knots.radius_mm
        pools = []
        for k, (post, ring) in enumerate(zip(first, rings, strict=True)):
            way = copy(self.obstacles)
            others = [*first[:k], *first[k + 1 :], *map(keep_free, rings[:k] + rings[k + 1 :])]
            way.add(join_members([no_members(), *others]))
            pool = list_posts(sites, post, ring.ring_mm + ring.wire_mm + tube, self.bed)
            free = way.clear(pool) & meet_well(pool, ring, way.clearance)
            pools.append(pool.take(free))
        pool = join_members(pools)
        owner = np.repeat(np.arange(len(rings)), [len(one) for one in pools])
        away = (pool.start - pool.end) / pool.length_mm[:, None]
        threads = np.array([ring.thread for ring in rings])
        hold = hold_by_threads if len(rings) > 1 else None
        given = join_members([self.joints, *first])
        held = piece_frame(self.knots, sites, given, stiffness, hold)

        def springs(some: Candidates) -> tuple[Array, Array]:
            return springs_of(some, np.zeros(len(some)), stiffness)

        def sag(moved: Array) -> float:
            moves = let_swing(sites.point, moved[: len(sites.knot), :3], threads)
            return worst_of(moves, sites.point)[0]

        posts, more = list(first), no_members()
        held.hold(more, *springs(more))
        least = sag(held.displacements())
        while least > stiffness.max_sag_mm:
            parted = np.zeros(len(pool), dtype=bool)
            for k, own in enumerate(posts):
                there = (own.start - own.end) / own.length_mm[:, None]
                # cosine between posts that meet
                apart = (away @ there.T).max(axis=1) <= 0.7
                parted |= (owner == k) & apart & (len(own) < MOST_POSTS)
            numbers = np.flatnonzero(parted)
            spread = self._spread(pool.take(numbers))
            tried = pool.take(numbers[spread])
            sags = [sag(moved) for moved in held.displacements_with_each(tried, *springs(tried))]
            enough = max(map(len, posts)) >= fewest
            # a further post must leave at most this share of the sag before
            if not sags or (enough and min(sags) > 0.9 * least):
                break
            least = min(sags)
            pick = sags.index(least)
            k, one = int(owner[numbers[spread[pick]]]), tried.take([pick])
            posts[k], more = join_members([posts[k], one]), join_members([more, one])
            held.hold(more, *springs(more))
        return posts

    def _spread(self, some: Candidates) -> list[int]:
        """Pick posts that show little and begin well apart."""
        cost = self.shadows.cost(some) + LENGTH_WEIGHT * some.length_mm
        spread: list[int] = []
        for n in np.argsort(cost, kind="stable").tolist():
            off = np.linalg.norm(some.start[spread] - some.start[n], axis=1)
            if (off >= _SPREAD_RADII * self.knots.radius_mm).all():
                spread.append(n)
            if len(spread) == _WEIGHED:
                break
        return spread


def let_swing(points: Array, moves: Array, threads: Array) -> Array:
    """Turn the moves of a piece held at its threads (1 or 2, 3) into those of one free to swing.

    A piece that sags to one side turns until its centre of mass is below the thread again: by the two
    small angles about level axes that take the mean of the moves back to the plumb line. Below two threads
    it only swings about the line through both.

    Args:
        moves: (..., N, 3), or with turns (..., N, 6), at `points` (N, 3).
    """
    lever = points - threads.mean(axis=0)
    drop, aside = -float(lever[:, 1].mean()), moves[..., :3].mean(axis=-2, keepdims=True)
    turn = np.cross(UP, aside) / drop
    if len(threads) > 1:
        line = _level_line(threads)
        turn = (turn @ line)[..., None] * line
    swung = np.cross(turn, lever)
    both = np.concatenate([swung, np.broadcast_to(turn, swung.shape)], axis=-1)
    return np.asarray(moves + both[..., : moves.shape[-1]])


def _level_line(threads: Array) -> Array:
    """Return the level unit vector (3,) from the first of two threads to the second."""
    line = (threads[1] - threads[0]) * (1 - UP)
    return np.asarray(line / np.linalg.norm(line))


def _tilt_deg(threads: Array, middle: Array) -> float:
    """Measure how far askew a piece hangs whose centre of mass is `middle` (3,)."""
    off = threads.mean(axis=0) - middle
    level = off * (1 - UP)
    if len(threads) > 1:
        line = _level_line(threads)
        level = level - (level @ line) * line
    return float(np.degrees(np.arctan2(np.linalg.norm(level), off[1])))


def _centre_of_mass(*several: Masses) -> Array:
    """Return the common centre of mass, (3,)."""
    volume = np.concatenate([m.volume for m in several])
    return np.asarray(volume @ np.concatenate([m.center for m in several]) / volume.sum())


def hang_bodies(tubes: list[Mesh], mount: HangMount) -> list[Mesh]:
    """Unite tubes, struts, posts and eyelets to one watertight body, in scene coordinates."""
    # an eyelet has a hole of its own; a second one is a body more, which its hole makes up for
    return unite(tubes, hang_fixtures(mount), len(mount.members) + 1, "the hanger")


def hang_fixtures(mount: HangMount) -> list[Fixture]:
    """List struts, posts and eyelets as fixtures, in scene coordinates."""
    members = mount.members
    ends = zip(members.start, members.end, members.radius, strict=True)
    bars = [strut(start, end, float(radius)) for start, end, radius in ends]
    rings = [
        Fixture("eyelet", eyelet, (r.ring_mm, r.wire_mm), motion_along(r.through, r.middle))
        for r in mount.eyelets
    ]
    return [*bars, *rings]
