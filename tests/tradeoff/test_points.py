"""The presets are points of the measured front: docs/frontier.json, which `make frontier` writes."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_runs import beaten_by

from knotfab.tradeoff.points import PRESET, list_changes
from knotfab_formats.search import PRESETS

STUDY = json.loads((Path(__file__).parents[2] / "docs/frontier.json").read_text("utf-8"))
WHOLE = [p for p in STUDY["points"] if p["pictures"] == STUDY["compared_over"]]
OF_PRESET = {p["point"]: p for p in WHOLE if p["knob"] == PRESET}
MOST = 1.2  # times what another point takes, or is off


def excess(preset: dict[str, Any], points: list[dict[str, Any]]) -> float:
    """The factor by which a point of the study that may lie on the front beats a preset."""
    one, *others = (
        SimpleNamespace(seconds=p["seconds"], error=1 - p["iou"])
        for p in (preset, *(p for p in points if p["eligible"]))
    )
    return beaten_by(one, others)  # type: ignore[arg-type]


def test_the_study_is_of_the_presets_that_are() -> None:
    assert len(STUDY["pictures"]) >= 12 and STUDY["compared_over"] == len(STUDY["pictures"])
    assert OF_PRESET.keys() == PRESETS.keys()
    for name, row in OF_PRESET.items():
        changes = list_changes(PRESETS[name], PRESETS["standard"])
        assert row["changed"] == {key: new for key, (_, new) in changes.items()}


@pytest.mark.parametrize("name", PRESETS)
def test_no_preset_is_dominated(name: str) -> None:
    assert excess(OF_PRESET[name], WHOLE) <= MOST


def test_a_dominated_preset_is_found() -> None:
    row = OF_PRESET["standard"]
    for better in (
        {**row, "seconds": row["seconds"] / 1.3},
        {**row, "iou": 1 - (1 - row["iou"]) / 1.3},
    ):
        assert excess(row, [*WHOLE, better]) > MOST


def test_each_preset_costs_more_and_brings_more() -> None:
    rows = sorted(OF_PRESET.values(), key=lambda row: row["seconds"])
    assert [row["point"] for row in rows] == list(PRESETS)
    assert sorted(row["iou"] for row in rows) == [row["iou"] for row in rows]
