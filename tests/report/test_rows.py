"""What a person is told of a report: rows, the most pressing first, each with one remedy."""

from pathlib import Path
from typing import Any

import pytest
from reports import LOSS, VERDICT, check_of, report_with

from knotfab.report.folder_page import write_page
from knotfab.report.rows import list_rows
from knotfab_formats.errors import InputError
from knotfab_formats.report import Row

OFF = {
    "parting_px": 2.0, "lamp_mm": 5.0, "turn_deg": 1.0, "iou": 0.95, "samples": 7, "lamp_iou": {},
    "worst": {"of": "turn", "way": "up", "raw": 0.9, "fitted": 0.966},
}  # fmt: skip
SUPPORTS = {"asked": "auto", "way": "none", "why": "", "hours": 2.0, "grams": 60.0}


ROOTS = {
    "width_mm": 7.0, "thickness_mm": 1.6, "screws": [[-20.0, 5.0], [20.0, 5.0]], "tape": "along",
    "area_cm2": 39.2, "mass_g": 7.8,
}  # fmt: skip
WAYS = [
    {"way": way, "hours": 9.0, "grams": 80.0, "support_grams": 0.0, "price": price}
    for way, price in (("roots", 12.0), ("rounded", 13.0), ("slicer", 14.0))
]
HANGING = {"kind": "hang", "thread_mm": [0.0, 50.0, 0.0]}
STRINGS = {
    "retractions": 21121, "layers": 542, "warnings": [], "checks": [],
}  # fmt: skip


def view(iou: float, share: float = 0.1, of: str = "whole", **more: Any) -> dict[str, Any]:
    worst = {
        "share": share,
        "azimuth": 0.0 if of == "knots" else -45.0,
        "elevation": 30.0 * (of == "knots"),
    }
    told = {"worst": worst, "door": share / 2, "of": of}
    return {"iou": iou, "iou_frame": iou, "told": told, **more}


def lost(word: str, what: str = "stroke", size: float = 1.0) -> dict[str, Any]:
    loss = {**LOSS, "view": "front", "what": what, "size_mm": size, "needed_mm": 1.6}
    return {**VERDICT, "word": word, "lost": [loss]}


def rows(**sections: Any) -> dict[str, Row]:
    return {row.name: row for row in list_rows(report_with(**sections))}


# sections of a report, a row, and what it holds
TOLD: list[tuple[dict[str, Any], str, dict[str, Any]]] = [
    ({"views": [view(0.99962)]}, "likeness", {"value": 0.99962, "text": "99.9% alike"}),
    ({"views": [view(0.1, iou_drawn=0.91)]}, "likeness",
     {"text": "10.0% alike, 91.0% with its strokes as wide as drawn"}),
    ({"views": [view(0.9), view(0.8, name="side")]}, "likeness",
     {"where": "side", "text": "side: 80.0% alike, the least of 2"}),
    ({"views": [{"iou": 0.7, "iou_frame": 0.95}], "print": {"mount": {"kind": "stand"}}}, "likeness",
     {"text": "95.0% alike in the frame"}),
    ({"views": [view(0.957, misplacement=OFF)]}, "likeness",
     {"text": "95.7% alike; 97% with the piece turned by 1° left or right"}),
    ({"views": [view(0.9, 0.2)]}, "aside",
     {"remedy": "", "text": "is not read from 45° aside (told 0.20; from the door 0.10)"}),
    ({"views": [view(0.9, 0.4, "knots")]}, "aside", {"text": "may be guessed from 30° above in its knots"}),
    ({"views": [view(0.9, 0.9, "holder")], "print": {"mount": {"kind": "wall", "plate": "outline"}}},
     "aside", {"remedy": "--plate rounded", "text": "; --plate rounded hides its outline"}),
    ({"verdict": lost("coarse")}, "losses", {"status": "warn", "remedy": "--thicken auto"}),
    ({"verdict": lost("coarse", "hole")}, "losses", {"status": "warn", "remedy": ""}),
    ({"verdict": lost("coarse", size=2.0)}, "losses", {"remedy": ""}),
    ({"verdict": lost("good")}, "losses", {"status": "info", "remedy": ""}),
    ({"print": {"time_s": 9000.0, "filament_g": 42.0, "support_g": 13.0}}, "piece",
     {"value": 42.0, "unit": "g", "text": "178 × 172 × 109 mm, 2.5 h, 42 g, 13 g of it supports; one knot"}),
    ({"print": {"bounding_box_mm": None, "mass_g": 0.0}}, "piece",
     {"text": "no part; one knot of a tube 4.0 mm thick"}),
    ({"print": {"mount": {"kind": "none"}}}, "mount", {"remedy": "--mount wall"}),
    ({"print": {"mount": HANGING}}, "thread", {"status": "do"}),
    ({"print": {"mount": {**HANGING, "predicted_intrusion": 0.007}}}, "thread",
     {"text": "Its eyelet and rods darken 0.7% of a frame."}),
    ({"print": {"mount": {"kind": "wall", "foot": "dowel", "pegs": 5}}}, "holes", {"text": "Its 5 pegs"}),
    ({"print": {"roots": {**ROOTS, "screws": []}}}, "tape",
     {"status": "do", "text": "No screw fits its shadow: double-sided tape along its strips holds it (39"}),
    ({"print": {"supports": {**SUPPORTS, "ways": WAYS}}}, "otherwise",
     {"remedy": "--plate rounded", "limit": 12.0, "text": "The next best: in a rounded plate, which is its "
      "screen, it would take about 80 g and 9.0 h, a price of 13.0 h for 12.0 h (--plate rounded)."}),
    ({"print": {"mount": HANGING, "supports": {**SUPPORTS, "ways": WAYS[:1] + WAYS[2:]}}}, "otherwise",
     {"text": "The next best: with the slicer's supports it would take about"}),
    ({"print": {"supports": SUPPORTS, "bars": {"count": 3, "grams": 1.0, "longest_mm": 8.3}}}, "supports",
     {"status": "do", "text": "supports off; its 3 threads, up to 8.3 mm long, lie in the shadow"}),
    ({"print": {"supports": SUPPORTS}, "slicer": STRINGS}, "strings",
     {"status": "do", "text": "21\u202f121 times, 39 a layer: dry the filament"}),
    ({"print": {"supports": {**SUPPORTS, "way": "slicer", "why": "legs failed"}}}, "supports",
     {"text": "with supports: legs failed."}),
    ({"checks": [check_of("shadow", "fail", detail="it is not the picture").__dict__]}, "shadow",
     {"status": "fail", "limit": 2.2, "text": "shadow failed: it is not the picture"}),
    ({"warnings": ["front: unsure"]}, "warning", {"status": "warn", "text": "front: unsure."}),
    ({"next_step": {"accuracy": "fine", "iou_gain": 0.01, "seconds_more": 9, "sentence": "better"}}, "next",
     {"remedy": "--accuracy fine", "text": "better"}),
]  # fmt: skip


@pytest.mark.parametrize(("sections", "name", "held"), TOLD)
def test_a_row_holds(sections: dict[str, Any], name: str, held: dict[str, Any]) -> None:
    row = rows(**sections)[name]
    for key, value in held.items():
        found = getattr(row, key)
        assert value in found if key == "text" else found == value


def test_screws_that_fit_need_no_word_of_tape() -> None:
    assert "tape" not in rows(print={"roots": ROOTS})


def test_what_presses_stands_first() -> None:
    failed = [check_of("shadow", "fail").__dict__]
    dowels = {"supports": SUPPORTS, "mount": {"kind": "wall", "foot": "dowel", "pegs": 5}}
    found = list_rows(report_with(checks=failed, warnings=["unsure"], notes=["n"], print=dowels))
    assert "supports" not in {row.name for row in found}  # nobody prints what failed
    ranks = [("fail", "warn", "do", "info").index(row.status) for row in found]
    assert ranks == sorted(ranks) and {0, 1, 2, 3} == set(ranks)


@pytest.mark.parametrize("held", [None, "{", '{"schema": 1}', "[]"])
def test_a_folder_without_a_whole_build_gets_no_page(tmp_path: Path, held: str | None) -> None:
    if held is not None:
        (tmp_path / "report.json").write_text(held)
    with pytest.raises(InputError, match="it holds no whole build"):
        write_page(tmp_path)
    assert not (tmp_path / "report.html").exists()
