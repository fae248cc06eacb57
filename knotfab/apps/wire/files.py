"""The files of a bending plan: bends.csv, a bender's own format, and PDF templates at full size."""

from __future__ import annotations

import csv
import io
import math
import pathlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from importlib.resources import files
from itertools import accumulate
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.sandbox import SandboxedEnvironment

from knotfab.apps.wire.arcs import Bend, BendList
from knotfab.base.apps import VERSION
from knotfab.base.arrays import Array
from knotfab.base.disk import at_home, read_file
from knotfab.base.limited import run_limited
from knotfab.render.pages import Drawing, Paper, draw_tiled, write_pages
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material
from knotfab_formats.scene import ResolvedScene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

BENDERS = {"lra": "lra.csv", "grbl": "grbl.gcode"}  # files in the folder benders, by name
_MOST_BYTES = 100_000
_SECONDS = 10  # processor time in which a template is filled in
_WRONG = (TemplateError, TypeError, ValueError, ArithmeticError, LookupError, RuntimeError)
_NEEDED = {  # what a template must write for each bend: a key of it, and how to write it
    "length": ("feed_mm", "{{ bend.feed_mm }} (or distance_mm)"),
    "rotation": ("rotation_deg", "{{ bend.rotation_deg }} (or turned_deg)"),
    "angle": ("bend_deg", "{{ bend.tool_angle_deg }} (or bend_deg)"),
}
_SAMPLE = (
    Bend(10.0, 10.0, 0.0, 30.0, 35.0, 6.0),
    Bend(33.0, 20.0, 40.0, 50.0, 55.0, 6.0),
    Bend(44.0, 5.0, 0.0, 0.0, 0.0, 0.0, "joint"),
)


def require_bender(scene: ResolvedScene) -> None:
    """Refuse an unknown bender, or one whose template leaves out length, rotation or angle of a bend.

    Raises:
        InputError: naming the template and its fault.
    """
    name = scene.piece.bender
    plain = fill_template(name, _SAMPLE, "bends", scene.material)
    for what, (key, remedy) in _NEEDED.items():
        changed = [_change(bend, key) for bend in _SAMPLE]
        if fill_template(name, changed, "bends", scene.material) == plain:
            raise InputError(
                f"the bender {name}",
                f"its template has no place for the {what} of a bend",
                f"Write {remedy} into it, between {{% for bend in bends %}} and {{% endfor %}}.",
            )


def _change(bend: Bend, key: str) -> Bend:
    if key == "feed_mm":
        return replace(bend, feed_mm=bend.feed_mm + 1.0, distance_mm=bend.distance_mm + 1.0)
    if key == "rotation_deg":
        return replace(bend, rotation_deg=bend.rotation_deg + 1.0)
    more = bool(bend.bend_deg)
    return replace(bend, bend_deg=bend.bend_deg + more, tool_angle_deg=bend.tool_angle_deg + more)


def file_of_bender(name: str, plan: str) -> str:
    """Return the name of the file for a bender, such as bends-1-lra.csv for the plan bends-1.csv."""
    own = Path(BENDERS.get(name, name))
    stem = "".join(c if c.isalnum() and c.isascii() else "-" for c in own.stem)
    return f"{Path(plan).stem}-{stem}{own.suffix.lower() or '.txt'}"


def fill_template(
    name: str, bends: tuple[Bend, ...] | list[Bend], plan: str, wire: Material
) -> str:
    """Fill in a bender's template.

    Args:
        plan: the name of the plan.

    Raises:
        InputError: the template cannot be read, or names an unknown placeholder.
    """
    environment = SandboxedEnvironment(
        undefined=StrictUndefined,
        finalize=lambda x: f"{round(x, 3) + 0.0:.3f}" if isinstance(x, float) else x,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    text = _read(name)
    told = _list_placeholders(bends, plan, wire)
    try:
        return run_limited(
            lambda: environment.from_string(text).render(told),
            f"the bender {name}",
            seconds=_SECONDS,
            gigabytes=0.5,
            verb="filling in its template",
            remedy="Write no loop into it but that over the bends.",
        )
    except TemplateSyntaxError as error:
        why = f"line {error.lineno} of its template cannot be read: {error.message}"
    except _WRONG as error:
        why = f"its template cannot be filled in: {' '.join(str(error).split())}"
    keys = ", ".join(_list_placeholders(_SAMPLE, "", wire)["bends"][0])
    raise InputError(
        f"the bender {name}", why.rstrip("."), f"A bend has {keys}; docs/wire.md lists all."
    )


def _list_placeholders(
    bends: tuple[Bend, ...] | list[Bend], plan: str, wire: Material
) -> Mapping[str, Any]:
    turned = accumulate(bend.rotation_deg for bend in bends)
    rows = [
        {"index": k, **asdict(b), "arc_mm": b.radius_mm * radians(b.bend_deg), "turned_deg": t}
        for k, (b, t) in enumerate(zip(bends, turned, strict=True), start=1)
    ]
    return {
        "bends": rows,
        "plan": plan,
        "wire": wire.name,
        "wire_diameter_mm": wire.wire_diameter_mm,
        "length_mm": bends[-1].distance_mm,
        "program": f"knotfab {VERSION}",
    }


def _read(name: str) -> str:
    """Read a bender's template.

    Raises:
        InputError: there is none of that name, or it is not text.
    """
    if name in BENDERS:
        return (files("knotfab.apps.wire") / "benders" / BENDERS[name]).read_text(encoding="utf-8")
    what = f"the bender {name}"
    known = f"Name a file, or one of {', '.join(BENDERS)}."
    data = read_file(at_home(name), what, "template", _MOST_BYTES, missing=known, too_large=known)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(what, "its template is no text in UTF-8", known) from error


# bends.csv

COLUMNS = ("index", *(field.name for field in fields(Bend)))
_PLACED = ("start_mm", "direction", "normal")


def write_bends(path: Path, bends: BendList, header: dict[str, str]) -> None:
    """Write bends.csv: lines `# key: value`, then the rows, with three decimals.

    `header` is for human readers. Start, direction and normal of the wire follow it, so that the curve can
    be rebuilt from this file alone.
    """
    text = io.StringIO()
    for key, value in header.items():
        text.write(f"# {key}: {value}\n")
    for key, vector in zip(_PLACED, (bends.start, bends.direction, bends.normal), strict=True):
        text.write(f"# {key}: {' '.join(f'{x:.9f}' for x in vector)}\n")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for number, b in enumerate(bends.bends, start=1):
        numbers = (getattr(b, name) for name in COLUMNS[1:-1])
        rows.writerow([number, *(f"{round(x, 3) + 0.0:.3f}" for x in numbers), b.note])
    path.write_text(text.getvalue(), encoding="utf-8", newline="")


def read_bends(path: Path) -> BendList:
    """Read a bends.csv.

    Raises:
        InputError: it cannot be read, lacks columns or the wire's start, or a number is impossible.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), "it cannot be read", "Check the path.") from error
    placed: dict[str, np.ndarray] = {}
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            lines.append(line)
            continue
        key, _, value = line[1:].partition(":")
        if key.strip() in _PLACED:
            placed[key.strip()] = np.array([_read_number(path, x) for x in value.split()])
    if set(placed) != set(_PLACED) or any(v.shape != (3,) for v in placed.values()):
        raise InputError(path.name, f"it does not say {', '.join(_PLACED)}", "Write it anew.")
    table = csv.DictReader(lines)
    if tuple(table.fieldnames or ()) != COLUMNS:
        raise InputError(path.name, f"its columns are not {', '.join(COLUMNS)}", "Write it anew.")
    bends = []
    for row in table:
        if None in row or None in row.values():
            raise InputError(path.name, f"row {row['index']} has too few or too many columns", "")
        numbers = {name: _read_number(path, row[name]) for name in COLUMNS[1:-1]}
        bend = Bend(**numbers, note=row["note"])
        if min(bend.distance_mm, bend.feed_mm, bend.bend_deg, bend.radius_mm) < 0:
            raise InputError(path.name, f"row {row['index']} holds a negative length or bend", "")
        bends.append(bend)
    if not bends:
        raise InputError(path.name, "it has no rows", "Write it anew.")
    return BendList(tuple(bends), placed["start_mm"], placed["direction"], placed["normal"])


def _read_number(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path.name, f"{text!r} is not a number", "Write it anew.")
    return value


@dataclass(frozen=True)
class WireDrawing:
    """One view of one wire in its plane, in mm, to be drawn at full size.

    A label, the number of the bend and its height above the plane, is written beside each bend. The line
    starts at the joint.
    """

    title: str
    line: Array  # (k, 2) the centre line, its two ends at the joint
    bends: Array  # (m, 2) where each bend begins
    labels: tuple[str, ...]
    wire_mm: float

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top, with a margin of the wire's diameter."""
        low, high = self.line.min(axis=0) - self.wire_mm, self.line.max(axis=0) + self.wire_mm
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def draw(self, axes: Axes, shift: Array, window: Rectangle) -> None:
        """Draw the view on a page, shifted by `shift` (2,) mm and clipped to the window."""
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path
        from matplotlib.textpath import TextPath

        line = self.line + shift
        # at its true thickness, in points
        point = 72.0 / 25.4
        parts = axes.plot(*line.T, color="0.85", lw=self.wire_mm * point, solid_joinstyle="round")
        parts += axes.plot(*line.T, color="black", lw=0.3)
        parts += axes.plot(*(self.bends + shift).T, "o", ms=1.2, color="#c00", mew=0)
        parts += axes.plot(*line[0], "s", ms=5, mfc="none", mec="#06c", mew=0.6)
        for part in parts:
            part.set_clip_path(window)
        (x0, y0), wide, high = window.get_xy(), window.get_width(), window.get_height()
        # one path for all labels, as hundreds of texts would be slow
        glyphs = [
            TextPath((x + 0.4, y + 0.3), label, size=1.0)
            for (x, y), label in zip(self.bends + shift, self.labels, strict=True)
            if x0 <= x <= x0 + wide and y0 <= y <= y0 + high
        ]
        if glyphs:
            axes.add_patch(PathPatch(Path.make_compound_path(*glyphs), fc="#a00", lw=0, zorder=5))


def draw_views(
    name: str, line: Array, begins: Array, right: Array, up: Array, diameter: float
) -> tuple[WireDrawing, WireDrawing]:
    """Return the front view (as seen from the light, without perspective) and the side view (from the right).

    Args:
        line: (k, 3) the wire, bent again.
        begins: (m, 3) where its bends begin.
        right, up: (3,) unit axes as seen from the light, which is at the left of the side view.
    """
    towards = np.cross(right, up)
    base = float((line @ towards).min())
    depth = begins @ towards - base
    front = WireDrawing(
        f"{name}, front",
        np.column_stack([line @ right, line @ up]),
        np.column_stack([begins @ right, begins @ up]),
        tuple(f"{k} ({d:.1f})" for k, d in enumerate(depth, start=1)),
        diameter,
    )
    side = WireDrawing(
        f"{name}, side",
        np.column_stack([-(line @ towards), line @ up]),
        np.column_stack([-(begins @ towards), begins @ up]),
        tuple(str(k) for k in range(1, len(begins) + 1)),
        diameter,
    )
    return front, side


def write_templates(
    path: pathlib.Path, paper: Paper, drawings: list[WireDrawing], facts: list[str]
) -> int:
    """Write one PDF to be printed at full size, with `facts` on its first page; return the page count."""
    shown = [Drawing(one.title, one.box, one.draw) for one in drawings]
    pages = draw_tiled(paper, "Bending templates, full size", facts, shown, "bend")
    return write_pages(path, "Bending templates at full size", pages)
