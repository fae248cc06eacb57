"""Misplacement: a bound of how far shadows part that holds and is close, against moving for real."""

from __future__ import annotations

import numpy as np
import pytest

from examples.parting import bounds_and_truths
from knotfab.effects.base import EffectContext, World
from knotfab.effects.misplacement import MISPLACEMENT, parting_mm
from knotfab.scene.model import Mount, Placing, ResolvedView, Scene

VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)


def placed(**keys: float) -> World:
    return World(placing=Placing(**keys))


@pytest.mark.parametrize(("turns", "bent"), [(True, False), (False, False), (True, True)])
def test_it_bounds_the_truth_and_closely(turns: bool, bent: bool) -> None:
    rng = np.random.default_rng(3)
    scenes = [bounds_and_truths(rng, ways=60, turns=turns, bent=bent) for _ in range(12)]
    pairs = np.array(scenes)
    bounds, truths = pairs[:, :, [0, 1, 2] if turns else [0, 2]].swapaxes(0, 1)
    assert (bounds >= truths).all() and (np.median(bounds / truths, axis=0) <= 1.1).all()
    assert turns or (pairs[:, 0, 1] == 0).all()


def test_it_is_the_rule_of_the_spread() -> None:
    # two far apart heights all over the picture: half of 5 mm times the spread of (W + z) / (L - z)
    flat = np.random.default_rng(0).uniform(-70, 70, (400, 3))
    flat[:, 2] = np.where(np.arange(400) % 2, 30.0, -30.0)
    lamp, turn = parting_mm(VIEW, flat, 0.1, World())[:2]
    assert lamp == pytest.approx(2.5 * (130 / 470 - 70 / 530), rel=0.1)
    assert turn > np.radians(1.0) * 30.0  # and a keystone
    assert parting_mm(VIEW, flat, 0.1, placed(lamp_mm=0.0, turn_deg=0.0)) == (0.0, 0.0, 0.0)


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
    assert parting_mm(near, points, 2.0, placed(lamp_mm=8.0)) == (np.inf,) * 3
    assert parting_mm(VIEW, np.zeros((0, 3)), 2.0, World()) == (0.0, 0.0, 0.0)


def test_a_wall_that_may_lean_is_the_rule_of_similar_triangles() -> None:
    # a flat grid of shadows s: the wall rises by g s, and moves them by -g s (s - l) / H
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(-70, 70, 21)]))
    flat = np.column_stack([x, y, np.zeros_like(x)])
    assert parting_mm(VIEW, flat, 0.1, World()).tilt == 0.0
    s = 1.2 * np.stack([x, y])
    moved = np.tan(np.radians(2.0)) * (s.sum(axis=0) / 2**0.5) * s / 600  # about a diagonal
    left = np.linalg.norm(moved - moved.mean(axis=1)[:, None], axis=0).max()
    assert left <= parting_mm(VIEW, flat, 0.1, placed(tilt_deg=2.0)).tilt <= 1.15 * left


def test_what_hangs_on_the_wall_does_not_turn_against_it() -> None:
    points = np.random.default_rng(1).uniform(-40, 40, (50, 3))
    free, hung = (World.of(Scene(mount=Mount(kind=kind))) for kind in ("none", "wall"))
    assert free.turns and not hung.turns
    assert parting_mm(VIEW, points, 2.0, hung).turn == 0 < parting_mm(VIEW, points, 2.0, free).turn
