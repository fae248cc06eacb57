"""The sets of several pictures that a seed draws, and the scene by eye."""

import json
from functools import cache
from pathlib import Path

import pytest
from PIL import Image

from benchmarks import measurement, several_table
from benchmarks.measurement import Built
from benchmarks.several_table import NAMED, build_set, draw_sets
from knotfab.scene.load import load_scene


@pytest.mark.slow
def test_no_set_is_drawn_twice_and_all_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(several_table, "pictures", cache(several_table.pictures))
    drawn = draw_sets()
    assert {many: len(sets) for many, sets in drawn.items()} == {2: 12, 3: 8, 4: 2, 1: 5}
    for many, sets in drawn.items():
        assert all(len(set(name.split("-"))) == many for name in sets)
        assert len({frozenset(name.split("-")) for name in sets}) == len(sets)
    assert draw_sets() == drawn


@pytest.mark.slow
def test_a_set_is_built_once_and_by_eye_where_its_name_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[str, ...]] = []

    def build(first: str, out: Path, *options: str, printing: bool) -> Built:
        calls.append((first, *options))
        return Built(2, 1.0, 2.0, 3.0, None, "refused")

    monkeypatch.setattr(measurement, "build_apart", build)
    name = next(n for n in NAMED if n.endswith("by-eye"))
    for _ in range(2):
        built = build_set(name, tmp_path)
        assert built["said"] == "refused" and built["code"] == 2 and built["report"] is None
    ((first, second, *options),) = calls
    assert (Path(first).name, Path(second).name) == ("heart.png", "teapot.png")
    with Image.open(first) as picture:
        assert picture.size[0] > 100
    scene = load_scene(Path(options[options.index("--scene") + 1]))
    assert [view.kind for view in scene.views] == ["eye", "eye"]
    assert [view.azimuth_deg for view in scene.views] == [0.0, 90.0]
    assert json.loads((tmp_path / f"{name}.json").read_text())["cpu_s"] == 2.0
