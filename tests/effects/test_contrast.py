"""Contrast: what lights the shadow, against light followed ray by ray and the lamp moved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracles import bounce_and_truth, shift_bound_and_truth
from questions import design_under, view
from reports import verdict_of, view_of_report

from knotfab.effects import contrast
from knotfab.effects import shifts as sag
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.contrast import CONTRAST, contrast_of
from knotfab.effects.penumbra import blurs_mm
from knotfab.effects.shifts import LAYERS, SAG, allow_sag_mm, measure_sag, shifts_mm
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.report.effects import (
    judge_made,
    list_contrasts,
    list_effects,
    list_sags,
    tell_contrast,
)
from knotfab.scene.camera import CurvedWall
from knotfab.scene.load import parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material, Printer
from knotfab_formats.scene import ResolvedView
from knotfab_formats.verdict import Contrast, Sag
from knotfab_formats.views import Room
from knotfab_validators.shadows.tube_field import tube_field
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

WHITE = Material(color="#ffffff")
POINTS = np.random.default_rng(0).uniform(-50, 50, (400, 3))


def light(world: World | None = None, **keys: Any) -> Contrast:
    found = contrast_of(Shadows.from_points(view(**keys), POINTS), 2.0, world or World())
    assert found is not None
    return found


@pytest.mark.parametrize(("shape", "power"), [("disc", 4), ("leds", 4), ("ball", 3)])
def test_light_falls_off_by_the_cosine(shape: str, power: int) -> None:
    angle = np.arctan(90 * np.sqrt(2) / 600)
    assert light(light_shape=shape).falloff == pytest.approx(np.cos(angle) ** power)
    # the near side of a tilted wall is lit more
    assert light(light_shape=shape, wall_tilt_deg=30.0).falloff < np.cos(angle) ** power


def test_a_room_gives_back_what_an_integrating_sphere_does() -> None:
    """Photons of a bulb in a sphere, each thrown on by the cosine law until it is swallowed."""
    rng, reflectance, count = np.random.default_rng(1), 0.8, 20000
    bounces = rng.geometric(1 - reflectance, count) - 1  # after the first arrival
    sphere_m2 = 4 * np.pi * 0.6**2  # with the bulb in its middle: its wall is 0.6 m away everywhere
    room = World(room=Room(area_m2=sphere_m2, reflectance=reflectance))
    found = light(room, light_shape="ball")
    assert found.room == pytest.approx(bounces.mean(), rel=0.03)
    white = light(World(room=Room(area_m2=59.0, reflectance=0.8)), light_shape="ball")
    assert 1 / (1 + white.room) == pytest.approx(0.765, abs=0.005)
    flat = light(World(room=Room(area_m2=59.0, reflectance=0.8)))
    assert flat.room == pytest.approx(white.room / 4)


def test_filament_lets_light_through_by_its_chords() -> None:
    x = np.random.default_rng(2).uniform(-2, 2, 100_000)
    through = (0.3 ** (2 * np.sqrt(4 - x**2))).mean()
    found = light(World(material=Material(transmittance_per_mm=0.3)))
    assert found.transmitted == pytest.approx(through, rel=0.02)
    assert found.contrast == pytest.approx(1 - found.transmitted)


def test_a_second_lamp_throws_a_ghost() -> None:
    room = World(room=Room(ambient=0.5, second_lamp_mm=(50.0, 0.0, 500.0), second_lamp_share=0.5))
    found = light(room)
    assert found.ghost_shift_mm == pytest.approx(50.0 * 100 / 500)  # similar triangles
    assert (found.contrast, found.ghost_contrast) == pytest.approx((1 / 2, 0.5 / 2))


def test_a_black_piece_throws_nothing_back() -> None:
    lit = {
        color: light(World(room=Room(reflectance=0.5), material=Material(color=color)))
        for color in ("#000000", "#808080", "#ffffff")
    }
    assert lit["#000000"].bounced == 0.0 < lit["#808080"].bounced < lit["#ffffff"].bounced <= 0.5
    assert lit["#808080"].bounced == pytest.approx(0.216 * lit["#ffffff"].bounced, rel=0.01)
    # a small disc of strands, seen from far below its middle, fills its area over pi h²
    t = np.linspace(0, 60 * np.pi, 4000)
    disc = np.column_stack([t / 60 * np.cos(t), t / 60 * np.sin(t), np.zeros_like(t)])
    long = np.linalg.norm(np.diff(disc, axis=0), axis=1).sum()
    assert thrown_back(disc, 0.05) == pytest.approx(0.1 * long / (np.pi * 100**2), rel=0.06)


def thrown_back(points: np.ndarray, radius: float) -> float:
    """The light that white strands throw back, over what the wall throws at them."""
    found = contrast_of(
        Shadows.from_points(view(), points),
        radius,
        World(room=Room(reflectance=0.5), material=WHITE),
    )
    assert found is not None
    return found.bounced / 0.5


def rod(height: float) -> np.ndarray:
    """So high over the wall, and so long that it has no end."""
    points = np.zeros((4000, 3))
    points[:, 0], points[:, 2] = np.linspace(-6000, 6000, 4000), height - 100
    return points


def test_a_long_rod_throws_back_its_radius_over_its_height() -> None:
    """The share is that of both edges' cosines, seen from below (Howell, factor B-31)."""
    for height, radius in ((80.0, 2.0), (100.0, 10.0), (30.0, 4.0)):
        share = radius / height
        assert share <= thrown_back(rod(height), radius) < 1.08 * share


def test_what_strands_hide_from_each_other_is_thrown_back_once() -> None:
    one, far = rod(60.0), rod(120.0)
    assert thrown_back(np.concatenate([one, far]), 2.0) < 1.1 * thrown_back(one, 2.0)
    beside = far + [0.0, 300.0, 0.0]
    assert thrown_back(np.concatenate([one, beside]), 2.0) > 1.05 * thrown_back(one, 2.0)


@pytest.mark.slow
def test_what_is_thrown_back_is_bounded() -> None:
    rng = np.random.default_rng(3)
    ratios = [np.divide(*bounce_and_truth(rng)) for _ in range(2)]
    assert min(ratios) >= 1 and max(ratios) < 1.3


def test_nothing_beside_the_lamp_and_an_eye_needs_none() -> None:
    found = light()
    assert found.contrast == found.contrast_least == 1.0 and found.ghost_shift_mm is None
    assert contrast_of(Shadows.from_points(view(kind="eye"), POINTS), 2.0, World()) is None
    context = EffectContext((view(kind="eye"),), POINTS, 2.0, 0.25)
    assert CONTRAST.magnitude(context) == 0.0


def test_it_is_told_where_it_is_called_for_and_else_runs_no_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bright, dark = (
        design_under(world, POINTS) for world in (World(room=Room(ambient=0.4)), World())
    )
    (found,) = list_contrasts(bright)
    (said,) = tell_contrast([replace(view_of_report(), contrast=found)])
    assert "the shadow is 71% as dark as can be" in said
    line = next(x for x in list_effects(bright.result, verdict_of()) if x.calls)
    assert (line.name, line.where, line.calls) == ("contrast", ("report",), 1)

    def explode(*_: object) -> None:
        raise AssertionError("contrast was looked at")

    monkeypatch.setattr(contrast, "contrast_of", explode)
    assert list_contrasts(dark) == [None]


def test_a_second_lamp_behind_the_piece_is_refused() -> None:
    assert parse_scene("[room]\nsecond_lamp_mm = [0.0, 0.0, 300.0]\n").room.second_lamp_mm
    for wrong in ("second_lamp_mm = [0.0, 0.0, -50.0]", "ambient = -1.0", "reflectance = 1.0"):
        with pytest.raises(InputError):
            parse_scene(f"[room]\n{wrong}\n")


# Sag: a bound of how far shadows are shifted that holds and is close, and the piece moved for
# real.


T = 2 * np.pi * np.arange(200) / 200
RING = 50 * np.column_stack([np.cos(T), np.sin(T), 0.3 * np.sin(2 * T)])
FLAT = RING * [1, 1, 0]


@pytest.mark.parametrize("bent", [False, True])
def test_it_bounds_the_truth_and_closely(bent: bool) -> None:
    rng = np.random.default_rng(5)
    ratios = [np.divide(*shift_bound_and_truth(rng, "sag", bent=bent)) for _ in range(100)]
    assert min(ratios) >= 1.0 and np.median(ratios) <= (1.05 if bent else 1.02)


@pytest.mark.parametrize("lamp_mm", [0.0, 4.0, 30.0])
@pytest.mark.parametrize("bent", [None, -110.0])
def test_what_may_sag_shifts_no_shadow_by_more_than_an_eighth_and_a_quarter_of_its_blur(
    lamp_mm: float, bent: float | None
) -> None:
    rng = np.random.default_rng(3)
    views = (view(light_diameter_mm=lamp_mm, wall_radius_mm=bent), view(azimuth_deg=35.0))
    most = allow_sag_mm(views, RING, 2.0)
    ways = rng.normal(size=(400, 3))
    ways *= most / np.linalg.norm(ways, axis=1)[:, None]
    worst = 0.0
    for one in views:
        seen = Shadows.from_points(one, RING)
        wide = (
            2.0 * 2.0 * one.magnification / 8
        )  # of strands in the middle: those before it are wider
        shift = shifts_mm(seen, ways[:, None], 0.0)
        magnified = shifts_mm(seen, 1e-3 * seen.wall.axes[:1, None], 0.0)[0] / 1e-3
        allowed = 4.0 * magnified / 8 + blurs_mm(seen, 2.0) / 4
        assert 0.5 * wide < allowed.min()
        worst = max(worst, float((shift / allowed).max()))
    # the bound is reached by the worst move, and what bends on a round wall is of second order
    assert 0.95 < worst <= (1.001 if bent is None else 1.05)


def test_a_thicker_tube_and_a_larger_lamp_may_sag_more() -> None:
    def most(radius: float, lamp_mm: float) -> float:
        return allow_sag_mm((view(light_diameter_mm=lamp_mm),), RING, radius)

    assert most(4.0, 0.0) == pytest.approx(2 * most(2.0, 0.0))
    assert 0.4 < most(2.0, 0.0) < 0.5  # an eighth of 4 mm, less where the light falls aslant
    assert most(2.0, 30.0) > most(2.0, 4.0) > most(2.0, 0.0)


def test_without_a_mount_nothing_sags() -> None:
    assert SAG.magnitude(EffectContext((view(),), RING, 2.0, 0.25)) == 0.0
    moves = np.tile([0.0, -0.2, 0.0], (200, 1))
    sagging = SAG.magnitude(EffectContext((view(),), RING, 2.0, 0.25, moves=moves))
    assert sagging == pytest.approx(0.2 * 600 / (500 - 15 - 2) / (180 / 1024), rel=0.01)


@pytest.mark.slow
def test_the_piece_is_moved_where_it_shows_and_else_runs_no_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mask = np.zeros((180, 180), dtype=bool)
    rings, down = polylines_of_sizes((200,)), np.tile([0.0, -2.0, 0.0], (200, 1))
    found = measure_sag(view(), mask, FLAT, 0 * down, rings, 2.0)
    assert found == Sag(widest_px=0.0, iou=0.0, iou_designed=0.0)
    rows, columns = np.mgrid[:180, :180] - 89.5
    mask |= abs(np.hypot(rows, columns) - 60) < 2.4  # the flat ring's shadow
    made = design_under(World(), FLAT)
    judge_made(made, made.scene, down, None)
    (sagged,) = list_sags(made, down, [mask])
    assert sagged is not None and sagged.iou < sagged.iou_designed - 0.2
    # as far as its shadow goes: 2 mm, 1.2 times larger, of 180 mm on 1024 px
    assert sagged.widest_px == pytest.approx(2.4 / 180 * 1024, rel=0.05)
    lines = {line.name: line for line in list_effects(made.result, verdict_of())}
    line = lines["sag"]
    assert (line.calls, line.where, line.simulated) == (1, ("report",), True)

    def explode(*_: object) -> None:
        raise AssertionError("the piece was moved")

    monkeypatch.setattr(sag, "measure_sag", explode)
    for moves in (0.01 * down, None):
        made = design_under(World(), FLAT)
        judge_made(made, made.scene, moves, None)
        assert list_sags(made, moves, [mask]) == [None]


@pytest.mark.parametrize("radius", [350.0, -110.0])
def test_on_a_round_wall_it_is_the_shadow_there(radius: float) -> None:
    seen, rings = view(wall_radius_mm=radius), polylines_of_sizes((200,))
    there = view_geometry(seen, 1024, 1024)
    # one side sags, where the wall bends most; the picture is the ring as it is designed
    moves = np.outer(np.clip(FLAT[:, 0] - 25, 0, None), [0.0, -0.2, 0.0])

    def cast(points: np.ndarray, where: ViewGeometry) -> np.ndarray:
        return tube_field([points], 2.0, where).mask

    def iou(where: ViewGeometry) -> float:
        was, now = cast(FLAT, where), cast(FLAT + moves, where)
        return float((was & now).sum() / (was | now).sum())

    flat, wall = cast(FLAT, there.flat), CurvedWall.from_view(seen)
    on_flat, on_wall = (
        measure_sag(seen, flat, FLAT, moves, rings, 2.0, w).iou for w in (None, wall)
    )
    assert on_wall == pytest.approx(iou(there), abs=0.0015)
    assert on_flat == pytest.approx(iou(there.flat), abs=0.0015)
    assert radius > 0 or abs(on_wall - on_flat) > 0.008


# Layers: a bound of what half a layer shifts, as the piece lies on the printer's bed.


PX = 180 / 1024


def magnitude(seen: ResolvedView, points: Any, radius: float, up: Any, layer: float = 0.2) -> float:
    world = World(printer=Printer(layer_height_mm=layer))
    return LAYERS.magnitude(EffectContext((seen,), points, radius, 0.25, world, None, up))


@pytest.mark.parametrize("bent", [False, True])
def test_it_bounds_the_shift_and_closely(bent: bool) -> None:
    rng = np.random.default_rng(6)
    ratios = [np.divide(*shift_bound_and_truth(rng, "layers", bent=bent)) for _ in range(100)]
    assert min(ratios) >= 1.0 and np.median(ratios) <= 1.1


def test_no_layers_along_the_printers_axis_or_unprinted() -> None:
    there = np.zeros((1, 3))
    along, across = (
        magnitude(view(), there, 2.0, np.array(up)) for up in ([0, 0, 1.0], [0, 1.0, 0])
    )
    assert along < 0.02 < across
    # the part of the surface that is nearer to the lamp, and the rim
    assert across == pytest.approx(0.1 * 1.2 / PX, rel=0.05)
    assert magnitude(view(), there, 2.0, None) == 0.0
