"""Facts that a maker reads first: the lamp to take, the use of each file, the picture of the drawing."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.hold.mount import Mounted
from knotfab.hold.placement import placement_of
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.picture.raster import image_uri
from knotfab.render.pages import length
from knotfab.report.setup_words import lamp_facts, steps_of
from knotfab.scene.camera import Camera
from knotfab_formats.print_figures import Print, SetupSteps, SlicerFigures
from knotfab_formats.verdict import Check, Status
from knotfab_formats.views import View
from knotfab_validators.check import at_most

TORCH_MM = 5.0  # across which a phone's torch shines
BULB_MM = 60.0  # a frosted bulb
_COLOURS = 32  # colours of a drawing
_PAPER = 250  # a grey that is as good as white
_NO_WORDS = "#words { display: none }"  # they stand beside it

# the file that a maker opens first comes first
FILES = (
    (r"part(-\d+)?\.3mf", "for the slicer: the whole piece, in print pose"),
    (r"table-\d+\.3mf", "for the slicer: the frame that holds screen, piece and lamps"),
    (r"part-colours(-\d+)?\.3mf", "the same, its bodies by name and colour"),
    (r"slicer\.ini", "printer, filament and supports for PrusaSlicer"),
    (r"setup(-\d+)?\.pdf", "where piece, wall and lamp stand, with dimensions"),
    (r"drill-template(-\d+)?\.pdf", "the holes at full size: print it at 100 %"),
    (r"piece\.png", "the piece with its shadow: a picture to send"),
    (r"part(-\d+)?\.glb", "for phones and 3D viewers, as it hangs or stands"),
    (r"part(-\d+)?\.stl", "the mesh that was verified, in mm"),
    (r"knots(-\d+)?\.json", "the centre lines"),
    (r"scene(-\d+)?\.toml", "every setting: builds the same piece again"),
    (r"report\.json", "all of this for programs"),
)


def tell_setup(
    mounted: Mounted, cameras: Sequence[Camera], tube_radius_mm: float
) -> tuple[SetupSteps, ...]:
    """Say for each view what to do and which lamp to take: the report's `print.setup`."""
    return tuple(
        SetupSteps(
            view=view.name,
            steps=tuple(steps_of(mounted, placement_of(mounted, camera), view)),
            lamp=tuple(advise_lamp(view, tube_radius_mm)),
        )
        for view, camera in zip(mounted.scene.views, cameras, strict=True)
    )


def advise_lamp(view: View, tube_radius_mm: float) -> list[str]:
    """Say which lamp will do: the drawing's facts, then whether a phone's torch or a bulb will.

    The shadow of an edge in the middle of the piece is blurred over the lamp's width times the
    distance behind the piece over that before it.
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


def sort_files(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return the files that a maker uses with what each is for, the first to open at the top."""
    held = sorted(names)
    return [(name, what) for one, what in FILES for name in held if re.fullmatch(one, name)]


def list_files(names: Iterable[str]) -> list[tuple[str, str]]:
    """List the files beside a report as `sort_files` does.

    Where a sequence has many files of a kind, its first and last stand for all: "part-01.3mf …
    part-12.3mf".
    """
    alike: dict[tuple[str, str], list[str]] = {}
    for name, what in sort_files(names):
        alike.setdefault((re.sub(r"-\d+\b", "-", name), what), []).append(name)
    found = []
    for (_, what), group in alike.items():
        many = [f"{group[0]} … {group[-1]}"] if len(group) > 3 else group
        found += [(name, what) for name in many]
    return found


def draw_setup(folder: Path) -> list[str]:
    """Render setup.svg without its words, as data URIs: two if its drawings stand far apart."""
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
    """Find rows (axis 1) or columns (axis 0) of a picture with ink, or within 16 px of it."""
    from scipy.ndimage import binary_dilation

    inked = (np.asarray(image.convert("L")) < _PAPER).any(axis=axis)
    # empty rows and columns that are kept beside the drawing
    return np.asarray(binary_dilation(inked, iterations=16))


# The slicer's part of a report: its check and its table.


def tell_unsliced(result: Sliced | NotSliced | None) -> list[str]:
    """Say why the hours and supports of a printed piece are not known; nothing if they are."""
    if not isinstance(result, NotSliced) or result.kind == "process":
        return []
    return [f"Hours and supports are not known: {result.reason}. {result.remedy}".strip()]


def check_slicing(result: Sliced | NotSliced) -> Check:
    """Check `slicer`: whether PrusaSlicer makes G-code that prints the part.

    The program ends with exit code 0 for a mesh with holes, for one that overlaps itself and for a part
    outside the bed, and leaves out what is thinner than a line without a word: so its G-code is looked at.
    It fails if the program refuses the part or crashes on it, for a warning that nothing explains away,
    and for G-code that does not print the part. Without a slicer, or without an answer in time, it
    is skipped and not required.
    """
    if isinstance(result, Sliced):
        problems = result.problems
        good = f"{result.program} {result.version} slices part.3mf; " + "; ".join(
            c.detail for c in result.checks if c.name in ("surface", "bed")
        )
        detail = "; ".join(problems) or good
        return at_most("slicer", len(problems), 0, "problems", detail)
    failed = result.kind in ("refused", "crashed")
    parts = [result.reason]
    if result.said and result.said not in result.reason:
        parts.append(f"it said: {result.said}")
    if result.remedy:
        parts.append(f"remedy: {result.remedy}")
    status: Status = "fail" if failed else "skipped"
    return Check("slicer", status, failed, 1 if failed else None, 0, "problems", "; ".join(parts))


def report_slicing(result: Sliced | NotSliced) -> SlicerFigures:
    """Fill the report's table `slicer`; its figures are None where the part was not sliced."""
    if isinstance(result, NotSliced):
        return SlicerFigures(reason=result.reason, remedy=result.remedy, warnings=(), checks=())
    return SlicerFigures(**vars(result))


def with_slicing(print_: Print, result: Sliced | NotSliced | None) -> Print:
    """Add to a printed piece's figures what the slicer says that it takes."""
    if not isinstance(result, Sliced):
        return print_
    return replace(
        print_,
        time_s=result.time_s,
        filament_m=result.filament_m,
        filament_g=result.filament_g,
        support_g=result.filament_g * result.support_share,
        support_share=result.support_share,
    )
