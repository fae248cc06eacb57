"""The process that builds for batch and studio: one build after the other, each with its own end."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from knotfab.apps.batch.worker import open_builders, run_apart
from knotfab.base.pool import Workers


@pytest.fixture(scope="module")
def builder() -> Iterator[Workers]:
    with open_builders(1) as workers:
        yield workers


@pytest.mark.slow
def test_each_build_is_one_of_its_own(builder: Workers, tmp_path: Path) -> None:
    """One process answers several builds, each with its own exit code and words."""
    for name in ("one", "other"):
        call = ["build", str(tmp_path / f"{name}.png"), f"--out={tmp_path / 'out'}"]
        code, said = run_apart(builder, call)
        assert code == 2 and f"{name}.png" in said and "knotfab:" not in said
        (process,) = builder.processes
    assert run_apart(builder, ["printers"]) == (0, "")
    assert builder.processes == [process]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_asked_to_end_it_ends_its_build_and_builds_on(builder: Workers, tmp_path: Path) -> None:
    """The build, as one that is interrupted, which leaves nothing."""
    call = ["build", "text:A", f"--out={tmp_path}/out"]
    building = builder.submit(run_apart, builder, call)
    patience = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and time.monotonic() < patience:
        time.sleep(0.02)
    assert list(tmp_path.iterdir())  # where it writes until it is done
    (process,) = builder.processes
    process.send_signal(signal.SIGTERM)
    code, said = building.result(60)
    assert code == 130 and "interrupted" in said
    assert not list(tmp_path.iterdir())
    assert run_apart(builder, ["printers"]) == (0, "") and builder.processes == [process]
