"""A check: what was measured, the limit, and whether it holds."""

from __future__ import annotations

import re
import stat
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from knotfab_formats.verdict import Check, Place, Status
from knotfab_validators.arrays import Array, Ints

MOST_PLACES = 20  # places listed for one check; a picture with more marks shows nothing
MOST_COMPARED = 2000


# places as `spot` writes them, but for those of the scene
_SPOT = re.compile(r"\((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\) mm(?! of the scene)")


def at_least(
    name: str,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
    *,
    required: bool = True,
    tolerance: float = 0.0,
    at: Iterable[Sequence[float] | Array] = (),
) -> Check:
    """Make a check that passes if `measured` >= `limit` - `tolerance`, or if there is no limit. NaN fails.

    `tolerance` is for the rounding of what was written, in `unit`; it is not part of the limit.
    """
    holds = measured == measured and (limit is None or measured >= limit - tolerance)
    return _judge(name, holds, required, measured, limit, unit, detail, at)


def at_most(
    name: str,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
    *,
    required: bool = True,
    tolerance: float = 0.0,
    at: Iterable[Sequence[float] | Array] = (),
) -> Check:
    """Make a check that passes if `measured` <= `limit` + `tolerance`, or if there is no limit. NaN fails."""
    holds = measured == measured and (limit is None or measured <= limit + tolerance)
    return _judge(name, holds, required, measured, limit, unit, detail, at)


def skip_check(name: str, why: str, *, required: bool = False) -> Check:
    """Return a check that could not run; `required` when the part cannot be accepted without it."""
    return Check(name, "skipped", required, None, None, "", why)


def _judge(
    name: str,
    holds: bool,
    required: bool,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
    at: Iterable[Sequence[float] | Array],
) -> Check:
    """Make the check; numbers become Python floats, so that JSON can be written from them."""
    bound = None if limit is None else float(limit)
    value = float(measured) + 0.0  # -0.0 reads oddly
    status: Status = "pass" if holds else "fail"
    return Check(name, status, required, value, bound, unit, detail, places(at))


def places(points: Iterable[Sequence[float] | Array]) -> tuple[Place, ...]:
    """Return the first `MOST_PLACES` of some points (3,), mm, as plain numbers."""
    return tuple((float(x), float(y), float(z)) for x, y, z in islice(points, MOST_PLACES))


def spot(point: Sequence[float] | Array) -> str:
    """Format a point (3,), mm, for a sentence."""
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) mm"


def rescale(check: Check, share: float) -> Check:
    """Scale the places of a check, and those in its sentence, by `share`.

    A sentence that gives places in the scene stays as it is.
    """

    def place(found: re.Match[str]) -> str:
        return spot([share * float(x) for x in found.groups()])

    at = places(share * np.array(place) for place in check.at)
    return replace(check, at=at, detail=_SPOT.sub(place, check.detail))


def worst_apart(values: Array, points: Array, apart: float, above: float) -> Ints:
    """Return the indices of the worst values above a limit, worst first; NaN is worst of all.

    The largest value is always among them. Among `points` (n, 3) nearer than `apart` to each other, only the
    worst is named.
    """
    order = np.argsort(-np.where(np.isnan(values), np.inf, values), kind="stable")
    kept = [int(order[0])]
    for i in order[1:MOST_COMPARED]:
        if len(kept) == MOST_PLACES or not values[i] > above:
            break
        if np.linalg.norm(points[kept] - points[i], axis=1).min() > apart:
            kept.append(int(i))
    return np.array(kept, dtype=np.int64)


# Seconds spent on each stage.


@contextmanager
def time_stage(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the seconds spent inside to `seconds[stage]`."""
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start


# The error with which every reader refuses a file, and the limits on what a file may hold.

MOST_TRIANGLES = 20_000_000
"""The triangles that one file may have: more would not fit the memory of the machines meant for checks."""

MOST_MM = 1e7
"""Ten kilometres: coordinates beyond are nonsense or another unit, and squares of squares overflow."""

DECIMAL_COMMA = "its numbers have decimal commas, such as 1,5: export it with decimal points"


class BadFile(ValueError):
    """A file that cannot be read; the message is one sentence that names it."""


def read_bytes(path: Path, most: int) -> bytes:
    """Read a regular file of at most `most` bytes. Devices and pipes, which might never end, are refused.

    Raises:
        BadFile: it is a folder, a device or a pipe, is too large, or cannot be read.
    """
    try:
        about = path.stat()
        if stat.S_ISDIR(about.st_mode):
            raise BadFile(f"{path.name}: is a folder, not a file")
        if not stat.S_ISREG(about.st_mode):
            raise BadFile(f"{path.name}: is not a plain file")
        if about.st_size > most:
            raise BadFile(f"{path.name}: is larger than {most / 1e6:.6g} MB")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        why = getattr(error, "strerror", None) or error
        raise BadFile(f"{path.name}: cannot be read ({why})") from error
