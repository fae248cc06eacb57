"""The shadow in Braille: as large as the tube's, where it is, and never larger than what there is."""

import numpy as np
import pytest

from knotfab.base.arrays import Array, Mask
from knotfab.cli.terminal_shadow import draw_shadow
from knotfab.knots import Knot, Knots
from knotfab_formats.scene import ResolvedView

VIEW = ResolvedView(frame_width_mm=160.0, frame_height_mm=120.0)
FLAT = VIEW.magnification  # the magnification of a body in the middle of the piece


def ellipse(across: float, up: float, radius: float, count: int = 300) -> Knots:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points: Array = np.stack([across * np.cos(t), up * np.sin(t), 0 * t], axis=1)
    return Knots((Knot(points),), radius)


def dots(lines: str) -> Mask:
    """Find which dots are set, by the code chart of Braille patterns: 1 2 3 7 down the left, 4 5 6 8 the
    right."""
    places = {
        0: (0, 0), 1: (1, 0), 2: (2, 0), 6: (3, 0), 3: (0, 1), 4: (1, 1), 5: (2, 1), 7: (3, 1),
    }  # fmt: skip
    rows = lines.split("\n")
    found = np.zeros((4 * len(rows), 2 * max(map(len, rows))), dtype=bool)
    for r, row in enumerate(rows):
        for c, character in enumerate(row):
            code = ord(character) - 0x2800
            for bit, (down, right) in places.items():
                found[4 * r + down, 2 * c + right] = character != " " and code >> bit & 1
    return found


@pytest.mark.parametrize("count", [12, 300, 20000])  # vertices: few, or far more than dots
def test_a_ring_darkens_its_area(count: int) -> None:
    seen = dots(draw_shadow([VIEW], ellipse(40.0, 30.0, 6.0, count), 80, 24))
    mm = 160.0 / 128  # a dot: the frame's 120 mm are 96 dots high, 128 wide
    assert seen.shape[0] == 96 and abs(seen.shape[1] - 128) <= 2
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    corners = FLAT * np.stack([40 * np.cos(t), 30 * np.sin(t)], axis=1)
    length = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).sum()
    assert seen.sum() * mm**2 == pytest.approx(2 * 6.0 * FLAT * length, rel=0.06)
    rows, columns = np.nonzero(seen)
    assert rows.mean() == pytest.approx(47.5, abs=0.7)
    assert columns.mean() == pytest.approx(63.5, abs=0.7)
    assert not seen[44:52, 60:68].any()


def test_it_keeps_to_what_there_is() -> None:
    tall = VIEW.model_copy(update={"frame_width_mm": 30.0, "frame_height_mm": 200.0})
    wide = VIEW.model_copy(update={"frame_width_mm": 900.0, "frame_height_mm": 100.0})
    for views in ([VIEW], [tall], [wide], [tall, VIEW], [VIEW, VIEW, VIEW]):
        for columns, rows in ((24, 8), (96, 24), (40, 30)):
            lines = draw_shadow(views, ellipse(40.0, 30.0, 6.0), columns, rows).split("\n")
            assert len(lines) <= rows and max(map(len, lines)) <= columns
    two = draw_shadow([tall, VIEW], ellipse(40.0, 30.0, 6.0), 96, 24)
    assert max(map(len, two.split("\n"))) > 64  # both are there


def test_what_leaves_the_frame_is_no_error() -> None:
    assert dots(draw_shadow([VIEW], ellipse(4000.0, 3000.0, 1.0), 80, 24)).sum() == 0
