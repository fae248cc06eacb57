"""A sequence from end to end: one knot, its motion within the bound, each frame a verified part."""

import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw
from reports import check_of, report_with

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.part.slicer_process import REMEDY, find_slicer
from knotfab.picture.frames import read_frames
from knotfab.pipeline import film
from knotfab.pipeline.build import run_build
from knotfab.pipeline.film import advise, check_closing, check_motion, list_effects
from knotfab.plan import Attempts
from knotfab.request import Outcome, Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Accuracy, Mount, Piece
from knotfab_formats.report import Motion
from knotfab_formats.scene import Scene
from knotfab_formats.verdict import Check
from knotfab_formats.views import View

FRAME_MM, RADIUS_MM = 45.0, 1.8  # small parts are soon sliced and verified
QUICK = {"coarse_px": 128, "fine_px": 192, "coarse_iterations": 25, "fine_iterations": 25}


def _scene(**keys: object) -> Scene:
    views = (View(name="front", picture="front.png", frame_width_mm=FRAME_MM),)
    return Scene.model_validate(
        {
            "views": views,
            "piece": Piece(tube_radius_mm=RADIUS_MM),
            "accuracy": Accuracy(name="draft"),
            "search": {**QUICK, "depth_candidates": 6},
            **keys,
        }
    )


def _frames(folder: Path, angles: Sequence[float]) -> list[str]:
    """A disc with an arm at each of the angles."""
    names = []
    for number, angle in enumerate(np.deg2rad(angles), start=1):
        image = Image.new("L", (256, 256), 255)
        draw = ImageDraw.Draw(image)
        draw.ellipse([60, 90, 150, 180], fill=0)
        end = 105 + 120 * np.cos(angle), 135 - 120 * np.sin(angle)
        draw.line([105, 135, *end], fill=0, width=34)
        draw.ellipse([end[0] - 17, end[1] - 17, end[0] + 17, end[1] + 17], fill=0)
        names.append(f"{number}.png")
        image.save(folder / names[-1])
    return names


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("sequence")
    names = _frames(folder, (0.0, 16.0))
    request = Request(
        resolve(_scene(mount=Mount(kind="wall"))),
        read_frames(names, base=folder),
        folder / "out",
        printing=True,
        sequence=True,
        command="test",
        skip=frozenset({"shadow-render"}),  # the exact polygons decide
    )
    return run_build(request)


def _points(folder: Path, number: int) -> np.ndarray:
    """The frame's vertices in the scene, by the written pose, with code of the test's own."""
    pose = tomllib.loads((folder / f"scene-{number:02d}.toml").read_text())["pose"]["matrix"]
    knots = json.loads((folder / f"knots-{number:02d}.json").read_text())["knots"]
    assert len(knots) == 1
    points = np.array(knots[0]["points"])
    placed: np.ndarray = np.column_stack([points, np.ones(len(points))]) @ np.array(pose)[:3].T
    return placed


@pytest.mark.build
def test_a_sequence_passes_and_writes_its_files(outcome: Outcome) -> None:
    failed = [c for c in outcome.report["checks"] if c["required"] and c["status"] != "pass"]
    assert (outcome.exit_code, failed) == (0, [])
    names = {p.name for p in outcome.folder.iterdir()}
    for number in ("01", "02"):
        assert {
            *(f"part-{number}.{kind}" for kind in ("stl", "3mf", "glb")),
            f"knots-{number}.json",
        } <= names
        assert {f"scene-{number}.toml", f"picture-frame-{number}.png"} <= names
        assert {f"shadow-frame-{number}.png", f"compare-frame-{number}.png"} <= names
    assert {"report.json", "report.html"} <= names
    page = (outcome.folder / "report.html").read_text(encoding="utf-8")
    linked = re.findall(r'href="([^"#]+)"', page)
    assert {"part-01.3mf", "part-02.3mf", "setup-02.pdf"} <= set(linked) <= names
    assert "<b>part.3mf</b>" not in page
    figures = outcome.report["print"]
    if "time_s" in figures:  # where a slicer is installed
        each = [view["time_s"] for view in outcome.report["views"]]
        assert figures["time_s"] == pytest.approx(sum(each)) and len(each) == 2


@pytest.mark.build
def test_each_frame_hangs(outcome: Outcome) -> None:
    report = outcome.report
    mounts = [view["mount"] for view in report["views"]]
    assert [m["kind"] for m in mounts] == ["wall", "wall"] and min(m["pegs"] for m in mounts) >= 1
    checks = {c["name"]: c for c in report["checks"]}
    assert checks["sag"]["status"] == checks["intrusion"]["status"] == "pass"
    plates = [mount["foot"] == "plate" for mount in mounts]
    for number, mount, plate in zip(("01", "02"), mounts, plates, strict=True):
        scene = tomllib.loads((outcome.folder / f"scene-{number}.toml").read_text())
        assert scene["mount"]["pegs"] == [mount["pegs"] + mount["struts"]]
        # a plate is larger than the frame both ways, pegs alone reach further one way
        solid = trimesh.load_mesh(outcome.folder / f"part-{number}.stl")
        assert solid.is_watertight and ((solid.extents > FRAME_MM).sum() >= 2) == plate
        assert (outcome.folder / f"setup-{number}.pdf").is_file()
    assert set(report["print"]["drawings"]) >= {"setup-01.svg", "setup-02.pdf"}
    # the scene that repeats it asks for the mount, and leaves each frame its own pegs
    whole = tomllib.loads((outcome.folder / "scene.toml").read_text())
    assert whole["mount"]["kind"] == "wall" and not whole["mount"].get("pegs")


@pytest.mark.build
def test_each_frame_is_a_view_with_motion_and_certificate(outcome: Outcome) -> None:
    report = json.loads((outcome.folder / "report.json").read_text())
    first, second = report["views"]
    assert [v["name"] for v in report["views"]] == ["frame-01", "frame-02"]
    assert min(v["iou"] for v in report["views"]) > 0.95
    assert first["motion"] is None
    assert second["motion"]["held"]
    assert first["certificate"]["certified"]
    assert second["certificate"]["certified"]
    assert second["certificate"]["accepted"] > 20
    assert len({k["vertices"] for k in report["knots"]}) == 1
    assert {k["type"] for k in report["knots"]} == {"unknot"}


@pytest.mark.build
def test_the_motion_reported_is_that_of_the_files(outcome: Outcome) -> None:
    one, other = _points(outcome.folder, 1), _points(outcome.folder, 2)
    away = float(np.linalg.norm(one - other, axis=1).max())
    motion = outcome.report["views"][1]["motion"]
    assert motion["largest_mm"] == pytest.approx(away, abs=1e-9)
    assert away <= motion["outline_mm"] + RADIUS_MM
    # the arm's round end goes this far on the wall
    arm = 2 * 120 * np.sin(np.deg2rad(8.0)) / 256 * FRAME_MM
    assert motion["outline_mm"] == pytest.approx(arm, rel=0.1)


def test_motion_beyond_the_bound_fails() -> None:
    bounds = {"outline_mm": 5.0, "limit_mm": 7.0}
    held, not_held = (Motion(**bounds, largest_mm=m, held=m < 7) for m in (6.9, 7.1))
    assert check_motion([held, held]).status == "pass"
    found = check_motion([held, not_held])
    assert (found.status, found.measured, found.required) == ("fail", 7.1, True)
    assert "frame 3" in found.detail
    assert check_closing(not_held).status == "fail"
    assert not check_closing(not_held).required


def test_a_frame_that_fails_comes_with_a_remedy() -> None:
    def view(outline_mm: float | None, *failed: str, pieces: int = 1) -> Any:
        motion = None if outline_mm is None else SimpleNamespace(outline_mm=outline_mm)
        return SimpleNamespace(motion=motion, failed=failed, pieces=pieces, knots=1)

    passed = [view(None), view(3.0), view(4.0)]
    assert advise(passed, 2.0) == []
    (far,) = advise([view(None), view(30.0, "shadow"), view(4.0)], 2.0)
    assert far == (
        "Frame 2 fails (shadow): the outline goes 30 mm from frame 1 to frame 2, 15 tube radii: draw a "
        "frame in between."
    )
    # that it comes from a frame behind it does not matter
    (behind,) = advise([view(None, "recognisable"), view(30.0), view(4.0)], 2.0)
    assert behind.startswith("Frame 1 fails (recognisable): the outline goes 30 mm from frame 1 to")
    (near,) = advise([view(None), view(3.0, "outline")], 2.0)
    assert "its neighbours" in near
    # another frame in between joins no pieces that lie apart
    apart = view(30.0, "recognisable", pieces=2)
    assert "its 2 pieces lie apart" in advise([view(None), apart], 2.0)[0]


@pytest.mark.build
@pytest.mark.skipif(find_slicer() is None, reason=f"PrusaSlicer is not installed: {REMEDY}")
def test_each_frame_is_sliced_as_a_piece_of_its_own(outcome: Outcome) -> None:
    table = outcome.report["slicer"]
    details = [check["detail"] for check in table["checks"]]
    assert {d.split(":")[0] for d in details} == {"part-01.3mf", "part-02.3mf"}
    assert {c["status"] for c in table["checks"]} == {"pass"} and table["objects"] == 2
    assert table["command"].endswith("--output part-N.gcode part-N.3mf")
    (check,) = (c for c in outcome.report["checks"] if c["name"] == "slicer")
    assert (check["status"], check["required"]) == ("pass", True)
    assert outcome.report["print"]["time_s"] == table["time_s"] > 0
    assert (outcome.folder / "slicer.ini").is_file()


HAZE = {"name": "haze", "simulated": True, "seconds": 0.5, "threshold": 1.0, "unit": "px"}
HAZE |= {"forced": False, "reason": ""}


def test_an_effect_counts_in_the_stages_of_all_frames() -> None:
    """The frame that was searched first chose the depth, and another one has the larger magnitude."""
    frames = [
        report_with(effects=[{**HAZE, "magnitude": m, "where": w, "calls": c}])
        for m, w, c in ((2.0, ["depth", "verification"], 20), (3.0, ["verification"], 10))
    ]
    (line,) = list_effects(frames)
    assert (line.magnitude, line.calls, line.seconds) == (3.0, 30, 1.0)
    assert line.where == ("depth", "verification")


class Searched(Exception):
    """All frames were searched."""


@pytest.mark.parametrize("fault", ["limits", "part"])
@pytest.mark.parametrize("otherwise", [True, False])
def test_only_a_sequence_with_no_other_way_goes_on_beyond_a_frame_that_fails(
    fault: str, otherwise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = list[str]()

    def plan_frame(number: int, _: str) -> Any:
        yield from ()
        return SimpleNamespace(made=number)

    def settle(_: Request, __: Any, made: int, ___: Any) -> Any:
        yield from ()
        if made == 1 and fault == "part":
            raise SceneError("the stand", "a wall is near", "Use --mount hang")
        return made, None, None

    def limits(made: int) -> Check:
        return check_of("limits", "fail" if made == 1 and fault == "limits" else "pass")

    def write(*given: Any) -> Any:
        written.append(given[-1])
        return SimpleNamespace(scene=None)

    def end(*_: object) -> None:
        raise Searched

    chain = SimpleNamespace(order=[0, 1, 2], plan=plan_frame)
    fakes = {
        "count_knots": lambda *_: 1,
        "tell_apart": lambda *_: None,
        "Chain": lambda *_: chain,
        "plan_places": settle,
        "check_certificate": lambda _: check_of("isotopy"),
        "check_limits": limits,
        "write_scene": end,
    }
    for name, fake in fakes.items():
        monkeypatch.setattr(film, name, fake)
    progress = SimpleNamespace(total=0.0)
    frames = [SimpleNamespace(name=f"frame-{k}") for k in range(3)]
    scene = SimpleNamespace(piece=SimpleNamespace(knots=None))
    request: Any = SimpleNamespace(
        targets=frames, scene=scene, device=None, otherwise=scene if otherwise else None
    )
    request.budget = lambda _: None
    shop: Any = SimpleNamespace(folder=None, progress=progress, write=write)
    with pytest.raises(SceneError if otherwise else Searched):
        Attempts(Progress("quiet")).carry_out(film.plan_film(shop, request))
    assert written == (["-0"] if otherwise else ["-0", "-1", "-2"])
