"""Centre lines: polygons with one tube radius, and their straight edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from knotfab_validators.arrays import Array, Ints

__all__ = ["CurveEdges", "Curves", "Member", "edges_of"]


@dataclass(frozen=True)
class CurveEdges:
    """Edges from `start` to `end` (k, 3), mm, and the number (k,) of the curve each belongs to."""

    start: Array
    end: Array
    curve: Ints


@dataclass(frozen=True)
class Member:
    """A round bar of a mount: from a centre line to another, or to the mount's foot; all (3,), mm.

    `radius_mm` are those of its two ends, `foot` the unit normal of the face that it stands on, if it does.
    """

    start: Array
    end: Array
    radius_mm: tuple[float, float]
    foot: Array | None = None


@dataclass(frozen=True)
class Curves:
    """Polygons with one tube radius.

    `polygons` are (n, 3) float64 mm; where `closed` says so the last point joins the first, and is
    not repeated. `types` are the knot types that the file promises, such as "unknot" or "3_1" ("open"
    for an open curve); `radius_mm` is None where the file gives none. `members` are those of the mount
    that holds them.
    """

    polygons: tuple[Array, ...]
    types: tuple[str, ...]
    closed: tuple[bool, ...]
    radius_mm: float | None
    members: tuple[Member, ...] = ()

    @cached_property
    def edges(self) -> CurveEdges:
        """The edges of all curves, in their order."""
        return edges_of(self.polygons, self.closed)

    @property
    def length_mm(self) -> float:
        """Length of all polygons together, closing edges included."""
        return sum(self.lengths_mm)

    @property
    def lengths_mm(self) -> tuple[float, ...]:
        """Length of each polygon, the closing edge included where it is closed."""
        length = np.linalg.norm(self.edges.end - self.edges.start, axis=1)
        return tuple(np.bincount(self.edges.curve, length, minlength=len(self.polygons)).tolist())

    def scaled(self, share: float) -> Curves:
        """Return the same curves, radii and members at a share of every length."""
        return replace(
            self,
            polygons=tuple(share * polygon for polygon in self.polygons),
            radius_mm=None if self.radius_mm is None else share * self.radius_mm,
            members=tuple(
                Member(
                    share * m.start,
                    share * m.end,
                    (share * m.radius_mm[0], share * m.radius_mm[1]),
                    m.foot,
                )
                for m in self.members
            ),
        )


def edges_of(polygons: Sequence[Array], closed: Sequence[bool] | None = None) -> CurveEdges:
    """Return the edges of polygons (n, 3), in their order; `closed`: all by default.

    A closed polygon's last edge leads to its first point; an open one has no such edge.
    """
    starts, ends, numbers = [], [], []
    joined = [True] * len(polygons) if closed is None else closed
    for i, (polygon, is_closed) in enumerate(zip(polygons, joined, strict=True)):
        count = len(polygon) if is_closed else len(polygon) - 1
        starts.append(polygon[:count])
        ends.append(np.roll(polygon, -1, axis=0)[:count])
        numbers.append(np.full(count, i, dtype=np.int64))
    return CurveEdges(np.concatenate(starts), np.concatenate(ends), np.concatenate(numbers))
