"""Polygonal thickness of the written knots: how tight a tube around them may be, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.check import Check, Place, at_least, at_most, places, spot
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.tube.critical_chords import CurvePoint, shortest_critical_chord

__all__ = ["Thickness", "check_bend", "check_length", "check_thickness", "thickness"]

ROUNDING = 1e-12  # relative
STRAIGHT = 1e-5  # the sine of a turn that may be the rounding of coordinates
TOGETHER = 1e-3  # radians that such turns in a row come to: from then on they are a bend


@dataclass(frozen=True)
class Thickness:
    """The polygonal thickness `value` (a radius) and the two numbers it is the minimum of.

    `half_dcsd`, half the shortest doubly critical chord, is looked for only up to `min_rad`: None
    says that it is not shorter than that, or that there is no such chord. `min_rad_at` is (knot,
    vertex), None where nothing bends (`min_rad` inf); `dcsd_at` the two ends of the chord as
    (knot, edge, where on the edge from 0 to 1), `dcsd_points` their places. `point` is the vertex,
    or the middle of the chord, that decides. Knots, vertices and edges are counted from 0.
    """

    value: float
    min_rad: float
    min_rad_at: tuple[int, int] | None
    half_dcsd: float | None
    dcsd_at: tuple[CurvePoint, CurvePoint] | None
    dcsd_points: tuple[Place, Place] | None
    point: Place

    @property
    def bend_decides(self) -> bool:
        """True if a bend, rather than two strands, sets the thickness."""
        return self.half_dcsd is None or self.min_rad <= self.half_dcsd


def thickness(polygons: Sequence[Array], closed: Sequence[bool] | None = None) -> Thickness:
    """Return polygonal thickness of all polygons together, as a radius, at full double precision.

    The minimum of MinRad over the vertices, min(adjacent edges) / (2 tan(theta/2)) with theta the
    turning angle, and half the shortest doubly critical chord (Rawdon, "Approximating the
    thickness of a knot", 1998; "Approximating smooth thickness", 2000). All doubly critical
    chords count, not only local minima of the distance ("struts"); the minimum is the same, since
    from any other chord shorter than twice MinRad the distance can be lowered to a strut.

    Args:
        polygons: arrays (n, 3), n >= 2, of one unit. closed: all, by default.

    Raises:
        ValueError: there is no polygon, or a coordinate that is not finite.
    """
    if not polygons:
        raise ValueError("there is no polygon to measure")
    arrays = [np.asarray(p, dtype=np.float64) for p in polygons]
    if any(p.ndim != 2 or p.shape[1] != 3 or len(p) < 2 for p in arrays):
        raise ValueError("each polygon must be an array (n, 3) with at least two vertices")
    if not all(np.isfinite(p).all() for p in arrays):
        raise ValueError("a coordinate is not finite")
    is_closed = [True] * len(arrays) if closed is None else list(closed)
    min_rad, at = _find_min_rad(arrays, is_closed)
    chord = shortest_critical_chord(arrays, is_closed, up_to=2 * min_rad)
    half = chord.length / 2 if chord is not None else None
    point = arrays[0][0] if at is None else arrays[at[0]][at[1]]
    ends = None
    if chord is not None:
        one, other = places(chord.points)
        ends = (one, other)
        if chord.length / 2 < min_rad:
            point = chord.middle
    return Thickness(
        value=min_rad if half is None else min(min_rad, half),
        min_rad=min_rad,
        min_rad_at=at,
        half_dcsd=half,
        dcsd_at=None if chord is None else chord.ends,
        dcsd_points=ends,
        point=places([point])[0],
    )


def _find_min_rad(
    polygons: Sequence[Array], closed: Sequence[bool]
) -> tuple[float, tuple[int, int] | None]:
    """Find the smallest MinRad and its (knot, vertex); inf and None where nothing bends.

    Vertices at which nothing turns are no ends of edges: another program may have put them there.
    """
    best, at = float("inf"), None
    for k, (polygon, is_closed) in enumerate(zip(polygons, closed, strict=True)):
        kept = _find_turning(polygon, is_closed)
        if len(kept) < 3:
            continue
        radii = _bend_radii(polygon[kept], is_closed)
        vertex = int(np.argmin(radii))
        if radii[vertex] < best:
            best, at = float(radii[vertex]), (k, int(kept[vertex]))
    return best, at


def _find_turning(polygon: Array, closed: bool) -> Ints:
    """Find the vertices of a polygon (n, 3) at which it turns, and open ends.

    Where many in a row turn by next to nothing, some of them, so that a bend spread over thousands stays one.
    """
    n = len(polygon)
    one, other = polygon - np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0) - polygon
    off = np.linalg.norm(np.cross(one, other), axis=1)
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    sine = off / np.where(size > 0, size, 1.0)
    straight = (sine <= STRAIGHT) & (np.einsum("ij,ij->i", one, other) > 0)
    total = np.cumsum(np.where(straight, sine, 0.0))
    row = np.floor((total - np.maximum.accumulate(np.where(straight, 0.0, total))) / TOGETHER)
    straight &= np.diff(row, prepend=0.0) <= 0
    if not closed:
        straight[[0, -1]] = False
    return np.arange(n) if straight.all() else np.flatnonzero(~straight)


def _bend_radii(polygon: Array, closed: bool) -> Array:
    """Return MinRad (n,) at each vertex: 0 beside an edge of no length, inf where it is straight."""
    ahead = np.roll(polygon, -1, axis=0) - polygon
    length = np.linalg.norm(ahead, axis=1)
    unit = ahead / np.where(length > 0, length, 1.0)[:, None]
    before = np.roll(unit, 1, axis=0)
    shorter = np.minimum(length, np.roll(length, 1))
    # across / along is tan(theta / 2) of two unit vectors, exact for small angles too
    across = np.linalg.norm(unit - before, axis=1)
    along = np.linalg.norm(unit + before, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        radii = np.where(shorter > 0, shorter * along / (2 * across), 0.0)
    if not closed:
        radii[[0, -1]] = np.inf
    return radii


def _name_end(end: CurvePoint, place: Place) -> str:
    return f"knot {end[0]} vertex {end[1]} at {spot(place)}"


def _allow_rounding(limit: float | None) -> float:
    """Return the amount by which rounding may make a measured number fall short of its limit."""
    return ROUNDING * (limit or 0.0)


def check_thickness(curves: Curves, required_mm: float | None) -> Check:
    """Check `thickness`: the polygonal thickness is at least `required_mm`; None measures only.

    `required_mm` is the tube's radius and half the clearance.
    """
    try:
        found = thickness(curves.polygons, curves.closed)
    except ValueError as error:
        why = f"not tested: {error}"
        return Check("thickness", "fail", True, "untested", required_mm, "mm", why)
    at: list[Place] = [found.point]
    if not found.bend_decides and found.dcsd_at is not None and found.dcsd_points is not None:
        one, other = map(_name_end, found.dcsd_at, found.dcsd_points)
        detail = f"two strands decide, {one} and {other}"
    elif found.min_rad_at is not None:
        knot, vertex = found.min_rad_at
        detail = f"a bend decides, at knot {knot} vertex {vertex}, {spot(found.point)}"
    else:
        at, detail = [], "nothing bends and no strands face each other"
    tolerance = _allow_rounding(required_mm)
    return at_least("thickness", found.value, required_mm, "mm", detail, tolerance=tolerance, at=at)


def check_bend(curves: Curves, min_bend_radius_mm: float | None) -> Check:
    """Check `bend`: no bend radius (MinRad) of the centre lines is below `min_bend_radius_mm`."""
    radius, found = _find_min_rad(curves.polygons, curves.closed)
    at: list[Place] = []
    detail = "nothing bends"
    if found is not None:
        at = list(places([curves.polygons[found[0]][found[1]]]))
        detail = f"tightest at knot {found[0]} vertex {found[1]}, {spot(at[0])}"
    tolerance = _allow_rounding(min_bend_radius_mm)
    return at_least("bend", radius, min_bend_radius_mm, "mm", detail, tolerance=tolerance, at=at)


def check_length(curves: Curves, max_mm: float | None) -> Check:
    """Check `length`: the centre lines together are no longer than `max_mm`; at: where the longest is."""
    lengths = curves.lengths_mm
    longest = lengths.index(max(lengths))
    (start,) = places([curves.polygons[longest][0]])
    detail = f"{len(lengths)} knot{'s' if len(lengths) > 1 else ''}"
    if len(lengths) > 1:
        detail += f"; the longest is knot {longest}, {lengths[longest]:.1f} mm"
    detail += f", which starts at {spot(start)}"
    return at_most(
        "length", sum(lengths), max_mm, "mm", detail, tolerance=_allow_rounding(max_mm), at=[start]
    )
