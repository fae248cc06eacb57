"""G-code is read as it stands: figures, lines, supports; a cut or foreign file is refused."""

from pathlib import Path

import numpy as np
import pytest
from slicer_parts import gcode_text

from knotfab.slicer.gcode import BadGcode, points_along, read_gcode

SUPPORTED = """G1 X14 Y30 E1.5
;TYPE:Support material
G1 X0 Y0 F9000
G1 X100 Y0 E1
;TYPE:Support material interface
G1 X100 Y1.25 E1
;LAYER_CHANGE
;Z:0.4
G1 Z.4 F9000
;TYPE:Skirt/Brim
G1 X-7 Y.5 E3
G1 X1 Y1 E-.8
;TYPE:External perimeter
G1 X2 Y1 F9000
G1 X2 Y3 Z.6 F9000
G1 X5 Y3 E2
"""


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_figures(tmp_path: Path) -> None:
    found = read_gcode(_write(tmp_path / "a.gcode", gcode_text()))
    assert (found.program, found.version) == ("PrusaSlicer", "2.5.0")
    assert found.time_s == 3723
    assert (found.filament_mm, found.filament_cm3, found.filament_g) == (100.5, 0.24, 0.3)
    assert (found.layers, found.support_share) == (1, 0.0)
    assert np.array_equal(found.start, [[10, 20, 0.2]]) and np.array_equal(
        found.end, [[14, 23, 0.2]]
    )


@pytest.mark.parametrize(
    ("text", "seconds"), [("5s", 5), ("1m 0s", 60), ("2d 1h 0m 1s", 176401), ("22h 49m 37s", 82177)]
)
def test_durations(tmp_path: Path, text: str, seconds: int) -> None:
    assert read_gcode(_write(tmp_path / "a.gcode", gcode_text(time=text))).time_s == seconds


def test_lines_of_the_part_supports_and_the_rest(tmp_path: Path) -> None:
    found = read_gcode(_write(tmp_path / "a.gcode", gcode_text(SUPPORTED)))
    part = np.array(
        [[10, 20, 0.2, 14, 23, 0.2], [14, 23, 0.2, 14, 30, 0.2], [2, 3, 0.4, 5, 3, 0.4]]
    )
    assert np.array_equal(np.hstack([found.start, found.end]), part)
    assert found.layers == 2
    assert found.support_share == pytest.approx(2 / (0.5 + 1.5 + 2 + 3 + 2))
    # the extent is that of everything laid, the skirt too, but of no travel
    assert np.array_equal(found.low, [-7, 0, 0.2]) and np.array_equal(found.high, [100, 30, 0.4])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "which program"),
        ("G28\nG1 X1 Y1 E1\n", "which program"),
        (gcode_text(tail=""), "cut off"),
        (gcode_text().replace("(normal mode)", ""), "no printing time"),
        (gcode_text().replace("[cm3]", "[oz]"), "no filament in cm3"),
        (gcode_text().replace("100.50", "1.0.5"), "no filament in mm"),
        (gcode_text().replace("E.5", ""), "prints nothing"),
        (gcode_text().replace("G1 X", "G2 X"), "prints nothing"),
        (gcode_text().replace("TYPE:Perimeter", "TYPE:Support material"), "prints nothing"),
        (gcode_text().replace(";Z:0.2", ";Z:up"), "at no height"),
        (gcode_text().replace(";Z:0.2", ";Z:inf"), "not finite"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(BadGcode, match=why):
        read_gcode(_write(tmp_path / "a.gcode", text))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadGcode, match="cannot be read"):
        read_gcode(tmp_path / "none.gcode")


def test_lines_that_are_no_moves_are_passed_over(tmp_path: Path) -> None:
    """Such lines hold letters for a number, bytes of no encoding, or returns before their end."""
    text = gcode_text("G1 X1.2.3 Y4 E1\nG1 Xa Y4 E1\n G1 X99 Y99 E1\nG1 X- Y4 E1")
    content = text.encode().replace(b"G92 E0", b"G92 \xff\xfe").replace(b"\n", b"\r\n")
    (tmp_path / "a.gcode").write_bytes(content)
    found = read_gcode(tmp_path / "a.gcode")
    assert np.array_equal(found.end, [[14, 23, 0.2]]) and found.time_s == 3723


def test_points_along_lines() -> None:
    start = np.array([[0.0, 0, 0], [5, 5, 5], [1, 0, 0]])
    end = np.array([[2.0, 0, 0], [5, 5, 5], [1, 2.5, 0]])
    found = points_along(start, end, 1.0)
    assert np.array_equal(found[:3], np.array([[0.5, 0, 0], [1.5, 0, 0], [5, 5, 5]]))
    assert found[3:, 1] == pytest.approx([2.5 / 6, 1.25, 12.5 / 6]) and len(found) == 6
