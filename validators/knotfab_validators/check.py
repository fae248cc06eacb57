"""One check: what was measured, what the limit is, and whether it holds."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

__all__ = ["Check", "Status", "at_least", "at_most", "skipped"]

Status = Literal["pass", "fail", "skipped"]


@dataclass(frozen=True)
class Check:
    """The outcome of one check.

    `required` says whether a failure rejects the part; `measured` and `limit` are in `unit`, or
    words where the thing is not a number; `detail` is one sentence for a person.
    """

    name: str
    status: Status
    required: bool
    measured: float | str | None
    limit: float | str | None
    unit: str
    detail: str

    def to_dict(self) -> dict[str, Any]:
        """The keys of the report's `checks`."""
        return asdict(self)


def at_least(
    name: str,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
    *,
    required: bool = True,
    tolerance: float = 0.0,
) -> Check:
    """Passes when `measured` >= `limit` - `tolerance`, or there is no limit; NaN always fails.

    `tolerance` is for the rounding of what was written, in `unit`; it is no part of the limit.
    """
    holds = measured == measured and (limit is None or measured >= limit - tolerance)
    return _judged(name, holds, required, measured, limit, unit, detail)


def at_most(
    name: str,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
    *,
    required: bool = True,
    tolerance: float = 0.0,
) -> Check:
    """Passes when `measured` <= `limit` + `tolerance`, or there is no limit; NaN always fails."""
    holds = measured == measured and (limit is None or measured <= limit + tolerance)
    return _judged(name, holds, required, measured, limit, unit, detail)


def skipped(name: str, why: str, *, required: bool = False) -> Check:
    """A check that could not run; `required` when the part cannot be accepted without it."""
    return Check(name, "skipped", required, None, None, "", why)


def _judged(
    name: str,
    holds: bool,
    required: bool,
    measured: float,
    limit: float | None,
    unit: str,
    detail: str,
) -> Check:
    """`measured` and `limit` become Python floats, so that JSON can be written from them."""
    bound = None if limit is None else float(limit)
    value = float(measured) + 0.0  # -0.0 reads oddly
    return Check(name, "pass" if holds else "fail", required, value, bound, unit, detail)
