"""Layers: a bound of what half a layer shifts, as the piece lies on the printer's bed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from examples.parting import cast, directions
from knotfab.effects.base import EffectContext, World
from knotfab.effects.layers import LAYERS
from knotfab.scene.camera import camera_of
from knotfab.scene.model import Printer, ResolvedView

PX = 180 / 1024


def view(**keys: Any) -> ResolvedView:
    frame = {"frame_width_mm": 180.0, "frame_height_mm": 180.0}
    return ResolvedView.model_validate({**frame, **keys})


def magnitude(seen: ResolvedView, points: Any, radius: float, up: Any, layer: float = 0.2) -> float:
    world = World(printer=Printer(layer_height_mm=layer))
    return LAYERS.magnitude(EffectContext((seen,), points, radius, 0.25, world, None, up))


def test_it_bounds_the_shift_and_closely() -> None:
    rng, ratios = np.random.default_rng(6), []
    for _ in range(200):
        distance, wall = rng.uniform(200, 2000), rng.uniform(50, 400)
        seen = view(
            light_distance_mm=distance, wall_distance_mm=wall, wall_tilt_deg=rng.uniform(-30, 30)
        )
        points = rng.uniform(-1, 1, (60, 3)) * [70, 70, min(0.4 * distance, 0.4 * wall) / 2]
        up, layer, radius = (
            directions(50)[rng.integers(50)],
            rng.uniform(0.05, 0.4),
            rng.uniform(1, 4),
        )
        camera = camera_of(seen, 1, 1)
        surface = (points[:, None] + radius * directions(40)).reshape(-1, 3)
        was = cast(surface, camera.eye, camera)
        shifts = [cast(surface + s * layer * up, camera.eye, camera) - was for s in (-0.5, 0.5)]
        truth = np.linalg.norm(shifts, axis=2).max() / PX
        bound = magnitude(seen, points, radius, up, layer)
        assert bound >= truth
        ratios.append(bound / truth)
    assert np.median(ratios) <= 1.1


def test_seen_along_the_printers_axis_nothing_steps_and_unprinted_there_are_no_layers() -> None:
    there = np.zeros((1, 3))
    along, across = (
        magnitude(view(), there, 2.0, np.array(up)) for up in ([0, 0, 1.0], [0, 1.0, 0])
    )
    assert along < 0.02 < across
    # of the surface that is nearer to the lamp, and the rim
    assert across == pytest.approx(0.1 * 1.2 / PX, rel=0.05)
    assert magnitude(view(), there, 2.0, None) == 0.0
