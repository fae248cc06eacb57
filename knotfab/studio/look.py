"""What a tube will make of pictures, and other ways to read one, as the page shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from knotfab.options import BuildOptions
from knotfab.prepare import list_readings, survey_pictures
from knotfab.studio.fields import Value

__all__ = ["list_ways", "preview"]

# fields that a reading fills, by its keys of a view
_FILLED = {
    "ink": "ink",
    "speck_px": "specks",
    "smooth_px": "smooth",
    "keep_largest": "keep_largest",
}


def preview(sources: Sequence[str], options: BuildOptions) -> tuple[dict[str, Any], list[bytes]]:
    """The figures, and the pictures of what tubes lose, each with its caption.

    Raises:
        KnotfabError: the pictures cannot be read, or do not go with the options.
    """
    from knotfab.picture.data_uri import encode_image
    from knotfab.preview.draw import draw_panels
    from knotfab.preview.readings import is_unclear
    from knotfab.preview.sentence import list_figures

    found = survey_pictures(sources, options)
    drawn = draw_panels(found)
    captions = [panel.caption for panel in drawn]
    figures = {**list_figures(found), "error": "", "panels": captions, "unclear": is_unclear(found)}
    return figures, [encode_image(panel.image, compress_level=6) for panel in drawn]


def list_ways(
    sources: Sequence[str], options: BuildOptions, values: Mapping[str, Value]
) -> tuple[list[dict[str, Any]], list[bytes]]:
    """Up to six ways to read a picture, as what the fields would hold, and a thumbnail of each.

    Raises:
        KnotfabError: it cannot be read in any.
    """
    held = {field: values.get(field) for field in _FILLED.values()}
    # the page has no field for a rectangle about a subject
    found = [one for one in list_readings(sources, options) if one.keys.keys() <= _FILLED.keys()]
    ways = [
        {
            "settings": {**held, **{_FILLED[key]: value for key, value in one.keys.items()}},
            "refused": one.refusal is not None,
        }
        for one in found
    ]
    return ways, [one.thumbnail() for one in found]
