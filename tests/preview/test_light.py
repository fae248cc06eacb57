"""What does not need torch or VTK is refused, and previewed, before they load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CALLS = """
import sys
from knotfab.cli.app import main

def call(*words):
    try:
        main([*words])
    except SystemExit as left:
        heavy = {"torch", "vtkmodules", "pyvista", "matplotlib", "cadquery"} & set(sys.modules)
        print(left.code, sorted(heavy), file=sys.stdout)

call("build", "missing.png")
assert "scipy" not in sys.modules  # it takes as long to load as all else
for picture in ("missing.png", "blank.png", "broken.png"):
    call("build", picture)
    call("preview", picture)
for wrong in (["--threshold", "2"], ["--ink", "plaid"], ["--crop", "1,2"], ["--width", "-3"],
              ["--lamp-distance", "0"], ["--tube-radius", "thick"], ["--printer", "typewriter"],
              ["--tube-radius", "0.1"], ["--nonsense", "1"], ["--crop", "0,0,9000,20"]):
    call("build", "good.png", *wrong)
call("preview", "good.png", "--json")
"""


@pytest.mark.slow
def test_nothing_heavy_loads_before_it_is_needed(tmp_path: Path) -> None:
    Image.new("L", (80, 80), 255).save(tmp_path / "blank.png")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nnot one")
    shape = np.full((80, 80), 255, dtype=np.uint8)
    shape[20:60, 20:60] = 0
    Image.fromarray(shape).save(tmp_path / "good.png")
    done = subprocess.run(
        [sys.executable, "-c", CALLS], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    ended = [line for line in done.stdout.splitlines() if line.endswith("]")]
    codes = ["2"] * 7 + ["2"] * 7 + ["1", "2", "2"] + ["0"]
    assert ended == [f"{code} []" for code in codes], done.stdout + done.stderr
    refused = done.stderr.splitlines()
    assert len(refused) == 17 and all(line.startswith("knotfab: ") for line in refused)
    assert (tmp_path / "knotfab-preview.png").is_file()
    assert not (tmp_path / "knotfab-out").exists()
