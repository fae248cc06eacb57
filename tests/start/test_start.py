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

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.knots import Knot, Knots, read_start
from knotfab.scene.load import load_scene
from knotfab.start.start import start_from_knots
from knotfab_formats.errors import InputError
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS

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


def _lay_part(folder: Path, suffix: str = "") -> tuple[Path, Knots, np.ndarray]:
    """A part that lies turned, shifted and enlarged: knots.json, its knots, and the way to the scene."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn)) / 1.02  # printed larger, for it shrinks
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, [30.0, -20.0, 7.0]
    lies = Knots((Knot(TREFOIL, "3_1"),), 1.7)
    lies.write(folder / f"knots{suffix}.json")
    (folder / f"scene{suffix}.toml").write_text(f"[pose]\nmatrix = {matrix.tolist()}\n")
    return folder / f"knots{suffix}.json", lies, matrix


@pytest.mark.parametrize("suffix", ["", "-02"])
def test_the_knots_of_a_part_are_taken_back_to_its_scene(tmp_path: Path, suffix: str) -> None:
    path, lies, matrix = _lay_part(tmp_path, suffix)
    found = read_start(path)
    there = lies.points @ matrix[:3, :3].T + matrix[:3, 3]
    assert found.points == pytest.approx(there, abs=1e-12)
    assert found.radius_mm == round(1.7 / 1.02, 6) and found.knots[0].type == "3_1"
    if not suffix:
        assert (read_start(tmp_path).points == found.points).all()  # the folder does as well


@pytest.mark.parametrize(
    "scene", [None, "", "[pose]\n", "[pose]\nmatrix = [[1, 2]]\n", "[pose]\nmatrix = 'x'\n", "[["]
)
def test_a_part_without_a_pose_is_no_start(tmp_path: Path, scene: str | None) -> None:
    path, _, _ = _lay_part(tmp_path)
    if scene is None:
        (tmp_path / "scene.toml").unlink()
    else:
        (tmp_path / "scene.toml").write_text(scene)
    with pytest.raises(InputError, match=r"as they are printed, and no scene\.toml"):
        read_start(path)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"knots": [{"closed": True, "type": "unknot", "points": []}]}, "no closed knots"),
        ({"knots": [{"closed": True, "type": "unknot", "points": [[0, 0]] * 9}]}, "knot 0: points must be"),
        ({"radius_mm": 10**400}, "no file of knots"),
    ],
)  # fmt: skip
def test_a_damaged_part_is_told_before_it_is_moved(
    tmp_path: Path, changed: dict[str, Any], why: str
) -> None:
    path, _, _ = _lay_part(tmp_path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))
    with pytest.raises(InputError, match=why):
        read_start(path)


def test_the_thinnest_tube_stays_no_thinner(tmp_path: Path) -> None:
    path, lies, matrix = _lay_part(tmp_path)
    for shrunk in np.random.default_rng(4).uniform(0.95, 1.0, 50):
        scale = np.cbrt(np.linalg.det(matrix[:3, :3]))
        Knots(lies.knots, 0.8 / scale * (1 + 1e-15 * shrunk)).write(path)
        assert read_start(path).radius_mm == 0.8


@pytest.mark.slow
def test_a_search_goes_on_and_keeps_the_type(tmp_path: Path) -> None:
    problem = ask_heart()
    knots = read_start(write(tmp_path / "start.json", Knots((Knot(TREFOIL, "3_1"),), 2.0)))
    start = start_from_knots(problem, knots, knots.radius_mm)
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
        ({"coordinates": "print"}, "lie as they are printed, and no start.toml"),
        ({"knots": []}, "no file of knots: .* at least one knot"),
        ({"knots": [{"closed": False, "type": "open", "points": TREFOIL.tolist()}]}, "no closed knots"),
        ({"knots": [{"closed": True, "type": "unknot", "points": [[0, 0, 0]]}]}, "no closed knots"),
        ({"radius_mm": float("nan")}, "radius_mm must be a number above 0, got nan"),
        ({"radius_mm": None}, "no radius_mm"),
        ({"knots": 3}, "no file of knots: knots must be a list"),
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
        ((tmp_path / "nothing.json",), "no such file"),
        ((square_,), "not a UTF-8 text"),
        ((start,), "asked for, unknot,"),
        ((start, "--knot", "trefoil", "--free", "view"), "keeps the view"),
        ((start, "--sequence"), "begins with a template"),
    ):
        done = knotfab(*call, *more)
        assert done.code == 2 and why in done.err, done.err
    assert not (tmp_path / "out").exists()
