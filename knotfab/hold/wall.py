"""A wall mount: pegs along light rays, hidden in the tube's own shadow, on a plate or in drilled holes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh, as_manifold
from knotfab.hold.beams import Holder, Stiffness, sag_moves, worst_of
from knotfab.hold.foot_plate import FootPlate, foot_plate_fixture
from knotfab.hold.pegs import Pegs, choose_pegs, hidden_braces, pegs_on, sites_with, tie_to_held
from knotfab.hold.shade import MountShadows, Rays, free_rays
from knotfab.hold.solids import Fixture, fuse, motion_along, strut
from knotfab.hold.struts import GROUND, Candidates, Obstacles, Sites, join_members, no_members
from knotfab.knots import Knots
from knotfab.scene.camera import Camera
from knotfab_fixtures.solids import ARROW_MARKS, dowel, wall_plate
from knotfab_fixtures.solids import peg as peg_mesh
from knotfab_formats.piece import Mount

# shares of the tube's shadow that a peg fills: thick ones are stiff, thin ones pass between more strands
PEG_SHARES = (0.95, 0.85, 0.75, 0.6)
THIN_SHARES = (0.5, 0.4)  # shares for a knot alone that bars all thicker pegs itself
ROOT_SHARE = 0.1  # the filleted root is wider by this share
MOST_SHARE = 0.98
HOPELESS = 4.0  # factor of the limit from which on thinner pegs do not take away so much
ROOT_HEIGHT_MM = 3.0  # a peg widens to its root over so much
MARK_MM = 1.5  # depth of the notches in the plate's edges
PLAY_MM = 0.3  # a hole is so much wider than its dowel
DRILLS_MM = (*(0.5 * k for k in range(2, 14)), 7.0, 8.0, 9.0, 10.0, 12.0)  # bits that shops sell
OVERLAP_MM = 0.3  # a peg goes so far into its plate or dowel, beyond what its slant needs


class NotHeldError(SceneError):
    """None of the pegs that were tried hold the piece where it is."""


def hole_inset_mm(asked: Mount) -> float:
    """Return the distance from a plate's left and right edge to the middle of a screw hole."""
    return asked.plate_margin_mm / 2 + asked.hole_diameter_mm / 4


def mark_depth_mm(asked: Mount) -> float:
    """Return the depth of the notches in a plate's edges; 0 if its margin has no room."""
    beside = (hole_inset_mm(asked) - asked.hole_diameter_mm / 2) / 2
    deep = min(MARK_MM, asked.plate_margin_mm / 5, beside)
    return deep if deep >= 0.5 else 0.0  # a plate gets no notches where no deeper ones have room


@dataclass(frozen=True)
class Peg:
    """One peg: its knot, its ends (scene, mm) and its radii at the tube, the wall and the root."""

    knot: int
    top: Array
    foot: Array
    top_radius_mm: float
    foot_radius_mm: float
    root_radius_mm: float

    @property
    def length_mm(self) -> float:
        return float(np.linalg.norm(self.top - self.foot))

    @property
    def drill_mm(self) -> float:
        """The drill for the peg's hole: the largest one sold whose dowel still leaves the peg a shoulder."""
        wide = 2 * self.foot_radius_mm + PLAY_MM
        return max((d for d in DRILLS_MM if d <= wide), default=wide)

    @property
    def dowel_radius_mm(self) -> float:
        """The radius of what goes into the wall."""
        return 0.5 * (self.drill_mm - PLAY_MM)


@dataclass(frozen=True, kw_only=True)
class WallMount(Holder):
    """Pegs (leaning ones last), and struts between strands.

    `strut_knots` (n, 2) are the knots that each strut joins, often one and the same. On a
    `plate` in which the piece stands by its own valleys there are neither pegs nor struts.
    """

    pegs: tuple[Peg, ...]
    settings: Mount
    struts: Candidates = field(default_factory=no_members)
    strut_knots: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    plate: FootPlate | None = None

    def dowels(self, peg: Peg, wall: Array | None) -> list[Fixture]:
        """Make the dowel of a peg, if it has one; `wall` (3, 3) has rows as `Camera.wall_axes`."""
        if self.settings.foot == "plate" or wall is None:
            return []
        return _peg_fixtures(peg, wall.T, self.settings)[1:]


def plan_wall(
    knots: Knots,
    camera: Camera,
    clearance_mm: float,
    stiffness: Stiffness,
    settings: Mount,
    target: Mask | None = None,
    *,
    thoroughly: bool = True,
) -> WallMount:
    """Choose pegs for knots in scene coordinates (design, section 8), and struts if need be.

    A knot that other strands bar from the wall hangs on one of them by a strut. Struts join strands
    and so need a plate: on dowels every knot is a body that can be split.

    Args:
        settings: what the scene asks of its mount, with its foot chosen.
        target: (H, W) the picture's silhouette; None: nothing but the knots hides struts.
        thoroughly: whether to try all that may help, and accept the sag that is left. Otherwise, where the
            piece could be moved instead, what takes long and hardly helps is left out.

    Raises:
        NotHeldError: a knot has no free ray to the wall, and nothing to hang on; or, unless `thoroughly`,
            it sags too much.
    """
    best: WallMount | None = None
    remedy = "Use --mount none" + (", or --knots 1" if len(knots.knots) > 1 else "")
    if settings.foot != "plate":
        remedy += ', or a plate (mount.foot = "plate"), on which knots may hang from each other'
    for share in PEG_SHARES if thoroughly else PEG_SHARES[:1]:
        try:
            found = _plan_with_share(
                share, knots, camera, clearance_mm, stiffness, settings, target, thoroughly
            )
        except ValueError as error:  # a thinner one has no room either
            raise NotHeldError("the wall mount", str(error), remedy) from error
        if best is None or found.sag_mm < best.sag_mm:
            best = found
        if not stiffness.max_sag_mm < best.sag_mm <= HOPELESS * stiffness.max_sag_mm:
            break
    assert best is not None
    if not thoroughly and best.sag_mm > stiffness.max_sag_mm:
        sag, limit = best.sag_mm, stiffness.max_sag_mm
        why = f"it sags by {sag:.2f} mm on its pegs ({limit:g} allowed)"
        raise NotHeldError("the wall mount", why, remedy)
    return best


def _plan_with_share(
    share: float,
    knots: Knots,
    camera: Camera,
    clearance_mm: float,
    stiffness: Stiffness,
    settings: Mount,
    target: Mask | None,
    thoroughly: bool,
) -> WallMount:
    """Choose pegs that fill `share` of the tube's shadow; ValueError if a knot is not held."""
    rays, chosen, top, foot = _choose_rays(share, knots, camera, clearance_mm, stiffness)
    if settings.foot != "plate":
        _require_rays(chosen)
    if target is None:
        target = np.zeros((camera.height, camera.width), dtype=bool)
    wide = np.minimum(rays.share + ROOT_SHARE, MOST_SHARE)
    root = wide * knots.radius_mm * _shadow_scale(rays, camera.eye)
    radii = np.stack([top, foot, root], axis=1).tolist()
    pegs = tuple(Peg(int(rays.knot[i]), rays.top[i], rays.foot[i], *radii[i]) for i in chosen.rays)
    sites = sites_with(knots, rays, chosen.rays)
    bare, roots = pegs_on(sites, rays, chosen.rays, top, foot), root[chosen.rays]
    ties, obstacles = no_members(), Obstacles(knots, sites, clearance_mm)
    obstacles.add(replace(bare, radius=roots, end_radius=None))
    if chosen.barred:
        shadows = MountShadows(knots, (camera,), (target,))
        ties = tie_to_held(knots, sites, obstacles, shadows, chosen.barred)
        bare = join_members([bare, ties])
    moves = sag_moves(knots, sites, bare, stiffness)
    sag, at = worst_of(moves, knots.points)
    joined = _joined_knots(sites, ties)
    mount = WallMount(
        pegs=pegs,
        settings=settings,
        struts=ties,
        strut_knots=joined,
        sag_mm=sag,
        sag_at=at,
        moves=moves,
    )
    hopeless = not thoroughly and sag > HOPELESS * stiffness.max_sag_mm
    if sag <= stiffness.max_sag_mm or settings.foot != "plate" or hopeless:
        return mount
    shadows = MountShadows(knots, (camera,), (target,))
    braces = hidden_braces(knots, camera, stiffness, sites, obstacles, shadows, bare)
    moves = sag_moves(knots, sites, join_members([bare, braces]), stiffness)
    sag, at = worst_of(moves, knots.points)
    leans = braces.second == GROUND
    lean = braces.take(leans)
    leaning = tuple(
        Peg(int(sites.knot[first]), start, end, *[float(r)] * 3)
        for first, start, end, r in zip(lean.first, lean.start, lean.end, lean.radius, strict=True)
    )
    struts = join_members([ties, braces.take(~leans)])
    return replace(
        mount,
        pegs=(*pegs, *leaning),
        sag_at=at,
        sag_mm=sag,
        struts=struts,
        strut_knots=_joined_knots(sites, struts),
        moves=moves,
    )


def _joined_knots(sites: Sites, struts: Candidates) -> NDArray[np.int64]:
    """Return the two knots that each strut joins, (n, 2)."""
    return np.stack([sites.knot[struts.first], sites.knot[struts.second]], axis=1)


def sag_on_pegs(
    knots: Knots,
    camera: Camera,
    clearance_mm: float,
    stiffness: Stiffness,
    foot: Literal["plate", "dowel"] = "plate",
) -> float:
    """Measure how far knots would sag on only the thickest pegs, mm, as `choose_pegs` does.

    On a plate, knots from which no ray to the wall is free do not count: they may hang on others.

    Raises:
        ValueError: a knot has no free ray to the wall, and nothing to hang on.
    """
    chosen = _choose_rays(PEG_SHARES[0], knots, camera, clearance_mm, stiffness)[1]
    if foot != "plate" or len(chosen.barred) == len(knots.knots):
        _require_rays(chosen)
    return chosen.sag_mm


def _require_rays(chosen: Pegs) -> None:
    if chosen.barred:
        raise ValueError(f"no light ray from knot {chosen.barred[0]} to the wall is free for a peg")


def _choose_rays(
    share: float, knots: Knots, camera: Camera, clearance_mm: float, stiffness: Stiffness
) -> tuple[Rays, Pegs, Array, Array]:
    """Choose pegs among the free rays; return the rays, the pegs, and radii (n,) at tube and wall.

    Pegs fill `share` of the tube's shadow, or less for a knot that leaves no way for such a peg: a knot
    hardly larger than its tube is in its own way.
    """
    rays = free_rays(knots, camera, share, clearance_mm)
    for thinner in (s for s in (*PEG_SHARES, *THIN_SHARES) if s < share):
        barred = np.bincount(rays.knot, rays.free, len(knots.knots)) == 0
        if not barred.any():
            break
        thin = free_rays(knots, camera, thinner, clearance_mm)
        own = barred[rays.knot]
        free, shares = np.where(own, thin.free, rays.free), np.where(own, thinner, rays.share)
        rays = replace(rays, free=free, share=shares)
    top = rays.share * knots.radius_mm
    foot = top * _shadow_scale(rays, camera.eye)
    return rays, choose_pegs(knots, rays, top, foot, stiffness), top, foot


def _shadow_scale(rays: Rays, light: Array) -> Array:
    """Return how many times larger the tube's shadow is than the tube, at each ray, (n,)."""
    far, near = (np.linalg.norm(p - light, axis=1) for p in (rays.foot, rays.top))
    return np.asarray(far / near)


def wall_bodies(tubes: list[Mesh], mount: WallMount, camera: Camera) -> list[Mesh]:
    """Unite the tubes with pegs and plate or dowels to watertight bodies, in scene coordinates.

    On a plate everything is one body; on dowels each knot is one with its own.

    Raises:
        SceneError: the union is not what the pegs predict: something else touches.
    """
    # tubes come first: the order of making is seen in the last digits
    solids = [as_manifold(tube) for tube in tubes]
    own = [[f.solid() for f in group] for group in wall_fixtures(mount, camera, len(tubes))]
    groups = [[tube, *group] for tube, group in zip(solids, own, strict=False)]
    name, count = "the wall mount", len(tubes)
    if mount.settings.foot != "plate":
        return [fuse(one, 1, name, f"knot {k} of {count}") for k, one in enumerate(groups)]
    # a handle for each knot, closed loop of members, and hole
    if (plate := mount.plate) is None:
        genus = len(mount.pegs) + len(mount.struts) + 2
    else:
        genus = sum(plate.handles) + len(plate.holes) + len(plate.openings)
    return [fuse([solid for one in groups for solid in one] + own[-1], genus, name)]


def wall_fixtures(mount: WallMount, camera: Camera, knots: int) -> list[list[Fixture]]:
    """List each knot's fixtures, and the plate last, in scene coordinates."""
    wall = np.column_stack(list(camera.wall_axes))
    groups: list[list[Fixture]] = [[] for _ in range(knots)]
    for peg in mount.pegs:
        groups[peg.knot] += _peg_fixtures(peg, wall, mount.settings)
    members = mount.struts
    for i, (knot, _) in enumerate(mount.strut_knots):
        bar = strut(members.start[i], members.end[i], float(members.radius[i]))
        groups[int(knot)].append(bar)
    if mount.plate is not None:
        return [*groups, [foot_plate_fixture(mount.plate, camera, mount.settings)]]
    return (
        [*groups, [_plate_fixture(camera, wall, mount)]]
        if mount.settings.foot == "plate"
        else groups
    )


def _peg_fixtures(peg: Peg, wall: Array, settings: Mount) -> list[Fixture]:
    """Make a peg from tube to wall, and what holds it there."""
    axis = (peg.top - peg.foot) / peg.length_mm
    cosine = float(axis @ wall[:, 2])
    slant = float(np.sqrt(max(0.0, 1.0 - cosine**2)) / cosine)
    sizes = peg.length_mm, peg.top_radius_mm, peg.foot_radius_mm
    named = {
        "root_radius_mm": peg.root_radius_mm,
        "root_height_mm": ROOT_HEIGHT_MM,
        "sink_mm": peg.root_radius_mm * slant + OVERLAP_MM,
    }
    deep = settings.dowel_depth_mm
    # a slanting root must not come out of the plate's back
    buried = 0.75 * settings.thickness_mm if settings.foot == "plate" else 0.5 * deep
    above = wall[:, 2], float(wall[:, 2] @ peg.foot) - buried
    cone = Fixture("peg", peg_mesh, sizes, motion_along(axis, peg.foot, wall[:, 1]), named, above)
    if settings.foot == "plate":
        return [cone]
    motion = np.column_stack([wall, peg.foot])
    return [cone, Fixture("dowel", dowel, (peg.dowel_radius_mm, deep), motion)]


def _plate_fixture(camera: Camera, wall: Array, mount: WallMount) -> Fixture:
    """Make the plate, its face on the receiver plane, a margin wider than the frame."""
    s = mount.settings
    width, height = (side + 2 * s.plate_margin_mm for side in camera.frame_mm)
    sizes = width, height, s.thickness_mm, s.hole_diameter_mm
    deep = mark_depth_mm(s)
    beside = min(width / 2 - ARROW_MARKS * deep, height / 2 - deep)  # the arrow and the notches
    named = {
        "hole_inset_mm": hole_inset_mm(s),
        "mark_mm": deep,
        "corner_radius_mm": min(6.0, s.plate_margin_mm, 0.95 * beside),
    }
    back = camera.middle - s.thickness_mm * wall[:, 2]
    return Fixture("plate", wall_plate, sizes, np.column_stack([wall, back]), named)
