"""The frame on which shadows and pictures are compared."""

from __future__ import annotations

from fractions import Fraction
from math import floor

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
        y = Fraction(2 * int(i) + 1, 2 * frame.height) * shape[0]
        x = Fraction(2 * int(j) + 1, 2 * frame.width) * shape[1]
        assert inner[i, j] == mask[floor(y), floor(x)]
