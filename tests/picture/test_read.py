"""Reading pictures: every kind gives the shape that was drawn, every bad one a clear sentence."""

import contextlib
import io
import os
import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms

from knotfab.base import limited
from knotfab.picture import raster, read
from knotfab.picture.raster import encode_mask
from knotfab.picture.read import Target, read_target, read_targets
from knotfab.picture.silhouette import mask_iou
from knotfab.picture.source import name_picture, read_bytes
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading, View

pytestmark = pytest.mark.usefixtures("copies")

H, W = 40, 60
SHAPE = np.zeros((H, W), dtype=bool)
SHAPE[8:30, 12:45] = True
SHAPE[12:18, 20:30] = False  # a hole
SHAPE[30:34, 12:16] = True  # something that is not symmetric


def drawn(background: Any, ink: Any, dtype: Any = np.uint8) -> NDArray[Any]:
    return np.where(
        SHAPE if np.ndim(ink) == 0 else SHAPE[..., None], np.array(ink), np.array(background)
    ).astype(dtype)


def png(image: Image.Image, **options: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", **options)
    return buffer.getvalue()


def said_to_be(data: bytes, width: int, height: int) -> bytes:
    """A PNG whose header promises so many pixels."""
    header = struct.pack(">4sII", b"IHDR", width, height) + data[24:29]
    return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]


def save(path: Path, image: Image.Image, **options: Any) -> Path:
    image.save(path, **options)
    return path


GREY = Image.fromarray(drawn(255, 0))
RGB = Image.fromarray(drawn([250, 240, 230], [20, 90, 160]))
RGBA = Image.fromarray(drawn([9, 9, 9, 0], [9, 9, 9, 255]))


def palette(**options: Any) -> Image.Image:
    image = Image.fromarray(drawn(3, 7)).convert("P")
    image.putpalette([0] * 9 + [255, 255, 255] + [0] * 9 + [200, 0, 0])
    image.info.update(options)
    return image


KINDS: dict[str, tuple[Image.Image, str, dict[str, Any]]] = {
    "grey": (GREY, "png", {}),
    "bilevel": (GREY.convert("1"), "png", {}),
    "colour": (RGB, "png", {}),
    "alpha": (RGBA, "png", {}),
    "alpha-half": (Image.fromarray(drawn([0, 0, 0, 127], [0, 0, 0, 128])), "png", {}),
    "grey-alpha": (Image.fromarray(drawn([50, 0], [50, 255])), "png", {}),
    "opaque-alpha": (Image.fromarray(drawn([255, 255, 255, 255], [0, 0, 0, 255])), "png", {}),
    "palette": (palette(), "png", {}),
    "palette-transparent": (palette(), "png", {"transparency": 3}),
    "grey-keyed": (Image.fromarray(drawn(10, 11)), "png", {"transparency": 10}),
    "keyed": (Image.fromarray(drawn([1, 2, 3], [1, 2, 4])), "png", {"transparency": (1, 2, 3)}),
    "grey-16": (Image.fromarray(drawn(65535, 0, np.uint16)), "png", {}),
    "grey-16-faint": (Image.fromarray(drawn(30000, 30100, np.uint16)), "png", {}),
    "light-on-dark": (Image.fromarray(drawn(0, 255)), "png", {}),
    "webp": (RGB, "webp", {"lossless": True}),
    "webp-alpha": (RGBA, "webp", {"lossless": True}),
    "bmp": (RGB, "bmp", {}),
    "gif": (palette(), "gif", {}),
    "gif-transparent": (palette(), "gif", {"transparency": 3}),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_gives_the_shape(tmp_path: Path, kind: str) -> None:
    image, suffix, options = KINDS[kind]
    path = save(tmp_path / f"a shape.{suffix}", image, **options)
    target = read_target(path)
    assert (target.mask == SHAPE).all()
    assert target.mask.dtype == bool
    assert (target.width, target.height) == (W, H)
    assert target.given == (path.read_bytes(), f".{suffix}") and target.name == "a-shape"
    assert (read_target(path, Reading(invert=True)).mask == ~SHAPE).all()


def test_16_bit_colour_and_alpha(tmp_path: Path) -> None:
    # Pillow cannot write them, so the chunks are put together here (PNG specification, 2003).
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    def write(name: str, colour_type: int, pixels: NDArray[Any], *extra: bytes) -> Path:
        rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
        header = struct.pack(">IIBBBBB", W, H, 16, colour_type, 0, 0, 0)
        data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(extra)
        data += chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
        (tmp_path / name).write_bytes(data)
        return tmp_path / name

    colours = drawn([65535, 60000, 50000], [0, 20000, 40000], np.uint16)
    assert (read_target(write("rgb.png", 2, colours)).mask == SHAPE).all()
    with pytest.raises(InputError, match=r"16-bit colours differ by less.*Stretch its levels"):
        read_target(write("deep.png", 2, drawn([40] * 3, [167] * 3, np.uint16)))  # k62
    alpha = drawn([0, 0, 0, 32767], [0, 0, 0, 32768], np.uint16)
    assert (read_target(write("rgba.png", 6, alpha)).mask == SHAPE).all()
    grey_alpha = drawn([500, 0], [500, 65535], np.uint16)
    assert (read_target(write("la.png", 4, grey_alpha)).mask == SHAPE).all()
    key = chunk(b"tRNS", struct.pack(">H", 700))
    assert (read_target(write("key.png", 0, drawn(700, 701, np.uint16), key)).mask == SHAPE).all()


@pytest.mark.parametrize("mode", ["L", "RGB", "CMYK"])
def test_jpeg_gives_the_shape_but_for_its_ringing(tmp_path: Path, mode: str) -> None:
    path = save(tmp_path / "shape.JPEG", RGB.convert(mode), quality=95, subsampling=0)
    target = read_target(path)
    assert (target.mask == SHAPE).mean() > 0.999
    assert target.given == (path.read_bytes(), ".jpeg")


def test_exif_orientation_is_followed(tmp_path: Path) -> None:
    turned = GREY.transpose(Image.Transpose.ROTATE_90)  # a viewer must turn it clockwise
    exif = Image.Exif()
    exif[0x0112] = 6
    path = save(tmp_path / "phone.png", turned, exif=exif)
    assert (read_target(path).mask == SHAPE).all()
    assert (read_target(save(tmp_path / "plain.png", turned)).mask == np.rot90(SHAPE)).all()


def test_gif_gives_its_first_frame(tmp_path: Path) -> None:
    second = Image.fromarray(np.full((H, W), 255, dtype=np.uint8))
    path = save(tmp_path / "film.gif", GREY, save_all=True, append_images=[second])
    found = read_target(path)
    assert (found.mask == SHAPE).all()
    assert found.rule.startswith("the first of its 2 frames: ")


def test_few_of_many_blank_frames_are_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blank = [Image.new("RGB", (W, H), (k, k, k)) for k in range(40)]
    path = save(tmp_path / "film.gif", blank[0], save_all=True, append_images=blank[1:])
    monkeypatch.setattr(read, "_MOST_TRIED_PX", 5 * W * H)
    with pytest.raises(InputError, match="none of its first 5 frames holds a shape"):
        read_target(path)


@pytest.mark.parametrize("blank", ["white", "clear"])
def test_a_blank_first_frame_of_a_film_is_passed_over(tmp_path: Path, blank: str) -> None:
    empty = Image.new("RGBA", (W, H), (255, 255, 255, 0 if blank == "clear" else 255))
    frames = [GREY.convert("RGBA"), RGB.convert("RGBA")]
    path = save(tmp_path / "film.webp", empty, save_all=True, append_images=frames, lossless=True)
    found = read_target(path)
    assert (found.mask == SHAPE).all() and found.given == (path.read_bytes(), ".webp")
    assert found.rule.startswith("frame 2 of its 3, the first with a shape: ")
    assert (again(tmp_path, found).mask == SHAPE).all()
    path = save(tmp_path / "never.webp", empty, save_all=True, append_images=[empty.copy()])
    with pytest.raises(InputError, match=r"one colour|transparent everywhere"):
        read_target(path)


@pytest.mark.parametrize("suffix", ["avif", "heic", "tif", "jp2", "ppm", "ico"])
def test_formats_of_phones_and_scanners(tmp_path: Path, suffix: str) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    path = save(tmp_path / f"photo.{suffix}", GREY.convert("RGB").resize((4 * W, 4 * H), 0))
    found = read_target(path)
    assert found.given == (path.read_bytes(), f".{suffix}")
    assert found.mask.mean() == pytest.approx(SHAPE.mean(), rel=0.02)


@pytest.mark.parametrize("mode", ["CMYK", "F", "I;16", "LAB"])
def test_scans_of_any_mode(tmp_path: Path, mode: str) -> None:
    image = GREY.convert("RGB" if mode in ("CMYK", "LAB") else "L")
    if mode == "LAB":
        image = ImageCms.profileToProfile(
            image, ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB"), outputMode="LAB"
        )
    elif mode == "I;16":
        image = Image.fromarray(drawn(65535, 0, np.uint16))
    else:
        image = image.convert(mode)
    assert (read_target(save(tmp_path / "scan.tiff", image)).mask == SHAPE).all()


def test_an_address_is_not_a_file() -> None:
    with pytest.raises(InputError, match=r"address on the web.*Download"):
        read_target("https://example.org/cat.png")


def test_half_contrast_is_above_half_the_largest_difference(tmp_path: Path) -> None:
    levels = np.full((20, 20), 200, dtype=np.uint8)
    levels[5, 5:10] = 100  # the largest difference is 100
    levels[6, 5:10] = 150  # exactly half: background
    levels[7, 5:10] = 149
    levels[8, 5:10] = 251  # lighter counts as well
    mask = read_target(save(tmp_path / "levels.png", Image.fromarray(levels))).mask
    assert [bool(mask[row, 7]) for row in (4, 5, 6, 7, 8)] == [False, True, False, True, True]


def test_the_border_colour_is_a_median(tmp_path: Path) -> None:
    grey = drawn(255, 0)
    grey[:15, 0] = 0  # the shape touches the frame
    grey[0, :20] = 0
    mask = read_target(save(tmp_path / "touching.png", Image.fromarray(grey))).mask
    assert (mask == (grey == 0)).all()


def test_extreme_sizes_are_read(tmp_path: Path) -> None:
    for size in ((16, 8000), (8000, 16), (16, 16)):
        image = Image.new("L", size, 255)
        image.paste(0, (4, 4, size[0] - 4, size[1] - 4))
        target = read_target(save(tmp_path / "long.png", image))
        assert (target.width, target.height) == size
        assert target.mask.sum() == (size[0] - 8) * (size[1] - 8)


def test_content_decides_not_the_suffix(tmp_path: Path) -> None:
    (tmp_path / "picture.jpg").write_bytes(png(GREY))
    (tmp_path / "picture").write_bytes(png(GREY))
    (tmp_path / "picture.svg").write_bytes(png(GREY))
    for name in ("picture.jpg", "picture", "picture.svg"):
        target = read_target(tmp_path / name)
        assert (target.mask == SHAPE).all() and target.given.suffix == ".png"


def test_relative_paths_start_at_the_base(tmp_path: Path) -> None:
    save(tmp_path / "shape.png", GREY)
    assert read_target("shape.png", base=tmp_path).name == "shape"


@pytest.mark.slow
def test_names_are_safe(tmp_path: Path) -> None:
    """Names of any script stay as they are in folders, in pages and in the names of views."""
    names = {
        "Ünï cödé!": "Ünï-cödé", "♞": "♞", "猫": "猫", "пёс": "пёс", "a.b": "a-b", "!": "picture", "-x": "x",
        "a\u202eb": "a-b", "x<i>&'": "x-i", "e\u0301": "é", "caf\udce9": "caf",
    }  # fmt: skip
    for raw, name in names.items():
        assert read_target(save(tmp_path / f"{raw}.png", GREY)).name == name
        assert View(name=name).name == name


def test_a_file_named_as_a_text_keeps_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path / "text:a.png", GREY)
    monkeypatch.chdir(tmp_path)
    assert read_target("./text:a.png").name == "text-a"


@pytest.mark.slow
def test_people_read_the_name_as_it_was_given(tmp_path: Path) -> None:
    """Its folder's name has signs that every disk takes; no sign that moves the cursor is shown."""
    for given, folder in (("Mia & Tom", "Mia-Tom"), ("1,5 mm (new)", "1-5-mm-new"), ("cat", "cat")):
        save(tmp_path / f"{given}.png", GREY)
        target = read_target(tmp_path / f"{given}.png")
        assert (target.name, target.shown) == (folder, given)
    assert read_target("text: A & B ").shown == "A & B"
    for hidden in ("a\x1b[2J", "a\u202eb", "b" * 70):
        save(tmp_path / f"{hidden}.png", GREY)
        target = read_target(tmp_path / f"{hidden}.png")
        assert target.shown == target.name


def test_long_names_that_begin_alike_stay_apart() -> None:
    for sign in ("a", "猫", "😀"):
        one, two = (name_picture(sign * 62 + end) for end in ("1", "2"))
        assert one != two and one[:30] == two[:30]
        assert len(one) <= 60 and len(f"compare-{View(name=one).name}.png".encode()) < 255
    assert name_picture("a" * 60 + ".png") == "a" * 60


@pytest.mark.parametrize(
    "name", ["", "a b", "a/b", "..", "a.b", "<b>", 'a"', "a\n", "\x85", "a" * 61, "😀" * 50]
)
def test_what_is_no_name_of_a_view(name: str) -> None:
    with pytest.raises(ValueError):
        View(name=name)


# --- bad input -------------------------------------------------------------------------------

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10"{}>{}</svg>'
BAD: dict[str, tuple[bytes, str]] = {
    "text.png": (b"this is no picture at all", "not a picture that can be read"),
    "empty.png": (b"", "the file is empty"),
    "cut.png": (png(RGB.resize((300, 200)))[:700], "damaged or cut short"),
    "header.png": (png(GREY)[:20], "not a picture that can be read"),
    "noise.jpg": (b"\xff\xd8\xff" + bytes(range(256)), "not a picture|damaged"),
    "white.png": (png(Image.new("L", (64, 64), 255)), "all one colour"),
    "black.png": (png(Image.new("RGB", (64, 64), 0)), "all one colour"),
    "clear.png": (png(Image.new("RGBA", (64, 64), 0)), "transparent everywhere"),
    "full.png": (png(Image.new("RGBA", (64, 64), (0, 0, 0, 200))), "all one colour"),
    "faint.png": (png(Image.fromarray(drawn([0, 0, 0, 0], [0, 0, 0, 102]))), "alpha 0.4.*--threshold 0.2"),
    "hardly.png": (png(Image.fromarray(drawn([0, 0, 0, 0], [0, 0, 0, 1]))), "--threshold 0.002,"),
    "page.png": (b"%PDF-1.7", "it is a PDF"),
    "film.png": (b"\0\0\0\x20ftypisom", "it is a film"),
    "photo.png": (b"\0\0\0\x20ftypheic", "a HEIC photo, as iPhones take them"),
    "page.jpg": (b"<!DOCTYPE html><html>", "it is a web page"),
    "layers.png": (b"8BPS\0\1", "it is a Photoshop file"),
    "one.png": (png(Image.new("L", (1, 1), 0)), "1 x 1 pixels, less than 16"),
    "small.png": (png(GREY.resize((15, 40))), "15 x 40 pixels, less than 16"),
    "wide.png": (png(Image.new("1", (8001, 16))), "8001 x 16 pixels, more than 8000"),
    "bomb.png": (said_to_be(png(GREY), 20000, 20000), "more than 8000"),
    "notxml.svg": (b"this is no XML", "not valid XML"),
    "cut.svg": (SVG.format("", "<rect/>").encode()[:-4], "not valid XML"),
    "html.svg": (b"<html><body/></html>", "outermost element is <html>"),
    "zipped.svg": (b"\x1f\x8b\x08rest", "compressed SVG is damaged"),
    "nothing.svg": (SVG.format("", "").encode(), "transparent everywhere"),
    "hair.svg": (SVG.format("", '<path d="M1 1L8 9H2" fill="none" stroke="red" stroke-width=".0009"/>')
                 .encode(), "lines are thinner than a pixel"),
    "speck.svg": (SVG.format("", '<circle cx="5" cy="5" r="0.001"/>').encode(), "transparent|thinner"),
    "zero.svg": (SVG.format(' width="0" height="1"', "<path/>").encode(), "its size is nothing"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_target(path)
    assert caught.value.exit_code == 2
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)
    assert caught.value.remedy.endswith(".")


@pytest.mark.slow
def test_missing_files_directories_and_pipes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_target(tmp_path / "missing.png")
    with pytest.raises(InputError, match="it is a directory"):
        read_target(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="not a regular file"):
        read_target(tmp_path / "pipe")
    with pytest.raises(InputError, match="cannot be read"):
        read_target("nul\0l")


def test_a_file_too_large_is_told_how_large_one_may_be(tmp_path: Path) -> None:
    with (tmp_path / "large.png").open("wb") as file:
        file.truncate(10 * 8000**2)  # bytes, of which a disk holds none
    with pytest.raises(InputError, match="at most 8000 pixels on a side"):
        read_target(tmp_path / "large.png")
    noise = tmp_path / "noise.bin"  # 16-bit RGBA of 100 x 100 px
    noise.write_bytes(bytes(8 * 100**2 + 500))
    assert len(read_bytes(noise, "noise", 100)) == 80_500
    with pytest.raises(InputError, match=r"too much.*at most 90 pixels on a side"):
        read_bytes(noise, "noise", 90)


def test_permissions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save(tmp_path / "secret.png", GREY)

    def deny(self: Path, mode: str) -> bytes:
        raise PermissionError(13, "Permission deny")

    monkeypatch.setattr(Path, "open", deny)
    with pytest.raises(InputError, match=r"may not be read.*chmod"):
        read_target(path)


@pytest.mark.parametrize(("side", "dot", "good"), [(64, 1, False), (2000, 4, False), (64, 8, True)])
@pytest.mark.slow
def test_specks_are_refused(tmp_path: Path, side: int, dot: int, good: bool) -> None:
    grey = np.full((side, side), 255, dtype=np.uint8)
    grey[20 : 20 + dot, 20 : 20 + dot] = 0
    path = save(tmp_path / "dot.png", Image.fromarray(grey))
    if good:
        assert read_target(path).mask.sum() == dot * dot
    else:
        with pytest.raises(InputError, match=f"largest piece covers {dot * dot} of"):
            read_target(path)


@pytest.mark.slow
def test_many_specks_are_no_shape_either(tmp_path: Path) -> None:
    grey = np.full((2000, 2000), 255, dtype=np.uint8)
    grey[10:-10:20, 10:-10:20] = 0
    with pytest.raises(InputError, match="largest piece covers 1 of"):
        read_target(save(tmp_path / "dots.png", Image.fromarray(grey)))


def test_inverting_decides_what_is_full(tmp_path: Path) -> None:
    clear = np.zeros((20, 20, 4), dtype=np.uint8)
    clear[1:, :, 3] = 255
    path = save(tmp_path / "strip.png", Image.fromarray(clear))
    assert read_target(path, Reading(invert=True)).mask.sum() == 20


# --- SVG -------------------------------------------------------------------------------------


def svg(tmp_path: Path, body: str, attributes: str = "") -> Target:
    path = tmp_path / "drawing.svg"
    path.write_text(SVG.format(attributes, body), encoding="utf-8")
    return read_target(path)


def again(tmp_path: Path, target: Target, invert: bool = False) -> Target:
    path = tmp_path / "picture-again.png"
    path.write_bytes(encode_mask(target.asked))
    return read_target(path, Reading(invert=invert))


@pytest.mark.usefixtures("large")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "share"),
    [
        ('<circle cx="5" cy="5" r="3"/>', np.pi * 0.09),
        ('<rect width="10" height="10" fill="#ffd"/><rect x="2" y="2" width="5" height="4"/>', 0.2),
    ],
)
def test_svg_is_drawn_and_its_raster_reads_the_same(
    tmp_path: Path, body: str, share: float
) -> None:
    target = svg(tmp_path, body)
    assert (target.width, target.height, target.given.suffix) == (2048, 2048, ".svg")
    assert target.mask.mean() == pytest.approx(share, rel=1e-3)
    assert (again(tmp_path, target).mask == target.mask).all()


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize(
    ("box", "size"),
    [("0 0 30 10", (2048, 683)), ("0 0 10 40", (512, 2048)), ("0 0 1 400", (20, 8000))],
)
def test_svg_keeps_its_aspect_ratio(tmp_path: Path, box: str, size: tuple[int, int]) -> None:
    path = tmp_path / "long.svg"
    x, y = (float(v) for v in box.split()[2:])
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">'
        f'<rect width="{x / 2}" height="{y / 2}"/></svg>'
    )
    target = read_target(path)
    assert (target.width, target.height) == size
    assert target.mask.mean() == pytest.approx(0.25, rel=5e-3)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits it")
@pytest.mark.parametrize(
    "svg",
    ids=["selectors", "blanks"],
    argvalues=[
        "<svg xmlns='http://www.w3.org/2000/svg' width='99' height='99'><style>x "
        + "g " * 12
        + "rect{fill:red}</style>"
        + "<g>" * 40
        + "<rect x='9' y='9' width='60' height='60'/>"
        + "</g>" * 40
        + "</svg>",
        " " * 3_000_000 + "<svg xmlns='http://www.w3.org/2000/svg'/>",
    ],
)
def test_a_drawing_ends_within_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, svg: str
) -> None:
    """It is drawn, or refused in a sentence; what reads it is stopped, whatever it is at."""
    monkeypatch.setattr("knotfab.picture.read.SECONDS", 1)
    (tmp_path / "slow.svg").write_bytes(svg.encode())
    with contextlib.suppress(InputError):
        read_target(tmp_path / "slow.svg")
    assert not limited._living


def test_only_the_first_frames_are_searched_for_a_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = [Image.new("L", (40, 40), 250 - shade) for shade in range(12)]
    frames[-1].paste(0, (10, 10, 30, 30))
    frames[0].save(tmp_path / "late.gif", save_all=True, append_images=frames[1:])
    assert read_target(tmp_path / "late.gif").rule.startswith("frame 12 of its 12")
    monkeypatch.setattr("knotfab.picture.read._MOST_TRIED", 11)
    with pytest.raises(InputError, match="none of its first 11 frames holds a shape"):
        read_target(tmp_path / "late.gif")


@pytest.mark.study
def test_a_large_photograph_is_decoded_once_and_shrunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    levels = np.random.default_rng(4).normal(150, 10, (1500, 2000, 3))
    levels[300:1300, 500:1600] -= 100
    whole = Image.fromarray(levels.clip(0, 255).astype(np.uint8))
    turned = Image.Exif()
    turned[0x0112] = 6  # upright after a quarter turn
    whole.save(tmp_path / "photo.jpg", quality=92, exif=turned)
    log, decode = tmp_path / "log", raster.decode_shrunk

    def noted(*asked: Any) -> Any:
        with log.open("a") as file:
            file.write("once ")
        return decode(*asked)

    monkeypatch.setattr(raster, "decode_shrunk", noted)
    sheet = Reading(crop_px=False)
    (target,) = read_targets([str(tmp_path / "photo.jpg")], [sheet], glance=1280)
    assert log.read_text() == "once "
    assert target.shrunk == 2 and target.mask.shape == (1000, 750)
    monkeypatch.undo()
    few = read_target(tmp_path / "photo.jpg", sheet).mask[::2, ::2]
    assert mask_iou(few, target.mask) > 0.98
