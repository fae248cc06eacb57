"""A case of the corpus validated: whether it is rejected, by which check, where, in what time and memory."""

import contextlib
import resource
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.pipeline.strangers import plain_arrays
from knotfab_formats.errors import InputError
from knotfab_validators import Check, Verdict, validate
from knotfab_validators.check import BadFile
from knotfab_validators.files import mesh
from knotfab_validators.geometry.mesh import Mesh
from tests.corpus.case import READ, Broken, Good, Place
from tests.corpus.files import write
from tests.corpus.fuzzed import company
from tests.corpus.hostile import Hostile

NAMED = 5
"""The right place must be among so many of those that a check names, worst first."""

NO_RENDERING = "shadow-render"  # the exact polygons alone decide about shadows


@dataclass(frozen=True)
class Row:
    """What came of one case.

    `meant` is empty for a good one. `right` says whether the meant check rejected the broken case,
    or no required check the good one; `failed` are the required checks that failed. `away_mm` is how far the
    nearest named place is from the fault, None where the fault has no place or none was named.
    """

    name: str
    meant: str
    right: bool
    failed: tuple[str, ...]
    away_mm: float | None
    within_mm: float | None
    said: str
    seconds: float

    @property
    def placed(self) -> bool | None:
        """True if the place was named nearly enough; None where the fault has none."""
        if self.within_mm is None:
            return None
        return self.away_mm is not None and self.away_mm <= self.within_mm


def judge_case(case: Broken | Good, folder: Path, skip: Sequence[str] = (NO_RENDERING,)) -> Row:
    """One case, written to a folder that exists, and validated."""
    part = case.make()
    files = write(part, folder)
    start = time.perf_counter()
    checks: tuple[Check, ...] = ()
    refusal = ""
    try:
        checks = validate_file(files.part, files.knots, files.scene, skip=skip).checks
    except ValueError as error:
        refusal = str(error)
    seconds = time.perf_counter() - start
    bad = [c for c in checks if c.required and c.status != "pass"]
    failed = (READ,) if refusal else tuple(c.name for c in bad if c.status == "fail")
    if isinstance(case, Good):
        said = refusal or "; ".join(f"{c.name} {c.status}: {c.detail}" for c in bad)
        return Row(case.name, "", not said, failed, None, None, said, seconds)
    meant = next((c for c in checks if c.name == case.meant), None)
    right = case.meant in failed and case.says.lower() in refusal.lower()
    if refusal or meant is None:
        said = refusal or f"there is no check {case.meant}"
    else:
        said = f"{meant.status} {meant.measured}: {meant.detail}"
    if case.places is None:
        return Row(case.name, case.meant, right, failed, None, None, said, seconds)
    named = () if meant is None else meant.at[:NAMED]
    away = _distance(named, tuple(case.places(part)))
    return Row(case.name, case.meant, right, failed, away, case.within_mm, said, seconds)


def _distance(named: Sequence[Place], true: Sequence[Place]) -> float | None:
    """The least distance between a named and a true place."""
    if not named or not true:
        return None
    apart = np.array(named)[:, None] - np.array(true)[None]
    return float(np.linalg.norm(apart, axis=2).min())


def validate_file(
    part: Path | None, knots: Path | None, scene: Path | None, **more: Any
) -> Verdict:
    """The verdict of `knotfab validate`, here and now; raises ValueError where a file is refused."""
    with _plain(part) as read:
        return validate(read, knots, scene, **more)


def read_mesh(path: Path, unit: str = "mm", notes: list[str] | None = None) -> Mesh:
    """The mesh of a file of any format that `knotfab validate` reads; raises BadFile."""
    with _plain(path) as read:
        assert read is not None
        return mesh.read_mesh(read, unit, notes)


@contextlib.contextmanager
def _plain(part: Path | None) -> Iterator[Path | None]:
    try:
        with plain_arrays(part) as read:
            yield read
    except InputError as error:
        raise BadFile(f"{error.what}: {error.why}") from error


@dataclass(frozen=True)
class Outcome:
    """What became of one file: pass, fail or refused; or crashed, slow, hungry (then `said` has why)."""

    kind: str
    said: str
    seconds: float
    peak_mb: float


def examine(file: Hostile, folder: Path) -> Outcome:
    """Read one file here and now; the validators measure everything that can be measured on it."""
    if file.reader:
        return _examine_stranger(file, folder)
    files: dict[str, Path | None] = {"part": None, "knots": None, "scene": None}
    if file.among:
        for other in ("part.obj", "knots.json", "scene.toml", "front.png"):
            (folder / other).write_bytes(company()[other])
        files = {"part": folder / "part.obj"}
        files |= {"knots": folder / "knots.json", "scene": folder / "scene.toml"}
    path = folder / file.name
    path.write_bytes(file.content)
    files[{"json": "knots", "toml": "scene"}.get(path.suffix.removeprefix("."), "part")] = path
    _forget_peak()
    start = time.perf_counter()
    try:
        verdict = validate_file(**files, skip={"shadow-render"}, failures=folder / "failures.png")
        kind, said = verdict.status, ""
    except ValueError as error:  # the error that the readers promise
        kind, said = "refused", str(error)
        own = type(error).__module__.startswith("knotfab_validators")  # not one of numpy's
        named = file.among or said.startswith(file.name)
        if "\n" in said or not own or not named or len(said) > 600:
            kind, said = "crashed", f"no clear sentence: {said[:300]}"
    except Exception as error:  # anything else is a crash
        kind, said = "crashed", f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - start
    return Outcome(kind, said, seconds, _peak_mb())


def _examine_stranger(file: Hostile, folder: Path) -> Outcome:
    from tests.corpus.strangers import read_stranger

    _forget_peak()
    start = time.perf_counter()
    try:
        read_stranger(file, folder)
        kind, said = "pass", ""
    except InputError as error:
        kind, said = "refused", str(error)
        if "\n" in said or "Traceback" in said or len(said) > 900 or "mistake" in said:
            kind, said = "crashed", f"no clear sentence: {said[:300]}"
    except Exception as error:  # a command would print a traceback
        kind, said = "crashed", f"{type(error).__name__}: {error}"
    return Outcome(kind, said, time.perf_counter() - start, max(_peak_mb(), _peak_of_copies()))


def _peak_of_copies() -> float:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def _forget_peak() -> None:
    """Let the peak of resident memory start anew, so that it is that of one file."""
    with contextlib.suppress(OSError):  # only Linux has it
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(row.split()[1]) / 1024 for row in lines if row.startswith("VmHWM"))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
