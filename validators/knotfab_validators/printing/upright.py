"""Check that a part prints without supports: it stands while it grows, and on its feet when it is done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_formats.upright import (
    LEAST_FLANK_DEG,
    LEAST_FOOT_SHARE,
    LEAST_STIFFNESS_N_MM,
    LEAST_TIP_DEG,
    MOST_BRIDGE_MM,
    MOST_REACH_MM,
    MOST_UNEVEN_MM,
    ROUNDED_MM,
    longest_free_leg_mm,
)
from knotfab_formats.verdict import GROWN, OVERHANGING, Check
from knotfab_validators.arrays import Array
from knotfab_validators.check import at_least, at_most, skip_check, spot, worst_apart
from knotfab_validators.geometry.mesh import Mesh, body_volumes, connect, number_bodies
from knotfab_validators.printing.growth import Growth, OverAir, find_over_air, follow_growth
from knotfab_validators.printing.slices import Slices, find_pieces, slice_layers
from knotfab_validators.printing.standing import margin, share_above

ANGLE_TOLERANCE = 2e-3  # of a normal's z: small faces in single precision are off by this
LENGTH_TOLERANCE_MM = 1e-6
APART_MM = 4.0  # places of one check that are nearer count as one


@dataclass(frozen=True)
class Upright:
    """A part as it prints without supports: its closed mesh with bars (z up), and what it is made of."""

    mesh: Mesh
    young_modulus_mpa: float
    wall_mm: float = np.inf  # thickness in a layer of the loops about an empty core; inf: no core


def check_upright(part: Upright, layer_mm: float) -> list[Check]:
    """Make the checks of `checks.GROWN`, and those of `PRINTING` about what lies over air; all required.

    - `islands`: places that begin in mid-air; `floating`: bodies that do not reach the bed.
    - `reach`: how far a layer lies over air, held on one side; `bridge`: held on two, straight across. A
      break-away bar is a bridge.
    - `overhang`: area of the undersides flatter than `LEAST_FLANK_DEG`, in patches that rise by more than the
      half of an arch as wide as a bridge: what is less rounds off a peak, which `reach` and `bridge` measure.
    - `legs`: the least stiffness of a leg's end while it stands free, against the drag of the nozzle
      (`follow_growth`, `longest_free_leg_mm`).
    - `feet`: the smallest foot's area in the first layer, against the section of the part's legs;
      `feet_level`: how far feet's undersides are above the lowest.
    - `tipping`: the angle by which the body that tips first can be tipped and comes back; what bars, a plate
      or strips on the bed join is one body.
    - `voids`: hollows in the matter, in which a foot would stand on nothing.
    """
    mesh = part.mesh
    cut = slice_layers(mesh, layer_mm)
    if not (cut.floor == 0).any():
        why = f"no line of the first layer, {layer_mm:g} mm high, would be printed"
        return [skip_check(name, why, required=True) for name in (*OVERHANGING, *GROWN)]
    grown = follow_growth(cut, part.wall_mm)
    air = find_over_air(cut, grown.held)
    return [
        _check_overhang(mesh, cut),
        skip_check("support_volume", "designed to print without supports"),
        _check_bridge(air),
        _check_floating(cut, grown),
        _check_islands(grown),
        _check_reach(air),
        _check_legs(grown, part.young_modulus_mpa),
        *_check_feet(mesh, cut, grown),
        _check_tipping(cut, grown),
        _check_voids(mesh),
    ]


def _named(at: Array, words: str = ", the first at ") -> str:
    return f"{words}{spot(at[0])}" if len(at) else ""


def _check_overhang(mesh: Mesh, cut: Slices) -> Check:
    normals, areas = mesh.normals
    steep = np.flatnonzero(-normals[:, 2] > np.cos(np.radians(LEAST_FLANK_DEG)) + ANGLE_TOLERANCE)
    share = share_above(mesh.vertices[mesh.faces[steep], 2], cut.bottom + cut.layer)
    steep, share = steep[share > 0], share[share > 0]
    area, at = 0.0, np.empty((0, 3))
    if len(steep):
        faces = mesh.faces[steep]
        label, _ = connect(
            faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1), len(mesh.vertices)
        )
        _, patch = np.unique(label[faces[:, 0]], return_inverse=True)
        z, of, count = mesh.vertices[faces.reshape(-1), 2], np.repeat(patch, 3), patch.max() + 1
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, of, z)
        np.maximum.at(high, of, z)
        long = high - low > ROUNDED_MM
        counted = np.where(long[patch], areas[steep] * share, 0.0)
        area = float(counted.sum()) / 100
        worst = np.argsort(-counted, kind="stable")
        at = mesh.vertices[faces[worst[counted[worst] > 0]]].mean(axis=1)
    detail = (
        f"area flatter than {LEAST_FLANK_DEG:g}° from the bed, in patches that rise by more than "
        f"{ROUNDED_MM:.1f} mm{_named(at, ', the largest face at ')}; printed without supports"
    )
    return at_most("overhang", area, 0.0, "cm²", detail, at=at)


def _check_bridge(air: OverAir) -> Check:
    span = np.where(np.isfinite(air.span), air.span, 0.0)
    return _check_longest(
        "bridge",
        span,
        air.place,
        MOST_BRIDGE_MM,
        "longest stretch that one layer lays over air between two sides",
    )


def _check_reach(air: OverAir) -> Check:
    reach = np.where(np.isfinite(air.span), 0.0, air.reach)
    return _check_longest(
        "reach",
        reach,
        air.place,
        MOST_REACH_MM,
        "how far one layer lies over air, held on one side",
    )


def _check_longest(name: str, length: Array, place: Array, limit: float, what: str) -> Check:
    longest = float(length.max(initial=0.0))
    at = place[worst_apart(length, place, APART_MM, limit)] if longest > 0 else place[:0]
    detail = f"{what}{_named(at, ', at ')}"
    return at_most(name, longest, limit, "mm", detail, tolerance=LENGTH_TOLERANCE_MM, at=at)


def _check_floating(cut: Slices, grown: Growth) -> Check:
    lowest = np.unique(grown.body, return_index=True)[1]
    aloft = lowest[cut.floor[lowest] > 0]
    at = grown.middle[aloft]
    detail = f"that do not reach the bed, of {len(lowest)}{_named(at)}; printed without supports"
    return at_most("floating", len(aloft), 0, "bodies", detail, at=at)


def _check_islands(grown: Growth) -> Check:
    at = grown.middle[grown.island]
    detail = f"that begin in mid-air, held by nothing below{_named(at)}; printed without supports"
    return at_most("islands", len(at), 0, "places", detail, at=at)


def _check_legs(grown: Growth, modulus: float) -> Check:
    ends = np.flatnonzero(grown.top & grown.held & (grown.limp > 0))
    if not len(ends):
        detail = "no leg stands free"
        return Check("legs", "pass", True, "none", LEAST_STIFFNESS_N_MM, "N/mm", detail)
    limp = grown.limp[ends] / modulus
    order = worst_apart(limp, grown.middle[ends], 0.0, 1 / LEAST_STIFFNESS_N_MM)
    worst = ends[order[0]]
    # the radius of a full round leg that would deflect as much
    radius = float(4 * grown.free[worst] ** 3 / (3 * np.pi * grown.limp[worst])) ** 0.25
    most = longest_free_leg_mm(radius, modulus)
    weak = int((limp * LEAST_STIFFNESS_N_MM > 1).sum())
    detail = (
        f"least stiffness of a leg's end while it prints, at {spot(grown.middle[worst])}: "
        f"{grown.free[worst]:.1f} mm stand free, and of a full leg of radius {radius:.2f} mm "
        f"{most:.1f} mm may; "
        f"{weak} of {len(ends)} are longer than they may"
    )
    at = grown.middle[ends[order]]
    return at_least("legs", 1 / float(limp[order[0]]), LEAST_STIFFNESS_N_MM, "N/mm", detail, at=at)


def _check_feet(mesh: Mesh, cut: Slices, grown: Growth) -> list[Check]:
    feet = np.flatnonzero(cut.floor == 0)
    legs = grown.round_mm2[grown.held & (grown.free > 0)]
    limit = LEAST_FOOT_SHARE * float(np.median(legs)) if len(legs) else 0.0
    area = grown.area[feet]
    lack = worst_apart(-area, grown.middle[feet], 0.0, -limit)
    at = grown.middle[feet[lack]]
    detail = (
        f"area of the smallest of {len(feet)} feet in the first layer{_named(at, ', at ')}, against "
        f"{LEAST_FOOT_SHARE:g} of a leg's section"
    )
    bottom = _find_undersides(mesh, cut, len(feet))
    uneven = bottom[:, 2] - cut.bottom
    high = worst_apart(uneven, bottom, 0.0, MOST_UNEVEN_MM)
    told = f"how far the highest of {len(feet)} feet is above the lowest{_named(bottom[high], ', at ')}"
    return [
        at_least("feet", float(area.min()), limit, "mm²", detail, at=at),
        at_most(
            "feet_level",
            float(uneven.max()),
            MOST_UNEVEN_MM,
            "mm",
            told,
            tolerance=LENGTH_TOLERANCE_MM,
            at=bottom[high],
        ),
    ]


def _find_undersides(mesh: Mesh, cut: Slices, feet: int) -> Array:
    """Return the lowest vertex (feet, 3) of each piece of the first layer."""
    low = mesh.vertices[mesh.vertices[:, 2] <= cut.bottom + cut.layer / 2]
    runs = cut.first, cut.left, cut.right, cut.piece
    rows = ((low[:, 1] - cut.south) / cut.row).clip(1, cut.rows - 2)
    foot = find_pieces(*runs, cut.layer, np.ascontiguousarray(low[:, 0]), rows)
    found = np.full((feet, 3), cut.bottom + cut.layer / 2)
    order = np.argsort(-low[:, 2], kind="stable")
    order = order[foot[order] >= 0]
    found[foot[order]] = low[order]  # the last one written, the lowest, wins
    return found


def _check_tipping(cut: Slices, grown: Growth) -> Check:
    """Check how far each body can be tipped, from its centre's height and margin within the feet."""
    bodies = int(grown.body.max()) + 1
    weight = np.bincount(grown.body, grown.area, bodies)
    moment = [np.bincount(grown.body, grown.area * x, bodies) for x in grown.middle.T]
    center: Array = np.column_stack(moment) / weight[:, None]
    runs = int(cut.first[cut.rows])
    y = cut.south + cut.row * np.repeat(np.arange(cut.rows), np.diff(cut.first[: cut.rows + 1]))
    ends = np.concatenate([np.column_stack([x[:runs], y]) for x in (cut.left, cut.right)])
    of = np.tile(grown.body[cut.piece[:runs]], 2)
    standing = np.unique(of)
    inside = [margin(center[body], ends[of == body]) for body in standing]
    tip = np.degrees(np.arctan2(inside, center[standing, 2] - cut.bottom))
    worst = worst_apart(-tip, center[standing], 0.0, -LEAST_TIP_DEG)
    at = center[standing[worst]]
    detail = (
        f"the angle by which the first of {len(standing)} loose bodies to tip comes back, of what hangs "
        f"together; its middle is at {spot(at[0])}"
    )
    return at_least("tipping", float(tip.min()), LEAST_TIP_DEG, "deg", detail, at=at)


def _check_voids(mesh: Mesh) -> Check:
    label, count = number_bodies(mesh)
    hollow = np.flatnonzero(body_volumes(mesh, label, count) < 0)
    first = np.unique(label[label >= 0], return_index=True)[1]
    at = mesh.vertices[label >= 0][first[hollow]]
    detail = f"hollows in the matter, in which nothing above stands{_named(at)}"
    return at_most("voids", len(hollow), 0, "hollows", detail, at=at)
