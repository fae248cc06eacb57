"""A search goes on from the knots of a file: of the types that it states, and the same again each time."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from command import knotfab, picture, square
from oracles import cast, turn_about
from questions import ask_heart, ask_views, start_and_search

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.effects.base import World
from knotfab.effects.misplacement import Steadying
from knotfab.knots import Knot, Knots, read_start
from knotfab.problem import Problem, Start
from knotfab.scene.camera import camera_of
from knotfab.scene.load import load_scene
from knotfab.start import depth
from knotfab.start.filling import Template, fill
from knotfab.start.lift import lift_template
from knotfab.start.start import start_from_knots
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Mount
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS
from knotfab_formats.views import Placing, Switch

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


# Depth where people place carelessly: there is less, and less of the picture is lost, moved for
# real.


FEW_LIFT = PRESETS["draft"].model_copy(update={"depth_candidates": 16})
RADIUS, DEPTH_MM = 3.0, 90.0
FRAME = shapely.box(-50, -50, 50, 50).difference(shapely.box(-38, -38, 38, 38))
BARS = shapely.MultiPolygon([FRAME.union(shapely.box(-50, -6, 50, 6))])


@pytest.fixture(scope="module")
def problem() -> Problem:
    return replace(ask_views([BARS], 0.0), depth_mm=DEPTH_MM, depth_open=True)


@pytest.fixture(scope="module")
def template() -> Template:
    return fill(BARS, RADIUS)


def _place(
    problem: Problem, template: Template, lamp_mm: float, turn_deg: float, word: Switch = None
) -> Start:
    world = World(placing=Placing(lamp_mm=lamp_mm, turn_deg=turn_deg))
    placed = replace(problem, world=world, switches={"misplacement": word})
    return lift_template(placed, template, RADIUS, FEW_LIFT)


def _extent(start: Start) -> float:
    assert start.depth is not None
    measured = float(np.ptp(np.concatenate(start.curves)[:, 2]))
    assert measured == pytest.approx(start.depth.extent_mm, rel=0.02)
    return start.depth.extent_mm


def _ious(problem: Problem, start: Start, lamp_mm: float, turn_deg: float) -> Array:
    """(6, 2) IoU of the piece's shadow where the lamp is off along an axis or the piece is turned about one.

    With that of the piece as it is: raw, and after the best shift, scale and turn.
    """
    view = problem.views[0].view
    camera, points = camera_of(view, 1, 1), np.concatenate(start.curves)
    ends = np.cumsum([len(c) for c in start.curves])[:-1]
    wide = RADIUS * view.magnification

    def outline(shadow: Array) -> shapely.Geometry:
        rings = [shapely.LinearRing(c) for c in np.split(shadow, ends)]
        return shapely.union_all([ring.buffer(wide, quad_segs=2) for ring in rings])

    was = cast(points, camera.eye, camera)
    moved = [cast(points, camera.eye + lamp_mm * way, camera) for way in np.eye(3)]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for way in np.eye(3):
        turned = middle + (points - middle) @ turn_about(way, np.radians(turn_deg)).T
        moved.append(cast(turned, camera.eye, camera))
    found, truth = [], outline(was)
    for now in moved:
        one, other = ((s - s.mean(axis=0)) @ [1, 1j] for s in (was, now))
        fitted = other * np.vdot(other, one) / np.vdot(other, other)
        back = np.column_stack([fitted.real, fitted.imag]) + was.mean(axis=0)
        shadows = [outline(now), outline(back)]
        found.append([truth.intersection(s).area / truth.union(s).area for s in shadows])
    return np.array(found)


def test_coarser_placing_makes_flatter_pieces_that_lose_less(
    problem: Problem, template: Template
) -> None:
    alike = _place(problem, template, 5.0, 1.0, False)
    usual, coarse = (_place(problem, template, *p) for p in ((5.0, 1.0), (50.0, 5.0)))
    assert _extent(alike) == _extent(usual) == DEPTH_MM  # there it would cost more than it gains
    for one, other in zip(alike.curves, usual.curves, strict=True):
        np.testing.assert_array_equal(one, other)
    assert _extent(coarse) < 0.8 * DEPTH_MM
    deep, flat = (_ious(problem, start, 50.0, 5.0) for start in (alike, coarse))
    # raw: the shadow merely moves; as a person sees it: the worst, and all
    assert flat[:, 0].mean() >= deep[:, 0].mean()
    assert flat[:, 1].min() > deep[:, 1].min() + 0.05
    assert flat[:, 1].mean() > deep[:, 1].mean() + 0.05


def test_what_print_costs_is_weighed_in_the_extent(
    problem: Problem, template: Template, monkeypatch: pytest.MonkeyPatch
) -> None:
    def extent(dearer_by: float, lamp_mm: float, turn_deg: float) -> float:
        """Supports cost so much more at full depth than at none."""

        def supports(judge: depth._Judge, parts: list[Array]) -> Array:
            return np.array([dearer_by * judge.extent_mm / DEPTH_MM])

        monkeypatch.setattr(depth._Judge, "supports", supports)
        return _extent(_place(problem, template, lamp_mm, turn_deg))

    assert extent(0.2, 50.0, 5.0) < extent(0.0, 50.0, 5.0) < extent(-0.2, 50.0, 5.0)
    # by itself that is no reason: what careless placing asks grows from nothing at its threshold
    assert extent(0.2, 5.0, 1.0) == DEPTH_MM


def test_loose_pieces_are_as_deep_with_the_mount_left_open(problem: Problem) -> None:
    loose = fill(
        shapely.MultiPolygon([shapely.box(-50, -40, -8, 40), shapely.box(8, -40, 50, 40)]), RADIUS
    )
    assert len(loose.curves) > 1
    starts = {}
    for kind in ("auto", "wall", "none"):
        placing = Placing(lamp_mm=5.0, turn_deg=10.0)
        world = World.from_scene(Scene(mount=Mount(kind=kind), placing=placing))
        starts[kind] = lift_template(replace(problem, world=world), loose, RADIUS, FEW_LIFT)
    assert _extent(starts["auto"]) == _extent(starts["wall"]) > _extent(starts["none"])
    for one, other in zip(starts["auto"].curves, starts["wall"].curves, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_depth_that_the_scene_gives_is_kept(problem: Problem, template: Template) -> None:
    given = _place(replace(problem, depth_open=False), template, 50.0, 5.0)
    assert _extent(given) == DEPTH_MM and given.effects["misplacement"].calls == 0
    # a rebuild from the depth that was chosen finds the same piece
    chosen = _place(problem, template, 50.0, 5.0)
    again = replace(problem, depth_mm=_extent(chosen), depth_open=False)
    for one, other in zip(chosen.curves, _place(again, template, 50.0, 5.0).curves, strict=True):
        np.testing.assert_array_equal(one, other)


def test_placing_that_is_not_called_for_runs_no_code(
    problem: Problem, template: Template, monkeypatch: pytest.MonkeyPatch
) -> None:
    def explode(*_: object) -> None:
        raise AssertionError("the lamp was moved")

    called = _place(problem, template, 5.0, 1.0).effects["misplacement"]
    assert called.where == ["depth"] and called.calls > 0
    for name in ("lost", "cost"):
        monkeypatch.setattr(Steadying, name, explode)
    for lamp_mm, word in ((0.0, None), (0.0, True), (60.0, False)):
        off = _place(problem, template, lamp_mm, 0.0, word).effects["misplacement"]
        assert off.calls == 0 and off.where == [] and off.seconds == 0.0
    with pytest.raises(AssertionError, match="moved"):
        _place(problem, template, 60.0, 0.0)
