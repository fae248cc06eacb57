"""Adversarial steps against the certificate: none that it lets pass may carry a strand through another.

Steps aim one edge at the nearest other, or shake, stretch, turn and collapse the polygons at sizes from
a millionth to a thousand times their gap; neighbour lists are left to age. Each accepted step is judged
again by the exact times at which edges meet, and each run's end by knot and link invariants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import shapely
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from benchmarks.hard.crossing import linking_number, passes_through
from benchmarks.hard.pictures import HardKnot
from knotfab.base.arrays import Array, Mask
from knotfab.geometry.carry import certify
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.picture.strokes import Line, trace_strokes
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types

RUN = 500  # steps from a fresh start


@dataclass(frozen=True)
class Fuzzed:
    """What came of so many steps: accepted, would have crossed and refused, crossed and accepted (faults)."""

    name: str
    steps: int
    accepted: int
    crossing: int
    faults: int
    changed: int  # runs whose invariants changed


def types_of(polygons: list[Array]) -> str | None:
    """Return knot types and linking, as the validators find them; None where strands are too near to tell."""
    n = len(polygons)
    found = knot_types(Curves(tuple(polygons), ("unknot",) * n, (True,) * n, 1.0))
    if found.touching is not None or found.tangled:
        return None
    linking = sorted(abs(number) for *_, number in found.linking.numbers)
    names = sorted(str(k.identity.knots) for k in found.knots)
    return f"{names} {found.linking.state} {linking}"


def _same(before: list[Array], after: list[Array]) -> bool:
    """Tell whether the invariants agree: linking always, the rest where the validators can tell."""
    if len(before) == 2 and abs(linking_number(*before) - linking_number(*after)) > 1e-3:
        return False
    was, now = types_of(before), types_of(after)
    return was is None or now is None or was == now


def fuzz(case: HardKnot, steps: int, seed: int) -> Fuzzed:
    """Return `steps` adversarial steps from the case's polygons, a fresh start every so many."""
    rng = np.random.default_rng(seed)
    start = case.make()
    rings = polylines_of_sizes(tuple(len(p) for p in start))
    accepted = crossing = faults = changed = 0
    for first in range(0, steps, RUN):
        x = np.concatenate(start)
        near: Neighbours | None = None
        for _ in range(min(RUN, steps - first)):
            if near is None or rng.random() < 0.2:
                near = find_neighbours(x, rings, float(np.ptp(x, axis=0).max()) * 4, 2)
            step = _step(x, rings, rng)
            passes = certify(x, step, rings, near).valid
            crosses = (passes or rng.random() < 0.05) and passes_through(x, step, rings.next)
            crossing += crosses
            faults += crosses and passes
            if passes:
                accepted += 1
                x = x + step
        changed += not _same(start, rings.split(x))
    return Fuzzed(case.name, steps, accepted, crossing, faults, changed)


def _step(x: Array, rings: Polylines, rng: np.random.Generator) -> Array:
    """Return one adversarial step (N, 3)."""
    n = len(x)
    size = float(np.ptp(x, axis=0).max())
    scale = 10.0 ** rng.uniform(-6, 0.5)
    kind = rng.integers(6)
    if kind == 0:  # one edge at another's middle, and through
        i = int(rng.integers(n))
        middle = 0.5 * (x + x[rings.next])
        away = np.linalg.norm(middle - middle[i], axis=1)
        away[[i, rings.next[i], rings.previous[i]]] = np.inf
        j = int(np.argsort(away)[rng.integers(3)])
        step = np.zeros_like(x)
        step[[i, rings.next[i]]] = (middle[j] - middle[i]) * rng.uniform(0.3, 3.0)
        return step
    if kind == 1:  # one vertex anywhere
        step = np.zeros_like(x)
        step[rng.integers(n)] = rng.normal(size=3) * scale * size
        return step
    if kind == 2:  # all of them
        return np.asarray(rng.normal(size=(n, 3)) * scale * size * 0.3)
    if kind == 3:  # a shear or a collapse of all
        return np.asarray((x - x.mean(0)) @ (rng.normal(size=(3, 3)) * scale))
    if kind == 4:  # one ring, or one half of one, as a whole
        step = np.zeros_like(x)
        first = int(rng.integers(n))
        part = (rings.ring == rings.ring[first]) & (np.arange(n) >= first)
        step[part] = rng.normal(size=3) * scale * size
        return step
    # smooth along the curve
    wave = np.cos(2 * np.pi * (np.arange(n) / n * rng.integers(1, 4) + rng.random()))
    return np.asarray(wave[:, None] * rng.normal(size=3) * scale * size)


# Hard line drawings: whether what runs along their strokes stays on them, and misses none.


_SIZE = 400  # px
_STEP = 0.25  # px between places of a line that are looked at


@dataclass(frozen=True)
class StrokeCase:
    """A drawing whose strokes are `width_px` wide; `draw()` gives its mask (H, W)."""

    name: str
    why: str
    width_px: int
    draw: Callable[[], Mask]


@dataclass(frozen=True)
class Traced:
    """The lines; how far they leave the ink at most, in half widths of a stroke, or px where that is more.

    `missed` is the share of the ink, but for blots, that is more than a stroke's width from every line.
    """

    lines: list[Line]
    strays: float
    missed: float

    @property
    def good(self) -> bool:
        """Every line stays within half a width of the ink, and hardly any ink is missed."""
        whole = all(np.isfinite(line).all() and len(line) >= 2 for line in self.lines)
        return whole and self.strays <= 1 and self.missed <= 0.02


def trace(case: StrokeCase) -> Traced:
    """Trace a drawing, and measure what came of it."""
    mask = case.draw()
    lines = trace_strokes(mask, case.width_px)
    half = 0.5 * case.width_px
    if not lines:
        return Traced([], 0.0, float(mask.any()))
    drawn = shapely.MultiLineString(lines)
    places = shapely.get_coordinates(shapely.segmentize(drawn, _STEP))
    outside = distance_transform_edt(~np.pad(mask, 8, mode="constant"))
    u, v = (np.clip(np.rint(places.T) + 8, 0, _SIZE + 15)).astype(int)
    blot = distance_transform_edt(mask) > 0.75 * case.width_px
    thin = mask & (distance_transform_edt(~blot) > 2 * case.width_px if blot.any() else True)
    rows, columns = np.nonzero(thin)
    away, _ = cKDTree(places).query(np.column_stack([columns, rows]))
    strays = float(outside[v, u].max() / max(half, 1.0))
    return Traced(lines, strays, float((away > 2 * half).mean()))


def stroke_cases() -> tuple[StrokeCase, ...]:
    """Return all of them, in one order."""
    lines = (
        ("cross", "none: what the others are held against", 9, _cross()),
        ("hairlines", "strokes of two pixels", 2, _cross()),
        ("star", "48 strokes meet in one point", 5, _star(24)),
        ("acute", "strokes part by 4 degrees: one line or two", 5, _fan(4.0)),
        ("hatching", "strokes cross as many others: 225 junctions", 4, _hatching()),
        ("spiral line", "one stroke beside itself, two pixels apart", 5, _spiral(8.0)),
        ("scribble", "60 strokes anywhere: loops of every size", 3, _scribble()),
        ("over the edge", "strokes end outside the picture", 7, _over()),
    )
    return (
        *(StrokeCase(n, why, w, partial(_draw, strokes, w)) for n, why, w, strokes in lines),
        StrokeCase("ring and dots", "no end to begin at; nothing to run along", 8, _ring_and_dots),
        StrokeCase("blots", "strokes that are blots for a while", 5, _blots),
    )


def _draw(lines: list[Array], width: int) -> Mask:
    image = Image.new("1", (_SIZE, _SIZE))
    pen = ImageDraw.Draw(image)
    for line in lines:
        for one, two in pairwise(np.round(line).tolist()):
            pen.line([*one, *two], fill=1, width=width)
        if width > 2:
            for x, y in line.tolist():
                pen.ellipse([x - width / 2, y - width / 2, x + width / 2, y + width / 2], fill=1)
    return np.asarray(image)


def _cross() -> list[Array]:
    return [np.array([[60.0, 60], [340, 340]]), np.array([[60.0, 340], [340, 60]])]


def _star(spokes: int) -> list[Array]:
    turn = np.pi * np.arange(spokes) / spokes
    way = 160 * np.column_stack([np.cos(turn), np.sin(turn)])
    return [np.array([200 - w, 200 + w]) for w in way]


def _fan(degrees: float) -> list[Array]:
    low = 320 * np.tan(np.radians(degrees))
    return [np.array([[40.0, 200], [360, 200]]), np.array([[40.0, 200], [360, 200 + low]])]


def _hatching() -> list[Array]:
    at = np.arange(30, 371, 24.0)
    return [np.array([[30, y], [370, y]]) for y in at] + [np.array([[x, 30], [x, 370]]) for x in at]


def _spiral(pitch: float) -> list[Array]:
    turn = np.linspace(8, 2 * np.pi * 100 / pitch, 4000)
    r = pitch * turn / (2 * np.pi)
    return [200 + np.column_stack([r * np.cos(turn), r * np.sin(turn)])]


def _scribble() -> list[Array]:
    return [np.random.default_rng(8).uniform(30, 370, (61, 2))]


def _over() -> list[Array]:
    return [np.array([[-50.0, y], [450, y + 40]]) for y in (40, 120, 200, 280, 340)]


def _ring_and_dots() -> Mask:
    image = Image.new("1", (_SIZE, _SIZE))
    pen = ImageDraw.Draw(image)
    pen.ellipse([100, 100, 300, 300], outline=1, width=8)
    for x in range(20, 400, 40):
        pen.ellipse([x - 4, 30, x + 4, 38], fill=1)
    return np.asarray(image)


def _blots() -> Mask:
    u, v = np.mgrid[:_SIZE, :_SIZE][::-1]
    wide = 2.5 + 14 * np.exp(-(((u - 200) / 15.0) ** 2))
    along = np.abs(v - 200 - 60 * np.sin(u / 40)) < wide
    return np.asarray(along & (u > 20) & (u < 380))
