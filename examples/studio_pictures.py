"""The pictures of the studio in README and docs: a picture is dropped, the build runs, the result.

`python -m examples.studio_pictures examples/knight.png docs` drives a real build in Chromium.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from benchmarks.measurement import run_study

COLOURS = 128
SHOWN_IOU = 0.95  # from which the running build is worth a picture


def draw(page: Page, picture: Path, out: Path) -> None:
    """Take screenshots of a build from the first drop to the result: studio-preview, -live, -result.png."""
    page.set_input_files("#file", picture)
    page.wait_for_selector("#survey:not([hidden])")
    page.wait_for_function(
        "() => [...document.querySelectorAll('#panels img')].every(i => i.complete)"
    )
    _keep(page, out / "studio-preview.png")
    page.locator("input[value=draft]").check(force=True)
    page.click("#build")
    page.wait_for_function(
        "least => parseFloat(document.getElementById('shadow-iou').textContent.slice(4)) > least",
        arg=SHOWN_IOU,
        timeout=600_000,
    )
    _keep(page, out / "studio-live.png")
    page.wait_for_selector("#result:not([hidden])", timeout=1_200_000)
    page.frame_locator("#report").locator("h1").wait_for()
    _keep(page, out / "studio-result.png")


def _keep(page: Page, path: Path) -> None:
    page.evaluate(
        "() => document.querySelectorAll('#panel, #stage').forEach(e => e.scrollTo(0, 0))"
    )
    page.wait_for_timeout(1000)
    page.screenshot(path=path)
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def _address(studio: subprocess.Popen[str]) -> str:
    """Find where the studio says that it can be opened."""
    assert studio.stdout is not None
    return next(found[0] for line in studio.stdout if (found := re.search(r"http://\S+", line)))


def main(picture: Path, out: Path, /) -> None:
    with (
        tempfile.TemporaryDirectory(prefix="knotfab-studio-") as place,
        subprocess.Popen(
            [sys.executable, "-m", "knotfab", "studio", "--no-open", "--out", place],
            stdout=subprocess.PIPE,
            text=True,
        ) as studio,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 820})
        page.set_default_timeout(300_000)
        page.goto(_address(studio))
        page.wait_for_selector("html[data-ready]", state="attached")
        draw(page, picture, out)
        browser.close()
        studio.terminate()


if __name__ == "__main__":
    run_study(main)
