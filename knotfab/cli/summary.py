"""Print the result of a command: a build's summary, checks, catalogues, and the shadow in Braille."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Mask
from knotfab.report.summary import mark_of
from knotfab_formats.scene import ResolvedView
from knotfab_formats.verdict import POOR, knot_in_words

if TYPE_CHECKING:
    from knotfab.knots import Knots
    from knotfab.request import Outcome
    from knotfab_formats.piece import Material, Printer
    from knotfab_formats.report import Report
    from knotfab_formats.verdict import Check

_MARKS = {
    "info": "[dim]info[/]",
    "pass": "[green]pass[/]",
    "fail": "[red]FAIL[/]",
    "warn": "[yellow]warn[/]",
    "skipped": "[yellow]skip[/]",
}
_MOST_ROWS = 7
_WORDS = {"faithful": "green", "good": "green", "coarse": "yellow", "not recognisable": "red"}

UNABLE = (
    "A required check did not run: its line says why. What this machine lacks knotfab doctor says; "
    "--skip shadow-render goes on without rendering."
)


def _format_value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.5g}"
    return "" if value is None else str(value)


def print_checks(checks: Sequence[Check]) -> None:
    """Print a table of the checks that ran, details of those that failed, and why others did not run."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=True, header_style="dim")
    for column in ("", "check", "measured", "limit", "unit"):
        table.add_column(column)
    for check in checks:
        if check.status == "skipped" and not check.required:
            continue
        told_only = check.status == "pass" and (check.limit is None or not check.required)
        table.add_row(
            _MARKS["info" if told_only else mark_of(check)],
            escape(check.name),
            escape(knot_in_words(_format_value(check.measured), "{1} ({0})")),
            escape(_format_value(check.limit)),
            escape(check.unit),
        )
    console = Console()
    console.print(table)
    reasons: dict[str, list[str]] = {}
    for check in checks:
        if check.status == "skipped" and not check.required:
            reasons.setdefault(check.detail, []).append(check.name)
        # the detail of `centre_line` tells what was found in a part from elsewhere
        elif check.detail and (check.status != "pass" or check.name == "centre_line"):
            line = f"  {escape(check.name)}: {escape(check.detail)}"
            console.print(line, highlight=False, soft_wrap=True)
    for why, names in reasons.items():
        line = f"  not run ({escape(why)}): {escape(', '.join(names))}"
        console.print(line, highlight=False, soft_wrap=True, style="dim")


def print_summary(outcome: Outcome, verbose: bool = False) -> None:
    """Print how a build ended, and what to know or do about it: eight lines; all rows if `verbose`."""
    from rich.console import Console
    from rich.markup import escape

    from knotfab.report.report import tell_stages

    report, console = outcome.found, Console(highlight=False, soft_wrap=True)
    status = "[green]pass[/]" if outcome.exit_code == 0 else "[red]fail[/]"
    folder, seconds = escape(str(outcome.folder)), report.timings["total"]
    console.print(
        f"{status}{_format_verdict(report)}  in {seconds:.0f} s: open {folder}/report.html"
    )
    most = _MOST_ROWS - (outcome.exit_code == 3)  # whose line stands below
    for row in (report.rows or ())[: None if verbose else most]:
        colour = {"fail": "red", "warn": "yellow"}.get(row.status)
        mark = f"[{colour}]{row.status}:[/] " if colour else ""
        console.print(f"  {mark}{escape(row.text)}")
    if verbose:
        console.print(f"  {tell_stages(report.timings)}")
    if outcome.exit_code == 3:
        console.print(UNABLE)


def _format_verdict(report: Report) -> str:
    """Return the verdict's word in colour, with a warning if the shadow is coarse or worse."""
    if report.verdict is None:
        return ""
    word = report.verdict.word
    warning = "warning: " if word in POOR else ""
    return f"  [{_WORDS[word]}]{warning}{word}[/]"


def print_catalogue(
    printers: Mapping[str, Printer], materials: Mapping[str, Material], own: Path
) -> None:
    """Print tables of the known printers and materials, and say where to put your own."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from knotfab.scene.catalogue import title_of

    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("name", "printer", "room, mm", "nozzle", "tube"):
        table.add_column(column, no_wrap=True)
    for name, p in printers.items():
        room = " × ".join(f"{side:g}" for side in p.build_volume_mm)
        figures = (f"{p.nozzle_mm:g}", f"{2 * p.min_tube_radius_mm:g}")
        table.add_row(escape(name), escape(title_of("printer", name)), room, *figures)
    console.print(table)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("name", "material", "g/cm³", "stiff, GPa", "bend"):
        table.add_column(column, no_wrap=True)
    for name, m in materials.items():
        bend = m.min_bend_radius_mm
        radius = "auto" if bend is None else f"{bend:g}"
        more = (f"{m.density_g_cm3:g}", f"{m.young_modulus_mpa / 1000:g}", radius)
        table.add_row(escape(name), escape(title_of("material", name)), *more)
    console.print()
    console.print(table)
    console.print(
        "\nroom: what it can print; tube: the thinnest that it prints; bend: the tightest radius.\n"
        f"Your own: {escape(str(own))}/printers/NAME.toml and materials/NAME.toml"
    )


# the shadow in Braille

_ACROSS, _DOWN = 2, 4  # dots of a character
# the bit of each dot, added to U+2800
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_GAP = 2  # columns between views


def draw_shadow(views: Sequence[ResolvedView], knots: Knots, columns: int, rows: int) -> str:
    """Draw the shadow of knots in the scene, in as many views side by side as there is room for.

    Args:
        columns, rows: the room, in characters.

    Returns:
        At most `rows` lines of Braille.
    """
    # imported here because they load scipy, and refused calls draw nothing
    from knotfab.render.image import frame_at
    from knotfab.render.silhouette import Sheet, cast

    points = knots.points
    drawn: list[list[str]] = []
    left = columns
    for view in views:
        high = _DOWN * rows
        wide = round(high * view.frame_width_mm / view.frame_height_mm)
        if wide > _ACROSS * columns:
            wide, high = _ACROSS * columns, round(high * _ACROSS * columns / wide)
        if -(-wide // _ACROSS) > left:
            break
        dot_mm = max(view.frame_width_mm / max(1, wide), view.frame_height_mm / max(1, high))
        frame = frame_at(view, Sheet(max(1, wide), max(1, high), dot_mm, view.wall_tilt_deg))
        # strands are at least as thick as a dot, so that they have no gaps
        thick = max(knots.radius_mm, 0.5 * dot_mm / view.magnification)
        drawn.append(_to_braille(cast(points, points[knots.rings.next], frame, thick)))
        left -= len(drawn[-1][0]) + _GAP
    height = max((len(lines) for lines in drawn), default=0)
    filled = [lines + [" " * len(lines[0])] * (height - len(lines)) for lines in drawn]
    return "\n".join((" " * _GAP).join(parts).rstrip() for parts in zip(*filled, strict=True))


def _to_braille(dark: Mask) -> list[str]:
    height, width = dark.shape
    whole: NDArray[np.bool_] = np.zeros(
        (-(-height // _DOWN) * _DOWN, -(-width // _ACROSS) * _ACROSS), dtype=bool
    )
    whole[:height, :width] = dark
    cells = whole.reshape(len(whole) // _DOWN, _DOWN, -1, _ACROSS)
    codes = np.einsum("rdca,da->rc", cells.astype(np.int64), _BITS)
    return ["".join(chr(0x2800 + int(code)) for code in row) for row in codes]
