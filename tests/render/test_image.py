"""The target picture at the resolution of a phase: nothing of it is lost, grown or shifted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from knotfab.picture.silhouette import resample_mask
from knotfab.render.image import image_at
from knotfab_formats.scene import ResolvedView

RADIUS_MM = 2.0


@pytest.mark.slow
@pytest.mark.parametrize("pixels", [96, 192, 250, 384, 512, 1024, 1500])
@pytest.mark.parametrize("size", [(1023, 1024), (829, 1024), (1024, 655), (301, 200), (64, 64)])
def test_a_picture_keeps_its_area_and_its_place_at_any_size(
    size: tuple[int, int], pixels: int
) -> None:
    """A filter that counts whole pixels shifts a picture of twice its size by half of one of these."""
    width, height = size
    v, u = np.mgrid[:height, :width] + 0.5
    mask = np.hypot(u - 0.4 * width, v - 0.55 * height) < 0.35 * min(size)
    view = ResolvedView(frame_width_mm=0.1 * width, frame_height_mm=0.1 * height)
    image = image_at(view, mask, RADIUS_MM, pixels, precision="double")
    pixel = max(size) / pixels  # in the mask's
    target, high, wide = image.target, image.frame.height, image.frame.width
    assert target.sum() * pixel**2 == pytest.approx(mask.sum(), rel=1e-5)
    at = target.sum(axis=0) @ np.arange(wide), target.sum(axis=1) @ np.arange(high)
    middle = [m / target.sum() + 0.5 - 0.5 * n for m, n in zip(at, (wide, high), strict=True)]
    wanted = [(mask * w).sum() / mask.sum() - 0.5 * n for w, n in ((u, width), (v, height))]
    assert_allclose(np.multiply(middle, pixel), wanted, atol=5e-3)


def test_a_window_looks_at_a_part_of_a_mask_and_beyond_it() -> None:
    mask = np.random.default_rng(2).random((40, 60)) > 0.4
    wide = resample_mask(np.pad(mask, ((3, 5), (2, 4))), 33, 24)
    assert_allclose(resample_mask(mask, 33, 24, (-2.0, -3.0, 64.0, 45.0)), wide, atol=1e-6)
    part = resample_mask(mask[4:34, 10:50], 17, 11)
    assert_allclose(resample_mask(mask, 17, 11, (10.0, 4.0, 50.0, 34.0)), part, atol=1e-6)
    # a pixel half beyond the mask's edge is at most half covered
    edge = resample_mask(np.ones((10, 10), dtype=bool), 5, 5, (-1.0, 0.0, 9.0, 10.0))
    assert_allclose(edge, np.tile([0.5, 1, 1, 1, 1], (5, 1)), atol=1e-6)
