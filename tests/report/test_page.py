"""The report: the contract's keys, finite numbers, a verdict from the checks, a safe page."""

import base64
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from pages import open_browser
from PIL import Image
from reports import VERDICT, check_of, report_with

from knotfab.geometry.tube import sweep
from knotfab.render.part_picture import draw_part, look_from, place_eyes, turn_eye
from knotfab.report import page as report_html
from knotfab.report.for_maker import list_files
from knotfab.report.page import Picture, render_html
from knotfab.report.pictures import find_pictures
from knotfab.report.report import write_report_json
from knotfab.report.summary import CHECKS, mark_of, tally_checks, tell_colours
from knotfab_formats.errors import plain, read_as
from knotfab_formats.report import Report
from knotfab_formats.scene import ResolvedView
from knotfab_formats.verdict import PRINTER, exit_code, list_unmet

DETAIL = "closest at (12.0, 3.1, 40.2) mm"
CHECKS_MADE: list[dict[str, Any]] = [
    {"name": "closed mesh", "detail": "volume 49123 mm³, as the tube's length and radius give"},
    {"name": "thickness"},
    {"name": "slicer", "status": "skipped", "required": False, "measured": None, "limit": None},
]
FAILED = {"name": "thickness", "status": "fail", "measured": 1.91, "detail": DETAIL}


class Page(HTMLParser):
    """Tags, their attributes, and the text of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] != "style":
            self.text += data


def test_keys_of_the_contract(tmp_path: Path) -> None:
    write_report_json(tmp_path / "report.json", report_with())
    text = (tmp_path / "report.json").read_text(encoding="utf-8")
    report = json.loads(text)
    assert set(report) == {
        "schema", "title", "status", "verdict", "views", "checks", "effects", "limits", "timings", "knots",
        "print", "settings", "notes", "attempts",
    }  # fmt: skip
    assert report["schema"] == 1 and report["status"] == "pass" and report["verdict"] is None
    assert np.array(report["views"][0]["projection"]).shape == (3, 4)
    assert len(report["views"][0]["receiver"]) == 4
    assert plain(read_as(Report, report)) == report  # what was read is what was written


@pytest.mark.parametrize("word", ["faithful", "coarse", "not recognisable"])
def test_the_verdict_of_the_worst_view_stands_first(word: str) -> None:
    judged = (("front", "faithful"), ("side", word))
    views = [{"name": name, "verdict": {**VERDICT, "word": said}} for name, said in judged]
    report = report_with(views=views)
    assert report.verdict is not None and report.verdict.word == word
    assert [loss.view for loss in report.verdict.lost] == ["front", "side"]
    heading = render_html(report).split("<h1>")[1].split("</h1>")[0]
    assert word in heading and ("Warning" in heading) == (word != "faithful")
    page = render_html(report)
    assert "a piece is lost &lt;here&gt;" in page and "<here>" not in page


def test_colours_of_lamps_are_told_in_words_and_shown_lamp_by_lamp(tmp_path: Path) -> None:
    assert tell_colours(report_with()) == []
    lamp = {"colour": [1.0, 0.0, 0.0], "light": [0.0, 0.0, 500.0], "spill": 0.0, "missing": 0.0}
    lamps = [
        {**lamp, "name": "red", "spill_beside": 0},
        {**lamp, "name": "blue", "spill_beside": 0.02},
    ]
    shares = {"share": 0.9999, "share_inside": 1.0, "share_along": 0.5, "along": 0.1}
    shares |= {"share_half_light": 0.99, "share_drawn": 0.98, "ambient": 0.0}
    errors = {"delta_e": 3.2, "delta_e_inside": 1.0, "delta_e_along": 9.0, "delta_e_lit": 1.1}
    moved = {"lamp_mm": None, "moved_mm": 2.0, "share": 0.96, "unmoved": 0.99}
    picture = {"file": "p.png", "delta_e": 9.1, "masks_share": 0.8, "masks_delta_e": 4.0}
    picture |= {"swapped": [], "swapped_delta_e": None}
    colours = {"lamps": lamps, **shares, **errors, "misregistration": moved, "picture": picture}
    views = [{"lamp_colour": [1.0, 0.0, 0.5]}]
    report = report_with(colours=colours, views=views)
    first, error, beside = tell_colours(report)
    assert "99.9%" in first and "4 colours that 2 lamps" in first  # never rounded up to all
    assert "ΔE 3.2" in error and "9.1" in error and "80.0%" in error and "blue" in beside
    off = report_with(colours={**colours, "misregistration": {**moved, "lamp_mm": 4.6}})
    assert any("5 mm beside its place" in line and "96.0%" in line for line in tell_colours(off))
    file = tmp_path / "shadow.png"
    Image.new("L", (4, 4), 255).save(file)
    shown = [Picture(file, "colours", "all"), Picture(file, "alone", "", report.views[0].name)]
    page = render_html(report, shown)
    assert "background:rgb(255 0 186)" in page and "alone" in page and "99.9%" in page


def test_limits_stand_apart_from_the_effects() -> None:
    page = render_html(report_with())
    shown = page.split("<summary>Effects ")[1]
    one, two = shown.split("<summary>Limits ")
    assert "penumbra" in one and "clearance" not in one and "clearance" in two


def test_settings_are_a_row_each_however_deep() -> None:
    tried = {"radius_mm": 1.5, "template_iou": 0.9, "start_iou": None}
    trials = [tried, {**tried, "radius_mm": 2.0, "start_iou": 0.97}]
    report = report_with(settings={"tube_radius": {"chosen_by": "trying", "trials": trials}})
    table = render_html(report).split('<table class="settings">')[1].split("</table>")[0]
    assert "{" not in table and "None" not in table
    rows = ("trials.1.radius_mm</td><td>1.5<", "trials.2.start_iou</td><td>0.97<")
    assert all(f"tube_radius.{row}" in table for row in rows)


def test_what_is_not_required_warns_and_does_not_fail() -> None:
    checks = [{"name": "closing", "status": "fail", "required": False}]
    page = render_html(report_with(checks=[*checks, {"name": "shadow", "status": "fail"}]))
    rows = {
        name: page.split(f'"s">{name}')[0].rsplit("<tr>", 1)[1] for name in ("closing", "shadow")
    }
    assert "warn" in rows["closing"] and "fail" not in rows["closing"]
    assert "✗ fail" in rows["shadow"]
    for status in ("pass", "skipped"):
        assert mark_of(check_of("a", status, required=False)) == status


@pytest.mark.parametrize(
    "section", ["views", "checks", "effects", "limits", "knots", "print", "settings"]
)
def test_a_key_too_few_is_refused(section: str) -> None:
    told = plain(report_with(checks=CHECKS_MADE))
    record = told[section] if isinstance(told[section], dict) else told[section][0]
    key = next(iter(record))
    del record[key]
    with pytest.raises(ValueError, match=rf"{section}\.(0\.)?(View\.)?{key}\n"):
        read_as(Report, told)


@pytest.mark.parametrize(
    ("states", "code"),
    [
        ([("pass", True), ("fail", False)], 0), ([("pass", True), ("skipped", False)], 0),
        ([("pass", True), ("skipped", True)], 3), ([("skipped", True), ("fail", True)], 1), ([], 0),
    ],
)  # fmt: skip
def test_the_rule_of_what_passes(states: list[tuple[str, bool]], code: int) -> None:
    """A skipped check proves nothing; one that is not required decides nothing."""
    checks = [check_of(f"c{k}", s, needed) for k, (s, needed) in enumerate(states)]
    assert exit_code(checks) == code
    assert bool(list_unmet(checks)) == (code != 0)


def test_an_unknown_status_is_refused() -> None:
    with pytest.raises(ValueError, match="status"):
        check_of("a", "passed")


def test_the_printers_checks_are_checks() -> None:
    assert set(PRINTER) < set(CHECKS)
    assert len(set(CHECKS)) == len(CHECKS)


def test_eyes_are_those_of_all_views_and_others_beside() -> None:
    view = ResolvedView(frame_width_mm=100.0, frame_height_mm=100.0)
    alone = place_eyes([view])
    angles = np.degrees(np.arctan2(alone[:, 0], alone[:, 2]))
    assert angles == pytest.approx([0.0, 30.0, 60.0, 90.0])
    near = view.model_copy(update={"azimuth_deg": 90.0, "light_distance_mm": 300.0})
    both = place_eyes([view, near])
    assert both[:2] == pytest.approx(np.array([[0.0, 0.0, 500.0], [300.0, 0.0, 0.0]]), abs=1e-9)
    others = np.degrees(np.arctan2(both[2:, 0], both[2:, 2]))
    assert others == pytest.approx([30.0, 60.0])
    looks = [look_from(near, *way) / 300.0 for way in ((0.0, 0.0), (90.0, 0.0), (0.0, -90.0))]
    assert np.array(looks) == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, -1, 0]]), abs=1e-9)


def test_numbers_are_finite_and_plain() -> None:
    value = {
        "nan": float("nan"), "inf": np.inf, "f32": np.float32(0.5), "i": np.int64(3),
        "b": np.bool_(True), "a": np.array([[1.0, np.nan]]), 7: (1, 2), "p": Path("a/b"),
    }  # fmt: skip
    assert plain(value) == {
        "nan": None, "inf": None, "f32": 0.5, "i": 3, "b": True, "a": [[1.0, None]], "7": [1, 2],
        "p": "a/b",
    }  # fmt: skip
    assert type(plain(np.int64(3))) is int
    with pytest.raises(TypeError):
        plain(object())


def test_a_large_picture_is_embedded_small(tmp_path: Path) -> None:
    y, x = np.mgrid[:360, :1440]
    waves = 128 + 60 * np.sin(x / 9) * np.cos(y / 7)
    waves = waves[..., None] + np.random.default_rng(0).normal(0, 6, (360, 1440, 3))
    Image.fromarray(waves.clip(0, 255).astype(np.uint8)).save(tmp_path / "part.png")
    head, _, text = Picture(tmp_path / "part.png", "part").data_uri.partition(",")
    data = base64.b64decode(text)
    assert (
        head == "data:image/webp;base64"
        and len(data) < 0.3 * (tmp_path / "part.png").stat().st_size
    )
    shown = np.asarray(Image.open(io.BytesIO(data)), dtype=float)
    assert shown.shape == waves.shape and np.abs(shown - waves).mean() < 8


def test_without_a_part_the_page_sends_nobody_to_print() -> None:
    report = report_with()
    whole = render_html(report, [], "knight")
    assert "Print <b>part.3mf</b>" in whole and "as it lies on the bed" in whole
    report = report_with(print={"volume_mm3": 0.0, "mass_g": 0.0, "bounding_box_mm": None})
    none = render_html(report, [], "knight")
    assert "There is no part" in none and not re.search("part.3mf|lies on the bed|>Material<", none)


def test_page_is_whole_and_loads_nothing(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8), "white").save(tmp_path / "compare.png")
    pictures = [
        Picture(tmp_path / "compare.png", "compare", view="front"),
        Picture(tmp_path / "compare.png", "compare", view="another"),
        Picture(tmp_path / "compare.png", "shadow", "The shadow alone", view="front"),
        Picture(tmp_path / "compare.png", "part", "From several sides"),
    ]
    report = report_with(checks=CHECKS_MADE)
    text = render_html(report, pictures, "knight")
    page = Page(text)
    assert page.open == []
    images = [attributes for tag, attributes in page.tags if tag == "img"]
    assert len(images) == 3 and all(a["src"].startswith("data:image/png;base64,") for a in images)
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe", "object"}
    assert not re.search(r"https?://|url\(|@import", text)
    for words in ("Verified", "0.9877", "thickness", "penumbra", "8.4 s", "prusa-mk4"):
        assert words in page.text
    assert report.settings.command in page.text and "versions.numpy" in page.text
    widths = [a["style"] for _, a in page.tags if a.get("class") == "fill"]
    of_stages = [s / report.timings["total"] for k, s in report.timings.items() if k != "total"]
    assert widths == [f"width:{round(100 * share, 2)}%" for share in of_stages]


def test_a_bent_picture_says_by_how_much_beside_its_likeness(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8), "white").save(tmp_path / "bent-front.png")
    bending = {"rms": 0.012, "most": 0.034, "stretch": 1.2, "mirrored": False}
    report = report_with(views=[{"bending": bending, "iou_drawn": 0.9951, "bound": 0.997}])
    page = " ".join(
        Page(render_html(report, find_pictures(tmp_path))).text.replace("\xa0", " ").split()
    )
    assert "(99.5 % with it as bent)" in page and "Left the picture as bent" in page
    assert "bent, by 1.2 % of its height on average and 3.4 % at most" in page and "99.7 %" in page


def test_page_of_a_failed_build_says_what_and_where() -> None:
    text = Page(render_html(report_with(checks=[FAILED]))).text
    assert "Not ready" in text and "Verified." not in text
    assert DETAIL in text


def test_page_escapes_what_it_is_given() -> None:
    evil = "<script>alert('x')</script>\"&"
    check, view = {"name": "mesh", "detail": evil}, {"picture": evil}
    report = report_with(settings={"command": evil}, checks=[check], views=[view])
    page = Page(render_html(report, title=evil))
    assert "script" not in {tag for tag, _ in page.tags} and page.text.count(evil) == 5


def test_page_survives_what_could_not_be_measured() -> None:
    keys = ("iou", "iou_tube", "precision", "outline_error_px")
    view = dict.fromkeys(keys, float("nan"))
    report = report_with(views=[view], timings={"total": 0.0}, knots=[])
    text = Page(render_html(report)).text
    assert "IoU –" in text and "nan" not in text.lower() and "None" not in text


def test_what_a_person_can_do_stands_on_top() -> None:
    rows = [{"name": "mount", "text": "nothing holds the 3 loose knots"}]
    head = render_html(report_with(rows=rows)).split("</header>")[0]
    assert "<li>Nothing holds the 3 loose knots.</li>" in head


def test_optional_print_numbers() -> None:
    text = fabrication_page(print={"time_s": 5400.0, "filament_m": 20.42, "filament_g": 61.0}).text
    assert "Printing takes" in text and "1 h 30 min" in text and "20.4" in text


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.987654, "0.9877"), (1.0, "1"), (0.0, "0"), (49123.4, "49\u202f123"), (12, "12"),
        (1480, "1\u202f480"), (-0.5, "−0.5"), (1e-9, "1.00e−09"), (None, "–"), (float("inf"), "–"),
        ([178.24, 90.0], "178.2 × 90"), (True, "yes"), ("text", "text"), (100.0, "100"),
    ],
)  # fmt: skip
def test_numbers_for_readers(value: object, said: str) -> None:
    assert report_html._number(value) == said


def ring() -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    return sweep(np.stack([30 * np.cos(t), 20 * np.sin(t), 0 * t], axis=1) + 7, 3.0, 12)


def test_part_from_several_sides(tmp_path: Path) -> None:
    """The ring is open as the light sees it; turned by 90 degrees it is a narrow bar."""
    draw_part(*ring(), tmp_path / "part.png", turn_eye((0.0, 0.0, 500.0), (0.0, 90.0)), 100)
    image = np.asarray(Image.open(tmp_path / "part.png").convert("RGB")).astype(int)
    assert image.shape == (100, 200, 3)
    drawn = np.abs(image - image[0, 0]).sum(axis=2) > 60
    front, side = drawn[:, :100], drawn[:, 100:]
    assert not front[50, 50] and side[50, 50]
    assert np.ptp(np.flatnonzero(front.any(axis=0))) > 80
    assert np.ptp(np.flatnonzero(side.any(axis=0))) < 15
    heights = [np.ptp(np.flatnonzero(panel.any(axis=1))) for panel in (front, side)]
    assert heights[0] == pytest.approx(heights[1], abs=2)  # one scale


def test_a_part_is_drawn_in_its_materials_colour(tmp_path: Path) -> None:
    eye = turn_eye((0.0, 0.0, 500.0), (0.0,))
    draw_part(*ring(), tmp_path / "part.png", eye, 60, color="#1060d0")
    image = np.asarray(Image.open(tmp_path / "part.png").convert("RGB")).astype(int)
    drawn = image[np.abs(image - image[0, 0]).sum(axis=2) > 200]
    assert len(drawn) and (drawn[:, 2] > drawn[:, 0] + 20).all()


def sections(page: Page) -> list[str]:
    return [
        s
        for s in ("The wall mount", "The stand", "The bending plan", "The slicer")
        if s in page.text
    ]


def fabrication_page(**more: Any) -> Page:
    """The page of a report with what fabrication adds to it."""
    return Page(render_html(report_with(**more)))


WALL = {
    "kind": "wall", "foot": "dowel", "pegs": 7, "peg_length_mm": [55.9, 127.4],
    "peg_diameter_mm": 2.2296, "sag_mm": 0.17, "max_sag_mm": 0.2,
}  # fmt: skip
STAND = {
    "kind": "stand", "posts": 2, "struts": 11, "members_of_knots": [13],
    "member_diameter_mm": [2.0, 3.0], "base_mm": [88.0, 64.5, 9.0],
    "margin_mm": 12.0, "tip_deg": 9.5, "predicted_intrusion": 0.002, "sag_mm": 0.1, "max_sag_mm": 0.2,
}  # fmt: skip
SLICED = {
    "program": "PrusaSlicer", "version": "2.5.0", "time_s": 91031.0, "filament_m": 114.9,
    "filament_g": 342.9, "support_m": 28.725, "layers": 745, "objects": 1,
    "retractions": 31548, "starts_per_layer": 61.27,
    "warnings": [{"text": "low <bed> adhesion", "explanation": "the brim settles it", "settled": True}],
    "checks": [{"name": "bed", "status": "pass", "measured": -7.0, "limit": 0.0, "unit": "mm",
                "detail": "keeps 7 mm"}],
    "command": "prusa-slicer --export-gcode part.3mf", "profile": {}, "seconds": 9.0,
}  # fmt: skip


@pytest.mark.slow
def test_sections_of_fabrication_stand_where_they_apply() -> None:
    assert sections(fabrication_page()) == []
    assert sections(fabrication_page(print={"mount": {"kind": "none"}, "drawings": []})) == []
    assert sections(fabrication_page(print={"mount": WALL})) == ["The wall mount"]
    assert sections(fabrication_page(print={"mount": STAND})) == ["The stand"]
    assert sections(fabrication_page(slicer=SLICED)) == ["The slicer"]


def test_the_mounts_figures_and_drawings() -> None:
    drawings = ["setup.pdf", "setup.svg", "drill-template.pdf"]
    text = fabrication_page(print={"mount": WALL, "drawings": drawings}).text
    for part in ("in drilled holes", "55.9 to 127", "0.17", "limit 0.2", ", ".join(drawings)):
        assert part in text
    assert "full size" in text
    plain = fabrication_page(print={"mount": STAND, "drawings": drawings[:2]}).text
    assert "88 × 64.5 × 9" in plain and "9.5" in plain and "full size" not in plain


def test_the_slicers_figures_and_warnings() -> None:
    text = fabrication_page(slicer=SLICED).text
    for part in (
        "25 h 18 min",
        "25 %",
        "745",
        "31\u202f548",
        "61.3",
        "low <bed> adhesion",
        "the brim settles it",
    ):
        assert part in text
    assert "keeps 7 mm" in text
    quiet = fabrication_page(slicer={**SLICED, "warnings": []}).text
    assert "had no warning" in quiet
    none = {**SLICED, "program": None, "reason": "it is not installed", "remedy": "Install it."}
    without = fabrication_page(slicer=none | {"checks": [], "warnings": []}).text
    assert "Not sliced: it is not installed." in without and "print time" not in without


@pytest.mark.slow
def test_what_it_costs_to_be_off_is_told_with_the_view() -> None:
    def ious(*ways: str) -> dict[str, dict[str, float]]:
        return {way: {"raw": 0.858 - 0.1 * n, "fitted": 0.958} for n, way in enumerate(ways)}

    off = {
        "parting_px": 2.0, "lamp_mm": 5.0, "turn_deg": 1.0, "iou": 0.99, "worst": None, "samples": 7,
        "lamp_iou": ious("right", "up", "towards"), "turn_iou": ious("right", "up", "axis"),
    }  # fmt: skip
    text = fabrication_page(views=[{"misplacement": off}]).text
    assert "lamp 5 mm to the side" in text and "0.858" in text and "0.958" in text
    assert "piece turned by 1° like a wheel" in text and "0.658" in text
    # a piece on a wall cannot be turned against it
    del off["turn_iou"]
    assert "piece turned" not in fabrication_page(views=[{"misplacement": off}]).text


def test_sag_and_layers_are_told_where_they_were_measured() -> None:
    assert "as they hang" not in fabrication_page().text
    sag = {"widest_px": 1.4, "iou": 0.987, "iou_designed": 0.988}
    layers = {"layer_mm": 0.2, "shift_px": 1.0, "iou": 0.9761, "iou_smooth": 0.9859, "samples": 400}
    text = fabrication_page(views=[{"sag": sag, "layers": layers}]).text
    assert "as they hang on their mount: IoU 0.987, 0.988 as designed" in text
    assert "a stack of its layers: IoU 0.976, 0.986 as designed" in text


def test_checks_are_tallied_and_those_that_failed_named() -> None:
    passed = [check_of(str(k)) for k in range(35)]
    assert tally_checks([*passed, check_of("slicer", "skipped")]) == "35 passed, 1 skipped: slicer"
    failed = [check_of("tube", "fail"), check_of("closing", "fail", False)]
    assert tally_checks(failed) == "1 failed: tube, 1 not required and not met: closing"
    many = [check_of(str(k), "skipped") for k in range(10)]
    assert tally_checks([*passed, *many]) == "35 passed, 10 skipped"


def test_numbered_files_are_listed_by_the_first_and_the_last() -> None:
    parts = [f"part-{k:02d}.3mf" for k in range(1, 13)]
    listed = [name for name, _ in list_files([*reversed(parts), "setup-01.pdf", "part-01.stl"])]
    assert listed == ["part-01.3mf … part-12.3mf", "setup-01.pdf", "part-01.stl"]


@pytest.mark.slow
def test_drawings_for_setting_up_are_wide_enough_to_be_read(tmp_path: Path) -> None:
    """The front view is as high as it is wide: its figures must not shrink with a limit of its height."""
    drawing = "data:image/svg+xml," + quote(
        '<svg xmlns="http://www.w3.org/2000/svg" width="800" height="800"/>'
    )
    page = tmp_path / "page.html"
    page.write_text(render_html(report_with(), drawings=[drawing, drawing]), encoding="utf-8")
    with open_browser() as browser:
        for width in (390, 1280):
            opened = browser.new_page(viewport={"width": width, "height": 900})
            opened.goto(page.as_uri())
            front = opened.query_selector_all(".hang .drawing img")[1].bounding_box()
            assert front is not None and front["width"] > 340, width
