"""Join the tubes with the mount that the scene asks for, into the piece that is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.effects.base import World
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.hold.beams import Stiffness
from knotfab.hold.eyelet import Bed
from knotfab.hold.foot_plate import ears_mm, plan_foot_plate
from knotfab.hold.hang import MOST_TILT_DEG, Hanger, HangMount, begin_hang, hang_bodies
from knotfab.hold.solids import Fixture, stand_bodies, stand_fixtures
from knotfab.hold.stand import StandMount, StandSettings, plan_stand
from knotfab.hold.wall import WallMount, plan_wall, wall_bodies
from knotfab.knots import Knots
from knotfab.problem import Braced
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.require import require_mount
from knotfab_formats.print_figures import MountFigures, PlateFigures, RootsFigures
from knotfab_formats.scene import ResolvedScene, SettledScene
from knotfab_formats.verdict import Check
from knotfab_validators.check import at_most

if TYPE_CHECKING:
    from manifold3d import Manifold

BASE_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # scene to bed
EYELET_RODS = 24  # straight rods that knots.json has for an eyelet's ring


def mount_piece(
    scene: SettledScene,
    knots: Knots,
    tubes: list[Mesh],
    cameras: Sequence[Camera],
    targets: Sequence[Mask] = (),
    bed: Bed | None = None,
    *,
    thoroughly: bool = True,
) -> Mounted:
    """Add the scene's mount to the tubes (one per knot, scene coordinates).

    Where the scene leaves it open, several loose knots of one view before a flat wall get a wall
    mount, others none.

    Args:
        cameras: of the views. targets: their pictures' silhouettes (H, W), which a stand and a
            hanger need, and in which struts hide.
        bed: on which it prints without supports.
        thoroughly: as for `plan_wall`.

    Raises:
        InputError: a wall mount, and several views.
        NotHeldError: a wall mount does not hold it (`plan_wall`).
        SceneError: there is no such mount for this piece.
        ValueError: a stand or a hanger without the silhouettes.
    """
    require_mount(scene)
    scene = _resolve_mount(scene, knots, cameras)
    asked, every = scene.mount, range(len(tubes))
    if asked.kind == "none":
        return Mounted(tubes, _name_knots(len(tubes)), scene, None)
    stiffness, clearance_mm = Stiffness.from_scene(scene, knots), scene.piece.clearance_mm
    if asked.kind in ("stand", "hang") and len(targets) != len(cameras):
        raise ValueError("a stand or an eyelet is placed by the silhouettes of all views")
    if asked.kind == "stand":
        settings, ends = _stand_settings(scene), scene.screen_ends
        stand = plan_stand(knots, cameras, targets, clearance_mm, stiffness, settings, ends)
        count = tuple(int((stand.holds == k).sum()) for k in every)
        scene, bodies = scene.but(mount=asked.but(pegs=count)), stand_bodies(tubes, stand)
        return Mounted(bodies, ["piece on its stand"], scene, BASE_DOWN, stand)
    if asked.kind == "hang":
        hang = _begin_hang(scene, knots, cameras, targets, stiffness, bed).plan_best()
        bodies, (first, *second) = hang_bodies(tubes, hang), map(tuple, hang.threads.tolist())
        count = tuple(int((hang.holds == k).sum()) for k in every)
        places = {"thread_mm": first, "second_thread_mm": second[0] if second else None}
        scene = scene.but(mount=asked.but(pegs=count, **places))
        name = "piece with its eyelets" if second else "piece with its eyelet"
        return Mounted(bodies, [name], scene, None, hang)
    if asked.on_feet:
        target = targets[0] if targets else None
        found = plan_foot_plate(knots, tubes, cameras[0], stiffness, asked, target)
        mount = WallMount(pegs=(), settings=asked, **vars(found))
        count = found.plate.handles
    else:
        how = clearance_mm, stiffness, asked, targets[0] if targets else None
        mount = plan_wall(knots, cameras[0], *how, thoroughly=thoroughly)
        struts = [int((mount.strut_knots[:, 0] == k).sum()) for k in every]
        count = tuple(sum(peg.knot == k for peg in mount.pegs) + struts[k] for k in every)
    bodies = wall_bodies(tubes, mount, cameras[0])
    names = ["piece with wall plate"] if asked.foot == "plate" else _name_knots(len(bodies))
    scene = scene.but(mount=asked.but(pegs=count))
    # the wall on the bed, its front up
    return Mounted(bodies, names, scene, cameras[0].wall_axes, mount)


def require_holder(
    scene: ResolvedScene,
    knots: Knots,
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
    bed: Bed | None = None,
) -> None:
    """Refuse a stand or a hanger that has no place about these strands: those that a search begins with.

    Args:
        bed: as for `mount_piece`.

    Raises:
        SceneError: as `mount_piece`.
    """
    material = scene.material
    stiffness = Stiffness(material.young_modulus_mpa, material.density_g_cm3, np.inf)
    if scene.mount.kind == "stand":
        settings, ends = _stand_settings(scene), scene.screen_ends
        how = scene.piece.clearance_mm, stiffness, settings, ends
        plan_stand(knots, cameras, targets, *how, thoroughly=False)
    elif scene.mount.kind == "hang":
        _begin_hang(scene, knots, cameras, targets, stiffness, bed).require_place()


def _begin_hang(
    scene: ResolvedScene,
    knots: Knots,
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
    stiffness: Stiffness,
    bed: Bed | None,
) -> Hanger:
    least_mm, ends = scene.printer.min_tube_radius_mm, scene.screen_ends
    how = scene.piece.clearance_mm, stiffness, least_mm, ends, bed
    return begin_hang(knots, cameras, targets, *how)


def _stand_settings(scene: ResolvedScene) -> StandSettings:
    asked, least_mm = scene.mount, scene.printer.min_tube_radius_mm
    return StandSettings(asked.base_thickness_mm, asked.min_tip_deg, least_mm)


def lay_bed(braced: Braced, radius: float, world: World) -> Bed:
    """Lay the bed of a piece that stands with the light's axis up, with the bars that hold its legs there."""
    upright, (legs, bars) = np.eye(4), (braced.legs, braced.bars)
    upright[:3, :3] = axes = braced.axes
    ties = np.array([end for bar in bars for end in (bar.start, bar.end)]).reshape(-1, 3)
    free = [leg.list_free(ties, 1.5 * radius) for leg in legs]
    places = np.concatenate([leg.points for leg in legs]) @ axes
    moved = tuple(bar.moved(upright.T) for bar in bars)
    return Bed(axes[2], world.leg_modulus_mpa(radius), radius, moved, places, np.concatenate(free))


def _name_knots(count: int) -> list[str]:
    return [f"knot {i + 1}" for i in range(count)]


def _resolve_mount(scene: SettledScene, knots: Knots, cameras: Sequence[Camera]) -> SettledScene:
    """Choose the mount's kind and foot where the scene leaves them open."""
    kind, foot = scene.mount.kind, scene.mount.foot
    if scene.mount.on_feet:
        kind, foot = "wall", "plate"
    if kind == "auto":
        kind = "wall" if scene.on_wall(len(knots.knots)) else "none"
    if foot == "auto":
        foot = choose_foot(scene, knots, cameras[0]) if kind == "wall" else "plate"
    sag = (
        scene.mount.max_sag_mm if kind == "none" else Stiffness.from_scene(scene, knots).max_sag_mm
    )
    return scene.but(mount=scene.mount.but(kind=kind, foot=foot, max_sag_mm=sag))


def choose_foot(scene: ResolvedScene, knots: Knots, camera: Camera) -> Literal["plate", "dowel"]:
    """Choose a plate if the printer holds one as large as frame and distance ask for."""
    asked = scene.mount
    across, along = (side + 2 * asked.plate_margin_mm for side in camera.frame_mm)
    wall = camera.receiver
    high = float((knots.points @ wall[:3]).max() + wall[3]) + knots.radius_mm
    width, depth, height = scene.printer.build_volume_mm
    fits = max(across, along) <= max(width, depth) and min(across, along) <= min(width, depth)
    return "plate" if fits and high + asked.thickness_mm <= height else "dowel"


@dataclass(frozen=True)
class Mounted:
    """The bodies to print, in scene coordinates.

    `scene` has the mount resolved (its foot, the pegs of each knot). `upright` is the rotation (3,
    3) from scene to bed in which the mount prints best, None where any will do.
    """

    bodies: list[Mesh]
    names: list[str]
    scene: SettledScene
    upright: Array | None
    holder: WallMount | StandMount | HangMount | None = None

    @property
    def wall(self) -> WallMount | None:
        return self.holder if isinstance(self.holder, WallMount) else None

    @property
    def stand(self) -> StandMount | None:
        return self.holder if isinstance(self.holder, StandMount) else None

    @property
    def hang(self) -> HangMount | None:
        return self.holder if isinstance(self.holder, HangMount) else None

    @cached_property
    def solids(self) -> list[Manifold]:
        """The bodies as solids, for drawings of them."""
        return [as_manifold(body) for body in self.bodies]

    @property
    def moves(self) -> Array | None:
        """How far each vertex sags under the piece's weight, mm (N, 3); None without a mount."""
        return None if self.holder is None else self.holder.moves

    def members(self, to_part: Array) -> list[dict[str, Any]]:
        """List members for knots.json; `to_part` is a (4, 4) similarity from the scene.

        Each goes `from` a centre line `to` the mount's foot or another centre line. `radius_mm` are
        those of its ends, `foot` is the unit normal of the plate, wall or base that it stands on,
        if it does.
        """
        turn, shift = to_part[:3, :3], to_part[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        found: list[tuple[Array, Array, tuple[float, float], Array | None]] = []
        if self.wall is not None and self.upright is not None:
            out, struts = self.upright[2], self.wall.struts
            found += [
                (p.top, p.foot, (p.top_radius_mm, p.foot_radius_mm), out) for p in self.wall.pegs
            ]
        elif self.stand is not None:
            out, struts = self.stand.base.slope.normal, self.stand.struts
            posts = self.stand.posts
            ends = zip(posts.start, posts.end, posts.radius, strict=True)
            found += [(start, end, (r, r), out) for start, end, r in ends]
        elif self.hang is not None:
            struts = self.hang.members  # its posts end in the eyelet's bars
        else:
            return []
        ends = zip(struts.start, struts.end, struts.radius, strict=True)
        found += [(start, end, (r, r), None) for start, end, r in ends]
        return [
            {
                "from": (turn @ start + shift).tolist(),
                "to": (turn @ end + shift).tolist(),
                "radius_mm": [scale * float(r) for r in radius],
                **({} if foot is None else {"foot": (turn @ foot / scale).tolist()}),
            }
            for start, end, radius, foot in found
        ]

    def makeup(self, to_part: Array) -> dict[str, list[dict[str, Any]]]:
        """Describe the mount for knots.json; `to_part` is a (4, 4) similarity from the scene.

        That is `members`, the `rods` of the eyelets, and the `hulls` of a base or dowels; a plate
        follows from the scene.
        """
        turn, shift = to_part[:3, :3], to_part[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        rods: list[dict[str, Any]] = []
        if self.hang is not None:
            rings = [
                (e.wire_mm, e.outline(EYELET_RODS) @ turn.T + shift) for e in self.hang.eyelets
            ]
            rods = [
                {"from": a.tolist(), "to": b.tolist(), "radius_mm": scale * wire}
                for wire, ring in rings
                for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
            ]
        solids: list[Fixture] = []
        if self.wall is not None:
            solids = [f for peg in self.wall.pegs for f in self.wall.dowels(peg, self.upright)]
        elif self.stand is not None:
            solids = [f for f in stand_fixtures(self.stand) if f.kind == "base"]
        hulls = [
            {"name": f.kind, "corners": (as_mesh(f.solid().hull())[0] @ turn.T + shift).tolist()}
            for f in solids
        ]
        return {"members": self.members(to_part), "rods": rods, "hulls": hulls}

    def slab(self, to_part: Array) -> dict[str, Any] | None:
        """Describe the plate in which the piece stands for knots.json, as `members` does; None without one.

        `outline` lists the corners of its face, whose unit normal is `out`; `holes` the middles of the
        screw holes there, `hole_mm` wide.
        """
        if self.wall is None or self.wall.plate is None or self.upright is None:
            return None
        turn, shift = to_part[:3, :3], to_part[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        plate, view = self.wall.plate, self.scene.views[0]
        middle = camera_of(view, 1, 1).middle
        middle = middle + self.wall.settings.before_wall_mm * self.upright[2]

        def on_wall(flat: Array) -> list[list[float]]:
            found = (middle + flat @ self.upright[:2]) @ turn.T + shift  # type: ignore[index]
            return [[float(x) for x in row] for row in found]

        rings = [on_wall(ring) for ring in (plate.outline, *plate.openings)]
        return {
            "outline": rings[0],
            **({"openings": rings[1:]} if rings[1:] else {}),
            "holes": on_wall(plate.holes),
            "hole_mm": scale * self.wall.settings.hole_diameter_mm,
            "thickness_mm": scale * self.wall.settings.thickness_mm,
            "out": (turn @ self.upright[2] / scale).tolist(),
        }

    def plate_figures(self, shrinks_to: float) -> PlateFigures | None:
        """Report the plate in which the piece stands; it is printed larger, by what the material shrinks."""
        if self.wall is None or self.wall.plate is None or self.wall.settings.before_wall_mm:
            return None
        outline, mount = self.wall.plate.outline, self.wall.settings
        printer, material = self.scene.printer, self.scene.material
        high = mount.thickness_mm / shrinks_to
        layers = int(np.ceil(high / printer.layer_height_mm - 1e-6))
        return PlateFigures(
            thickness_mm=mount.thickness_mm,
            change_at_mm=round(layers * printer.layer_height_mm, 4),
            change_layer=layers + 1,
            mass_g=float(self._plate_mm2 * mount.thickness_mm * 1e-3 * material.density_g_cm3),
            outline=tuple((round(float(x), 2), round(float(y), 2)) for x, y in outline),
        )

    @property
    def roots_figures(self) -> RootsFigures | None:
        """Report the roots in which the piece stands."""
        if self.wall is None or self.wall.plate is None or not self.wall.settings.before_wall_mm:
            return None
        plate, mount = self.wall.plate, self.wall.settings
        grams = self._plate_mm2 * mount.thickness_mm * 1e-3 * self.scene.material.density_g_cm3
        return RootsFigures(
            width_mm=plate.width_mm,
            thickness_mm=mount.thickness_mm,
            screws=tuple((round(x, 2), round(y, 2)) for x, y in plate.holes.tolist()),
            tape="along" if plate.taped else "pads",
            area_cm2=round(self._plate_mm2 / 100, 1),
            mass_g=round(grams, 2),
        )

    @property
    def _plate_mm2(self) -> float:
        """The area of the plate in which the piece stands, without its holes."""
        import shapely

        assert self.wall is not None and self.wall.plate is not None
        plate, wide = self.wall.plate, self.wall.settings.hole_diameter_mm
        sheet = shapely.Polygon(plate.outline, plate.openings)
        return float(sheet.area - len(plate.holes) * np.pi / 4 * wide**2)

    @property
    def must_be_upright(self) -> bool:
        """Whether only `upright` will do: a stand too tall for the printer may lie down."""
        return self.wall is not None

    @property
    def fixed_mm(self) -> tuple[float, float, float] | None:
        """The share of the extents, as `upright` lays the part, that does not scale with the frame, mm.

        It holds a plate's margin and thickness, or a dowel's length, and the distance from the wall. None:
        only the tube's thickness does not scale.
        """
        if self.wall is None:
            return None
        s, view = self.wall.settings, self.scene.views[0]
        off = view.wall_distance_mm * float(np.cos(np.deg2rad(view.wall_tilt_deg)))
        if self.wall.plate is not None:
            if s.before_wall_mm:
                return 0.0, 0.0, off
            beyond = 2 * s.plate_margin_mm if s.plate == "outline" else 0.0
            return beyond + ears_mm(s), beyond, off + s.thickness_mm
        if s.foot == "plate":
            return 2 * s.plate_margin_mm, 2 * s.plate_margin_mm, off + s.thickness_mm
        across = 2 * max(peg.root_radius_mm for peg in self.wall.pegs)
        return across, across, off + s.dowel_depth_mm

    @property
    def figures(self) -> MountFigures:
        """The mount's entry in the report."""
        mount, asked = self.holder, self.scene.mount
        if mount is None:
            return MountFigures(kind="none")
        own: dict[str, Any] = {"sag_mm": mount.sag_mm, "max_sag_mm": asked.max_sag_mm}
        if isinstance(mount, WallMount) and mount.plate is not None:
            kind, feet = mount.settings.plate, mount.plate.feet
            return MountFigures(kind="wall", foot="plate", plate=kind, feet_of_knots=feet, **own)
        if isinstance(mount, WallMount):
            lengths = [peg.length_mm for peg in mount.pegs]
            thick = [peg.top_radius_mm for peg in mount.pegs]
            joined = mount.strut_knots.tolist()
            return MountFigures(
                kind="wall",
                foot=mount.settings.foot,
                pegs=len(mount.pegs),
                struts=len(mount.struts),
                knots_joined=tuple(sorted({(a, b) for a, b in joined if a != b})),
                peg_length_mm=(min(lengths), max(lengths)),
                peg_diameter_mm=2 * max(thick),
                thinnest_peg_mm=2 * min(thick),
                **own,
            )
        radius = mount.members.radius
        own["struts"], own["members_of_knots"] = len(mount.struts), asked.pegs
        own["member_diameter_mm"] = 2 * float(radius.min()), 2 * float(radius.max())
        own["predicted_intrusion"] = float(mount.predicted_intrusion.max())
        if isinstance(mount, StandMount):
            return MountFigures(
                kind="stand",
                posts=len(mount.posts),
                base_mm=mount.base.size_mm[:3],
                margin_mm=mount.base.margin_mm,
                tip_deg=mount.base.tip_deg,
                **own,
            )
        ring = mount.eyelets[0]
        return MountFigures(
            kind="hang",
            thread_mm=asked.thread_mm,
            second_thread_mm=asked.second_thread_mm,
            hole_mm=2 * (ring.ring_mm - ring.wire_mm),
            tilt_deg=mount.tilt_deg,
            max_tilt_deg=MOST_TILT_DEG,
            **own,
        )

    def check_sag(self) -> Check | None:
        """Check `sag`: how far the piece moves under its own weight, as a frame."""
        mount = self.holder
        if mount is None:
            return None
        sag, limit = mount.sag_mm, self.scene.mount.max_sag_mm
        assert limit is not None  # since it has a mount
        x, y, z = mount.sag_at
        if isinstance(mount, WallMount) and mount.plate is not None:
            on, less = f"{sum(mount.plate.feet)} feet in its plate", "less depth (--depth)"
        elif isinstance(mount, WallMount):
            on = f"{len(mount.pegs)} pegs and {len(mount.struts)} struts"
            less = "less depth (--depth) or a nearer wall (--wall-distance)"
        elif isinstance(mount, StandMount):
            on, less = f"{len(mount.posts)} posts and {len(mount.struts)} struts", "less depth"
        else:
            on = "two eyelets" if len(mount.eyelets) > 1 else "an eyelet"
            on, less = f"{on} and {len(mount.struts)} struts", "less depth"
        remedy = ""
        if sag > limit:
            remedy = (
                f", and no free member would help more: use a stiffer material, a thicker tube, {less}, "
                f"or set mount.max_sag_mm to {np.ceil(100 * sag) / 100:g} (in scene.toml, with --scene)"
            )
        detail = (
            f"largest displacement under the piece's own weight on {on}, "
            f"at ({x:.1f}, {y:.1f}, {z:.1f}) mm of the scene{remedy}"
        )
        return at_most("sag", sag, limit, "mm", detail)
