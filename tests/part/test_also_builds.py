"""Whole builds with files for other tools: of wire, and of several views (a sequence has its own test)."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import picture

import knotfab

V, U = np.mgrid[:80, :80]
RING = np.abs(np.hypot(U - 40, V - 40) - 26) < 5
BAR = (np.abs(U - 40) < 6) & (np.abs(V - 40) < 31)


@pytest.mark.build
@pytest.mark.parametrize(
    ("names", "options"),
    [
        (("ring",), {"material": "steel-wire-2mm", "size": 36.0}),
        (("ring", "bar"), {"size": 90.0}),
    ],
)
def test_a_build_writes_all_that_was_asked_for(
    tmp_path: Path, names: tuple[str, ...], options: dict[str, Any]
) -> None:
    shapes = {"ring": RING, "bar": BAR}
    files = [str(picture(tmp_path / f"{name}.png", shapes[name])) for name in names]
    rest = {"accuracy": "sketch", "also": "svg,dxf,step", "skip": ("slicer", "shadow-render")}
    made = knotfab.build(files, tmp_path / "out", **options, **rest)
    there = {path.name for path in made.folder.iterdir()}
    assert {f"centre-lines.{kind}" for kind in ("svg", "dxf", "step")} | {"part.step"} <= there
    views = [view["name"] for view in made.report["views"]]
    assert {f"shadow-{view}.svg" for view in views} <= there and len(views) == len(names)
    assert ("bends-lra.csv" in there) == ("material" in options)
