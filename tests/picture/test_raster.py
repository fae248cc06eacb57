"""A silhouette in a page: the same picture, dark on white, small."""

from __future__ import annotations

import base64
import io

import numpy as np
from PIL import Image

from knotfab.picture.raster import silhouette_uri


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
