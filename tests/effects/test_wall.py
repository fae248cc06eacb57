"""Round walls: places by closed forms, the picture there and back, and what cannot be."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import questions
import shapely
from PIL import Image

from knotfab.design.walls import flatten_targets
from knotfab.effects.base import EffectContext
from knotfab.effects.shifts import WALL
from knotfab.picture.read import Target
from knotfab.scene.camera import CurvedWall, require_wall
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.scene.require import require_walls
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.views import Switches

PLACES = np.random.default_rng(0).uniform(-80, 80, (50, 2))


def view(radius: float | None, **keys: Any) -> ResolvedView:
    return questions.view(wall_radius_mm=radius, **keys)


def wall_of(seen: ResolvedView) -> CurvedWall:
    wall = CurvedWall.from_view(seen)
    assert wall is not None
    return wall


def magnitude(seen: ResolvedView) -> float:
    return WALL.magnitude(EffectContext((seen,), np.zeros((0, 3)), 2.0, 0.25))


@pytest.mark.parametrize("radius", [350.0, 2000.0, -120.0])
@pytest.mark.parametrize(
    "keys", [{}, {"wall_tilt_deg": 20.0, "azimuth_deg": 40.0, "frame_up_mm": 15.0}]
)
def test_a_place_its_flat_one_and_the_light_are_on_one_ray(radius: float, keys: Any) -> None:
    seen = view(radius, **keys)
    wall = wall_of(seen)
    flat = wall.flatten(PLACES)
    assert wall.unroll(flat) == pytest.approx(PLACES, abs=1e-9)
    points, normals = wall.stand(PLACES)
    light = wall.foot + wall.light @ wall.axes
    there = wall.foot + flat @ wall.axes[:2]
    assert np.abs(np.cross(points - light, there - light)).max() < 1e-6 * 600**2
    # on a circle about an axis that is radius before the flat wall, with normals to or from it
    off = points - (wall.foot + radius * wall.axes[2])
    off -= (off @ wall.axes[1])[:, None] * wall.axes[1]
    assert np.linalg.norm(off, axis=1) == pytest.approx(np.full(50, abs(radius)))
    assert normals == pytest.approx(-off / radius)
    planes = wall.touching(0.3 * light + 0.7 * points)
    assert planes[:, :3] == pytest.approx(normals, abs=1e-9)
    assert (planes[:, :3] * points).sum(axis=1) + planes[:, 3] == pytest.approx(
        np.zeros(50), abs=1e-6
    )


def test_the_magnitude_is_the_rule_and_nothing_of_a_flat_wall() -> None:
    x, high, radius = 90.0, 600.0, 3000.0
    up = x**3 / (2 * radius * high)  # the move in y at the corner, where |y| = x
    across = up - x**3 / (6 * radius**2)
    px = 180 / 1024
    assert magnitude(view(radius)) == pytest.approx(np.hypot(up, across) / px, rel=0.02)
    assert magnitude(view(None)) == 0.0 < magnitude(view(1e9)) < 1e-3
    assert magnitude(view(-50.0)) == np.inf


def target(mask: Any) -> Target:
    return Target("disc", mask, b"", mask.shape[1], mask.shape[0])


def disc(seen: ResolvedView, size: int) -> Any:
    """A disc on the round wall, and where its rays meet the flat one, by a polygon of its edge."""
    angle = np.linspace(0, 2 * np.pi, 400)
    edge = np.column_stack([35 + 45 * np.cos(angle), -35 + 45 * np.sin(angle)])
    rows, columns = np.mgrid[:size, :size]
    masks = []
    for places in (edge, wall_of(seen).flatten(edge)):
        polygon = shapely.Polygon((places * [1, -1] / 180 + 0.5) * size - 0.5)
        masks.append(shapely.contains_xy(polygon, columns, rows))
    return masks


@pytest.mark.parametrize("radius", [400.0, -150.0])
def test_a_picture_is_taken_to_the_flat_wall_once(radius: float) -> None:
    seen = view(radius)
    drawn, expected = disc(seen, 500)
    rows, columns = np.nonzero(drawn)
    line = np.column_stack([columns, rows])[::500].astype(np.float64)
    asked = replace(target(drawn), original=drawn, line=line)
    (flat,) = flatten_targets(Scene(), (seen,), (asked,))
    for mask in (flat.mask, flat.asked):
        assert (mask != expected).sum() < 0.25 * (drawn != expected).sum()
    assert flat.line is not None and np.abs(flat.line - line).max() > 1.0
    u, v = np.rint(flat.line).astype(int).T  # the line goes with its drawing
    assert expected[v, u].mean() > 0.97
    assert flat.flattened_s is not None and "round" in flat.rule
    (again,) = flatten_targets(Scene(), (seen,), (flat,))
    assert again is flat


def test_a_hardly_round_wall_and_one_switched_off_run_no_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def explode(*_: object, **__: object) -> None:
        raise AssertionError("a picture was bent")

    monkeypatch.setattr("scipy.ndimage.map_coordinates", explode)
    drawn = target(disc(view(400.0), 60)[0])
    assert flatten_targets(Scene(), (view(None),), (drawn,))[0] is drawn
    assert flatten_targets(Scene(), (view(1e6),), (drawn,))[0] is drawn
    off = Scene(effects=Switches(wall=False))
    assert flatten_targets(off, (view(400.0),), (drawn,))[0] is drawn
    with pytest.raises(AssertionError, match="bent"):
        flatten_targets(Scene(), (view(400.0),), (drawn,))


@pytest.mark.parametrize(
    ("radius", "keys", "why"),
    [
        (-60.0, {}, "narrower than the picture"),
        (100.0, {"wall_distance_mm": 30.0, "light_distance_mm": 120.0}, "forward beside"),
        (290.0, {}, "is not inside it"),
        (56.0, {"wall_distance_mm": 60.0, "light_distance_mm": 40.0}, "narrower"),
    ],
)
def test_walls_that_cannot_be(radius: float, keys: Any, why: str) -> None:
    with pytest.raises(InputError, match=why):
        require_wall(view(radius, **keys))


def test_a_picture_that_leaves_its_frame_names_its_margin() -> None:
    full = target(np.ones((100, 100), dtype=bool))
    with pytest.raises(InputError, match=r"Leave \d+ px free at both sides and \d+ px above"):
        flatten_targets(Scene(), (view(400.0),), (full,))
    flatten_targets(Scene(), (view(-400.0),), (full,))  # a column takes it inwards


def test_what_goes_with_a_flat_wall_alone_is_refused() -> None:
    round_one = view(-400.0)
    for scene in (
        Scene(views=(round_one,), mount=Mount(kind="wall")),
        Scene(views=(round_one.model_copy(update={"kind": "eye"}),)),
        Scene(views=(round_one,), search={"free_view": True}),
    ):
        with pytest.raises(InputError):
            require_walls(scene)
    require_walls(Scene(views=(round_one,)))
    written = parse_scene(dump_scene(Scene(views=(round_one,))))
    assert written.views[0].wall_radius_mm == -400.0
    with pytest.raises(InputError, match="not 0"):
        parse_scene("[[views]]\nwall_radius_mm = 0.0\n")


@pytest.mark.parametrize("radius", [350.0, -300.0])
def test_how_near_points_come_to_a_round_wall(radius: float) -> None:
    wall = wall_of(view(radius, wall_tilt_deg=10.0, azimuth_deg=40.0))
    points, normals = wall.stand(PLACES)
    for off in (5.0, 0.0, -3.0):
        assert wall.room_mm(points + off * normals) == pytest.approx(off, abs=1e-9)


@pytest.mark.parametrize("radius", [350.0, -300.0, None])
def test_the_drawing_that_is_written_is_that_of_the_wall_itself(radius: float | None) -> None:
    """A line of greys is followed on the flat wall, and its picture is compared on the round one."""
    mask = np.zeros((480, 480), dtype=bool)
    mask[80:400, 60:84] = mask[80:104, 60:420] = True
    line = np.array([[72.0, 92.0], [416.0, 92.0], [72.0, 396.0]])
    drawn = replace(target(mask), line=line)
    (taken,) = flatten_targets(Scene(), [view(radius)], [drawn])
    assert (taken.flattened_s is None) == (radius is None)
    assert (taken.mask != mask).any() == (radius is not None)
    assert (taken.line != line).any() == (radius is not None)
    again = np.asarray(Image.open(io.BytesIO(taken.drawing_png())).convert("L")) < 128
    assert (again == mask).all()
