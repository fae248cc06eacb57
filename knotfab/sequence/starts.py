"""Choose the earlier frame whose knot a frame begins as, and the next tries where that does not serve."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotfab.geometry.polylines import Polylines
from knotfab.knots import Knots
from knotfab.picture.opening import opening_iou
from knotfab.problem import Problem
from knotfab.render.forms import COMPILED, Forms
from knotfab.sequence.motion import Anchor
from knotfab.sequence.search import FrameResult, finish, follow
from knotfab_formats.search import SearchSettings

__all__ = [
    "POOR",
    "Attempt",
    "Following",
    "PictureDifferences",
    "Tie",
    "Trial",
    "list_attempts",
    "list_retries",
]


_MORE = 2.0  # factor of the iterations, where a frame did not come out
POOR = 0.025  # another start is tried where the IoU is so far below what the radius allows
_ALIKE = 0.5  # a frame that differs less than this share of the neighbour's difference is the better start


class PictureDifferences:
    """Measure the share of the frame in which the pictures differ."""

    def __init__(self, masks: Sequence[NDArray[np.bool_]]) -> None:
        step = max(1, max(masks[0].shape) // 256)  # the longer side of pictures that are compared
        self._masks = np.stack([m[::step, ::step] for m in masks])
        self._whole = masks

    def start_of(self, k: int, neighbour: int, known: Iterable[int]) -> int:
        """Return the known frame to begin frame k from: its neighbour, or one much more like it.

        Where limbs part that one silhouette had hidden, the knot of a frame in which they were apart
        knows which strand goes where.
        """
        unlike = {j: float((self._masks[j] ^ self._masks[k]).mean()) for j in known}
        nearest = min(unlike, key=lambda j: (unlike[j], j))
        return nearest if unlike[nearest] < _ALIKE * unlike[neighbour] else neighbour

    def same(self, one: int, other: int) -> bool:
        """Tell whether two frames have one picture."""
        return bool(np.array_equal(self._whole[one], self._whole[other]))


@dataclass(frozen=True)
class Attempt:
    """One way to search a frame: the frame (from 0) whose knot it begins as, and with what effort.

    `closes`: it is bound to the frame that leads back around the loop. `still`: the knot stays as it was.
    """

    origin: int
    closes: bool = True
    effort: float = 1.0
    still: bool = False


def list_attempts(nearest: int, neighbour: int, closes: bool, same: bool) -> list[Attempt]:
    """Yield tries in their order: the frame most alike, the neighbour, not bound to close, more iterations.

    Last the neighbour's knot as it is, which draws the wrong picture and keeps every limit.

    Args:
        closes: whether the frame may be bound to close at all. same: the nearest has the same picture.
    """
    bound = [Attempt(nearest), Attempt(neighbour)] if closes else []
    free = [Attempt(nearest, False), Attempt(neighbour, False), Attempt(neighbour, False, _MORE)]
    held = [Attempt(neighbour, c, still=True) for c in ((True, False) if closes else (False,))]
    before = [replace(held[0], origin=nearest)] if same else []
    return list(dict.fromkeys([*before, *bound, *free, *held]))


def list_retries(origins: Iterable[int], used: int | None, closes: bool) -> list[Attempt]:
    """Yield tries with more iterations from each frame but the one that the frame had begun as."""
    found = [Attempt(j, closes, _MORE) for j in dict.fromkeys(origins) if j != used]
    return found or [Attempt(j, False, 2 * _MORE) for j in dict.fromkeys(origins)]


@dataclass(frozen=True)
class Tie:
    """A frame found before that this one must stay near, and how far the outlines go in between, mm.

    `loop`: around the end of the sequence, from its last frame to its first.
    """

    frame: int
    outline_mm: float
    loop: bool = False


@dataclass(frozen=True)
class Trial:
    """A frame's knot by one attempt; `ended` with twice the vertices, where it was good enough for that."""

    attempt: Attempt
    found: FrameResult
    ended: FrameResult | None

    @property
    def quality(self) -> tuple[bool, float]:
        if self.ended is None:
            return False, self.found.result.iou_estimate
        return self.ended.sound, self.ended.result.iou_estimate


@dataclass(frozen=True)
class Following:
    """All that a search of one more frame, `number`, needs: the knots known, as searched and as finished.

    `why`: the type of the first of them, and so of all, is known.
    """

    number: int
    known: Mapping[int, Knots]
    fine: Mapping[int, NDArray[np.float64]]  # (2 N, 3) mm
    problems: Sequence[Problem]
    rings: Polylines
    radius: float
    settings: SearchSettings
    taut_mm: float
    ties: tuple[Tie, ...]
    why: str
    forms: Forms = COMPILED

    def search(
        self, attempts: Iterable[Attempt], report: Callable[[float, float | None], None]
    ) -> Trial:
        """Return the first trial that keeps every limit and draws the picture well, else the best of all."""
        wanted = opening_iou(self.problems[self.number].polygons[0], self.radius) - POOR
        best: Trial | None = None
        for attempt in attempts:
            if attempt.still and best is not None and best.quality[0]:
                continue  # the last resort for a frame that breaks a limit
            trial = self._try(attempt, report)
            if best is None or trial.quality > best.quality:
                best = trial
            if best.quality >= (True, wanted):
                break
        assert best is not None
        if best.ended is None:
            best = replace(best, ended=self._finish(best.found, best.attempt))
        return best

    def _try(self, attempt: Attempt, report: Callable[[float, float | None], None]) -> Trial:
        found = follow(
            self.known[attempt.origin],
            self.rings,
            (self.problems[attempt.origin], self.problems[self.number]),
            self.radius,
            self.settings.scaled(attempt.effort),
            self.taut_mm,
            self._anchors({j: knots.points for j, knots in self.known.items()}, attempt.closes),
            self.forms,
            report,
            attempt.still,
        )
        log = found.result.log
        log.template = f"the knot of frame {attempt.origin + 1}; of the first one: {self.why}"
        return Trial(attempt, found, self._finish(found, attempt) if found.sound else None)

    def _finish(self, found: FrameResult, attempt: Attempt) -> FrameResult:
        return finish(
            found.result,
            self.rings,
            self.problems[self.number],
            self.radius,
            self.settings,
            self._anchors(self.fine, attempt.closes),
            self.forms,
        )

    def _anchors(self, points: Mapping[int, NDArray[np.float64]], closes: bool) -> list[Anchor]:
        return [
            Anchor(points[tie.frame], tie.outline_mm + self.radius, self.radius)
            for tie in self.ties
            if closes or not tie.loop
        ]
