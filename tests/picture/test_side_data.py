"""What lies beside a picture in its file decides nothing: a PNG's words, a TIFF's other pages."""

import io
import zlib

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from knotfab.picture.raster import count_frames, decode, take_frames

SHAPE = np.full((64, 64), 255, np.uint8)
SHAPE[16:48, 20:40] = 0


def png() -> bytes:
    file = io.BytesIO()
    Image.fromarray(SHAPE).save(file, "PNG")
    return file.getvalue()


def chunk(kind: bytes, content: bytes, damaged: bool = False) -> bytes:
    code = zlib.crc32(kind + content) ^ damaged
    return len(content).to_bytes(4, "big") + kind + content + code.to_bytes(4, "big")


SIDE = {
    "3 MB of words": chunk(b"zTXt", b"prompt\0\0" + zlib.compress(b"a" * 3_000_000)),
    "words that are not packed": chunk(b"tEXt", b"prompt\0" + b"a" * 3_000_000),
    "words by the thousand": chunk(b"iTXt", b"k\0\0\0\0\0" + b"a" * 60_000) * 2_000,
    "a profile of 2 MB": chunk(b"iCCP", b"p\0\0" + zlib.compress(bytes(2_000_000))),
    "a damaged profile": chunk(b"iCCP", b"p\0\0no zlib"),
    "words of another sum": chunk(b"zTXt", b"prompt\0\0" + zlib.compress(b"a"), damaged=True),
    "a damaged tag": chunk(b"eXIf", b"MM\0*", damaged=True),
    "a private chunk": chunk(b"prIv", bytes(5_000_000)),
}


@pytest.mark.parametrize("case", SIDE)
def test_side_data_of_a_png_decide_nothing(case: str) -> None:
    plain = png()
    image, kind = decode(plain[:33] + SIDE[case] + plain[33:], "a.png")
    assert kind == "PNG" and (np.asarray(image.convert("L")) == SHAPE).all()


def tiff(*pages: tuple[np.ndarray, int]) -> bytes:
    """A TIFF of pages, each with its NewSubfileType (1: reduced)."""
    file = io.BytesIO()
    images = []
    for page, subfile in pages:
        image = Image.fromarray(page)
        info = TiffImagePlugin.ImageFileDirectory_v2()
        info[254] = subfile
        image.encoderinfo = {"tiffinfo": info}
        images.append(image)
    with TiffImagePlugin.AppendingTiffWriter(file) as out:
        for image in images:
            image.save(out, "TIFF", tiffinfo=image.encoderinfo["tiffinfo"])
            out.newFrame()
    return file.getvalue()


def test_a_reduced_page_is_none() -> None:
    small = SHAPE[::2, ::2].copy()
    data = tiff((small, 1), (SHAPE, 0))
    image, _ = decode(data, "a.tif")
    assert image.size == (64, 64) and count_frames(data) == 2
    assert [frame.size for frame in take_frames(data, 9)] == [(64, 64)]
    assert decode(tiff((small, 1)), "a.tif")[0].size == (32, 32)  # no other page
