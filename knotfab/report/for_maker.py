"""Facts that a maker reads first: the lamp to take, the use of each file, the picture of the drawing."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.drawing.dimensions import length
from knotfab.mount.mount import Mounted
from knotfab.mount.placement import placement_of
from knotfab.mount.words import lamp_facts, steps_of
from knotfab.picture.data_uri import image_uri
from knotfab.scene.camera import Camera
from knotfab_formats.report import SetupSteps
from knotfab_formats.scene import View

__all__ = ["advise_lamp", "draw_setup", "list_files", "tell_setup"]

TORCH_MM = 5.0  # across which a phone's torch shines
BULB_MM = 60.0  # a frosted bulb
_COLOURS = 32  # colours of a drawing
_PAPER = 250  # a grey that is as good as white
_NO_WORDS = "#words { display: none }"  # they stand beside it

# the file that a maker opens first comes first
FILES = (
    (r"part(-\d+)?\.3mf", "for the slicer: the whole piece, in print pose"),
    (r"plate(-\d+)+\.3mf", "for the slicer: what is printed in one go"),
    (
        r"(part|plate)(-\d+)*\.gcode",
        "for the printer: sliced with slicer.ini, with pictures for its screen",
    ),
    (r"table-\d+\.3mf", "for the slicer: the frame that holds screen, piece and lamps"),
    (r"part-colours(-\d+)?\.3mf", "the same, its bodies by name and colour"),
    (r"coupon\.3mf", "a small print to try the mount's fit on"),
    (r"slicer\.ini", "printer, filament and supports for PrusaSlicer"),
    (r"zoetrope\.(stl|3mf)", "all frames on one turning ring"),
    (r"setup(-\d+)?\.pdf", "where piece, wall and lamp stand, with dimensions"),
    (r"drill-template-\w+(-\d+)?\.pdf", "the holes at full size: print it at 100 %"),
    (r"bending-templates-\w+(-\d+)?\.pdf", "the wire at full size: print it at 100 %"),
    (r"bends(-\d+)*\.csv", "the wire's bends, one a line"),
    (r"bends(-\d+)*-[\w-]+\.\w+", "the same for the bender"),
    (
        r"centre-lines(-\d+)?\.(dxf|svg)",
        "the centre lines in the shadow, at full size: a layer a knot",
    ),
    (r"shadow-[^./]+\.svg", "the shadow's outline at full size, for cutters"),
    (r"part(-\d+)?\.step", "for CAD: tubes and mount as solids that overlap where they join"),
    (r"centre-lines(-\d+)?\.step", "for CAD: the centre lines as splines"),
    (r"part(-\d+)?\.glb", "for phones and 3D viewers, as it hangs or stands"),
    (r"part(-\d+)?\.stl", "the mesh that was verified, in mm"),
    (r"turn\.gif", "the shadow while the piece turns under one lamp"),
    (r"sequence\.gif", "the shadows of all frames"),
    (r"knots(-\d+)?\.json", "the centre lines"),
    (r"scene(-\d+)?\.toml", "every setting: builds the same piece again"),
    (r"report\.json", "all of this for programs"),
)


def tell_setup(
    mounted: Mounted, cameras: Sequence[Camera], tube_radius_mm: float
) -> tuple[SetupSteps, ...]:
    """Write the report's `print.setup`: what to do for each view, and what lamp to take, in two sentences."""
    return tuple(
        SetupSteps(
            view=view.name,
            steps=tuple(steps_of(mounted, placement_of(mounted, camera, view), view)),
            lamp=tuple(advise_lamp(view, tube_radius_mm)),
        )
        for view, camera in zip(mounted.scene.views, cameras, strict=True)
    )


def advise_lamp(view: View, tube_radius_mm: float) -> list[str]:
    """Say which lamp will do, a sentence or two each: the drawing's facts, a phone's torch, a bulb.

    The shadow of an edge in the middle of the piece is as wide as the lamp, by the distances
    behind and before it.
    """
    facts = lamp_facts(view)
    if view.kind != "shadow" or view.light_has_sides:
        return facts  # a lamp of such a shape is at hand, and no torch or bulb stands in for it
    spread = view.wall_distance_mm / view.light_distance_mm
    strand = 2 * tube_radius_mm * view.magnification
    torch, bulb = TORCH_MM * spread, BULB_MM * spread
    facts.append(
        f"A phone's torch will do: it shines from about {length(TORCH_MM)} mm, and outlines blur by "
        f"{length(torch)} mm. Fix the phone so that its light, not its middle, is where the lamp belongs."
    )
    against = "more than" if bulb > strand else "while"
    facts.append(
        f"No frosted bulb: {length(BULB_MM)} mm across, it blurs outlines by {length(bulb)} mm, {against} "
        f"a strand's shadow is {length(strand)} mm wide."
    )
    return facts


def list_files(names: Iterable[str]) -> list[tuple[str, str]]:
    """List the files beside a report with what each is for, those that a maker opens first.

    Of the numbered ones of a sequence the first and the last stand for all: "part-01.3mf … part-12.3mf".
    """
    found = []
    for pattern, what in FILES:
        alike: dict[str, list[str]] = {}
        for name in sorted(name for name in names if re.fullmatch(pattern, name)):
            alike.setdefault(re.sub(r"-\d+\b", "-", name), []).append(name)
        for group in alike.values():
            # files of a kind that are listed one by one
            many = [f"{group[0]} … {group[-1]}"] if len(group) > 3 else group
            found += [(name, what) for name in many]
    return found


def draw_setup(folder: Path) -> list[str]:
    """Draw the drawings of setup.svg without their words, as data URIs: one, or two that stand far apart."""
    path = next(iter(sorted(folder.glob("setup*.svg"))), None)
    if path is None:
        return []
    import resvg_py
    from PIL import Image

    png = bytes(
        resvg_py.svg_to_bytes(
            svg_path=str(path), dpi=110.0, style_sheet=_NO_WORDS, background="#ffffff"
        )
    )
    image = Image.open(io.BytesIO(png)).convert("RGB")
    near = np.flatnonzero(_near_ink(image, 1))
    gaps = np.diff(near)
    cut = int(gaps.argmax()) + 1
    # empty rows beyond those, between two drawings: the side and the front
    bands = np.split(near, [cut]) if gaps[cut - 1] > 24 else [near]
    found = []
    for rows in bands:
        part = image.crop((0, rows[0], image.width, rows[-1] + 1))
        columns = np.flatnonzero(_near_ink(part, 0))
        close = part.crop((columns[0], 0, columns[-1] + 1, part.height))
        found.append(image_uri(close.quantize(_COLOURS), optimize=True))
    return found


def _near_ink(image: Any, axis: int) -> NDArray[np.bool_]:
    """Find which rows (axis 1) or columns (axis 0) of a picture have ink, or are near one that has."""
    from scipy.ndimage import binary_dilation

    inked = (np.asarray(image.convert("L")) < _PAPER).any(axis=axis)
    # empty rows and columns that are kept beside the drawing
    return np.asarray(binary_dilation(inked, iterations=16))
