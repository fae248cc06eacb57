"""Sag and layers: a close bound of how far shadows are shifted, and the piece moved for real."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from oracles import shift_bound_and_truth
from questions import design_under, view
from reports import verdict_of

from knotfab.effects import shifts as sag
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.penumbra import blurs_mm
from knotfab.effects.shifts import LAYERS, SAG, allow_sag_mm, measure_sag, shifts_mm
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.report.effects import judge_made, list_effects, list_sags
from knotfab_formats.piece import Printer
from knotfab_formats.scene import ResolvedView
from knotfab_formats.verdict import Sag

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
        wide = (
            2.0 * 2.0 * one.magnification / 8
        )  # of strands in the middle: those before it are wider
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
