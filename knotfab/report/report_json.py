"""report.json: all that a build measured, under the contract's keys (schema 1), from plain data."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.base.errors import spelled
from knotfab.report.of_effects import limits_as_effects
from knotfab.verify.checks import exit_code
from knotfab_formats.report import RECORDS, SCHEMA
from knotfab_validators.shadows.recognition import worst_verdict

__all__ = ["assemble", "plain", "write_report_json"]

Record = Mapping[str, Any]


def assemble(
    *,
    views: Sequence[Record],
    checks: Sequence[Record],
    effects: Sequence[Record],
    limits: Sequence[Record],
    timings: Mapping[str, float],
    knots: Sequence[Record],
    print_: Record,
    settings: Record,
    colours: Record | None = None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """The report as plain data: finite numbers, None for a figure that could not be measured.

    `status` follows from the checks, `verdict` from the views; `limits` stand among the effects as well;
    `total` of the timings is their sum unless it is given. `notes` are sentences that a reader must
    not miss. Numpy scalars and arrays become numbers and lists.

    Raises:
        ValueError: a record lacks a key of the contract, or a check has no known status.
    """
    parts: dict[str, Any] = {
        "views": views,
        "checks": checks,
        "effects": effects,
        "limits": limits,
        "timings": timings,
        "knots": knots,
        "print": print_,
        "settings": settings,
    }
    for section, keys in RECORDS.items():
        content = parts[section]
        for record in [content] if isinstance(content, Mapping) else content:
            lacking = [key for key in keys if key not in record]
            if lacking:
                raise ValueError(f"report.json: {section} lacks {', '.join(lacking)}")
    parts["effects"] = [*effects, *limits_as_effects(limits)]
    stages = {name: seconds for name, seconds in timings.items() if name != "total"}
    parts["timings"] = {**stages, "total": timings.get("total", sum(stages.values()))}
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "status": "fail" if exit_code(checks) else "pass",
        "verdict": worst_verdict(views),
        **parts,
    }
    if colours is not None:  # that several lamps mix on one screen
        report["colours"] = colours
    if notes:
        report["notes"] = notes
    content = plain(report)
    assert isinstance(content, dict)
    return content


def write_report_json(path: Path, report: Record) -> None:
    """Write `report` as UTF-8 JSON that any parser reads: no NaN, no infinity."""
    text = json.dumps(plain(report), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def plain(value: Any) -> Any:
    """`value` in JSON's own types; numbers that are not finite become None.

    Raises:
        TypeError: something that has no such form.
    """
    if isinstance(value, str):
        return spelled(value)
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Sequence):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in report.json")
