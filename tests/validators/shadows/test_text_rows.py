"""Rows of text are found among pieces of all sizes, and nothing else is."""

from knotfab_validators.shadows.text_rows import MOST, Row, find_rows
from knotfab_validators.shadows.topology import Box


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
