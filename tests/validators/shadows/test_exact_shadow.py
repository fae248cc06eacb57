"""The exact shadow against brute force: the union of all projected triangles, one by one."""

from __future__ import annotations

import os
import subprocess
import sys

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
def test_matter_behind_the_wall_casts_none_unless_asked_for() -> None:
    g = view_geometry(PlainView(wall_distance_mm=5.0, wall_tilt_deg=20.0), 256, 256)
    vertices, faces = tube(trefoil(), 3.0, 24)  # runs through the wall
    with SilhouetteRenderer(vertices, faces) as renderer:
        front, all_of_it = renderer.render(g), renderer.render(g, behind=True)
    exact = shadow_mask(shadow_lines(vertices, faces, g), g)
    assert not (front ^ exact)[~touching_outline(exact)].any()
    assert all_of_it.sum() > 1.2 * front.sum()
    assert not (front & ~all_of_it).any()


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
