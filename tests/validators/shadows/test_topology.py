"""Changes of topology: known edits are found, counted and placed; what an opening undoes is none."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy.ndimage import binary_dilation, distance_transform_edt

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.outlines import WrongStretch, depth_in, find_wrong_stretch
from knotfab_validators.shadows.shapes import MOST, Row, find_misshapen, find_rows
from knotfab_validators.shadows.topology import (
    Box,
    Change,
    close_slits,
    count_touching,
    find_changes,
    list_pieces,
    without_lost,
)

REACH = 2.0
STEP = 40  # px between the nodes of a drawn graph
Edge = tuple[tuple[int, int], tuple[int, int]]


def count_euler(mask: Mask) -> int:
    """Pieces less holes, 8-connected, by bit quads (Gray 1971): no labels, no flood fill."""
    padded = np.pad(mask, 1).astype(int)
    quads = padded[:-1, :-1] + 2 * padded[:-1, 1:] + 4 * padded[1:, :-1] + 8 * padded[1:, 1:]
    ones = np.isin(quads, [1, 2, 4, 8]).sum()
    threes = np.isin(quads, [7, 11, 13, 14]).sum()
    diagonals = np.isin(quads, [6, 9]).sum()
    return int(ones - threes - 2 * diagonals) // 4


def signed(changes: list[Change]) -> int:
    """The number by which changes raise pieces less holes."""
    n = Counter(c.kind for c in changes)
    return n["hole"] + n["stroke"] + n["stray"] - n["piece"] - n["gap"] - n["leak"]


def draw_graph(nodes: set[tuple[int, int]], edges: set[Edge], side: int = 5) -> Mask:
    """Discs of radius 8 on a grid, joined by strokes 6 px wide."""
    size = side * STEP
    v, u = np.mgrid[:size, :size]
    mask = np.zeros((size, size), dtype=bool)
    for i, j in nodes:
        mask |= (u - STEP * i - 20) ** 2 + (v - STEP * j - 20) ** 2 <= 64
    for (a, b), (c, d) in edges:
        low, high = (
            (STEP * min(b, d) + 20, STEP * min(a, c) + 20),
            (STEP * max(b, d), STEP * max(a, c)),
        )
        mask[low[0] - 3 : high[0] + 23, low[1] - 3 : high[1] + 23] = True
    return mask


def grid(side: int = 5) -> tuple[set[tuple[int, int]], list[Edge]]:
    nodes = {(i, j) for i in range(side) for j in range(side)}
    across = [((i, j), (i + 1, j)) for i in range(side - 1) for j in range(side)]
    down = [((i, j), (i, j + 1)) for i in range(side) for j in range(side - 1)]
    return nodes, across + down


@pytest.mark.parametrize("seed", range(12))
def test_every_edge_that_is_added_or_taken_away_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes, edges = grid()
    drawn = {e for e in edges if rng.random() < 0.5}
    other = [e for e in edges if e not in drawn]
    more = {other[k] for k in rng.choice(len(other), 4, replace=False)}
    thin, thick = draw_graph(nodes, drawn), draw_graph(nodes, drawn | more)
    bridged = find_changes(thick, thin, REACH)
    assert Counter(c.kind for c in bridged) == {"gap": 4}
    broken = find_changes(thin, thick, REACH)
    assert Counter(c.kind for c in broken) == {"stroke": 4}
    for found, width in ((bridged, 24), (broken, 6)):
        for c in found:  # on one of the edges, and as wide as what was there
            assert any(_lies_on(c, edge) for edge in more), c
            # a gap beside a stroke is as wide as from that stroke, and at most as from node to node
            assert width - 8 <= c.width_px <= width + 8


def _lies_on(change: Change, edge: Edge) -> bool:
    (a, b), (c, d) = edge
    u, v = change.where
    beside = STEP * min(a, c) + 12 <= u <= STEP * max(a, c) + 28
    return beside and STEP * min(b, d) + 12 <= v <= STEP * max(b, d) + 28


@pytest.mark.parametrize("seed", range(12))
def test_all_kinds_of_edits_together_explain_the_euler_number(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    nodes, edges = grid()
    drawn = {e for e in edges if rng.random() < 0.4}
    target = draw_graph(nodes, drawn)
    touched = {n for e in drawn for n in e}
    gone = {n for n in nodes - touched if rng.random() < 0.5}
    free = [e for e in edges if e not in drawn and not {*e} & gone]
    more = {free[k] for k in rng.choice(len(free), min(2, len(free)), replace=False)}
    shadow = draw_graph(nodes - gone, drawn | more)
    found = find_changes(shadow, target, REACH)
    kinds = Counter(c.kind for c in found)
    assert kinds["piece"] == len(gone) and kinds["gap"] == len(more)
    assert count_euler(shadow) - count_euler(target) == signed(found)


def ring(size: int = 160, outer: float = 60.0, inner: float = 30.0) -> Mask:
    v, u = np.mgrid[:size, :size] - size / 2
    return (np.hypot(u, v) <= outer) & (np.hypot(u, v) > inner)


def test_must_reject() -> None:
    two = np.zeros((160, 300), dtype=bool)
    two[20:80, 20:80] = two[20:80, 200:260] = True
    for name, shadow, target, kinds in [
        ("a removed piece", np.where(np.arange(300) < 150, two, False), two, {"piece": 1}),
        ("a filled hole", ring(inner=0.0), ring(), {"hole": 1}),
        ("a hole that only the shadow has", ring(), ring(inner=0.0), {"leak": 1}),
        ("a piece that only the shadow has", two, two & (np.arange(300) < 150), {"stray": 1}),
        ("nothing at all", np.zeros_like(two), two, {"piece": 2}),
    ]:
        assert Counter(c.kind for c in find_changes(shadow, target, REACH)) == kinds, name
    bridge = two.copy()
    bridge[45:55, 70:210] = True
    (gap,) = find_changes(bridge, two, REACH)
    assert gap.kind == "gap" and 80 <= gap.where[0] < 200 and 45 <= gap.where[1] < 55
    # as far apart as they are: half of the disc that fits between them in the middle
    assert gap.width_px == pytest.approx(120, abs=6)
    (stroke,) = find_changes(two, bridge, REACH)
    assert stroke.kind == "stroke" and stroke.width_px == pytest.approx(10, abs=1)
    cut = ring()
    cut[75:85, 80:] = False  # one piece still, but the hole runs out
    (opened,) = find_changes(cut, ring(), REACH)
    assert opened.kind == "stroke" and opened.width_px == pytest.approx(30, abs=2)
    (closed,) = find_changes(ring(), cut, REACH)
    assert closed.kind == "gap" and closed.width_px == pytest.approx(10, abs=1)


def test_a_removed_piece_is_placed_and_measured() -> None:
    target = np.zeros((200, 300), dtype=bool)
    target[20:80, 20:80] = target[100:112, 200:280] = True
    (piece,) = find_changes(target & (np.arange(300) < 150), target, REACH)
    assert piece.box == (200, 100, 280, 112) and piece.width_px == pytest.approx(12, abs=1)
    assert 200 <= piece.where[0] < 280 and 100 <= piece.where[1] < 112


@pytest.mark.parametrize("shift", [(1, 0), (0, 1), (1, 1), (-1, 1)])
def test_a_shadow_that_is_shifted_by_a_pixel_changes_nothing(shift: tuple[int, int]) -> None:
    nodes, edges = grid()
    target = draw_graph(nodes, set(edges[::3]))
    assert find_changes(np.roll(target, shift, (0, 1)), target, REACH) == []


def test_noise_changes_nothing() -> None:
    rng = np.random.default_rng(7)
    target = ring(400, 150.0, 80.0)
    v, u = rng.integers(5, 390, (2, 40))
    speckled = target.copy()
    speckled[v, u] ^= True
    speckled[v, u + 1] ^= True
    for shadow, wanted in ((speckled, target), (target, speckled), (speckled, speckled.T)):
        assert find_changes(shadow, wanted, REACH) == []


def test_corners_that_touch_are_no_topology() -> None:
    squares = np.kron(
        (np.indices((6, 6)).sum(axis=0) % 2).astype(bool), np.ones((20, 20), dtype=bool)
    )
    distance = distance_transform_edt(~np.pad(squares, 10))
    apart = np.pad(squares, 10) & (distance_transform_edt(np.pad(squares, 10)) > 1)
    for shadow in (distance <= 1, apart):
        assert find_changes(shadow, np.pad(squares, 10), REACH) == []


def test_a_piece_that_grew_is_no_other_one() -> None:
    target = np.zeros((100, 100), dtype=bool)
    target[40:48, 40:48] = True
    shadow = np.zeros_like(target)
    shadow[30:60, 38:50] = True
    assert find_changes(shadow, target, 1.5) == []
    shadow = np.roll(shadow, 30, axis=1)
    assert Counter(c.kind for c in find_changes(shadow, target, 1.5)) == {"piece": 1, "stray": 1}


def test_pieces_and_holes_are_listed_with_their_boxes() -> None:
    mask = np.zeros((60, 90), dtype=bool)
    mask[10:40, 5:45] = True
    mask[20:30, 15:25] = False
    mask[50, 80] = True  # a speck
    assert sorted(list_pieces(mask, 2.0)) == [(5, 10, 45, 40), (15, 20, 25, 30)]
    assert list_pieces(np.zeros((9, 9), dtype=bool), 2.0) == []


def test_closing_takes_slits_and_leaves_the_rest() -> None:
    mask = np.zeros((120, 120), dtype=bool)
    mask[:90, 30:90] = True  # up to the edge, and closed there too
    mask[10:20, 40:80] = False
    slit = mask.copy()
    slit[58:61, 40:80] = False
    for given in (mask, slit):  # but for its inner corners, which a disc cannot reach
        assert (close_slits(given, 2.0) ^ mask).sum() <= 12
    assert not close_slits(np.zeros((20, 20), dtype=bool), 2.0).any()


def test_the_picture_without_what_is_lost() -> None:
    target = np.zeros((160, 300), dtype=bool)
    target[20:80, 20:80] = target[100:112, 200:280] = True
    rest = target & (np.arange(300) < 150)
    assert np.array_equal(without_lost(target, find_changes(rest, target, REACH)), rest)
    full = ring(inner=0)
    full[80, 80] = True
    assert np.array_equal(without_lost(ring(), find_changes(full, ring(), REACH)), full)


def test_masks_of_two_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="one grid"):
        find_changes(ring(100), ring(120), REACH)


def squares(apart: int) -> Mask:
    """Two squares whose corners are so many px apart along the diagonal; 0: they touch, -3: they overlap."""
    mask = np.zeros((100, 100), dtype=bool)
    mask[20:50, 20:50] = True
    mask[50 + apart : 80 + apart, 50 + apart : 80 + apart] = True
    return mask


@pytest.mark.parametrize("reach", [1.5, 2.0, 3.0])
def test_corners_that_touch_count_as_what_no_tube_draws(reach: float) -> None:
    touching = squares(0)
    for shadow in (touching, squares(2), squares(-2)):
        assert not find_changes(shadow, touching, reach)
    assert count_touching(touching, reach) == 1
    assert count_touching(squares(12), reach) == count_touching(squares(-12), reach) == 0
    assert count_touching(np.zeros((50, 50), dtype=bool), reach) == 0


def test_a_stroke_that_parts_and_a_gap_that_closes_still_count() -> None:
    bar = np.zeros((60, 120), dtype=bool)
    bar[20:40, 10:110] = True
    cut = bar.copy()
    cut[:, 55:65] = False
    assert [c.kind for c in find_changes(cut, bar, 2.0)] == ["stroke"]
    assert [c.kind for c in find_changes(bar, cut, 2.0)] == ["gap"]


# A piece or hole that is there and drawn badly is named; one drawn within a reach of its outline is
# not.


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


# The stretch of wrong outline has the length, the depth and the place of what was done to a mask.


NONE = WrongStretch(0.0, 0.0, (0.0, 0.0))


def square(low: int = 40, high: int = 160, size: int = 200) -> np.ndarray:
    mask = np.zeros((size, size), dtype=bool)
    mask[low:high, low:high] = True
    return mask


def test_equal_and_empty_masks_have_nothing_wrong() -> None:
    assert find_wrong_stretch(square(), square()) == NONE
    empty = np.zeros((50, 70), dtype=bool)
    assert find_wrong_stretch(empty, empty) == NONE


@pytest.mark.parametrize("deep", [4, 9, 30])
@pytest.mark.parametrize("missing", [False, True])
def test_a_bump_or_a_bite_is_measured_and_placed(deep: int, missing: bool) -> None:
    target, shadow = square(), square()
    if missing:
        shadow[40 : 40 + deep, 90:110] = False
    else:
        shadow[40 - deep : 40, 90:110] = True
    found = find_wrong_stretch(shadow, target)
    assert found.off_px == pytest.approx(deep, abs=1.0)
    u, v = found.where
    assert 88 <= u <= 111 and abs(v - (40 + deep if missing else 40 - deep)) <= 1.5
    # the bump's edge: its top and both sides, less what is within 2 px of the straight outline
    assert found.length_px == pytest.approx(20 + 2 * (deep - 2), abs=4)


def test_what_is_no_farther_than_the_limit_is_right() -> None:
    target = square()
    assert find_wrong_stretch(np.roll(target, 2, axis=1), target) == NONE
    assert find_wrong_stretch(np.roll(target, 3, axis=1), target).length_px == pytest.approx(
        117, abs=4
    )
    assert find_wrong_stretch(np.roll(target, 1, axis=1), target, wrong_px=0.4).length_px > 100


@pytest.mark.parametrize("off", [0, 1, 3, 8])
def test_the_quantile_is_how_far_the_outlines_are_apart(off: int) -> None:
    assert find_wrong_stretch(
        square(40 - off, 160 + off), square()
    ).quantile_95_px == pytest.approx(off, abs=1.0)
    spiked = square()
    spiked[30:40, 98:102] = True  # 24 px of some 500: the farthest 5 % begin at its foot
    assert find_wrong_stretch(spiked, square()).quantile_95_px < 2


def test_shadow_and_target_change_places_and_the_answer_stays() -> None:
    rng = np.random.default_rng(3)
    one, other = square(), square()
    for _ in range(6):
        r, c = rng.integers(30, 165, 2)
        other[r : r + 12, c : c + 7] ^= True
    a, b = find_wrong_stretch(one, other), find_wrong_stretch(other, one)
    assert a.length_px == pytest.approx(b.length_px) and a.off_px == pytest.approx(b.off_px)


def test_a_missing_piece_and_an_empty_shadow_are_wrong_all_round() -> None:
    target = square(80, 120)
    found = find_wrong_stretch(np.zeros_like(target), target)
    assert found.length_px == pytest.approx(4 * 40, abs=5)
    both = target.copy()
    both[10:30, 10:30] = True  # a loose blob where nothing should be
    assert find_wrong_stretch(both, target).length_px == pytest.approx(4 * 20, abs=5)


def test_a_stretch_is_not_cut_where_the_contour_begins() -> None:
    for turn in range(4):
        target, shadow = square(), square()
        shadow[100:112, 160:175] = True
        found = find_wrong_stretch(np.rot90(shadow, turn), np.rot90(target, turn))
        assert found.length_px == pytest.approx(12 + 2 * 13, abs=4)


def test_outlines_of_two_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="one grid"):
        find_wrong_stretch(square(), square(size=300))


# Distances on a grid are those of scipy's exact transform.


@pytest.mark.parametrize("share", [0.02, 0.5, 0.97, 0.9995])
@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (33, 57), (80, 61)])
def test_the_depth_is_exact(share: float, shape: tuple[int, int]) -> None:
    mask = np.random.default_rng(7).random(shape) < share
    mask[0, -1] = False
    np.testing.assert_array_equal(depth_in(mask), distance_transform_edt(mask))
    np.testing.assert_array_equal(depth_in(mask.T), distance_transform_edt(mask.T))


def test_with_nothing_outside_it_is_the_diagonal() -> None:
    assert (depth_in(np.ones((3, 4), dtype=bool)) == 5.0).all()
    assert not depth_in(np.zeros((3, 4), dtype=bool)).any()
