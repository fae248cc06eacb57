"""Misplacement: a bound of how far shadows part that holds and is close, against moving for real."""

from __future__ import annotations

import numpy as np
import pytest

from examples.parting import bounds_and_truths
from knotfab.effects.base import EffectContext
from knotfab.effects.misplacement import MISPLACEMENT, parting_mm
from knotfab.scene.model import Placing, ResolvedView

VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)


def test_it_bounds_the_truth_and_closely() -> None:
    rng = np.random.default_rng(3)
    ratios = np.array([np.divide(*bounds_and_truths(rng, ways=60)) for _ in range(20)])
    assert ratios.min() >= 1.0 and (np.median(ratios, axis=0) <= 1.1).all()


def test_it_is_the_rule_of_the_spread() -> None:
    # two far apart heights all over the picture: half of 5 mm times the spread of (W + z) / (L - z)
    flat = np.random.default_rng(0).uniform(-70, 70, (400, 3))
    flat[:, 2] = np.where(np.arange(400) % 2, 30.0, -30.0)
    lamp, turn = parting_mm(VIEW, flat, 0.1, Placing())
    assert lamp == pytest.approx(2.5 * (130 / 470 - 70 / 530), rel=0.1)
    assert turn > np.radians(1.0) * 30.0  # and a keystone
    assert parting_mm(VIEW, flat, 0.1, Placing(lamp_mm=0.0, turn_deg=0.0)) == (0.0, 0.0)


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
    assert parting_mm(near, points, 2.0, Placing(lamp_mm=8.0)) == (np.inf, np.inf)
    assert parting_mm(VIEW, np.zeros((0, 3)), 2.0, Placing()) == (0.0, 0.0)
