"""How tests of this folder draw SVG files: in their own process."""

from typing import Any

import pytest
import resvg_py

from knotfab.picture.svg import render
from knotfab_formats.libraries import took_part


@pytest.fixture
def drawn_apart() -> None:
    """Let a process of its own, with limits, draw this test's SVG files, as in a build."""


@pytest.fixture(autouse=True)
def _draw_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw SVG files in this process: to start another takes longer than to draw most of them.

    What the library refuses is drawn once more as in a build, which says why.
    """
    if "drawn_apart" in request.fixturenames:
        return
    apart = render.draw_svg

    def draw(svg: str, what: str, **options: Any) -> bytes:
        took_part("resvg-py", "drew the SVG")
        try:
            return bytes(resvg_py.svg_to_bytes(svg_string=svg, **options))
        except ValueError:
            return apart(svg, what, **options)

    monkeypatch.setattr(render, "draw_svg", draw)
