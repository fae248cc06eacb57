"""Sag and layers: a close bound of how far shadows are shifted, and the piece moved for real."""

from typing import Any

import numpy as np
import pytest
from oracles import bounds_and_truths, cast, shift_bound_and_truth, turn_about
from questions import design_under, view
from reports import verdict_of
from shapely import MultiPolygon, box
from tables import some

from knotfab.effects import shifts as sag
from knotfab.effects.base import Decision, EffectContext, Shadows, World
from knotfab.effects.misplacement import MISPLACEMENT, Steadying, parting_mm
from knotfab.effects.penumbra import blurs_mm
from knotfab.effects.shifts import LAYERS, SAG, allow_sag_mm, measure_sag, shifts_mm
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.report.effects import judge_made, list_effects, list_sags
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.piece import Mount, Printer
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.verdict import Sag
from knotfab_formats.views import Placing, View

T = 2 * np.pi * np.arange(200) / 200
RING = 50 * np.column_stack([np.cos(T), np.sin(T), 0.3 * np.sin(2 * T)])
FLAT = RING * [1, 1, 0]


def test_it_bounds_the_truth_and_closely() -> None:
    rng = np.random.default_rng(5)
    ratios = [np.divide(*shift_bound_and_truth(rng, "sag")) for _ in range(100)]
    assert min(ratios) >= 1.0 and np.median(ratios) <= 1.02


@pytest.mark.parametrize("lamp_mm", [0.0, 4.0, 30.0])
def test_what_may_sag_shifts_no_shadow_by_more_than_an_eighth_and_a_quarter_of_its_blur(
    lamp_mm: float,
) -> None:
    rng = np.random.default_rng(3)
    views = (view(light_diameter_mm=lamp_mm), view(azimuth_deg=35.0))
    most = allow_sag_mm(views, RING, 2.0)
    ways = rng.normal(size=(400, 3))
    ways *= most / np.linalg.norm(ways, axis=1)[:, None]
    worst = 0.0
    for one in views:
        seen = Shadows.from_points(one, RING)
        # an eighth of a strand's shadow at the middle; nearer to the lamp shadows are wider
        wide = 2.0 * 2.0 * one.magnification / 8
        shift = shifts_mm(seen, ways[:, None], 0.0)
        magnified = shifts_mm(seen, 1e-3 * seen.wall.axes[:1, None], 0.0)[0] / 1e-3
        allowed = 4.0 * magnified / 8 + blurs_mm(seen, 2.0) / 4
        assert 0.5 * wide < allowed.min()
        worst = max(worst, float((shift / allowed).max()))
    # the bound is reached by the worst move
    assert 0.95 < worst <= 1.001


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


# Layers: a bound of what half a layer shifts, as the piece lies on the printer's bed.


PX = 180 / 1024


def magnitude(seen: ResolvedView, points: Any, radius: float, up: Any, layer: float = 0.2) -> float:
    world = World(printer=Printer(layer_height_mm=layer))
    return LAYERS.magnitude(EffectContext((seen,), points, radius, 0.25, world, None, up))


def test_it_bounds_the_shift_and_closely() -> None:
    rng = np.random.default_rng(6)
    ratios = [np.divide(*shift_bound_and_truth(rng, "layers")) for _ in range(100)]
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


# Misplacement: a bound of how far shadows part that holds and is close, against moving for real.


VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)


def placed(**keys: float) -> World:
    return World(placing=Placing(**keys))


@pytest.mark.slow
@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize("count", some([6, 12], 2))
def test_misplacement_bounds_the_truth_and_closely(turns: bool, count: int) -> None:
    rng = np.random.default_rng(3)
    scenes = [bounds_and_truths(rng, ways=60, turns=turns) for _ in range(count)]
    pairs = np.array(scenes)
    bounds, truths = pairs[:, :, [0, 1, 2] if turns else [0, 2]].swapaxes(0, 1)
    assert (bounds >= truths).all() and (np.median(bounds / truths, axis=0) <= 1.1).all()
    assert turns or (pairs[:, 0, 1] == 0).all()


def test_it_is_the_rule_of_the_spread() -> None:
    # two far apart heights all over the picture: half of 5 mm times the spread of (W + z) / (L - z)
    flat = np.random.default_rng(0).uniform(-70, 70, (400, 3))
    flat[:, 2] = np.where(np.arange(400) % 2, 30.0, -30.0)
    lamp, turn = parting_mm(Shadows.from_points(VIEW, flat), 0.1, World())[:2]
    assert lamp == pytest.approx(2.5 * (130 / 470 - 70 / 530), rel=0.1)
    assert turn > np.radians(1.0) * 30.0  # and a keystone
    assert parting_mm(Shadows.from_points(VIEW, flat), 0.1, placed(lamp_mm=0.0, turn_deg=0.0)) == (
        0.0,
        0.0,
        0.0,
    )


def test_the_worst_view_counts_and_an_eye_is_one() -> None:
    points = np.random.default_rng(1).uniform(-40, 40, (50, 3))
    eye = VIEW.model_copy(update={"kind": "eye"})
    far = VIEW.model_copy(update={"light_distance_mm": 1e6})

    def magnitude(*views: ResolvedView) -> float:
        return MISPLACEMENT.magnitude(EffectContext(views, points, 2.0, 0.25))

    assert magnitude(eye) == magnitude(VIEW) == magnitude(far, VIEW) > magnitude(far)


def test_what_may_be_moved_into_the_lamp_has_no_bound() -> None:
    near = VIEW.model_copy(update={"light_distance_mm": 45.0})
    points = np.random.default_rng(1).uniform(-40, 40, (50, 3))
    assert parting_mm(Shadows.from_points(near, points), 2.0, placed(lamp_mm=8.0)) == (np.inf,) * 3
    assert parting_mm(Shadows.from_points(VIEW, np.zeros((0, 3))), 2.0, World()) == (0.0, 0.0, 0.0)


def test_a_wall_that_may_lean_is_the_rule_of_similar_triangles() -> None:
    # a flat grid of shadows s: the wall rises by g s, and moves them by -g s (s - l) / H
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(-70, 70, 21)]))
    flat = np.column_stack([x, y, np.zeros_like(x)])
    assert parting_mm(Shadows.from_points(VIEW, flat), 0.1, World()).tilt == 0.0
    s = 1.2 * np.stack([x, y])
    moved = np.tan(np.radians(2.0)) * (s.sum(axis=0) / 2**0.5) * s / 600  # about a diagonal
    left = np.linalg.norm(moved - moved.mean(axis=1)[:, None], axis=0).max()
    assert (
        left
        <= parting_mm(Shadows.from_points(VIEW, flat), 0.1, placed(tilt_deg=2.0)).tilt
        <= 1.15 * left
    )


def test_what_hangs_on_the_wall_does_not_turn_against_it() -> None:
    points = np.random.default_rng(1).uniform(-40, 40, (50, 3))
    free, hung = (World.from_scene(Scene(mount=Mount(kind=kind))) for kind in ("none", "wall"))
    assert free.turns and not hung.turns
    assert (
        parting_mm(Shadows.from_points(VIEW, points), 2.0, hung).turn
        == 0
        < parting_mm(Shadows.from_points(VIEW, points), 2.0, free).turn
    )


@pytest.mark.parametrize(
    ("scene", "loose", "whole"),
    [
        (Scene(), True, False),
        (Scene(mount=Mount(kind="wall")), True, True),
        (Scene(mount=Mount(kind="none")), False, False),
        (Scene(mount=Mount(kind="stand")), False, False),
        (Scene(views=(View(), View(name="side", azimuth_deg=90.0))), False, False),
    ],
    ids=["auto", "wall", "none", "stand", "two views"],
)
def test_loose_pieces_hang_on_the_wall_asked_for_or_left_open(
    scene: Scene, loose: bool, whole: bool
) -> None:
    world = World.from_scene(scene)
    assert (scene.on_wall(2), scene.on_wall(1)) == (loose, whole)
    assert (world.holding(2).turns, world.holding(1).turns) == (not loose, not whole)
    assert not World(turns=False).holding(2).turns
    assert world.turns != whole and world.holding(2).holding(2) == world.holding(2)


@pytest.mark.parametrize("mount", ["none", "wall"])
@pytest.mark.parametrize("aside", [{}, {"azimuth_deg": 40.0, "elevation_deg": 20.0}])
def test_the_loss_to_be_expected_is_that_of_moving_for_real(mount: str, aside: dict) -> None:
    view = VIEW.model_copy(update=aside)
    world = World.from_scene(
        Scene(mount=Mount(kind=mount), placing=Placing(lamp_mm=2.0, turn_deg=0.5))
    )
    side, t = 90.0, np.linspace(0, 2 * np.pi, 90, endpoint=False)
    square = MultiPolygon([box(-side / 2, -side / 2, side / 2, side / 2)])
    axes, camera = view_axes(view), camera_of(view, 1, 1)
    asks = Steadying(Decision(MISPLACEMENT, 2.0, 1.0), view, axes, square, world)
    losses = []
    for share in (0.3, 1.0):
        z = share * 30 * np.sin(5 * t + 1)
        points = np.column_stack([45 * np.cos(t) + 12 * np.cos(3 * t), 40 * np.sin(t), z])
        losses.append(asks.lost(points))
        turned = points @ axes
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) @ axes
        was, moved = cast(turned, camera.eye, camera), []
        for way in axes:
            moved.append(cast(turned, camera.eye + 2.0 * way, camera))
            if world.turns:
                by = turn_about(way, np.radians(0.5))
                moved.append(cast(middle + (turned - middle) @ by.T, camera.eye, camera))
        one, *others = ((s - s.mean(axis=0)) @ [1, 1j] for s in (was, *moved))
        left = [s - np.vdot(one, s) / np.vdot(one, one) * one for s in others]
        parted = np.sqrt((np.abs(left) ** 2).sum() / len(t)) / view.magnification
        # the move changes a share of the square on both sides of its outline
        lost = parted / np.sqrt(np.pi) * 4 / side
        assert losses[-1] == pytest.approx(lost / (1 + lost / 2), rel=0.03)
    assert losses[0] < 0.7 * losses[1]
    assert asks.cost([points]) == pytest.approx(0.5 * losses[1]) and asks.decision.calls == 1
