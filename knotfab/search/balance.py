"""Weigh each of three views or more in the search: the more, the further it falls short of its goal.

Pictures that contradict each other pull at the same strands, and a plain sum of their errors lets the
one with most to gain win: a strand that spills in one view draws what the hull's own shadow lacks in
another. The bound of each view says what it can ask for, so those that lack most of it are given more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Balance", "goals_of"]

_SHORT = 0.015  # a view may stay so far below its bound; settling and repairs take some more
_GAIN = 30.0  # at an update 0.01 further below the goal than the mean of all gains e^0.3
# the part of a share's logarithm that stays at an update: shares are equal where no view lacks anything
_KEPT = 0.9
_MOST = 4.0  # a view counts at most so many times more or less than among equals


def goals_of(bounds: Sequence[float]) -> tuple[float, ...]:
    """Return the IoU that each view is to reach, from the IoU of the hull's own shadows."""
    return tuple(bound - _SHORT for bound in bounds)


@dataclass
class Balance:
    """The weights of the views, and what moves them.

    `shares` (n,) has the mean 1. A view above its goal asks for nothing, and where none lacks anything the
    shares go back to equal. This is the multiplicative weights method (Arora, Hazan & Kale 2012,
    section 2) on the shortfalls, with a memory that fades.
    """

    goals: tuple[float, ...]
    shares: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        self.shares = np.ones(len(self.goals))

    def update(self, ious: Sequence[float]) -> NDArray[np.float64]:
        """Return new shares (n,) from the IoU of each view as it stands."""
        short = np.maximum(np.array(self.goals) - np.array(ious), 0.0)
        moved = self.shares**_KEPT * np.exp(_GAIN * (short - short.mean()))
        moved = np.clip(moved, 1.0 / _MOST, _MOST)
        self.shares = np.asarray(moved / moved.mean())
        return self.shares
