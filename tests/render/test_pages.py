"""Pages at full size: tiles cover a drawing, and what they share lies in the same place on both."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from pages import page_contents, page_sizes, segments
from pieces import ring

from knotfab.geometry.tube import as_manifold, sweep
from knotfab.render.pages import (
    OVERLAP_MM,
    PAGE_MM,
    ROOM_MM,
    Tile,
    draw_dimension,
    draw_ruler,
    draw_tile,
    fit_scale,
    lay_tiles,
    length,
    make_page,
    project_outlines,
    write,
    write_pages,
)


def test_tiles_cover_and_overlap() -> None:
    wide, high = ROOM_MM
    assert len(lay_tiles((0, 0, wide, high))) == 1
    assert len(lay_tiles((0, 0, wide + 0.01, high))) == 2
    assert len(lay_tiles((0, 0, wide, high + 0.01))) == 2
    tiles = lay_tiles((-5, 7, 500, 607))
    assert len(tiles) == 9
    assert [(t.row, t.column) for t in tiles[:4]] == [(0, 0), (0, 1), (0, 2), (1, 0)]
    left = sorted({t.left for t in tiles})
    low = sorted({t.bottom for t in tiles})
    assert np.diff(left) == pytest.approx(wide - OVERLAP_MM)
    assert np.diff(low) == pytest.approx(high - OVERLAP_MM)
    assert left[0] <= -5 and left[-1] + wide >= 500 and low[0] <= 7 and low[-1] + high >= 607
    assert tiles[0].bottom == low[-1]  # rows run from the top


def test_crosses_of_neighbours_are_the_same_places() -> None:
    first, second = lay_tiles((0, 0, ROOM_MM[0] + 50, 100))

    def crosses(tile: Tile) -> set[tuple[float, float]]:
        _, axes, shift, _ = draw_tile(tile)
        found = set()
        for line in axes.lines:
            x, y = (np.asarray(v, dtype=float) for v in line.get_data())
            if len(x) == 2 and abs(np.hypot(*(x[1] - x[0], y[1] - y[0])) - 6) < 1e-9:
                found.add((round(x.mean() - shift[0], 6), round(y.mean() - shift[1], 6)))
        return found

    shared = crosses(first) & crosses(second)
    assert len(crosses(first)) == 4 and len(shared) == 2


def test_pages_print_whole_on_a4_and_letter_and_are_the_same_bytes_again(tmp_path: Path) -> None:
    for path in (tmp_path / "a", tmp_path / "b"):
        figure, axes = make_page()
        draw_ruler(axes, "drill")
        write_pages(path, "title", [figure])
    data = (tmp_path / "a").read_bytes()
    assert data == (tmp_path / "b").read_bytes() and b"CreationDate" not in data
    assert page_sizes(tmp_path / "a") == pytest.approx(np.array([PAGE_MM]), abs=0.005)
    assert (np.array(PAGE_MM) <= ((210.0, 297.0), (215.9, 279.4))).all()
    lines = np.concatenate([segments(text) for text in page_contents(tmp_path / "a")])
    long = np.linalg.norm(lines[:, 2:] - lines[:, :2], axis=1)
    assert (np.abs(long - 100) < 1e-3).any()  # the ruler


def test_letters_no_font_has_are_told_by_number(tmp_path: Path) -> None:
    page, axes = make_page()
    write(axes, (10, 20), "пёс ♞")
    write(axes, (10, 10), "\U0010fffd\U0010fffe, ℵ and a")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of letters that it draws as boxes
        write_pages(tmp_path / "a.pdf", "title", [page])
    told = tuple(text.get_text() for text in axes.texts)
    assert told == ("пёс ♞", "[no font here for U+10FFFD …], ℵ and a")


# Dimensions and scales: exact lengths, readable text, outlines with their holes.


@pytest.mark.parametrize(
    ("value", "text"),
    [(600.0, "600"), (1.25, "1.2"), (99.96, "100"), (-0.01, "0"), (-3.0, "-3"), (-0.4, "-0.4")],
)
def test_lengths_read_as_on_a_ruler(value: float, text: str) -> None:
    assert length(value) == text


@pytest.mark.parametrize(
    ("size", "ratio"),
    [(50.0, 1), (100.0, 1), (100.1, 1.5), (200, 2), (201, 2.5), (799, 8), (801, 10), (10_001, 150)],
)
def test_the_largest_usual_scale_that_fits(size: float, ratio: float) -> None:
    to = fit_scale(np.array([[-size / 2, 10.0], [size / 2, 0.0]]), (20.0, 30.0, 120.0, 130.0))
    assert to.ratio == pytest.approx(ratio)
    ends = to(np.array([[-size / 2, 0.0], [size / 2, 10.0]]))
    assert ends.mean(axis=0) == pytest.approx([70.0, 80.0])
    assert ends[1] - ends[0] == pytest.approx(np.array([size, 10.0]) / ratio)
    assert to.name == f"1:{ratio:g}"


@pytest.mark.parametrize("turn", range(0, 360, 30))
def test_text_of_a_dimension_can_be_read(turn: int) -> None:
    _, axes = make_page()
    start = np.array([100.0, 150.0])
    end = start + 40 * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    draw_dimension(axes, start, end, (0, 0), "40")
    (text,) = axes.texts
    assert -90 < ((text.get_rotation() + 180) % 360) - 180 <= 90
    assert np.linalg.norm(np.array(text.get_position()) - (start + end) / 2) < 1.0
    line = np.array(axes.lines[-1].get_data()).T
    assert line == pytest.approx(np.stack([start, end]))
    draw_dimension(axes, (100, 100), (103, 100), (0, 5), "3")  # too short: the text is beside it
    x, y = axes.texts[-1].get_position()
    assert x > 104 and y == pytest.approx(105, abs=1)


def test_the_outline_of_a_ring_has_a_hole() -> None:
    solid = as_manifold(sweep(ring(30.0, wave=0.0), 2.0, 32))

    def area(polygon: np.ndarray) -> float:
        x, y = polygon.T
        return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2

    front = sorted(area(p) for p in project_outlines([solid], np.eye(3)))
    assert front == pytest.approx([-np.pi * 28**2, np.pi * 32**2], rel=3e-3)
    side = project_outlines([solid], np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    assert [area(p) for p in side] == pytest.approx([60 * 4 + np.pi * 4], rel=1e-2)
    both = project_outlines([solid, solid.translate((100.0, 0, 0))], np.eye(3))
    assert len(both) == 4
