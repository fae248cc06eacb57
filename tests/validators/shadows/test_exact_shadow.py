"""The exact shadow against brute force: the union of all projected triangles, one by one."""

import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import shapely
from scipy import ndimage
from validator_parts import Array, PlainView, circle, needs_rendering, tangle, trefoil, tube

from knotfab_validators.shadows.exact_shadow import (
    Linework,
    ShadowError,
    shadow_lines,
    shadow_mask,
    shadow_polygon,
    winding_at,
    wound_mask,
)
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer, why_no_rendering
from knotfab_validators.shadows.tube_field import (
    OutlineError,
    _trace_hulls,
    outline_error,
    tube_field,
)
from knotfab_validators.shadows.view import ViewGeometry, view_geometry


def brute_force(vertices: Array, faces: Array, geometry: ViewGeometry) -> shapely.Geometry:
    pixels, _ = geometry.project(vertices)
    triangles = shapely.polygons(pixels[np.column_stack([faces, faces[:, 0]])])
    return shapely.union_all(triangles[shapely.area(triangles) > 1e-9])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_the_union_of_all_triangles(seed: int) -> None:
    g = view_geometry(PlainView(wall_tilt_deg=15.0 * (seed - 1), azimuth_deg=40.0 * seed), 300, 300)
    vertices, faces = tube(tangle(160, seed), 4.0, 12)
    lines = shadow_lines(vertices, faces, g)
    exact, expected = shadow_polygon(lines), brute_force(vertices, faces, g)
    assert exact.symmetric_difference(expected).area < 1e-6 * expected.area
    assert len(exact.interiors if exact.geom_type == "Polygon" else [0]) > 0
    mask = shadow_mask(lines, g)
    v, u = np.mgrid[: g.height, : g.width]
    np.testing.assert_array_equal(mask, shapely.contains_xy(expected, u, v))


def test_holds_for_open_and_inverted_meshes_too() -> None:
    g = view_geometry(PlainView(), 200, 200)
    vertices, faces = tube(tangle(120, 7), 4.0, 10)
    faces = faces[np.random.default_rng(0).random(len(faces)) < 0.6]
    faces[::3] = faces[::3, ::-1]
    exact, expected = (
        shadow_polygon(shadow_lines(vertices, faces, g)),
        brute_force(vertices, faces, g),
    )
    assert exact.symmetric_difference(expected).area < 1e-6 * expected.area


@pytest.mark.slow
def test_a_ring_has_the_area_of_its_cone_section() -> None:
    g = view_geometry(PlainView(), 1800, 1800)  # 10 px per mm
    vertices, faces = tube(circle(720, 30.0), 5.0, 256)
    shadow = shadow_polygon(shadow_lines(vertices, faces, g))
    # outlines: rays that touch the circle of radius 5 about (30, 0) in a plane through the axis
    slope = np.arctan2(30, 500) + np.array([1, -1]) * np.arcsin(5 / np.hypot(30, 500))
    outer, inner = 6000 * np.tan(slope)
    assert shadow.area == pytest.approx(np.pi * (outer**2 - inner**2), rel=3e-4)
    assert len(shadow.interiors) == 1


def test_matter_behind_the_wall_casts_none() -> None:
    g = view_geometry(PlainView(wall_distance_mm=0.0, light_distance_mm=600.0), 400, 400)
    vertices, faces = tube(circle(200, 40.0), 4.0, 32)
    behind = vertices - np.array([0, 0, 4.0])  # touches the plane from behind
    assert not shadow_mask(shadow_lines(behind, faces, g), g).any()
    half = shadow_polygon(shadow_lines(vertices, faces, g))  # cut through the middle
    scale = 400 / 180
    # the rest of the ring: its section at the plane, a little enlarged where it is nearer
    assert half.area == pytest.approx(np.pi * (44**2 - 36**2) * scale**2, rel=5e-3)
    front = shadow_polygon(shadow_lines(vertices + np.array([0, 0, 4.0]), faces, g))
    assert front.area > half.area


def test_a_part_that_reaches_the_light_is_refused() -> None:
    g = view_geometry(PlainView(light_distance_mm=30.0), 64, 64)
    vertices, faces = tube(tangle(100, 1), 3.0, 8)
    with pytest.raises(ShadowError):
        shadow_lines(vertices, faces, g)


# Winding numbers of a linework in the plane.


def test_winding_numbers_count_turns() -> None:
    square = np.array([[0.5, 0.5], [8.5, 0.5], [8.5, 8.5], [0.5, 8.5]])
    twice = Linework(square, np.roll(square, -1, axis=0), np.full(4, 2))
    mask = wound_mask([twice], 12, 10)
    assert np.count_nonzero(mask) == 64
    points = np.array([[1.0, 1.0], [8.0, 8.0], [9.0, 1.0], [0.0, 5.0], [4.0, 20.0]])
    assert np.abs(winding_at(points, twice)).tolist() == [2, 2, 0, 0, 0]
    v, u = np.mgrid[:10, :12]
    at = winding_at(np.column_stack([u.ravel(), v.ravel()]).astype(float), twice)
    np.testing.assert_array_equal(at.reshape(10, 12) != 0, mask)


def test_what_parts_wind_adds_up_and_may_cancel() -> None:
    draw = np.random.default_rng(5)
    loops = draw.uniform(-4.0, 34.0, (2, 40, 2))
    parts = [Linework(p, np.roll(p, -1, axis=0), np.ones(40, dtype=np.int64)) for p in loops]
    v, u = np.mgrid[:30, :30]
    points = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    both = sum(winding_at(points, part) for part in parts)
    np.testing.assert_array_equal(wound_mask(parts, 30, 30).ravel(), both != 0)
    back = Linework(parts[0].end, parts[0].start, parts[0].weight)
    assert not wound_mask([parts[0], back], 30, 30).any()


# Rendered silhouettes agree with the exact polygons; a machine that cannot render is told so.


def touching_outline(mask: np.ndarray) -> np.ndarray:
    """Pixels within one pixel of the mask's outline, on either side."""
    square = np.ones((3, 3), dtype=bool)
    return ndimage.binary_dilation(mask, square) & ~ndimage.binary_erosion(mask, square)


@needs_rendering
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_the_exact_shadow(seed: int) -> None:
    tilt, azimuth = [0.0, 30.0, -50.0, 10.0][seed], [0.0, 130.0, 45.0, -90.0][seed]
    view = PlainView(
        wall_tilt_deg=tilt, azimuth_deg=azimuth, frame_height_mm=120.0, light_distance_mm=300.0
    )
    width, height = [(512, 341), (60, 40), (300, 200), (200, 199)][seed]
    g = view_geometry(view, width, height).resample(working_frame(width, height))
    vertices, faces = tube(tangle(250, seed, 45.0), 2.5, 24)
    exact = shadow_mask(shadow_lines(vertices, faces, g), g)
    with SilhouetteRenderer(vertices, faces) as renderer:
        seen = renderer.render(g)
        again = renderer.render(g)
    assert seen.shape == (g.height, g.width) and seen.sum() > 1000
    np.testing.assert_array_equal(seen, again)
    assert not (seen ^ exact)[~touching_outline(exact)].any()
    assert (seen ^ exact).sum() < 0.002 * exact.sum()


@needs_rendering
def test_the_comparison_can_fail() -> None:
    g = view_geometry(PlainView(), 64, 64).resample(working_frame(64, 64))
    vertices, faces = tube(trefoil(), 3.0, 24)
    with SilhouetteRenderer(vertices + np.array([0.0, 1.0, 0.0]), faces) as renderer:
        seen = renderer.render(g)
    exact = shadow_mask(shadow_lines(vertices, faces, g), g)
    assert (seen ^ exact)[~touching_outline(exact)].any()


@needs_rendering
def test_of_a_tube_through_the_wall_only_what_is_before_it_casts_a_shadow() -> None:
    g = view_geometry(PlainView(wall_distance_mm=5.0, wall_tilt_deg=20.0), 256, 256)
    vertices, faces = tube(trefoil(), 3.0, 24)  # runs through the wall
    with SilhouetteRenderer(vertices, faces) as renderer:
        front = renderer.render(g)
    exact = shadow_mask(shadow_lines(vertices, faces, g), g)
    assert not (front ^ exact)[~touching_outline(exact)].any()


@needs_rendering
def test_known_points_land_on_their_pixels() -> None:
    g = view_geometry(PlainView(wall_tilt_deg=35.0, azimuth_deg=20.0), 400, 300)
    points = np.array([[30.0, 20.0, 10.0], [-40.0, 5.0, -30.0], [0.0, -35.0, 25.0]])
    corners = np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]]) * 0.4
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    vertices = (points[:, None] + corners).reshape(-1, 3)
    with SilhouetteRenderer(vertices, np.concatenate([faces, faces + 4, faces + 8])) as renderer:
        seen = renderer.render(g)
    labels, count = ndimage.label(seen, np.ones((3, 3)))
    assert count == 3
    centres = np.array(ndimage.center_of_mass(seen, labels, [1, 2, 3]))[:, ::-1]
    for pixel in g.project(points)[0]:
        assert np.linalg.norm(centres - pixel, axis=1).min() < 0.5


def test_switched_off_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KNOTFAB_NO_RENDERING", "1")
    assert why_no_rendering() is not None
    with pytest.raises(CannotRender, match="apt-get install libegl1 libgl1"):
        SilhouetteRenderer(*tube(trefoil(30), 3.0, 6))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is Linux's")
@pytest.mark.slow
def test_without_a_driver_it_refuses_instead_of_crashing() -> None:
    # EGL's loader is told that no vendor library exists, as on a machine without libegl1's Mesa
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull}
    code = (
        "import numpy as np\n"
        "from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer\n"
        "import sys\n"
        "try:\n"
        "    SilhouetteRenderer(np.eye(3), np.array([[0, 1, 2]]))\n"
        "except CannotRender as error:\n"
        "    assert not any(m.startswith(('vtk', 'pyvista')) for m in sys.modules)\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "apt-get install" in done.stdout


# The exact tube's picture: distances of known value, and shadows that must be found wrong.


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
