"""Pages at full size: tiles cover a drawing, and what they share lies in the same place on both."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from pdf_pages import page_contents, page_sizes, segments

from knotfab.drawing.pages import (
    OVERLAP_MM,
    PAPERS,
    Tile,
    draw_facts,
    draw_tile,
    lay_tiles,
    write_pages,
)


@pytest.mark.parametrize("name", ["a4", "letter"])
def test_tiles_cover_and_overlap(name: str) -> None:
    paper = PAPERS[name]
    wide, high = paper.room
    assert len(lay_tiles((0, 0, wide, high), paper)) == 1
    assert len(lay_tiles((0, 0, wide + 0.01, high), paper)) == 2
    assert len(lay_tiles((0, 0, wide, high + 0.01), paper)) == 2
    tiles = lay_tiles((-5, 7, 500, 607), paper)
    assert len(tiles) == 9
    assert [(t.row, t.column) for t in tiles[:4]] == [(0, 0), (0, 1), (0, 2), (1, 0)]
    left = sorted({t.left for t in tiles})
    low = sorted({t.bottom for t in tiles})
    assert np.diff(left) == pytest.approx(wide - OVERLAP_MM)
    assert np.diff(low) == pytest.approx(high - OVERLAP_MM)
    assert left[0] <= -5 and left[-1] + wide >= 500 and low[0] <= 7 and low[-1] + high >= 607
    assert tiles[0].bottom == low[-1]  # rows run from the top


def test_crosses_of_neighbours_are_the_same_places() -> None:
    paper = PAPERS["a4"]
    first, second = lay_tiles((0, 0, paper.room[0] + 50, 100), paper)

    def crosses(tile: Tile) -> set[tuple[float, float]]:
        _, axes, shift, _ = draw_tile(paper, tile)
        found = set()
        for line in axes.lines:
            x, y = (np.asarray(v, dtype=float) for v in line.get_data())
            if len(x) == 2 and abs(np.hypot(*(x[1] - x[0], y[1] - y[0])) - 6) < 1e-9:
                found.add((round(x.mean() - shift[0], 6), round(y.mean() - shift[1], 6)))
        return found

    shared = crosses(first) & crosses(second)
    assert len(crosses(first)) == 4 and len(shared) == 2


@pytest.mark.parametrize(("name", "size"), [("a4", (210, 297)), ("letter", (215.9, 279.4))])
def test_pages_are_of_the_papers_size_and_the_same_bytes_again(
    tmp_path: Path, name: str, size: tuple[float, float]
) -> None:
    for path in (tmp_path / "a", tmp_path / "b"):
        pages = [draw_facts(PAPERS[name], "title", ["a fact"], "page 1 of 1", "drill")]
        assert write_pages(path, "title", iter(pages)) == 1
    data = (tmp_path / "a").read_bytes()
    assert data == (tmp_path / "b").read_bytes() and b"CreationDate" not in data
    assert page_sizes(tmp_path / "a") == pytest.approx(np.array([size]), abs=0.005)
    lines = np.concatenate([segments(text) for text in page_contents(tmp_path / "a")])
    long = np.linalg.norm(lines[:, 2:] - lines[:, :2], axis=1)
    assert (np.abs(long - 100) < 1e-3).any()  # the ruler


def test_letters_no_font_has_are_told_by_number(tmp_path: Path) -> None:
    page = draw_facts(
        PAPERS["a4"], "пёс ♞", ["\U0010fffd\U0010fffe, ℵ and a"], "page 1 of 1", "drill"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of letters that it draws as boxes
        assert write_pages(tmp_path / "a.pdf", "title", [page]) == 1
    title, fact = (text.get_text() for text in page.axes[0].texts[:2])
    assert (title, fact) == ("пёс ♞", "[no font here for U+10FFFD …], ℵ and a")
