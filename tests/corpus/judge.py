"""One case of the corpus validated: whether it is rejected, by which check, and where."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotfab_validators import Check
from tests.corpus.case import READ, Broken, Good, Place
from tests.corpus.examine import validate_file
from tests.corpus.files import write

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
