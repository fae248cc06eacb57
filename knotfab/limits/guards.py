"""All limits of a search, each under watch."""

from __future__ import annotations

from knotfab.limits.base import Guard, Limit
from knotfab.limits.bend import BEND
from knotfab.limits.clearance import CLEARANCE
from knotfab.limits.length import LENGTH
from knotfab.limits.region import REGION

__all__ = ["LIMITS", "guard_limits"]

LIMITS: tuple[Limit, ...] = (CLEARANCE, BEND, REGION, LENGTH)


def guard_limits() -> dict[str, Guard]:
    """Return a fresh watch over every limit, by name."""
    return {limit.name: Guard(limit) for limit in LIMITS}
