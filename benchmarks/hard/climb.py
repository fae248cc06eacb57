"""From numbers of order 1 to those of the largest share, by CMA-ES from one random start after another."""

from __future__ import annotations

import time
from dataclasses import dataclass

import cma
import numpy as np

from knotfab.base.arrays import Array

from .worst import Hunt

__all__ = ["Worst", "climb"]

_LEAST, _MOST = 1e-9, 1e9  # of a share: less is nothing, more is as bad
_SPREAD = 0.7  # of the first steps, in units of the numbers' own order


@dataclass(frozen=True)
class Worst:
    """The largest share, its numbers, the cases tried, in how many climbs, and where these began (median)."""

    share: float
    numbers: Array
    cases: int
    climbs: int
    begun: float


def climb(hunt: Hunt, seconds: float, seed: int) -> Worst:
    """Climb from one random start after another."""
    rng = np.random.default_rng(seed)
    end = time.monotonic() + seconds
    best, at, cases = -1.0, np.zeros(hunt.size), 0
    starts: list[float] = []

    def try_all(tried: list[Array]) -> list[float]:
        """Their shares; what is not a number is a fault as large as any."""
        nonlocal best, at, cases
        shares = [share if share < _MOST else _MOST for share in map(hunt.share, tried)]
        cases += len(tried)
        worst = int(np.argmax(shares))
        if shares[worst] > best:
            best, at = shares[worst], np.asarray(tried[worst])
        return shares

    while time.monotonic() < end or not starts:
        start = rng.normal(size=hunt.size)
        starts += try_all([start])
        options = {"seed": int(rng.integers(1, 2**31)), "verbose": -9}
        search = cma.CMAEvolutionStrategy(start, _SPREAD, options)
        while not search.stop() and time.monotonic() < end:
            tried = search.ask()
            search.tell(tried, [-float(np.log10(max(s, _LEAST))) for s in try_all(tried)])
    return Worst(best, at, cases, len(starts), float(np.median(starts)))
