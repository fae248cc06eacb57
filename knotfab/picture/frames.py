"""Reading a sequence: numbered files of a folder, or pictures one by one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from knotfab.base.disk import at_home
from knotfab.base.limited import run_limited
from knotfab.picture.raster import own_box
from knotfab.picture.read import PLAIN, Target, read_uncut
from knotfab.picture.source import PICTURE_SUFFIXES, is_picture, name_picture
from knotfab_formats.errors import InputError, shown
from knotfab_formats.views import Reading

MOST_FRAMES = 240  # frames of a sequence
_SECONDS = 900  # processor time in which all are read


def frame_name(number: int) -> str:
    """Return the name of a frame's view, from 1: "frame-01"."""
    return f"frame-{number:02d}"


def name_sequence(source: str) -> str:
    """Name a sequence after its folder or its first picture."""
    path = Path(source)
    return name_picture(str(path.parent.absolute()) if "*" in path.name else source)


def read_frames(
    sources: Sequence[str],
    reading: Reading = PLAIN,
    *,
    base: Path | None = None,
    font: str | None = None,
) -> tuple[Target, ...]:
    """Read the frames of a sequence, in order, named frame-01, frame-02, …

    Args:
        sources: a folder (its pictures in the order of the numbers in their names), a pattern such
            as "walk/frame-*.png" (the same), or several pictures in the order given.
        reading: how each becomes a silhouette.
        base: folder that relative paths start from.
        font: font of pictures that are `text:…`.

    Raises:
        InputError: fewer than two frames, more than 240, frames of different sizes, or a picture
            that cannot be read.
    """
    named = [shown(source) for source in sources]
    return run_limited(
        lambda: _read_frames(sources, reading, base, font),
        named[0] if len(named) == 1 else "the sequence",
        seconds=_SECONDS,
    )


def _read_frames(
    sources: Sequence[str], reading: Reading, base: Path | None, font: str | None
) -> tuple[Target, ...]:
    alike = reading.crop_px is None  # one box for all, about whatever moves in it
    reading = reading.but(crop_px=False) if alike else reading
    sources = [str(s) for s in sources]
    what = sources[0] if len(sources) == 1 else "the sequence"
    paths: Sequence[str | Path] = sources
    if len(sources) == 1:
        path, base = at_home(sources[0]) if base is None else base / at_home(sources[0]), None
        if path.is_dir() or "*" in path.name:
            paths = [*sorted(_list_files(path, what), key=_by_number)]
        else:
            paths = [path]
            read_uncut(path, reading)  # a file that is no picture is told as such
    _count(what, len(paths))
    read = [read_uncut(p, reading, base, font) for p in paths]
    found, told = [target for target, _ in read], list[str]()
    if sheets := [target.mask.shape for target, sheet in read if sheet]:
        alike, told = True, ["all frames are cropped to one box (--crop none keeps the sheets)"]
        # a frame that is no sheet, and whose own border is left out, is read with it
        whole = reading.but(crop_px=False)
        found = [
            t if t.mask.shape == sheets[0] else read_uncut(p, whole, base, font)[0]
            for t, p in zip(found, paths, strict=True)
        ]
    first = found[0]
    for number, target in enumerate(found, start=1):
        if (target.width, target.height) != (first.width, first.height):
            raise InputError(
                what,
                f"frame {number} is {target.width} x {target.height} px and the first is "
                f"{first.width} x {first.height} px",
                "Give all frames one size",
            )
    box = own_box(np.logical_or.reduce([t.mask for t in found])) if alike else None
    found = found if box is None else [t.cropped(box) for t in found]
    return tuple(
        replace(t, name=frame_name(k), title="", notes=(*t.notes, *told))
        for k, t in enumerate(found, start=1)
    )


def count_knots(targets: Sequence[Target], asked: int | None = None) -> int:
    """Return how many knots move through all frames: one per piece if all have equally many, else one.

    Args:
        asked: the number that the scene gives.

    Raises:
        InputError: more than one is asked for, and a frame has a different number of pieces.
    """
    counts = [target.pieces for target in targets]
    if asked is None:
        return counts[0] if len(set(counts)) == 1 else 1
    other = next((k for k, count in enumerate(counts, start=1) if count != asked), None)
    if asked > 1 and other is not None:
        raise InputError(
            f"{asked} knots (--knots {asked})",
            f"frame {other} has another number of pieces ({counts[other - 1]}), and a knot can neither "
            "begin nor end between frames",
            "Leave it out, or draw as many pieces in every frame",
        )
    return asked


def tell_apart(targets: Sequence[Target], knots: int) -> str | None:
    """Return a note on the strand that shows between pieces joined by one knot; None if there is none."""
    apart = [k for k, target in enumerate(targets, start=1) if target.pieces > knots]
    if not apart:
        return None
    every = len(apart) == len(targets)
    where = "In every frame" if every else f"In frame {', '.join(map(str, apart))}"
    return (
        f"{where} pieces lie apart, and one knot runs through all frames: the strand that joins them "
        "shows. Let them touch, draw as many pieces in every frame, or build each as a sequence of its own."
    )


def _list_files(path: Path, what: str) -> list[Path]:
    """Return the pictures of a folder, or the files that match a pattern."""
    try:
        if path.is_dir():
            # a GIF beside frames is the animation that they make
            frames = PICTURE_SUFFIXES - {".gif"}
            return [p for p in path.iterdir() if is_picture(p, frames)]
        return [p for p in path.parent.glob(path.name) if p.is_file() and p.name[0] != "."]
    except OSError as error:
        raise InputError(
            what, f"it cannot be read ({error.strerror or error})", "Change its permissions."
        ) from error


def _by_number(path: Path) -> tuple[list[int], str]:
    """Return a sort key by the numbers in a name: 2 before 10."""
    return [int(n) for n in re.findall(r"\d+", path.stem)], path.name


def _count(what: str, count: int) -> None:
    if count < 2:
        raise InputError(
            what,
            "it holds no sequence: " + ("one picture" if count else "no picture"),
            "Name a folder of numbered pictures, or several pictures; of an animation, save the frames so.",
        )
    if count > MOST_FRAMES:
        raise InputError(
            what, f"it has {count} frames, more than {MOST_FRAMES}", "Leave out every other one."
        )
