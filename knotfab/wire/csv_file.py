"""bends.csv: the bending plan as a file, written for a person at a bench and read back for the replay."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np

from knotfab.base.errors import InputError
from knotfab.wire.bends import Bend, BendList

__all__ = ["COLUMNS", "read_bends", "write_bends"]

COLUMNS = (
    "index",
    "distance_mm",
    "feed_mm",
    "rotation_deg",
    "bend_deg",
    "tool_angle_deg",
    "radius_mm",
    "note",
)
_PLACED = ("start_mm", "direction", "normal")


def write_bends(path: Path, bends: BendList, header: dict[str, str]) -> None:
    """Write the rows after lines `# key: value`; lengths and angles have three decimals.

    `header` is for the reader; start, direction and normal of the wire in the scene follow it, so
    that the curve can be rebuilt from this file alone.
    """
    text = io.StringIO()
    for key, value in header.items():
        text.write(f"# {key}: {value}\n")
    for key, vector in zip(_PLACED, (bends.start, bends.direction, bends.normal), strict=True):
        text.write(f"# {key}: {' '.join(f'{x:.9f}' for x in vector)}\n")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for number, b in enumerate(bends.bends, start=1):
        numbers = (
            b.distance_mm,
            b.feed_mm,
            b.rotation_deg,
            b.bend_deg,
            b.tool_angle_deg,
            b.radius_mm,
        )
        rows.writerow([number, *(f"{round(x, 3) + 0.0:.3f}" for x in numbers), b.note])
    path.write_text(text.getvalue(), encoding="utf-8", newline="")


def read_bends(path: Path) -> BendList:
    """Read the rows of a bends.csv, exactly as written.

    Raises:
        InputError: the file cannot be read, lacks its columns or placing, or a number is impossible.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), "it cannot be read", "Check the path.") from error
    placed: dict[str, np.ndarray] = {}
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            lines.append(line)
            continue
        key, _, value = line[1:].partition(":")
        if key.strip() in _PLACED:
            placed[key.strip()] = np.array([_read_number(path, x) for x in value.split()])
    if set(placed) != set(_PLACED) or any(v.shape != (3,) for v in placed.values()):
        raise InputError(path.name, f"it does not say {', '.join(_PLACED)}", "Write it anew.")
    table = csv.DictReader(lines)
    if tuple(table.fieldnames or ()) != COLUMNS:
        raise InputError(path.name, f"its columns are not {', '.join(COLUMNS)}", "Write it anew.")
    bends = []
    for row in table:
        if None in row or None in row.values():
            raise InputError(path.name, f"row {row['index']} has too few or too many columns", "")
        numbers = [_read_number(path, row[name]) for name in COLUMNS[1:-1]]
        distance, feed, rotation, bend, tool, radius = numbers
        if min(distance, feed, bend, radius) < 0:
            raise InputError(path.name, f"row {row['index']} holds a negative length or bend", "")
        bends.append(Bend(distance, feed, rotation, bend, tool, radius, row["note"]))
    if not bends:
        raise InputError(path.name, "it has no rows", "Write it anew.")
    return BendList(tuple(bends), placed["start_mm"], placed["direction"], placed["normal"])


def _read_number(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path.name, f"{text!r} is not a number", "Write it anew.")
    return value
