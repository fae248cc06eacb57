"""The frame on which shadows and pictures are compared."""

from fractions import Fraction
from math import ceil, floor

import numpy as np
import pytest

from knotfab_validators.shadows.frame import padded_mask, working_frame


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(16, 16), (1000, 300), (3000, 4096), (1, 1)])
def test_the_working_frame_keeps_pixel_squares(shape: tuple[int, int]) -> None:
    mask = np.random.default_rng(1).random(shape) < 0.5
    frame = working_frame(shape[1], shape[0])
    assert max(frame.width, frame.height) == 1024
    assert frame.pad_x == round(frame.width / 4) and frame.pad_y == round(frame.height / 4)
    padded = padded_mask(mask, frame)
    assert padded.shape == (frame.padded_height, frame.padded_width)
    inner = padded[
        frame.pad_y : frame.pad_y + frame.height, frame.pad_x : frame.pad_x + frame.width
    ]
    assert padded.sum() == inner.sum()
    for i, j in np.random.default_rng(2).integers(0, inner.shape, (50, 2)):
        down = share(int(i), frame.height, shape[0])
        across = share(int(j), frame.width, shape[1])
        covered = sum(a * b for y, a in down.items() for x, b in across.items() if mask[y, x])
        assert inner[i, j] == (2 * covered >= sum(down.values()) * sum(across.values()))


def share(at: int, wanted: int, pixels: int) -> dict[int, Fraction]:
    """Measure how much of each of so many pixels the one of `wanted` covers, by number."""
    low, high = Fraction(at * pixels, wanted), Fraction((at + 1) * pixels, wanted)
    return {k: min(high, k + 1) - max(low, k) for k in range(floor(low), ceil(high))}


def test_a_picture_of_twice_as_many_pixels_is_not_moved() -> None:
    """A disc in the middle of a picture of 2048 px lay a quarter of a pixel aside on the frame of 1024."""
    v, u = np.mgrid[:2048, :2048] - 1023.5
    inner = padded_mask(np.hypot(u, v) < 700.3, working_frame(2048, 2048))
    for turned in (inner[::-1], inner[:, ::-1], inner.T):
        np.testing.assert_array_equal(turned, inner)


def test_half_a_pixel_counts() -> None:
    """The same on either side: an edge between two working pixels' centres takes neither side's part."""
    mask = np.zeros((2048, 2048), dtype=bool)
    mask[101:801, 501:1801] = True
    inner = padded_mask(mask, working_frame(2048, 2048))[256:-256, 256:-256]
    rows, columns = np.flatnonzero(inner.any(axis=1)), np.flatnonzero(inner.any(axis=0))
    assert (rows[0], rows[-1], columns[0], columns[-1]) == (50, 400, 250, 900)
