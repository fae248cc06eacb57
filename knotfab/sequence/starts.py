"""Which earlier frame's knot a frame begins as, and what is tried where that does not serve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab.geometry.polylines import Polylines
from knotfab.knots import Knots
from knotfab.problem import Problem
from knotfab.scene.settings import SearchSettings
from knotfab.sequence.motion import Anchor
from knotfab.sequence.search import FrameResult, follow
from knotfab.target.opening import opening_iou

__all__ = ["Following", "Likeness", "Trial"]


_MORE = 2.0  # times the iterations, where a frame did not come out
_POOR = 0.025  # of IoU below what the radius allows: another start is tried
_ALIKE = 0.5  # of what differs from the frame before: an earlier frame is the better start
_SMALL_PX = 256  # of pictures that are compared


class Likeness:
    """How much of the frame the pictures differ in."""

    def __init__(self, masks: Sequence[NDArray[np.bool_]]) -> None:
        step = max(1, max(masks[0].shape) // _SMALL_PX)
        self._masks = np.stack([m[::step, ::step] for m in masks])

    def before(self, k: int) -> int:
        """The earlier frame to begin frame k from: that just before, or one much more like it.

        Where limbs part that one silhouette had hidden, the knot of a frame in which they were apart
        knows which strand goes where.
        """
        unlike = (self._masks[:k] ^ self._masks[k]).mean(axis=(1, 2))
        nearest = int(unlike.argmin())
        return nearest if unlike[nearest] < _ALIKE * unlike[k - 1] else k - 1


@dataclass(frozen=True)
class Following:
    """What it takes to search one more frame: `known` are the knots of those before it."""

    known: tuple[Knots, ...]
    problems: tuple[Problem, ...]  # of the frames before, and of this one
    rings: Polylines
    radius: float
    settings: SearchSettings
    taut_mm: float
    back: Anchor | None  # to the first frame, while the sequence may still close
    outline_mm: float  # from the frame just before
    device: str

    def search(self, nearest: int, report: Callable[[float, float | None], None]) -> Trial:
        """The frame's knot, from the earlier frame `nearest` if that serves.

        Where that breaks a limit or draws badly, it begins from the frame just before, is not bound
        to close, or has more iterations; the best of the trials is kept.
        """
        last = len(self.known) - 1
        wanted = opening_iou(self.problems[-1].polygons[0], self.radius) - _POOR
        bound = [] if self.back is None else [(nearest, True, 1.0), (last, True, 1.0)]
        free = [(nearest, False, 1.0), (last, False, 1.0), (last, False, _MORE)]
        best: Trial | None = None
        for origin, closes, effort in dict.fromkeys([*bound, *free]):
            back = self.back if closes else None
            found = follow(
                self.known[origin],
                self.rings,
                (self.problems[origin], self.problems[-1]),
                self.radius,
                self.settings.scaled(effort),
                self.taut_mm,
                [
                    Anchor(self.known[last].points, self.outline_mm + self.radius, self.radius),
                    *([] if back is None else [back]),
                ],
                self.device,
                report,
            )
            found.result.log.template = f"the knot of frame {origin + 1}"
            trial = Trial(found, origin, back)
            if best is None or trial.quality > best.quality:
                best = trial
            if found.sound and found.result.iou_estimate >= wanted:
                break
        assert best is not None
        return best


@dataclass(frozen=True)
class Trial:
    """A frame's knot, the frame (from 0) that it began from, and how it was bound to close."""

    found: FrameResult
    origin: int
    back: Anchor | None

    @property
    def quality(self) -> tuple[bool, float]:
        return self.found.sound, self.found.result.iou_estimate
