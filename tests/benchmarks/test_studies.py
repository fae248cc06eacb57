"""The table of features: the quickest build of each row, and refusals that name the physical reason."""

import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import knotfab
from PIL import Image
from reports import report_with
from validator_parts import circle, tube

from benchmarks import build_table, on_paper, seconds
from benchmarks.build_table import (
    COLUMNS,
    ON_PAPER,
    PROCESS,
    SMALL,
    TABLES,
    Row,
    build_row,
    compare_promise,
    count_lost,
    draw_picture,
    draw_sets,
    read_row,
    summarize,
)
from benchmarks.features import CELLS, ROWS, Cell, build_cell
from benchmarks.measurement import Built
from benchmarks.on_paper import WIDE
from benchmarks.readme_figures import FIGURES, compare_figures
from benchmarks.small_pictures import small_pictures
from benchmarks.traced_colours import light_and_mix, measure_rms, trace_colours, use_mitsuba
from benchmarks.typed_pages import PAGES, ROOT, broken_promises, commands_of, take_photograph
from examples.lamps.draw import PICTURES as COLOURED
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.cli.commands import app
from knotfab.design import survey
from knotfab.design.frames import frame_view
from knotfab.design.radius import RadiusChoice
from knotfab.part.write import make_pose
from knotfab.picture.raster import encode_mask
from knotfab.pipeline import build as pipeline
from knotfab.request import Outcome, Request
from knotfab.scene.load import dump_scene, load_scene
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.view import view_geometry
from paper.pictures import paper_pictures

# rows that other tests cover, at a lower cost than a whole build
ELSEWHERE = {
    "wall mount": "tests/pipeline/test_build.py", "desk stand": "tests/hold",
    "eyelet for a thread": "tests/hold/test_hang.py", "depth given": "tests/pipeline/test_build.py",
    "flat": "tests/pipeline/test_build.py", "slicing": "tests/part/test_slicer.py",
    "network (inn)": "tests/apps/paper/test_network.py",
    "network, then flow (inn+flow)": "tests/apps/paper/test_network.py",
    "region mesh": "tests/limits/test_feasibility.py", "time budget": "tests/search/test_free_pose.py",
    "price of a limit": "tests/design/test_settings.py",
    "sparser filling": "tests/pipeline/test_build.py",
    "view found in the search": "tests/search/test_free_pose.py",
}  # fmt: skip
assert all(Path(__file__).parents[2].joinpath(place).exists() for place in ELSEWHERE.values())
# as dear as a minute of other tests: tests/part/test_plates.py, tests/start/test_tie.py and
# tests/search/test_search.py have their parts
STUDIES = {"knot of a given type", "repairs alone"}
QUICKEST = [
    pytest.param(
        Cell(row, row.quickest),
        id=row.name,
        marks=[pytest.mark.study] if row.name in STUDIES else [],
    )
    for row in ROWS
    if row.name not in ELSEWHERE
]


@pytest.mark.build
@pytest.mark.parametrize("cell", QUICKEST)
def test_the_quickest_build_of_each_row(cell: Cell, tmp_path: Path) -> None:
    good, said = build_cell(cell, tmp_path)
    assert good, said


@pytest.mark.parametrize(
    "cell", [c for c in CELLS if c.refusal], ids=lambda c: f"{c.row.name}, {c.column}"
)
def test_a_refusal_names_the_physical_reason(cell: Cell, tmp_path: Path) -> None:
    good, said = build_cell(cell, tmp_path)
    assert good and said.startswith("refused: "), said
    assert not (tmp_path / "out").exists()


PICTURES = cache(build_table.pictures)

# Pictures by settings: sets of several that a seed draws, rows that are built once, ratios.


@pytest.mark.slow
def test_no_set_is_drawn_twice_and_all_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_table, "pictures", PICTURES)
    drawn = draw_sets()
    assert {many: len(sets) for many, sets in drawn.items()} == {2: 12, 3: 8, 4: 2, 1: 5}
    for many, sets in drawn.items():
        assert all(len(set(name.split("+"))) == many for name in sets)
        assert len({frozenset(name.split("+")) for name in sets}) == len(sets)
    assert draw_sets() == drawn


@pytest.mark.slow
def test_a_set_is_built_once_and_by_eye_where_its_name_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[str, ...]] = []

    def build(first: str, out: Path, *options: str, printing: bool, checkout: object) -> Built:
        calls.append((first, *options))
        return Built(2, 1.0, 2.0, 3.0, None, "refused")

    monkeypatch.setattr(build_table, "build_apart", build)
    monkeypatch.setattr(build_table, "pictures", PICTURES)
    for _ in range(2):
        row, folder = build_row("heart+teapot@eye", "a b", ("--print",), tmp_path)
        assert row["said"] == "refused" and row["code"] == 2 and row["cpu_s"] == 2.0
        assert folder.name == "rejected"
    ((first, second, *options),) = calls
    assert (Path(first).name, Path(second).name) == ("heart.png", "teapot.png")
    with Image.open(first) as picture:
        assert picture.size[0] > 100
    scene = load_scene(Path(options[options.index("--scene") + 1]))
    assert [view.kind for view in scene.views] == ["eye", "eye"]
    assert [view.azimuth_deg for view in scene.views] == [0.0, 90.0]
    assert options[-1] == "--print"


def test_rows_leave_out_what_a_report_lacks_and_settings_are_compared_with_the_first() -> None:
    row: Row = {"code": 0, "cpu_s": 3.0}
    assert read_row(("code", "grams", "word"), row, None) == {"code": 0}
    report = {"print": {"time_s": 7200.0}, "verdict": {"word": "good"}}
    found = read_row(("cpu_s", "hours", "colours", "word"), row, report)
    assert found == {"cpu_s": 3.0, "hours": 2.0, "word": "good"}
    rows: dict[str, dict[str, Row]] = {
        "first": {"a": {"hours": 2.0}, "b": {"hours": 4.0}},
        "other": {"a": {"hours": 1.0}, "b": {"hours": 4.0}, "c": {"hours": 9.0}},
    }
    first, other, ratio = summarize(rows)
    assert first.startswith("first, 2 built: hours 3 (median 3, 2 to 4)")
    assert other.startswith("other, 3 built: hours 4.667")
    assert ratio.endswith("hours 0.750 (at most 1.000)")


@pytest.mark.slow
def test_every_picture_of_every_table_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_table, "pictures", PICTURES)
    known = set(build_table.pictures()) | set(small_pictures()) | set(COLOURED) | set(ON_PAPER)
    known |= set(paper_pictures())
    # tests/picture/test_colours.py has some drawn
    monkeypatch.setattr(on_paper, "_photograph", lambda *_: (Image.new("RGB", (WIDE, 9)), None))
    assert all(draw_picture(name).width == WIDE for name in ON_PAPER)
    for one in TABLES.values():
        for name in one.names():
            texts = name.startswith("text:")
            assert texts or set(name.removesuffix("@eye").split("+")) <= known
        assert set(one.columns) <= {*COLUMNS, *PROCESS} and one.settings


def test_a_promise_is_kept_where_all_of_it_came() -> None:
    """Grams and hours within 12 %, the tube, the holder, and what is told."""
    promise: Row = {"said_g": 50.0, "said_h": 5.0, "said_mm": 2.0, "said_holder": "in roots"}
    came = {
        "print": {"filament_g": 50.0, "time_s": 18000.0, "mount": {"kind": "wall", "plate": "roots"}},
        "settings": {"tube_radius_mm": 2.0}, "views": [{"told": {"worst": {"share": 0.5}}}],
    }  # fmt: skip
    assert compare_promise(promise, came) == {"g_off": 0.0, "h_off": 0.0, "same": 1.0}
    assert compare_promise({**promise, "said_told": 0.45}, came)["same"] == 1.0
    for other in (
        {"said_told": 1.0},
        {"said_g": 57.0},
        {"said_h": 4.3},
        {"said_mm": 2.2},
        {"said_holder": "on pegs"},
    ):
        assert compare_promise({**promise, **other}, came)["same"] == 0.0
    assert compare_promise({"preview_s": 3.0}, came) == compare_promise(promise, None) == {}


def test_only_pieces_and_holes_that_the_tube_could_draw_count_as_lost() -> None:
    losses = [("piece", 3.1), ("hole", 3.1), ("piece", 2.9), ("specks", 9.0)]
    lost = [{"what": what, "size_mm": size, "needed_mm": 2.0} for what, size in losses]
    assert count_lost({"verdict": {"lost": lost}}) == 2
    drawn = small_pictures()
    assert all(drawn.keys() & set(pair.split("+")) for pair in SMALL)
    assert all(len(np.unique(np.asarray(picture) > 127)) == 2 for picture in drawn.values())


# The colours that the validators mix, against paths that Mitsuba traces through the same scene.


PX, PATHS = 40, 196


@pytest.mark.slow
def test_what_lamps_mix_is_what_a_path_tracer_sees() -> None:
    pytest.importorskip("mitsuba")
    assert use_mitsuba()
    base = {"frame_width_mm": 80.0, "frame_height_mm": 80.0, "wall_distance_mm": 60.0}
    places = {"red": (-60.0, 0.0), "green": (10.0, 50.0), "blue": (60.0, -20.0)}
    views: list[dict[str, Any]] = [
        {**base, "name": name, "light_right_mm": x, "light_up_mm": y, "lamp_colour": colour}
        for (name, (x, y)), colour in zip(places.items(), np.eye(3).tolist(), strict=True)
    ]
    views = [views[0], *({**view, "wall": "red"} for view in views[1:])]
    scene = parse_scene({"views": views})
    mesh = Mesh(*tube(circle(80, 20.0), 4.0, 24))
    seen = [view_geometry(view, PX, PX) for view in scene.views]
    _, ours = light_and_mix(mesh, scene, seen)
    traced = trace_colours(mesh, scene.views, seen, PATHS)
    assert measure_rms(ours, traced).max() < 0.03
    assert ours.min() < 0.05 and (ours > 0.9).all(axis=2).mean() > 0.3
    # a lamp elsewhere is another picture, in its own channel
    moved = replace(seen[2], light=seen[2].light + 40 * seen[2].up)
    off = measure_rms(ours, trace_colours(mesh, scene.views, [*seen[:2], moved], PATHS))
    assert off[2] > 0.1 > 0.03 > off[:2].max()


# README's and the tutorial's commands are typed as they stand there; builds are stood for by
# their files.


def build(request: Request, progress: Progress) -> Outcome:
    """Write what a later command reads: scene, pictures, and that there is a report."""
    pairs = zip(request.scene.views, request.targets, strict=False)
    views = [frame_view(view, target).as_written() for view, target in pairs]
    with OutputFolder(request.out) as folder:
        for view, target in zip(views, request.targets, strict=False):
            folder.write(view.picture, encode_mask(target.asked))
            if (came := target.given) is not None:
                folder.write(f"given-{view.name}{came.suffix}", came.data)
        made = {"views": tuple(views), "pose": make_pose(np.eye(4))}
        folder.write("scene.toml", dump_scene(request.scene.model_copy(update=made)))
        folder.write("report.json", "{}")
        folder.commit()
    return Outcome(0, report_with(views=[]), request.out)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(p, marks=[pytest.mark.study] if p == "README.md" else []) for p in PAGES]
)
def test_a_page_can_be_typed_from_its_first_line_to_its_last(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "run_build", build)
    # which tube several pictures take is found by drawing starts, for seconds
    monkeypatch.setattr(survey, "choose_radius", lambda *_, **__: RadiusChoice(2.0, ()))
    folder = shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(folder)
    commands = commands_of((ROOT / name).read_text("utf-8"))
    assert len(commands) >= (15 if name == "README.md" else 4)
    for words in commands:
        if words[0] in ("build", "preview", "compare"):
            if words[0] == "compare":
                take_photograph(folder / words[2], folder / words[1])
            done = knotfab(*words)
            assert done.code == 0, (words, done.err)
            if words[0] == "compare":
                assert done.out.startswith("9"), done.out  # % alike
        else:
            app.parse_args(words, exit_on_error=False, print_error=False)


def test_a_promise_that_is_off_by_more_than_a_tenth_is_told() -> None:
    def told(word: str, figures: str, report: str = "badge/report.html") -> str:
        return f"    pass  {word}  in 9 s: open {report}\n      99% alike\n      9 mm, {figures}; one knot\n"

    said = told("good", "1 h, 2 g", "a/report.html") + told("faithful", "10.1 h, 86 g")
    for promise, kept in (("9.5 h, 90 g", True), ("22 h, 86 g", False), ("10.1 h, 99 g", False)):
        assert (broken_promises(told("faithful", promise), said) == []) == kept
    assert broken_promises(told("good", "10.1 h, 86 g"), said)
    assert commands_of("```sh\ncd x\nknotfab build a b  # c\n```\n    knotfab no\n") == [
        ["build", "a", "b"]
    ]


def test_readmes_figures_are_held_against_the_build() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.split()) <= 900
    told = re.search(FIGURES, text, re.DOTALL)
    assert told is not None
    grams, hours, iou = (float(one) for one in told.groups())
    built = {"filament_g": grams, "time_s": 3600 * hours}
    assert not compare_figures(text, report_with(print=built, views=[{"iou": iou}]))
    off = report_with(print={**built, "filament_g": 1.06 * grams}, views=[{"iou": iou - 0.01}])
    assert [line.split(":")[0] for line in compare_figures(text, off)] == ["grams", "IoU"]
    assert compare_figures("nothing", off)


def test_what_moved_by_more_than_its_tolerance_is_listed() -> None:
    def report(**figures: float) -> dict[str, Any]:
        checks = [
            {"name": name, "status": "pass", "measured": value, "unit": "mm"}
            for name, value in figures.items()
        ]
        return {"checks": checks, "views": [{"iou": 0.99}], "verdict": {"word": "good"}}

    old = report(bend=2.0, gap=0.4, reach=0.30)
    new = report(bend=2.09, gap=0.43, reach=0.31)
    (moved, last) = seconds.compare({"a": old, "b": old}, {"a": new})
    assert moved.startswith("a  gap: pass 0.4 -> pass 0.43") and last.startswith("1 builds, 3 ")
    new["checks"][0]["status"], new["views"][0]["iou"] = "fail", 0.98
    told = list(seconds.compare({"a": old}, {"a": new}))
    assert [line.split(":")[0] for line in told[:-1]] == ["a  bend", "a  gap", "a  IoU"]


def test_short_searches_are_no_full_ones() -> None:
    whats = ["search: a tube", "search from more arches", "short search without it", "part on legs"]
    built = {"attempts": [{"what": what} for what in whats]}
    assert list(seconds.count_searches({"a": built})) == ["a  2", "mean 2.00 of 1 builds"]
