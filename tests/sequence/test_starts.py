"""Which frame a frame begins as: pictures that return to an earlier one, and trials until one serves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import MultiPolygon, box

from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.knots import Knot, Knots
from knotfab.limits.base import Limits
from knotfab.limits.feasibility import Feasibility
from knotfab.problem import CertificateLog, Problem, SearchResult, TargetView
from knotfab.scene.model import ResolvedRegion, ResolvedView
from knotfab.scene.settings import SearchSettings
from knotfab.sequence import starts
from knotfab.sequence.motion import Anchor
from knotfab.sequence.search import FrameResult
from knotfab.sequence.starts import Following, Likeness

ROOM = ResolvedRegion(size_mm=(200.0, 200.0, 200.0))


def _legs(apart: int) -> NDArray[np.bool_]:
    """A body with two legs, so many pixels to either side."""
    mask = np.zeros((80, 80), dtype=bool)
    mask[5:40, 30:50] = True
    for foot in (-apart, apart):
        mask[40:75, 36 + foot : 44 + foot] = True
    return mask


def test_a_frame_begins_as_the_one_before() -> None:
    alike = Likeness([_legs(n) for n in (20, 14, 8, 2)])
    assert [alike.before(k) for k in (1, 2, 3)] == [0, 1, 2]


def test_legs_that_part_again_begin_where_they_were_apart() -> None:
    alike = Likeness([_legs(n) for n in (20, 10, 0, 10, 20)])
    assert alike.before(3) == 1
    assert alike.before(4) == 0


class _Follow:
    """Stands for the search: an IoU for (start, whether it must close, whether it has more iterations)."""

    def __init__(self, seen: dict[tuple[int, bool, bool], float], sound: bool = True) -> None:
        self.seen, self.sound = seen, sound
        self.asked: list[tuple[int, bool, bool]] = []

    def __call__(
        self,
        before: Knots,
        rings: object,
        problems: object,
        radius: float,
        settings: SearchSettings,
        taut_mm: float,
        anchors: Sequence[Anchor],
        *rest: Any,
    ) -> FrameResult:
        asked = int(before.points[0, 0]), len(anchors) == 2, settings.fine_iterations > 10
        self.asked.append(asked)
        limits = Limits(2.0, 0.4, 2.2, 1000.0, ROOM)
        at = np.zeros(3)
        measured = Feasibility(3.0 if self.sound else 1.0, at, 5.0, at, -1.0, at, 100.0, limits)
        seen = (self.seen.get(asked, 0.5),)
        return FrameResult(SearchResult(before, measured, CertificateLog(), {}, None, seen), -1.0)


def _following(monkeypatch: pytest.MonkeyPatch, follow: _Follow, closing: bool) -> Following:
    """Of frame 3, after frames 0, 1 and 2, whose knots hold their numbers as coordinates."""
    monkeypatch.setattr(starts, "follow", follow)
    monkeypatch.setattr(starts, "opening_iou", lambda *_: 0.99)
    view = ResolvedView(frame_width_mm=80.0, frame_height_mm=80.0)
    target = TargetView(view, _legs(10), MultiPolygon([box(0, 0, 9, 9)]))
    problem = Problem((target,), 0.4, None, 1000.0, ROOM)
    known = tuple(Knots((Knot(np.full((4, 3), float(k))),), 2.0) for k in range(3))
    back = Anchor(known[0].points, 5.0, 2.0) if closing else None
    settings = SearchSettings(fine_iterations=10)
    return Following(
        known, (problem,) * 4, polylines_of_sizes((4,)), 2.0, settings, 100.0, back, 3.0, "cpu"
    )


def test_the_first_trial_that_serves_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(1, True, False): 0.98})
    trial = _following(monkeypatch, follow, closing=True).search(1, lambda *_: None)
    assert follow.asked == [(1, True, False)]
    assert (trial.origin, trial.back is not None) == (1, True)
    assert trial.found.result.log.template == "the knot of frame 2"


def test_closing_is_given_up_before_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(2, True, False): 0.8, (2, False, False): 0.98})
    trial = _following(monkeypatch, follow, closing=True).search(2, lambda *_: None)
    assert follow.asked == [(2, True, False), (2, False, False)]
    assert trial.back is None
    again = _Follow({(2, False, False): 0.98})
    _following(monkeypatch, again, closing=False).search(2, lambda *_: None)
    assert again.asked == [(2, False, False)]


def test_the_best_of_poor_trials_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(0, True, False): 0.7, (2, True, False): 0.9, (2, False, True): 0.8})
    trial = _following(monkeypatch, follow, closing=True).search(0, lambda *_: None)
    assert len(follow.asked) == 5
    assert (trial.origin, trial.found.result.iou_estimate) == (2, 0.9)


def test_a_frame_that_breaks_a_limit_has_all_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(2, True, False): 0.99}, sound=False)
    trial = _following(monkeypatch, follow, closing=True).search(2, lambda *_: None)
    assert len(follow.asked) == 3
    assert trial.found.result.iou_estimate == 0.99
