"""The page of a trade-off: it holds every point, escapes names, and is driven by keys."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from pages import open_browser
from played_runs import FakeRunner, FakeStudy

from knotfab.apps.tradeoff.run import Tradeoff, measure_tradeoff
from knotfab_formats.scene import Scene

BAD = '<script>alert("&")</script>'


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Tradeoff:
    out = tmp_path_factory.mktemp("tradeoff")
    return measure_tradeoff([FakeStudy(BAD), FakeStudy("two")], Scene(), out, FakeRunner())


class _Seen(HTMLParser):
    """Tags by name with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


@pytest.mark.slow
def test_the_page_holds_every_point_and_loads_nothing(found: Tradeoff) -> None:
    page = (found.folder / "tradeoff.html").read_text()
    seen = _Seen(page)
    marks = [a for _, a in seen.tags if (a.get("class") or "").startswith("point ")]
    assert len(marks) == len(found.explored.measured)
    assert sorted(int(a["data-i"] or -1) for a in marks) == list(range(len(marks)))
    assert sum(a["tabindex"] == "0" for a in marks) == 1
    shown = json.loads(re.search(r'id="shown">(.*?)</script>', page, re.S)[1])  # type: ignore[index]
    assert len(shown["points"]) == len(marks)
    front = {m.point.label for m in found.explored.front}
    assert {p["label"] for p in shown["points"] if p["front"]} == front
    for point in shown["points"]:
        assert 0 < point["x"] < 760 and 0 < point["y"] < 480 and point["shadows"]
    assert not any({"src", "href"} & a.keys() for _, a in seen.tags)
    for step in found.steps:
        assert f"× {step.seconds:.2f}" in page


def test_every_knob_has_a_look_of_its_own(found: Tradeoff) -> None:
    """The thirteenth and what came after it were grey, with no mark beside their names."""
    page = (found.folder / "tradeoff.html").read_text()
    colours = dict(re.findall(r"\.(k\d+) \{ --knob: (#\w+)", page))
    buttons = [a for tag, a in _Seen(page).tags if tag == "button" and a.get("data-knob")]
    looks = {(colours[str(a["class"]).split()[0]], "turn" in str(a["class"])) for a in buttons}
    assert len(buttons) > 12 and len(looks) == len(buttons)


def test_names_are_escaped(found: Tradeoff) -> None:
    page = (found.folder / "tradeoff.html").read_text()
    assert "<script>alert" not in page and "&lt;script&gt;alert" in page
    assert sum(tag == "script" for tag, _ in _Seen(page).tags) == 2


@pytest.mark.slow
def test_a_point_is_looked_at_by_pointer_and_by_keys(found: Tradeoff) -> None:
    with open_browser() as browser:
        page = browser.new_page()
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda m: faults.append(m.text) if m.type == "error" else None)
        page.goto((Path(found.folder) / "tradeoff.html").as_uri())
        assert page.inner_text("#name") == "standard"
        page.locator("#shadows img").first.wait_for()
        page.locator(".point[tabindex='0']").focus()
        page.keyboard.press("End")
        last = page.inner_text("#name")
        page.keyboard.press("Home")
        assert page.inner_text("#name") != last
        assert page.locator(".point[tabindex='0']").count() == 1
        page.locator("button.plain").last.click()
        assert page.inner_text("#name") == last
        page.locator("button[data-knob]").first.click()
        assert 0 < page.locator(".point.dim").count() < len(found.explored.measured)
        assert not faults
