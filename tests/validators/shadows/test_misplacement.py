"""Lamp and piece moved for real: what a shift, scale and turn forgive, and what parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from region_meshes import box_mesh
from small_views import PIXELS, geometry, needs_rendering

from knotfab_formats.verdict import Move
from knotfab_formats.views import Placing, Switches
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.misplacement import (
    fit_likeness,
    measure_misplacement,
    moves_apart,
    parting_px,
)
from knotfab_validators.shadows.render import SilhouetteRenderer

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
    assert found.lamp_iou_per_mm["right"] == pytest.approx((1 - sideways.raw) / 20.0)
    assert found.turn_iou_per_deg["axis"] == pytest.approx((1 - found.turn_iou["axis"].raw) / 3.0)
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
    assert set(found.lamp_iou_per_mm.values()) == {0.0}


def test_it_is_measured_where_the_scene_calls_for_it() -> None:
    assert moves_apart(Switches(), 1.1) and not moves_apart(Switches(), 0.9)
    assert moves_apart(Switches(misplacement=True), 0.0)
    assert not moves_apart(Switches(misplacement=False), 99.0)
    assert parse_scene({"placing": {"lamp_mm": 2.0}}).placing == Placing(lamp_mm=2.0, turn_deg=1.0)
    for keys in ({"lamp_mm": -1.0}, {"turn_deg": 11.0}):
        with pytest.raises(BadFile, match=next(iter(keys))):
            parse_scene({"placing": keys})
