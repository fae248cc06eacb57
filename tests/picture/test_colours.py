"""Drawings under uneven light keep their shape; what is no drawing on paper stays as it is."""

import base64
import io
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy import ndimage
from tables import some

from benchmarks.on_paper import draw_photographs
from knotfab.base.arrays import Array, Mask
from knotfab.picture import source
from knotfab.picture.frames import read_frames
from knotfab.picture.paper import read_paper
from knotfab.picture.raster import encode_mask, own_box, silhouette_uri
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import holes_of, mask_iou, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading

Y, X = np.mgrid[:400, :400] / 400
PASSING = np.where((Y > 0.35) & (Y < 0.6), 0.55, 1.0)  # a shadow over the paper
LIGHTS = {
    "falls off": 0.95 - 0.65 * (X + Y) / 2,
    "from one side": 0.97 - 0.8 * X,
    "half in a shadow": ndimage.gaussian_filter(np.where(X + 0.5 * Y > 0.75, 0.4, 0.95), 8),
    "in a dark corner": 0.95 - 0.75 * np.clip(np.hypot(X - 0.5, Y - 0.5) / 0.7, 0, 1) ** 2,
    "a shadow across": ndimage.gaussian_filter((0.9 - 0.45 * X) * PASSING, 4),
}
DISC = np.hypot(X - 0.5, Y - 0.5) < 0.22


def drawings() -> dict[str, Mask]:
    """Two rings one on the other, a box within a pen's ring, and a thick ring."""
    far = np.hypot(X - 0.5, Y - 0.5)
    eight = (abs(np.hypot(X - 0.5, Y - 0.36) - 0.13) < 0.05) | (
        abs(np.hypot(X - 0.5, Y - 0.65) - 0.16) < 0.05
    )
    box = np.maximum(abs(X - 0.5), abs(Y - 0.5))
    return {
        "eight": eight,
        "pen": (abs(far - 0.35) < 0.01) | (abs(box - 0.12) < 0.01),
        "ring": abs(far - 0.27) < 0.07,
    }


def photograph(grey: Array) -> Image.Image:
    """Warm white paper of this brightness, with the noise of a camera."""
    noisy = grey + np.random.default_rng(1).normal(0, 0.01, grey.shape)
    colours = np.clip(noisy[..., None] * (1.0, 0.97, 0.9), 0, 1)
    return Image.fromarray((255 * colours).astype(np.uint8))


@pytest.mark.parametrize(("drawn", "light"), some(product(drawings(), LIGHTS), 4))
def test_a_drawing_keeps_its_holes(drawn: str, light: str, tmp_path: Path) -> None:
    ink = drawings()[drawn]
    photograph(LIGHTS[light] * np.where(ink, 0.12, 1.0)).save(tmp_path / "photo.jpg", quality=88)
    read = read_target(tmp_path / "photo.jpg", Reading(crop_px=False))
    assert mask_iou(read.mask, ink) > 0.95
    assert len(holes_of(read.mask)[1]) == len(holes_of(ink)[1])
    assert len(pieces_of(read.mask)[1]) == len(pieces_of(ink)[1])
    assert "uneven light on the paper" in read.notes[0]
    drawn = read_target(
        tmp_path / "photo.jpg"
    )  # by default its box, which is sized, and not the sheet
    left, top, width, height = own_box(read.mask)
    assert (drawn.mask == read.mask[top : top + height, left : left + width]).all()
    assert f"in the picture from ({left}, {top}), {width} x {height} px" in drawn.rule
    assert "--crop none keeps it" in drawn.notes[0] and "--crop" not in read.notes[0]
    (tmp_path / "kept.png").write_bytes(encode_mask(drawn.asked))
    again = read_target(tmp_path / "kept.png")  # as a build's folder has it
    assert (again.mask == drawn.mask).all() and not again.notes


@pytest.mark.parametrize(
    ("blur_px", "contrast"),
    some([(blur, far) for blur in (3, 5, 8, 10, 14) for far in (30, 45, 70)], 5),
)
def test_blotches_are_no_drawing_on_paper(blur_px: int, contrast: int) -> None:
    grain = np.random.default_rng(1).normal(size=(300, 400, 3))
    blurred = ndimage.gaussian_filter(grain, (blur_px, blur_px, 0))
    levels = contrast * blurred / blurred.std() + 128
    assert read_paper(Image.fromarray(levels.clip(0, 255).astype(np.uint8))) is None


@pytest.mark.parametrize("smooth_px", some([3.0, 0.0], 2))
def test_frames_drawn_on_paper_keep_one_box(
    tmp_path: Path, smooth_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And each is read once."""
    read = list[Image.Image]()
    monkeypatch.setattr(source, "read_paper", lambda image: read.append(image) or read_paper(image))
    for k in range(3):
        ink = np.hypot(X - 0.4 - 0.1 * k, Y - 0.5) < 0.12
        lit = LIGHTS["falls off"] * np.where(ink, 0.12, 1.0)
        photograph(lit[::2, ::2]).save(tmp_path / f"{k}.png")
    asked = Reading(smooth_px=smooth_px)
    found = read_frames([str(tmp_path)], asked)
    assert len(read) == len(found) == 3
    whole = read_frames([str(tmp_path)], asked.but(crop_px=False))
    left, top, width, height = own_box(np.logical_or.reduce([t.mask for t in whole]))
    part = np.s_[top : top + height, left : left + width]
    for one, sheet in zip(found, whole, strict=True):
        assert (one.mask == sheet.mask[part]).all() and (one.asked == sheet.asked[part]).all()
        assert one.mask.sum() == sheet.mask.sum() and "--crop none" in one.notes[-1]
    # one of them drawn by a program
    kite(Image.new("RGB", (SIDE, SIDE), "white"), (0, 0, 0)).reduce(2).save(tmp_path / "3.png")
    assert len({t.mask.shape for t in read_frames([str(tmp_path)])}) == 1


@pytest.mark.parametrize(
    "name",
    some(
        ["ballpoint, tilt on wood, mug", "wash, squared, phone, mug", "wash, lined, ghost",
         "ballpoint, yellowed, falling light, tilt, boot"], 2
    ),
)  # fmt: skip
def test_thin_strokes_are_as_wide_as_drawn_and_a_wash_has_no_holes(name: str) -> None:
    ((_, image, truth),) = (one for one in draw_photographs(name) if one[0] == name)
    read = read_paper(image)
    assert read is not None
    mask = ~np.asarray(read[0])
    assert mask_iou(mask, truth) > 0.96
    assert [len(f(mask)[1]) for f in (pieces_of, holes_of)] == [
        (f(truth)[1] > 60).sum() for f in (pieces_of, holes_of)
    ]


@pytest.mark.parametrize(
    "grey",
    [
        0.9 - 0.01 * X + 0 * Y,  # even light
        np.where(DISC, 1.0, 0.05 + 0.6 * Y),  # a light shape on a dark gradient
        np.where(DISC, 0.5, 0.05 + 0.85 * Y),
        np.where(X < 0.5, 0.3, 0.9),
        np.where((6 * X).astype(int) + (6 * Y).astype(int) & 1, 0.25, 0.9),
        np.where(np.maximum(abs(X - 0.5), abs(Y - 0.5)) < 0.4, 0.9, 0.15),
        sum(
            s * ndimage.gaussian_filter(np.random.default_rng(5).normal(size=X.shape), s)
            for s in (2, 8, 30, 90)
        )
        / 2.5
        + 0.5,
    ],
    ids=["even", "light shape", "grey shape", "halves", "checks", "dark frame", "texture"],
)
@pytest.mark.study
def test_what_is_no_drawing_on_paper_stays(grey: Array) -> None:
    assert read_paper(photograph(grey)) is None


# Drawings on a sheet within the picture, on a painted board, on squares, and pale ones with a
# dark spot.


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


def squares(step: int, tone: tuple[int, ...], lined: bool = False) -> Image.Image:
    picture = Image.new("RGB", (SIDE, SIDE), "white")
    pen = ImageDraw.Draw(picture)
    for at in range(0, SIDE, step):
        pen.line([(0, at), (SIDE, at)], fill=tone)
        if not lined:
            pen.line([(at, 0), (at, SIDE)], fill=tone)
    return kite(picture, (20, 20, 20))


def punched() -> Image.Image:
    grain = np.random.default_rng(0).normal(240, 3, (SIDE, SIDE, 1)).clip(0, 255).repeat(3, axis=2)
    picture = kite(Image.fromarray(grain.astype(np.uint8)), (20, 20, 20))
    for y in (0.25, 0.75):
        ImageDraw.Draw(picture).circle((0.05 * SIDE, y * SIDE), 0.02 * SIDE, fill=(40, 40, 40))
    return picture


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
    "blue lines": (squares(16, (150, 190, 230), lined=True), "lined paper"),
    "punched": (punched(), "punched holes are left out"),
    "a yellow body": (spotted((255, 228, 110), (0, 0, 0)), "paler than its darkest spot"),
    "a pencil's grey": (spotted((195, 195, 195), (10, 10, 10)), "paler than its darkest spot"),
}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
def test_a_drawing_is_read_on_any_ground(tmp_path: Path, kind: str) -> None:
    picture, words = CASES[kind]
    picture.save(tmp_path / "drawing.png")
    target = read_target(tmp_path / "drawing.png", Reading(crop_px=False))
    assert words in " ".join(target.notes)
    assert 0.4 * INK < target.mask.mean() < 1.15 * INK
    assert target.pieces == 1 and not target.mask[:5].any()


@pytest.mark.slow
def test_where_squares_cross_no_holes_are_punched() -> None:
    (photograph,) = (image for _, image, _ in draw_photographs("felt-tip, squared, shell"))
    read = read_paper(photograph)
    assert read is not None and "uneven light" in read[1] and "punched" not in read[1]


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


# A silhouette in a page: the same picture, dark on white, small.


def test_a_silhouette_comes_back() -> None:
    y, x = np.mgrid[:900, :1500]
    mask = np.hypot(x - 600, y - 400) < 300
    head, _, text = silhouette_uri(mask).partition(",")
    data = base64.b64decode(text)
    shown = Image.open(io.BytesIO(data))
    assert head == "data:image/png;base64" and shown.size == (512, 307) and len(data) < 4000
    dark = ~np.asarray(shown.convert("1"))
    assert abs(dark.mean() - mask.mean()) < 1e-3
    small = mask[::20, ::20]
    _, _, text = silhouette_uri(small).partition(",")
    again = np.asarray(Image.open(io.BytesIO(base64.b64decode(text))).convert("1"))
    assert (~again == small).all()
