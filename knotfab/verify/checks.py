"""The one rule of what passes, and the one list of check names, for checks in the report's form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from knotfab_formats.checks import FILES, HELD, KNOTS, MESH, PLATES, PRINTING, SHADOWS, TABLE, TUBE
from knotfab_validators.check import Check
from knotfab_validators.verdict import exit_code_of

__all__ = [
    "CHECKS",
    "exit_code",
    "list_unmet",
    "mark_of",
    "place_of",
    "tally_checks",
    "verdict_without_part",
]

Record = dict[str, Any]

STATES = ("pass", "fail", "skipped")
# names that `--skip` knows: the validators' checks, the rendering that some of them use, the slicer
CHECKS = (
    "shadow-render",
    "slicer",
    *SHADOWS,
    *KNOTS,
    *MESH,
    *FILES,
    *TUBE,
    *HELD,
    *PRINTING,
    *PLATES,
    *TABLE,
)


def exit_code(checks: Iterable[Mapping[str, Any]]) -> int:
    """0 where every required check passed, 1 where one failed, else 3 where one could not run.

    Raises:
        ValueError: a check has no known status.
    """
    states = [(bool(check["required"]), str(check["status"])) for check in _list_known(checks)]
    return exit_code_of(states)


def list_unmet(checks: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The required checks that did not pass: a skipped one proves nothing."""
    return [
        check for check in _list_known(checks) if check["required"] and check["status"] != "pass"
    ]


def place_of(check: Mapping[str, Any]) -> int:
    """Return the place of a check in a report: as in `CHECKS`, and others after these."""
    name = str(check["name"])
    return CHECKS.index(name) if name in CHECKS else len(CHECKS)


_TALLIED = {"pass": "passed", "fail": "failed", "warn": "not required and not met"}
_TALLIED |= {"skipped": "skipped", "info": "for information"}
_FEW = 4  # checks that are named


def mark_of(check: Mapping[str, Any]) -> str:
    """Return the mark of a check: its status, but "warn" where one fails that is not required."""
    fails = check["status"] == "fail" and not check["required"]
    return "warn" if fails else str(check["status"])


def tally_checks(checks: Iterable[Mapping[str, Any]]) -> str:
    """Say how many passed, and which did not: "35 passed, 1 skipped: slicer"."""
    names: dict[str, list[str]] = {}
    for check in checks:
        names.setdefault(mark_of(check), []).append(check["name"])
    told = []
    for mark, word in _TALLIED.items():
        if found := names.get(mark, []):
            which = f": {', '.join(found)}" if mark != "pass" and len(found) <= _FEW else ""
            told.append(f"{len(found)} {word}{which}")
    return ", ".join(told)


def verdict_without_part(why: str) -> Record:
    """The verdict on a piece of which no part could be made."""
    part = Check("part", "fail", True, None, None, "", why).to_dict()
    return {"status": "fail", "exit_code": 1, "checks": [part], "views": [], "seconds": {}}


def _list_known(checks: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    found = list(checks)
    for check in found:
        if check["status"] not in STATES:
            raise ValueError(f"check {check['name']!r} has the status {check['status']!r}")
    return found
