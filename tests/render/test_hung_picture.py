"""The piece with its lamp on: its shadow lies where the lamp throws it, and most of it is seen."""

import numpy as np
import pytest
from pieces import ring
from PIL import Image

from knotfab.geometry.tube import sweep
from knotfab.render import hung_picture
from knotfab.render.hung_picture import (
    _cast,
    _choose_lamps,
    _frame,
    _place_viewer,
    draw_hung,
    draw_unlit,
)
from knotfab.render.part_picture import Light, PartPainter, eye_towards, why_undrawn
from knotfab_formats.scene import ResolvedView

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(why_undrawn() is not None, reason="OpenGL is missing"),
]
VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0, wall_distance_mm=100.0)
VERTICES, FACES = sweep(ring(30.0, wave=0.0), 2.0, 12)


NEAR_PX = 8  # in a drawing as small as those of the tests


def grey(image: Image.Image | None) -> np.ndarray:
    assert image is not None and image.size == (hung_picture.WIDE_PX, hung_picture.HIGH_PX)
    return np.asarray(image.convert("L")).astype(float)


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_the_wall_is_dark_where_the_lamp_is_hidden_and_light_beside_it(turn: float) -> None:
    view = VIEW.but(azimuth_deg=turn)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = VERTICES @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    lamps = _choose_lamps([view])
    with PartPainter(turned, FACES) as painter:
        drawn = grey(draw_hung(painter, [view]))
        eye = _place_viewer(painter.points, lamps)
    shadow = _cast(turned, lamps[0].place, lamps[0].wall)
    middle = shadow.mean(axis=0)
    seen, _ = eye.project(shadow)
    body, _ = eye.project(turned)
    # the wall is seen there
    away = np.linalg.norm(seen[:, None] - body[None], axis=2).min(axis=1) > NEAR_PX
    assert away.sum() > 200
    mid, out = (eye.project(middle + share * (shadow - middle))[0][away] for share in (1.0, 1.2))
    dark, light = (drawn[tuple(p[:, ::-1].astype(int).T)] for p in (mid, out))
    assert np.median(dark) < 0.75 * np.median(light)


def test_all_of_piece_and_shadow_lies_in_the_picture() -> None:
    lamps = _choose_lamps([VIEW])
    eye = _place_viewer(VERTICES, lamps)
    seen, _ = eye.project(
        np.concatenate([VERTICES, _cast(VERTICES, lamps[0].place, lamps[0].wall)])
    )
    assert (seen > 0).all() and (seen < (hung_picture.WIDE_PX, hung_picture.HIGH_PX)).all()


def test_two_walls_make_a_corner_and_a_third_lamp_on_one_wall_mixes_with_it() -> None:
    aside, opposite = (
        VIEW.but(name="aside", azimuth_deg=90.0),
        VIEW.but(name="o", azimuth_deg=180.0),
    )
    assert len(_choose_lamps([VIEW, aside])) == 2
    assert len(_choose_lamps([VIEW, opposite])) == 1
    beside = [VIEW.but(light_right_mm=right) for right in (-50.0, 0.0, 50.0, 80.0)]
    assert len(_choose_lamps(beside)) == 3


def test_an_eye_has_no_shadow_and_the_same_piece_the_same_picture() -> None:
    with PartPainter(VERTICES, FACES) as painter:
        assert draw_hung(painter, [VIEW.but(kind="eye")]) is None
        one = grey(draw_hung(painter, [VIEW], desk_mm=-40.0))
        assert (one == grey(draw_hung(painter, [VIEW], desk_mm=-40.0))).all()


def test_by_day_no_shadow_lies_on_the_wall() -> None:
    lamp = _choose_lamps([VIEW])[0]
    eyes = np.array([[300.0, 0.0, 300.0], [-300.0, 200.0, 300.0]])
    with PartPainter(VERTICES, FACES) as painter:
        drawn = np.asarray(draw_unlit(painter, [VIEW], eyes).convert("L")).astype(float)
        on_paper = draw_unlit(painter, [VIEW.but(kind="eye")], eyes)
    assert drawn.shape == (hung_picture._DAY_PX[1], 2 * hung_picture._DAY_PX[0])
    assert on_paper.width == 2 * on_paper.height
    way = (eyes[0] - lamp.middle) / np.linalg.norm(eyes[0] - lamp.middle)
    eye = _frame(VERTICES, way, [lamp], hung_picture._DAY_PX)
    shadow = _cast(VERTICES, lamp.place, lamp.wall)
    body, _ = eye.project(VERTICES)
    middle = shadow.mean(axis=0)
    seen, beside = (eye.project(middle + share * (shadow - middle))[0] for share in (1.0, 1.2))
    apart = np.linalg.norm(seen[:, None] - body[None], axis=2).min(axis=1) > NEAR_PX
    dark, light = (drawn[tuple(p[apart][:, ::-1].astype(int).T)] for p in (seen, beside))
    assert apart.sum() > 200
    assert np.median(dark) > 0.95 * np.median(light)
    assert drawn[tuple(body[:, ::-1].astype(int).T)].mean() < 0.8 * np.median(light)


def test_a_border_is_covered_in_part_and_a_light_lights_by_its_angle() -> None:
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    eye = eye_towards(np.array([0.0, 0.0, 10.0]), np.zeros(3), (0.3, 1, 0), 10.0, (41, 41), 5.0)
    angle = np.radians(70.0)
    far = 1e6 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    with PartPainter(square, np.array([[0, 1, 2], [0, 2, 3]])) as painter:
        painter.light(Light(far, np.eye(3)[1], False))
        light, depth = painter.look(eye)
    assert light[20, 20] == pytest.approx([0.0, np.cos(angle), 0.0, 1.0], abs=0.01)
    assert depth[20, 20] == pytest.approx(10.0, rel=1e-4)
    assert depth[0, 0] == pytest.approx(eye.far)
    assert light[..., 3].sum() == pytest.approx((2 * eye.focal_px / 10) ** 2, rel=0.03)
    assert {0.25, 0.5, 0.75} & set(np.round(light[..., 3].ravel(), 2).tolist())


def test_a_large_picture_is_drawn_about_the_part_alone_and_looks_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    eye = eye_towards(np.array([90.0, 40.0, 150.0]), np.zeros(3), (0, 1, 0), 25.0, (160, 120), 60.0)
    with PartPainter(VERTICES + (15.0, 5.0, 0.0), FACES) as painter:
        painter.light(Light(np.array([-0.6, 1.0, 0.8]), np.eye(3)[2], True))
        whole = painter.look(eye)
        monkeypatch.setattr("knotfab.render.part_picture._SMALL_PX", 0)
        cut = painter.look(eye)
    assert 0.02 < (whole[0][..., 3] > 0).mean() < 0.5
    for one, other in zip(whole, cut, strict=True):
        near = np.isclose(one, other, rtol=1e-3, atol=0.02)
        assert near.mean() > 0.999
