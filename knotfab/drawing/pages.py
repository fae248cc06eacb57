"""Pages that print at full size: papers, tiles to be laid together, crosses and a ruler to check by."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import InputError
from knotfab.picture.fonts import find_font, supply_fonts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

__all__ = [
    "OVERLAP_MM",
    "PAPERS",
    "RULER_MM",
    "Box",
    "Drawing",
    "Paper",
    "Tile",
    "choose_fonts",
    "draw_facts",
    "draw_foot",
    "draw_ruler",
    "draw_tile",
    "draw_tiled",
    "lay_tiles",
    "make_page",
    "write_pages",
]

Box = tuple[float, float, float, float]  # left, bottom, right, top

OVERLAP_MM = 10.0  # neighbouring pages share this
RULER_MM = 100.0
FULL_SIZE = "print at 100 %, not fitted to the page"
_HEAD_MM = 16.0  # room at the foot of each page, for the ruler and the page's name


@dataclass(frozen=True)
class Paper:
    """A page's size and its margin, in mm."""

    name: str
    width: float
    height: float
    margin: float = 10.0

    @property
    def room(self) -> tuple[float, float]:
        """Width and height that a drawing may fill."""
        return self.width - 2 * self.margin, self.height - 2 * self.margin - _HEAD_MM


PAPERS = {"a4": Paper("A4", 210.0, 297.0), "letter": Paper("Letter", 215.9, 279.4)}


@dataclass(frozen=True)
class Tile:
    """One page of a drawing: its place among the others, and where in the drawing (mm) its room's lower
    left corner lies."""

    row: int
    column: int
    left: float
    bottom: float


def lay_tiles(box: Box, paper: Paper) -> list[Tile]:
    """Return the pages that cover `box` of a drawing (mm).

    Pages overlap by `OVERLAP_MM`, rows run from the top, and the whole is centred.
    """
    wide, high = paper.room
    left, bottom, right, top = box

    def along(low: float, size: float, room: float) -> list[float]:
        step = room - OVERLAP_MM
        count = max(1, int(np.ceil((size - OVERLAP_MM) / step - 1e-9)))
        covered = count * step + OVERLAP_MM
        return [low - 0.5 * (covered - size) + k * step for k in range(count)]

    columns = along(left, right - left, wide)
    rows = along(bottom, top - bottom, high)[::-1]
    return [Tile(r, c, x, y) for r, y in enumerate(rows) for c, x in enumerate(columns)]


def write_pages(path: Path, title: str, pages: Iterable[Figure]) -> int:
    """Return one PDF of these pages, the same bytes for the same pages; returns how many there are."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages

    settings: Any = {
        "path.simplify": False,  # simplifying moves points
        "pdf.compression": 6,
        "font.family": "DejaVu Sans",
    }
    about = {"CreationDate": None, "Title": title, "Creator": "knotfab"}
    count = 0
    with rc_context(settings), PdfPages(path, metadata=about) as pdf:
        for page in pages:
            choose_fonts(page)
            pdf.savefig(page)
            count += 1
    return count


def choose_fonts(page: Figure) -> None:
    """Give each text of a page the fonts that have its letters; letters that none has are told by number."""
    from matplotlib.text import Text

    for text in page.findobj(Text):
        assert isinstance(text, Text)
        families, lacking = ["DejaVu Sans"], ""
        for letter in dict.fromkeys(text.get_text()):
            if letter.isspace():
                continue
            try:
                path = find_font(letter, supply_fonts(None), "the page")
            except InputError:
                lacking += letter
            else:
                families.append(_family_of(path))
        text.set_fontfamily(list(dict.fromkeys(families)))
        if lacking:
            run = re.compile(f"[{re.escape(lacking)}]+")
            text.set_text(run.sub(_name_letters, text.get_text()))


@cache
def _family_of(path: str) -> str:
    """Name the family of a font's file; matplotlib is told of it once, or it forgets what it found."""
    from matplotlib.font_manager import FontProperties, fontManager

    fontManager.addfont(path)
    return FontProperties(fname=path).get_name()


def _name_letters(found: re.Match[str]) -> str:
    """Name letters that no font of this machine has."""
    more = " …" if len(found[0]) > 1 else ""
    return f"[no font here for U+{ord(found[0][0]):04X}{more}]"


def make_page(paper: Paper) -> tuple[Figure, Axes]:
    """Make a figure of exactly the paper's size, whose axes are millimetres from its lower left."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(paper.width / 25.4, paper.height / 25.4))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, paper.width), ylim=(0, paper.height))
    axes.axis("off")
    return figure, axes


def draw_ruler(axes: Axes, paper: Paper, before: str) -> None:
    """Draw 100 mm at the lower left, to be measured before one `before`s."""
    x, y = paper.margin, paper.margin + 6
    axes.plot([x, x + RULER_MM], [y, y], color="black", lw=0.5, solid_capstyle="butt")
    for k in range(int(RULER_MM) // 10 + 1):
        axes.plot([x + 10 * k] * 2, [y, y + (3.0 if k % 5 == 0 else 1.5)], color="black", lw=0.4)
    axes.text(x, y - 1.0, f"100 mm: measure it before you {before}", size=6, va="top")


def draw_foot(axes: Axes, paper: Paper, page: str, what: str, note: str = "") -> None:
    """Draw at a page's lower right its name, the paper and the page's number, and a note."""
    right = paper.width - paper.margin
    axes.text(right, paper.margin + 10.5, note, size=6, ha="right", va="top")
    axes.text(right, paper.margin + 7, what, size=7, ha="right", va="top")
    axes.text(right, paper.margin + 3.5, f"{paper.name}, {page}", size=6, ha="right", va="top")


def draw_facts(paper: Paper, title: str, facts: Sequence[str], page: str, before: str) -> Figure:
    """Draw a page of words, with a ruler."""
    figure, axes = make_page(paper)
    top = paper.height - paper.margin
    axes.text(paper.margin, top, title, size=14, va="top")
    for k, line in enumerate(facts):
        axes.text(paper.margin, top - 14 - 5.2 * k, line, size=8, va="top")
    draw_ruler(axes, paper, before)
    draw_foot(axes, paper, page, "")
    return figure


@dataclass(frozen=True)
class Drawing:
    """A drawing at full size that may take several pages: its bounds, mm, and what draws it on one of them.

    `draw` is handed a page's axes, the shift (2,), mm, from the drawing to it, and the window to clip by.
    """

    title: str
    box: Box
    draw: Callable[[Axes, Array, Rectangle], None]


def draw_tiled(
    paper: Paper, title: str, facts: Sequence[str], drawings: Sequence[Drawing], before: str
) -> Iterator[Figure]:
    """Draw a page of words and pages that cover each drawing; the ruler is measured before one `before`s."""
    tiled = [(drawing, lay_tiles(drawing.box, paper)) for drawing in drawings]
    total = 1 + sum(len(tiles) for _, tiles in tiled)
    yield draw_facts(paper, title, facts, f"page 1 of {total}", before)
    number = 1
    for drawing, tiles in tiled:
        for tile in tiles:
            number += 1
            where = f", row {tile.row + 1}, column {tile.column + 1}" if len(tiles) > 1 else ""
            figure, axes, shift, window = draw_tile(paper, tile)
            draw_ruler(axes, paper, before)
            page = f"page {number} of {total}"
            draw_foot(axes, paper, page, f"{drawing.title}{where}", FULL_SIZE)
            drawing.draw(axes, shift, window)
            yield figure


def draw_tile(paper: Paper, tile: Tile) -> tuple[Figure, Axes, Array, Rectangle]:
    """Draw a page for one tile of a drawing: its window, and crosses to lay on each other.

    Returns:
        The figure, its axes, the shift (2,), mm, from the drawing to the page, and the window to clip by.
    """
    from matplotlib.patches import Rectangle

    figure, axes = make_page(paper)
    wide, high = paper.room
    x0, y0 = paper.margin, paper.margin + _HEAD_MM
    window = Rectangle((x0, y0), wide, high, fill=False, lw=0.2, ec="0.6")
    axes.add_patch(window)
    # marks in the middle of the shared strips stand at the same places of the drawing on both pages
    half = 0.5 * OVERLAP_MM
    for x in (x0 + half, x0 + wide - half):
        for y in (y0 + half, y0 + high - half):
            axes.plot([x - 3, x + 3], [y, y], color="black", lw=0.25)
            axes.plot([x, x], [y - 3, y + 3], color="black", lw=0.25)
    return figure, axes, np.array([x0 - tile.left, y0 - tile.bottom]), window
