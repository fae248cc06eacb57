"""Judge a bending plan: bend its rows again, and compare the wire with knots, pictures and tool."""

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

_TOUCH_MM = 0.01  # by which touching strands may seem to overlap
_SHORT_MM = 0.01  # rounding of the shortest straight


@dataclass(frozen=True)
class PieceShadow:
    """One view's picture, and the shadow of the round tube in it.

    `mask` (height, width) is the picture's silhouette, and `target` the same on the pixels of `geometry`.
    `inside_mm`, on these pixels too, is the depth of each inside the piece's shadow, on the wall.
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
        """Return how deep inside the piece's shadow the light sees points (k, 3), in mm at the points."""
        pixels, w = self.geometry.project(points)
        i = np.clip(np.rint(pixels[:, 1]).astype(int), 0, self.inside_mm.shape[0] - 1)
        j = np.clip(np.rint(pixels[:, 0]).astype(int), 0, self.inside_mm.shape[1] - 1)
        return np.asarray(self.inside_mm[i, j] * w)


def cast_shadows(
    scene: SettledScene, pictures: Sequence[Path], knots: Knots
) -> tuple[PieceShadow, ...]:
    """Cast the piece's shadow in each view, on the same wall as the validators (`receive`).

    Args:
        pictures: the file of each view.
        knots: in scene coordinates.
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
    """The wires as bent from a plan, and the checks on them; `ious` by view."""

    knots: tuple[BentWire, ...]
    ious: dict[str, float]
    least_distance_mm: float
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Judge:
    """Judges bending plans against the knots that they stand for."""

    curves: list[Array]
    shadows: tuple[PieceShadow, ...]
    material: Material
    tolerance: float
    floor: float
    types: tuple[str, ...]  # the knots' types

    def bend_again(self, plans: list[BendList], names: list[str], hidden: list[bool]) -> Verdict:
        """Bend the wires by their plans, and judge them.

        Args:
            names: of the plans' files.
            hidden: whether each wire's joint lies within all shadows.
        """
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
    """Check `wire_type`: the bent wires have the knots' types and do not touch.

    Bends become chords of 20 degrees or less, which keeps the type unless strands touch.
    """
    from knotfab_validators.geometry.curves import Curves
    from knotfab_validators.knots.knot_types import knot_checks

    polygons = tuple(replay(p, step_deg=20.0, step_mm=np.inf)[0][:-1] for p in plans)
    both = knot_checks(Curves(polygons, tuple(types), (True,) * len(polygons), None))
    # the worse of the two decides, and the detail quotes both
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
    """Check the bent wires against picture, knots and tool."""
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


# bending the wire again from its rows alone, and measuring it

_STEP_MM = 0.1  # spacing at which two curves are compared
_WINDOW = 30  # samples searched to either side for the nearest point
_APART_MM = 0.25  # spacing at which distances between strands are measured


def replay(rows: BendList, step_deg: float = 4.0, step_mm: float = 0.5) -> tuple[Array, Array]:
    """Bend a wire by the rows, and return its centre line from one end to the other.

    A frame moves along: t, the direction of the wire, and n, the side it bends to. A rotation by a takes n
    to n cos a + (t x n) sin a. A bend by b follows an arc of the row's radius and takes t to
    t cos b + n sin b.

    Returns:
        Points (k, 3), mm, whose first and last are the wire's ends, and where the bends begin (m, 3).
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
    """Return for each row the direction of the straight, and the side to which the wire then bends."""
    t, n = rows.direction, rows.normal
    found = []
    for row in rows.bends:
        # orthonormalised: rounding errors would double every few bends
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
    """Distances (mm) between two closed curves.

    `largest` and `mean` are plain distances; `across` is the largest across the rays of any view's light,
    the only kind that shows in a shadow. `at` is where on the first curve the largest is.
    """

    largest: float
    mean: float
    across: float
    at: tuple[float, float, float]


def measure_deviation(curve: Array, other: Array, lights: Sequence[Array]) -> Deviation:
    """Measure distances between two closed curves (n, 3) and (k, 3), both ways.

    Points are compared at about the same share of the way around, so that a strand that strayed is not
    excused by another one nearby.

    Args:
        other: runs in the same sense, from any start.
        lights: (3,) of each view; if empty, every direction counts as across.
    """
    first, second = sample_evenly(curve, _STEP_MM), sample_evenly(other, _STEP_MM)
    # both start where the first is nearest to the start of the other
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

    The share is lifted to a circle in two more dimensions, as wide as the curves, so that strands
    elsewhere are far away.
    """
    size = float(np.ptp(np.concatenate([points, others]), axis=0).max())

    def lifted(p: Array) -> Array:
        angle = 2 * np.pi * np.arange(len(p)) / len(p)
        return np.column_stack([p, size * np.cos(angle), size * np.sin(angle)])

    _, found = cKDTree(lifted(others)).query(lifted(points))
    # the circle shifts the answer along the strand a little: search a few mm about it
    window = (found[:, None] + np.arange(-_WINDOW, _WINDOW + 1)) % len(others)
    gap = points[:, None, :] - others[window]
    best = (gap * gap).sum(axis=2).argmin(axis=1)
    return np.asarray(window[np.arange(len(points)), best], dtype=np.int64)


def measure_least_distance(curves: list[Array], diameter: float) -> float:
    """Return the least distance (mm) between two strands, at most three diameters.

    Two places on one wire are different strands if the way along it is longer than a half circle about one
    diameter.
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
    """How far (mm) the wire's end moves if a bend is wrong by one degree.

    `worst` for the worst single bend; `typical` for independent errors of one degree in all bends.
    """

    worst: float
    typical: float


def measure_sensitivity(rows: BendList) -> Sensitivity:
    """Measure how errors of one degree in the bends move the wire's far end."""
    points, begins = replay(rows)
    pairs = zip(rows.bends, _carry_frames(rows), strict=True)
    axes = np.array([np.cross(t, n) for row, (t, n) in pairs if row.bend_deg > 0])
    arms = np.linalg.norm(np.cross(axes.reshape(-1, 3), points[-1] - begins), axis=1)
    moved = arms * np.deg2rad(1.0)
    return Sensitivity(float(moved.max(initial=0.0)), float(np.sqrt((moved**2).sum())))
