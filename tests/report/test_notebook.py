"""What a notebook shows: words and pictures in one small piece of page, whatever the texts are."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from reports import LOSS, VERDICT, report_with

import knotfab
from knotfab.picture.read import Target
from knotfab_formats.report import Report

_LOADS = ("http:", "https:", "//", "<script", "<link", "<style", "url(")
_WORDS = '<img src=x onerror="alert(1)"> & <script>'


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def _pictures(page: str) -> int:
    """Count how many pictures a piece of page has, all of them inside; it loads nothing and runs nothing."""
    plain = re.sub(r"data:image/[a-z]+;base64,[A-Za-z0-9+/=]+", "data:", page)
    assert not any(word in plain for word in _LOADS), plain
    reader = _Tags()
    reader.feed(page)
    assert {tag for tag, _ in reader.tags} <= {"div", "p", "b", "br", "figure", "img", "figcaption"}
    sources = [attributes["src"] or "" for tag, attributes in reader.tags if tag == "img"]
    assert all(source.startswith("data:image/") for source in sources)
    assert not any(name.startswith("on") for _, attributes in reader.tags for name in attributes)
    return len(sources)


def _report(**more: object) -> Report:
    failed = {"name": "clearance", "status": "fail", "detail": _WORDS}
    lost = [{**LOSS, "sentence": "An ear is lost."}]
    sections = {
        "views": [{"iou": 0.9876}], "checks": [failed], "notes": ["Mind the lamp."],
        "print": {"bounding_box_mm": [10.0, 20.0, 30.0], "mass_g": 5.0},
        "verdict": {**VERDICT, "reasons": [_WORDS], "lost": lost},
    }  # fmt: skip
    return report_with(**sections | more)


def test_a_build_shows_verdict_and_pictures_with_text_escaped(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 900, 3), dtype=np.uint8)
    for name in ("compare-front.png", "part.png"):
        Image.fromarray(noise).save(tmp_path / name)
    page = knotfab.Outcome(1, _report(), tmp_path / "<b>")._repr_html_()
    assert page is not None and _pictures(page) == 0  # no folder of that name, and no error
    page = knotfab.Outcome(1, _report(), tmp_path)._repr_html_()
    assert page is not None and _pictures(page) == 2 and len(page) < 1_500_000
    for words in ("Not ready.", "Warning: coarse.", "clearance failed", "98.8% alike", "one knot",
                  "An ear is lost.", "Mind the lamp.", "&lt;script&gt;", "10 × 20 × 30 mm"):  # fmt: skip
        assert words in page, words
    page = knotfab.Outcome(0, _report(verdict=None, checks=[]), tmp_path)._repr_html_()
    assert page is not None and "Verified." in page


@pytest.mark.slow
def test_pictures_of_a_long_sequence_stay_within_bounds(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (600, 1500, 3), dtype=np.uint8)
    for number in range(8):
        Image.fromarray(noise).save(tmp_path / f"compare-{number}.png")
    page = knotfab.Outcome(1, _report(), tmp_path)._repr_html_()
    assert page is not None and 0 < _pictures(page) < 8 and len(page) < 1_500_000


@pytest.mark.slow
def test_every_stage_shows_itself_and_its_repr_is_short() -> None:
    target = knotfab.read_picture("text:I")
    question = knotfab.pose_question(knotfab.Scene(), [target])
    question, radius, start = knotfab.choose_tube(question, "sketch")
    found = knotfab.search_knots(question, start, radius, "sketch")
    design = knotfab.settle_design(question, found, "sketch")
    part = knotfab.assemble_part(design, [target])
    for thing, words in (
        (target, "px"), (question, "clearance"), (start, "closed curve"), (found, "IoU"),
        (design, "one knot of a tube"), (part, "as it is printed"),
    ):  # fmt: skip
        page = thing._repr_html_()
        assert page is not None and words in page, type(thing)
        assert _pictures(page) == 1 and len(page) < 400_000
        assert len(repr(thing)) < 2000 and repr(thing).startswith(type(thing).__name__)


def test_a_name_that_is_markup_stays_text() -> None:
    target = Target(_WORDS, np.eye(20, dtype=bool), b"", 20, 20, notes=(_WORDS,))
    page = target._repr_html_()
    assert page is not None and _pictures(page) == 1 and page.count("&lt;script&gt;") == 2
    assert "array" not in repr(target) and "<20×20 bool>" in repr(target)
