"""Limits under watch: a term that cannot be felt is not called, and leaving it out changes nothing."""

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import questions
import validator_parts
from command import knotfab
from numpy.typing import NDArray
from oracles import state_at
from questions import ask_heart, ask_quick, start_and_search
from validator_parts import box_mesh

from knotfab.base.arrays import Array
from knotfab.design.retries import SHORT
from knotfab.limits import feasibility as guards
from knotfab.limits.region import REGION, mesh_excess, region_excess, region_mesh, tube_outside
from knotfab.limits.terms import LENGTH, Guard, Limit, Limits
from knotfab.part.files import write_stl
from knotfab.scene.load import load_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS
from knotfab_formats.verdict import KNOTS, MESH

QUICK = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 64, "coarse_iterations": 12, "depth_candidates": 2},
        **{"fine_px": 64, "fine_iterations": 6, "settle_iterations": 4},
    }
)
# files left out whole are not measured: only the limits tell
UNREAD = [f"--skip={name}" for name in (*KNOTS, *MESH, "tube", "clearance")]
SIDE = 100.0
SIZES: dict[str, tuple[float, float, float]] = {
    "box": (SIDE,) * 3, "cylinder": (SIDE, SIDE, SIDE), "sphere": (SIDE,) * 3, "mesh": (SIDE,) * 3,
}  # fmt: skip


def ring(n: int = 120) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([40 * np.cos(t), 40 * np.sin(t), 6 * np.cos(5 * t)])


def limits(tmp_path: Path, kind: str = "box", length: float = 1e5) -> Limits:
    named: Any = {"kind": kind, "size_mm": SIZES[kind]}
    if kind == "mesh":
        named["file"] = str(tmp_path / "room.stl")
        box = box_mesh(SIZES[kind])
        write_stl(tmp_path / "room.stl", [(box.vertices, box.faces.astype(np.int32))])
    return Limits(2.0, 0.4, 2.2, length, SettledRegion(**named))


def value_and_slope(term: Callable[..., Any], points: Array, lim: Limits) -> tuple[float, Array]:
    value, slope = term(state_at(points), lim)
    return value, slope


def walk(steps: int, seed: int) -> list[Array]:
    """A ring that drifts and swells until it is long and far outside, by steps of up to a radius."""
    rng = np.random.default_rng(seed)
    found, points = [], ring()
    for step in range(steps):
        points = points * 1.002 + rng.normal(0, 0.02, points.shape) + [0.01 * step, 0.0, 0.004]
        found.append(points)
    return found


def test_walls_end_the_region() -> None:
    """A wall that leans over the middle: what stands behind it is pushed straight out of it."""
    normal = np.array([0.6, 0.0, 0.8])
    walls = ((*normal.tolist(), 10.0),)
    region = SettledRegion(size_mm=(200.0, 200.0, 200.0))
    points = np.random.default_rng(0).uniform(-99, 99, (500, 3))
    free, excess = region_excess(points, region, 2.0)[0], region_excess(points, region, 2.0, walls)
    assert excess[0] == pytest.approx(np.maximum(free, 2.0 - points @ normal - 10.0))
    behind = excess[0] > free
    assert 50 < behind.sum() < 450
    assert np.abs(excess[1][behind] + normal).max() < 1e-12


@pytest.mark.parametrize("kind", list(SIZES))
def test_a_region_that_is_not_felt_is_nothing(tmp_path: Path, kind: str) -> None:
    lim, guard, looks = limits(tmp_path, kind), Guard(REGION), 0
    felt = 0
    for points in walk(50, 1):
        before = guard._seen
        term = guard.term(state_at(points), lim)
        looks += guard._seen is not before
        value, slope = value_and_slope(REGION.term, points, lim)
        if term is None:
            assert value == 0.0 == np.abs(slope).max()
        else:
            felt += 1
            assert term[0] == value
    assert 5 < felt == guard.calls < 45
    assert looks - felt < 45 - felt  # and not every step was looked at


def test_a_length_that_is_not_felt_is_nothing(tmp_path: Path) -> None:
    way = walk(50, 2)
    spans = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum() for p in way]
    lim, guard = limits(tmp_path, length=float(np.median(spans))), Guard(LENGTH)
    for points in way:
        term = guard.term(state_at(points), lim)
        value, slope = value_and_slope(LENGTH.term, points, lim)
        if term is None:
            assert value == 0.0 == np.abs(slope).max()
        else:
            assert term[0] == value
    assert 5 < guard.calls < 45


@pytest.mark.parametrize("kind", [*SIZES, "length"])
def test_slopes_are_those_of_finite_differences(tmp_path: Path, kind: str) -> None:
    lim = limits(tmp_path) if kind == "length" else limits(tmp_path, kind)
    limit = LENGTH if kind == "length" else REGION
    lim = replace(lim, length=150.0)
    points, rng, h = ring() * [1.4, 1.3, 1.0] + 0.1, np.random.default_rng(3), 1e-5
    value, slope = value_and_slope(limit.term, points, lim)
    assert value > 0
    # the mean edge's part in a weight is no part of a slope: along moves that keep it there is none
    for _ in range(6):
        way = rng.normal(size=points.shape)
        way -= way.mean(axis=0)
        ahead, behind = (value_and_slope(limit.term, points + s * way, lim)[0] for s in (h, -h))
        grown = [state_at(points + s * h * way).spacing for s in (1, -1)]
        of_weight = 0.0
        if limit is REGION and kind != "mesh":
            of_weight = value / state_at(points).spacing * (grown[0] - grown[1]) / (2 * h)
        found = (ahead - behind) / (2 * h) - of_weight
        if kind == "mesh":
            assert found == pytest.approx(float((slope * way).sum()), rel=0.1, abs=0.05 * value)
        else:
            assert found == pytest.approx(float((slope * way).sum()), rel=1e-4, abs=1e-5 * value)


@pytest.mark.slow
def test_an_unfelt_limit_runs_no_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> None:
        raise AssertionError("a limit that cannot be felt was called")

    problem = ask_heart()
    disarmed = [
        replace(one, term=explode) if one.name in ("region", "length") else one
        for one in guards.LIMITS
    ]
    monkeypatch.setattr(guards, "LIMITS", disarmed)
    result = start_and_search(problem, 4.0, QUICK, repairs=0)
    assert result.guards["region"].calls == 0 == result.guards["length"].calls
    assert result.guards["clearance"].calls == result.guards["bend"].calls == 22
    # and where the scene calls for it, it does run: the heart's box is 40 mm too small
    tight = replace(problem, region=SettledRegion(size_mm=(100.0, 100.0, 180.0)))
    with pytest.raises(AssertionError, match="cannot be felt"):
        start_and_search(tight, 4.0, QUICK, repairs=0)


@pytest.mark.slow
def test_watching_changes_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A budget that only comes to be felt along the walk, watched and always called: the same knots."""
    problem = ask_heart()
    free = start_and_search(problem, 4.0, QUICK, repairs=0)
    length = sum(knot.length_mm for knot in free.knots.knots)
    tight = replace(problem, length=0.995 * length)
    watched = start_and_search(tight, 4.0, QUICK, repairs=0)
    always: list[Limit] = [replace(one, slack=None) for one in guards.LIMITS]
    monkeypatch.setattr(guards, "LIMITS", always)
    called = start_and_search(tight, 4.0, QUICK, repairs=0)
    assert 0 < watched.guards["length"].calls < called.guards["length"].calls == 22
    assert (watched.knots.points == called.knots.points).all()


# A region that is a closed mesh: exact signed distances with a gradient, and its way into a
# build.


Mesh = tuple[Array, NDArray[np.int32]]


def prism(*outline: tuple[float, float], half: float) -> Mesh:
    mesh = validator_parts.prism(*outline, low=-half, high=half)
    return mesh.vertices, mesh.faces.astype(np.int32)


BOX = prism((-30, -20), (30, -20), (30, 20), (-30, 20), half=10)
WEDGE = prism((0, 5), (-9, 60), (-60, 60), (-60, -60), (60, -60), (60, 60), (9, 60), half=30)


def region(
    folder: Path, mesh: Mesh, center: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> SettledRegion:
    path = folder / "room.stl"
    write_stl(path, [mesh])
    region_mesh.cache_clear()
    return SettledRegion(
        kind="mesh", file=str(path), center_mm=center, size_mm=(200.0, 200.0, 200.0)
    )


def test_distances_to_a_box_are_exact_at_faces_edges_and_corners(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-45, 45, (4000, 3))
    q = np.abs(points) - [30, 20, 10]
    exact = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    found = region_excess(points, region(tmp_path, BOX), 0.0)[0]
    assert np.abs(found - exact).max() < 1e-9
    moved = region(tmp_path, BOX, (1.0, 2.0, 3.0))
    again = region_excess(points + [1, 2, 3], moved, 2.5)[0]
    assert np.abs(again - 2.5 - exact).max() < 1e-9


def test_sides_are_right_about_an_edge_that_pokes_in(tmp_path: Path) -> None:
    """Points nearest to a sharp edge: the nearest faces alone would put some on the wrong side."""
    r = region(tmp_path, WEDGE)
    points = np.random.default_rng(1).uniform([-15, -5, -25], [15, 25, 25], (4000, 3))
    x, y = np.abs(points[:, 0]), points[:, 1]
    in_wedge = (y > 5) & (x < 9 / 55 * (y - 5))
    found = region_excess(points, r, 0.0)[0]
    assert np.array_equal(found > 0, in_wedge)


def test_the_gradient_leads_inwards(tmp_path: Path) -> None:
    mesh = region_mesh(str(region(tmp_path, WEDGE).file), (0.0, 0.0, 0.0))
    points = np.random.default_rng(2).uniform(-70, 70, (200, 3))
    value, slope = mesh_excess(points, mesh)
    assert np.linalg.norm(slope, axis=1) == pytest.approx(np.ones(200))
    ahead, _ = mesh_excess(points - 1e-4 * slope, mesh)
    assert value - ahead == pytest.approx(np.full(200, 1e-4), rel=1e-3)


def test_what_the_search_accepts_is_inside(tmp_path: Path) -> None:
    """The wedge's edge stands between two vertices: only the enlarged radius keeps it out."""
    r = region(tmp_path, WEDGE)
    x = np.linspace(-20.3, 20.3, 30)  # the edge at x = 0 is midway between two vertices
    for gap in np.linspace(1.95, 2.1, 16):
        line = np.column_stack([x, np.full(30, 5.0 - gap), np.zeros(30)])
        points, excess = tube_outside(line[:-1], line[1:], Limits(2.0, 0.4, 2.2, 100.0, r))
        assert len(points) == 58
        if gap < 2.0:
            assert excess.max() > 0
        if gap > 2.04:  # and not by much more than is needed
            assert excess.max() < 0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no STL file"),
        (b"solid x\nendsolid x", "no STL file"),
        (b"solid\nvertex 1 2 x\n", "not three numbers"),
        (b"solid\nvertex 0 0 0 vertex 1 0 0 vertex 0 1 nan", "not finite"),
        (b"solid\nvertex 0 0 0 vertex 1 0 0 vertex 0 1 0", "not a closed surface"),
        (b"\xff" * 84, "no STL file"),
        (None, "no such file"),
    ],
)
def test_a_mesh_that_is_no_region_is_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    path = tmp_path / "bad.stl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        region_mesh(str(path), (0.0, 0.0, 0.0))
    assert caught.value.exit_code == 2 and "bad.stl" in str(caught.value)


def test_holes_and_an_inside_out_mesh_are_refused(tmp_path: Path) -> None:
    vertices, faces = BOX
    for wrong, words in ((faces[1:], "not a closed"), (faces[:, ::-1], "inside out")):
        with pytest.raises(InputError, match=words):
            region_excess(np.zeros((1, 3)), region(tmp_path, (vertices, wrong)), 0.0)


def test_a_scene_names_its_mesh_beside_itself(tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text('[region]\nkind = "mesh"\nfile = "sub/room.stl"\n')
    assert load_scene(tmp_path / "my.toml").region.file == os.path.join(tmp_path, "sub", "room.stl")
    for text, words in (
        ('kind = "mesh"', "names no file"),
        ('file = "room.stl"', 'goes with kind = "mesh"'),
        ('kind = "mesh"\nfile = 3', "text in quotes"),
    ):
        with pytest.raises(InputError, match=words):
            parse_scene("[region]\n" + text)


@pytest.mark.build
@pytest.mark.study
def test_a_build_stays_inside_and_its_scene_names_the_copied_mesh(tmp_path: Path) -> None:
    # an edge from the right reaches 2 mm into the picture
    outline = [(63.0, 28.0), (90.0, 56.0), (90.0, 90.0), (-90.0, 90.0), (-90.0, -90.0)]
    write_stl(tmp_path / "room.stl", [prism(*outline, (90.0, -90.0), (90.0, 0.0), half=60.0)])
    scene = tmp_path / "mine.toml"
    scene.write_text(
        f"{ask_quick(iou_floor=0.5, max_outline_error_px=1.0)}"
        '[region]\nkind = "mesh"\nfile = "room.stl"\n[piece]\ntube_radius_mm = 2.5\n'
    )
    out = tmp_path / "out"
    call = ("build", "--skip", "shadow-render")
    done = knotfab(*call, *UNREAD, "text:♥", "--scene", scene, "--out", out)
    assert done.code == 0, done
    report = json.loads((out / "report.json").read_text())
    check = next(c for c in report["checks"] if c["name"] == "region")
    assert check["status"] == "pass" and -1.0 < check["measured"] < 0  # the wall was felt
    assert (out / "region.stl").read_bytes() == (tmp_path / "room.stl").read_bytes()
    assert load_scene(out / "scene.toml").region.file == str(out / "region.stl")


@pytest.mark.build
def test_an_impossible_limit_is_rejected_whole_with_the_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"coarse_px": 64, "fine_px": 64, "coarse_iterations": 8}.items():
        monkeypatch.setitem(SHORT, name, value)
    scene = tmp_path / "stiff.toml"
    few = questions.QUICK.replace("fine_px = 160", "fine_px = 96").replace(
        "coarse_px = 96", "coarse_px = 64"
    )
    few = re.sub(r"iterations = \d+", "iterations = 8", few)
    scene.write_text(f"{few}[material]\nmin_bend_radius_mm = 60.0\n")
    call = ["build", "text:♥", "--scene", scene, "--tube-radius", "9"]
    done = knotfab(*call, "--out", tmp_path / "out", "--skip", "shadow-render", *UNREAD)
    assert done.code == 1, done
    assert not (tmp_path / "out" / "part.stl").exists()
    report = json.loads((tmp_path / "out" / "rejected" / "report.json").read_text())
    assert report["status"] == "fail"
    [limits] = [c for c in report["checks"] if c["name"] == "limits"]
    assert limits["status"] == "fail"
    assert "below 60.000 mm at (" in limits["detail"]
    # the written piece is the best that keeps the limit; it is no heart, and the report says why
    assert {c["name"] for c in report["checks"] if c["status"] == "fail"} == {
        *("limits", "shadow", "half_light", "recognisable")
    }
    [binding] = report["binding"]
    assert binding["limits"] == ["bend"] and binding["iou_without"] > 0.9 > binding["iou"]
