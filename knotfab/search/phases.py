"""The phases that every search goes through, and the repairs that follow while a limit is violated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab.effects.base import Decision, Limits
from knotfab.geometry.polylines import Rings
from knotfab.render.picture import picture_at
from knotfab.scene.model import View
from knotfab.scene.settings import SearchSettings
from knotfab.search.flow import FlowSettings
from knotfab.search.objective import Objective, Weights

__all__ = ["SETTLE", "Phase", "objective_of", "repair", "three_phases"]

Mask = NDArray[np.bool_]

SETTLE = Weights(clearance=20.0, bend=5.0, region=50.0)  # of the phase that ends feasible
_SHARP = 6.0  # tau times the projected radius, from the end of the fine phase on


@dataclass(frozen=True)
class Phase:
    """One walk of the flow: the picture's longer side, the steps, the weights, and tau from start to end.

    tau is in units of one over the projected tube radius.
    """

    pixels: int
    walk: FlowSettings
    weights: Weights
    tau: tuple[float, float]

    @property
    def iterations(self) -> int:
        return self.walk.iterations


def three_phases(
    settings: SearchSettings,
    softest: float = 1.5,
    rates: tuple[float, float, float] = (0.15, 0.06, 0.02),
) -> tuple[Phase, Phase, Phase]:
    """A coarse picture, a fine one, and one that weighs the limits most.

    Args:
        softest: tau at the start. rates: of the steps, in tube radii, at the start of the coarse
            phase, between the two, and at the end of the fine one.
    """
    start, middle, end = rates
    return (
        Phase(
            settings.coarse_px,
            FlowSettings(iterations=settings.coarse_iterations, rate=start, rate_end=middle),
            Weights(),
            (softest, 3.0),
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.fine_iterations, rate=middle, rate_end=end),
            Weights(clearance=3.0, bend=0.5),
            (3.0, _SHARP),
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.settle_iterations, rate=0.03, rate_end=0.01),
            SETTLE,
            (_SHARP, _SHARP),
        ),
    )


def repair(settings: SearchSettings, number: int) -> Phase:
    """The repair of this number, from 0: the picture gives way, ever less weight on it than on the limits."""
    weights = Weights(image=0.3**number, clearance=40.0, bend=40.0, region=100.0, length=20.0)
    walk = FlowSettings(iterations=60, rate=0.02 if number == 0 else 0.04, rate_end=0.005)
    return Phase(settings.fine_px, walk, weights, (_SHARP, _SHARP))


def objective_of(
    view: View,
    mask: Mask,
    limits: Limits,
    rings: Rings,
    effects: dict[str, Decision],
    phase: Phase,
    settings: SearchSettings,
    device: str,
) -> Objective:
    """The objective of one phase in one view, whose silhouette is `mask` (H, W)."""
    frame, target, pixel_mm = picture_at(
        view, mask, phase.pixels, effects["perspective"].simulated, device
    )
    return Objective(
        frame,
        target,
        rings,
        limits,
        effects,
        phase.weights,
        phase.tau,
        limits.radius * view.magnification / pixel_mm,
        settings.winners_every,
    )
