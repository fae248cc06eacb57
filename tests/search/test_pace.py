"""Iterations by the clock: the last phase makes up for the others, and timing leaves no trace."""

import numpy as np
import pytest
from questions import ask_heart

from knotfab.problem import Start
from knotfab.search import pace as module
from knotfab.search.pace import Pace
from knotfab.search.phases import three_phases
from knotfab.search.state import SearchState, begin
from knotfab_formats.search import PRESETS

SETTINGS = PRESETS["draft"].model_copy(update={"coarse_px": 48, "fine_px": 64})
PHASES = three_phases(SETTINGS)


@pytest.fixture(scope="module")
def state() -> SearchState:
    turn = np.linspace(0, 2 * np.pi, 121)[:-1]
    ring = 30.0 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    return begin(ask_heart(), Start((ring,), "a circle"), 2.5, SETTINGS)


@pytest.mark.slow
def test_timing_a_phase_leaves_the_search_where_it_was(state: SearchState) -> None:
    points, calls = state.points.copy(), {n: g.calls for n, g in state.guards.items()}
    steps = state.log.accepted
    for number in range(3):
        Pace(lambda _: 1.0).fit(state, PHASES, number)
    np.testing.assert_array_equal(state.points, points)
    assert {n: g.calls for n, g in state.guards.items()} == calls and state.log.accepted == steps


@pytest.mark.slow
def test_the_last_phase_gets_what_the_others_left(
    state: SearchState, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock is played: the first phases cost half as much again as was timed."""
    monkeypatch.setattr(Pace, "_seconds_each", lambda *_: 0.02)
    clock = [6.0]
    pace = Pace(lambda vertices: clock[0])
    for number, dearer in enumerate((1.5, 1.5, 1.0)):
        before = clock[0]
        fitted = pace.fit(state, PHASES, number)
        assert pace.iterations[number] == fitted.iterations
        assert fitted.walk.rate == PHASES[number].walk.rate
        clock[0] -= dearer * 0.02 * fitted.iterations
    kept = module._MENDING / (1.0 + module._MENDING)  # for repairs
    assert clock[0] == pytest.approx(kept * before, abs=0.02)


@pytest.mark.parametrize(("left", "bound"), [(-5.0, "least"), (1e6, "most")])
def test_there_is_a_least_and_a_most(
    left: float, bound: str, state: SearchState, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pace, "_seconds_each", lambda *_: 0.02)
    pace = Pace(lambda _: left)
    for number, phase in enumerate(PHASES):
        count = pace.fit(state, PHASES, number).iterations
        most = round(module._MOST * phase.iterations)
        assert count == (module._LEAST[number] if bound == "least" else most)
