"""Pages as people see them: in a headless Chromium, and the PDFs that matplotlib wrote, in mm."""

from __future__ import annotations

import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser


NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Debian's Chromium, driven by Playwright; the test is skipped where either is missing."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("Chromium is not installed (apt-get install --no-install-recommends chromium)")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=OPTIONS)
        try:
            yield browser
        finally:
            browser.close()


POINT = 72 / 25.4  # points in a mm


def page_sizes(path: Path) -> np.ndarray:
    """(k, 2) width and height of each page."""
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", path.read_bytes())
    return np.array(boxes, dtype=float) / POINT


def page_contents(path: Path) -> list[str]:
    """The drawing commands of its pages, and of what else in it is drawn."""
    found = []
    for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.DOTALL):
        try:
            found.append(zlib.decompress(part).decode("latin-1"))
        except zlib.error:  # a font's own
            continue
    return found


def segments(text: str) -> np.ndarray:
    """(k, 4) the lines of one move and one line."""
    pairs = re.findall(r"([-\d.]+) ([-\d.]+) m\n([-\d.]+) ([-\d.]+) l\n", text)
    return np.array(pairs, dtype=float).reshape(-1, 4) / POINT
