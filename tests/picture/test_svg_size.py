"""Sizes of SVG pages: the same drawing in every unit gives the same picture."""

from pathlib import Path

import pytest

from knotfab.picture.read import Target, read_target
from knotfab_formats.errors import InputError

SIDE = 512  # px: tests/conftest.py draws no larger
VIEW_BOX = 'viewBox="0 0 40 20"'


def sized_svg(tmp_path: Path, size: str, unit: str = "", box: bool = True) -> Target:
    """A drawing of 40 x 20 user units, a quarter of it a block left of its middle and below the top.

    Without a viewBox its shapes are given in `unit`, as the page is.
    """
    u = "" if box else unit
    path = tmp_path / "sized.svg"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} {VIEW_BOX * box}>'
        f'<rect x="5{u}" y="5{u}" width="20{u}" height="10{u}"/></svg>'
    )
    return read_target(path)


def check_block(target: Target, *, size: tuple[int, int] = (SIDE, SIDE // 2)) -> None:
    """The block lies where the drawing has it, its page `size` pixels."""
    assert (target.width, target.height) == size
    rows, columns = target.mask.any(axis=1).nonzero()[0], target.mask.any(axis=0).nonzero()[0]
    edges = [
        columns[0] / SIDE, (columns[-1] + 1) / SIDE, 2 * rows[0] / SIDE, 2 * (rows[-1] + 1) / SIDE,
    ]  # fmt: skip
    assert edges == pytest.approx([1 / 8, 5 / 8, 1 / 4, 3 / 4], abs=4e-3)


UNITS = ["mm", "cm", "in", "pt", "pc", "px", "em", "ex", ""]


@pytest.mark.parametrize("unit", [*UNITS, "%", "e1mm", " mm ", "MM", "Q"])
def test_svg_sizes_of_every_unit_with_a_view_box(tmp_path: Path, unit: str) -> None:
    size = (
        f'width="100{unit}" height="100{unit}"'
        if unit == "%"
        else f'width="40{unit}" height="20{unit}"'
    )
    check_block(sized_svg(tmp_path, size, unit))


@pytest.mark.parametrize("unit", UNITS)
def test_svg_sizes_of_every_unit_without_a_view_box(tmp_path: Path, unit: str) -> None:
    check_block(sized_svg(tmp_path, f'width="40{unit}" height="20{unit}"', unit, box=False))


@pytest.mark.parametrize("size", ['width="30mm"', 'height="7pt"', "", 'width="3vw" height="auto"'])
def test_svg_sides_that_are_left_out_follow_from_the_view_box(tmp_path: Path, size: str) -> None:
    check_block(sized_svg(tmp_path, size))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "height"), [("1in", "2cm"), ("30mm", "85.04pt"), ("2pc", "20px")]
)
def test_svg_page_has_the_ratio_of_its_sides(tmp_path: Path, width: str, height: str) -> None:
    pixels = {"in": 96, "cm": 96 / 2.54, "mm": 96 / 25.4, "pt": 96 / 72, "pc": 16, "px": 1}
    w, h = (float(side[:-2]) * pixels[side[-2:]] for side in (width, height))
    target = sized_svg(tmp_path, f'width="{width}" height="{height}"')
    expected = (SIDE * w / max(w, h), SIDE * h / max(w, h))
    assert (target.width, target.height) == pytest.approx(expected, abs=1.1)


@pytest.mark.parametrize(
    "size", ['width="0mm" height="9mm"', 'width="4" height="-2"', 'width="0%"']
)
def test_svg_of_no_size_is_refused(tmp_path: Path, size: str) -> None:
    with pytest.raises(InputError, match="its size is nothing"):
        sized_svg(tmp_path, size)
