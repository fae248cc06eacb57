"""The exact tube's picture: distances of known value, and shadows that must be found wrong."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely
from validator_parts import Array, PlainView, circle, tangle, tube

from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask, shadow_polygon
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.tube_field import (
    OutlineError,
    _trace_hulls,
    outline_error,
    tube_field,
)
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

FRAME = working_frame(512, 512)
PX = 180 / 1024  # mm


def geometry(tilt: float = 0.0, azimuth: float = 0.0) -> ViewGeometry:
    view = PlainView(wall_tilt_deg=tilt, azimuth_deg=azimuth)
    return view_geometry(view, 512, 512).resample(FRAME)


def measure(curve: Array, radius: float, vertices: Array, faces: Array) -> OutlineError:
    g = geometry(20.0, 30.0)
    lines = shadow_lines(vertices, faces, g)
    outline = shapely.get_coordinates(shadow_polygon(lines))
    return outline_error(tube_field([curve], radius, g), outline, shadow_mask(lines, g))


@pytest.mark.parametrize("tilt", [0.0, 35.0])
def test_zero_on_the_outline_and_true_beside_it(tilt: float) -> None:
    g = geometry(tilt)
    field = tube_field([circle(720, 40.0)], 5.0, g)
    # the outline of a ball at (40, 0, 0), followed along the receiver's own axes
    light, along = np.array([0, 0, 500.0]), np.array([1.0, 0, 0])
    slope = np.arctan2(40, 500) + np.arcsin(5 / np.hypot(40, 500))
    hit = light + 600 / np.cos(slope) * np.array([np.sin(slope), 0, -np.cos(slope)])
    for shift in (-0.5, 0.0, 0.25, 1.0):
        pixel, _ = g.project((hit + shift * along)[None])
        assert field.signed_distance(pixel)[0] == pytest.approx(-shift, abs=4e-3)


def test_the_mask_is_where_the_distance_is_positive() -> None:
    g = geometry(-25.0, 60.0)
    field = tube_field([tangle(200, 3), circle(90, 30.0)], 3.0, g)
    rng = np.random.default_rng(0)
    rows, columns = rng.integers(0, g.height, 4000), rng.integers(0, g.width, 4000)
    distance = field.signed_distance(np.column_stack([columns, rows]).astype(float))
    sure = np.abs(distance) > 0.02  # mm; the outline of a ball is a polygon in the mask
    np.testing.assert_array_equal(field.mask[rows, columns][sure], distance[sure] > 0)
    assert 100 < field.mask[rows, columns].sum() < 3900


def test_a_segment_seen_end_on_is_a_ball() -> None:
    g = view_geometry(PlainView(), 360, 360)
    rod = np.array([[0.0, 0, 0], [0.0, 0, 20.0]])
    field = tube_field([rod], 4.0, g)
    centre = field.signed_distance(np.array([[179.5, 179.5]]))
    assert np.isfinite(centre).all() and centre[0] > 4.0
    reach = 600 * np.tan(np.arcsin(4 / 480))  # the reach of the nearer end, in mm on the wall
    edge = np.array([[179.5 + 2 * reach, 179.5], [179.5, 179.5 - 2 * reach]])
    np.testing.assert_allclose(field.signed_distance(edge), 0, atol=1e-6)


def test_a_fine_tube_is_right_and_a_coarse_one_is_not() -> None:
    curve = tangle(900, 5)
    fine = measure(curve, 3.0, *tube(curve, 3.0, 96))
    assert fine.largest_mm < 0.1 * PX
    coarse = measure(curve, 3.0, *tube(curve, 3.0, 6))
    assert coarse.missing_mm > 0.5 * PX and coarse.spill_mm < 0.1 * PX


@pytest.mark.parametrize("size_px", [1.0, 60.0])
def test_a_shifted_shadow_is_found_and_measured(size_px: float) -> None:
    curve = circle(400, 40.0)
    vertices, faces = tube(curve, 3.0, 96)
    shift = size_px * PX * 500 / 600  # seen `size_px` away
    error = measure(curve, 3.0, vertices + np.array([0.0, shift, 0.0]), faces)
    assert error.largest_mm > 0.9 * size_px * PX * (1 if size_px < 2 else 0.7)
    assert error.spill_mm > 0.5 * PX


def test_a_wrong_radius_is_found() -> None:
    curve = tangle(600, 6)
    thick = measure(curve, 3.0, *tube(curve, 3.0 + PX, 96))
    assert thick.spill_mm > 0.8 * PX and thick.missing_mm < 0.1 * PX
    thin = measure(curve, 3.0, *tube(curve, 3.0 - PX, 96))
    assert thin.missing_mm > 0.8 * PX and thin.spill_mm < 0.1 * PX


def test_a_missing_strand_and_a_loose_speck_are_found() -> None:
    big, small = circle(400, 60.0), circle(200, 20.0)
    g = geometry()
    vertices, faces = tube(big, 3.0, 64)
    field = tube_field([big, small], 3.0, g)
    lines = shadow_lines(vertices, faces, g)
    outline = shapely.get_coordinates(shadow_polygon(lines))
    missing = outline_error(field, outline, shadow_mask(lines, g))
    assert missing.missing_mm > 2.0 and missing.spill_mm < 0.1
    # a speck far smaller than a pixel: no pixel centre sees it, its outline does
    speck = outline_error(
        tube_field([big], 3.0, g),
        np.concatenate([outline, [[700.2, 700.3], [700.21, 700.3], [700.2, 700.31]]]),
        shadow_mask(lines, g),
    )
    assert speck.spill_mm > 10.0


@pytest.mark.slow
def test_a_radius_far_too_large_costs_little_memory() -> None:
    """A knots.json whose radius is twice its ring's made every pixel ask every capsule at once."""
    curve = circle(240, 20.0)
    g = geometry()
    vertices, faces = tube(curve, 3.0)
    lines = shadow_lines(vertices, faces, g)
    outline = shapely.get_coordinates(shadow_polygon(lines))
    shadow = shadow_mask(lines, g)
    tracemalloc.start()
    found = outline_error(tube_field([curve], 44.5, g), outline, shadow)
    peak_mb = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    assert peak_mb < 400
    assert found.missing_mm > 30


def test_hulls_are_those_of_shapely() -> None:
    """The lists of points hold some that lie on a line or occur twice."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(60, 30, 2))
    points[20:40] = np.round(2 * points[20:40])
    hulls = shapely.convex_hull(shapely.multipoints(points))
    for some, hull in zip(points, hulls, strict=True):
        begin, stop = _trace_hulls(some[None])
        np.testing.assert_array_equal(begin[1:], stop[:-1])  # a ring
        np.testing.assert_array_equal(begin[0], stop[-1])
        area = (begin[:, 0] * stop[:, 1] - begin[:, 1] * stop[:, 0]).sum() / 2
        assert area == pytest.approx(hull.area) and len(begin) == len(hull.exterior.coords) - 1
