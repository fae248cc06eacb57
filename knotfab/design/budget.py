"""As many iterations as some seconds allow on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from knotfab.scene.settings import SearchSettings

__all__ = ["scale_to_budget"]


def scale_to_budget(
    seconds: float, settings: SearchSettings, trial: Callable[[SearchSettings], object]
) -> SearchSettings:
    """The settings with their iterations scaled to the seconds, by one short run.

    Args:
        trial: searches by the few iterations that it is given.
    """
    few = settings.model_copy(
        update={
            "coarse_iterations": 6,
            "fine_iterations": 6,
            "settle_iterations": 3,
            "network_iterations": 6,
        }
    )
    begun = time.perf_counter()
    trial(few)
    each = (time.perf_counter() - begun) / few.iterations
    factor = (seconds - 16 * each) / (each * settings.iterations)
    return settings.scaled(float(np.clip(factor, 0.2, 5.0)))
