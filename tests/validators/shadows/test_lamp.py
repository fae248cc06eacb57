"""The shadow of a lamp with a size: centred points, straight edges where they belong, ghosts of arrays."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from validator_parts import CURVE, PIXELS, PlainView, box_mesh, geometry, needs_rendering, tube

from knotfab_formats.verdict import Move
from knotfab_formats.views import Placing, Switches
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import WorkingFrame
from knotfab_validators.shadows.lamp import (
    RINGS,
    SoftShadow,
    averages_lamp,
    blur_px,
    lamp_points,
    lamp_size,
    measure_penumbra,
)
from knotfab_validators.shadows.misplacement import (
    fit_likeness,
    layer_shift_px,
    layered_mask,
    measure_layers,
    measure_misplacement,
    parting_px,
    shows_layers,
    simulates_misplacement,
)
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

SLAB = box_mesh((50.0, 50.0, 0.02))


@dataclass(frozen=True)
class Lamp:
    kind: str = "shadow"
    light_shape: str = "disc"
    light_diameter_mm: float = 5.0
    light_width_mm: float = 0.0
    light_height_mm: float = 0.0
    light_leds: tuple[int, int] = (1, 1)


def average(lamp: Lamp, part: Mesh = SLAB) -> SoftShadow:
    """The average of the slab's soft shadow, whose picture is its sharp shadow, 60 mm wide."""
    seen = geometry()
    frame = WorkingFrame(PIXELS, PIXELS, 0, 0)
    with SilhouetteRenderer(part.vertices, part.faces) as renderer:
        sharp = renderer.render(seen)
        return measure_penumbra(renderer, part.vertices, seen, sharp, sharp, frame, lamp, 0.25)


@pytest.mark.parametrize(
    ("lamp", "second"),
    [
        (Lamp(light_diameter_mm=8.0), (4.0, 4.0)),  # a disc's is r² / 4
        (Lamp(light_shape="ball", light_diameter_mm=8.0), (4.0, 4.0)),
        (Lamp(light_shape="rectangle", light_width_mm=12.0, light_height_mm=6.0), (12.0, 3.0)),
    ],
)
@pytest.mark.parametrize("blur", [3.0, 30.0])
def test_points_are_odd_centred_and_spread_evenly(
    lamp: Lamp, second: tuple[float, float], blur: float
) -> None:
    points = lamp_points(lamp, blur, 0.25)
    assert len(points) % 2 == 1 and (len(points) >= 101) == (blur > 10)
    mirrored = {tuple(p) for p in np.round(-points, 9) + 0.0}
    assert {tuple(p) for p in np.round(points, 9) + 0.0} == mirrored and (0.0, 0.0) in mirrored
    assert np.linalg.norm(points, axis=1).max() <= lamp_size(lamp) / 2
    assert (points**2).mean(axis=0) == pytest.approx(second, rel=0.07)


def test_fewer_where_the_accuracy_is_coarse_and_always_odd() -> None:
    assert [len(lamp_points(Lamp(), blur, 0.5)) for blur in (3.0, 30.0)] == [7, 101]
    assert all(1 + sum(rings) == count for count, rings in RINGS.items())


def test_an_array_is_sampled_led_by_led() -> None:
    leds = Lamp("shadow", "leds", 2.0, 30.0, 10.0, (3, 2))
    points = lamp_points(leds, 30.0, 0.25)
    assert lamp_size(leds) == pytest.approx(2.0 + np.hypot(30, 10))
    middles = [(x, y) for x in (-15, 0, 15) for y in (-5, 5)]
    near = [np.linalg.norm(points - m, axis=1) <= 1.0 for m in middles]
    assert {int(n.sum()) for n in near} == {len(points) // 6}


def test_of_a_large_array_each_led_is_a_point_of_its_own_disc() -> None:
    for columns, each in ((10, 7), (11, 1)):
        leds = Lamp("shadow", "leds", 2.0, 30.0, 10.0, (columns, 10))
        assert len(lamp_points(leds, 30.0, 0.25)) == columns * 10 * each
    for columns, rows in ((20, 20), (13, 11)):
        lamp = Lamp("shadow", "leds", 2.0, 60.0, 40.0, (columns, rows))
        small = replace(lamp, light_diameter_mm=0.0)
        points, middles = lamp_points(lamp, 30.0, 0.25), lamp_points(small, 30.0, 0.25)
        spots = points - middles
        assert np.linalg.norm(spots, axis=1).max() <= 1.0
        assert points == pytest.approx(-points[::-1])
        # as bright as discs of that size wherever one looks: a quarter of their radius squared each way
        quarters = np.array_split(spots, 4)
        for part in quarters:
            assert (part**2).mean(axis=0) == pytest.approx(0.25, rel=0.15)
            assert np.abs(part.mean(axis=0)).max() < 0.12
    assert parse_scene({"views": [{"light_leds": [20, 20]}]}).views[0].light_leds == (20, 20)


@needs_rendering
def test_the_half_light_line_is_the_sharp_one() -> None:
    found = average(Lamp(light_diameter_mm=30.0))
    assert found.found.samples == 101 and found.found.iou > 0.995  # corners are rounded
    blur = 30.0 * 100.0 / 500.0  # mm: on a wall 100 mm behind, of a lamp 500 mm before
    assert found.found.widest_px == pytest.approx(blur * PIXELS / 120.0, rel=1e-2)
    # the share is 0.212 of the blur along the outline of 4 x 60 mm, over the frame
    assert found.found.brightness_error == pytest.approx(
        4 / (3 * np.pi) / 2 * blur * 240 / 120**2, rel=0.03
    )
    assert found.found.hard_error == 0.0  # the picture is the sharp shadow
    row = found.soft[PIXELS // 2]
    assert row[PIXELS // 2] == 1.0 and row[5] == 0.0
    falling = row[PIXELS // 2 :]
    assert (np.diff(falling) <= 0).all()
    # the middle half of the blur holds 61 % of the light: the area of a disc between two chords
    middle = int(((falling > 0.195) & (falling < 0.805)).sum())
    assert middle == pytest.approx(found.found.widest_px / 2, abs=1.0)


@needs_rendering
def test_two_leds_throw_a_shadow_each() -> None:
    pair = Lamp("shadow", "leds", 1.0, 60.0, 0.0, (2, 1))  # ghosts 12 mm apart
    found = average(pair)
    row = found.soft[PIXELS // 2]
    half = np.isclose(row, 0.5)
    assert half.sum() == pytest.approx(2 * 12.0 * PIXELS / 120.0, abs=6)
    assert np.isclose(row, 1.0).sum() == pytest.approx((60 - 12) * PIXELS / 120.0, abs=4)


@needs_rendering
def test_a_rectangle_blurs_more_along_its_longer_side() -> None:
    found = average(Lamp("shadow", "rectangle", 5.0, 40.0, 10.0))
    middle = PIXELS // 2
    across, along = (
        ((line > 0) & (line < 1)).sum() for line in (found.soft[middle], found.soft[:, middle])
    )
    assert across == pytest.approx(4 * along, rel=0.15)


def test_a_lamp_is_averaged_over_where_the_scene_calls_for_it() -> None:
    seen, vertices = geometry(), SLAB.vertices
    wide, narrow = Lamp(light_diameter_mm=20.0), Lamp(light_diameter_mm=0.4)
    assert blur_px(vertices, seen, 20.0) > 1.0 > blur_px(vertices, seen, 0.4) > 0

    def averages(lamp: Lamp, word: str = "auto", tolerance: float = 0.25) -> bool:
        return averages_lamp(Switches(penumbra=word), vertices, seen, lamp, tolerance)

    assert averages(wide) and not averages(narrow)
    assert averages(narrow, True) and not averages(wide, False)
    assert averages(narrow, tolerance=0.01)
    assert not averages(Lamp(kind="eye"), True) and not averages(Lamp(light_diameter_mm=0.0), True)


def test_the_blur_of_a_tilted_wall_is_that_of_its_plane() -> None:
    """At the same distances the blur is 1/cos² wider where the rays come in at a slant."""
    flat, tilted = (
        view_geometry(PlainView(wall_tilt_deg=t, frame_width_mm=120.0), PIXELS, PIXELS)
        for t in (0.0, 30.0)
    )
    there = np.zeros((1, 3))
    ratio = blur_px(there, tilted, 1e-3) / blur_px(there, flat, 1e-3)
    assert ratio == pytest.approx(1 / np.cos(np.pi / 6), rel=1e-6)


@pytest.mark.parametrize(
    "keys",
    [{"light_shape": "star"}, {"light_leds": [0, 1]}, {"light_leds": [3]}, {"light_leds": 5},
     {"light_leds": [21, 20]},
     {"light_width_mm": -1.0}],
)  # fmt: skip
def test_a_lamp_that_cannot_be_is_refused(keys: dict[str, Any]) -> None:
    with pytest.raises(BadFile, match=next(iter(keys))):
        parse_scene({"views": [keys]})
    with pytest.raises(BadFile, match="penumbra"):
        parse_scene({"effects": {"penumbra": "perhaps"}})


# Lamp and piece moved for real: what a shift, scale and turn forgive, and what parts.


OFF = Placing(lamp_mm=20.0, turn_deg=3.0)


def plates(apart_mm: float) -> Mesh:
    """Two plates beside each other, one so much nearer to the light."""
    first, second = box_mesh((20.0, 40.0, 0.1)), box_mesh((20.0, 40.0, 0.1))
    vertices = np.concatenate(
        [first.vertices + [-20, 0, -apart_mm / 2], second.vertices + [20, 0, apart_mm / 2]]
    )
    return Mesh(vertices, np.concatenate([first.faces, second.faces + len(first.vertices)]))


def test_a_flat_piece_merely_moves_and_a_deep_one_parts() -> None:
    seen, flat, deep = geometry(), plates(0.0).vertices, plates(60.0).vertices
    middle = np.zeros(3)
    lamp = Placing(lamp_mm=10.0, turn_deg=0.0)
    assert parting_px(flat, middle, seen, lamp) < 0.05
    # these are both halves of the spread of 10 (W + z) / (L - z), up and down, in pixels of half a millimetre
    spread = 10.0 * (130 / 470 - 70 / 530)
    up = replace(seen, light=seen.light + 10.0 * seen.up)
    left = fit_likeness(deep, seen, up).left_mm
    assert 0.4 * spread < left <= 0.55 * spread
    assert parting_px(deep, middle, seen, lamp) >= left / seen.pixel_mm
    assert parting_px(deep, middle, seen, Placing(lamp_mm=0.0, turn_deg=0.0)) == 0.0


def test_a_likeness_is_the_one_that_was_made() -> None:
    """A flat piece under a lamp that is nearer: its shadow grows, and nothing else."""
    seen, flat = geometry(), plates(0.0).vertices * [1, 1, 0]
    nearer = replace(seen, light=seen.light - 50.0 * seen.axis)
    found = fit_likeness(flat, seen, nearer)
    assert found.left_mm < 1e-9
    assert found.turn == pytest.approx(np.eye(2) * (550 / 450 / (600 / 500) - 1), abs=1e-12)
    moved = found.move(nearer)
    # the same points of the piece are on the same pixels
    assert moved.project(flat)[0] == pytest.approx(seen.project(flat)[0], abs=1e-9)


@needs_rendering
@pytest.mark.parametrize("apart", [0.0, 60.0])
def test_moved_for_real_raw_and_fitted(apart: float) -> None:
    part, seen = plates(apart), geometry()
    with SilhouetteRenderer(part.vertices, part.faces) as renderer:
        target = renderer.render(seen)
        found = measure_misplacement(
            renderer, part.vertices, np.zeros(3), seen, target, OFF, parting=2.0
        )
    assert found.samples == 13 and found.iou == 1.0
    sideways = found.lamp_iou["right"]
    assert sideways.raw < 0.9  # 4 mm of plates 24 mm wide
    like_a_wheel = found.turn_iou["axis"]
    assert like_a_wheel.fitted > 0.97 > like_a_wheel.raw
    if apart == 0.0:
        assert all(way.fitted > 0.97 for way in found.lamp_iou.values())
    else:
        # one plate's shadow moves by 2.6 mm, the other's by 5.5: along both, nothing brings them together
        assert sideways.raw < found.worst.fitted < 0.95
        worst = found.worst
        assert getattr(found, f"{worst.of}_iou")[worst.way] == Move(worst.raw, worst.fitted)
    still = {way.fitted for of in ("lamp", "turn") for way in getattr(found, f"{of}_iou").values()}
    assert found.worst.fitted == min(still)


@needs_rendering
def test_what_nobody_misplaces_is_not_moved() -> None:
    part, seen = plates(20.0), geometry()
    with SilhouetteRenderer(part.vertices, part.faces) as renderer:
        target = renderer.render(seen)
        found = measure_misplacement(
            renderer,
            part.vertices,
            np.zeros(3),
            seen,
            target,
            Placing(lamp_mm=0.0, turn_deg=0.0),
            parting=2.0,
            turns=False,
        )
        framed = np.zeros_like(target)
        framed[:, : PIXELS // 2] = True  # where one of both plates shows
        half = measure_misplacement(
            renderer,
            part.vertices,
            np.zeros(3),
            seen,
            target & framed,
            OFF,
            parting=2.0,
            within=framed,
        )
        assert half.iou == 1.0
    assert found.samples == 1 and found.worst is None and found.turn_iou is None


def test_it_is_measured_where_the_scene_calls_for_it() -> None:
    assert simulates_misplacement(Switches(), 1.1) and not simulates_misplacement(Switches(), 0.9)
    assert simulates_misplacement(Switches(misplacement=True), 0.0)
    assert not simulates_misplacement(Switches(misplacement=False), 99.0)
    assert parse_scene({"placing": {"lamp_mm": 2.0}}).placing == Placing(lamp_mm=2.0, turn_deg=1.0)
    for keys in ({"lamp_mm": -1.0}, {"turn_deg": 11.0}):
        with pytest.raises(BadFile, match=next(iter(keys))):
            parse_scene({"placing": keys})


# Slices of a printed part: against points along each ray, and against the part itself.


PIXELS_LAYERS = 40


def geometry_layers(pixels: int = PIXELS_LAYERS, elevation: float = 0.0) -> ViewGeometry:
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
    seen = geometry_layers(elevation=elevation)
    found = layered_mask(part, seen, layer)
    v, u = np.mgrid[:PIXELS_LAYERS, :PIXELS_LAYERS]
    spots = seen.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    # these are shares of the way from the wall to the light
    share = np.linspace(0.08, 0.28, 1000)[None, :, None]
    points = spots[:, None] + share * (seen.light - spots[:, None])
    points[..., 2] = (np.floor(points[..., 2] / layer) + 0.5) * layer
    inside = (abs(points @ matrix) < [20.0, 15.0, 10.0]).all(axis=2).any(axis=1)
    off = found != inside.reshape(PIXELS_LAYERS, PIXELS_LAYERS)
    assert found.sum() > 100 and off.sum() <= 0.02 * found.sum()  # rays between two points


def test_thin_layers_are_the_part_and_thick_ones_are_not() -> None:
    curve = Mesh(*tube(CURVE, 3.0))
    view = geometry_layers(240, elevation=35.0)
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
    assert not layered_mask(plate, geometry_layers(), 0.5).any()
    assert (
        layer_shift_px(plate.vertices[plate.vertices[:, 2] < -101], geometry_layers(), 0.5) == 0.0
    )


def test_it_is_looked_at_where_the_scene_calls_for_it() -> None:
    assert shows_layers(Switches(), 0.51) and not shows_layers(Switches(), 0.49)
    assert shows_layers(Switches(layers=True), 0.0) and not shows_layers(
        Switches(layers=False), 9.0
    )
