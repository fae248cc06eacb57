"""A silhouette as a small picture that pages embed."""

from __future__ import annotations

import base64
import io

from PIL import Image

from knotfab.arrays import Mask

__all__ = ["silhouette_uri"]

_LONGER_PX = 512


def silhouette_uri(mask: Mask) -> str:
    """A silhouette (H, W) as a data URI: a PNG of two colours, dark on white, 512 px long at most."""
    image = Image.fromarray(~mask)
    scale = _LONGER_PX / max(image.size)
    if scale < 1:
        size = max(1, round(image.width * scale)), max(1, round(image.height * scale))
        grey = image.convert("L").resize(size, Image.Resampling.BOX)
        image = grey.point(lambda value: 255 if value > 127 else 0)
    file = io.BytesIO()
    image.convert("1", dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")
