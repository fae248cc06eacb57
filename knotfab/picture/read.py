"""Reading a picture from any source: an image file, an SVG, or `text:…`."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from knotfab.base.arrays import Mask
from knotfab.base.limited import run_limited
from knotfab.picture import raster, text
from knotfab.picture.bending import Bending
from knotfab.picture.doubt import tell_other_reading
from knotfab.picture.ground import guess_reading
from knotfab.picture.raster import encode_image
from knotfab.picture.silhouette import pieces_of, smooth
from knotfab.picture.source import (
    DRAWN_SUFFIXES,
    SECONDS,
    TEXT_PREFIX,
    bare_picture,
    name_picture,
    plain_name,
    read_bytes,
    read_source,
    title_of,
)
from knotfab.picture.svg.render import render_svg
from knotfab.picture.svg.xml import looks_like_svg
from knotfab_formats.errors import InputError, shown
from knotfab_formats.views import Box, Reading, View, is_mask

PLAIN = Reading()
_READ_AS_IT_IS = dict(PLAIN)
MOVING = ("GIF", "WEBP", "PNG", "AVIF", "TIFF")  # formats that can hold an animation, or pages
# frames of an animation, and px of all of them, searched for the first with a shape: some 8 CPU s
_MOST_TRIED, _MOST_TRIED_PX = 100, 4e8
_MOST_NAMED = 12  # letters in one sentence
# how far from a letter's box its parts may lie: in its longer sides, and at least in the masks' longer sides
_BESIDE, _LEAST_BESIDE = 0.25, 0.01
_CRUMB = 0.01  # share of the ink below which a part is no piece of its own


class Letter(NamedTuple):
    """A letter of a text, with its number and its box in shares of the picture's sides."""

    number: int
    name: str
    left: float
    top: float
    right: float
    bottom: float


class Given(NamedTuple):
    """The file that a picture came as, byte for byte."""

    data: bytes
    suffix: str  # of its format, such as ".jpg"


class Change(NamedTuple):
    """What a shadow is compared with and scored by, where something else is drawn."""

    asked: Mask  # as it was read
    judged: Mask  # with strokes as wide as they are drawn, and bent
    bending: Bending | None = None


@dataclass(frozen=True, repr=False)
class Target:
    """A picture, read once: its silhouette and what is told of it.

    `mask` (height, width) is True where the drawn shape is, row 0 at the top. `rule` says how it was read,
    and `notes` what was left out or guessed. `name` is a `plain_name`, `title` the name as given. After a
    glance `shrunk` px of the picture make one of the mask, across. The first of the masks that lamps mix has
    the picture in colours, in their size, as its `given`.
    """

    name: str
    mask: Mask
    rule: str = ""
    title: str = ""
    given: Given | None = None
    notes: tuple[str, ...] = ()
    letters: tuple[Letter, ...] | None = None  # of a text; boxes in shares of the mask's sides
    shrunk: int = 1
    settled: bool = False  # whether it was read from a build's mask, of which nothing is left out
    change: Change | None = None

    @property
    def shown(self) -> str:
        """The name to show to people."""
        return self.title or self.name

    @property
    def width(self) -> int:
        return int(self.mask.shape[1])

    @property
    def height(self) -> int:
        return int(self.mask.shape[0])

    @property
    def is_text(self) -> bool:
        """Whether it is text, which must not be mirrored."""
        return self.letters is not None

    def cropped(self, box: Box) -> Target:
        """Return what of it lies in a box of its mask, before it is bent; `letters` stay as they are."""
        left, top, width, height = box
        part = np.s_[top : top + height, left : left + width]
        change = self.change and Change(self.change.asked[part], self.change.judged[part])
        rule = f"{self.rule}; {raster.tell_box(box, self.shrunk)}"
        return replace(self, mask=self.mask[part].copy(), change=change, rule=rule)

    def to_picture(self, at: tuple[float, float]) -> tuple[float, float]:
        """Convert a point of the masks to px of the picture, whose pixel centres are whole numbers."""
        x, y = ((c + 0.5) * self.shrunk - 0.5 for c in at)
        return x, y

    def letters_at(self, places: Iterable[Sequence[float]]) -> str:
        """Name the letters at these points of the masks: "A and P"; "" where there are none.

        Where some points are beside the text, the names end in "among them".
        """
        found = [self._letter_at(place) for place in places]
        names = list(
            dict(sorted((letter.number, letter.name) for letter in found if letter)).values()
        )
        if len(names) > _MOST_NAMED:
            names[_MOST_NAMED:] = [f"{len(names) - _MOST_NAMED} more"]
        *others, last = names or [""]
        told = f"{', '.join(others)} and {last}" if others else last
        return f"{told} among them" if told and None in found else told

    def _letter_at(self, place: Sequence[float]) -> Letter | None:
        """Return the letter nearest to a point of the masks, if it is near enough."""
        at, size = np.array(place) + 0.5, np.array(self.mask.shape[::-1])

        def away(letter: Letter) -> tuple[float, float]:
            box = np.reshape(letter[2:], (2, 2)) * size
            beside = np.hypot(*np.maximum(np.maximum(box[0] - at, at - box[1]), 0.0))
            reach = max(_BESIDE * (box[1] - box[0]).max(), _LEAST_BESIDE * size.max())
            return max(float(beside - reach), 0.0), float(np.hypot(*(at - box.mean(axis=0))))

        nearest = min(self.letters or (), key=away, default=None)
        return nearest if nearest and away(nearest)[0] == 0.0 else None

    @cached_property
    def pieces(self) -> int:
        """The number of drawn pieces, crumbs aside."""
        _, areas = pieces_of(self.mask)
        return int((areas >= _CRUMB * areas.sum()).sum())

    @property
    def asked(self) -> Mask:
        """The silhouette that a shadow is compared with: as it was read."""
        return self.mask if self.change is None else self.change.asked

    @property
    def judged(self) -> Mask:
        """The silhouette by which a shadow is scored."""
        return self.mask if self.change is None else self.change.judged

    @property
    def bending(self) -> Bending | None:
        """How `mask` and `judged` were bent or mirrored."""
        return None if self.change is None else self.change.bending


def read_target(
    source: str | Path,
    reading: Reading = PLAIN,
    *,
    base: Path | None = None,
    font: str | None = None,
    glance: int = 0,
) -> Target:
    """Read a picture and take its silhouette.

    Args:
        source: path of a PNG, JPEG, WebP, BMP, GIF, HEIC, AVIF, TIFF or SVG file, told apart by
            content (one that moves gives its first frame with a shape); or `text:` and characters to draw.
            Of a mask that a build wrote (`is_mask`) nothing is guessed, and what was given lies beside it.
        reading: how it becomes a silhouette; a view of a scene is one.
        base: folder that a relative path starts from (that of the scene file); the current one if
            left out.
        font: font of `text:`, a family's name or a font file.
        glance: px to which a large picture's longer side may be shrunk at once; 0: none.

    Raises:
        InputError: the picture cannot be read, or holds no shape that can be drawn.
    """

    def read() -> Target:
        found, sheet = read_uncut(source, reading, base, font, glance)
        if not sheet:
            return found
        told = f"{sheet}; the sheet about it is cropped off (--crop none keeps it)"
        notes = tuple(told if note == sheet else note for note in found.notes)
        return replace(found.cropped(raster.own_box(found.mask)), notes=notes)

    return run_limited(read, shown(source), seconds=SECONDS)


def read_uncut(
    source: str | Path,
    reading: Reading = PLAIN,
    base: Path | None = None,
    font: str | None = None,
    glance: int = 0,
) -> tuple[Target, str]:
    """Read a picture as `read_target` does, here, and crop no sheet off.

    Returns:
        The picture, and the note on the sheet that is to be cropped off; "" where there is none.
    """
    what, name = shown(source), name_picture(str(source))
    if isinstance(source, str) and source.startswith(TEXT_PREFIX):
        content = source.removeprefix(TEXT_PREFIX)
        drawn, fonts = text.render_text(content, font)
        target, _ = _take_target(drawn, what, name, reading, glance)
        begin, end = (np.flatnonzero(target.mask.any(axis=0))[[0, -1]] + 0.5) / target.width
        letters = tuple(
            Letter(k, sign, begin + left * (end - begin), 0.0, begin + right * (end - begin), 1.0)
            for k, (sign, left, right) in enumerate(text.find_letters(content, font))
        )
        notes = text.tell_other_fonts(content, font) + target.notes
        rule, title = f"{target.rule} [in {', '.join(fonts)}]", title_of(content.strip())
        return replace(target, letters=letters, title=title, rule=rule, notes=notes), ""
    data, path = read_source(source, base)
    is_svg = _is_drawn(data, path)
    pixels, notes = render_svg(data, what) if is_svg else (data, ())
    try:
        name = plain_name(path.stem, "picture")
        target, sheet = _take_target(pixels, what, name, reading, glance)
    except InputError as error:
        if not notes:
            raise
        why = f"as it is drawn, {error.why} ({'; '.join(notes)})"
        raise InputError(what, why, error.remedy) from error
    suffix = path.suffix.lower()
    usual = DRAWN_SUFFIXES if is_svg else raster.suffixes_of(data)
    came = Given(data, suffix if suffix in usual else usual[0])
    given = _given_beside(path) if target.settled else came
    notes += target.notes
    return replace(target, notes=notes, title=title_of(path.stem), given=given), sheet


def _is_drawn(data: bytes, path: Path) -> bool:
    """Return whether a file is an SVG."""
    drawn = path.suffix.lower() in DRAWN_SUFFIXES or looks_like_svg(data)
    return drawn and not raster.looks_like_raster(data)


def _given_beside(mask: Path) -> Given | None:
    """Read the file that a build took a mask from; None where it does not lie beside it."""
    pattern = f"given-{glob.escape(mask.stem.removeprefix('picture-'))}.*"
    for path in sorted(mask.parent.glob(pattern)):
        return Given(read_bytes(path, path.name), path.suffix)
    return None


def read_image(source: str | Path, *, base: Path | None = None) -> Image.Image:
    """Read a picture in its colours; arguments as `read_target` takes them.

    Raises:
        InputError: it cannot be read.
    """
    return run_limited(lambda: _read_image(source, base), shown(source), seconds=SECONDS)


def _read_image(source: str | Path, base: Path | None) -> Image.Image:
    what = shown(source)
    if isinstance(source, str) and source.startswith(TEXT_PREFIX):
        data = text.render_text(source.removeprefix(TEXT_PREFIX))[0]
    else:
        data, path = read_source(source, base)
        if _is_drawn(data, path):
            data = render_svg(data, what)[0]
    return raster.to_plain(raster.decode(data, what)[0])


def read_targets(
    sources: Sequence[str],
    views: Sequence[Reading],
    *,
    base: Path | None = None,
    font: str | None = None,
    glance: int = 0,
) -> tuple[Target, ...]:
    """Read the pictures of all views, in their order.

    Args:
        sources: as `read_target` takes them. views: how each is read.
        base, font, glance: as `read_target` takes them.

    Raises:
        InputError: one cannot be read, or there are not as many as views.
    """
    if len(sources) != len(views):
        raise InputError(
            "",
            f"{len(sources)} pictures are given for {len(views)} views",
            "Give one picture for each [[views]] of the scene, in their order",
        )
    if any(os.path.isfile(os.path.join(base or "", source)) for source in sources):
        from scipy import ndimage  # noqa: F401 (the copy that reads would load it, and lose it)
    return run_limited(
        lambda: tuple(
            read_target(source, view, base=base, font=font, glance=glance)
            for source, view in zip(sources, views, strict=True)
        ),
        ", ".join(map(shown, sources)) if len(sources) < 4 else "the pictures",
        seconds=SECONDS * len(sources),
    )


def name_targets(targets: Sequence[Target], views: Sequence[View]) -> tuple[Target, ...]:
    """Name pictures as a built scene titles them: its picture-front.png still has the title of cat.png."""
    return tuple(
        replace(t, name=plain_name(v.title, t.name), title=v.title)
        for t, v in zip(targets, views, strict=True)
    )


def _take_target(
    data: bytes, what: str, name: str, reading: Reading, glance: int
) -> tuple[Target, str]:
    """Take the silhouette of a pixel picture; return it with the note on its sheet, as `read_uncut` does."""
    glance *= isinstance(reading.crop_px, bool)
    image, kind, size, shrunk = raster.decode_shrunk(data, what, glance)
    frames = raster.count_frames(data) if kind in MOVING else 1
    settled = is_mask(data)
    asked = reading = reading.but(ink="dark") if settled and reading.ink == "auto" else reading
    if kind not in raster.KEPT:
        image = raster.to_plain(image)
    image, notes, on_paper = bare_picture(image, reading)
    try:
        reading, told = guess_reading(image, reading, what)
        notes = (*notes, *told)
        if shrunk > 1 and reading.crop_px != asked.crop_px:
            return _take_target(data, what, name, asked, 0)  # to tell a thin frame in its own px
        mask, rule = raster.silhouette(image, what, reading, shrunk)
    except InputError:
        if frames == 1:
            raise
        return _first_drawn(data, what, name, asked, glance, frames, size)
    if settled:
        rule = re.sub(r"what is dark \[[^]]*\]", "the silhouette that a build read", rule)
    if frames > 1:
        rule = f"the first of its {frames} frames: {rule}"
    if not notes and asked == asked.but(**_READ_AS_IT_IS):
        notes = tell_other_reading(image, mask)
    change = None
    if reading.smooth_px:
        change = Change(mask, mask)
        mask = smooth(mask, reading.smooth_px / shrunk)
        raster.check_shape(mask, f"{what}, smoothed,")
        rule += f"; drawn smoothed by {reading.smooth_px:g} px"
    found = Target(name, mask, rule, notes=notes, shrunk=shrunk, settled=settled, change=change)
    return found, notes[0] if on_paper and reading.crop_px is True else ""


def _first_drawn(
    data: bytes,
    what: str,
    name: str,
    reading: Reading,
    glance: int,
    frames: int,
    size: tuple[int, int],
) -> tuple[Target, str]:
    """Return an animation's first frame that holds a shape, if its very first one holds none."""
    refused = None
    most = min(_MOST_TRIED, max(2, int(_MOST_TRIED_PX / (size[0] * size[1]))))
    for number, frame in enumerate(raster.take_frames(data, most), start=1):
        if not np.ptp(np.reshape(frame.getextrema(), (-1, 2)), axis=1).any():
            continue  # of one colour
        try:
            found, sheet = _take_target(encode_image(frame), what, name, reading, glance)
        except InputError as error:
            refused = refused or error
        else:
            rule = f"frame {number} of its {frames}, the first with a shape: {found.rule}"
            return replace(found, rule=rule), sheet
    tried = f"none of its first {most} frames" if frames > most else "none of its frames"
    raise refused or InputError(
        what, f"{tried} holds a shape", "Export the animation again, as GIF or PNG."
    )
