"""Slices of a printed part: against points along each ray, and against the part itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from validator_parts import CURVE, PlainView, box_mesh, tube

from knotfab_formats.views import Switches
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.misplacement import (
    layer_shift_px,
    layered_mask,
    measure_layers,
    shows_layers,
)
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

PIXELS = 40


def geometry(pixels: int = PIXELS, elevation: float = 0.0) -> ViewGeometry:
    return view_geometry(
        PlainView(frame_width_mm=120.0, frame_height_mm=120.0, elevation_deg=elevation),
        pixels,
        pixels,
    )


def slab(turn_deg: float) -> tuple[Mesh, NDArray[np.float64]]:
    """A slab of 40 x 30 x 20 mm, turned about two axes, and that turn (3, 3)."""
    a, b = np.radians([turn_deg, 0.6 * turn_deg])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_z = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    plain, turn = box_mesh((40.0, 30.0, 20.0)), about_x @ about_z
    return Mesh(plain.vertices @ turn.T, plain.faces), turn


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turn", "elevation"), [(0.0, 0.0), (25.0, 0.0), (25.0, 50.0), (25.0, 90.0), (70.0, -75.0)]
)
def test_slices_hide_what_points_along_the_rays_hit(turn: float, elevation: float) -> None:
    """A point is in the stack where the point in the middle of its layer is in the slab."""
    layer = 4.0
    part, matrix = slab(turn)
    seen = geometry(elevation=elevation)
    found = layered_mask(part, seen, layer)
    v, u = np.mgrid[:PIXELS, :PIXELS]
    spots = seen.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    # these are shares of the way from the wall to the light
    share = np.linspace(0.08, 0.28, 1000)[None, :, None]
    points = spots[:, None] + share * (seen.light - spots[:, None])
    points[..., 2] = (np.floor(points[..., 2] / layer) + 0.5) * layer
    inside = (abs(points @ matrix) < [20.0, 15.0, 10.0]).all(axis=2).any(axis=1)
    off = found != inside.reshape(PIXELS, PIXELS)
    assert found.sum() > 100 and off.sum() <= 0.02 * found.sum()  # rays between two points


def test_thin_layers_are_the_part_and_thick_ones_are_not() -> None:
    curve = Mesh(*tube(CURVE, 3.0))
    view = geometry(240, elevation=35.0)
    smooth = shadow_mask(shadow_lines(curve.vertices, curve.faces, view), view)
    apart = []
    for layer in (1.0, 0.5, 0.1):
        shift = layer_shift_px(curve.vertices, view, layer)
        mask = layered_mask(curve, view, layer)
        apart.append(int((mask != smooth).sum()))
        # half a layer is seen from 35 degrees above, 1.2 times larger, in pixels of half a millimetre
        assert shift == pytest.approx(layer, rel=0.35)
    assert apart[0] > apart[1] > apart[2] and apart[2] < 0.01 * smooth.sum()
    shift = layer_shift_px(curve.vertices, view, 1.0)
    found = measure_layers(curve, view, 1.0, smooth, smooth, shift)
    assert found.iou_smooth == 1.0 > found.iou > 0.8
    assert found.shift_px == shift


def test_matter_behind_the_wall_throws_no_shadow() -> None:
    wall = box_mesh((60.0, 60.0, 4.0))
    plate = Mesh(wall.vertices + [0, 0, -103.0], wall.faces)  # the wall is 100 mm behind
    assert not layered_mask(plate, geometry(), 0.5).any()
    assert layer_shift_px(plate.vertices[plate.vertices[:, 2] < -101], geometry(), 0.5) == 0.0


def test_it_is_looked_at_where_the_scene_calls_for_it() -> None:
    assert shows_layers(Switches(), 0.51) and not shows_layers(Switches(), 0.49)
    assert shows_layers(Switches(layers=True), 0.0) and not shows_layers(
        Switches(layers=False), 9.0
    )
