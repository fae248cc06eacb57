"""Closed lines in a plane as SVG and DXF, in mm: for cutters, plotters and drawing programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from knotfab.base.arrays import Array

__all__ = ["Layers", "write_dxf", "write_svg"]

Layers = Mapping[str, Sequence[Array]]
"""By the name of each layer its closed lines (n, 2), mm right and up from the frame's middle."""

_STROKE_MM = 0.1
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def write_svg(
    path: Path, layers: Layers, frame_mm: tuple[float, float], title: str, filled: bool = False
) -> None:
    """Write closed paths, a group for each layer; the page is the frame, one user unit is 1 mm.

    Args:
        filled: whether what the lines enclose is black (by even and odd), or the lines are drawn.
    """
    width, height = frame_mm
    style = 'fill="#000" fill-rule="evenodd"'
    if not filled:
        style = f'fill="none" stroke="#000" stroke-width="{_STROKE_MM}"'
    text = [
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="{_INKSCAPE}" width="{width:.4f}mm" '
        f'height="{height:.4f}mm" viewBox="0 0 {width:.4f} {height:.4f}">',
        f"<title>{escape(title)}</title>",
    ]
    for name, lines in layers.items():
        label = escape(name)
        text.append(f'<g id="{label}" inkscape:groupmode="layer" inkscape:label="{label}" {style}>')
        steps = [
            " ".join(f"{x + width / 2:.4f},{height / 2 - y:.4f}" for x, y in line) for line in lines
        ]
        text += [f'<path d="{" ".join(f"M {step} Z" for step in steps)}"/>', "</g>"]
    path.write_text("\n".join([*text, "</svg>", ""]), encoding="utf-8", newline="")


def write_dxf(path: Path, layers: Layers, frame_mm: tuple[float, float]) -> None:
    """Write closed polylines of DXF R12, which every program reads; the origin is the frame's lower left.

    The header's units are millimetres.
    """
    corner = 0.5 * frame_mm[0], 0.5 * frame_mm[1]
    tags: list[tuple[int, object]] = [(0, "SECTION"), (2, "HEADER")]
    tags += [
        (9, "$ACADVER"),
        (1, "AC1009"),
        (9, "$INSUNITS"),
        (70, 4),
        (9, "$MEASUREMENT"),
        (70, 1),
    ]
    tags += [(0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER")]
    tags.append((70, len(layers)))
    for number, name in enumerate(layers):
        tags += [(0, "LAYER"), (2, name), (70, 0), (62, 1 + number % 7), (6, "CONTINUOUS")]
    tags += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for name, lines in layers.items():
        for line in lines:
            tags += [(0, "POLYLINE"), (8, name), (66, 1), (10, 0.0), (20, 0.0), (30, 0.0), (70, 1)]
            for x, y in line:
                tags += [(0, "VERTEX"), (8, name), (10, f"{x + corner[0]:.4f}")]
                tags += [(20, f"{y + corner[1]:.4f}"), (30, 0.0)]
            tags += [(0, "SEQEND"), (8, name)]
    tags += [(0, "ENDSEC"), (0, "EOF")]
    path.write_text("".join(f"{code}\n{value}\n" for code, value in tags), encoding="ascii")
