"""Search again where a result falls short: without a limit, sparser, without bumps, or on more legs.

The searches without a limit price it: they show how much IoU it costs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.geometry.legs import Leg, peaks_of
from knotfab.plan import Search, Steps
from knotfab.problem import Problem, Start, TargetView
from knotfab.search.state import SearchResult
from knotfab.search.upright import FLANK_DEG
from knotfab.start.arches import LOWEST_ARCH_RADII
from knotfab.start.filling import Template
from knotfab.start.profiles import lift, lower
from knotfab.start.start import make_start
from knotfab_formats.report import Price
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import SearchSettings
from knotfab_formats.upright import LEAST_FLANK_DEG, MOST_BRIDGE_MM, ROUNDED_MM

SHORT: dict[str, Any] = {
    "method": "flow",
    "network_start": "filling",
    "coarse_px": 160,
    "fine_px": 224,
    "coarse_iterations": 32,
    "fine_iterations": 16,
    "settle_iterations": 16,
    "winners_every": 4,
    "depth_candidates": 4,
}
_NEAR = 0.05  # margin, as a share of a limit, below which it binds
_GAIN = 0.005  # gain in IoU below which a limit counts as free of cost
_USUAL_CLEARANCE = 0.4  # a scene's default, mm
_KEYS = {  # for each limit: its key, its name, and words for the figure that is reached without it
    "bend": ("[material] min_bend_radius_mm", "the bend limit", "bends to {} mm"),
    "clearance": ("[piece] clearance_mm", "the clearance", "leaves gaps of {} mm"),
    "region": ("[region] size_mm", "the region", "takes {} mm of room"),
    "length": ("[material] max_length_mm", "the length budget", "is {} mm long"),
}


def _word(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(_word(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float | int) else str(value)


def binding_limits(
    problem: Problem, result: SearchResult, roomy: SettledRegion
) -> dict[str, Problem]:
    """Return the limits that bind, each with the problem in which it is loosened.

    A limit binds if it is broken or barely kept. The tube's own bend limit and the default clearance are not
    the scene's choice, so they never count. `roomy` is a region that does not constrain the pictures.
    """
    state, limits = result.feasibility, result.feasibility.limits
    own_bend = limits.radius + 0.5 * problem.clearance
    close = {
        "bend": limits.bend_radius > own_bend * (1 + 1e-9)
        and state.bend_mm < (1 + _NEAR) * limits.bend_radius,
        "clearance": problem.clearance > _USUAL_CLEARANCE
        and state.gap_mm < (1 + _NEAR) * limits.separation,
        "region": problem.region != roomy and state.outside_mm > -0.25 * limits.radius,
        "length": state.length_mm > (1 - _NEAR) * limits.length,
    }
    return {name: _loosen(problem, (name,), roomy) for name, binds in close.items() if binds}


def _loosen(problem: Problem, names: Sequence[str], roomy: SettledRegion) -> Problem:
    """Return the problem with these limits loosened."""
    free: dict[str, tuple[str, Any]] = {
        "bend": ("bend_radius", None),
        "clearance": ("clearance", _USUAL_CLEARANCE),
        "region": ("region", roomy),
        "length": ("length", 1e9),
    }
    return replace(problem, **dict(free[name] for name in names))


def plan_prices(
    problem: Problem,
    start: Start,
    result: SearchResult,
    settings: SearchSettings,
    roomy: SettledRegion,
    iou: float | None = None,
) -> Steps[tuple[Price, ...]]:
    """Price each binding limit in IoU of the worst view, dearest first, or all if none costs by itself.

    Args:
        start: the start of the short searches. iou: of the part that keeps the limits, if `result` does not.
    """
    short, radius = settings.but(**SHORT), result.knots.radius_mm
    candidates = binding_limits(problem, result, roomy)
    here = result.iou_estimate if iou is None else iou

    def price(names: tuple[str, ...], free: Problem) -> Steps[Price]:
        told = " and ".join(_KEYS[name][1] for name in names)
        other = yield Search(
            f"short search without {told}", free, start, radius, short, "for its price"
        )
        return _price(names, problem, other, result, here)

    found = []
    for name, free in candidates.items():
        found.append((yield from price((name,), free)))
    found = [
        p for p in found if p.iou_without > here + _GAIN or (p.met_without and iou is not None)
    ]
    if not found and len(candidates) > 1:
        names = tuple(candidates)
        both = yield from price(names, _loosen(problem, names, roomy))
        found = [both] if both.iou_without > here + _GAIN else []
    return tuple(sorted(found, key=lambda p: (p.met_without, p.iou_without), reverse=True))


def _price(
    names: tuple[str, ...], problem: Problem, other: SearchResult, result: SearchResult, here: float
) -> Price:
    radius = result.knots.radius_mm
    points = np.concatenate([k.points for k in other.knots.knots])
    extents = tuple((np.ptp(points, axis=0) + 2 * radius).round(2).tolist())
    limits = result.feasibility.limits
    asked = {
        "bend": limits.bend_radius,
        "clearance": limits.clearance,
        "region": problem.region.size_mm,
        "length": limits.length,
    }
    needed = {
        "bend": other.feasibility.bend_mm,
        "clearance": other.feasibility.gap_mm - 2 * radius,
        "region": extents,
        "length": other.feasibility.length_mm,
    }
    found = [needed[name] for name in names]
    return Price(
        limits=names,
        keys=tuple(_KEYS[name][0] for name in names),
        asked=tuple(asked[name] for name in names),
        needed=tuple(found),
        iou=here,
        iou_without=other.iou_estimate,
        met_without=not other.feasibility.violations,
        sentence=_tell(names, asked, found, here, other),
    )


def _tell(
    names: tuple[str, ...],
    asked: dict[str, Any],
    needed: Sequence[Any],
    here: float,
    other: SearchResult,
) -> str:
    """Write the sentence that says what the limits cost."""
    named = " and ".join(f"{_KEYS[n][1]} ({_KEYS[n][0]} = {_word(asked[n])} mm)" for n in names)
    each = zip(names, needed, strict=True)
    found = " and ".join(_KEYS[name][2].format(_word(value)) for name, value in each)
    rest = "; another limit is broken then" if other.feasibility.violations else ""
    verb = "binds" if len(names) == 1 else "bind together"
    return (
        f"{named[0].upper()}{named[1:]} {verb}: the IoU is {here:.3f} with it, and "
        f"{other.iou_estimate:.3f} without it, by a short search whose piece {found}{rest}."
    )


# Sparser strands, or rings, where no filling of the pictures keeps every limit.

# with these settings the search takes nearly no steps
_STILL = {**SHORT, "coarse_iterations": 0, "fine_iterations": 0, "settle_iterations": 2}
_WIDER = (1.5, 2.5, 4.0, 6.5, 10.0, 16.0)  # spacings of the strands to try, in tube radii


def plan_sparser(
    problem: Problem, radius: float, knots: int | None, settings: SearchSettings
) -> Steps[SearchResult | None]:
    """Search with sparser strands until a result is feasible; return None if none is.

    The pictures are filled as if by ever thicker tubes, whose strands are further apart and bend less. One
    view is tried with depth and then flat, and last come rings.

    Args:
        radius: of the tube, mm. knots: as for `make_start`.
    """
    for what, asked, start, steps in _tries(problem, radius, knots, settings):
        few, why = settings.but(**steps), "it breaks a limit"
        result: SearchResult = yield Search(f"search of {what}", asked, start, radius, few, why)
        if result.feasible:
            return result
    return None


def _tries(
    problem: Problem, radius: float, knots: int | None, settings: SearchSettings
) -> Iterator[tuple[str, Problem, Start, dict[str, Any]]]:
    """Yield each attempt's name, problem, start and search settings."""
    limits = problem.limits(radius)
    least = max(0.5 * limits.separation, limits.bend_radius) / radius
    wide = {*(w for w in _WIDER if w < least), *(least * w for w in _WIDER)}
    widest = 0.5 * float(np.sqrt(min(p.area for p in problem.polygons)))
    one = len(problem.views) == 1
    flat = replace(problem, depth_mm=None)
    short = settings.but(**SHORT)
    for spacing in sorted(wide):
        if 0.5 * least < spacing and spacing * radius < widest:
            for asked in (problem, flat) if one else (problem,):
                try:
                    sparse = make_start(asked, radius, short, knots, spacing)
                    what = f"strands {2 * spacing * radius:.1f} mm apart"
                    yield what + (", flat" if asked is flat else ""), asked, sparse, SHORT
                except SceneError:
                    continue
    if not one or problem.knot != "unknot":
        return
    # evening its edges bends a ring more than a circle, so try sizes above the bend limit's
    for size in (1.1, 1.3, 1.6):
        ring = _ring(problem, size * least * radius, radius)
        yield "a ring", flat, make_start(flat, radius, short, template=ring), _STILL


def _ring(problem: Problem, least: float, radius: float) -> Template:
    """Return a ring at the silhouette's largest inscribed circle, with a radius of at least `least`, mm."""
    polygon = problem.polygons[0]
    line = shapely.maximum_inscribed_circle(polygon)
    middle = np.asarray(line.coords[0])
    size = max(line.length - radius, least, 2 * radius)
    turn = 2 * np.pi * np.arange(256) / 256
    ring = middle + size * np.stack([np.cos(turn), np.sin(turn)], 1)
    return Template((ring,), polygon, radius)


# Bumps: where a strand steps aside past another and leaves the picture.

# distance of a centre line from the picture, in radii, above which it is a bump; those are about 1 outside
_OUTSIDE = 0.5


def start_without_bumps(
    problem: Problem,
    result: SearchResult,
    radius: float,
    settings: SearchSettings,
    knots: int | None,
) -> Start | None:
    """Make a start whose strands keep their order, if a search has led to bumps; None without bumps.

    Args:
        radius: of the tube, mm. knots: as for `make_start`.
    """
    one = len(problem.views) == 1
    given = settings.start or settings.free_view or settings.network_start == "circle"
    if not one or given or problem.depth_mm is None or problem.views[0].lines:
        return None
    if _farthest_outside(result, problem.views[0]) <= _OUTSIDE * radius:
        return None
    try:
        return make_start(problem, radius, settings, knots, parted=True)
    except SceneError:
        return None


def is_better(one: SearchResult, other: SearchResult) -> bool:
    """Return whether one result is preferred to another: by feasibility, then by IoU."""
    if one.feasible != other.feasible:
        return one.feasible
    return one.iou_estimate > other.iou_estimate


def _farthest_outside(result: SearchResult, target: TargetView) -> float:
    """Return how far centre lines stand outside the picture, mm in the plane z = 0."""
    points = np.concatenate([knot.points for knot in result.knots.knots]) @ target.axes.T
    seen = lower(points, target.view.light_distance_mm)
    shapely.prepare(target.polygon)
    return float(shapely.distance(target.polygon, shapely.points(seen)).max())


# Legs: where a strand without supports ends up too far from all others for a bar, or too flat.

_FLATTEST_DEG = LEAST_FLANK_DEG + 3.0  # least mean slope of a leg, parts of which are flatter
# greatest height of the arch before a leg that is flat in places, over the leg's: 46 degrees become 57
_LOW_SHARE = 0.25
# a strand that is no higher above its foot lies on the bed: so much is cut off, or stands in a plate
_LYING_RADII = 0.5
_ROUNDING_MM = 1e-9  # by so much a gap at a crossing may shrink
_SEEN_EVERY = 8  # points along a leg, each that is looked for in the start


def start_on_more_legs(
    problem: Problem, start: Start, found: SearchResult, ended: bool = False, every: bool = False
) -> Start | None:
    """Add an arch for each leg that has no neighbour to brace it, or is too flat; None where none is amiss.

    An arch with a leg of the first kind becomes two. A flat leg, whose strand is too long for its height,
    gets a low arch before it. Strands move along the light's rays. Of two that cross, as seen from there, the
    nearer one stays nearer, by a tube's width unless it was less: knots keep their types.

    Args:
        found: what a search made of the start's curves, whose legs are looked at.
        ended: whether that is what is printed: a leg may then lie on the bed before it rises.
        every: whether to return None as well if a leg that is amiss cannot be changed.
    """
    if not problem.arched:
        return None
    light, radius = problem.views[0].view.light_distance_mm, found.knots.radius_mm
    axes, legs = found.braced.axes, found.braced.legs
    curves = [curve @ axes.T for curve in start.curves]
    plans = [lower(curve, light) for curve in curves]
    floor = min(float(curve[:, 2].min()) for curve in curves)
    ends, shares = _find_crossings(plans)
    begun = [curve[:, 2] - floor for curve in curves]
    # curves, with the ends of the legs that are changed; the top alone, where its arch is halved
    changed, kept = set[tuple[int, int, int]](), list[Leg]()

    def find(leg: Leg) -> Indices:
        """Find the vertices of the start that have become a leg."""
        # a search keeps the places in the picture, but lengthens some stretches more than others
        return _find_stretch(begun[leg.curve], plans[leg.curve], lower(leg.points, light))

    def find_gaps() -> tuple[Array, Array]:
        """Find the heights (n,) and how much nearer to the light each crossing's second edge is, (k,) mm."""
        heights = np.concatenate(curves)[:, 2]
        near = 1.0 / (light - heights)  # linear along an edge's picture
        return heights, -np.diff(1.0 / (shares * near[ends]).sum(axis=2))[:, 0]

    def change(leg: Leg, low: int, top: int, height: Array | None) -> None:
        before, (heights, gaps) = curves[leg.curve], find_gaps()
        if height is not None:
            curves[leg.curve] = lift(plans[leg.curve], height + floor, light)
            moved, now = find_gaps()
            least = np.minimum(np.abs(gaps), 2.0 * radius) - _ROUNDING_MM
            # edges that rise along a ray cross in no one point, and have no gap: they must stay
            stay = (np.abs(moved - heights) < _ROUNDING_MM)[ends].all(axis=(1, 2))
            if (stay | (now * np.sign(gaps) > least)).all():
                changed.add((leg.curve, low, top))
                return
        curves[leg.curve] = before
        kept.append(leg)

    for spot in found.braced.lacking:
        leg = min(legs, key=lambda one: float(np.linalg.norm(one.points - spot, axis=1).min()))
        places = find(leg)
        top = int(places[-1]) if len(places) else -1
        if top >= 0 and (leg.curve, top, top) not in changed:  # both legs of an arch may lack one
            heights = curves[leg.curve][:, 2] - floor
            change(leg, top, top, _halve_arch(heights, plans[leg.curve], top, radius))

    lying = _LYING_RADII * radius if ended else 0.0

    def add_arches(is_flat: Callable[[Leg], bool], most: float = 0.0) -> None:
        for leg in filter(is_flat, legs):
            rise, along = _rise_of(leg, lying)
            share = 0.5 * (along * np.tan(np.radians(FLANK_DEG)) / rise - 1.0)
            # a leg that is steep but for a flat place gets the lowest arch, and is steeper still
            share = max(share, min(1.01 * LOWEST_ARCH_RADII * radius / rise, most))
            if not len(places := find(leg)):
                continue
            low, top = places[[0, -1]].tolist()
            if not changed & {(leg.curve, low, top), (leg.curve, top, top)}:
                heights = curves[leg.curve][:, 2] - floor
                change(leg, low, top, _add_arch(heights, plans[leg.curve], places, share, radius))

    add_arches(lambda leg: _is_flat(leg, lying))
    if not changed:  # a further search may well straighten a leg that is flat in places
        add_arches(_is_flat_in_places, _LOW_SHARE)
    if not changed or (every and kept):
        return None
    return replace(start, curves=tuple(c @ axes for c in curves))


def has_valley_aloft(found: SearchResult) -> bool:
    """Return whether a valley is left above the floor, where it would begin in mid-air."""
    feet = [leg.points[0, 2] for leg in found.braced.legs]
    return bool(feet) and max(feet) - min(feet) > _LYING_RADII * found.knots.radius_mm


def _steps_along(leg: Leg) -> Array:
    """Return how far each step along a leg goes over the bed, (n - 1,) mm."""
    return np.asarray(np.linalg.norm(np.diff(leg.points[:, :2], axis=0), axis=1))


def _rise_of(leg: Leg, lying: float) -> tuple[float, float]:
    """Return how far a leg rises, and goes over the bed, from where it is `lying` above its foot, mm."""
    height = leg.points[:, 2] - leg.points[0, 2]
    first = int(np.flatnonzero(height <= lying)[-1])
    return float(height[-1] - height[first]), float(_steps_along(leg)[first:].sum())


def _is_flat(leg: Leg, lying: float) -> bool:
    rise, along = _rise_of(leg, lying)
    return bool(MOST_BRIDGE_MM < rise < along * np.tan(np.radians(_FLATTEST_DEG)))


def _is_flat_in_places(leg: Leg) -> bool:
    """Return whether a stretch that is too flat to print rises by more than what rounds a peak off."""
    rises = np.diff(leg.points[:, 2])
    flat = rises < _steps_along(leg) * np.tan(np.radians(LEAST_FLANK_DEG))
    stretch = np.cumsum(np.diff(flat, prepend=False))[flat]
    return bool((np.bincount(stretch, rises[flat]) > ROUNDED_MM).any())


def _find_crossings(plans: list[Array]) -> tuple[Indices, Array]:
    """Find where edges of closed curves [(n, 2)] cross or touch others.

    Returns the numbers (k, 2, 2) of the vertices at the ends of both edges, and these vertices' shares
    (k, 2, 2) in the crossing, which are not numbers where the edges are parallel.
    """
    points = np.concatenate(plans)
    numbers = np.split(np.arange(len(points)), np.cumsum([len(plan) for plan in plans])[:-1])
    following = np.concatenate([np.roll(own, -1) for own in numbers])
    edges = shapely.linestrings(np.stack([points, points[following]], axis=1))
    one, other = shapely.STRtree(edges).query(edges, predicate="intersects")
    apart = (one < other) & (following[one] != other) & (following[other] != one)
    pairs = np.column_stack([one, other])[apart]
    way = (points[following] - points)[pairs]
    between = points[pairs[:, 1]] - points[pairs[:, 0]]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = _cross(between[:, None], way[:, ::-1]) / _cross(way[:, 0], way[:, 1])[:, None]
    return np.stack([pairs, following[pairs]], axis=2), np.stack([1.0 - at, at], axis=2)


def _cross(one: Array, other: Array) -> Array:
    """Return the cross products of vectors (..., 2)."""
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def _shares_of(way: Array) -> Array:
    """Return how far along a polyline (n, 2) its vertices are, 0 to 1."""
    along = np.cumsum(np.linalg.norm(np.diff(way, axis=0, prepend=way[:1]), axis=1))
    return np.asarray(along / along[-1])


def _halve_arch(height: Array, plan: Array, at: int, radius: float) -> Array | None:
    """Replace an arch in a ring of heights (n,) over a plan (n, 2) by two, half as high and wide.

    None if it is low.
    """
    count, valleys = len(height), np.sort(peaks_of(-height))
    if not len(valleys):
        return None
    end = int(np.searchsorted(valleys, at, side="right"))
    first, last = int(valleys[end - 1]), int(valleys[end % len(valleys)])
    places = np.arange(first, first + (last - first - 1) % count + 2) % count
    arch = height[places]
    if 0.5 * arch.max() < LOWEST_ARCH_RADII * radius:
        return None
    u = _shares_of(plan[places])
    base = arch[0] + (arch[-1] - arch[0]) * u
    halved = height.copy()
    halved[places] = base + 0.5 * np.interp(2.0 * u % 1.0, u, arch - base)
    return halved


def _find_stretch(height: Array, plan: Array, seen: Array) -> Indices:
    """Find the vertices from a valley up to a peak of a ring of heights (n,) that draw a leg `seen` (k, 2).

    Over the plan (n, 2) that is the stretch nearest to the whole of the leg: a strand beside it may be
    nearer to either end. Empty without a peak.
    """
    count, peaks = len(height), peaks_of(height)
    if not len(peaks):
        return np.empty(0, dtype=np.int64)
    found = [
        (valley + way * np.arange((way * (peaks - valley) % count).min() + 1)) % count
        for valley in peaks_of(-height)
        for way in (1, -1)
    ]
    lines = np.array([shapely.LineString(plan[places]) for places in found])
    away = shapely.distance(lines[:, None], shapely.points(seen[::_SEEN_EVERY])[None])
    return np.asarray(found[int(away.mean(axis=1).argmin())])


def _add_arch(
    height: Array, plan: Array, places: Indices, share: float, radius: float
) -> Array | None:
    """Insert an arch of a share of a leg's height before it in a ring of heights (n,) over a plan (n, 2).

    All three flanks become equally steep. The leg is at these places of the ring. None if the arch is low.
    """
    leg = height[places]
    if share * (leg[-1] - leg[0]) < LOWEST_ARCH_RADII * radius:
        return None
    u, wide = _shares_of(plan[places]), share / (2.0 * share + 1.0)
    shape = np.interp(
        np.where(u < 2 * wide, 1.0 - np.abs(u / wide - 1.0), (u - 2 * wide) / (1.0 - 2 * wide)),
        u,
        leg - leg[0],
    )
    more = height.copy()
    more[places] = leg[0] + np.where(u < 2 * wide, share, 1.0) * shape
    return more
