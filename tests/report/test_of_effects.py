"""What a report says of effects: calls of design and verification together, and advice with its gain."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from knotfab.effects.base import Decision
from knotfab.effects.penumbra import PENUMBRA
from knotfab.report.of_effects import add_advice, list_effects
from knotfab.scene.model import ResolvedView


def advise(wall_mm: float, error: float | None, depth_mm: float = 80.0, **keys: Any) -> list[str]:
    view = ResolvedView(
        wall_distance_mm=wall_mm, light_diameter_mm=20.0, frame_width_mm=180.0,
        frame_height_mm=180.0, **keys,
    )  # fmt: skip
    z = np.linspace(-depth_mm / 2, depth_mm / 2, 101)
    points = np.column_stack([np.zeros((101, 2)), z])
    knots = SimpleNamespace(points=points, radius_mm=2.0)
    made: Any = SimpleNamespace(knots=knots, scene=SimpleNamespace(views=(view,)))
    found = {"brightness_error": error} if error is not None else None
    report = {"views": [{"penumbra": found}]}
    add_advice(report, made)
    return list(report.get("notes", []))


def test_a_nearer_wall_is_advised_with_its_gain() -> None:
    (note,) = advise(100.0, 0.03)
    # 42 mm behind the middle are 0.9 of 47 mm; the blur of the middle falls from 100/600 to 47/547
    assert "--wall-distance 47 (100 mm now)" in note and "from 0.030 to about 0.016" in note
    left = float(note.rsplit(" ", 1)[1].rstrip("."))
    assert left == pytest.approx(0.03 * (47 / 547) / (100 / 600), rel=0.05)


@pytest.mark.parametrize(
    ("wall_mm", "error", "keys"),
    [
        (100.0, 0.008, {}),  # little to gain
        (47.0, 0.03, {}),  # as near as it can be
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
    verdict = {"views": [{"penumbra": {"samples": 19}}, {}], "seconds": {"penumbra": 1.5}}
    (line,) = list_effects(result, verdict)
    assert (line["calls"], line["seconds"]) == (319, 1.6)
    assert line["where"] == ["depth", "verification"]
    (line,) = list_effects(result, {"views": [], "seconds": {}})
    assert (line["calls"], line["where"]) == (300, ["depth"])
    assert decision.calls == 300
