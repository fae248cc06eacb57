"""A piece from aside is named by its picture where that stands out, and by nothing where it is a tangle."""

import numpy as np
import pytest

from knotfab_validators.shadows.naming import (
    MARGIN,
    SIDE,
    fit_picture,
    name_piece,
    read_foreign,
    shrink_to_box,
)

V, U = np.mgrid[:200, :160]
CROSS = (np.abs(U - 80) < 14) | (np.abs(V - 70) < 14)
HOUSE = (V > 90) & (np.abs(U - 80) < 60) | (np.abs(U - 80) < V - 10) & (V < 91)


def lattice(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mask = np.zeros((200, 160), dtype=bool)
    for a, b, c in rng.uniform(-1, 1, (14, 3)):
        mask |= np.abs(a * (U - 80) + b * (V - 100) + 90 * c) < 7 * np.hypot(a, b)
    return mask


@pytest.mark.parametrize("picture", [CROSS, HOUSE])
def test_the_picture_itself_is_named_first_sheared_too_and_a_lattice_is_not(
    picture: np.ndarray,
) -> None:
    sheared = np.array([np.roll(row, i // 8 - 12) for i, row in enumerate(picture)])
    for seen in (picture, sheared[::2]):
        found = name_piece([seen], picture)
        assert found is not None and found.first and found.z > 3
        assert name_piece([seen], picture) == found  # no luck in it
    tangled = name_piece([lattice(k) for k in range(4)], picture)
    assert tangled is not None and tangled.z < 2.5
    best = name_piece([lattice(0), picture], picture)
    assert best == name_piece([picture], picture)


def test_nothing_to_see_is_not_named() -> None:
    nothing = np.zeros((9, 9), dtype=bool)
    assert name_piece([], CROSS) is name_piece([nothing], CROSS) is None
    assert name_piece([CROSS], nothing) is None


def test_signs_are_two_dozen_pictures_none_of_which_is_another() -> None:
    signs, gains = read_foreign()
    assert signs.shape == (24, SIDE, SIDE) and gains.shape == (24,)
    fits = np.array([[fit_picture(a, b) for b in signs] for a in signs])
    assert np.diag(fits) == pytest.approx(1.0)
    assert (fits - np.eye(24)).max() < 0.9


def test_a_box_is_stretched_with_all_that_it_covers() -> None:
    mask = np.zeros((50, 70), dtype=bool)
    mask[11:31, 7:52] = True
    whole = shrink_to_box(mask)
    assert whole is not None
    assert whole.sum() == pytest.approx((SIDE - 2 * MARGIN) ** 2)
    mask[11:21, 7:29] = False
    part = shrink_to_box(mask)
    assert part is not None
    assert part.sum() / whole.sum() == pytest.approx(1 - 10 * 22 / (20 * 45))
