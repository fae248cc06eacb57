"""Follow a drawing's centre lines by a template: one simple closed curve for each connected drawing.

The curve is the outline of a disc. The lines are a plane graph, of which some faces are filled so that the
curve runs once along a line between a filled and an empty face; their total length is made large, as a
maximum cut of the dual graph, by ascent. A line between two empty faces becomes a thin ribbon, one between
two filled faces a slit, and the curve runs along both there and back. Where lines meet, filled faces and
ribbons are joined into one disc. The joints form a spanning tree, so the outline is one simple curve.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import sample_evenly
from knotfab.start.filling import Template, join_curves, simple_curves, smooth_closed

# lengths in tube radii
_APART = 0.07  # half the distance between the two passes of a line, as the light sees them
_JOINT = 0.5  # distance from a crossing within which faces and ribbons are joined
_SIDE = 0.02  # distance from a line at which its faces are looked up
_STEP = 0.25  # distance between the curve's points
_WIDE = 1.2  # half width of a stroke from which two adjacent passes draw it better than one


def follow_strokes(
    lines: list[Array], polygon: MultiPolygon, radius: float, knots: int | None = None
) -> Template:
    """Lead one simple closed curve along the lines of each connected drawing.

    Args:
        lines: [(n, 2) mm] from `picture.strokes.trace_strokes`, which meet only at their ends.
        polygon: the silhouette, mm. radius: projected tube radius, mm.
        knots: None for one curve a drawing, or the number of curves to bridge them to.
    """
    step = _STEP * radius
    curves = [
        sample_evenly(np.asarray(_outline_disc(part, polygon, radius).coords)[:-1], step)
        for part in _connected(lines)
    ]
    if knots is not None:
        curves = join_curves(curves, radius, step, knots, keep=True)
    for sigma in (2.0, 1.0, 0.5):
        smoothed = [smooth_closed(curve, sigma) for curve in curves]
        if simple_curves(smoothed):
            curves = smoothed
            break
    return Template(tuple(curves), polygon, radius, passes=True)


def _connected(lines: list[Array]) -> list[list[LineString]]:
    """Group the lines that are connected by their ends."""
    groups: dict[tuple[float, float], int] = {}
    members: dict[int, list[LineString]] = {}
    for number, points in enumerate(lines):
        ends = [(float(x), float(y)) for x, y in points[[0, -1]]]
        met = {groups[end] for end in ends if end in groups}
        members[number] = [LineString(points)]
        for other in met:
            members[number] += members.pop(other)
        groups |= {end: number for end in ends}
        groups |= {end: number for end, group in groups.items() if group in met}
    return list(members.values())


@dataclass(frozen=True)
class _Plane:
    """Lines, the faces that they bound, and the face on each side of every line; 0 is the unbounded face."""

    lines: list[LineString]
    faces: list[Polygon]
    sides: list[tuple[int, int]]

    def face_at(self, x: float, y: float) -> int:
        """Return the number of the face that contains a point."""
        point = Point(x, y)
        return next((n for n, f in enumerate(self.faces, 1) if f.covers(point)), 0)


def _part_plane(lines: list[LineString], radius: float) -> _Plane:
    plane = _Plane(lines, list(shapely.polygonize(lines).geoms), [])
    for line in lines:
        one, end = (line.interpolate(0.5 + d, normalized=True) for d in (-1e-3, 1e-3))
        along = np.array([end.x - one.x, end.y - one.y])
        x, y = _SIDE * radius * along / np.hypot(*along)
        middle = line.interpolate(0.5, normalized=True)
        plane.sides.append(
            (plane.face_at(middle.x - y, middle.y + x), plane.face_at(middle.x + y, middle.y - x))
        )
    return plane


def _fill_faces(plane: _Plane, wide: list[bool]) -> list[bool]:
    """Choose the faces to fill, so that the total length of lines between filled and empty ones is large.

    Wide lines count negative, since the curve should run along them twice. The ascent flips one face or two
    neighbours at a time; the unbounded face stays empty.
    """
    count = len(plane.faces) + 1
    weight = np.zeros((count, count))
    for line, (one, other), twice in zip(plane.lines, plane.sides, wide, strict=True):
        if one != other:
            weight[one, other] += -line.length if twice else line.length
            weight[other, one] = weight[one, other]
    sign, pull = np.ones(count), weight.sum(axis=1)  # pull: weight @ sign
    better = True
    while better:
        better = False
        for one in range(1, count):
            moves = [(one,), *((one, int(other)) for other in np.flatnonzero(weight[one]) if other)]
            for move in moves:
                gain = 4.0 * sum(sign[i] * pull[i] for i in move)
                if len(move) == 2:
                    gain -= 8.0 * sign[move[0]] * sign[move[1]] * weight[move]
                if gain > 1e-9:
                    for i in move:
                        sign[i] *= -1.0
                        pull += 2.0 * sign[i] * weight[i]
                    better = True
    return [bool(s < 0) for s in sign]


def _is_wide(line: LineString, edge: BaseGeometry, radius: float) -> bool:
    """Return whether most of a stroke is wider than one tube draws; `edge` is the silhouette's outline."""
    at = shapely.line_interpolate_point(line, np.linspace(0.1, 0.9, 9), normalized=True)
    return bool(np.median(shapely.distance(at, edge)) > _WIDE * radius)


def _outline_disc(
    lines: list[LineString], polygon: MultiPolygon, radius: float
) -> shapely.LinearRing:
    """Return the closed curve along connected lines."""
    plane = _part_plane(lines, radius)
    edge = polygon.boundary
    filled = _fill_faces(plane, [_is_wide(line, edge, radius) for line in lines])
    apart, reach = _APART * radius, _JOINT * radius
    solid: list[BaseGeometry] = [f for f, on in zip(plane.faces, filled[1:], strict=True) if on]
    slits: list[BaseGeometry] = []
    for line, (one, other) in zip(lines, plane.sides, strict=True):
        if filled[one] == filled[other]:
            (slits if filled[one] else solid).append(line.buffer(apart))
    disc = shapely.union_all(solid)
    if slits:
        disc = disc.difference(shapely.union_all(slits))
    spokes = _join_at_ends(plane, filled, reach)
    joints = [Point(at) for at in spokes]
    if joints:
        disc = disc.difference(shapely.union_all([j.buffer(reach) for j in joints]))
        bars = [
            LineString([at, end]).buffer(apart, cap_style="square")
            for at, ends in spokes.items()
            for end in ends
        ]
        disc = shapely.union_all([disc, *bars])
    parts = [p for p in shapely.get_parts(disc) if isinstance(p, Polygon)]
    return max(parts, key=lambda p: p.area).exterior


def _join_at_ends(
    plane: _Plane, filled: list[bool], reach: float
) -> dict[tuple[float, float], list[Array]]:
    """Return for each crossing the points around it, in faces or ribbons, that are joined to it.

    Parts are joined only if they are not connected already.
    """
    meeting: dict[tuple[float, float], list[tuple[int, Array]]] = defaultdict(list)
    for number, line in enumerate(plane.lines):
        coords = np.asarray(line.coords)
        for end, way in ((coords[0], reach), (coords[-1], line.length - reach)):
            at = (float(end[0]), float(end[1]))
            near = line.interpolate(way)
            meeting[at].append((number, np.array([near.x, near.y]) - end))
    joined: dict[tuple[str, int], tuple[str, int]] = {}

    def root(part: tuple[str, int]) -> tuple[str, int]:
        while part in joined:
            part = joined[part]
        return part

    spokes: dict[tuple[float, float], list[Array]] = {}
    for at, ends in meeting.items():
        if len(ends) < 2:
            continue
        around = sorted(ends, key=lambda e: np.arctan2(e[1][1], e[1][0]))
        angles = [float(np.arctan2(way[1], way[0])) for _, way in around]
        block: dict[tuple[str, int], Array] = {}
        runs = 0
        for k, (number, way) in enumerate(around):
            one, other = plane.sides[number]
            if filled[one] == filled[other] and not filled[one]:
                runs += 1
                block.setdefault(root(("line", number)), np.array(at) + 1.2 * way)
            gap = (angles[(k + 1) % len(around)] - angles[k]) % (2 * np.pi) or 2 * np.pi
            turn = angles[k] + 0.5 * gap
            middle = np.array(at) + reach * np.array([np.cos(turn), np.sin(turn)])
            face = plane.face_at(*middle)
            if filled[face]:
                runs += 1
                end = np.array(at) + 1.2 * (middle - np.array(at))
                block.setdefault(root(("face", face)), end)
        if runs < 2:
            continue
        first, *rest = block
        for part in rest:
            joined[part] = first
        spokes[at] = list(block.values()) if rest else []
    return spokes
