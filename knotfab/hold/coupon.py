"""A coupon: the mount's pins and holes at a few clearances, to be printed and tried beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.hold.modeller import model_fixture
from knotfab.hold.mount import Mounted
from knotfab_fixtures.holders import fit_pin, fit_strip
from knotfab_fixtures.solids import peg
from knotfab_formats.print_figures import CouponFigures

COUPON = "coupon.3mf"
# Each hole has this play about the pin, and as many dots as tenths.
PLAYS_MM = (0.1, 0.2, 0.3, 0.4, 0.5)
APART_MM = 5.0  # between peg, strip and pin

_DOTS = tuple(round(10 * play) for play in PLAYS_MM)


@dataclass(frozen=True)
class Coupon:
    """A pin and how deep it goes, a strip of holes, and a peg that stands on it; lengths in mm."""

    pin_mm: float
    depth_mm: float
    thickness_mm: float
    peg_length_mm: float
    peg_top_mm: float
    peg_foot_mm: float

    @property
    def holes_mm(self) -> tuple[float, ...]:
        return tuple(self.pin_mm + play for play in PLAYS_MM)

    def make_bodies(self) -> list[Mesh]:
        """Make the strip with its peg, and the loose pin, side by side on the bed."""
        room = self.peg_foot_mm + 2 * APART_MM
        strip = as_manifold(
            model_fixture(fit_strip, self.holes_mm, _DOTS, self.thickness_mm, room_mm=room)
        )
        sizes = self.peg_length_mm, self.peg_top_mm / 2, self.peg_foot_mm / 2
        cone = model_fixture(peg, *sizes, sink_mm=0.3)
        standing = as_manifold(cone).translate((room / 2, 0.0, self.thickness_mm))
        vertices, faces = as_mesh(strip + standing)
        pin, pin_faces = model_fixture(
            fit_pin, self.pin_mm, self.depth_mm, 4.0
        )  # with a knob of 4 mm
        above = vertices[:, 1].max() - pin[:, 1].min() + APART_MM
        pin = pin + [vertices[:, 0].mean(), above, 0.0]
        low = np.minimum(vertices.min(axis=0), pin.min(axis=0))
        return [(vertices - low, faces), (pin - low, pin_faces)]

    @property
    def figures(self) -> CouponFigures:
        """The coupon's entry in the report."""
        holes = tuple(round(hole, 3) for hole in self.holes_mm)
        return CouponFigures(file=COUPON, pin_mm=round(self.pin_mm, 3), holes_mm=holes, dots=_DOTS)

    def tell(self) -> str:
        """Say in one sentence what the coupon is for."""
        return (
            f"Print {COUPON} first, in half an hour: its pin of {self.pin_mm:.1f} mm and its holes, "
            f"{PLAYS_MM[0]:g} to {PLAYS_MM[-1]:g} mm wider, show what play your printer needs."
        )


def plan_coupon(mounted: Mounted, suffix: str = "") -> Coupon | None:
    """Plan the coupon of a wall mount or a stand; None without either.

    The pin is as thick as what enters a hole: a dowel or the root of a peg, or a stand's thickest
    member. The strip is as thick as the plate or the stand's base. The peg is the mount's thinnest.

    Args:
        suffix: that of the piece's files; frames, which have one such as "-01", get no coupon.
    """
    asked = mounted.scene.mount
    if asked.on_feet:
        return None
    if mounted.wall is not None:
        pegs = mounted.wall.pegs
        slim = min(pegs, key=lambda one: one.top_radius_mm)
        pin = max(one.root_radius_mm for one in pegs)
        top, foot, length = slim.top_radius_mm, slim.foot_radius_mm, slim.length_mm
        thick = asked.thickness_mm
    elif mounted.stand is not None and len(mounted.stand.members):
        members = mounted.stand.members
        pin, top = float(members.radius.max()), float(members.radius.min())
        foot, length = top, float(members.length_mm.max())
        thick = asked.base_thickness_mm
    else:
        return None
    return Coupon(
        pin_mm=2 * pin,
        depth_mm=asked.dowel_depth_mm,
        thickness_mm=max(thick, 3.0),  # as thick as a strip must be
        peg_length_mm=min(length, 20.0),  # the longest peg on the strip
        peg_top_mm=2 * top,
        peg_foot_mm=2 * foot,
    )
