"""Which frame a frame begins as: pictures that return to an earlier one, and trials until one serves."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import MultiPolygon, box

from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.knots import Knot, Knots
from knotfab.limits.base import Limits
from knotfab.limits.feasibility import Feasibility
from knotfab.problem import CertificateLog, Problem, SearchResult, TargetView
from knotfab.sequence import starts
from knotfab.sequence.motion import Anchor
from knotfab.sequence.search import FrameResult
from knotfab.sequence.starts import (
    Attempt,
    Following,
    PictureDifferences,
    Tie,
    Trial,
    list_attempts,
    list_retries,
)
from knotfab_formats.scene import ResolvedView, SettledRegion
from knotfab_formats.search import SearchSettings

ROOM = SettledRegion(size_mm=(200.0, 200.0, 200.0))


def _legs(apart: int) -> NDArray[np.bool_]:
    """A body with two legs, so many pixels to either side."""
    mask = np.zeros((80, 80), dtype=bool)
    mask[5:40, 30:50] = True
    for foot in (-apart, apart):
        mask[40:75, 36 + foot : 44 + foot] = True
    return mask


def test_a_frame_begins_as_the_one_before() -> None:
    alike = PictureDifferences([_legs(n) for n in (20, 14, 8, 2)])
    assert [alike.start_of(k, k - 1, range(k)) for k in (1, 2, 3)] == [0, 1, 2]
    # going backwards it is as the one behind
    assert [alike.start_of(k, k + 1, range(k + 1, 4)) for k in (2, 1, 0)] == [3, 2, 1]


def test_legs_that_part_again_begin_where_they_were_apart() -> None:
    alike = PictureDifferences([_legs(n) for n in (20, 10, 0, 10, 20)])
    assert alike.start_of(3, 2, range(3)) == 1
    assert alike.start_of(4, 3, range(4)) == 0
    assert alike.same(1, 3) and not alike.same(1, 2)


Asked = tuple[int, bool, bool, bool]


class _Follow:
    """Stands for the search: an IoU for (start, whether it must close, has more iterations, stays still).

    `unsound`: what breaks a limit.
    """

    def __init__(self, seen: dict[Asked, float], unsound: Sequence[Asked] = ()) -> None:
        self.seen, self.unsound = seen, unsound
        self.asked: list[Asked] = []

    def __call__(
        self,
        before: Knots,
        rings: object,
        problems: object,
        radius: float,
        settings: SearchSettings,
        taut_mm: float,
        anchors: Sequence[Anchor],
        device: str,
        report: object,
        still: bool,
    ) -> FrameResult:
        more = settings.fine_iterations > 10
        asked = int(before.points[0, 0]), len(anchors) == 2, more, still
        self.asked.append(asked)
        limits = Limits(2.0, 0.4, 2.2, 1000.0, ROOM)
        at = np.zeros(3)
        bend = 1.0 if asked in self.unsound else 3.0
        measured = Feasibility(bend, at, 5.0, at, -1.0, at, 100.0, limits)
        seen = (self.seen.get(asked, 0.5),)
        return FrameResult(SearchResult(before, measured, CertificateLog(), {}, None, seen), -1.0)


def _search(
    monkeypatch: pytest.MonkeyPatch, follow: _Follow, attempts: Sequence[Attempt]
) -> tuple[Trial, list[Asked]]:
    """Search frame 3 after frames 0, 1 and 2, whose knots hold their numbers as coordinates."""
    monkeypatch.setattr(starts, "follow", follow)
    monkeypatch.setattr(starts, "finish", lambda found, *_: FrameResult(found, -1.0))
    monkeypatch.setattr(starts, "opening_iou", lambda *_: 0.99)
    view = ResolvedView(frame_width_mm=80.0, frame_height_mm=80.0)
    target = TargetView(view, _legs(10), MultiPolygon([box(0, 0, 9, 9)]))
    problem = Problem((target,), 0.4, None, 1000.0, ROOM)
    known = {k: Knots((Knot(np.full((4, 3), float(k))),), 2.0) for k in range(3)}
    fine = {k: knots.points for k, knots in known.items()}
    ties = (Tie(2, 3.0), Tie(0, 5.0, loop=True))
    settings = SearchSettings(fine_iterations=10)
    rings = polylines_of_sizes((4,))
    following = Following(
        3, known, fine, (problem,) * 4, rings, 2.0, settings, 100.0, ties, "simple"
    )
    return following.search(attempts, lambda *_: None), follow.asked


def test_the_first_trial_that_serves_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(1, True, False, False): 0.98})
    trial, asked = _search(monkeypatch, follow, list_attempts(1, 2, closes=True, same=False))
    assert asked == [(1, True, False, False)]
    assert trial.attempt == Attempt(1) and trial.ended is not None
    assert trial.found.result.log.template == "the knot of frame 2; of the first one: simple"


def test_closing_is_given_up_before_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {(2, True, False, False): 0.8, (2, False, False, False): 0.98}
    trial, asked = _search(monkeypatch, _Follow(seen), list_attempts(2, 2, closes=True, same=False))
    assert asked == list(seen)
    assert not trial.attempt.closes
    # where nothing is to close, nothing is bound to
    _, asked = _search(monkeypatch, _Follow(seen), list_attempts(2, 2, closes=False, same=False))
    assert asked == [(2, False, False, False)]


def test_the_best_of_poor_trials_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {
        (0, True, False, False): 0.7,
        (2, True, False, False): 0.9,
        (2, False, True, False): 0.8,
    }
    trial, asked = _search(monkeypatch, _Follow(seen), list_attempts(0, 2, closes=True, same=False))
    assert len(asked) == 5 and not any(still for *_, still in asked)
    assert (trial.attempt.origin, trial.found.result.iou_estimate) == (2, 0.9)


def test_a_frame_that_breaks_a_limit_ends_as_its_neighbour(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = [(2, c, more, False) for c, more in ((True, False), (False, False), (False, True))]
    follow = _Follow(dict.fromkeys(moved, 0.99), unsound=moved)
    trial, asked = _search(monkeypatch, follow, list_attempts(2, 2, closes=True, same=False))
    assert asked[:4] == [*moved, (2, True, False, True)]
    assert trial.attempt.still and trial.quality == (True, 0.5)
    # nothing keeps the limits: the best of all, finished all the same
    held = [(2, True, False, True), (2, False, False, True)]
    follow = _Follow({moved[0]: 0.99}, unsound=[*moved, *held])
    trial, asked = _search(monkeypatch, follow, list_attempts(2, 2, closes=True, same=False))
    assert asked == [*moved, *held]
    assert trial.found.result.iou_estimate == 0.99 and trial.ended is not None


def test_the_same_picture_once_more_needs_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    follow = _Follow({(1, True, False, True): 0.98})
    trial, asked = _search(monkeypatch, follow, list_attempts(1, 2, closes=True, same=True))
    assert asked == [(1, True, False, True)]
    assert trial.attempt.still and trial.attempt.origin == 1


def test_a_retry_begins_elsewhere_with_more_iterations() -> None:
    assert list_retries([1, 2, 4], 2, closes=True) == [Attempt(1, True, 2.0), Attempt(4, True, 2.0)]
    # with one neighbour alone there is no other start, but more to do
    (only,) = list_retries([1, 1], 1, closes=True)
    assert only.origin == 1 and only.effort > 2.0 and not only.closes
