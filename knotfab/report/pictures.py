"""Pictures of the part from several sides: the picture from the light, a tangle from elsewhere."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["draw_part"]

Array = NDArray[np.float64]

ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)
PANEL_PX = 360
OVERSAMPLING = 2  # instead of multisampling, which software renderers do not always have
PAPER = (250, 248, 244)
TUBE = (0.82, 0.46, 0.31)
MARGIN = 1.12


def draw_part(
    vertices: Array,
    faces: NDArray[np.integer[Any]],
    path: Path,
    light_distance_mm: float = 500.0,
    angles_deg: Sequence[float] = ANGLES_DEG,
    panel_px: int = PANEL_PX,
) -> bool:
    """Draw the part in a row of panels, seen from the light and then turned about the vertical.

    The eye stands where the light does, so that the first panel shows the picture; all have one scale
    and the page's background. It is decoration: where this machine cannot render, nothing is written.

    Args:
        vertices: (n, 3) mm in scene coordinates, so that z points to the light and y up.
        faces: (m, 3).
        path: the PNG to write, `panel_px` high.
        light_distance_mm: from the scene's origin, along z.

    Returns:
        Whether the picture was written.
    """
    from knotfab_validators.shadows.render import why_no_rendering

    if why_no_rendering() is not None:
        return False
    from PIL import Image

    panels = _render(vertices, faces, light_distance_mm, angles_deg, panel_px * OVERSAMPLING)
    strip = Image.fromarray(np.concatenate(panels, axis=1))
    size = (panel_px * len(panels), panel_px)
    strip.resize(size, Image.Resampling.BOX).save(path, compress_level=6)
    return True


def _render(
    vertices: Array,
    faces: NDArray[np.integer[Any]],
    light_mm: float,
    angles_deg: Sequence[float],
    pixels: int,
) -> list[NDArray[np.uint8]]:
    if sys.platform.startswith("linux"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista

    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    points = vertices - middle
    triangles: Any = faces
    mesh = pyvista.PolyData.from_regular_faces(points.astype(np.float32), triangles)
    mesh.point_data.active_normals = _normals(points, faces)
    # Whatever the turn about y, what is drawn lies in this disc of the horizontal and this height.
    reach = max(float(np.hypot(points[:, 0], points[:, 2]).max()), float(abs(points[:, 1]).max()))

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[pixels, pixels], lighting="none")
    try:
        plotter.background_color = PAPER
        plotter.add_mesh(
            mesh, color=TUBE, smooth_shading=True, ambient=0.34, diffuse=0.8, specular=0.22,
            specular_power=18,
        )  # fmt: skip
        # A key light from the upper left and a weak one from the lower right, fixed to the camera.
        for where, strength in (((-0.5, 0.8, 1.2), 0.9), ((0.9, -0.4, 0.6), 0.25)):
            plotter.add_light(
                pyvista.Light(position=where, light_type="camera light", intensity=strength)
            )
        camera = plotter.camera
        x, y, z = np.array([0.0, 0.0, light_mm]) - middle
        away = max(float(z), 2 * reach)
        camera.view_angle = 2 * np.degrees(np.arctan(MARGIN * reach / (away - 0.5 * reach)))
        camera.clipping_range = (0.01 * away, away + 4 * reach)
        panels = []
        for angle in np.deg2rad(angles_deg):
            c, s = np.cos(angle), np.sin(angle)
            camera.position = (c * x + s * away, y, c * away - s * x)
            camera.focal_point = (0.0, 0.0, 0.0)
            camera.up = (0.0, 1.0, 0.0)
            plotter.render()
            panels.append(np.asarray(plotter.screenshot(return_img=True), dtype=np.uint8))
        return panels
    finally:
        plotter.close()


def _normals(points: Array, faces: NDArray[np.integer[Any]]) -> NDArray[np.float32]:
    """(n, 3) unit vertex normals, weighted by the area of the faces around."""
    corner = points[faces]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(face[:, axis], 3), minlength=len(points))
            for axis in range(3)
        ],
        axis=1,
    )
    length = np.sqrt(np.einsum("ij,ij->i", total, total))
    return np.asarray(total / np.maximum(length, 1e-300)[:, None], dtype=np.float32)
