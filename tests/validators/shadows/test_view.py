"""The validators' own view geometry: projected points of known place, tilted and turned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from validator_parts import Array, PlainView, box_mesh, circle, needs_rendering, tangle, tube

from knotfab_formats.views import Switches
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.shadows.compare import find_wall, receive, turn_view
from knotfab_validators.shadows.exact_shadow import (
    ShadowCaster,
    ShadowError,
    shadow_lines,
    shadow_mask,
    shadow_polygon,
)
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.lamp import blur_px
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.tube_field import outline_error, tube_field
from knotfab_validators.shadows.verify_view import count_stray
from knotfab_validators.shadows.view import ViewGeometry, view_geometry


def test_an_upright_wall_by_hand() -> None:
    g = view_geometry(PlainView(), 360, 360)
    # 600 mm from light to wall: a point at the origin is enlarged 600 / 500 times, 2 px per mm
    pixels, w = g.project(np.array([[0.0, 0, 0], [10.0, 0, 0], [0, 10.0, 0], [10.0, 10.0, -100.0]]))
    np.testing.assert_allclose(
        pixels, [[179.5, 179.5], [203.5, 179.5], [179.5, 155.5], [199.5, 159.5]], atol=1e-9
    )
    np.testing.assert_allclose(w, [500 / 600] * 3 + [1.0])
    np.testing.assert_allclose(g.receiver, [0, 0, 1, 100], atol=1e-12)


def test_azimuth_ninety_puts_the_light_at_plus_x() -> None:
    g = view_geometry(PlainView(azimuth_deg=90.0), 100, 100)
    np.testing.assert_allclose(g.light, [500, 0, 0], atol=1e-9)
    np.testing.assert_allclose(g.receiver, [1, 0, 0, 100], atol=1e-9)
    pixels, _ = g.project(np.array([[0.0, 0, -10.0]]))  # -z is on the right of who looks from +x
    assert pixels[0, 0] > 49.5


@pytest.mark.parametrize("tilt", [-40.0, 30.0])
@pytest.mark.parametrize("azimuth", [0.0, 70.0])
def test_a_tilted_wall_by_following_the_ray(tilt: float, azimuth: float) -> None:
    view = PlainView(wall_tilt_deg=tilt, azimuth_deg=azimuth, frame_height_mm=120.0)
    g = view_geometry(view, 300, 200)
    a, t = np.radians(azimuth), np.radians(tilt)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    light, centre = turn @ [0, 0, 500.0], turn @ [0, 0, -100.0]
    up = turn @ [0, np.cos(t), np.sin(t)]  # the top edge leans towards the light
    right = turn @ [1.0, 0, 0]
    normal = np.cross(right, up)
    points = np.random.default_rng(3).uniform(-60, 60, (40, 3))
    pixels, w = g.project(points)
    ray = points - light
    reach = (centre - light) @ normal / (ray @ normal)
    hit = light + reach[:, None] * ray - centre
    expected = np.column_stack([hit @ right / 180 * 300 + 149.5, -(hit @ up) / 120 * 200 + 99.5])
    np.testing.assert_allclose(pixels, expected, atol=1e-8)
    np.testing.assert_allclose(w, 1 / reach)
    np.testing.assert_allclose(g.receiver[:3], normal, atol=1e-12)
    np.testing.assert_allclose(g.receiver[:3] @ centre + g.receiver[3], 0, atol=1e-9)
    assert g.receiver[:3] @ light + g.receiver[3] > 0
    np.testing.assert_allclose(g.axis, turn @ [0, 0, 1.0], atol=1e-12)
    np.testing.assert_allclose(g.project(g.on_receiver(pixels))[0], pixels, atol=1e-8)


def test_part_coordinates_and_resampling_show_the_same_picture() -> None:
    g = view_geometry(PlainView(wall_tilt_deg=20.0, azimuth_deg=35.0), 50, 80)
    rng = np.random.default_rng(4)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, rng.normal(size=3) * 50
    part = rng.uniform(-50, 50, (20, 3))
    scene = part @ rotation.T + pose[:3, 3]
    seen, w = g.project(scene)
    own = g.in_part(pose)
    np.testing.assert_allclose(own.project(part)[0], seen, atol=1e-8)
    np.testing.assert_allclose(own.projection, g.projection @ pose, atol=1e-8)
    np.testing.assert_allclose(own.receiver, g.receiver @ pose, atol=1e-8)
    frame = working_frame(50, 80)
    fine, w_fine = g.resample(frame).project(scene)
    expected_u = (seen[:, 0] + 0.5) * frame.width / 50 - 0.5 + frame.pad_x
    expected_v = (seen[:, 1] + 0.5) * frame.height / 80 - 0.5 + frame.pad_y
    np.testing.assert_allclose(fine, np.column_stack([expected_u, expected_v]), atol=1e-7)
    np.testing.assert_allclose(w_fine, w)


def test_a_light_beside_the_axis_moves_neither_wall_nor_pixels() -> None:
    keys = {"name": "a", "azimuth_deg": 35, "elevation_deg": 10, "wall_tilt_deg": 20}
    straight, aside = (
        view_geometry(parse_scene({"views": [{**keys, **more}]}).views[0], 300, 200)
        for more in ({}, {"light_right_mm": 90, "light_up_mm": -30})
    )
    assert np.allclose(aside.origin, straight.origin) and np.allclose(aside.du, straight.du)
    assert np.allclose(aside.light - straight.light, 90 * aside.right - 30 * aside.up)
    spots = aside.on_receiver(np.array([[0.0, 0.0], [299.0, 10.0]]))
    assert np.allclose(
        aside.project(aside.light + 0.3 * (spots - aside.light))[0], [[0, 0], [299, 10]]
    )


# Shadows on a round wall: balls in closed form, three ways to one mask, and what cannot be.


RADII = [350.0, -130.0]
PIXELS = 256


def geometry(radius: float | None, **keys: Any) -> ViewGeometry:
    return view_geometry(PlainView(wall_radius_mm=radius, **keys), PIXELS, PIXELS)


def places(radius: float) -> Array:
    """(n, 3) where pixels' places lie on a wall whose middle is 100 mm behind the piece, row by row."""
    mm = (np.arange(PIXELS) - (PIXELS - 1) / 2) * 180 / PIXELS
    arc, down = (grid.ravel() for grid in np.meshgrid(mm, mm))
    turn = arc / radius
    return np.column_stack([radius * np.sin(turn), -down, radius * (1 - np.cos(turn)) - 100.0])


@pytest.mark.slow
@pytest.mark.parametrize("radius", RADII)
def test_a_balls_shadow_is_where_rays_pass_it(radius: float) -> None:
    g, ball, light = geometry(radius), np.array([35.0, 20.0, 10.0]), np.array([0.0, 0.0, 500.0])
    at = places(radius)
    ray = (at - light) / np.linalg.norm(at - light, axis=1)[:, None]
    away = np.linalg.norm(np.cross(ball - light, ray), axis=1)
    dark = (away < 12.0).reshape(PIXELS, PIXELS)
    found = tube_field([np.stack([ball, ball + 1e-6])], 12.0, g, [False])
    # a ball's picture is a polygon of 48 corners
    near = np.abs(away - 12.0).reshape(dark.shape) < 0.1
    assert dark.sum() > 500 and not ((found.mask != dark) & ~near).any()
    assert g.on_receiver(g.project(at)[0]) == pytest.approx(at, abs=1e-6)
    assert (found.mask != tube_field([ball[None]], 12.0, g.flat).mask).sum() > 15


@pytest.mark.parametrize("radius", RADII)
def test_distances_are_lengths_along_the_wall(radius: float) -> None:
    g = geometry(radius)
    field = tube_field([circle(720, 40.0)], 5.0, g)
    # in the plane of lamp and axis: the ray that touches the ball at (40, 0, 0), and the circle that it meets
    slope = np.arctan2(40, 500) + np.arcsin(5 / np.hypot(40, 500))
    away = np.linspace(300.0, 900.0, 600001)
    x, z = away * np.sin(slope), 500.0 - away * np.cos(slope)
    gap = np.hypot(x, z + 100.0 - radius) - abs(radius)
    hit = int(np.abs(np.where(z < -60.0, gap, np.inf)).argmin())
    arc = radius * np.arctan2(x[hit] / radius, 1 - (z[hit] + 100.0) / radius)
    for shift in (-0.5, 0.0, 0.25):
        pixel = np.array([[(arc + shift) * PIXELS / 180 + (PIXELS - 1) / 2, (PIXELS - 1) / 2]])
        assert field.signed_distance(pixel)[0] == pytest.approx(-shift, abs=8e-3)


@needs_rendering
@pytest.mark.parametrize("radius", RADII)
def test_rays_lines_and_the_exact_tube_agree(radius: float) -> None:
    g = geometry(radius, wall_tilt_deg=10.0, azimuth_deg=25.0)
    curve = tangle(200, 3)
    vertices, faces = tube(curve, 4.0, 24)
    lines = shadow_lines(vertices, faces, g)
    exact, outline = shadow_mask(lines, g), shadow_polygon(lines, g)
    with SilhouetteRenderer(vertices, faces) as renderer:
        rendered = renderer.render(g)
        flat = renderer.render(g.flat)
    assert count_stray(rendered, exact, outline) == 0
    assert (rendered != exact).mean() < 0.005 < (flat != exact).mean()
    error = outline_error(tube_field([curve], 4.0, g), shapely.get_coordinates(outline), exact)
    assert error.largest_mm < 0.2  # a tube of 24 sides, where light falls aslant


@pytest.mark.parametrize("radius", RADII)
def test_past_a_misplaced_light_the_whole_shadow_is_thrown(radius: float) -> None:
    low, high = np.array([-6.0, -6.0, -50.0]), np.array([6.0, 6.0, 560.0])
    bar, light = box_mesh(tuple(high - low)), np.array([40.0, 15.0, 500.0])
    g = replace(geometry(radius), light=light)
    found = ShadowCaster(bar.vertices + (low + high) / 2, bar.faces).render(g)
    # rays from the wall to the light meet the six planes of the bar, or none
    at = places(radius)
    ends = (np.stack([low, high])[:, None] - at) / (light - at)
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    dark = (np.maximum(enter, 0) < np.minimum(leave, 1)).reshape(PIXELS, PIXELS)
    assert dark[:, 0].any() and (found != dark).mean() < 0.002


def test_turned_with_the_piece_nothing_changes() -> None:
    g, points = (
        geometry(350.0, wall_tilt_deg=10.0),
        np.random.default_rng(0).uniform(-40, 40, (20, 3)),
    )
    middle, axis = np.array([5.0, -3.0, 2.0]), np.array([0.0, 1.0, 0.0])
    turned = turn_view(g, middle, axis, 0.3)
    c, s = np.cos(0.3), np.sin(0.3)
    moved = (points - middle) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + middle
    assert turned.project(points)[0] == pytest.approx(g.project(moved)[0], abs=1e-6)


def test_a_part_in_the_wall_is_refused() -> None:
    plate = box_mesh((150.0, 10.0, 1.0))
    near = plate.vertices - [0, 0, 95.0]
    shadow_lines(near, plate.faces, geometry(-400.0))
    with pytest.raises(ShadowError, match="cuts the hollow wall"):
        shadow_lines(near, plate.faces, geometry(400.0))


@pytest.mark.parametrize(("radius", "why"), [(-60.0, "narrower"), (250.0, "outside")])
def test_walls_that_cannot_be(radius: float, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        geometry(radius)


def test_it_is_looked_at_where_it_matters() -> None:
    assert find_wall(geometry(None)) is None
    far, near = (find_wall(geometry(radius)) for radius in (1e6, 400.0))
    assert far is not None and near is not None
    assert far is not None and near is not None and far.off_px < 0.05 and near.off_px > 5
    for seen, effects in ((geometry(1e6), Switches()), (geometry(400.0), Switches(wall=False))):
        received, wall = receive(seen, effects)
        assert received.cylinder is None and wall is None
    for seen, effects in ((geometry(400.0), Switches()), (geometry(1e6), Switches(wall=True))):
        received, wall = receive(seen, effects)
        assert received is seen and wall == find_wall(seen)
    scene = parse_scene({"views": [{"wall_radius_mm": -200.0}], "effects": {"wall": "off"}})
    assert (scene.views[0].wall_radius_mm, scene.effects.wall) == (-200.0, False)
    for wrong in (0, "round"):
        with pytest.raises(BadFile):
            parse_scene({"views": [{"wall_radius_mm": wrong}]})


def test_light_that_falls_aslant_blurs_more() -> None:
    """Light falls more aslant beside the middle of a column, and the wall is farther away there."""
    aside = np.array([[60.0, 0.0, 0.0]])
    straight, bent = (blur_px(aside, geometry(r), 20.0) for r in (None, -130.0))
    wall = places(-130.0)
    # the lamp's rim is thrown through the point onto the wall itself
    spots = []
    for x in (-10.0, 10.0):
        lamp = np.array([x, 0.0, 500.0])
        ray = wall - lamp
        off = np.linalg.norm(np.cross(aside - lamp, ray), axis=1) / np.linalg.norm(ray, axis=1)
        spots.append(int(off.argmin()) % PIXELS)
    assert bent > 1.15 * straight
    assert bent == pytest.approx(abs(spots[0] - spots[1]), abs=1.1)
