"""Pages for printing at full size: overlapping tiles, alignment marks, a ruler."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from math import atan2, degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.picture.fonts import find_font, supply_fonts
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    from manifold3d import Manifold
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

Box = tuple[float, float, float, float]  # left, bottom, right, top

OVERLAP_MM = 10.0  # neighbouring pages share this
RULER_MM = 100.0
_HEAD_MM = 16.0  # room at the foot of each page for the ruler and the page's name


PAGE_MM = 210.0, 279.4  # A4's width and Letter's height: it prints at full size on both
MARGIN_MM = 10.0
# what a drawing may fill of it
ROOM_MM = PAGE_MM[0] - 2 * MARGIN_MM, PAGE_MM[1] - 2 * MARGIN_MM - _HEAD_MM


@dataclass(frozen=True)
class Tile:
    """One page of a drawing: its place among the others, and the lower left of its room, mm."""

    row: int
    column: int
    left: float
    bottom: float


def lay_tiles(box: Box) -> list[Tile]:
    """Divide `box` of a drawing (mm) into pages.

    Pages overlap by `OVERLAP_MM`, rows run from the top, and the whole is centred.
    """
    wide, high = ROOM_MM
    left, bottom, right, top = box

    def along(low: float, size: float, room: float) -> list[float]:
        step = room - OVERLAP_MM
        pages = max(1, int(np.ceil((size - OVERLAP_MM) / step - 1e-9)))
        spare = pages * step + OVERLAP_MM - size
        return [low - 0.5 * spare + k * step for k in range(pages)]

    columns = along(left, right - left, wide)
    rows = along(bottom, top - bottom, high)[::-1]
    return [Tile(r, c, x, y) for r, y in enumerate(rows) for c, x in enumerate(columns)]


def write_pages(path: Path, title: str, pages: Iterable[Figure]) -> None:
    """Write the pages as one PDF, byte for byte reproducible."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages

    took_part("matplotlib", "drew the sheets")
    settings: Any = {
        "path.simplify": False,  # simplifying moves points
        "pdf.compression": 6,
        "font.family": "DejaVu Sans",
    }
    about = {"CreationDate": None, "Title": title, "Creator": "knotfab"}
    with rc_context(settings), PdfPages(path, metadata=about) as pdf:
        for page in pages:
            choose_fonts(page)
            pdf.savefig(page)


def choose_fonts(page: Figure) -> None:
    """Set fonts for each text of a page; characters that no font has become their code points."""
    from matplotlib.text import Text

    def name_letters(found: re.Match[str]) -> str:
        more = " …" if len(found[0]) > 1 else ""
        return f"[no font here for U+{ord(found[0][0]):04X}{more}]"

    for text in page.findobj(Text):
        assert isinstance(text, Text)
        paths = {letter: _font_of(letter) for letter in dict.fromkeys(text.get_text())}
        families = [_family_of(path) for path in paths.values() if path]
        text.set_fontfamily(list(dict.fromkeys(["DejaVu Sans", *families])))
        if lacking := "".join(letter for letter, path in paths.items() if path is None):
            run = f"[{re.escape(lacking)}]+"
            text.set_text(re.sub(run, name_letters, text.get_text()))


@cache
def _font_of(letter: str) -> str | None:
    """Return the path of a font that has a letter, "" for a space, None if no font has it."""
    try:
        return "" if letter.isspace() else find_font(letter, supply_fonts(None), "the page")
    except InputError:
        return None


@cache
def _family_of(path: str) -> str:
    """Return the family of a font file, and register it with matplotlib once."""
    from matplotlib.font_manager import FontProperties, fontManager

    fontManager.addfont(path)
    return FontProperties(fname=path).get_name()


def write(axes: Axes, at: Sequence[float] | Array, text: str, **style: Any) -> None:
    """Write a text at a point (2,) of the page, mm."""
    axes.text(float(at[0]), float(at[1]), text, **style)


def make_page() -> tuple[Figure, Axes]:
    """Create a figure of exactly a page's size, with axes in mm from its lower left corner."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_MM[0] / 25.4, PAGE_MM[1] / 25.4))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, PAGE_MM[0]), ylim=(0, PAGE_MM[1]))
    axes.axis("off")
    return figure, axes


def draw_ruler(axes: Axes, before: str) -> None:
    """Draw a 100 mm ruler at the lower left, to check before doing what the verb `before` says."""
    x, y = MARGIN_MM, MARGIN_MM + 6
    axes.plot([x, x + RULER_MM], [y, y], color="black", lw=0.5, solid_capstyle="butt")
    for k in range(int(RULER_MM) // 10 + 1):
        axes.plot([x + 10 * k] * 2, [y, y + (3.0 if k % 5 == 0 else 1.5)], color="black", lw=0.4)
    axes.text(x, y - 1.0, f"100 mm: measure it before you {before}", size=6, va="top")


def draw_foot(axes: Axes, page: str, what: str, note: str = "") -> None:
    """Write the page's name, number and a note at its lower right."""
    for up, size, text in ((10.5, 6, note), (7, 7, what), (3.5, 6, page)):
        at = PAGE_MM[0] - MARGIN_MM, MARGIN_MM + up
        write(axes, at, text, size=size, ha="right", va="top")


def draw_tile(tile: Tile) -> tuple[Figure, Axes, Array, Rectangle]:
    """Draw the page of one tile: its window, and crosses for aligning neighbours.

    Returns:
        The figure, its axes, the shift (2,), mm, from the drawing to the page, and the window to clip by.
    """
    from matplotlib.patches import Rectangle

    figure, axes = make_page()
    wide, high = ROOM_MM
    x0, y0 = MARGIN_MM, MARGIN_MM + _HEAD_MM
    window = Rectangle((x0, y0), wide, high, fill=False, lw=0.2, ec="0.6")
    axes.add_patch(window)
    # marks in the middle of the shared strips stand at the same places of the drawing on both pages
    half = 0.5 * OVERLAP_MM
    for x in (x0 + half, x0 + wide - half):
        for y in (y0 + half, y0 + high - half):
            axes.plot([x - 3, x + 3], [y, y], color="black", lw=0.25)
            axes.plot([x, x], [y - 3, y + 3], color="black", lw=0.25)
    return figure, axes, np.array([x0 - tile.left, y0 - tile.bottom]), window


# Dimensions, scales and outlines: what a technical drawing is made of, in mm of the page.

_STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_LINE = 0.35  # points
_TEXT = 6.5  # points
_GAP_MM = 1.0  # gap between an object and its extension line
_ARROW_MM = 1.6  # length of an arrow's head


def length(value: float) -> str:
    """Format a length to a tenth of a mm; whole numbers have no decimal point."""
    return f"{value:.1f}".removesuffix(".0").replace("-0", "0" if abs(value) < 0.05 else "-0")


@dataclass(frozen=True)
class Scaled:
    """A drawing at 1:`ratio` on the page: `shift` (mm of the page) is where its origin comes to lie."""

    ratio: float
    shift: tuple[float, float]

    def __call__(self, points: Array) -> Array:
        """Map points (..., 2), mm of the object, to mm of the page."""
        page: Array = np.asarray(points, dtype=np.float64) / self.ratio + np.asarray(self.shift)
        return page

    @property
    def name(self) -> str:
        return f"1:{self.ratio:g}"


def fit_scale(points: Array, zone: Box) -> Scaled:
    """Return the largest usual scale at which points (n, 2), mm, fit into `zone` (mm), centred there."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.array([zone[2] - zone[0], zone[3] - zone[1]])
    least = float(((high - low) / room).max()) * (1 - 1e-9)
    usual = (step * 10.0**power for power in count() for step in _STEPS)
    ratio = next(ratio for ratio in usual if ratio >= least)
    middle = (low + high) / 2
    there = np.array([zone[0] + zone[2], zone[1] + zone[3]]) / 2
    x, y = there - middle / ratio
    return Scaled(ratio, (float(x), float(y)))


def draw_dimension(
    axes: Axes,
    start: Sequence[float] | Array,
    end: Sequence[float] | Array,
    away: Sequence[float] | Array,
    text: str,
    *,
    color: str = "#06c",
) -> None:
    """Dimension two points of the page (mm); the line is offset from them by the vector `away`.

    The text stands above the line, seen in reading direction, or beside it if there is no room.
    """
    a, b, off = (np.asarray(p, dtype=np.float64) for p in (start, end, away))
    along = b - a
    reach = float(np.linalg.norm(along))
    side = np.linalg.norm(off)
    lead = off / side if side > 0 else np.zeros(2)
    for p in (a, b):
        if side > _GAP_MM:
            tips = np.stack([p + _GAP_MM * lead, p + off + _GAP_MM * lead])
            axes.plot(*tips.T, color=color, lw=0.6 * _LINE)
    ends = np.stack([a + off, b + off])
    unit = along / reach if reach > 0 else np.array([1.0, 0.0])
    inside = reach >= 9.0  # room for the text between two arrows
    axes.plot(*ends.T, color=color, lw=_LINE)
    for tip, sign in zip(ends, (1.0, -1.0) if inside else (-1.0, 1.0), strict=True):
        back = tip + sign * _ARROW_MM * unit
        across = 0.25 * _ARROW_MM * np.array([-unit[1], unit[0]])
        axes.fill(*np.stack([tip, back + across, back - across]).T, color=color, lw=0)
    reading = unit if unit[0] > 1e-8 or (unit[0] > -1e-8 and unit[1] > 0) else -unit
    angle = degrees(atan2(reading[1], reading[0]))
    above = np.array([-reading[1], reading[0]])
    if inside:
        at, align = ends.mean(axis=0) + 0.6 * above, "center"
    else:
        at = max(ends, key=lambda p: float(p @ reading)) + 2.2 * reading - 0.8 * above
        align = "left"
    turned = {"rotation": angle, "rotation_mode": "anchor"}
    write(axes, at, text, size=_TEXT, color=color, ha=align, va="baseline", **turned)


def project_outlines(solids: Iterable[Manifold], axes: Array) -> list[Array]:
    """Return the outlines (n, 2) of solids seen along `axes[2]`, in the coordinates of `axes[:2]` (mm).

    Outer outlines turn counter-clockwise, those of holes clockwise.

    Args:
        axes: (3, 3) orthonormal rows, right-handed; the last one points to the viewer.
    """
    onto = np.pad(axes, ((0, 0), (0, 1)))
    return outlines_of(solid.transform(onto) for solid in solids)


def outlines_of(solids: Iterable[Manifold], within_mm: float = 0.02) -> list[Array]:
    """Return the outlines (n, 2) of solids seen from above; corners nearly on a line are left out."""
    from manifold3d import CrossSection

    flat = CrossSection()
    for solid in solids:
        flat += solid.project()
    return [np.asarray(p, dtype=np.float64) for p in flat.simplify(within_mm).to_polygons()]
