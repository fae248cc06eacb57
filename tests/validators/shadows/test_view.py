"""The validators' own view geometry: projected points of known place, tilted and turned."""

from dataclasses import replace

import numpy as np
import pytest
from validator_parts import PlainView, box_mesh, needs_rendering, tangle, trefoil, tube

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.shadows.compare import turn_view
from knotfab_validators.shadows.exact_shadow import (
    ShadowCaster,
    ShadowError,
    shadow_lines,
    shadow_mask,
)
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.render import SilhouetteRenderer
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


def test_turned_with_the_piece_nothing_changes() -> None:
    g = view_geometry(PlainView(wall_tilt_deg=10.0), 256, 256)
    points = np.random.default_rng(0).uniform(-40, 40, (20, 3))
    middle, axis = np.array([5.0, -3.0, 2.0]), np.array([0.0, 1.0, 0.0])
    turned = turn_view(g, middle, axis, 0.3)
    c, s = np.cos(0.3), np.sin(0.3)
    moved = (points - middle) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + middle
    assert turned.project(points)[0] == pytest.approx(g.project(moved)[0], abs=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 25.0])
def test_past_a_misplaced_light_the_whole_shadow_is_thrown(tilt: float) -> None:
    low, high = np.array([-6.0, -6.0, -30.0]), np.array([6.0, 6.0, 560.0])
    bar, light = box_mesh(tuple(high - low)), np.array([40.0, 15.0, 500.0])
    g = replace(view_geometry(PlainView(wall_tilt_deg=tilt), 256, 256), light=light)
    found = ShadowCaster(bar.vertices + (low + high) / 2, bar.faces).render(g)
    # rays from the wall to the light meet the six planes of the bar, or none
    v, u = np.mgrid[:256, :256]
    at = g.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    ends = (np.stack([low, high])[:, None] - at) / (light - at)
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    dark = (np.maximum(enter, 0) < np.minimum(leave, 1)).reshape(256, 256)
    assert dark[:, 0].any() and (found != dark).mean() < 0.002


# Shadows by a table of edges, for light after light: the exact ones, and those that are rendered.


def test_the_exact_shadow_of_every_light_is_cast() -> None:
    vertices, faces = tube(tangle(150, 5, 45.0), 2.5, 12)
    caster = ShadowCaster(vertices, faces)
    for far, tilt in ((40.0, 0.0), (60.0, 25.0), (5.0, -20.0)):
        view = PlainView(wall_distance_mm=far, wall_tilt_deg=tilt)
        g = view_geometry(view, 120, 90)
        for light in (g.light, g.light + [30.0, -20.0, 5.0]):
            moved = replace(g, light=light)
            exact = shadow_mask(shadow_lines(vertices, faces, moved), moved)
            np.testing.assert_array_equal(caster.render(moved), exact)
            assert 200 < exact.sum() < exact.size


@needs_rendering
def test_it_draws_what_the_renderer_draws() -> None:
    vertices, faces = tube(trefoil(), 3.0, 24)
    g = view_geometry(PlainView(wall_distance_mm=5.0, wall_tilt_deg=20.0), 256, 256)
    with SilhouetteRenderer(vertices, faces) as renderer:
        rendered = renderer.render(g)
    cast = ShadowCaster(vertices, faces).render(g)
    assert (cast != rendered).sum() <= 0.002 * rendered.sum()


def met_by_rays(g: ViewGeometry, corners: Array) -> Mask:
    """Find which pixels' rays, from the receiver to the light, meet one of the triangles (m, 3, 3): all by
    all."""
    v, u = np.mgrid[: g.height, : g.width]
    at = g.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    met = np.zeros(len(at), dtype=bool)
    for a, b, c in corners:
        way = np.broadcast_to(g.light - at, at.shape)
        system = np.stack([-way, np.broadcast_to(b - a, at.shape), (c - a) + 0 * at], axis=2)
        t, p, q = np.linalg.solve(system, (at - a)[:, :, None])[:, :, 0].T
        met |= (t > 0) & (t < 1) & (p >= 0) & (q >= 0) & (p + q <= 1)
    return met.reshape(g.height, g.width)


def test_faces_across_the_light_and_the_wall_are_cut_there() -> None:
    """Faces that are whole before the wall are sorted once for all lights."""
    rng = np.random.default_rng(3)
    corners = rng.uniform([-40, -40, -90], [40, 40, 60], (12, 3, 3))
    corners[:4, 0, 2], corners[4:8, 0, 2] = 300.0, -150.0  # behind the light; behind the wall
    corners[0, 1, 2] = 250.0
    caster = ShadowCaster(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    g = view_geometry(PlainView(light_distance_mm=200.0), 48, 48)
    with pytest.raises(ShadowError, match="reaches the light"):
        caster.lines(g)
    for light in (g.light, g.light + [15.0, -10.0, 5.0]):
        moved = replace(g, light=light)
        seen, last = caster.render(moved), caster._last
        expected = met_by_rays(moved, corners)
        np.testing.assert_array_equal(seen, expected)
        assert (expected & ~met_by_rays(moved, corners[4:])).sum() > 50
        assert (expected & ~met_by_rays(moved, np.delete(corners, range(4, 8), 0))).sum() > 50
        caster.render(replace(moved, light=light + 1.0))
        assert caster._last is last and last is not None and len(last[2].faces) == 4


@needs_rendering
@pytest.mark.parametrize(("above", "dark"), [(0.0, False), (0.015, False), (0.1, True)])
def test_a_plate_whose_face_is_the_wall_casts_nothing(above: float, dark: bool) -> None:
    """Cleaning a mesh may leave its face by hundredths of a millimetre before the wall."""
    g = view_geometry(PlainView(wall_distance_mm=40.0), 64, 64)
    pixels = np.array([[8.0, 8.0], [56.0, 10.0], [30.0, 50.0]])
    corners = g.on_receiver(pixels) + above * g.normal
    face = np.array([[0, 1, 2]], dtype=np.int32)
    with SilhouetteRenderer(corners, face) as renderer:
        assert renderer.render(g).any() == dark
    assert ShadowCaster(corners, face).render(g).any() == dark
    assert shadow_mask(shadow_lines(corners, face, g), g).any() == dark
