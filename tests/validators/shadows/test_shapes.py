"""A piece or hole that is there and drawn badly is named; one drawn within a reach of its outline is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy.ndimage import binary_dilation

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.shapes import MOST, Row, find_misshapen, find_rows
from knotfab_validators.shadows.topology import Box, Change

REACH = 2.0  # a quarter of the tube's radius
LEAST = 0.9
BODY, AT = (20, 20, 150, 280), (220, 110)
Size = tuple[int, int]


def draw(feature: Size | None, hole: bool) -> Mask:
    """A large body beside a small ellipse of half axes `feature`, or with it as a hole in the body."""
    image = Image.new("1", (300, 300))
    pen = ImageDraw.Draw(image)
    pen.rectangle(BODY, fill=1)
    u, v = (85, AT[1]) if hole else AT
    if feature:
        a, b = feature
        pen.ellipse((u - a, v - b, u + a, v + b), fill=not hole)
    return np.asarray(image)


@pytest.mark.parametrize("hole", [False, True])
@pytest.mark.parametrize("size", [(11, 19), (22, 18), (6, 12)])
def test_a_small_feature_turned_or_swollen_is_named_in_its_place(size: Size, hole: bool) -> None:
    target = draw((19, 11) if size != (6, 12) else (12, 6), hole)
    found = find_misshapen(draw(size, hole), target, REACH, LEAST)
    (shape,) = found
    assert (shape.kind, shape.of) == ("shape", "hole" if hole else "piece")
    np.testing.assert_allclose(shape.where, (85, AT[1]) if hole else AT, atol=6)
    assert shape.width_px == pytest.approx(13 if size == (6, 12) else 23, abs=2)
    assert 0.2 < shape.likeness < LEAST


@pytest.mark.parametrize("hole", [False, True])
def test_a_feature_drawn_within_a_reach_is_not_named(hole: bool) -> None:
    target = draw((19, 11), hole)
    for shadow in (
        target,
        np.roll(target, 2, axis=1),
        binary_dilation(target, iterations=2),
        ~binary_dilation(~target, iterations=2),
    ):
        assert not find_misshapen(shadow, target, REACH, LEAST)
        assert not find_misshapen(shadow.T, target.T, REACH, LEAST)


@pytest.mark.parametrize("hole", [False, True])
def test_what_no_tube_draws_is_counted_elsewhere(hole: bool) -> None:
    slit = draw((19, 3), hole)
    assert not find_misshapen(draw((19, 9), hole), slit, REACH, LEAST)
    if hole:  # as wide as the tube's radius, to a pixel
        assert not find_misshapen(draw((9, 4), hole), draw((19, 4), hole), 2.25, LEAST)
    target = draw((19, 11), hole)
    (gone,) = find_misshapen(draw(None, hole), target, REACH, LEAST)
    assert gone.likeness == 0.0
    lost = Change(gone.of, gone.where, gone.width_px, gone.box)
    assert not find_misshapen(draw(None, hole), target, REACH, LEAST, [lost])


def draw_stroke(points: Sequence[Size], width: int) -> Mask:
    """A stroke through `points` with round ends."""
    image = Image.new("1", (300, 300))
    pen = ImageDraw.Draw(image)
    pen.line(points, fill=1, width=width)
    for u, v in points:
        pen.ellipse((u - width / 2, v - width / 2, u + width / 2, v + width / 2), fill=1)
    return np.asarray(image)


def test_a_fine_stroke_is_held_to_the_tube_along_it() -> None:
    nose = (150, 80), (130, 140), (152, 150)
    wanted, radius = draw_stroke(nose, 7), int(4 * REACH)
    assert not find_misshapen(draw_stroke(nose, 2 * radius), wanted, REACH, LEAST)
    assert not find_misshapen(wanted, wanted, REACH, LEAST)
    turned = draw_stroke([(300 - u, v) for u, v in nose], 2 * radius)
    short = draw_stroke([(137, 119), *nose[1:]], 2 * radius)
    blob = draw_stroke(nose[1:], 4 * radius)
    for badly in (turned, short, blob):
        (shape,) = find_misshapen(badly, wanted, REACH, LEAST)
        assert (shape.kind, shape.of) == ("shape", "piece")


def test_two_blank_masks_have_nothing_to_compare() -> None:
    blank = np.zeros((40, 40), dtype=bool)
    assert not find_misshapen(blank, blank, REACH, LEAST)


# Rows of text are found among pieces of all sizes, and nothing else is.


def letters(x: int, y: int, count: int, width: int = 20, height: int = 30) -> list[Box]:
    return [(x + (width + 6) * k, y, x + (width + 6) * k + width, y + height) for k in range(count)]


def test_rows_are_found_in_any_order_beside_large_pieces() -> None:
    one, two = letters(100, 50, 5), letters(300, 300, 8)
    large: list[Box] = [(0, 0, 900, 900), (20, 400, 400, 800)]
    found = find_rows([*two[::-1], *large, *one], 1024.0)
    assert sorted(r.pieces for r in found) == [5, 8]
    assert Row((100, 50, 224, 80), 5) in found


def test_two_pieces_a_column_and_what_is_far_apart_are_no_text() -> None:
    pair, column = letters(0, 0, 2), [(500, 40 * k, 520, 40 * k + 30) for k in range(6)]
    apart = [(200 * k, 600, 200 * k + 20, 630) for k in range(5)]
    tall = letters(0, 800, 5, height=200)
    assert find_rows([*pair, *column, *apart, *tall], 1024.0) == []


def test_ascenders_and_the_space_between_words_are_no_end() -> None:
    row = letters(0, 100, 3) + letters(110, 88, 2, height=42) + letters(190, 100, 4)
    (found,) = find_rows(row, 1024.0)
    assert found.pieces == 9


def test_noise_is_not_searched() -> None:
    assert find_rows([(3 * k, 0, 3 * k + 2, 2) for k in range(MOST + 1)], 1024.0) == []
