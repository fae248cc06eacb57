"""The findings of a validation: its checks, its views, and the exit code that follows from them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

from knotfab_validators.check import Check

__all__ = ["Verdict", "exit_code_of", "verdict_of"]


@dataclass(frozen=True)
class Verdict:
    """The result of `validate`.

    `status` is "pass" or "fail". `exit_code` is 0 when every required check passed, 1 when one failed, 3
    when one could not run on this machine. `views` has the keys of the report's views; `seconds` says what
    each stage cost; `picture` is the file in which the failures were drawn; `conclusion` one line for a
    person, `size_mm` the part's extents, `notes` what its reader passed over or asks. `colours` has the
    report's keys of the colours that several lamps mix on one screen; None where none do.
    """

    status: str
    exit_code: int
    checks: tuple[Check, ...]
    views: tuple[dict[str, Any], ...]
    seconds: dict[str, float] = field(default_factory=dict)
    picture: str | None = None
    conclusion: str = ""
    size_mm: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    colours: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Its fields but exit code and seconds, of values that JSON knows (no infinities)."""
        return {
            "status": self.status,
            "conclusion": self.conclusion,
            "size_mm": _plain(self.size_mm),
            "notes": list(self.notes),
            "picture": self.picture,
            "checks": [_plain(asdict(check)) for check in self.checks],
            "views": [_plain(view) for view in self.views],
            "colours": _plain(self.colours),
        }


def exit_code_of(states: Iterable[tuple[bool, str]]) -> int:
    """The one rule of passing, from each check's `required` and `status`.

    1: a required check failed; else 3: a required one could not run; else 0. What is not required
    decides nothing.
    """
    required = {status for needed, status in states if needed}
    return 1 if "fail" in required else 3 if "skipped" in required else 0


def verdict_of(
    checks: list[Check],
    views: list[dict[str, Any]],
    seconds: dict[str, float],
    picture: str | None = None,
) -> Verdict:
    """Sum up checks (see `exit_code_of`)."""
    code = exit_code_of((c.required, c.status) for c in checks)
    return Verdict(
        status="fail" if code else "pass",
        exit_code=code,
        checks=tuple(checks),
        views=tuple(views),
        seconds=seconds,
        picture=picture,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
