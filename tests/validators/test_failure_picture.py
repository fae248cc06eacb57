"""The picture of what failed: drawn when something required failed, marked where the checks say."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import circle, tube

from knotfab_validators.check import Check, at_most
from knotfab_validators.failure_picture import MARK, PANEL_PX, draw_failures
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh

RING = circle(60, 20.0)
MESH = Mesh(*tube(RING, 3.0, 24))


def fail_at(at: tuple[float, float, float] = (23.0, 0.0, 0.0), *, required: bool = True) -> Check:
    return at_most("hole", 3, 0, "edges", "an open edge", required=required, at=[at])


def size(path: Path) -> tuple[int, int]:
    with Image.open(path) as sheet:
        return sheet.size


def red(path: Path) -> np.ndarray:
    """(n, 2) pixels (u, v) of the marks, above the sentences."""
    with Image.open(path) as opened:
        sheet = np.asarray(opened.convert("RGB"))[: PANEL_PX + 14]
    rows, columns = np.nonzero((sheet == MARK).all(axis=2))
    return np.column_stack([columns, rows])


def test_nothing_is_drawn_unless_something_required_failed(tmp_path: Path) -> None:
    path = tmp_path / "f.png"
    passed = at_most("hole", 0, 0, "edges", "")
    assert not draw_failures(path, [passed, fail_at(required=False)], MESH, None)
    assert not draw_failures(path, [fail_at()], None, None)
    assert not path.exists()


@pytest.mark.slow
def test_the_marks_lie_where_the_place_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "f.png"
    assert draw_failures(path, [fail_at()], MESH, None)
    marks = red(path)
    # from above +x is on the right; from the front too; from the right it is in the middle
    scale, pitch = (PANEL_PX - 48) / 46.0, PANEL_PX + 14
    for panel, x in enumerate((23.0, 23.0, 0.0)):
        u = 14 + panel * pitch + PANEL_PX / 2 + x * scale
        ring = np.hypot(marks[:, 0] - u, marks[:, 1] - (14 + PANEL_PX / 2))
        assert np.count_nonzero(np.abs(ring - 6.5) < 1.5) > 20, panel
    far = tmp_path / "far.png"
    assert draw_failures(far, [fail_at((1e9, 0, 0))], MESH, None)  # at the edge, not outside
    assert len(red(far)) > 50


@pytest.mark.slow
def test_meshes_that_are_broken_and_curves_alone_are_drawn_too(tmp_path: Path) -> None:
    broken = Mesh(MESH.vertices.copy(), np.vstack([MESH.faces[::7], [[0, 0, 0]]]))
    broken.vertices[5] = np.nan
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    curves = Curves((RING,), ("unknot",), (True,), 3.0)
    for number, (mesh, lines) in enumerate([(broken, None), (flat, None), (None, curves)]):
        path = tmp_path / f"{number}.png"
        assert draw_failures(path, [fail_at()], mesh, lines)
        assert size(path)[0] > 3 * PANEL_PX


@pytest.mark.slow
def test_every_failure_has_its_sentence(tmp_path: Path) -> None:
    few, many = tmp_path / "few.png", tmp_path / "many.png"
    draw_failures(few, [fail_at()], MESH, None)
    draw_failures(many, [fail_at(), fail_at((0, 23, 0)), fail_at((0, 0, 3))], MESH, None)
    assert size(many)[1] == size(few)[1] + 2 * 19
