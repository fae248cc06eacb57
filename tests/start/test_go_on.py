"""A search goes on from the knots of a file: of the types that it states, and the same again each time."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command import knotfab, picture, square
from questions import ask_heart, start_and_search

from knotfab.design.design import choose_tube
from knotfab.errors import InputError, SceneError
from knotfab.knots import Knot, Knots, read_start
from knotfab.progress import Progress
from knotfab.scene.load import load_scene
from knotfab.scene.model import Scene
from knotfab.scene.settings import PRESETS
from knotfab.start.start import go_on

T = np.linspace(0, 2 * np.pi, 60, endpoint=False)
TREFOIL = 12.0 * np.stack(
    [np.sin(T) + 2 * np.sin(2 * T), np.cos(T) - 2 * np.cos(2 * T), -np.sin(3 * T)], axis=1
)
FEW = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 96, "fine_px": 96},
        **{"coarse_iterations": 6, "fine_iterations": 3, "settle_iterations": 3},
    }
)


def write(path: Path, held: Knots, **changed: Any) -> Path:
    path.write_text(json.dumps({**json.loads(held.dump_start()), **changed}))
    return path


def test_what_is_written_is_read_to_the_last_bit(tmp_path: Path) -> None:
    knots = Knots((Knot(TREFOIL, "3_1"), Knot(TREFOIL + [100.0, 0, 0], "unknot")), 1.7)
    found = read_start(write(tmp_path / "start.json", knots))
    assert (found.points == knots.points).all() and found.radius_mm == 1.7
    assert [k.type for k in found.knots] == ["3_1", "unknot"]


@pytest.mark.slow
def test_a_search_goes_on_and_keeps_the_type(tmp_path: Path) -> None:
    problem = ask_heart()
    knots = read_start(write(tmp_path / "start.json", Knots((Knot(TREFOIL, "3_1"),), 2.0)))
    start = go_on(problem, knots, knots.radius_mm)
    one, two = (start_and_search(problem, 2.0, FEW, start, repairs=0) for _ in range(2))
    assert (one.knots.points == two.knots.points).all()
    assert one.log.certified and [k.type for k in one.knots.knots] == ["3_1"]


def test_a_start_thinner_than_the_printer_prints_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "start.json", Knots((Knot(TREFOIL, "3_1"),), 0.05))
    settings = FEW.model_copy(update={"start": str(path)})
    question: Any = SimpleNamespace(scene=Scene())  # which leaves the radius to the start
    with pytest.raises(SceneError, match=r"0\.05 mm is thinner than prusa-mk4 prints"):
        choose_tube(question, settings, Progress("quiet"))


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"coordinates": "print"}, "not in the scene's coordinates"),
        ({"knots": []}, "no closed knots"),
        ({"knots": [{"closed": False, "type": "open", "points": TREFOIL.tolist()}]}, "no closed knots"),
        ({"knots": [{"closed": True, "type": "unknot", "points": [[0, 0, 0]]}]}, "no closed knots"),
        ({"radius_mm": float("nan")}, "not finite"),
        ({"radius_mm": None}, "no file of knots"),
        ({"knots": 3}, "no file of knots"),
    ],
)  # fmt: skip
def test_what_is_no_start(tmp_path: Path, changed: dict[str, Any], why: str) -> None:
    path = write(tmp_path / "start.json", Knots((Knot(TREFOIL),), 2.0), **changed)
    with pytest.raises(InputError, match=why):
        read_start(path)


def test_a_scene_names_its_start_beside_it(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('[search]\nstart = "start.json"\n')
    assert load_scene(tmp_path / "scene.toml").search["start"] == str(tmp_path / "start.json")


def test_a_start_that_does_not_serve_is_told_before_the_search(tmp_path: Path) -> None:
    square_ = picture(tmp_path / "p.png", square())
    start = write(tmp_path / "start.json", Knots((Knot(TREFOIL, "3_1"),), 2.0))
    call = ("build", square_, "--out", tmp_path / "out", "--start")
    for more, why in (
        ((tmp_path / "nothing.json",), "cannot be read"),
        ((square_,), "no file of knots"),
        ((start,), "asked for, unknot,"),
        ((start, "--knot", "trefoil", "--free", "view"), "keeps the view"),
        ((start, "--sequence"), "begins with a template"),
    ):
        done = knotfab(*call, *more)
        assert done.code == 2 and why in done.err, done.err
    assert not (tmp_path / "out").exists()
