"""A search that watches the clock: how many iterations each phase gets is settled when it begins."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from knotfab.search.phases import Phase
from knotfab.search.state import SearchState, run_phase

__all__ = ["Pace"]

_TRIED = 6  # iterations by which a phase is timed before it begins; they are taken back
_LEAST = (20, 16, 12)  # iterations of the phases, that a verified part needs
_MOST = 5.0  # factor of the settings' iterations: more has nothing to gain
_OVERHEAD = 0.5  # a share of an iteration that even a picture of no pixels would cost
_MENDING = 0.4  # the last phase's extra cost, for its closer vertices and repairs, as a share


@dataclass
class Pace:
    """Iterations of the phases by the seconds that are left.

    A phase is timed by a few iterations that are taken back, and gets its share of what is left by then: so
    the last one, which ends feasible, makes up for what the others took too much. The number of iterations
    alone decides what a phase does: a search that is given the same numbers does the same.

    Args:
        left: seconds that the search may still take, where it ends with so many vertices.
    """

    left: Callable[[int], float]
    iterations: dict[int, int] = field(default_factory=dict)  # keyed by the phase's number

    def fit(self, state: SearchState, phases: Sequence[Phase], number: int) -> Phase:
        """Return the phase of this number with as many iterations as there is time for."""
        each = self._seconds_each(state, phases[number])
        ahead = [
            phase.iterations * each * _cost(phase) / _cost(phases[number])
            for phase in phases[number:]
        ]
        ahead[-1] *= 1.0 + _MENDING
        factor = float(np.clip(self.left(len(state.points)) / sum(ahead), 0.0, _MOST))
        asked = phases[number]
        count = max(_LEAST[number], round(factor * asked.iterations))
        self.iterations[number] = count
        return replace(asked, walk=replace(asked.walk, iterations=count))

    def _seconds_each(self, state: SearchState, phase: Phase) -> float:
        """Return seconds of an iteration of a phase from where the search stands, which is left as it is."""
        spent = []
        # the first loads what is compiled; what every phase does at its beginning falls out of the others
        for count in (1, 1, 1 + _TRIED):
            tried = replace(
                state,
                log=copy.copy(state.log),
                guards=copy.deepcopy(state.guards),
                pose=copy.deepcopy(state.pose),
                balance=copy.deepcopy(state.balance),
                watch=None,
            )
            begun = time.perf_counter()
            run_phase(tried, replace(phase, walk=replace(phase.walk, iterations=count)))
            spent.append(time.perf_counter() - begun)
        return max(spent[2] - spent[1], 0.1 * spent[2]) / _TRIED


def _cost(phase: Phase) -> float:
    """Weigh an iteration against others of the same search: by its pixels, plus a constant."""
    return _OVERHEAD * 256.0**2 + phase.pixels**2
