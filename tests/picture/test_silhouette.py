"""Masks as polygons and at other resolutions: areas, distances and topology against exact ones."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Point, Polygon, affinity

from knotfab.base.arrays import Mask
from knotfab.picture.silhouette import resample_mask, sample_mask, trace_polygon


def pieces(shape: MultiPolygon) -> list[Polygon]:
    """The largest first."""
    return sorted(shape.geoms, key=lambda p: -p.area)


def disc(side: int, radius: float, u: float, v: float) -> Mask:
    y, x = np.mgrid[:side, :side]
    return np.asarray((x - u) ** 2 + (y - v) ** 2 <= radius**2)


def turning(polygon: Polygon) -> float:
    """Total turning of the outer ring, 2π for a convex one."""
    points = np.asarray(polygon.exterior.coords)
    edges = np.diff(np.vstack([points, points[1]]), axis=0)
    angle = np.diff(np.arctan2(edges[:, 1], edges[:, 0]))
    return float(np.abs((angle + np.pi) % (2 * np.pi) - np.pi).sum())


@pytest.mark.parametrize("radius", [6.0, 20.0, 100.0, 450.0])
def test_discs_have_their_area_place_and_no_stairs(radius: float) -> None:
    side = int(2 * radius + 20)
    u, v = side / 2 + 0.3, side / 2 - 0.2
    mask = disc(side, radius, u, v)
    shape = trace_polygon(mask)
    assert shape.is_valid and len(shape.geoms) == 1
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    exact = Point(u, v).buffer(radius, quad_segs=256)
    assert shapely.hausdorff_distance(shape, exact) < 0.7
    stairs = turning(trace_polygon(mask, 0).geoms[0])
    assert turning(shape.geoms[0]) < 2 * np.pi + 0.1 * (stairs - 2 * np.pi)


@pytest.mark.parametrize("angle", [0, 3, 17, 45])
def test_rectangles_keep_their_sides_and_corners(angle: float) -> None:
    exact = affinity.rotate(shapely.box(60.5, 80.5, 200.5, 160.5), angle)
    y, x = np.mgrid[:256, :256]
    mask = shapely.contains_xy(exact, x, y)
    shape = trace_polygon(mask)
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    assert shapely.hausdorff_distance(shape, trace_polygon(mask, 0)) < 0.7
    assert shape.symmetric_difference(exact).area / exact.area < 0.01


def test_untouched_outline_runs_between_the_pixels() -> None:
    mask = np.zeros((20, 30), dtype=bool)
    mask[5:10, 8:20] = True
    shape = trace_polygon(mask, 0)
    assert shape.bounds == pytest.approx((7.5, 4.5, 19.5, 9.5), abs=2e-3)
    assert shape.area == pytest.approx(60 - 0.5, abs=0.1)


def test_shapes_that_touch_the_frame_end_there() -> None:
    mask = np.zeros((100, 100), dtype=bool)
    mask[:, :50] = True
    shape = trace_polygon(mask)
    assert shape.bounds == pytest.approx((-0.5, -0.5, 49.5, 99.5), abs=0.3)
    assert shape.area == pytest.approx(5000, rel=2e-3)


def test_holes_and_pieces() -> None:
    mask = disc(300, 80, 100, 100) & ~disc(300, 40, 110, 90) | disc(300, 15, 110, 90)
    mask |= disc(300, 30, 240, 240)
    parts = pieces(trace_polygon(mask))
    assert [len(p.interiors) for p in parts] == [1, 0, 0]
    areas = [np.pi * (80**2 - 40**2), np.pi * 30**2, np.pi * 15**2]
    assert [p.area for p in parts] == pytest.approx(areas, rel=5e-3)


def test_specks_and_pinholes_go() -> None:
    mask = disc(100, 30, 50, 50)
    mask[2, 2] = True
    mask[50, 50] = False
    (part,) = pieces(trace_polygon(mask))
    assert len(part.interiors) == 0


def test_thin_strokes_survive() -> None:
    mask = np.zeros((200, 200), dtype=bool)
    mask[20, 20:180] = True  # one pixel wide
    mask[40:180, 60:62] = True
    i = np.arange(40, 160)
    mask[i, i + 30] = True  # connected by corners alone
    mask[i, i + 31] = True
    parts = pieces(trace_polygon(mask))
    assert len(parts) == 3
    assert sum(p.area for p in parts) == pytest.approx(mask.sum(), rel=0.02)


def test_pixels_that_touch_at_corners_are_one_piece() -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[10:20, 10:20] = True
    mask[20:30, 20:30] = True
    shape = trace_polygon(mask)
    assert shape.is_valid
    assert shape.area == pytest.approx(200, rel=0.02)


@pytest.mark.slow
def test_large_masks_are_traced_smaller_in_their_own_coordinates() -> None:
    mask = disc(3000, 900, 1400.5, 1600)
    shape = trace_polygon(mask)
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    assert (shape.centroid.x, shape.centroid.y) == pytest.approx((1400.5, 1600), abs=0.1)
    assert shapely.hausdorff_distance(shape, Point(1400.5, 1600).buffer(900, 256)) < 1.5


def test_long_frames() -> None:
    mask = np.zeros((16, 8000), dtype=bool)
    mask[4:12, 100:7900] = True
    shape = trace_polygon(mask)
    assert shape.is_valid
    assert shape.area == pytest.approx(mask.sum(), rel=0.01)


def test_random_blobs_stay_valid() -> None:
    from scipy import ndimage

    rng = np.random.default_rng(5)
    for sigma in (1.0, 3.0, 8.0):
        mask = ndimage.gaussian_filter(rng.random((256, 256)), sigma) > 0.5
        shape = trace_polygon(mask)
        assert shape.is_valid
        assert shape.area == pytest.approx(mask.sum(), rel=0.03)
        outline = shapely.contains_xy(shape, *np.mgrid[:256, :256][::-1])
        inner = ndimage.binary_erosion(mask) | ~ndimage.binary_dilation(mask)
        assert (outline == mask)[inner].mean() > 0.995


def test_nothing_gives_nothing() -> None:
    empty = trace_polygon(np.zeros((20, 20), dtype=bool))
    assert empty.is_empty and pieces(empty) == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [(30, 20), (7, 11), (60, 40), (100, 90), (60, 13), (1, 1)])
def test_coverage_is_exact_against_fine_subpixels(size: tuple[int, int]) -> None:
    mask = np.random.default_rng(1).random((40, 60)) > 0.4
    width, height = size
    coverage = resample_mask(mask, width, height)
    assert coverage.shape == (height, width) and coverage.dtype == np.float32
    fine = np.kron(mask, np.ones((height, width)))  # a common multiple of both grids
    blocks = fine.reshape(height, 40, width, 60).mean(axis=(1, 3))
    assert coverage == pytest.approx(blocks, abs=1e-6)
    assert coverage.mean() == pytest.approx(mask.mean(), abs=1e-6)


def test_a_sampled_mask_is_that_of_the_validators() -> None:
    from knotfab_validators.shadows.frame import padded_mask, working_frame

    rng = np.random.default_rng(4)
    for height, width in ((16, 23), (1024, 700), (1500, 2047), (333, 2048)):
        mask = rng.random((height, width)) > 0.5
        frame = working_frame(width, height)
        padded = padded_mask(mask, frame)
        inner = padded[frame.pad_y : frame.pad_y + frame.height]
        inner = inner[:, frame.pad_x : frame.pad_x + frame.width]
        assert (sample_mask(mask, frame.width, frame.height) == inner).all()


def test_half_a_pixel_is_enough_where_a_mask_is_sampled() -> None:
    mask = np.zeros((300, 2000), dtype=bool)
    mask[31:201, 501:1801] = True
    small = sample_mask(mask, 1000, 150)
    assert small.shape == (150, 1000) and small.sum() == 86 * 651 - 4  # corners: a quarter
    assert (small[::-1, ::-1] == sample_mask(mask[::-1, ::-1], 1000, 150)).all()
    tiny = np.random.default_rng(3).random((16, 8)) > 0.5
    assert (sample_mask(tiny, 512, 1024) == np.kron(tiny, np.ones((64, 64), dtype=bool))).all()
