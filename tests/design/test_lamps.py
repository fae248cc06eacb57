"""Places of lamps: within their bounds, and such that each one's pieces throw nothing else on the screen."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from knotfab.design.frames import frame_view
from knotfab.design.lamps import depth_apart, place_lamps
from knotfab.design.question import ask
from knotfab.picture.read import Target
from knotfab.scene.camera import cameras_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.lamps import with_lamps
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.start.start import make_start
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.scene import Scene
from knotfab_formats.search import search_settings


def masks(count: int = 3) -> tuple[Target, ...]:
    """Discs and bars that overlap, with the frame wider than they are."""
    v, u = np.mgrid[:160, :200]
    shapes = [
        np.hypot(u - 90 - 12 * k, v - 80 + 8 * k) < 50 - 4 * k
        if k % 2 == 0
        else (abs(u - 100) < 60) & (abs(v - 70) < 26)
        for k in range(count)
    ]
    return tuple(Target(f"m{k}", m, b"", 200, 160) for k, m in enumerate(shapes))


def scene_of(lamps: str = "rgb", text: str = "") -> Scene:
    scene = with_lamps(parse_scene(text), lamps)
    first = scene.views[0]
    views = tuple(v.model_copy(update={"frame_width_mm": 120.0}) for v in scene.views)
    assert first.wall == "" and all(v.wall == first.name for v in scene.views[1:])
    return scene.model_copy(update={"views": views})


@pytest.mark.parametrize("lamps", ["rgb", "warm+cold", "red+green+blue+white"])
def test_other_shadows_of_lamps_fall_beside_the_screen(lamps: str) -> None:
    scene = scene_of(lamps)
    targets = masks(len(scene.views))
    placed, _ = place_lamps(scene, targets)
    bounds = placed.lamps
    assert bounds.places == "fixed"
    views = [frame_view(v, t) for v, t in zip(placed.views, targets, strict=True)]
    depth = depth_apart(views, [t.mask for t in targets])
    assert depth is not None and depth > 10
    cameras = cameras_of(views, targets)
    for one, other in permutations(range(len(views)), 2):
        assert abs(views[one].light_right_mm) <= bounds.max_right_mm
        assert abs(views[one].light_up_mm) <= bounds.max_up_mm
        camera, rows = cameras[one], np.argwhere(targets[one].mask)
        on = camera.corner + rows[:, 1:] * camera.du + rows[:, :1] * camera.dv
        for z in (-0.5 * depth, 0.0, 0.5 * depth):  # the wall lies across z
            share = (camera.eye[2] - z) / (camera.eye[2] - on[:, 2])
            body = camera.eye + share[:, None] * (on - camera.eye)
            seen = cameras[other].project(body)
            inside = (seen > -0.5).all(1) & (seen[:, 0] < 199.5) & (seen[:, 1] < 159.5)
            assert not inside.any()


def test_lamps_keep_their_bounds_and_given_distances() -> None:
    text = "[lamps]\nmax_right_mm = 150\nmax_up_mm = 40\n"
    text += "[[views]]\nlight_distance_mm = 700\nwall_distance_mm = 400"
    placed, told = place_lamps(scene_of(text=text), masks())
    assert all(abs(v.light_right_mm) <= 150 and abs(v.light_up_mm) <= 40 for v in placed.views)
    assert {(v.light_distance_mm, v.wall_distance_mm) for v in placed.views} == {(700, 400)}
    assert "1100 mm" in told[0]
    assert place_lamps(placed, masks()) == (
        placed,
        (),
    )  # fixed: a rebuild finds them where they are
    assert parse_scene(dump_scene(placed)) == placed


@pytest.mark.parametrize("lamps", ["max_right_mm = 20\nmax_up_mm = 20", 'screen = "open"'])
def test_lamps_that_cannot_stand_apart_share_what_is_drawn(lamps: str) -> None:
    scene = scene_of("red+blue", f"[lamps]\n{lamps}")
    placed, told = place_lamps(scene, masks(2))
    assert len(told) == 2 and ask(resolve(placed), masks(2)).problem.apart_mm is None


@pytest.mark.slow
def test_each_mask_is_filled_where_its_own_lamp_sees_it() -> None:
    targets = masks()
    scene, _ = place_lamps(scene_of(), targets)
    question = ask(resolve(scene), targets)
    assert question.problem.apart_mm is not None
    assert min(bound.iou for bound in question.bounds) > 0.999
    settings = search_settings("sketch", {})
    start = make_start(question.problem, 1.5, settings)
    assert len(start.curves) == 3 and set(start.types) == {"unknot"}
    assert min(start.ious) > 0.9
    piece = scene.piece.model_copy(update={"knot": "trefoil"})
    asked = ask(resolve(scene.model_copy(update={"piece": piece})), targets)
    types = make_start(asked.problem, 1.5, settings).types
    assert sorted(types) == sorted(("unknot", "unknot", parse_knot_name("trefoil").promise))
