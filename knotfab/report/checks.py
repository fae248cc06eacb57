"""The one list of check names, and how checks are shown."""

from __future__ import annotations

from collections.abc import Iterable

from knotfab_formats.verdict import (
    FILES,
    HELD,
    KNOTS,
    MESH,
    PLATES,
    PRINTING,
    SHADOWS,
    TABLE,
    TUBE,
    UPRIGHT,
    Check,
    Verdict,
)

# names that `--skip` knows: the validators' checks, the rendering that some of them use, the slicer
_OF_PRINT = (*HELD, *PRINTING, *UPRIGHT, *PLATES, *TABLE)
CHECKS = ("shadow-render", "slicer", *SHADOWS, *KNOTS, *MESH, *FILES, *TUBE, *_OF_PRINT)


def place_of(name: str) -> int:
    """Return where the check of this name stands in a report: as in `CHECKS`, and others after these."""
    return CHECKS.index(name) if name in CHECKS else len(CHECKS)


_TALLIED = {"pass": "passed", "fail": "failed", "warn": "not required and not met"}
_TALLIED |= {"skipped": "skipped", "info": "for information"}
_FEW = 4  # checks that are named


def mark_of(check: Check) -> str:
    """Return the mark of a check: its status, but "warn" where one fails that is not required."""
    fails = check.status == "fail" and not check.required
    return "warn" if fails else check.status


def tally_checks(checks: Iterable[Check]) -> str:
    """Say how many passed, and which did not: "35 passed, 1 skipped: slicer"."""
    names: dict[str, list[str]] = {}
    for check in checks:
        names.setdefault(mark_of(check), []).append(check.name)
    told = []
    for mark, word in _TALLIED.items():
        if found := names.get(mark, []):
            which = f": {', '.join(found)}" if mark != "pass" and len(found) <= _FEW else ""
            told.append(f"{len(found)} {word}{which}")
    return ", ".join(told)


def verdict_without_part(why: str) -> Verdict:
    """Return the verdict on a piece of which no part could be made."""
    return Verdict(
        status="fail",
        exit_code=1,
        conclusion="",
        size_mm=None,
        notes=(),
        checks=(Check("part", "fail", True, None, None, "", why),),
        views=(),
        colours=None,
        picture=None,
        seconds={},
    )
