"""The polygonal thickness of the written knots: how thick a tube around them may be, and what limits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_formats.verdict import Check, Place
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_least, at_most, places, spot
from knotfab_validators.geometry.curves import Curves, cut_edges
from knotfab_validators.tube.critical_chords import CurvePoint, shortest_critical_chord

ROUNDING = 1e-12  # relative
STRAIGHT = 1e-5  # sine of a turn that may come from rounded coordinates
TOGETHER = 1e-3  # radians: consecutive turns of that kind with this sum are a bend


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
        """Whether a bend, rather than two strands, sets the thickness."""
        return self.half_dcsd is None or self.min_rad <= self.half_dcsd


def thickness(polygons: Sequence[Array], closed: Sequence[bool] | None = None) -> Thickness:
    """Compute the polygonal thickness of all polygons together, as a radius, in full double precision.

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
    """Return the smallest MinRad and its (knot, vertex); inf and None if nothing bends.

    Vertices without a turn are skipped: another program may have inserted them.
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
    """Find the vertices of a polygon (n, 3) at which it turns, and its open ends.

    Some of many tiny turns in a row are kept, so that a bend spread over thousands of vertices stays one.
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
    """Return how far rounding may let a measured number fall short of its limit."""
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
    """Check `length`: the centre lines together are at most `max_mm` long. Its place is on the longest."""
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


# Places of centre lines that face each other, told from neighbours along one strand.

MOST_SAMPLES = 200_000  # the limit on absurdly long curves
MOST_MOVES = 20_000_000  # moves of pairs in all steps; 11 m of a thin tube take 4 million, in 4 s
MOST_PAIRS = 20_000_000
STEPS = tuple((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b)


@dataclass(frozen=True)
class Samples:
    """Points along closed polygons, in order; all arrays have one entry per sample (n)."""

    point: Array  # (n, 3)
    knot: Ints
    edge: Ints  # index over all polygons
    arc: Array  # length along its knot
    ahead: Ints
    behind: Ints
    lengths: Array  # (knots,)
    step: float  # largest distance between two samples


@dataclass(frozen=True)
class StrandPairs:
    """Pairs i < j of samples that are near in space, but not neighbours along one strand.

    `facing`: pairs of two knots, or of two strands of one, from which the distance descends to a positive
    minimum. `far`: pairs of two knots, or at least `apart` along their knot.
    """

    i: Ints
    j: Ints
    facing: Mask
    far: Mask


def sample_curves(polygons: Sequence[Array], step: float) -> Samples:
    """Sample the edges of closed polygons at most `step` apart, and at all vertices."""
    total = sum(float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum()) for p in polygons)
    step = max(step, total / MOST_SAMPLES)
    point, knot, edge, arc, ahead, behind, lengths = [], [], [], [], [], [], []
    offset = edges = 0
    for k, polygon in enumerate(polygons):
        span = np.roll(polygon, -1, axis=0) - polygon
        length = np.linalg.norm(span, axis=1)
        which, part, _ = cut_edges(polygon, np.roll(polygon, -1, axis=0), step)
        point.append(polygon[which] + part[:, None] * span[which])
        arc.append((np.cumsum(length) - length)[which] + part * length[which])
        index = np.arange(len(which))
        ahead.append(np.roll(index, -1) + offset)
        behind.append(np.roll(index, 1) + offset)
        knot.append(np.full(len(which), k))
        edge.append(which + edges)
        lengths.append(float(length.sum()))
        offset += len(which)
        edges += len(polygon)
    return Samples(
        point=np.concatenate(point),
        knot=np.concatenate(knot),
        edge=np.concatenate(edge),
        arc=np.concatenate(arc),
        ahead=np.concatenate(ahead),
        behind=np.concatenate(behind),
        lengths=np.array(lengths),
        step=step,
    )


def arc_between(samples: Samples, i: Ints, j: Ints) -> Array:
    """Return the shorter way (n,) along their knot from samples to others."""
    along = np.abs(samples.arc[i] - samples.arc[j])
    return np.minimum(along, samples.lengths[samples.knot[i]] - along)


def strand_pairs(samples: Samples, reach: float, apart: float) -> StrandPairs:
    """Find pairs of samples within `reach` that face each other, or are `apart` along their knot.

    Whether two places of a knot face each other is found by descent: both are moved along the
    curve, sample by sample, as long as that lowers their distance. Neighbours meet; places that do not
    meet are on two strands. So a bend is no gap, whatever its length and radius, and two strands are
    two, however soon the curve comes back.

    Raises:
        ValueError: there are more than 20 million pairs within `reach`, or strands run side by side
            for so long that the descent would not end soon.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(samples.point)
    if tree.count_neighbors(tree, reach) > 2 * MOST_PAIRS:
        raise ValueError("the centre lines are so crowded that strands cannot be told apart")
    pairs = tree.query_pairs(reach, output_type="ndarray").astype(np.int64)
    i, j = pairs.min(axis=1), pairs.max(axis=1)
    other = samples.knot[i] != samples.knot[j]
    far = other | (arc_between(samples, i, j) >= apart)
    facing = other.copy()
    same = np.flatnonzero(~other)
    facing[same] = ~_meet(samples, i[same], j[same])
    keep = facing | far
    return StrandPairs(i[keep], j[keep], facing[keep], far[keep])


def _meet(samples: Samples, i: Ints, j: Ints) -> Mask:
    """Return which pairs of one knot descend to a single place."""
    count = np.int64(len(samples.point))
    start, where = np.unique(i * count + j, return_inverse=True)
    now = start.copy()
    active = np.arange(len(now))
    moves = 0
    for _ in range(10_000):
        if not len(active):
            break
        moves += len(active)
        if moves > MOST_MOVES:
            raise ValueError("strands run side by side for too long to be told apart")
        # pairs at the same place continue as one
        unique, back = np.unique(now[active], return_inverse=True)
        moved = _lower(samples, unique // count, unique % count, count)[back]
        changed = moved != now[active]
        now[active] = moved
        active = active[changed]
    one, other = now // count, now % count
    near = (one == other) | (samples.ahead[one] == other) | (samples.behind[one] == other)
    result: Mask = near[where]
    return result


def _lower(samples: Samples, i: Ints, j: Ints, count: np.int64) -> Ints:
    """Move each pair to whichever lies closest together: itself or one of its eight neighbours."""
    to_i = {-1: samples.behind[i], 0: i, 1: samples.ahead[i]}
    to_j = {-1: samples.behind[j], 0: j, 1: samples.ahead[j]}
    best, at = _square(samples, i, j) * (1 - 1e-12), i * count + j
    for a, b in STEPS:
        square = _square(samples, to_i[a], to_j[b])
        less = square < best
        best = np.where(less, square, best)
        at = np.where(less, to_i[a] * count + to_j[b], at)
    return at


def _square(samples: Samples, i: Ints, j: Ints) -> Array:
    d = samples.point[i] - samples.point[j]
    square: Array = np.einsum("ij,ij->i", d, d)
    return square
