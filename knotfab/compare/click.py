"""A page to point at the frame's corners in a photograph: four clicks, and it says the command."""

from __future__ import annotations

import shlex
from pathlib import Path

from PIL import Image

from knotfab.compare.compare import read_photo
from knotfab.files.whole import write_whole
from knotfab.picture.data_uri import image_uri
from knotfab.report.report_html import make_environment

__all__ = ["write_click_page"]

_LONGER_PX = 2000  # longer side of the photograph as it is shown


def write_click_page(photo: Path, command: list[str], out: Path) -> None:
    """Write a page of one file, which opens offline.

    Args:
        command: the call of `knotfab compare` without its corners: what the page adds them to.

    Raises:
        InputError: the photograph cannot be read, or the page not written.
    """
    image = Image.fromarray((255 * read_photo(photo)).round().astype("uint8"))
    width, height = image.size
    image.thumbnail((_LONGER_PX, _LONGER_PX))
    template = make_environment(Path(__file__).parent).get_template("click.html.j2")
    page: str = template.render(
        name=photo.name,
        uri=image_uri(image, "jpeg", quality=85),
        width=width,
        height=height,
        before=shlex.join(command[:4]),
        after="".join(f" {shlex.quote(word)}" for word in command[4:]),
    )
    write_whole(out, page.encode())
