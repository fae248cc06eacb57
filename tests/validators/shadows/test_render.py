"""Rendered silhouettes agree with the exact polygons; a machine that cannot render is told so."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy import ndimage
from small_views import needs_rendering
from validator_parts import PlainView, tangle, trefoil, tube

from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer, why_no_rendering
from knotfab_validators.shadows.view import view_geometry


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
