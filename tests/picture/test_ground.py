"""Drawings on a sheet within the picture, on a painted board, on squares, and pale ones with a dark spot."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.picture.read import read_target
from knotfab_formats.errors import InputError

SIDE = 400
KITE = [(150, 110), (250, 140), (235, 260), (170, 230)]
INK = 9956 / SIDE**2  # of the kite


def kite(ground: Image.Image, colour: tuple[int, ...]) -> Image.Image:
    ImageDraw.Draw(ground).polygon(KITE, fill=colour)
    return ground


def sheet(around: tuple[int, ...], paper: tuple[int, ...], turn: float, inset: int) -> Image.Image:
    page = kite(Image.new("RGBA", (SIDE, SIDE), paper), (20, 20, 20, 255))
    page = page.resize((SIDE - 2 * inset,) * 2).rotate(turn, Image.Resampling.BICUBIC, expand=True)
    whole = Image.new("RGBA", (max(SIDE, page.width),) * 2, around)
    at = (whole.width - page.width) // 2
    whole.alpha_composite(page, (at, at))
    return whole


def bars(axis: int) -> Image.Image:
    picture = np.array(kite(Image.new("RGB", (SIDE, SIDE), "white"), (20, 20, 20)))
    picture = np.moveaxis(picture, axis, 0)
    picture[:60] = picture[-60:] = 0
    return Image.fromarray(np.ascontiguousarray(np.moveaxis(picture, 0, axis)))


def board(tile: int, pale: int, dark: int, colour: tuple[int, ...]) -> Image.Image:
    rows, columns = np.indices((SIDE, SIDE)) // tile
    levels = np.where((rows + columns) % 2, dark, pale).astype(np.uint8)
    return kite(Image.fromarray(np.stack([levels] * 3, -1)), colour)


def squares(step: int, tone: tuple[int, ...]) -> Image.Image:
    picture = Image.new("RGB", (SIDE, SIDE), "white")
    pen = ImageDraw.Draw(picture)
    for at in range(0, SIDE, step):
        pen.line([(at, 0), (at, SIDE)], fill=tone)
        pen.line([(0, at), (SIDE, at)], fill=tone)
    return kite(picture, (20, 20, 20))


def spotted(body: tuple[int, ...], spot: tuple[int, ...]) -> Image.Image:
    picture = kite(Image.new("RGB", (SIDE, SIDE), "white"), body)
    ImageDraw.Draw(picture).ellipse([190, 160, 206, 176], fill=spot)
    return picture


WHITE, CLEAR = (255, 255, 255, 255), (0, 0, 0, 0)
CASES = {
    "a scan turned in an editor": (sheet(CLEAR, WHITE, 5, 0), "a sheet of paper"),
    "a sheet with clear margins": (sheet(CLEAR, WHITE, 0, 40), "a sheet of paper"),
    "paper on a table": (sheet((118, 82, 52, 255), (245, 243, 238, 255), -8, 60), "a sheet of paper"),
    "a dark surround": (sheet((0, 0, 0, 255), WHITE, 0, 40), "a sheet of paper"),
    "bars above and below": (bars(0), "a sheet of paper"),
    "bars at the sides": (bars(1), "a sheet of paper"),
    "a white kite on a board": (board(16, 255, 204, (255, 255, 255)), "a painted checkerboard"),
    "a grey kite on a board": (board(10, 255, 229, (229, 229, 229)), "a painted checkerboard"),
    "a red kite on a board": (board(16, 255, 204, (200, 30, 30)), "a painted checkerboard"),
    "grey squares": (squares(20, (170, 170, 170)), "squared paper"),
    "blue squares": (squares(16, (150, 190, 230)), "squared paper"),
    "a yellow body": (spotted((255, 228, 110), (0, 0, 0)), "paler than its darkest spot"),
    "a pencil's grey": (spotted((195, 195, 195), (10, 10, 10)), "paler than its darkest spot"),
}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
def test_a_drawing_is_read_on_any_ground(tmp_path: Path, kind: str) -> None:
    picture, words = CASES[kind]
    picture.save(tmp_path / "drawing.png")
    target = read_target(tmp_path / "drawing.png")
    assert words in " ".join(target.notes)
    assert 0.4 * INK < target.mask.mean() < 1.15 * INK
    assert target.pieces == 1 and not target.mask[:5].any()
    if target.threshold is None:  # the picture beside the scene gives the same mask again
        (tmp_path / "again.png").write_bytes(target.png_bytes)
        assert (read_target(tmp_path / "again.png").mask == target.mask).all()


PLAIN = {
    "a kite": kite(Image.new("RGB", (SIDE, SIDE), "white"), (0, 0, 0)),
    "a light kite on black": kite(Image.new("RGB", (SIDE, SIDE), "black"), (250, 250, 250)),
    "a white square on black": Image.fromarray(np.pad(np.full((200, 200), 255, np.uint8), 100)),
    "a kite cut out": kite(Image.new("RGBA", (SIDE, SIDE), CLEAR), (255, 255, 255, 255)),
    "a kite of two tones": spotted((60, 60, 60), (0, 0, 0)),
}


@pytest.mark.parametrize("kind", PLAIN)
def test_plain_drawings_are_left_as_they_are(tmp_path: Path, kind: str) -> None:
    PLAIN[kind].save(tmp_path / "drawing.png")
    assert not read_target(tmp_path / "drawing.png").notes


def test_unused_alpha_of_a_bmp_is_none(tmp_path: Path) -> None:
    rgba = kite(Image.new("RGBA", (SIDE, SIDE), (255, 255, 255, 0)), (0, 0, 0, 0))
    rgba.save(tmp_path / "a.bmp")
    assert read_target(tmp_path / "a.bmp").mask.mean() == pytest.approx(INK, rel=0.1)


@pytest.mark.parametrize(
    ("source", "words"), [("text:A\nB", "several lines"), ("'a.png'", "quotes about it")]
)
def test_what_is_no_picture_is_told(source: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_target(source)


def test_addresses_of_files_and_soft_hyphens_are_read(tmp_path: Path) -> None:
    PLAIN["a kite"].save(tmp_path / "my kite.png")
    uri = (tmp_path / "my kite.png").as_uri()
    assert read_target(uri).mask.mean() == pytest.approx(INK, rel=0.1)
    assert (read_target("text:A\u00adB").mask == read_target("text:AB").mask).all()
