"""Guess what each holder of a piece would add, before any is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.candidates import Laid, hours_of_plate, hours_of_tube, price_of
from knotfab.design.design import Design
from knotfab.design.survey import Survey
from knotfab.effects.base import World
from knotfab.geometry.overhang import Estimate, Strands, estimate
from knotfab.hold.hang import HOLE_MM
from knotfab.hold.mount import BASE_DOWN, choose_foot, lay_bed, require_holder
from knotfab.knots import Knot, Knots
from knotfab.part.assemble import rules_of
from knotfab.part.orient import estimate_print_minutes, propose_turns, rank_turns, strands_of
from knotfab.picture.read import Target
from knotfab.problem import Start, TargetView, brace
from knotfab.scene.camera import Camera, camera_of, cameras_of
from knotfab_formats.scene import ResolvedScene

Kind = Literal["wall", "stand", "hang"]
WORDS: dict[Kind, str] = {"wall": "a wall mount", "stand": "a stand", "hang": "eyelets for threads"}
_RODS = 2000  # rods that stand for the strands
# Usual members, as built for the project's own pictures: how many, how long as a share of the piece's
# height (a peg's of its way to the wall), and how thick as a share of the tube.
_POSTS = {"hang": (3, 0.25), "stand": (4, 0.3), "wall": (7, 1.0)}
_MEMBER_SHARE = 0.7


@dataclass(frozen=True)
class Guess:
    """What a holder adds to the bare piece, its supports included; `hours` are NaN but for filament."""

    kind: Kind
    grams: float
    hours: float

    def price(self, word: str = "faithful") -> float:
        """Return its price, and that of the verdict's word on it, in hours."""
        return price_of(self.hours, self.grams, word=word)

    def __str__(self) -> str:
        hours = "" if np.isnan(self.hours) else f" and {max(self.hours, 0.0):.1f} h"
        return f"{WORDS[self.kind]} (some {max(self.grams, 0.0):.0f} g{hours} with its supports)"


def refuse_holder(found: Survey) -> SceneError | None:
    """Return the error of a piece whose stand or hanger finds no place about its start, else None."""
    if found.start is None:
        return None
    framed = tuple(seen.view for seen in found.views)
    cameras = cameras_of(framed, [seen.target for seen in found.views])
    knots = _knots_of(found.start, found.radius_mm)
    masks = [seen.target.mask for seen in found.views]
    bed = None
    if found.scene.mount.kind == "hang" and found.scene.piece.supports == "none":
        seen, world = TargetView(framed[0], masks[0], MultiPolygon()), World.from_scene(found.scene)
        bed = lay_bed(brace(knots, seen, world), knots.radius_mm, world)
    try:
        require_holder(found.scene.but(views=framed), knots, cameras, masks, bed)
    except SceneError as error:
        return error
    return None


def lay_strands(scene: ResolvedScene, start: Start, radius: float) -> Laid:
    """Tell how the strands that a search begins with lie on the bed where that costs least."""
    strands = strands_of(_knots_of(start, radius), most=_RODS)
    best = rank_turns(strands, propose_turns(strands), rules_of(scene))[0].estimate
    length = float(strands.length.sum())
    return Laid(length, 1e3 * best.filament_cm3, estimate_print_minutes(best) / 60)


def _knots_of(start: Start, radius: float) -> Knots:
    return Knots(tuple(Knot(curve) for curve in start.curves), radius)


def can_hold(scene: ResolvedScene) -> list[Kind]:
    """List the holders that a scene allows: a wall mount only for a single shadow on a flat wall.

    A piece that prints without supports allows none, since members would begin in mid-air.
    """
    if scene.piece.supports == "none":
        return []
    # where lamps share a screen, they stand as the holder lets them, which was settled before
    kinds: list[Kind] = ["hang"] if scene.share_wall else ["hang", "stand"]
    return [*kinds, "wall"] if scene.is_one_shadow else kinds


def guess_holders(made: Design, targets: Sequence[Target]) -> list[Guess]:
    """Guess what each holder that the scene allows would add; the cheapest come first."""
    scene, knots = made.scene, made.knots
    kinds = can_hold(scene)
    if not kinds:
        return []
    rules, strands = rules_of(scene), strands_of(knots, most=_RODS)
    best = rank_turns(strands, propose_turns(strands), rules)[0].estimate
    camera = camera_of(scene.views[0], targets[0].width, targets[0].height)
    found = []
    for kind in kinds:
        posed, member_mm3, solid_mm3 = best, _members_mm3(kind, knots.points, made, camera), 0.0
        if kind == "hang":
            wire = _MEMBER_SHARE * knots.radius_mm
            member_mm3 += 2 * np.pi**2 * (0.5 * HOLE_MM + wire) * wire**2
        else:
            turn = BASE_DOWN if kind == "stand" else camera.wall_axes
            foot, solid_mm3 = _foot_of(kind, made, camera)
            posed = estimate(_on_a_foot(strands, foot, turn), turn, rules)
        found.append(_price(kind, scene, knots.radius_mm, posed, best, member_mm3, solid_mm3))
    return sorted(found, key=Guess.price)


def _price(
    kind: Kind,
    scene: ResolvedScene,
    radius: float,
    posed: Estimate,
    bare: Estimate,
    member_mm3: float,
    solid_mm3: float,
) -> Guess:
    filament = scene.material.process == "filament"
    supports_cm3 = posed.filament_cm3 - bare.filament_cm3 if filament else 0.0
    grams = scene.material.density_g_cm3 * (supports_cm3 + 1e-3 * (member_mm3 + solid_mm3))
    hours = (estimate_print_minutes(posed) - estimate_print_minutes(bare)) / 60
    hours += hours_of_tube(member_mm3, radius, scene.printer) + hours_of_plate(
        solid_mm3, scene.mount.thickness_mm, scene.printer
    )
    return Guess(kind, float(grams), float(hours) if filament else float("nan"))


def _members_mm3(kind: Kind, points: Array, made: Design, camera: Camera) -> float:
    count, share = _POSTS[kind]
    length = float(np.ptp(points[:, 1]))
    if kind == "wall":
        length = float((points @ camera.receiver[:3]).mean() + camera.receiver[3])
        count *= len(made.knots.knots)
    return count * share * length * np.pi * (_MEMBER_SHARE * made.knots.radius_mm) ** 2


def _foot_of(kind: Kind, made: Design, camera: Camera) -> tuple[Array, float]:
    """Return a point (3,) of the plane on which the holder stands, and the volume of its plate or base."""
    points, asked, radius = made.knots.points, made.scene.mount, made.knots.radius_mm
    if kind == "stand":
        size = np.ptp(points @ camera.level_axes.T, axis=0) + 2 * radius
        tall = 0.5 * size[1] * np.tan(np.deg2rad(asked.min_tip_deg))
        area = size[0] * max(size[2], 2 * tall)
        low = points[int(points[:, 1].argmin())] - np.array([0.0, 2 * radius, 0.0])
        return low, float(area * asked.base_thickness_mm)
    off = camera.receiver[:3] * -(camera.receiver[3] + camera.receiver[:3] @ points.mean(axis=0))
    middle = points.mean(axis=0) + off
    foot = choose_foot(made.scene, made.knots, camera) if asked.foot == "auto" else asked.foot
    if foot == "dowel":
        return middle, 0.0
    across, along = (side + 2 * asked.plate_margin_mm for side in camera.frame_mm)
    return middle, float(across * along * asked.thickness_mm)


def _on_a_foot(strands: Strands, foot: Array, turn: Array) -> Strands:
    """Add a speck at a foot, so that supports and height count from there."""
    return replace(
        strands,
        middle=np.vstack([strands.middle, foot]),
        along=np.vstack([strands.along, turn[0]]),
        length=np.append(strands.length, 1e-6),
        sizes=(*strands.sizes, 1),
    )
