"""A whole build of wire with files for other tools; search/test_several.py and sequence/ have others."""

from pathlib import Path

import numpy as np
import pytest
from command import picture

import knotfab

V, U = np.mgrid[:80, :80]
RING = np.abs(np.hypot(U - 40, V - 40) - 26) < 5


@pytest.mark.build
def test_a_build_of_wire_writes_all_that_was_asked_for(tmp_path: Path) -> None:
    file = str(picture(tmp_path / "ring.png", RING))
    asked = {
        "material": "steel-wire-2mm",
        "size": 36.0,
        "accuracy": "sketch",
        "also": "svg,dxf,step",
    }
    made = knotfab.build([file], tmp_path / "out", **asked, skip=("slicer", "shadow-render"))
    there = {path.name for path in made.folder.iterdir()}
    assert {f"centre-lines.{kind}" for kind in ("svg", "dxf", "step")} | {"part.step"} <= there
    (view,) = (view["name"] for view in made.report["views"])
    assert {f"shadow-{view}.svg", "bends-lra.csv"} <= there
