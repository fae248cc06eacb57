"""Parts that are written larger, for their material shrinks: measured as they will be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import PlainView, circle, tube

from examples.corpus.files import encode
from examples.corpus.parts import Body
from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.validate import validate

VIEW = PlainView(frame_width_mm=120.0, frame_height_mm=120.0)
LEFT = 0.97  # of every length
POSE = np.array([[0.0, 1, 0, -5], [0, 0, 1, 7], [1, 0, 0, 3], [0, 0, 0, 1]])


def write(folder: Path, part: float, knots: float, pose: float) -> Path:
    """A ring of 30 mm and its picture; part and knots written so much larger, and a pose that shrinks so."""
    curve = circle(120, 30.0)
    vertices, faces = tube(curve, 2.0, 24)
    seen = view_geometry(VIEW, 256, 256)
    dark = shadow_mask(shadow_lines(vertices, faces, seen), seen)
    Image.fromarray(np.where(dark, 0, 255).astype(np.uint8)).save(folder / "front.png")
    turn, shift = POSE[:3, :3], POSE[:3, 3]
    body = Body(part * (vertices - shift) @ turn, faces)
    (folder / "part.stl").write_bytes(encode(body, "stl"))
    points = (knots * (curve - shift) @ turn).tolist()
    told = {"schema": 1, "unit": "mm", "radius_mm": 2.0 * knots}
    told["knots"] = [{"closed": True, "type": "unknot", "points": points}]
    (folder / "knots.json").write_text(json.dumps(told))
    matrix = POSE * [[pose], [pose], [pose], [1]]
    matrix[:3, 3] = shift
    (folder / "scene.toml").write_text(
        "[piece]\ntube_radius_mm = 2.0\n[material]\nshrinkage_percent = 3.0\n"
        '[[views]]\npicture = "front.png"\nframe_width_mm = 120.0\nframe_height_mm = 120.0\n'
        '[accuracy]\niou_floor = 0.9\n[effects]\nmisplacement = "off"\n'
        f"[pose]\nmatrix = {matrix.tolist()}\n"
    )
    return folder


def fails(folder: Path) -> set[str]:
    files = [folder / name for name in ("part.stl", "knots.json", "scene.toml")]
    found = validate(*files, skip=("shadow-render",), only="shadows").checks
    return {check.name for check in found if check.status == "fail" and check.required}


def test_it_is_measured_as_it_shrinks(tmp_path: Path) -> None:
    assert not fails(write(tmp_path, 1 / LEFT, 1 / LEFT, LEFT))


def test_a_part_that_was_not_enlarged_is_rejected(tmp_path: Path) -> None:
    assert "outline" in fails(write(tmp_path, 1.0, 1 / LEFT, LEFT))
    assert "shadow" in fails(write(tmp_path, 1.0, 1.0, LEFT))
    with pytest.raises(BadFile, match="shrinks the part"):
        fails(write(tmp_path, 1.0, 1.0, 1.0))
    with pytest.raises(BadFile, match="shrinks the part"):
        fails(write(tmp_path, 1 / LEFT, 1 / LEFT, 0.98))
