"""PrusaSlicer's warnings, and the answer of knotfab's own checks to each."""

from __future__ import annotations

import re

from knotfab_formats.report import SlicerWarning

__all__ = ["SlicerWarning", "explain_warning", "read_warnings"]


# The first pattern found in the text decides; the words are those of versions 2.5 to 2.9.
_KNOWN: tuple[tuple[str, str, bool], ...] = (
    (
        r"Empty layer between",
        "layers in which nothing is laid: what is above them hangs in the air, or is thinner than a "
        "line",
        False,
    ),
    (
        r"no extrusions in the first layer",
        "a body that does not reach the bed, or is thinner than a line there",
        False,
    ),
    (
        r"overlapping or self-intersecting facets",
        "it met a layer's outline that touches itself; knotfab's exact test of the mesh for "
        "self-intersections is what decides, and the lines laid were compared with the surface",
        True,
    ),
    (
        r"(?s)stability issues.*Floating object part",
        "a piece that begins in the air: without supports it cannot be printed",
        False,
    ),
    (
        r"stability issues|Consider enabling supports",
        "overhangs, bridges and standing are measured on the mesh against the printer's own limits: "
        "see the checks of the part's printability",
        True,
    ),
    (
        r"Low bed adhesion|Consider enabling brim",
        "little of a tube touches the bed: print it with a brim",
        True,
    ),
    (
        r"Gtk|GLib|dconf|libEGL|MESA|X11|[Dd]isplay|locale",
        "of the window system or the language of this machine, not of the part",
        True,
    ),
)

_PROGRESS = re.compile(r"^\d+ => |^Slicing result exported to |^\[\d{4}-.*\[(trace|debug|info)\]")
_START = re.compile(r"^print(?:_object)? warning: ")


def explain_warning(text: str) -> SlicerWarning:
    """Return `text` with what is known of it."""
    for pattern, explanation, settled in _KNOWN:
        if re.search(pattern, text):
            return SlicerWarning(text, explanation, settled)
    return SlicerWarning(text)


def read_warnings(said: str) -> list[SlicerWarning]:
    """Read the warnings in what PrusaSlicer said: all that is not its report of progress.

    A warning runs over several lines, up to the next line of progress; the same one is given once.
    Lines that belong to no warning stand for themselves.
    """
    blocks: list[list[str]] = []
    inside = False
    for line in said.splitlines():
        if _PROGRESS.match(line):
            inside = False
        elif _START.match(line):
            blocks.append([_START.sub("", line)])
            inside = True
        elif line.strip():
            if inside:
                blocks[-1].append(line.strip())
            else:
                blocks.append([line.strip()])
    return [explain_warning(text) for text in dict.fromkeys("\n".join(block) for block in blocks)]
