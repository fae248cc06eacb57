"""The camera that every stage uses keeps docs/conventions.md, line by line."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from knotfab.scene.camera import Camera, camera_of, cameras_of, view_axes
from knotfab_formats.scene import ResolvedView


def view(**keys: object) -> ResolvedView:
    return ResolvedView.model_validate({"frame_width_mm": 180.0, "frame_height_mm": 90.0, **keys})


def camera(**keys: object) -> Camera:
    return camera_of(view(**keys), 400, 200)


def pixel(cam: Camera, *point: float) -> list[float]:
    return list(cam.project(np.array([point]))[0])


def weight(cam: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    p = cam.projection
    return np.asarray(points @ p[2, :3] + p[2, 3])


def on_receiver(cam: Camera) -> NDArray[np.float64]:
    uv = np.array([[0, 0], [399, 0], [0, 199], [123.4, 56.7]])
    return np.asarray(cam.corner + uv[:, :1] * cam.du + uv[:, 1:] * cam.dv)


def test_light_is_on_z_and_wall_behind() -> None:
    cam = camera()
    assert cam.eye == pytest.approx([0, 0, 500])
    assert cam.receiver == pytest.approx([0, 0, 1, 100])


def test_the_axis_meets_the_frame_in_its_middle() -> None:
    for depth in (-100, 0, 200):
        assert pixel(camera(), 0, 0, depth) == pytest.approx([199.5, 99.5])


def test_picture_covers_the_frame_edge_to_edge() -> None:
    cam = camera()
    assert pixel(cam, -90, 45, -100) == pytest.approx([-0.5, -0.5])
    assert pixel(cam, 90, -45, -100) == pytest.approx([399.5, 199.5])


def test_u_is_right_v_is_down_seen_from_the_light() -> None:
    u, v = pixel(camera(), 10, 20, 0)
    assert u > 199.5 and v < 99.5


def test_shadow_is_larger_than_the_piece_by_similar_triangles() -> None:
    # 10 mm at the origin is 12 mm on the wall (600 / 500), and a pixel is 0.45 mm
    assert pixel(camera(), 10, 0, 0)[0] == pytest.approx(199.5 + 12 / 0.45)


@pytest.mark.parametrize("keys", [{}, {"azimuth_deg": 37.0, "wall_tilt_deg": -25.0}])
def test_weight_is_one_on_the_receiver_and_positive_before_light(keys: dict[str, float]) -> None:
    cam = camera(**keys)
    points = on_receiver(cam)
    assert weight(cam, points) == pytest.approx(np.ones(4))
    assert cam.project(points)[3] == pytest.approx([123.4, 56.7])
    towards = points + 0.9 * (cam.eye - points)
    assert (weight(cam, towards) > 0).all()
    beyond = points + 1.1 * (cam.eye - points)
    assert (weight(cam, beyond) < 0).all()


@pytest.mark.parametrize("keys", [{}, {"azimuth_deg": 200.0, "wall_tilt_deg": 40.0}])
def test_receiver_is_a_unit_normal_towards_the_light(keys: dict[str, float]) -> None:
    cam = camera(**keys)
    plane = cam.receiver
    assert np.linalg.norm(plane[:3]) == pytest.approx(1)
    assert plane[:3] @ cam.eye + plane[3] > 0
    assert on_receiver(cam) @ plane[:3] + plane[3] == pytest.approx(np.zeros(4), abs=1e-9)


def test_azimuth_90_puts_the_light_at_plus_x_and_keeps_up_up() -> None:
    cam = camera(azimuth_deg=90.0)
    assert cam.eye == pytest.approx([500, 0, 0])
    assert cam.receiver == pytest.approx([1, 0, 0, 100])
    assert pixel(cam, 0, 10, 0)[1] < 99.5
    assert pixel(cam, 0, 0, -10)[0] > 199.5  # from +x, right is -z


def test_azimuth_turns_the_whole_view() -> None:
    a = np.deg2rad(33.0)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    points = np.random.default_rng(1).uniform(-40, 40, (20, 3))
    straight = camera(wall_tilt_deg=10.0).project(points)
    assert camera(azimuth_deg=33.0, wall_tilt_deg=10.0).project(points @ turn.T) == pytest.approx(
        straight
    )


def test_positive_tilt_leans_the_top_edge_towards_the_light() -> None:
    cam = camera(wall_tilt_deg=20.0)
    top = cam.corner + 199.5 * cam.du - 0.5 * cam.dv
    bottom = cam.corner + 199.5 * cam.du + 199.5 * cam.dv
    assert top[2] > bottom[2] and top[1] > bottom[1]
    assert 0.5 * (top + bottom) == pytest.approx([0, 0, -100])
    assert np.linalg.norm(top - bottom) == pytest.approx(90)
    assert pixel(cam, 0, 0, 0) == pytest.approx([199.5, 99.5])


def test_the_documented_formula_of_the_projection() -> None:
    cam = camera(azimuth_deg=12.0, wall_tilt_deg=15.0)
    frame = np.stack([cam.du, cam.dv, cam.corner - cam.eye], axis=1)
    formula = np.linalg.solve(frame, np.column_stack([np.eye(3), -cam.eye]))
    assert cam.projection == pytest.approx(formula)


def test_resized_frames_follow_the_pixel_formula() -> None:
    cam = camera(azimuth_deg=20.0, wall_tilt_deg=5.0)
    points = np.random.default_rng(2).uniform(-40, 40, (20, 3))
    small = cam.resized(100, 30)
    expected = (cam.project(points) + 0.5) * [100 / 400, 30 / 200] - 0.5
    assert small.project(points) == pytest.approx(expected)
    assert weight(small, on_receiver(cam)) == pytest.approx(np.ones(4))
    assert (small.width, small.height) == (100, 30)


def test_padded_frames_shift_pixels_by_whole_numbers() -> None:
    cam = camera(wall_tilt_deg=5.0)
    points = np.random.default_rng(3).uniform(-40, 40, (20, 3))
    padded = cam.padded(100, 50)
    assert padded.project(points) == pytest.approx(cam.project(points) + np.array([100, 50]))
    assert (padded.width, padded.height) == (600, 300)
    assert padded.receiver == pytest.approx(cam.receiver)


def test_a_mirrored_picture_is_noticed() -> None:
    # right-handed: x right, y up, z towards the light
    cam = camera()
    assert np.cross(cam.du, -cam.dv) @ cam.receiver[:3] > 0


def test_a_light_as_far_as_the_sun_casts_parallel_rays() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [90, 45, 45]
    seen = camera(light_distance_mm=1e7).project(points)
    parallel = np.column_stack([points[:, 0], -points[:, 1]]) * 400 / 180 + [199.5, 99.5]
    assert np.abs(seen - parallel).max() < 0.008 * 400 / 1024


TURNED = {"azimuth_deg": 30.0, "elevation_deg": 20.0, "wall_tilt_deg": 15.0, "frame_up_mm": 12.0}


@pytest.mark.parametrize("keys", [{}, TURNED])
def test_a_shadow_lies_on_the_wall_where_its_point_is_seen(keys: dict[str, float]) -> None:
    cam = camera(**keys)
    points = np.random.default_rng(2).uniform(-40, 40, (50, 3))
    feet = cam.cast(points)
    assert feet @ cam.receiver[:3] + cam.receiver[3] == pytest.approx(np.zeros(50), abs=1e-9)
    assert cam.project(feet) == pytest.approx(cam.project(points), abs=1e-9)
    away = points - cam.eye  # and on the ray through the point, behind it
    assert np.cross(away, feet - cam.eye) == pytest.approx(np.zeros((50, 3)), abs=1e-6)
    assert (((feet - points) * away).sum(axis=1) > 0).all()


def test_each_view_has_the_pixels_of_its_picture() -> None:
    sizes = [SimpleNamespace(width=40, height=20), SimpleNamespace(width=30, height=60)]
    found = cameras_of([view(), view(azimuth_deg=90.0)], sizes)
    assert [(c.width, c.height) for c in found] == [(40, 20), (30, 60)]
    with pytest.raises(ValueError, match="longer"):
        cameras_of([view()], sizes)


@pytest.mark.parametrize("turned", [{}, {"azimuth_deg": 40.0, "elevation_deg": 20.0}])
def test_a_lamp_beside_the_axis_shines_on_the_same_frame(turned: dict[str, float]) -> None:
    straight, aside = camera(**turned), camera(**turned, light_right_mm=150.0, light_up_mm=-40.0)
    here = on_receiver(straight)
    assert aside.project(here) == pytest.approx(straight.project(here))
    assert aside.receiver == pytest.approx(straight.receiver)
    right, up, back = view_axes(view(**turned))
    assert aside.eye == pytest.approx(500 * back + 150 * right - 40 * up)
    # a point moved by the lamp's own shift, less the way to the wall, keeps its shadow
    u, v = aside.project((150 * right - 40 * up)[None] * 100 / 600)[0]
    assert (u, v) == pytest.approx((199.5, 99.5))
