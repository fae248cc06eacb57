"""What is lost for want of width comes with the option that widens it."""

from typing import Any

import pytest
from reports import LOSS, recognition

from knotfab.report.of_views import advise_widening
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import ResolvedView, Scene, SettledScene


def scene(**view: Any) -> SettledScene:
    keys: Any = {"frame_width_mm": 180.0, "frame_height_mm": 90.0, "picture": "p.png", **view}
    asked: Any = {"views": (ResolvedView(**keys),)}
    return resolve(Scene(**asked))


def told(word: str, *lost: tuple[str, float], of: SettledScene | None = None) -> list[str]:
    losses = [{**LOSS, "what": what, "size_mm": size, "needed_mm": 1.6} for what, size in lost]
    return advise_widening(recognition(word=word, lost=losses), of or scene())


@pytest.mark.parametrize("word", ["coarse", "not recognisable"])
def test_strokes_that_are_lost_for_want_of_width_can_be_widened(word: str) -> None:
    (note,) = told(word, ("stroke", 1.2), ("piece", 1.0), ("shape", 0.2), ("hole", 0.4))
    assert "as thin as 1.0 mm" in note and "1.6 mm wide" in note and "--thicken auto" in note


def test_nothing_is_said_where_widening_does_not_help() -> None:
    assert told("good", ("piece", 1.0)) == told("coarse", ("piece", 2.0), ("stray", 1.0)) == []
    assert told("coarse", ("hole", 1.0)) == []
    assert told("coarse", ("piece", 1.0), of=scene(thicken_mm=1.8)) == []
    assert advise_widening(None, scene()) == []
