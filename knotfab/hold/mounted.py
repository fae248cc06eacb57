"""A piece with its mount: its bodies, and what files and report say of the mount."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.hold.foot_plate import ears_mm
from knotfab.hold.hang import MOST_TILT_DEG, HangMount, hang_fixtures
from knotfab.hold.solids import Fixture, stand_fixtures
from knotfab.hold.stand import StandMount
from knotfab.hold.wall import WallMount, wall_fixtures
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.print_figures import MountFigures, PlateFigures
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Check
from knotfab_validators.check import at_most

if TYPE_CHECKING:
    from manifold3d import Manifold

EYELET_RODS = 24  # straight rods that knots.json has for an eyelet's ring


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
    wall: WallMount | None
    stand: StandMount | None = None
    hang: HangMount | None = None

    @property
    def holder(self) -> WallMount | StandMount | HangMount | None:
        """The mount that holds the piece, if any."""
        return self.wall or self.stand or self.hang

    @cached_property
    def solids(self) -> list[Manifold]:
        """The bodies as solids, for drawings of them."""
        return [as_manifold(body) for body in self.bodies]

    def fixtures(self, camera: Camera) -> list[Fixture]:
        """List the mount's solids, in scene coordinates; `camera` is the first view's."""
        if self.wall is not None:
            groups = wall_fixtures(self.wall, camera, max(len(self.scene.mount.pegs), 1))
            return [fixture for group in groups for fixture in group]
        if self.stand is not None:
            return stand_fixtures(self.stand)
        return [] if self.hang is None else hang_fixtures(self.hang)

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

        That is `members`, the `rods` of an eyelet, and the `hulls` of a base or dowels; a plate
        follows from the scene.
        """
        turn, shift = to_part[:3, :3], to_part[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        rods: list[dict[str, Any]] = []
        if self.hang is not None:
            eyelet = self.hang.eyelet
            ring = eyelet.outline(EYELET_RODS) @ turn.T + shift
            rods = [
                {"from": a.tolist(), "to": b.tolist(), "radius_mm": scale * eyelet.wire_mm}
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
        """Describe, as `members` does, the plate in which the piece stands; None without one.

        `outline` are the corners of its face, whose unit normal is `out`, and `holes` the middles
        of the screw holes there, `hole_mm` wide.
        """
        if self.wall is None or self.wall.plate is None or self.upright is None:
            return None
        turn, shift = to_part[:3, :3], to_part[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        plate, view = self.wall.plate, self.scene.views[0]
        middle = camera_of(view, 1, 1).middle

        def place(flat: Array) -> list[list[float]]:
            found = (middle + flat @ self.upright[:2]) @ turn.T + shift  # type: ignore[index]
            return [[float(x) for x in row] for row in found]

        return {
            "outline": place(plate.outline),
            "holes": place(plate.holes),
            "hole_mm": scale * self.wall.settings.hole_diameter_mm,
            "thickness_mm": scale * self.wall.settings.thickness_mm,
            "out": (turn @ self.upright[2] / scale).tolist(),
        }

    def plate_figures(self, shrinks_to: float) -> PlateFigures | None:
        """Report the plate in which the piece stands; it is printed larger by the shrinkage."""
        if self.wall is None or self.wall.plate is None:
            return None
        import shapely

        outline, mount = self.wall.plate.outline, self.wall.settings
        printer, material = self.scene.printer, self.scene.material
        high = mount.thickness_mm / shrinks_to
        layers = int(np.ceil(high / printer.layer_height_mm - 1e-6))
        area = shapely.Polygon(outline).area - np.pi / 2 * mount.hole_diameter_mm**2
        return PlateFigures(
            thickness_mm=mount.thickness_mm,
            change_at_mm=round(layers * printer.layer_height_mm, 4),
            change_layer=layers + 1,
            mass_g=float(area * mount.thickness_mm * 1e-3 * material.density_g_cm3),
            hidden_aside={str(a): round(s, 3) for a, s in self.wall.hidden_aside.items()},
            outline=tuple((round(float(x), 2), round(float(y), 2)) for x, y in outline),
        )

    @property
    def must_be_upright(self) -> bool:
        """Whether only `upright` will do: a stand too tall for the printer may lie down."""
        return self.wall is not None

    @property
    def fixed_mm(self) -> tuple[float, float, float] | None:
        """What of the extents, as `upright` lays the part, does not scale with the frame.

        Margin and thickness of a plate, a dowel's length, and the distance from the wall; None if
        it is the tube's thickness alone.
        """
        if self.wall is None:
            return None
        s, view = self.wall.settings, self.scene.views[0]
        off = view.wall_distance_mm * float(np.cos(np.deg2rad(view.wall_tilt_deg)))
        if self.wall.plate is not None:
            beyond = 2 * s.plate_margin_mm if s.plate == "outline" else 0.0
            return beyond + ears_mm(s), beyond, off + s.thickness_mm
        if s.foot == "plate":
            return 2 * s.plate_margin_mm, 2 * s.plate_margin_mm, off + s.thickness_mm
        across = 2 * max(peg.root_radius_mm for peg in self.wall.pegs)
        return across, across, off + s.dowel_depth_mm

    @property
    def figures(self) -> MountFigures:
        """The mount's entry in the report."""
        if self.stand is not None:
            return self._stand_figures(self.stand)
        if self.hang is not None:
            return self._hang_figures(self.hang)
        if self.wall is None:
            return MountFigures(kind="none")
        if self.wall.plate is not None:
            return MountFigures(
                kind="wall",
                foot="plate",
                plate=self.wall.settings.plate,
                feet_of_knots=self.wall.plate.feet,
                sag_mm=self.wall.sag_again_mm,
                max_sag_mm=self.scene.mount.max_sag_mm,
            )
        lengths = [peg.length_mm for peg in self.wall.pegs]
        thick = [peg.top_radius_mm for peg in self.wall.pegs]
        joined = self.wall.strut_knots.tolist()
        knots = range(len(self.scene.mount.pegs))
        pegs = [sum(peg.knot == k for peg in self.wall.pegs) for k in knots]
        return MountFigures(
            kind="wall",
            foot=self.wall.settings.foot,
            pegs=len(self.wall.pegs),
            struts=len(self.wall.struts),
            pegs_of_knots=tuple(pegs),
            knots_joined=tuple(sorted({(a, b) for a, b in joined if a != b})),
            peg_length_mm=(min(lengths), max(lengths)),
            peg_diameter_mm=2 * max(thick),
            thinnest_peg_mm=2 * min(thick),
            sag_mm=self.wall.sag_again_mm,
            max_sag_mm=self.scene.mount.max_sag_mm,
        )

    def _stand_figures(self, stand: StandMount) -> MountFigures:
        width, depth, front, back = stand.base.size_mm
        radius = stand.members.radius
        return MountFigures(
            kind="stand",
            posts=len(stand.posts),
            struts=len(stand.struts),
            members_of_knots=self.scene.mount.pegs,
            member_diameter_mm=(2 * float(radius.min()), 2 * float(radius.max())),
            base_mm=(width, depth, front),
            base_back_mm=back,
            margin_mm=stand.base.margin_mm,
            tip_deg=stand.base.tip_deg,
            predicted_intrusion=float(stand.predicted_intrusion.max()),
            sag_mm=stand.sag_again_mm,
            max_sag_mm=self.scene.mount.max_sag_mm,
        )

    def _hang_figures(self, hang: HangMount) -> MountFigures:
        radius = hang.members.radius
        x, y, z = hang.eyelet.thread.tolist()
        return MountFigures(
            kind="hang",
            struts=len(hang.struts),
            members_of_knots=self.scene.mount.pegs,
            member_diameter_mm=(2 * float(radius.min()), 2 * float(radius.max())),
            thread_mm=(x, y, z),
            hole_mm=2 * (hang.eyelet.ring_mm - hang.eyelet.wire_mm),
            tilt_deg=hang.tilt_deg,
            max_tilt_deg=MOST_TILT_DEG,
            predicted_intrusion=float(hang.predicted_intrusion.max()),
            sag_mm=hang.sag_again_mm,
            max_sag_mm=self.scene.mount.max_sag_mm,
        )

    def check_sag(self) -> Check | None:
        """Check `sag`: how far the piece moves under its own weight, as a frame."""
        mount = self.holder
        if mount is None:
            return None
        sag, limit = mount.sag_again_mm, self.scene.mount.max_sag_mm
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
            on, less = f"an eyelet and {len(mount.struts)} struts", "less depth"
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
