"""Pixel pictures: safe decoding, the silhouette by the contract's rule, and encoding for pages."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
import warnings
import zlib
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from PIL import Image, ImageOps
from PIL.PngImagePlugin import PngInfo

from knotfab.base.arrays import Mask
from knotfab.picture.ink import find_ink
from knotfab.picture.silhouette import drop_specks, fit_size, keep_largest, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part
from knotfab_formats.views import MASK_MARK, Box, Reading

SMALLEST_SIDE = 16
LARGEST_SIDE = 8000
GLANCE = 2048  # px of a longer side for a glance at a picture; a verdict takes 1024
_LEAST = 200  # least px of a shorter side at a glance
MARGIN = 0.06  # margin about a drawing, as a share of the frame's longer side

# What Pillow calls each format that is read, and the suffixes its files carry, the usual one first.
SUFFIXES: dict[str, tuple[str, ...]] = {
    "PNG": (".png", ".apng"),
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif"),
    "MPO": (".jpg", ".jpeg", ".mpo"),
    "WEBP": (".webp",),
    "BMP": (".bmp", ".dib"),
    "GIF": (".gif",),
    "AVIF": (".avif", ".avifs"),
    "HEIF": (".heic", ".heif", ".hif"),
    "TIFF": (".tif", ".tiff"),
    "ICO": (".ico",),
    "JPEG2000": (".jp2", ".j2k"),
    "PPM": (".ppm", ".pgm", ".pbm", ".pnm"),
}
KEPT = ("PNG", "JPEG", "MPO", "WEBP", "BMP", "GIF")  # formats that are read in their own mode
_FORMATS = tuple(kind for kind in SUFFIXES if kind != "MPO")
_READABLE = "PNG, JPEG, WebP, BMP, GIF, HEIC, AVIF, TIFF or SVG"
_BEGINNINGS = (
    b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF87a", b"GIF89a", b"BM", b"II*\0", b"MM\0*",
    b"\0\0\1\0", b"\0\0\0\x0cjP", b"\xff\x4f\xff\x51", *(b"P%d" % n for n in range(1, 8)),
)  # fmt: skip
_EXPORT = "Open it in the program that made it, and export it as PNG or SVG."
# files mistaken for pictures: first bytes, kind, remedy
_OTHERS: tuple[tuple[bytes, str, str], ...] = (
    (rb"%PDF", "a PDF", "Export its page as SVG or PNG, by Inkscape or by pdftoppm -png."),
    (rb"%!PS|\xc5\xd0\xd3\xc6", "PostScript (EPS)", "Export it as SVG or PNG, by Inkscape."),
    (rb"8BPS", "a Photoshop file", _EXPORT),
    (rb"gimp xcf", "a GIMP file", _EXPORT),
    (rb"\xff\x0a|\0\0\0\x0cJXL ", "a JPEG XL picture", "Save it as PNG."),
    (rb"PK\x03\x04", "a ZIP archive, as documents are (docx, odg, kra)", _EXPORT),
    (rb"\s*(?i:<!doctype html|<html)", "a web page", "Save the picture itself, not the page it is on."),
    (rb"\s*0\s+SECTION|AC10", "a CAD drawing (DXF, DWG)", "Export it as SVG."),
    (rb"....ftyp(?:avif|avis)", "an AVIF picture", "Save it as PNG, or install a newer Pillow."),
    (rb"....ftyp(?:hei|hev|mif1|msf1)", "a HEIC photo, as iPhones take them",
     "Save it as JPEG or PNG, or pip install pillow-heif."),
    (rb"....ftyp|\x1aE\xdf\xa3|RIFF....AVI ", "a film",
     "Export its frames as PNG (ffmpeg -i FILM frame-%d.png), and draw them with --sequence."),
)  # fmt: skip


def looks_like_raster(data: bytes) -> bool:
    """Return whether the first bytes belong to a readable pixel format."""
    return data.startswith(_BEGINNINGS) or data[8:12] == b"WEBP" or data[4:8] == b"ftyp"


@cache
def _read_heif() -> bool:
    """Register pillow-heif for photos of iPhones; return whether it is installed."""
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        return False
    register_heif_opener()
    took_part("pillow-heif", "read the picture")
    return True


def _unreadable(data: bytes, what: str) -> InputError:
    """Return the error for an unreadable picture, with its kind if the first bytes show it."""
    for beginning, name, remedy in _OTHERS:
        if re.match(beginning, data, re.S):
            return InputError(what, f"it is {name}, which cannot be read", remedy)
    return InputError(
        what,
        f"it is not a picture that can be read (a damaged file, or not {_READABLE})",
        f"Save or export the picture as {_READABLE} and try again.",
    )


_PNG = b"\x89PNG\r\n\x1a\n"
_DRAWING = (
    b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"eXIf", b"acTL", b"fcTL", b"fdAT", b"bKGD",
    b"sBIT",
)  # fmt: skip
_SUBFILE, _MOST_REDUCED = 254, 8  # TIFF's tag NewSubfileType, and the pages that may be reduced
_MOST_SIDE = 1_000_000  # bytes of side data; Pillow unpacks no more of one


def _check_size(
    what: str, width: int, height: int, smallest: int, largest: int = LARGEST_SIDE
) -> None:
    if max(width, height) > largest:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, more than {largest} on a side",
            f"Scale it down to at most {largest} pixels on the longer side.",
        )
    if min(width, height) < smallest:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, less than {smallest} on a side",
            f"Use a picture of at least {smallest} x {smallest} pixels, better about 1000.",
        )


def decode(
    data: bytes, what: str, *, smallest: int = SMALLEST_SIDE, largest: int = LARGEST_SIDE
) -> tuple[Image.Image, str]:
    """Decode as `decode_shrunk` does, at full size; return the picture and its format."""
    return decode_shrunk(data, what, 0, smallest, largest)[:2]


def decode_shrunk(
    data: bytes, what: str, longest: int, smallest: int = SMALLEST_SIDE, largest: int = LARGEST_SIDE
) -> tuple[Image.Image, str, tuple[int, int], int]:
    """Decode a pixel picture, turned upright by its EXIF tag, its longer side shrunk to about `longest` px.

    Args:
        what: how an error names the picture.
        longest: 0: full size. smallest, largest: px allowed on a side of the file's.

    Returns:
        The first frame, in its own mode, Pillow's name of the format, width and height before, and how many
        px of those make one, across.

    Raises:
        InputError: unknown format, damaged data, or a size outside what is allowed (checked before any
            pixel is decoded).
    """
    with warnings.catch_warnings():
        # Pillow warns of large pictures and odd metadata; sizes are checked here instead.
        warnings.simplefilter("ignore")
        took_part("pillow", "read the picture")
        try:
            if data[4:8] == b"ftyp":
                _read_heif()
            image = _open(data)
        except Image.DecompressionBombError as error:
            raise InputError(
                what,
                f"it has more than {largest} pixels on a side",
                f"Scale it down to at most {largest} pixels on the longer side.",
            ) from error
        except Exception as error:  # Pillow's plug-ins raise many kinds on damaged headers
            raise _unreadable(data, what) from error
        _check_size(what, *image.size, smallest, largest)
        kind, size = str(image.format), image.size
        factor = shrunk_by(size, longest) if longest else 1
        few = math.gcd(factor, 8)  # a JPEG decoded at an eighth, a fourth or half costs less
        drafted = few > 1 and image.draft(None, (size[0] // few, size[1] // few)) is not None
        try:
            image.load()
            upright = ImageOps.exif_transpose(image)
        except Exception as error:
            raise InputError(
                what, f"the {kind} data is damaged or cut short", "Copy or export the file again."
            ) from error
    opaque = upright.mode == "RGB" or (
        upright.mode == "RGBA" and np.ptp(np.asarray(upright)[..., 3]) == 0
    )
    if kind == "PNG" and data[24:25] == b"\x10" and opaque:
        levels = np.asarray(upright.convert("RGB"))  # the upper 8 of 16 bits
        if np.ptp(levels, axis=(0, 1)).max() <= 2:
            raise InputError(
                what,
                "its 16-bit colours differ by less than a hundredth of the range, which looks black",
                "Stretch its levels in an image editor, and save it with 8 bits a channel.",
            )
    if kind in ("BMP", "ICO") and upright.mode == "RGBA" and not upright.getchannel("A").getbbox():
        upright = upright.convert("RGB")  # an alpha of zero everywhere means that there is none
    if upright.mode.startswith(("I", "F")):
        factor = 1  # Pillow does not reduce these modes
    further = factor // few if drafted else factor
    turned = (upright.width < upright.height) != (size[0] < size[1])
    size = size[::-1] if turned else size
    return shrink(upright, further) if further > 1 else upright, kind, size, factor


def _open(data: bytes) -> Image.Image:
    """Open a picture at its first page; a TIFF's pages that are marked as reduced are none."""
    Image.init()
    formats = [kind for kind in _FORMATS if kind in Image.OPEN]  # this machine's Pillow reads those
    image = Image.open(io.BytesIO(_without_side_data(data)), formats=formats)
    if image.format == "TIFF":
        for number in range(min(getattr(image, "n_frames", 1), _MOST_REDUCED)):
            image.seek(number)
            if not _is_reduced(image):
                return image
        image.seek(0)
    return image


def _is_reduced(image: Image.Image) -> bool:
    return image.format == "TIFF" and bool(getattr(image, "tag_v2", {}).get(_SUBFILE, 0) & 1)


def _without_side_data(data: bytes) -> bytes:
    """Cut out of a PNG what draws nothing: words and profiles that are damaged or too large for Pillow.

    Transparency, gamma, profiles, orientation and frames of an animation stay where they are whole.
    """
    if not data.startswith(_PNG):
        return data
    kept: list[bytes | memoryview] = [_PNG]
    at = len(_PNG)
    while at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        kind, whole = data[at + 4 : at + 8], memoryview(data)[at:end]
        draws = kind[:1].isupper() or (
            kind in _DRAWING
            and (len(whole) <= _MOST_SIDE or kind == b"fdAT")
            and zlib.crc32(whole[4:-4]) == int.from_bytes(whole[-4:], "big")
            and (kind != b"iCCP" or _is_profile(bytes(whole[8:-4])))
        )
        if draws:
            kept.append(bytes(whole))
        at = end
        if kind == b"IEND":
            break
    return b"".join([*kept, data[at:]])


def _is_profile(chunk: bytes) -> bool:
    """Return whether a profile unpacks, to no more than Pillow takes."""
    unpack = zlib.decompressobj()
    try:
        return len(unpack.decompress(chunk.partition(b"\0")[2][1:], _MOST_SIDE)) < _MOST_SIDE
    except zlib.error:
        return False


def shrunk_by(size: tuple[int, int], longest: int) -> int:
    """Return the factor that shrinks a picture's longer side to about `longest` px."""
    return min(-(-max(size) // longest), max(1, min(size) // _LEAST))


def shrink(image: Image.Image, factor: int) -> Image.Image:
    """Shrink a picture by averaging squares of `factor` px."""
    if image.mode not in ("L", "LA", "RGB", "RGBA"):
        image = image.convert("RGBA" if image.has_transparency_data else "RGB")
    return image.reduce(factor)


def suffixes_of(data: bytes) -> tuple[str, ...]:
    """Return the suffixes of the format of a picture that `decode` reads, the usual one first."""
    with _open(data) as image:
        return SUFFIXES[str(image.format)]


def count_frames(data: bytes) -> int:
    """Return the number of frames that `decode` can read; 1 for a still picture."""
    with _open(data) as image:
        try:
            return int(getattr(image, "n_frames", 1))
        except Exception:  # as in `take_frames`
            return 1


def take_frames(data: bytes, most: int) -> Iterator[Image.Image]:
    """Yield up to `most` frames of a moving picture, in RGBA, ending before a damaged one."""
    with _open(data) as image:
        for number in range(most):
            try:
                image.seek(number)
                frame = None if _is_reduced(image) else image.convert("RGBA")
            except Exception:  # Pillow's plug-ins raise many kinds on damaged frames
                return
            if frame is not None:
                yield frame


def flatten(image: Image.Image, longest: int) -> Image.Image:
    """Return a picture in RGB, on white where it is clear, at most `longest` px on its longer side."""
    if image.mode.startswith("I"):
        image = Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    image = image.convert("RGBA")
    paper = Image.new("RGBA", image.size, "white")
    paper.alpha_composite(image)
    flat = paper.convert("RGB")
    flat.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    return flat


def to_plain(image: Image.Image) -> Image.Image:
    """Return a picture in a mode that PNG supports, without metadata."""
    if image.mode == "F":
        levels = np.asarray(image, dtype=np.float64)
        known = np.isfinite(levels)
        if not known.any():
            return Image.fromarray(np.zeros(levels.shape, dtype=np.uint16))
        low, high = levels[known].min(), levels[known].max()
        # NaN is taken as the border's value
        rim = np.concatenate([levels[0], levels[-1], levels[:, 0], levels[:, -1]])
        rim = rim[np.isfinite(rim)] if np.isfinite(rim).any() else levels[known]
        levels = np.where(known, levels, np.median(rim))
        scaled = (levels - low) * (65535 / max(high - low, 1e-300))
        return Image.fromarray(scaled.astype(np.uint16))
    if image.mode.startswith("I"):
        deep = np.asarray(image).astype(np.int64)
        return Image.fromarray((deep - min(0, int(deep.min()))).clip(0, 65535).astype(np.uint16))
    if image.mode in ("1", "L", "LA", "P", "PA", "RGB", "RGBA") and "icc_profile" not in image.info:
        return image
    return image.convert("RGBA" if image.has_transparency_data else "RGB")


def silhouette(
    image: Image.Image, what: str, reading: Reading, shrunk: int = 1
) -> tuple[Mask, str]:
    """Return the silhouette of a decoded picture, by the rules of docs/silhouette.md.

    The picture is cropped; then ink is found, and inverted if asked; then the largest pieces are
    kept and specks removed.

    Args:
        image: upright, as from `decode`.
        what: how an error names the picture.
        shrunk: how many px of the picture make one of `image`, across; `reading` is in px of the
            picture.

    Returns:
        Its mask (H, W) of the cropped picture, row 0 at the top, True where the shape is; and the rule in
        words, its figures in brackets.

    Raises:
        InputError: no shape, nothing but specks, or a shape that fills the whole frame.
    """
    image, box = crop_image(image, what, reading)
    mask, rule = find_ink(image, reading, what)
    if reading.invert:
        mask, rule = ~mask, f"all but {rule}"
    if reading.speck_px:
        mask = drop_specks(mask, round(reading.speck_px / shrunk**2))
        rule += f"; without specks of less than {reading.speck_px} px"
    if count := reading.keep_largest:
        mask = keep_largest(mask, count)
        rule += f"; of that the {'largest piece' if count == 1 else f'{count} largest pieces'}"
    if box is not None:
        rule += f"; {tell_box(box, shrunk)}"
    check_shape(mask, what)
    return mask, rule


def tell_box(box: Box, shrunk: int) -> str:
    return "in the picture from ({}, {}), {} x {} px".format(*(side * shrunk for side in box))


def own_box(mask: Mask) -> Box:
    """Return a silhouette's bounding box with a margin, clipped to the picture."""
    rows, columns = (np.flatnonzero(mask.any(axis)).tolist() for axis in (1, 0))
    height, width = mask.shape
    longer = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    margin = max(2, round(longer * MARGIN / (1 - 2 * MARGIN)), (SMALLEST_SIDE - longer + 1) // 2)
    left, top = max(0, columns[0] - margin), max(0, rows[0] - margin)
    right, bottom = min(width, columns[-1] + 1 + margin), min(height, rows[-1] + 1 + margin)
    return left, top, right - left, bottom - top


def crop_image(image: Image.Image, what: str, reading: Reading) -> tuple[Image.Image, Box | None]:
    """Crop a picture to the part that is read; return it with its box in px."""
    box = reading.crop_px
    if box is None:
        whole, _ = silhouette(image, what, reading.but(crop_px=False))
        box = own_box(whole)
    return (image, None) if isinstance(box, bool) else (_crop(image, box, what), box)


def _crop(image: Image.Image, box: Box, what: str) -> Image.Image:
    left, top, width, height = box
    if left + width > image.width or top + height > image.height:
        raise InputError(
            what,
            f"a crop of {width} x {height} px from ({left}, {top}) reaches beyond its "
            f"{image.width} x {image.height} px",
            "Give left, top, width and height in px of the picture, or --crop auto.",
        )
    _check_size(f"{what}, cropped,", width, height, SMALLEST_SIDE)
    return image.crop((left, top, left + width, top + height))


def check_shape(mask: Mask, what: str) -> None:
    """Refuse masks that no tube can draw: full, empty, or nothing but specks."""
    area = int(np.count_nonzero(mask))
    if area == mask.size:
        raise InputError(
            what,
            "the shape fills the whole frame, so there is no outline",
            "Leave some background around the shape, or say what is drawn: --ink dark or --ink light.",
        )
    smallest = max(2.0, 1e-4 * mask.size)
    largest = area
    if smallest <= area < mask.size // 50:  # real pictures do not consist of specks that fill more
        largest = int(pieces_of(mask)[1].max())
    if largest < smallest:
        raise InputError(
            what,
            f"its largest piece covers {largest} of {mask.size} pixels, too little to be drawn",
            "Crop the picture closer to the shape, or use a larger shape.",
        )


# Pictures for pages as file bytes and data URIs, and digests of the pages' scripts.

_LONGER_PX = 512  # longer side of a picture on a page


def encode_image(image: Image.Image, kind: str = "png", **options: Any) -> bytes:
    """Encode a picture in the format that Pillow calls `kind`, with that format's options."""
    with io.BytesIO() as file:
        image.save(file, kind.upper(), **options)
        return file.getvalue()


def encode_mask(mask: Mask) -> bytes:
    """Encode a silhouette as the PNG that a build keeps of it (`is_mask`), black where the shape is."""
    mark = PngInfo()
    mark.add_text(*MASK_MARK)
    return encode_image(Image.fromarray(~mask), pnginfo=mark)


def data_uri(data: bytes, media: str) -> str:
    """Encode a file's bytes as a data URI; `media` is such as "image/png"."""
    return f"data:{media};base64,{base64.b64encode(data).decode('ascii')}"


def image_uri(image: Image.Image, kind: str = "png", **options: Any) -> str:
    """Encode a picture as a data URI; arguments as for `encode_image`."""
    return data_uri(encode_image(image, kind, **options), f"image/{kind}")


def silhouette_uri(mask: Mask) -> str:
    """Encode a silhouette (H, W) as a data URI of a two-colour PNG, at most 512 px long."""
    image = Image.fromarray(~mask)
    if max(image.size) > _LONGER_PX:
        size = fit_size(*image.size, _LONGER_PX)
        grey = image.convert("L").resize(size, Image.Resampling.BOX)
        image = grey.point(lambda value: 255 if value > 127 else 0)
    return image_uri(image.convert("1", dither=Image.Dither.NONE), optimize=True)


def hash_script(script: str) -> str:
    """Return a script's SHA-256 digest, in base64, for a page's content security policy."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
