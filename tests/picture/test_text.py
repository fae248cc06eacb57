"""Text as a picture: as large as its ink, in every script, or refused."""

import shutil
import subprocess
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib.tables._g_l_y_f import Glyph

from knotfab.picture import fonts
from knotfab.picture.read import Target, read_target
from knotfab.picture.silhouette import holes_of, mask_iou, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading
from tests.picture.test_read import again


@pytest.mark.slow
@pytest.mark.parametrize(("text", "side"), [("♞", 1024), ("abc", 512), ("∮", 512), ("-", 512)])
def test_text_hugs_the_ink(
    tmp_path: Path, text: str, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("text", "svg.render"):
        monkeypatch.setattr(f"knotfab.picture.{module}.LONGER_SIDE", side)
    target = read_target(f"text:{text}")
    rows, columns = target.mask.any(axis=1).nonzero()[0], target.mask.any(axis=0).nonzero()[0]
    assert max(target.width, target.height) == side
    margin = 0.06 * side
    gaps = [columns[0], target.width - 1 - columns[-1], rows[0], target.height - 1 - rows[-1]]
    assert gaps == pytest.approx([margin] * 4, abs=1.5)
    assert target.given is None and target.is_text
    assert (again(tmp_path, target).mask == target.mask).all()
    inverted = read_target(f"text:{text}", Reading(invert=True))
    assert (inverted.mask == ~target.mask).all()
    assert (again(tmp_path, inverted, invert=True).mask == target.mask).all()


def test_text_is_upright_and_reads_from_left_to_right() -> None:
    mask = read_target("text:L.").mask  # the stem is on the left, the foot below, the dot right
    assert mask[:, : mask.shape[1] // 2].sum() > mask[:, mask.shape[1] // 2 :].sum()
    assert mask[mask.shape[0] // 2 :].sum() > mask[: mask.shape[0] // 2].sum()


@pytest.mark.slow
def test_text_of_every_script_is_shaped() -> None:
    hebrew = read_target(
        "text:שלום"
    ).mask  # its last letter alone has a hole, and stands at the left
    _, columns = (holes_of(hebrew)[0] > 0).nonzero()
    assert 0 < columns.mean() < 0.3 * hebrew.shape[1]
    assert len(pieces_of(read_target("text:ممم").mask)[1]) == 1  # three letters in one stroke
    placed, whole = (read_target(f"text:{e}").mask[:, :325] for e in ("e\u0301", "é"))
    assert mask_iou(placed, whole) > 0.97
    mixed = read_target("text:א l").mask  # the first letter at the right, and the l at the left
    assert mixed[:, : mixed.shape[1] // 4].sum() < mixed[:, -mixed.shape[1] // 2 :].sum()
    rows, across = mixed.any(axis=1).nonzero()[0], mixed.any(axis=0).nonzero()[0]
    gaps = [across[0], mixed.shape[1] - 1 - across[-1], rows[0], mixed.shape[0] - 1 - rows[-1]]
    assert gaps == pytest.approx([0.06 * 512] * 4, abs=2.5)


@pytest.mark.slow
def test_text_keeps_holes_and_kerning() -> None:
    def holes(text: str) -> int:
        return len(holes_of(read_target(f"text:{text}").mask)[1])

    assert (holes("8"), holes("O"), holes("R"), holes("l"), holes("B8")) == (2, 1, 1, 0, 4)
    wide, tight = read_target("text:HH"), read_target("text:AV")
    assert tight.mask.any(axis=0)[50:-50].all()  # A and V overlap from left to right
    assert not wide.mask.any(axis=0)[50:-50].all()


@pytest.mark.slow
def test_text_with_a_variation_selector_or_another_font() -> None:
    plain, styled = read_target("text:☺"), read_target("text:☺\ufe0f")
    assert (plain.mask == styled.mask).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no visible character"), ("   ", "no visible character"), ("\ufe0f", "no visible character"),
        ("a\nb", "several lines"), ("x" * 300, "300 characters"),
    ],
)  # fmt: skip
def test_text_that_cannot_be_drawn(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_target(f"text:{text}")
    assert "\n" not in str(caught.value)


# Fonts of text pictures: one asked for by name or file, and the machine's own for what they lack.


BALL = "🧶"  # in no font that comes along
DEJAVU = Path(matplotlib.get_data_path()) / "fonts" / "ttf"


def block(width: int, height: int) -> Glyph:
    pen = TTGlyphPen(None)
    pen.moveTo((0, 0))
    for corner in ((0, height), (width, height), (width, 0)):
        pen.lineTo(corner)
    pen.closePath()
    return pen.glyph()


def write_font(path: Path, family: str, wide: int = 200) -> Path:
    """A font in which A and a ball of yarn are blocks of `wide` x 800 units."""
    glyphs = {".notdef": block(500, 500), "A": block(wide, 800), "ball": block(wide, 800)}
    build = FontBuilder(1000)
    build.setupGlyphOrder(list(glyphs))
    build.setupCharacterMap({ord("A"): "A", ord(BALL): "ball"})
    build.setupGlyf(glyphs)
    build.setupHorizontalMetrics({name: (900, 0) for name in glyphs})
    build.setupHorizontalHeader(ascent=800, descent=-200)
    build.setupNameTable({"familyName": family, "styleName": "Regular"})
    build.setupOS2()
    build.setupPost()
    build.save(path)
    return path


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine whose only font is one of blocks, as fontconfig sees it."""
    if shutil.which("fc-list") is None:
        pytest.skip("fontconfig is not installed")
    folder = tmp_path / "fonts"
    folder.mkdir()
    write_font(folder / "blocks.ttf", "Knotfab Blocks")
    (tmp_path / "fonts.conf").write_text(
        '<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd"><fontconfig>'
        f"<dir>{folder}</dir><cachedir>{tmp_path / 'cache'}</cachedir></fontconfig>"
    )
    monkeypatch.setenv("FONTCONFIG_FILE", str(tmp_path / "fonts.conf"))
    found = subprocess.run(["fc-list"], capture_output=True, text=True, check=True).stdout
    assert found.count("\n") == 1
    return folder


def check_block(source: str, wide: int, font: str | None = None) -> None:
    """The picture holds one block of `wide` to 800."""
    mask = read_target(source, font=font).mask
    rows, columns = mask.any(axis=1).sum(), mask.any(axis=0).sum()
    assert mask.sum() == pytest.approx(rows * columns, rel=5e-3)
    assert columns / rows == pytest.approx(wide / 800, rel=0.02)


def fonts_of(source: str, font: str | None = None) -> str:
    """What is told of the fonts that it was drawn from."""
    return read_target(source, font=font).rule.rpartition("[in ")[2].rstrip("]")


@pytest.mark.slow
def test_a_glyph_that_only_the_machine_has(machine: Path) -> None:
    check_block(f"text:{BALL}", 200)
    assert fonts_of(f"text:{BALL}") == "blocks.ttf"
    assert fonts_of(f"text:R{BALL}A") == "DejaVuSans.ttf, blocks.ttf"  # A comes along already


@pytest.mark.parametrize("name", ["Knotfab Blocks", "knotfab blocks"])
def test_a_font_by_its_family(machine: Path, name: str) -> None:
    check_block("text:A", 200, name)
    assert fonts_of("text:A", name) == "blocks.ttf"


@pytest.mark.slow
def test_a_font_by_its_file_and_what_it_lacks(tmp_path: Path) -> None:
    path = write_font(tmp_path / "own.ttf", "Own", wide=400)
    check_block("text:A", 400, str(path))
    assert fonts_of("text:AR", str(path)) == "own.ttf, DejaVuSans.ttf"
    plain, other = (
        read_target("text:R"),
        read_target("text:R", font=str(DEJAVU / "DejaVuSerif.ttf")),
    )
    assert plain.mask.shape != other.mask.shape or (plain.mask != other.mask).any()


@pytest.mark.slow
def test_without_fontconfig_matplotlib_names_the_fonts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib import font_manager

    path = write_font(tmp_path / "own.ttf", "Own", wide=300)
    broken = tmp_path / "broken.ttf"
    broken.write_bytes(b"no font")
    monkeypatch.setattr(fonts.shutil, "which", lambda name: None)
    monkeypatch.setattr(font_manager, "findSystemFonts", lambda: [str(path), str(broken)])
    check_block(f"text:{BALL}", 300)
    serif = read_target("text:A", font="DejaVu Serif").mask
    assert (serif == read_target("text:A", font=str(DEJAVU / "DejaVuSerif.ttf")).mask).all()


def test_a_character_that_no_font_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fonts, "_system_fonts", lambda pattern: iter(()))
    with pytest.raises(InputError, match=r"no font.*U\+1F9F6, ball of yarn"):
        read_target(f"text:{BALL}")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.ttf", "no such file"),
        ("words.ttf", "no font file"),
        ("No Such Family At All", "no font of that name"),
        ("", "no font of that name"),
    ],
)
def test_what_is_no_font(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    (tmp_path / "words.ttf").write_text("I am no font.\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        read_target("text:A", font=name)


def test_the_picture_that_is_kept_gives_the_text_again(tmp_path: Path) -> None:
    path = write_font(tmp_path / "own.ttf", "Own")
    target = read_target("text:A", font=str(path))
    path.unlink()
    assert np.array_equal(again(tmp_path, target).mask, target.mask)


def middles_of(target: Target) -> list[tuple[float, float]]:
    """Return the middle of each piece, from left to right."""
    labels, _ = pieces_of(target.mask)
    found = [np.argwhere(labels == k).mean(axis=0) for k in range(1, labels.max() + 1)]
    return sorted((float(column), float(row)) for row, column in found)


@pytest.mark.parametrize("word", ["ALPEN", "Riesling", "i j", "Öl", "A"])
def test_what_a_tube_loses_of_a_word_is_told_by_letter(word: str) -> None:
    target = read_target(f"text:{word}")
    middles = middles_of(target)
    drawn = [sign for sign in word if not sign.isspace()]
    named = [target.letters_at([middle]) for middle in middles]  # the dot of an i too
    assert sorted(set(named)) == sorted(set(drawn))
    assert target.letters_at(middles).replace(" and", ",").split(", ") == drawn


@pytest.mark.parametrize("source", ["text:مم", "text:א l"])
def test_letters_that_hang_together_have_no_names(source: str) -> None:
    assert read_target(source).letters_at([(100.0, 100.0)]) == ""
