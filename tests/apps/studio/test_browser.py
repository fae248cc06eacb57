"""The studio's page in a real browser: from an empty page to a built part by mouse alone.

The build is played.
"""

import asyncio
import shutil
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from command import picture, square
from played_runs import write_player

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")
pytest.importorskip("playwright", reason="pip install playwright")
import uvicorn
from playwright.sync_api import expect, sync_playwright

from knotfab.apps.studio.run import make_app
from knotfab.apps.studio.session import Studio

expect.set_options(timeout=120_000)  # ms: a busy machine answers late, which is no fault of a page
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no browser here: apt-get install chromium"),
]
TOKEN = "a-token"
AXE = Path(__file__).parents[3] / "web" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.fixture
def address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A studio that runs, whose builds are played."""
    script, _ = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()  # so that a page that asks before the server runs waits for it
        host = f"127.0.0.1:{listening.getsockname()[1]}"
        app = make_app(Studio(tmp_path / "studio", warm=False), TOKEN, 0)
        server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=2))
        serving = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
        serving.start()
        yield f"http://{host}/?token={TOKEN}"
        server.should_exit = True
        serving.join(20)
    assert not serving.is_alive()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    """An empty page; whatever its console says against it fails the test."""
    wrong: list[str] = []
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    opened.set_default_timeout(60_000)
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on(
        "console",
        lambda m: wrong.append(m.text) if m.type == "error" and "422" not in m.text else None,
    )
    opened.goto(address)
    opened.wait_for_selector("html[data-ready]", state="attached")
    yield opened
    opened.close()
    assert wrong == []


def violations(page: Any) -> list[Any]:
    """What axe-core finds in what is shown; nothing where it is not installed."""
    if not AXE.is_file():
        return []
    # beside the page's own scripts: its policy lets no other in
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate(
        "axe.run(document, {iframes: false})"
        ".then((r) => r.violations.map((v) => [v.id, v.nodes.map((n) => n.html)]))"
    )
    return list(found)


def test_from_an_empty_page_to_a_built_part_by_mouse_alone(page: Any, tmp_path: Path) -> None:
    drawn = picture(tmp_path / "drawing.png", square(64))
    page.set_input_files("#file", drawn)
    page.wait_for_selector("#survey:not([hidden])")  # the losses of a tube are shown
    assert "1 piece" in page.inner_text("#survey-lines")
    assert violations(page) == []
    page.click("summary:has-text('Read it otherwise')")
    assert violations(page) == []
    page.fill("#smooth", "much")
    page.click("#build")  # a wrong field is marked where it stands, and nothing is built
    page.wait_for_selector("#smooth[aria-invalid=true]:focus")
    assert "This is no number" in page.inner_text("#smooth-wrong") and page.is_hidden("#stop")
    assert violations(page) == []
    page.select_option("#plate", "rounded")
    with page.expect_response("**/api/settings"):  # what is told meanwhile leaves what is typed
        page.select_option("#supports", "slicer")
        page.fill("#smooth", "1,5")
    page.wait_for_timeout(300)
    assert page.input_value("#smooth") == "1,5"
    page.locator("#smooth").blur()
    page.wait_for_selector("#smooth:not([aria-invalid])")
    page.locator("input[value=wall]").check(force=True)
    page.click("#build")
    page.wait_for_selector("#result:not([hidden])")
    assert page.inner_text("#verdict") == "Good"
    assert violations(page) == []
    page.click("#tab-live")
    page.wait_for_selector("html[data-frames]", state="attached")  # the knots were drawn
    page.emulate_media(color_scheme="dark")
    assert violations(page) == []
    page.click("#tab-result")
    with page.expect_download() as loading:
        page.click("#download")
    assert Path(loading.value.path()).read_text() == "a part"
    assert page.frame_locator("#report").locator("body").inner_text() == "report"
    assert (tmp_path / "studio" / "builds" / "drawing" / "part.3mf").is_file()

    page.click("#build")  # again: the one before stays
    page.wait_for_selector("#builds li:nth-child(2)")
    assert page.inner_text("#builds li:nth-child(1) .open").startswith("drawing 2")
    page.click("#builds li:nth-child(2) .open")
    page.wait_for_selector("#builds [aria-current=true]")
    page.reload()  # the state is the server's
    page.wait_for_selector("#survey:not([hidden])")
    assert page.is_checked("input[value=wall]") and page.input_value("#plate") == "rounded"
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    panel, stage = (page.locator(part).bounding_box() for part in ("#panel", "#stage"))
    assert stage["y"] < panel["y"]  # the preview above the settings
    page.focus("#tab-file")  # and by keyboard
    page.keyboard.press("ArrowRight")
    assert page.is_visible("#text")
    page.fill("#text", "wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector("#survey-lines :text('wrong:')")  # in place of the drawing
    page.focus("#build")
    page.keyboard.press("Enter")
    page.wait_for_selector("#said.bad")
    assert page.inner_text("#said") == "text:wrong: no picture. Draw one."
