"""Pictures for pages, as the bytes of a file and as data URIs, and the digests of the pages' scripts."""

from __future__ import annotations

import base64
import hashlib
import io
from typing import Any

from PIL import Image

from knotfab.base.arrays import Mask
from knotfab.picture.silhouette import fit_size

__all__ = ["data_uri", "encode_image", "hash_script", "image_uri", "silhouette_uri"]

_LONGER_PX = 512  # longer side of a picture on a page


def encode_image(image: Image.Image, kind: str = "png", **options: Any) -> bytes:
    """Return the bytes of a picture's file, by Pillow's name of the format and with its options."""
    with io.BytesIO() as file:
        image.save(file, kind.upper(), **options)
        return file.getvalue()


def data_uri(data: bytes, media: str) -> str:
    """Return a file as a URI that holds all of it; `media` such as "image/png"."""
    return f"data:{media};base64,{base64.b64encode(data).decode('ascii')}"


def image_uri(image: Image.Image, kind: str = "png", **options: Any) -> str:
    """Return a picture as a data URI; arguments as `encode_image` has them."""
    return data_uri(encode_image(image, kind, **options), f"image/{kind}")


def silhouette_uri(mask: Mask) -> str:
    """Return a silhouette (H, W) as a data URI: a PNG of two colours, dark on white, 512 px long at most."""
    image = Image.fromarray(~mask)
    if max(image.size) > _LONGER_PX:
        size = fit_size(*image.size, _LONGER_PX)
        grey = image.convert("L").resize(size, Image.Resampling.BOX)
        image = grey.point(lambda value: 255 if value > 127 else 0)
    return image_uri(image.convert("1", dither=Image.Dither.NONE), optimize=True)


def hash_script(script: str) -> str:
    """Return the digest that a page's content security policy allows a script by (SHA-256, in base64)."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
