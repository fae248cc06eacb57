"""Hard line drawings: whether what runs along their strokes stays on them, and misses none."""

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

from knotfab.base.arrays import Array, Mask
from knotfab.picture.strokes import Line, trace_strokes

__all__ = ["StrokeCase", "Traced", "stroke_cases", "trace"]

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
