"""States of a search: few, evenly spread, from its first to nearly its last."""

import numpy as np
import pytest

from knotfab.knots import Knot, Knots
from knotfab.search.history import History


@pytest.mark.parametrize("iterations", [0, 1, 7, 8, 9, 100, 1000])
def test_few_states_are_kept_and_evenly_spread(iterations: int) -> None:
    history, made = History(most=8), []

    def knots(k: int) -> Knots:
        made.append(k)
        return Knots((Knot(np.eye(3)),), 1.0 + k)

    for k in range(iterations):
        history(lambda k=k: knots(k), True)
    taken = [round(state.radius_mm - 1.0) for state in history.states]
    assert len(taken) <= 8 and (not iterations or taken[0] == 0)
    assert len(taken) >= min(iterations, 4)
    steps = set(np.diff(taken).tolist())
    assert len(steps) <= 1 and all(iterations - taken[-1] <= step for step in steps)
    assert len(made) <= 8 + 4 * max(1, np.log2(max(iterations, 8) / 8) + 1)
