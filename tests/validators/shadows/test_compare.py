"""Overlap of masks and depth ratio, on shapes whose numbers are known."""

from fractions import Fraction
from math import ceil, floor
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import PlainView

from knotfab_validators.shadows.compare import depth_ratio, overlap
from knotfab_validators.shadows.frame import (
    MISSING,
    SPILL,
    padded_mask,
    working_frame,
    write_compare,
    write_shadow,
)
from knotfab_validators.shadows.view import view_geometry


def test_overlap_by_hand() -> None:
    a, b = np.zeros((2, 10, 10), dtype=bool)
    a[:, :4] = True  # 40
    b[:, 2:5] = True  # 30, of which 20 are shared
    both = overlap(a, b)
    assert (both.iou, both.precision, both.recall) == (20 / 50, 20 / 40, 20 / 30)
    nothing = np.zeros_like(a)
    assert overlap(nothing, b).iou == 0.0 and overlap(nothing, b).recall == 0.0
    assert overlap(a, nothing).precision == 0.0
    assert overlap(nothing, nothing).iou == 1.0


def test_depth_ratio_is_along_the_views_own_axis() -> None:
    points = np.array([[0.0, 0, 0], [10.0, 20.0, 40.0]])
    assert depth_ratio(points, view_geometry(PlainView(), 8, 8)) == pytest.approx(2.0)
    side = view_geometry(PlainView(azimuth_deg=90.0), 8, 8)
    assert depth_ratio(points, side) == pytest.approx(0.25)


# The frame on which shadows and pictures are compared.


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


# The pictures of a verified shadow say what the masks say.


def test_the_shadows_picture_reads_back_as_the_shadow(tmp_path: Path) -> None:
    frame = working_frame(100, 60)
    shape = np.zeros((60, 100), dtype=bool)
    shape[10:40, 20:70] = True
    shadow = padded_mask(shape, frame)
    write_shadow(tmp_path / "shadow.png", shadow, frame)
    back = np.asarray(Image.open(tmp_path / "shadow.png")) < 128
    assert back.shape == (frame.height, frame.width)
    np.testing.assert_array_equal(padded_mask(back, frame), shadow)


@pytest.mark.slow
def test_the_difference_has_its_colours_only_where_there_is_one(tmp_path: Path) -> None:
    frame = working_frame(64, 64)
    target = np.zeros((frame.padded_height, frame.padded_width), dtype=bool)
    target[400:900, 500:1000] = True
    for name, shadow, colours in [
        ("same", target, []),
        ("spill", target | np.roll(target, 60, axis=0), [SPILL]),
        ("missing", target & np.roll(target, 60, axis=0), [MISSING]),
        ("moved", np.roll(target, 60, axis=1), [SPILL, MISSING]),
    ]:
        path = tmp_path / f"{name}.png"
        write_compare(path, target, shadow, frame)
        image = np.asarray(Image.open(path))
        assert image.shape[1] > 2.5 * image.shape[0]
        for colour in (SPILL, MISSING):
            assert (image == colour).all(axis=-1).any() == (colour in colours), (name, colour)
