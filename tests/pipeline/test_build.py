"""The main job end to end: what a build writes, says, refuses, and leaves as it was."""

import json
import re
import shutil
import time
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command import Done, knotfab
from numpy.typing import NDArray
from PIL import Image

import knotfab.part.slicer as slicer
import knotfab.pipeline.plan as planning
from knotfab.design.design import Design
from knotfab.part.slicer_process import NotSliced
from knotfab.render.part_picture import why_undrawn
from knotfab.report.summary import CHECKS
from knotfab_formats.search import PRESETS
from knotfab_formats.verdict import KNOTS, MESH, PRINTING, SHADOWS, UPRIGHT

pytestmark = pytest.mark.build

FILES = {
    "part.stl", "part.3mf", "part.glb", "knots.json", "scene.toml", "report.json", "report.html",
    "shadow-front.png", "compare-front.png", "picture-front.png",
}  # fmt: skip
# groups that are left out whole are not measured: for builds of which only the shadow tells
UNREAD = [f"--skip={name}" for name in ("slicer", *KNOTS, *MESH, "tube", "clearance", *PRINTING)]
UNSEEN = [f"--skip={name}" for name in SHADOWS if name != "intrusion"]
RADIUS = 6.0  # mm: thick, so that a build is short
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class Good:
    """One build that passed, its folder and what it said."""

    def __init__(self, folder: Path, done: Done, design: Design) -> None:
        self.folder, self.done, self.design = folder, done, design
        self.report: dict[str, Any] = json.loads((folder / "report.json").read_text())
        self.knots: dict[str, Any] = json.loads((folder / "knots.json").read_text())


def found(design: Callable[..., Design]) -> Callable[..., Any]:
    """A plan whose one attempt, made for the plan's own reason, is what `design` returns."""

    def plan_searches(*asked: Any) -> Any:
        make, told = partial(design, *asked), {"what": "a search", "why": asked[-1]}
        return (yield SimpleNamespace(**told, make=make, judge=lambda made: "found"))

    return plan_searches


AFTER = {"part on no mount", "piece on no mount"}  # steps of one way, which need no reason


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Good:
    folder = tmp_path_factory.mktemp("good") / "out"
    designs: list[Design] = []

    def design(*arguments: Any) -> Any:
        designs.append((yield from original(*arguments)))
        return designs[-1]

    original = planning.plan_searches
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "plan_searches", design)
        call = ["build", "text:♥", "--tube-radius", str(RADIUS), "--accuracy", "draft"]
        # real slicing takes as long as all the rest: a sequence's build and tests/slicer have it
        bare = "--print", "--mount", "none", "--supports", "slicer", "--skip", "slicer"
        done = knotfab(*call, *bare, "--out", folder)
    assert done.code == 0, done
    return Good(folder, done, designs[0])


@pytest.fixture
def designed(good: Good, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A build whose search is done already: only what follows it runs."""
    monkeypatch.setattr(planning, "plan_searches", found(lambda *_: good.design))
    return ["build", "text:♥", "--tube-radius", str(RADIUS)]


def checks_of(folder: Path) -> dict[str, dict[str, Any]]:
    report = json.loads((folder / "report.json").read_text())
    return {c["name"]: c for c in report["checks"]}


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def black_on_white(path: Path) -> NDArray[np.bool_]:
    return np.asarray(Image.open(path).convert("L")) < 128


# --- a good build ---


def test_all_files_of_the_contract_and_what_is_said_before(good: Good) -> None:
    names = {p.name for p in good.folder.iterdir()}
    assert names >= FILES and not any(n.startswith(".") for n in names)
    assert "rejected" not in names
    drawings = {"setup.pdf", "setup.svg"}  # nothing is drilled for a piece without a mount
    assert {n for n in names if n.startswith(("setup", "drill"))} == drawings
    assert good.report["print"]["drawings"] == sorted(drawings)
    said = good.done.err.splitlines()
    assert said == good.report["settings"]["preview"] and len(said) == 3
    assert good.done.out.startswith("pass") and str(good.folder) in good.done.out


def test_the_report_has_the_keys_of_the_contract(good: Good) -> None:
    report = good.report
    assert (report["schema"], report["status"]) == (1, "pass")
    (view,) = report["views"]
    assert (view["name"], view["kind"], view["picture"]) == ("front", "shadow", "picture-front.png")
    assert 0 <= view["told"]["door"] <= view["told"]["worst"]["share"] <= 1
    assert 0.95 < view["iou"] == view["iou_tube"] <= 1
    assert min(view["precision"], view["recall"]) > 0.95
    assert 0 <= view["outline_error_px"] <= PRESETS["draft"].outline_px
    fine = 1024 / max(view["width"], view["height"])
    pixel_mm = 180 / max(view["width"], view["height"]) / fine
    assert view["outline_error_mm"] == pytest.approx(view["outline_error_px"] * pixel_mm, rel=1e-6)
    for check in report["checks"]:
        assert check["status"] != "fail" and isinstance(check["required"], bool)
        assert check["status"] == "pass" or not check["required"]
        assert set(check) >= {
            "name", "status", "required", "measured", "limit", "unit", "detail",
        }  # fmt: skip
    for effect in report["effects"]:
        assert set(effect) >= {
            "name", "simulated", "forced", "where", "magnitude", "threshold", "unit", "calls",
            "seconds", "reason",
        }  # fmt: skip
        assert effect["simulated"] == (effect["calls"] > 0) == bool(effect["where"])
    limits = {limit["name"]: limit for limit in report["limits"]}
    assert set(limits) == {"clearance", "bend", "region", "length"}
    effects = {effect["name"] for effect in report["effects"]}
    assert "penumbra" in effects and effects.isdisjoint(limits)
    assert min(limits["clearance"]["calls"], limits["bend"]["calls"]) > 0
    assert limits["length"]["calls"] == 0  # 50 m are never near
    for name, limit in limits.items():
        beyond = limit["measured"] - limit["limit"]
        assert beyond >= 0 if name in ("clearance", "bend") else beyond <= 0
    timings = report["timings"]
    assert {"picture", "search", "part", "verify", "total"} <= set(timings)
    assert timings["total"] >= sum(v for k, v in timings.items() if k != "total") - 0.01
    (knot,) = report["knots"]
    assert knot["type"] == "unknot" and knot["vertices"] == len(good.knots["knots"][0]["points"])
    piece, settings = report["print"], report["settings"]
    assert piece["printer"] == "prusa-mk4" and piece["depth_ratio"] >= 0.6
    volume = np.pi * RADIUS**2 * knot["length_mm"]
    assert piece["volume_mm3"] == pytest.approx(volume, rel=1e-3)
    assert piece["mass_g"] == pytest.approx(volume * 1.24e-3, rel=1e-3)
    assert settings["tube_radius_mm"] == RADIUS and settings["accuracy"] == "draft"
    assert {"seed", "versions", "command", "search"} <= set(settings)


def test_reported_knots_are_those_of_the_file(good: Good) -> None:
    points = np.array(good.knots["knots"][0]["points"])
    (knot,) = good.report["knots"]
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    assert knot["length_mm"] == pytest.approx(edges.sum())
    checks = checks_of(good.folder)
    assert knot["thickness_mm"] == pytest.approx(checks["thickness"]["measured"], rel=1e-6)
    assert knot["min_bend_radius_mm"] == pytest.approx(checks["bend"]["measured"], rel=1e-6)
    assert good.knots["radius_mm"] == RADIUS and good.knots["unit"] == "mm"


def test_the_projection_takes_the_knots_into_the_silhouette(good: Good) -> None:
    (view,) = good.report["views"]
    ink = black_on_white(good.folder / view["picture"])
    assert ink.shape == (view["height"], view["width"])
    points = np.concatenate([k["points"] for k in good.knots["knots"]])
    points = np.column_stack([points, np.ones(len(points))])
    u, v, w = np.array(view["projection"]) @ points.T
    assert (w > 0).all()
    at = np.rint(np.stack([v / w, u / w])).astype(int)
    assert ink[tuple(at)].mean() > 0.99
    # not merely somewhere inside: the strands come within a tube's width of the whole outline
    assert at.min(axis=1) == pytest.approx(np.argwhere(ink).min(axis=0), abs=25 * RADIUS)
    assert at.max(axis=1) == pytest.approx(np.argwhere(ink).max(axis=0), abs=25 * RADIUS)
    assert (points @ np.array(view["receiver"]) > 0).all()
    assert np.linalg.norm(view["receiver"][:3]) == pytest.approx(1.0)


def test_the_part_stands_on_the_bed_in_millimetres(good: Good) -> None:
    facets = np.frombuffer((good.folder / "part.stl").read_bytes()[84:], dtype=FACET)
    low, high = (f(facets["corners"].reshape(-1, 3), axis=0) for f in (np.min, np.max))
    assert low == pytest.approx([0, 0, 0], abs=1e-4)
    assert high == pytest.approx(good.report["print"]["bounding_box_mm"], abs=1e-3)
    points = np.concatenate([k["points"] for k in good.knots["knots"]])
    assert points.min(axis=0) - low == pytest.approx([RADIUS] * 3, abs=0.1)


def test_the_report_page_opens_offline(good: Good) -> None:
    """What it shows is inside; its links lead to the files beside it, and its policy lets nothing load."""
    whole = (good.folder / "report.html").read_text(encoding="utf-8")
    assert "default-src 'none'; img-src data:" in whole and "<script src" not in whole
    page = re.sub("<script.*?</script>", "", whole, flags=re.DOTALL)
    for link in re.findall(r'href="([^"]+)"', page):
        assert (good.folder / link).is_file(), link
    for address in re.findall(r"""(?:src|url)\s*[=(]\s*["']?([^"')\s>]+)""", page):
        assert address.startswith("data:"), address
    assert "@import" not in page
    assert page.count("data:image/png;base64,") >= 2


def test_every_attempt_is_told_with_what_came_of_it(good: Good) -> None:
    told = good.report["attempts"]
    assert told[0]["what"].startswith("search: ")
    ended = [one["ended"] for one in told if "search" in one["what"]]
    assert all(
        re.match(r"all \d+ iterations(, then \d+ rounds? of repairs, )?", one) for one in ended
    )
    assert not any("ended" in one for one in told if one["what"].startswith(("part", "piece")))
    assert [one["what"] for one in told[-2:]] == ["part on no mount", "piece on no mount"]
    assert told[-1]["outcome"].startswith("passes every check") and "why_next" not in told[-1]
    assert all("why_next" in one or told[k + 1]["what"] in AFTER for k, one in enumerate(told[:-1]))
    assert sum(one["seconds"] for one in told) <= good.report["timings"]["total"]


def test_the_scene_is_resolved(good: Good) -> None:
    text = (good.folder / "scene.toml").read_text(encoding="utf-8")
    scene = tomllib.loads(text)
    assert not {"ink", "threshold", "crop_px"} & set(scene["views"][0])  # its picture is a mask
    assert set(scene["effects"].values()) == {"auto"}  # rules, by which it is decided again
    assert scene["piece"]["bend"] == "auto"  # several pictures have their bending in their views
    # lamps that share a wall have places, and one view has not
    assert scene["lamps"]["places"] == "auto"
    # what holds nothing is settled where something holds the piece
    assert {scene["mount"][key] for key in ("max_sag_mm", "plate_thickness_mm", "plate")} == {
        "auto"
    }
    assert text.count('"auto"') == 7 + len(scene["effects"])
    assert scene["piece"]["tube_radius_mm"] == RADIUS and scene["piece"]["knots"] == 1
    assert scene["piece"]["depth"] > 50
    assert {"seed", "coarse_iterations", "fine_px", "mesh_sides"} <= set(scene["search"])
    assert np.array(scene["pose"]["matrix"]).shape == (4, 4)
    assert scene["views"][0]["picture"] == "picture-front.png"


def test_the_resolved_scene_gives_the_same_part_quietly(good: Good, tmp_path: Path) -> None:
    again = tmp_path / "again"
    scene = good.folder / "scene.toml"
    call = ["build", "--scene", scene, "--print", *UNREAD]  # the parts are alike or not
    done = knotfab(*call, "--out", again, "--quiet")
    assert done == Done(0, "", "")
    for name in (
        *("part.stl", "knots.json", "scene.toml", "picture-front.png", "shadow-front.png"),
        *("setup.pdf", "setup.svg"),
    ):
        assert (again / name).read_bytes() == (good.folder / name).read_bytes(), name


@pytest.mark.parametrize("again", [False, pytest.param(True, marks=pytest.mark.study)])
def test_a_printed_piece_gets_the_cheapest_holder_and_the_scene_gives_it_again(
    good: Good, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: bool
) -> None:
    def design(scene: Any, *_: Any) -> Design:
        made = good.design.scene
        return replace(good.design, scene=made.but(mount=scene.mount, pose=scene.pose))

    monkeypatch.setattr(planning, "plan_searches", found(design))
    out, repeated = tmp_path / "out", tmp_path / "again"
    call = ["build", "text:♥", "--tube-radius", str(RADIUS), "--accuracy", "draft", "--print"]
    call += [*UNREAD, *UNSEEN, "--skip", "shadow-render", "--quiet"]
    assert knotfab(*call, "--supports", "slicer", "--out", out).code == 0
    report = json.loads((out / "report.json").read_text())
    mount = tomllib.loads((out / "scene.toml").read_text())["mount"]
    assert mount["kind"] == report["print"]["mount"]["kind"] == "hang" and mount["turns"] is True
    (note,) = (note for note in report["notes"] if note.startswith("Held by eyelets"))
    assert (
        re.search(r"more for a stand \(some [0-9.]+ g and [0-9.]+ h", note)
        and "a wall mount" in note
    )
    assert checks_of(out)["level"]["status"] == checks_of(out)["sag"]["status"] == "pass"
    if again:
        call = ["build", "--scene", out / "scene.toml", "--print", *UNREAD, "--quiet"]
        assert knotfab(*call, "--out", repeated).code == 0
        assert (repeated / "part.stl").read_bytes() == (out / "part.stl").read_bytes()


def test_skip_knows_every_check_of_a_report(good: Good) -> None:
    own = {"3mf", "isotopy", "limits"}  # the build's, not the validators'
    of_others = (  # of pieces that hang, stand on a table, or have several lamps
        "shadow-render intrusion slicer level colours lamp_colours "
        "table_mesh table_bars table table_shadow"
    )
    sometimes = {*of_others.split(), *UPRIGHT}
    assert set(checks_of(good.folder)) - own == set(CHECKS) - sometimes


@pytest.mark.skipif(why_undrawn() is not None, reason="OpenGL is missing")
def test_all_is_drawn_and_the_verdict_told_while_it_slices(
    designed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wait_for_pictures(part: Path, *_: Any) -> NotSliced:
        until = time.monotonic() + 100
        while not part.with_name("unlit.png").is_file() and time.monotonic() < until:
            time.sleep(0.02)
        found = "all drawn" if time.monotonic() < until else "not drawn"
        return NotSliced("stopped", found)

    monkeypatch.setattr(slicer, "slice_part", wait_for_pictures)
    unread = (word for word in UNREAD if word != "--skip=slicer")
    call = [*designed, "--accuracy", "draft", "--print", "--mount", "none", "--supports", "slicer"]
    done = knotfab(*call, *unread, "--out", tmp_path / "out")
    assert done.code == 0 and "not known: all drawn" in done.out
    assert "verified, faithful; PrusaSlicer is slicing" in done.err


@pytest.mark.study
def test_what_does_not_print_without_supports_is_built_again_with_them(
    good: Good, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The strands of the good piece are no arches; its folder then holds what the slicer's way gives."""
    ways: list[str] = []

    def design(scene: Any, *_: Any) -> Design:
        ways.append(scene.piece.supports)
        piece = good.design.scene.piece.but(supports=ways[-1])
        return replace(good.design, scene=good.design.scene.but(piece=piece))

    monkeypatch.setattr(planning, "plan_searches", found(design))
    out = tmp_path / "out"
    call = ["build", "text:♥", "--tube-radius", str(RADIUS), "--accuracy", "draft"]
    way = "--print", "--mount", "none", "--supports", "auto"
    # what is printed decides: the same files with all their checks are the good piece's
    unread = (f"--skip={name}" for name in ("slicer", "shadow-render", *KNOTS, "tube", "clearance"))
    done = knotfab(*call, *way, *unread, "--out", out)
    assert done.code == 0 and ways == ["none", "slicer"]
    assert "Built again with the slicer's supports" in done.err and "islands" in done.err
    assert not (out / "rejected").exists()
    for name in ("part.stl", "part.3mf", "knots.json"):
        assert (out / name).read_bytes() == (good.folder / name).read_bytes()
    timings = json.loads((out / "report.json").read_text())["timings"]
    assert timings["total"] >= sum(v for k, v in timings.items() if k != "total") - 0.01


# --- validate and shadow, on what it wrote ---


def test_validate_agrees_with_the_report(good: Good) -> None:
    done = knotfab("validate", good.folder, "--json")
    answer = json.loads(done.out)
    assert (done.code, answer["status"], done.err) == (0, "pass", "")
    reported = checks_of(good.folder)
    for check in answer["checks"]:
        assert check == reported[check["name"]]
    assert answer["views"][0]["iou"] == good.report["views"][0]["iou"]


def test_validate_rejects_a_part_that_was_changed(good: Good, tmp_path: Path) -> None:
    """It was moved by a millimetre behind knotfab's back."""
    folder = tmp_path / "moved"
    shutil.copytree(good.folder, folder)
    data = (folder / "part.stl").read_bytes()
    facets = np.frombuffer(data[84:], dtype=FACET).copy()
    facets["corners"] += np.array([0.0, 1.0, 0.0], dtype="<f4")
    (folder / "part.stl").write_bytes(data[:84] + facets.tobytes())
    others = [f"--skip={name}" for name in CHECKS if name != "tube"]
    done = knotfab("validate", folder, "--json", *others)
    answer = json.loads(done.out)
    assert (done.code, answer["status"]) == (1, "fail")
    assert "tube" in {c["name"] for c in answer["checks"] if c["status"] == "fail"}


def test_shadow_draws_the_verified_shadow(good: Good, tmp_path: Path) -> None:
    png = tmp_path / "deep" / "shadow.png"
    scene = good.folder / "scene.toml"
    done = knotfab("shadow", good.folder / "part.stl", "--scene", scene, "--out", png)
    assert (done.code, done.err) == (0, "") and str(png) in done.out
    drawn, reported = black_on_white(png), black_on_white(good.folder / "shadow-front.png")
    assert 0.05 < drawn.mean() < 0.95
    assert (drawn == reported).all()
    assert [p.name for p in png.parent.iterdir()] == ["shadow.png"]


def test_shadow_leaves_nothing_where_it_cannot_write(good: Good, tmp_path: Path) -> None:
    place = tmp_path / "folder.png"
    place.mkdir()
    call = ["shadow", good.folder / "part.stl", "--scene", good.folder / "scene.toml"]
    done = knotfab(*call, "--out", place)
    assert done.code == 2 and done.err.startswith("knotfab: ") and done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [place]
    done = knotfab(*call, "--out", tmp_path / "x.png", "--view", "back")
    assert done.code == 2 and "no such view" in done.err


# --- builds that do not pass ---


def test_a_failed_check_rejects_the_whole_and_keeps_the_earlier(
    good: Good, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = good.design.scene
    strict = asked.accuracy.model_copy(update={"iou_floor": 0.9999})
    stricter = replace(good.design, scene=asked.model_copy(update={"accuracy": strict}))
    monkeypatch.setattr(planning, "plan_searches", found(lambda *_: stricter))
    out = tmp_path / "out"
    shutil.copytree(good.folder, out)
    before = contents(out)
    call = ["build", "text:♥", "--tube-radius", "7", "--out", out, "--print", "--mount", "none"]
    call += ["--supports", "slicer", *UNREAD, "--verbose"]
    done = knotfab(*call)
    assert done.code == 1
    # the design handed in has another tube than the preview told, which is said
    assert done.out.startswith("fail  ")
    assert re.search("warn: the piece is not as the preview said: .*its tube is ", done.out)
    assert "shadow" in done.out and str(out / "rejected") in done.out
    assert re.search(r"^part: \d+\.\d\d s$", done.err, re.MULTILINE)
    after = contents(out)
    rejected = {k.removeprefix("rejected/"): v for k, v in after.items() if "rejected/" in k}
    assert {k: v for k, v in after.items() if "rejected/" not in k} == before
    assert set(rejected) - {"failures.png"} == set(before)
    assert rejected["part.stl"] == before["part.stl"]
    report = json.loads(rejected["report.json"])
    assert report["status"] == "fail"
    assert [c["name"] for c in report["checks"] if c["status"] == "fail"] == [
        "shadow",
        "half_light",
    ]


def test_a_verifier_that_crashes_leaves_nothing(
    designed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crashing = tmp_path / "python"
    crashing.write_text("#!/bin/sh\nulimit -c 0\nread line\nkill -SEGV $$\n")
    crashing.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(crashing))
    done = knotfab(*designed, "--out", tmp_path / "out")
    assert done.code == 3
    assert done.err.splitlines()[-1].startswith("knotfab: verification")
    assert done.err.count("knotfab: ") == 1
    assert "SIGSEGV" in done.err and "--skip shadow-render" in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["python"]
