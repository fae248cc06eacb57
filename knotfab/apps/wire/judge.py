"""A bending plan judged: its rows are bent again, and set beside the knots, the picture and the tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.apps.wire.arcs import BendList
from knotfab.apps.wire.residual import DEPTH_FACTOR
from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import pair_nearby, sample_evenly
from knotfab.knots import Knots
from knotfab_formats.piece import Material
from knotfab_formats.report import BentWire
from knotfab_formats.scene import ResolvedView, SettledScene
from knotfab_formats.verdict import Check

if TYPE_CHECKING:
    from knotfab_validators.shadows.view import ViewGeometry


_TOUCH_MM = 0.01  # strands may come this much nearer than one diameter: they touch
_SHORT_MM = 0.01  # the shortest straight, for rounding


@dataclass(frozen=True)
class PieceShadow:
    """One view's picture and the piece's own shadow in it, by the validators' exact tube.

    `mask` is the picture's silhouette (height, width), `target` the same on the working frame of
    `geometry`; `inside_mm`, of that frame too, is how deep in the piece's shadow each pixel lies, on the
    receiver.
    """

    view: ResolvedView
    mask: Mask
    geometry: ViewGeometry
    target: Mask
    radius: float
    inside_mm: Array

    def iou(self, curves: list[Array]) -> float:
        """Return the IoU of the wires' shadow and the picture, at the validators' resolution."""
        from knotfab_validators.shadows.compare import overlap

        return overlap(_cast_shadow(curves, self.radius, self.geometry), self.target).iou

    def hides(self, points: Array) -> Array:
        """Measure how far inside the piece's shadow points (k, 3) are seen, in mm at the points."""
        pixels, w = self.geometry.project(points)
        i = np.clip(np.rint(pixels[:, 1]).astype(int), 0, self.inside_mm.shape[0] - 1)
        j = np.clip(np.rint(pixels[:, 0]).astype(int), 0, self.inside_mm.shape[1] - 1)
        return np.asarray(self.inside_mm[i, j] * w)


def cast_shadows(
    scene: SettledScene, pictures: Sequence[Path], knots: Knots
) -> tuple[PieceShadow, ...]:
    """Return the shadow of a piece in each view of a scene, beside that view's picture.

    On the wall that the validators take: a flat one where the scene's effect `wall` is off, or does not show.

    Args:
        pictures: the file of each view. knots: in scene coordinates.
    """
    from scipy.ndimage import distance_transform_edt

    from knotfab.design.frames import widen
    from knotfab.picture.read import read_target
    from knotfab_validators.shadows.compare import receive
    from knotfab_validators.shadows.frame import padded_mask, working_frame
    from knotfab_validators.shadows.view import view_geometry

    tolerance, found = scene.settings.tolerance_px, []
    for view, picture in zip(scene.views, pictures, strict=True):
        mask = widen(view, read_target(picture, view)).judged
        height, width = mask.shape
        frame = working_frame(width, height)
        whole, _ = receive(view_geometry(view, width, height), scene.effects, tolerance)
        geometry = whole.resample(frame)
        shadow = _cast_shadow([k.points for k in knots.knots], knots.radius_mm, geometry)
        inside = distance_transform_edt(shadow) * geometry.pixel_mm
        target = padded_mask(mask, frame)
        found.append(PieceShadow(view, mask, geometry, target, knots.radius_mm, inside))
    return tuple(found)


def _cast_shadow(curves: list[Array], radius: float, geometry: ViewGeometry) -> Mask:
    from knotfab_validators.shadows.tube_field import tube_field

    return tube_field(curves, radius, geometry).mask


@dataclass(frozen=True)
class Verdict:
    """What came of bending all rows; `ious` by the views' names, with its checks."""

    knots: tuple[BentWire, ...]
    ious: dict[str, float]
    least_distance_mm: float
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Judge:
    """Measures rows by bending them again, beside the knots that they stand for."""

    curves: list[Array]
    shadows: tuple[PieceShadow, ...]
    material: Material
    tolerance: float
    floor: float
    types: tuple[str, ...]  # the knots' types

    def of(self, plans: list[BendList], names: list[str], hidden: list[bool]) -> Verdict:
        """Return the verdict on the rows of all knots; names of their files; whether each joint is hidden."""
        lines = [replay(p)[0] for p in plans]
        lights = [s.geometry.light for s in self.shadows]
        knots = tuple(
            _measure_knot(names[k], plan, lines[k], self.curves[k], lights, hidden[k])
            for k, plan in enumerate(plans)
        )
        closed = [line[:-1] for line in lines]
        ious = {s.view.name: s.iou(closed) for s in self.shadows}
        least = measure_least_distance(closed, self.material.wire_diameter_mm)
        checks = check_wire(knots, self.material, self.tolerance, ious, self.floor, least)
        return Verdict(knots, ious, least, (*checks, check_type(plans, self.types)))


def _measure_knot(
    name: str, plan: BendList, line: Array, curve: Array, lights: Sequence[Array], hidden: bool
) -> BentWire:
    """Measure the result of one file, beside the knot that it stands for."""
    bent = [r for r in plan.bends if r.bend_deg > 0]
    joint = plan.bends[0].feed_mm + plan.bends[-1].feed_mm
    off, error = measure_deviation(curve, line[:-1], lights), measure_sensitivity(plan)
    return BentWire(
        file=name,
        length_mm=plan.length_mm,
        bends=len(bent),
        deviation_mm=off.largest,
        deviation_mean_mm=off.mean,
        deviation_across_mm=off.across,
        closing_error_mm=float(np.linalg.norm(line[-1] - line[0])),
        shortest_straight_mm=min([r.feed_mm for r in bent[1:]] + [joint]),
        largest_bend_deg=max((r.bend_deg for r in bent), default=0.0),
        joint_straight_mm=joint,
        joint_hidden=hidden,
        end_moves_mm_per_deg=error.worst,
        end_moves_mm_for_1_deg_everywhere=error.typical,
    )


def check_type(plans: Sequence[BendList], types: Sequence[str]) -> Check:
    """Check `wire_type`: the bent wires are the knots that they stand for, and apart.

    Bends are cut to chords of 20 degrees or less, which keeps the type as long as no strands touch.
    """
    from knotfab_validators.geometry.curves import Curves
    from knotfab_validators.knots.knot_types import knot_checks

    polygons = tuple(replay(p, step_deg=20.0, step_mm=np.inf)[0][:-1] for p in plans)
    both = knot_checks(Curves(polygons, tuple(types), (True,) * len(polygons), None))
    # the worse of the two checks decides; the detail quotes both
    worst = max(both, key=lambda check: ("pass", "skipped", "fail").index(check.status))
    detail = "; ".join(f"{check.name}: {check.detail}" for check in both)
    return replace(worst, name="wire_type", detail=detail, at=())


def check_wire(
    found: tuple[BentWire, ...],
    material: Material,
    tolerance: float,
    ious: Mapping[str, float],
    floor: float,
    least: float,
) -> tuple[Check, ...]:
    """Return the checks of a plan that was bent again."""
    from knotfab_validators.check import at_least, at_most

    view = min(ious, key=lambda name: ious[name])
    across = max(found, key=lambda k: k.deviation_across_mm)
    along = max(found, key=lambda k: k.deviation_mm)
    straight = min(found, key=lambda k: k.shortest_straight_mm)
    sharp = max(found, key=lambda k: k.largest_bend_deg)
    return (
        at_least(
            "wire_shadow", ious[view], floor, "", "IoU of the picture and the shadow of the wire as the "
            f"bending plan's files give it, view {view}",
        ),
        at_most(
            "wire_deviation", across.deviation_across_mm, tolerance, "mm",
            f"largest distance of the bent wire from the knot, across the light's rays ({across.file})",
        ),
        at_most(
            "wire_depth", along.deviation_mm, DEPTH_FACTOR * tolerance, "mm",
            f"largest distance of the bent wire from the knot in any direction ({along.file})",
        ),
        at_least(
            "wire_contact", least, material.wire_diameter_mm, "mm",
            "least distance between the centre lines of two strands", tolerance=_TOUCH_MM,
        ),
        at_least(
            "wire_straight", straight.shortest_straight_mm, material.min_straight_mm, "mm",
            f"shortest straight between two bends ({straight.file})", tolerance=_SHORT_MM,
        ),
        at_most(
            "wire_bend", sharp.largest_bend_deg, material.max_bend_deg, "deg",
            f"largest bend ({sharp.file})",
        ),
        at_most(
            "wire_closing", max(k.closing_error_mm for k in found), tolerance, "mm",
            "distance of the two ends that meet in the joint",
        ),
    )  # fmt: skip


# Bend the wire again from its rows alone, and measure the result.


_STEP_MM = 0.1  # between the places at which two curves are compared
_WINDOW = 30  # places to either side
_APART_MM = 0.25  # between the places of which distances of strands are taken


def replay(rows: BendList, step_deg: float = 4.0, step_mm: float = 0.5) -> tuple[Array, Array]:
    """Return the centre line that the rows give, from the start to the other end.

    Carries a frame along: `t` the direction of the wire and `n` the side it bends to. A rotation
    by a takes n to n cos a + (t x n) sin a; a bend by b moves along an arc of the row's radius to
    t cos b + n sin b.

    Returns:
        (k, 3) points in mm, and the place (m, 3) where each bend begins (rows with a bend). The
        first and last point are the wire's two ends, which a closed plan brings together.
    """
    at = rows.start.copy()
    points, begins = [at], []
    for row, (t, n) in zip(rows.bends, _carry_frames(rows), strict=True):
        pieces = max(1, int(np.ceil(row.feed_mm / step_mm)))
        points += [at + t * (row.feed_mm * (k + 1) / pieces) for k in range(pieces)]
        at = points[-1]
        if row.bend_deg <= 0:
            continue
        begins.append(at)
        bend, steps = np.deg2rad(row.bend_deg), max(1, int(np.ceil(row.bend_deg / step_deg)))
        for b in bend * (np.arange(steps) + 1) / steps:
            points.append(at + row.radius_mm * (np.sin(b) * t + (1 - np.cos(b)) * n))
        at = points[-1]
    return np.array(points), np.array(begins).reshape(-1, 3)


def _carry_frames(rows: BendList) -> list[tuple[Array, Array]]:
    """Return the direction of each row's straight, and the side that the wire then bends to."""
    t, n = rows.direction, rows.normal
    found = []
    for row in rows.bends:
        # kept at right angles and of length one: otherwise rounding doubles with every few bends
        t = t / np.linalg.norm(t)
        n = n - (n @ t) * t
        n = n / np.linalg.norm(n)
        angle, bend = np.deg2rad(row.rotation_deg), np.deg2rad(row.bend_deg)
        n = np.cos(angle) * n + np.sin(angle) * np.cross(t, n)
        found.append((t, n))
        t, n = np.cos(bend) * t + np.sin(bend) * n, np.cos(bend) * n - np.sin(bend) * t
    return found


@dataclass(frozen=True)
class Deviation:
    """Measure how far two closed curves are from each other (mm).

    `largest` and `mean` are plain distances, `across` is the largest distance across the rays of any
    view's light: the only kind that the shadows see.
    """

    largest: float
    mean: float
    across: float
    at: tuple[float, float, float]  # a place on the first curve


def measure_deviation(curve: Array, other: Array, lights: Sequence[Array]) -> Deviation:
    """Measure distances of the points of a closed curve (n, 3) from another (k, 3), both ways.

    Points answer to about the same share of the way around, so that another strand that passes
    close by does not excuse one that strayed.

    Args:
        other: begins anywhere and runs in the same sense.
        lights: (3,) of each view; none: every direction counts as across.
    """
    first, second = sample_evenly(curve, _STEP_MM), sample_evenly(other, _STEP_MM)
    # start both at the same place: the point of the first that is nearest to where the other begins
    shift = int(((first - second[0]) ** 2).sum(axis=1).argmin())
    first = np.roll(first, -shift, axis=0)
    there = _find_nearest(first, second)
    back = _find_nearest(second, first)
    gaps = np.concatenate([second[there] - first, second - first[back]])
    places = np.concatenate([first, first[back]])
    size = np.linalg.norm(gaps, axis=1)
    across = size if not len(lights) else np.zeros(len(gaps))
    for light in lights:
        ray = light - places
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        seen = np.linalg.norm(gaps - (gaps * ray).sum(axis=1)[:, None] * ray, axis=1)
        across = np.maximum(across, seen)
    x, y, z = places[int(size.argmax())]
    return Deviation(
        float(size.max()),
        float(size[: len(first)].mean()),
        float(across.max()),
        (float(x), float(y), float(z)),
    )


def _find_nearest(points: Array, others: Array) -> NDArray[np.int64]:
    """Find for each point the nearest of `others` at about the same share of the way around.

    The share becomes a circle in two more dimensions, wide enough that a strand elsewhere is farther
    than the right one, and flat enough that stretching moves nothing.
    """
    size = float(np.ptp(np.concatenate([points, others]), axis=0).max())

    def lifted(p: Array) -> Array:
        angle = 2 * np.pi * np.arange(len(p)) / len(p)
        return np.column_stack([p, size * np.cos(angle), size * np.sin(angle)])

    _, found = cKDTree(lifted(others)).query(lifted(points))
    # the circle draws the answer along the strand a little: the nearest within a few mm of it
    window = (found[:, None] + np.arange(-_WINDOW, _WINDOW + 1)) % len(others)
    gap = points[:, None, :] - others[window]
    best = (gap * gap).sum(axis=2).argmin(axis=1)
    return np.asarray(window[np.arange(len(points)), best], dtype=np.int64)


def measure_least_distance(curves: list[Array], diameter: float) -> float:
    """Measure the least distance (mm) of centre lines where they are different strands.

    Two places of one curve count as different strands when the way between them along the wire is
    longer than a half circle about one diameter: shorter ones are one bend. Distances above three
    diameters are not looked for: the answer is then three diameters.
    """
    even = [sample_evenly(c, _APART_MM) for c in curves]
    points = np.concatenate(even)
    for reach in (1.2 * diameter, 3.0 * diameter):
        pairs, along = pair_nearby(even, reach)
        a, b = pairs[along > 0.5 * np.pi * diameter + reach].T
        if len(a):
            return float(np.linalg.norm(points[a] - points[b], axis=1).min())
    return 3.0 * diameter


@dataclass(frozen=True)
class Sensitivity:
    """Measure how far the rest of the wire moves for one degree of error in a bend (mm).

    `worst` of any single bend; `typical`: of one degree at every bend, the errors independent.
    """

    worst: float
    typical: float


def measure_sensitivity(rows: BendList) -> Sensitivity:
    """Measure movement of the wire's far end for errors of one degree in bend angles."""
    points, begins = replay(rows)
    pairs = zip(rows.bends, _carry_frames(rows), strict=True)
    axes = np.array([np.cross(t, n) for row, (t, n) in pairs if row.bend_deg > 0])
    arms = np.linalg.norm(np.cross(axes.reshape(-1, 3), points[-1] - begins), axis=1)
    moved = arms * np.deg2rad(1.0)
    return Sensitivity(float(moved.max(initial=0.0)), float(np.sqrt((moved**2).sum())))
