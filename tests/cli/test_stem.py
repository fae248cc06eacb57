"""The stem of a batch: each build in a fork of a process that has loaded what it needs."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from knotfab.base.pool import Workers, may_fork
from knotfab.batch.worker import open_builders

pytestmark = pytest.mark.skipif(not may_fork(), reason="processes do not fork here")


@pytest.fixture(scope="module")
def stem() -> Iterator[Workers]:
    with open_builders(1) as pool:
        assert isinstance(pool, Workers)
        yield pool


def ask(stem: Workers, *arguments: str | Path, **environment: str) -> tuple[int, str]:
    asked = {
        "arguments": [str(a) for a in arguments],
        "environment": {**os.environ, **environment},
    }
    answer = stem.answer(asked)
    return answer["code"], answer["said"]


@pytest.mark.slow
def test_each_build_is_one_of_its_own(stem: Workers, tmp_path: Path) -> None:
    """With its exit code, its own words, its own environment, and nothing of the one before."""
    for name in ("one", "other"):
        code, said = ask(stem, "build", tmp_path / f"{name}.png", f"--out={tmp_path / 'out'}")
        assert code == 2 and said.count("\n") == 1 and f"{name}.png" in said
    assert ask(stem, "printers") == (0, "")
    device = ("build", "text:A", f"--out={tmp_path / 'out'}", "--device", "cuda")
    assert ask(stem, *device, CUDA_VISIBLE_DEVICES="")[0] == 3
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_asked_to_end_it_ends_its_build_first(stem: Workers, tmp_path: Path) -> None:
    """The build, as one that is interrupted, which leaves nothing; then the stem."""
    (process,) = stem._processes
    building = stem.submit(ask, stem, "build", "text:A", f"--out={tmp_path}/out")
    patience = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and time.monotonic() < patience:
        time.sleep(0.02)
    assert list(tmp_path.iterdir())  # where it writes until it is done
    process.send_signal(signal.SIGTERM)
    code, said = building.result(60)
    assert code == 130 and "interrupted" in said
    assert process.wait(60) == 0
    assert not list(tmp_path.iterdir())
