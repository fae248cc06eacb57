"""Changes of topology: known edits are found, counted and placed; what an opening undoes is none."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.topology import (
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
