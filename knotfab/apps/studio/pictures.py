"""The pictures of a studio: uploads are checked and kept, and shown with what a tube will make of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image
from pydantic import BaseModel, ConfigDict

from knotfab.base.disk import write_whole
from knotfab.base.limited import run_limited
from knotfab.picture import raster, text
from knotfab.picture.raster import encode_image
from knotfab.picture.source import SECONDS, TEXT_PREFIX, name_picture
from knotfab.picture.svg.render import render_svg
from knotfab.picture.svg.xml import looks_like_svg
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import survey_pictures
from knotfab_formats.errors import InputError

if TYPE_CHECKING:
    from PIL import Image


LARGEST_BYTES = 32 * 2**20  # of a picture
_SHOWN_PX = 1024  # longer side of a thumbnail, and of a picture on the page


class TooLargeError(InputError):
    """The request has too many bytes."""


class StudioPicture(BaseModel):
    """A picture in the tray, kept as `file` in the folder of pictures.

    `text` is the content of a typed text. `width` and `height` are px, upright.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: str
    title: str
    file: str
    text: str | None = None
    width: int
    height: int

    def source(self, folder: Path) -> str:
        """Return the picture as an argument of the command line."""
        return str(folder / self.file) if self.text is None else TEXT_PREFIX + self.text


def keep_picture(data: bytes, file_name: str, folder: Path) -> StudioPicture:
    """Check an uploaded picture, and save it in `folder` under a unique name.

    Raises:
        InputError: it cannot be read, or is too large.
    """
    what = "".join(c for c in file_name if c.isprintable())[:80] or "the picture"
    return run_limited(lambda: _keep_picture(data, what, folder), what, seconds=SECONDS)


def _keep_picture(data: bytes, what: str, folder: Path) -> StudioPicture:
    if not data:
        raise InputError(what, "the file is empty", "Copy or export it again.")
    if len(data) > LARGEST_BYTES:
        raise too_large(what)
    if looks_like_svg(data):
        image, _ = raster.decode(render_svg(data, what)[0], what)
        suffix = ".svg"
    else:
        image, kind = raster.decode(data, what)  # says what it is not
        suffix = raster.SUFFIXES[kind][0]
    path = _save_picture(data, name_picture(what), suffix, folder)
    title = Path(what).stem
    _keep_thumbnail(image, path)
    return StudioPicture(
        name=path.stem, title=title, file=path.name, width=image.width, height=image.height
    )


def keep_text(content: str, folder: Path, font: str | None = None) -> StudioPicture:
    """Save a text as a picture in `folder` under a unique name.

    Raises:
        InputError: it is empty, too long, or cannot be drawn.
    """
    content = " ".join(content.split())
    if not 0 < len(content) <= 40:  # characters
        raise InputError("the text", f"it has {len(content)} characters", "Give 1 to 40.")
    source = TEXT_PREFIX + content
    image, _ = raster.decode(text.render_text(content, font)[0], source)
    path = _save_picture(content.encode(), name_picture(source), ".txt", folder)
    _keep_thumbnail(image, path)
    size = {"width": image.width, "height": image.height}
    title = "".join(c for c in content if c.isprintable())
    return StudioPicture(name=path.stem, title=title, file=path.name, text=content, **size)


def thumbnail(folder: Path, name: str) -> Path:
    """Return the path of a picture's thumbnail."""
    return folder / ".shown" / f"{name}.png"


def _save_picture(data: bytes, plain: str, suffix: str, folder: Path) -> Path:
    """Write a picture to `folder`, numbered if its name is taken regardless of case, and return its path."""
    name, number = plain, 2
    while held := [p for p in folder.glob("[!.]*.*") if p.stem.casefold() == name.casefold()]:
        if all(p.suffix == suffix and p.is_file() and p.read_bytes() == data for p in held):
            return held[0]
        name, number = f"{plain}-{number}", number + 1
    path = folder / f"{name}{suffix}"
    write_whole(path, data)
    return path


def too_large(what: str, largest: int = LARGEST_BYTES) -> TooLargeError:
    if largest < LARGEST_BYTES:
        return TooLargeError(what, f"it has more than {largest >> 10} kB", "Load the page again.")
    return TooLargeError(
        what,
        f"it has more than {LARGEST_BYTES // 2**20} MB, too much for a picture",
        "Scale it down; about 1000 pixels on a side are enough.",
    )


def _keep_thumbnail(image: Image.Image, path: Path) -> None:
    """Write the thumbnail of a picture, without any metadata of its file."""
    small = image.convert("RGBA")
    small.thumbnail((_SHOWN_PX, _SHOWN_PX))
    plain = Image.new("RGBA", small.size)
    plain.paste(small)
    write_whole(thumbnail(path.parent, path.stem), encode_image(plain))


def preview(sources: Sequence[str], options: BuildOptions) -> tuple[dict[str, Any], list[bytes]]:
    """Survey pictures. Returns the figures for the page, and PNGs of what the tube loses.

    Raises:
        KnotfabError: the pictures cannot be read, or contradict the options.
    """
    from knotfab.design.sentence import list_figures
    from knotfab.picture.raster import encode_image
    from knotfab.report.pictures import draw_panels

    found = survey_pictures(sources, options)
    drawn = draw_panels(found)
    captions = [panel.caption for panel in drawn]
    figures = {**list_figures(found), "error": "", "panels": captions}
    return figures, [encode_image(panel.image, compress_level=6) for panel in drawn]
