"""Check that a printer can make a part: walls, gaps, overhangs, bridges, islands, and whether it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import GROWN, OVERHANGING, PRINTING, Check
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import at_least, at_most, places, skip_check, spot, time_stage
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.surface import TooMuchWork
from knotfab_validators.printing.bridges import (
    Columns,
    Stretches,
    columns,
    find_islands,
    find_unsupported,
)
from knotfab_validators.printing.local_thickness import NEAR_MM, LocalThickness, Probe
from knotfab_validators.printing.standing import (
    Body,
    bodies,
    footprint,
    margin,
    overhang_areas,
    support_volume,
)
from knotfab_validators.printing.upright import Upright, check_upright

if TYPE_CHECKING:
    from knotfab_formats.piece import Printer

MOST_MM = 10_000.0  # a larger part would leave no fine grid; no printer is larger
FEATURE_TOLERANCE_MM = 1e-4  # the rounding of a wall in single precision, far from the origin
GAP_TOLERANCE = 0.08  # a share of the nozzle; see `printability_checks`
BED_MM = 1e-3  # tolerance of a height at the bed
UNNAMED = "no printer was named: measured only"
POWDER = "printed in powder, which carries the part wherever it lies: nothing overhangs, and nothing stands"
CARRIED = (*OVERHANGING, "standing")


@dataclass(frozen=True)
class _Settings:
    """A printer's figures, or the usual ones if there is no printer."""

    named: bool = False
    wall: float | None = None
    gap: float | None = None
    powder: bool = False
    layer: float = 0.2
    supports: bool = True
    overhang_deg: float = 45.0
    bridge: float | None = None
    support_cm3: float | None = None
    upright: Upright | None = None

    @property
    def unsupported(self) -> bool:
        """True if the part must print without supports."""
        return self.upright is None and self.named and not self.supports and not self.powder


def printability_checks(
    mesh: Mesh,
    printer: Printer | None,
    *,
    seconds: dict[str, float],
    stands: bool = False,
    desk: Array | None = None,
    lacking: str | None = None,
    proud: Callable[[Array], Array] | None = None,
    upright: Upright | None = None,
) -> list[Check]:
    """Make all checks of `names.PRINTING`, of a closed mesh in print coordinates (z up, bed at z = 0), mm.

    - `feature`, `gap`: the thinnest wall and gap against the printer's, required. Gaps may be 8 %
      narrower: a tube of m flat sides with the round one's volume stands out by r a² / 12 at its
      corners (a = 2 pi / m; 0.015 mm at r = 2 mm and m = 24), so that two strands whose centre
      lines keep their distance come up to twice as much closer in the file. Where it is known how
      far that is (`proud`), they may be that much narrower, if that is more.
    - `overhang`: area steeper than the printer's `max_overhang_deg`, cm²; `support_volume`: solid
      columns under it, cm³; `bridge`: longest stretch over air, where a ledge that is held on one
      side counts twice; `islands`: how many places begin in mid-air; `floating`: how many bodies do
      not reach the bed. With supports only the `support_volume` has a limit. Without, it has none,
      and there must be neither island nor floating body, no bridge longer than `max_bridge_mm`, and
      no overhang but such bridges.
    - `standing`: how far the middle of a body's mass lies inside the hull of its first layer, the
      least of all bodies that reach the bed; must not be negative where the part `stands`.

    A part printed in powder is only asked for `feature` and `gap`, and for `standing` if it `stands`.

    Args:
        mesh: closed, consistently wound, finite and free of crossings, else nothing here means
            anything. printer: None: measured against nothing.
        seconds: the time each group took is added to it.
        stands: whether the part is meant to stand. desk: (3, 3) the turn from print coordinates to those in
            which it does (z up); None: it stands as it is printed.
        lacking: why the mesh cannot be measured; all checks are skipped with it.
        proud: how far corners beside places (k, 3) stand out of the tube that the mesh stands for, mm.
        upright: the part, if it is designed to print without supports; the checks of `names.GROWN` are added.
    """
    asked = PRINTING if upright is None else (*PRINTING, *GROWN)
    if lacking is None and np.ptp(mesh.vertices, axis=0).max() > MOST_MM:
        lacking = f"the part is larger than {MOST_MM / 1000:g} m"
    if lacking is not None:
        return [skip_check(name, lacking) for name in asked]
    use = replace(_settings(printer), upright=upright)
    try:
        return _measure(mesh, use, seconds, stands, desk, proud)
    except TooMuchWork as error:
        return [skip_check(n, f"not tested: {error}", required=use.named) for n in asked]


def _measure(
    mesh: Mesh,
    use: _Settings,
    seconds: dict[str, float],
    stands: bool,
    desk: Array | None,
    proud: Callable[[Array], Array] | None,
) -> list[Check]:
    with time_stage(seconds, "feature"):
        probe = Probe(mesh)
        wall = probe.wall()
    near = NEAR_MM if use.gap is None else max(NEAR_MM, 1.5 * use.gap)
    with time_stage(seconds, "gap"):
        gap = probe.gap(near)
    what = "thinnest wall, between sides that are parallel within 30°"
    checks = [_check_width("feature", wall, what, use.wall, use, FEATURE_TOLERANCE_MM)]
    checks.append(_check_gap(gap, use, proud))
    if use.powder and not stands:
        return checks + [skip_check(name, POWDER) for name in CARRIED]
    if use.upright is not None:
        with time_stage(seconds, "upright"):
            checks += check_upright(use.upright, use.layer)
        with time_stage(seconds, "standing"):
            return [*checks, _check_stands(mesh, bodies(mesh), use, stands, desk)]
    with time_stage(seconds, "overhang"):
        grid = columns(mesh)
    with time_stage(seconds, "bridges"):
        air = find_unsupported(grid, use.layer)
    with time_stage(seconds, "overhang"):
        checks += _check_overhang(mesh, grid, air, use)
    checks.append(_check_bridge(air, use))
    with time_stage(seconds, "standing"):
        checks += _check_bed(mesh, air, use, stands, desk)
    if use.powder:
        return [skip_check(c.name, POWDER) if c.name in CARRIED[:-1] else c for c in checks]
    return checks


def _settings(printer: Printer | None) -> _Settings:
    if printer is None:
        return _Settings()

    return _Settings(
        named=True,
        wall=printer.min_wall_mm or printer.stated("nozzle_mm"),
        gap=printer.min_gap_mm or printer.stated("nozzle_mm"),
        powder=printer.process == "powder",
        layer=printer.layer_height_mm,
        supports=printer.supports,
        overhang_deg=printer.max_overhang_deg,
        bridge=printer.max_bridge_mm,
        support_cm3=printer.max_support_cm3,
    )


def _check_gap(
    gap: LocalThickness, use: _Settings, proud: Callable[[Array], Array] | None
) -> Check:
    what = "thinnest gap between surfaces"
    if use.powder:
        what += ", from which powder must come out"
    least = use.gap or 0.0
    tolerance = GAP_TOLERANCE * least
    narrow = gap.widths < least - tolerance
    if proud is not None and narrow.any():
        facets = np.maximum(2 * proud(gap.at[narrow]), tolerance)
        # the place with the largest shortfall decides, whatever its width
        k = int((gap.widths[narrow] + facets).argmin())
        first = np.flatnonzero(narrow)[k]
        order = np.concatenate([[first], np.delete(np.arange(len(gap.at)), first)])
        gap = LocalThickness(float(gap.widths[first]), gap.widths[order], gap.at[order])
        tolerance = float(facets[k])
    return _check_width("gap", gap, what, use.gap, use, tolerance)


def _check_width(
    name: str,
    found: LocalThickness,
    what: str,
    least: float | None,
    use: _Settings,
    tolerance: float,
) -> Check:
    required = least is not None
    if least is not None:
        against = f", against the least of the printer, {least:g} mm"
    else:
        against = f"; {UNNAMED}" if not use.named else "; the printer's nozzle is not given"
    if not np.isfinite(found.value):
        detail = f"{what}: no two places face each other{against}"
        return Check(name, "pass", required, "none", least, "mm", detail)
    detail = f"{what}, at {spot(found.at[0])}{against}"
    thin = max(1, int((found.widths < (least or 0.0) - tolerance).sum()))
    return at_least(
        name,
        found.value,
        least,
        "mm",
        detail,
        required=required,
        tolerance=tolerance,
        at=found.at[:thin],
    )


def _check_overhang(mesh: Mesh, grid: Columns, air: Stretches, use: _Settings) -> list[Check]:
    areas = overhang_areas(mesh, use.overhang_deg, use.layer)
    angle = f"steeper than {use.overhang_deg:g}° from the vertical, off the bed"
    counted = areas
    if use.unsupported:
        counted = np.where(_find_bridged(mesh, areas, air, grid.cell, use), 0.0, areas)
        angle += f", bridges of up to {use.bridge:g} mm left out"
    worst = np.argsort(-counted, kind="stable")[:20]
    worst = worst[counted[worst] > 0]
    centers = mesh.vertices[mesh.faces[worst]].mean(axis=1)
    place = f", the largest face at {spot(centers[0])}" if len(worst) else ""
    area = float(counted.sum()) / 100
    volume, tallest = support_volume(mesh, grid, use.overhang_deg, use.layer)
    limited = use.named and use.supports
    limit = use.support_cm3 if limited else None
    tower = f", tallest at {spot(tallest)}" if volume else ""
    return [
        at_most(
            "overhang",
            area,
            0.0 if use.unsupported else None,
            "cm²",
            f"area {angle}{place}{_supports(use)}",
            required=use.unsupported,
            at=centers,
        ),
        at_most(
            "support_volume",
            volume / 1000,
            limit,
            "cm³",
            f"of solid columns under all overhangs{tower}{_supports(use)}",
            required=limit is not None,
            at=[tallest] if volume else [],
        ),
    ]


def _find_bridged(mesh: Mesh, areas: Array, air: Stretches, cell: float, use: _Settings) -> Mask:
    """Mark faces (m,) that belong to bridges short enough to print."""
    from scipy.spatial import cKDTree

    short = air.bridged & (air.length <= _longest_bridge(use))
    cells = air.cell_place[short[air.cell_of]] if len(short) else air.cell_place
    inside = np.zeros(len(areas), dtype=np.bool_)
    some = np.flatnonzero(areas > 0)
    if not len(cells) or not len(some):
        return inside
    scale = np.array([1 / (1.5 * cell), 1 / (1.5 * cell), 1 / use.layer])
    middle = mesh.vertices[mesh.faces[some]].mean(axis=1)
    distance, _ = cKDTree(cells * scale).query(middle * scale, p=np.inf)
    inside[some] = distance <= 1.0
    return inside


def _check_bridge(air: Stretches, use: _Settings) -> Check:
    span = np.where(air.bridged, air.length, 2 * air.length)
    span = np.where(air.island, 0.0, span)
    order = np.argsort(-span, kind="stable")
    limit = use.bridge if use.unsupported else None
    longest = float(span[order[0]]) if len(order) else 0.0
    kind = ""
    if longest > 0:
        first = order[0]
        kind = ", a bridge" if air.bridged[first] else ", a ledge held on one side, counted twice"
        kind += f", at {spot(air.place[first])}"
    over = int((span > _longest_bridge(use)).sum()) if limit is not None else 0
    some = order[: max(1, over)] if longest > 0 else order[:0]
    return at_most(
        "bridge",
        longest,
        limit,
        "mm",
        f"longest stretch that one layer lays over air{kind}{_supports(use)}",
        required=limit is not None,
        tolerance=1e-9,
        at=air.place[some],
    )


def _check_bed(
    mesh: Mesh, air: Stretches, use: _Settings, stands: bool, desk: Array | None
) -> list[Check]:
    layer = use.layer + BED_MM
    found = bodies(mesh)
    aloft = [b for b in found if b.lowest[2] > layer]
    limit = 0.0 if use.unsupported else None
    lone = find_islands(mesh, air, layer)
    where = f", the first at {spot(aloft[0].lowest)}" if aloft else ""
    begin = f", the first at {spot(lone[0])}" if len(lone) else ""
    checks = [
        at_most(
            "floating",
            len(aloft),
            limit,
            "bodies",
            f"that do not reach the bed, of {len(found)}{where}{_supports(use)}",
            required=use.unsupported,
            at=[b.lowest for b in aloft],
        ),
        at_most(
            "islands",
            len(lone),
            limit,
            "places",
            f"that begin in mid-air, held by nothing below{begin}{_supports(use)}",
            required=use.unsupported,
            at=lone,
        ),
    ]
    return [*checks, _check_stands(mesh, found, use, stands, desk)]


def _check_stands(
    mesh: Mesh, found: list[Body], use: _Settings, stands: bool, desk: Array | None
) -> Check:
    layer = use.layer + BED_MM
    if desk is not None:
        return _check_turned(mesh, desk, layer, stands)
    return _check_standing(mesh, [b for b in found if b.lowest[2] <= layer], layer, stands)


def _check_turned(mesh: Mesh, desk: Array, layer: float, stands: bool) -> Check:
    """Check `standing` of a part that does not stand in its print pose; places are as printed."""
    turned = mesh.vertices @ desk.T
    lowest = np.array([0.0, 0.0, turned[:, 2].min()])
    stood = Mesh(turned - lowest, mesh.faces)
    check = _check_standing(
        stood, [b for b in bodies(stood) if b.lowest[2] <= layer], layer, stands
    )
    at = places([(np.array(p) + lowest) @ desk for p in check.at])
    detail = f"{check.detail}; measured as it stands, not as it is printed"
    return replace(check, detail=detail, at=at)


def _check_standing(mesh: Mesh, found: list[Body], layer: float, stands: bool) -> Check:
    if not found:
        detail = "nothing reaches the bed"
        return Check("standing", "fail" if stands else "pass", stands, "none", 0.0, "mm", detail)
    margins = [margin(b.center, footprint(mesh.vertices, b.faces, layer)) for b in found]
    worst = int(np.argmin(margins))
    center = found[worst].center
    tip = np.degrees(np.arctan2(margins[worst], center[2]))
    of = f", of {len(found)} bodies the one that tips first" if len(found) > 1 else ""
    detail = (
        f"how far the centre of mass lies inside the first layer's hull{of}; the centre is at "
        f"{spot(center)}, and it tips at {tip:.1f}°"
    )
    if not stands:
        detail += "; it need not stand"
    return at_least(
        "standing",
        margins[worst],
        0.0 if stands else None,
        "mm",
        detail,
        required=stands,
        tolerance=1e-6,
        at=places([center]),
    )


def _longest_bridge(use: _Settings) -> float:
    return np.inf if use.bridge is None else use.bridge + 1e-9


def _supports(use: _Settings) -> str:
    if not use.named:
        return f"; {UNNAMED}"
    return "; printed with supports" if use.supports else "; printed without supports"
