"""What a report says of effects: calls of design and verification together, and advice with its gain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reports import LOSS, recognition, verdict_of, view_of_report
from shapely import MultiPolygon, box

from knotfab.base.errors import SceneError
from knotfab.design.room import depth_extent, resolve_region
from knotfab.effects.base import Decision
from knotfab.effects.penumbra import PENUMBRA
from knotfab.report.effects import advise_nearer_wall as advise_nearer
from knotfab.report.effects import advise_widening, list_effects, tell_move
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import ResolvedView, Scene, SettledScene
from knotfab_formats.verdict import WorstMove

SOFT = {
    "widest_px": 9.0, "iou": 0.99, "brightness_error": 0.0, "hard_error": 0.0, "samples": 19,
}  # fmt: skip


def advise(
    wall_mm: float, error: float | None, hard: float = 0.0, front_mm: float = 0.0, **keys: Any
) -> list[str]:
    """Advise on a piece of 80 mm depth that is moved `front_mm` towards the lamp."""
    view = ResolvedView(
        wall_distance_mm=wall_mm, light_diameter_mm=20.0, frame_width_mm=180.0,
        frame_height_mm=180.0, **keys,
    )  # fmt: skip
    z = np.linspace(-40, 40, 101) + front_mm
    points = np.column_stack([np.zeros((101, 2)), z])
    knots = SimpleNamespace(points=points, radius_mm=2.0)
    piece = SimpleNamespace(depth=None if front_mm else 60.0)
    scene = SimpleNamespace(views=(view,), piece=piece, share_wall=False)
    made: Any = SimpleNamespace(knots=knots, scene=scene)
    if error is None:
        return advise_nearer([view_of_report()], made)
    soft = {**SOFT, "brightness_error": error, "hard_error": hard}
    return advise_nearer([view_of_report(penumbra=soft)], made)


def test_a_nearer_wall_is_advised_with_its_gain() -> None:
    (note,) = advise(100.0, 0.03)
    # 40 mm and two radii behind the middle are 0.9 of 49 mm; its blur falls from 100/600 to 49/549
    assert "--wall-distance 49 (100 mm now)" in note and "from 0.030 to about 0.016" in note
    ratio = (49 / 549) / (100 / 600)
    left = float(note.rsplit(" ", 1)[1].rstrip("."))
    assert left == pytest.approx(0.03 * ratio, rel=0.05)
    # the part of the picture that the hard shadow misses stays
    (note,) = advise(100.0, 0.04, hard=0.01)
    left = float(note.rsplit(" ", 1)[1].rstrip("."))
    assert left == pytest.approx(0.01 + 0.03 * ratio, rel=0.05)


def test_the_advised_wall_is_one_that_a_build_accepts() -> None:
    polygon = MultiPolygon([box(-60, -60, 60, 60)])
    scene = Scene.model_validate({"piece": {"depth": 80.0, "tube_radius_mm": 2.0}})
    for wall, refused in ((49.0, False), (47.0, True)):
        view = ResolvedView(wall_distance_mm=wall, frame_width_mm=180.0, frame_height_mm=180.0)
        region = resolve_region(scene.region, [view], [], 2.0)
        if refused:
            with pytest.raises(SceneError, match="do not fit"):
                depth_extent(scene.piece.depth, polygon, region, 2.0)
        else:
            assert depth_extent(scene.piece.depth, polygon, region, 2.0) == 80.0


@pytest.mark.parametrize(
    ("wall_mm", "error", "keys"),
    [
        (100.0, 0.008, {}),  # little to gain
        (49.0, 0.03, {}),  # as near as it can be
        (100.0, 0.03, {"hard": 0.02}),  # blur is the lesser part of it
        (100.0, 0.03, {"front_mm": 50.0}),  # a piece that stands off the wall's place altogether
        (100.0, None, {}),  # not simulated
        (100.0, 0.03, {"wall_tilt_deg": 20.0}),  # where the wall is, is no one distance
    ],
)
def test_no_advice_without_a_gain(wall_mm: float, error: float | None, keys: Any) -> None:
    assert advise(wall_mm, error, **keys) == []


def test_an_effects_line_counts_the_design_and_the_verification() -> None:
    decision = Decision(PENUMBRA, 9.0, 1.0)
    decision.count("depth", 300, 0.1)
    result: Any = SimpleNamespace(effects={"penumbra": decision})
    verdict = verdict_of([{"penumbra": SOFT}, {}], seconds={"penumbra": 1.5})
    (line,) = list_effects(result, verdict)
    assert (line.calls, line.seconds) == (319, 1.6)
    assert line.where == ("depth", "verification")
    (line,) = list_effects(result, verdict_of())
    assert (line.calls, line.where) == (300, ("depth",))
    assert decision.calls == 300


def test_an_effect_that_nothing_ran_is_not_called_simulated() -> None:
    result: Any = SimpleNamespace(effects={"penumbra": Decision(PENUMBRA, 9.0, 1.0)})
    (line,) = list_effects(result, verdict_of())
    assert not line.simulated and line.reason.endswith("; nothing ran it")
    (line,) = list_effects(result, verdict_of([{"penumbra": SOFT}]))
    assert line.simulated and "nothing" not in line.reason


def test_a_move_is_told_in_words() -> None:
    off: Any = SimpleNamespace(lamp_mm=5.0, turn_deg=1.5)

    def told(of: str, way: str, kind: str = "shadow") -> str:
        return tell_move(WorstMove(0.9, 0.95, of, way), off, kind)

    assert told("lamp", "up") == "the lamp 5 mm up or down"
    assert told("lamp", "right", "eye") == "the eye 5 mm to the side"
    hung = tell_move(WorstMove(0.9, 0.95, "turn", "up"), off, "shadow", 80.0)
    assert hung == "one thread 2.1 mm nearer the wall than the other"
    assert told("turn", "axis") == "the piece turned by 1.5° like a wheel"


# What is lost for want of width comes with the option that widens it.


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
