"""Preview for the page what a tube will make of pictures, and other ways to read one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from knotfab.apps.studio.fields import Value, as_text
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import list_readings, survey_pictures

if TYPE_CHECKING:
    from PIL import Image

_FILLED = {  # the field that each key of a reading fills
    "ink": "ink",
    "speck_px": "specks",
    "smooth_px": "smooth",
    "keep_largest": "keep_largest",
    "subject_px": "subject",
}
_SHADE, _LINE = (20, 15, 10, 150), (255, 120, 40, 255)  # RGBA over what is cut away, and outline
_SHOWN_PX = 1024  # longer side of a picture on the page


def preview(sources: Sequence[str], options: BuildOptions) -> tuple[dict[str, Any], list[bytes]]:
    """Survey pictures. Returns the figures for the page, and PNGs of what the tube loses.

    Raises:
        KnotfabError: the pictures cannot be read, or contradict the options.
    """
    from knotfab.design.readings import is_unclear, list_figures
    from knotfab.picture.raster import encode_image
    from knotfab.report.pictures import draw_panels

    found = survey_pictures(sources, options)
    drawn = draw_panels(found)
    captions = [panel.caption for panel in drawn]
    figures = {**list_figures(found), "error": "", "panels": captions, "unclear": is_unclear(found)}
    return figures, [encode_image(panel.image, compress_level=6) for panel in drawn]


def list_ways(
    sources: Sequence[str], options: BuildOptions, values: Mapping[str, Value]
) -> tuple[list[dict[str, Any]], list[bytes]]:
    """List up to six ways to read a picture, as contents of fields, and a thumbnail of each.

    Raises:
        KnotfabError: it cannot be read.
    """
    held = {field: values.get(field) for field in _FILLED.values()}
    known = {*_FILLED, "crop_px"}  # the crop follows from the subject
    found = [one for one in list_readings(sources, options) if one.keys.keys() <= known]
    ways = [
        {
            "settings": held
            | {_FILLED[k]: as_text(v) for k, v in one.keys.items() if k in _FILLED},
            "refused": one.refusal is not None,
        }
        for one in found
    ]
    return ways, [one.thumbnail() for one in found]


def draw_cut(source: str, options: BuildOptions) -> bytes:
    """Draw the overlay for cutting a subject out of a photograph: its outline, and a shade over the rest.

    Returns:
        A PNG of the picture's proportions, at most 1024 px long.

    Raises:
        KnotfabError: the picture cannot be read, or no subject can be cut out.
    """
    from PIL import Image

    from knotfab.picture.raster import encode_image
    from knotfab.picture.subject import cut_subject
    from knotfab.pipeline.read_options import read_scene

    view, (image, shrunk) = read_scene(options)[0].views[0], _decode(source)
    assert view.subject_px is not None

    def small(sizes: tuple[int, ...]) -> Any:
        return tuple(round(size * shrunk) for size in sizes)

    left, top, width, height = view.subject_px
    first, above, last, below = small((left, top, left + width, top + height))
    box = first, above, last - first, below - above
    keep, drop = ([small(disc) for disc in discs] for discs in (view.keep_px, view.drop_px))
    mask = cut_subject(image, box, keep, drop, "the picture")
    sheet = np.zeros((*mask.shape, 4), dtype=np.uint8)
    sheet[~mask] = _SHADE
    sheet[binary_dilation(mask, iterations=2) & ~binary_erosion(mask)] = _LINE
    return encode_image(Image.fromarray(sheet), compress_level=1)


@lru_cache(maxsize=1)
def _decode(source: str) -> tuple[Image.Image, float]:
    """Read a picture upright at the size it is shown, and return also the scale. The last one is cached."""
    from knotfab.picture import raster

    image = raster.decode(Path(source).read_bytes(), "the picture")[0]
    image = image if image.mode.startswith("I") else image.convert("RGB")
    longer = max(image.size)
    image.thumbnail((_SHOWN_PX, _SHOWN_PX))
    return image, max(image.size) / longer
