"""The stretch of wrong outline has the length, the depth and the place of what was done to a mask."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from knotfab_validators.shadows.outlines import WrongStretch, depth_in, find_wrong_stretch

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


def test_masks_of_two_grids_are_refused() -> None:
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
