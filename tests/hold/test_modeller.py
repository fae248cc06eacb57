"""Solids come from a process that is started beside the search, and has gone when the block ends."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from knotfab.base.errors import MachineError
from knotfab.hold import modeller
from knotfab.hold.modeller import keep_modeller, model
from knotfab_fixtures.holders import fit_strip
from knotfab_fixtures.solids import peg


def _children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


@pytest.mark.slow
def test_a_process_of_its_own_makes_the_same_solids() -> None:
    here = peg(40.0, 1.3, 2.1, root_radius_mm=3.0, sink_mm=0.1)
    holes = fit_strip((4.0, 4.1), (0, 1), 3.0, room_mm=9.0)
    with keep_modeller(early=False):
        before = _children()
        for there, expected in (
            (model(peg, 40.0, 1.3, 2.1, root_radius_mm=3.0, sink_mm=np.float64(0.1)), here),
            (model(fit_strip, (4.0, 4.1), (0, 1), 3.0, room_mm=9.0), holes),
        ):
            for array, same in zip(there, expected, strict=True):
                assert array.dtype == same.dtype
                np.testing.assert_array_equal(array, same)
        started = _children() - before
        assert len(started) == 1  # one for both
        with pytest.raises(ValueError, match="every size of a peg"):
            model(peg, -1.0, 1.3, 2.1)
    assert not _children() & started


@pytest.mark.slow
def test_the_maker_loads_no_modeller() -> None:
    script = (
        "import sys\nfrom knotfab.hold.modeller import keep_modeller, model\n"
        "from knotfab_fixtures.solids import peg\n"
        "with keep_modeller(True): model(peg, 9.0, 1.0, 1.0)\n"
        "print([name for name in ('cadquery', 'OCP') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "[]", "")


def test_without_one_it_is_modelled_here() -> None:
    here = model(lambda size: (size * np.eye(3), np.array([[0, 1, 2]])), 2.0)
    np.testing.assert_array_equal(here[0], 2 * np.eye(3))


def test_a_process_that_ends_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modeller, "_MODULE", "no_such_modeller")
    with (
        keep_modeller(early=True),
        pytest.raises(MachineError, match=r"exit code 1: .*no_such_modeller") as told,
    ):
        model(peg, 9.0, 1.0, 1.0)
    assert "--mount none" in str(told.value)


def test_nobody_asks_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process starts where none is asked; and the block ends though it is still loading."""
    before = _children()
    with keep_modeller(early=False):
        assert _children() == before
    with keep_modeller(early=True):
        assert len(_children() - before) == 1
    assert _children() == before
