"""The doctor: finds what is there, names what is not, and survives what crashes."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Sequence
from pathlib import Path

import pytest

import knotfab
import knotfab_validators
from knotfab.apps import doctor
from knotfab.apps.doctor import Finding, examine
from knotfab.pipeline import verifier


def by_name(findings: list[Finding]) -> dict[str, Finding]:
    return {finding.name: finding for finding in findings}


@pytest.mark.slow
def test_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every library is looked for, the quick ones are imported too; builds import the others."""
    asked, real = list[str](), doctor._import_errors

    def import_errors(modules: Sequence[str]) -> dict[str, str]:
        asked.extend(modules)
        return real([name for name in modules if name in ("numpy", "manifold3d", "lib3mf", "igl")])

    monkeypatch.setattr(doctor, "_import_errors", import_errors)
    findings = examine()
    assert asked == [module for _, module in doctor.LIBRARIES]
    found = by_name(findings)
    assert len(found) == len(findings)
    for name in ("python", "torch", "numpy", "manifold3d", "lib3mf", "cadquery", "libigl"):
        assert found[name].status == "ok", found[name]
    assert "threads" in found["torch"].detail
    for finding in findings:
        assert finding.detail
        assert finding.status == "ok" or finding.remedy, finding


@pytest.mark.study
@pytest.mark.timeout(900)  # everything is compiled anew
def test_what_is_compiled_later_is_named(tmp_path: Path) -> None:
    """Loops of lattices, hulls, bending, supports and free depths are left to the builds that need them."""
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    call = [sys.executable, "-m", "knotfab", "doctor", "--compile"]
    subprocess.run(call, env=env, check=True, capture_output=True)
    kept = {path.name.rpartition("-")[0] for path in tmp_path.rglob("*.nbi")}
    every = {
        f"{path.stem}.{name}"
        for package in (knotfab, knotfab_validators)
        for path in Path(package.__path__[0]).rglob("*.py")
        for name in re.findall(r"^@compiled\ndef (\w+)", path.read_text("utf-8"), re.MULTILINE)
    }
    later = {"grow", "hull", "bend", "lattice", "overhang", "profiles"}
    assert kept and {loop.partition(".")[0] for loop in every - kept} <= later | {"kernels"}
    assert {"kernels.look_up", "kernels.closest_parameters"} >= {
        loop for loop in every - kept if loop.startswith("kernels.")
    }


@pytest.mark.slow
def test_validators_that_do_not_start_are_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifier, "_MODULE", "no_such_validators")
    monkeypatch.setattr(doctor, "run_loops", lambda **_: None)
    found = doctor.compile_loops()
    assert found.status == "warning" and found.remedy
    assert "not the validators'" in found.detail and "no_such_validators" in found.detail


def test_a_library_that_is_missing_or_broken_has_its_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gone = doctor._look_for("no-such-library", "shapely")
    remedy = "pip install no-such-library"
    assert gone == Finding("no-such-library", "missing", "not installed", remedy)
    with monkeypatch.context() as without:
        without.setenv("KNOTFAB_NO_RENDERING", "1")
        found = doctor._rendering()
        assert (found.status, found.remedy) == ("missing", "apt-get install libegl1 libgl1")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert doctor._look_for("shapely", "shapely").status == "missing"
    assert doctor._rendering().remedy == "pip install pyvista"
    assert doctor._fonts().remedy == "pip install matplotlib"
    assert doctor._torch().status == "missing"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "ended by signal 11"),
        ("raise ImportError('no such library')", "ImportError: no such library"),
        ("import sys; sys.exit(7)", "exit code 7"),
        ("import time; time.sleep(60)", "no answer in 0.5 s"),
    ],
)
@pytest.mark.slow
def test_a_child_that_dies_is_a_finding_not_a_crash(
    monkeypatch: pytest.MonkeyPatch, code: str, said: str
) -> None:
    monkeypatch.setattr(doctor, "TORCH_CHILD", code)
    if "sleep" in code:
        monkeypatch.setattr(doctor, "CHILD_TIMEOUT_S", 0.5)
    finding = doctor._torch()
    assert finding.status == "warning" and finding.detail == said and finding.remedy


def test_libraries_that_break_on_import(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One raises, one kills the process: both are named, and those behind them are still tried."""
    (tmp_path / "raising.py").write_text("raise OSError('libGL.so.1: cannot open')")
    (tmp_path / "killing.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert doctor._import_errors(["json", "raising", "killing", "csv", "raising"]) == {
        "raising": "OSError: libGL.so.1: cannot open",
        "killing": "ended by signal 11",
    }
    monkeypatch.setattr(doctor, "_import_errors", lambda modules: {"scipy": "it broke"})
    numpy, scipy = doctor._libraries([("numpy", "numpy"), ("scipy", "scipy")])
    assert numpy.status == "ok" and scipy.status == "missing" and "it broke" in scipy.detail


@pytest.mark.parametrize("memory", [None, 1.0])
def test_scarce_things_are_warnings(monkeypatch: pytest.MonkeyPatch, memory: float | None) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 10**9, 10**6))
    monkeypatch.setattr(shutil, "which", lambda name, path=None: None)
    monkeypatch.setattr(doctor, "measure_memory_gb", lambda: memory)
    monkeypatch.setattr(doctor, "count_cores", lambda: 1)
    monkeypatch.setattr(doctor, "GLYPH_FONTS", ("NoSuchFont.ttf",))
    found = [*doctor._machine(), doctor._slicer(), doctor._fonts()]
    assert {one.name for one in found} >= {"cores", "memory", "disk"}
    assert all(one.status == "warning" and one.remedy for one in found)


@pytest.mark.parametrize(
    ("script", "status", "detail"),
    [
        ("echo 'PrusaSlicer-2.5.0+UNKNOWN based on Slic3r'", "ok", ", PrusaSlicer-2.5.0"),
        ("echo 'something else'", "ok", "prusa-slicer"),
        ("echo 'no libGL.so.1' >&2; exit 127", "warning", "no libGL.so.1"),
        ("kill -SEGV $$", "warning", "signal 11"),
        (b"\x7fELF", "warning", ""),
    ],
)
def test_the_slicer_is_asked_for_its_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str | bytes, status: str, detail: str
) -> None:
    program = tmp_path / "prusa-slicer"
    text = script if isinstance(script, bytes) else f"#!/bin/sh\n{script}\n".encode()
    program.write_bytes(text)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    found = doctor._slicer()
    assert found.status == status and found.detail.endswith(detail)
    assert bool(found.remedy) == (status == "warning")
