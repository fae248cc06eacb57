"""The verdict in one line, and a picture of the places that failed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab_formats.laxer import tell_laxer
from knotfab_formats.verdict import Check, knot_in_words
from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh

if TYPE_CHECKING:
    from knotfab_validators.files.scene import Scene

# a part with a longest side below or above these is asked for its unit
SMALL_MM, LARGE_MM = 2.0, 2000.0
LEAST_IOU = 0.5  # that a shadow needs to be coarse (docs/verdict.md)
NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def size_of(mesh: Mesh) -> tuple[float, float, float]:
    """Return the extents of the mesh along x, y and z, mm."""
    x, y, z = (float(side) for side in np.ptp(mesh.vertices, axis=0))
    return x, y, z


def ask_unit(mesh: Mesh, name: str) -> str | None:
    """Ask for the unit of a part that is implausibly small or large in mm; None for any other."""
    longest = max(size_of(mesh))
    if not np.isfinite(longest) or SMALL_MM <= longest <= LARGE_MM:
        return None
    asked = (
        "in metres (--unit m), cm or inches (in)"
        if longest < SMALL_MM
        else "in another unit than mm"
    )
    return f"{name}: is {longest:.3g} mm long: is the file {asked}?"


def conclude(
    checks: Sequence[Check], mesh: Mesh | None, curves: Curves | None, scene: Scene | None = None
) -> str:
    """Summarise verdict and size: "One closed tube, 4 mm radius, an unknot; every required check passed. …"

    Args:
        mesh, curves, scene: what was measured, and what asks for it; None where there is none.
    """
    named = {check.name: check for check in checks}
    said = [_tell_what(named, mesh, curves)]
    kind = named.get("knot_type")
    if kind is not None and kind.status != "skipped" and isinstance(kind.measured, str):
        found = knot_in_words(re.sub(r", (proved|consistent)", "", kind.measured))
        several = curves is not None and len(curves.polygons) > 1
        named_so = "," not in found and not found.startswith(("no ", "not "))
        article = "" if not named_so else "an " if found[0] in "aeiou" else "a "
        said.append(f"{'each ' if several and article else ''}{article}{found}")
    linking = named.get("linking")
    if linking is not None and linking.status == "fail" and linking.measured != "touching":
        said.append("linked with each other")
    unmet = [c for c in checks if c.required and c.status != "pass"]
    failed = [c.name for c in unmet if c.status == "fail"]
    missing = [c.name for c in unmet if c.status == "skipped"]
    told = []
    if failed:
        told.append(f"{_count(len(failed), 'required check')} failed: {', '.join(failed)}")
    if missing:
        told.append(f"{_count(len(missing), 'required check')} could not run: {', '.join(missing)}")
    if not told:
        told = ["every required check passed"]
    if scene is not None and (laxer := tell_laxer(scene, curves)):
        told[-1] += f", but {laxer}"
    told += tell_lowered(checks)
    size = (
        "" if mesh is None else " " + " × ".join(f"{side:.3g}" for side in size_of(mesh)) + " mm."
    )
    if mesh is not None and ask_unit(mesh, "") is not None:
        size += " Is the file in another unit?"
    return f"{', '.join(said)}; {'; '.join(told)}.{size}"


def tell_lowered(checks: Sequence[Check]) -> list[str]:
    """Say in what the scene asks less of the shadow than a person would, a clause each."""
    said = []
    for check in checks:
        if check.name == "shadow" and isinstance(check.limit, float) and check.limit < LEAST_IOU:
            said.append(f"the scene asks of the shadow no more than an IoU of {check.limit:g}")
        if check.name == "recognisable" and check.status != "skipped" and not check.required:
            known = ", and this one is not recognisable" if check.status == "fail" else ""
            said.append(f"the scene accepts any shadow{known}")
    return said


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _tell_what(named: dict[str, Check], mesh: Mesh | None, curves: Curves | None) -> str:
    lines = named.get("centre_line")
    if curves is not None:
        what = "curve" if mesh is None else "tube"
        closed = (
            "closed"
            if all(curves.closed)
            else "open"
            if not any(curves.closed)
            else "closed and open"
        )
        number, radius = len(curves.polygons), curves.radius_mm
        size = "" if radius is None else f", {radius:.3g} mm radius"
        return f"{_in_letters(number)} {closed} {what}{'' if number == 1 else 's'}{size}"
    found = re.search(r"mesh: (.+?), radi(?:us|i) (.+?) mm,", lines.detail) if lines else None
    if lines is not None and lines.status == "pass" and found is not None:
        what, size = found.groups()
        size = size if " to " in size else f"{float(size):.3g}"
        return f"{what[0].upper()}{what[1:]}, {size} mm radius"
    bodies = named.get("mesh_bodies")
    count = None if bodies is None else bodies.measured
    if not isinstance(count, float | int):
        return "No closed tube"
    return f"{_in_letters(int(count))} {'body' if count == 1 else 'bodies'}, no closed tube"


def _in_letters(number: int) -> str:
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


# A picture of failures: the part from three sides, places marked, sentences beside it.

PANEL_PX = 420
GAP_PX = 14
LINE_PX = 19
TEXT_PX = 13
MOST_POINTS = 600_000  # points drawn of a surface
MOST_MARKS = 3  # marks drawn for one check
PAPER = (250, 248, 244)
INK = (44, 46, 52)
QUIET = (130, 132, 138)
SURFACE = (196, 200, 206)
MARK = (208, 60, 40)
TOWARDS_EYE = np.array([0.35, 0.45, 0.82])

# title, and the axes that point right, up and towards the eye on the page
SIDES: tuple[tuple[str, Array], ...] = (
    ("from above (x right, y up)", np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])),
    ("from the front (x right, z up)", np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
    ("from the right (y right, z up)", np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])),
)


@dataclass(frozen=True)
class _Cloud:
    """Points (n, 3) to draw, with the unit normals (n, 3) that shade them."""

    points: Array
    normals: Array


def draw_failures(
    path: Path, checks: Sequence[Check], mesh: Mesh | None, curves: Curves | None
) -> bool:
    """Draw the part with the places of the failed checks, each with its number and sentence.

    Points of the surface (or of the centre lines, where there is no mesh) are drawn by a simple depth
    buffer, seen along the axes of the file: this needs no graphics library, and no mesh is too broken
    for it.

    Args:
        path: the PNG to write. checks: all of them; those that failed are drawn, required ones first.

    Returns:
        Whether anything was written: not if no required check failed, or there is nothing to draw.
    """
    from PIL import Image, ImageDraw, ImageFilter, ImageFont

    from knotfab_validators.files.picture import write_image

    failed = sorted((c for c in checks if c.status == "fail"), key=lambda c: not c.required)
    cloud = _cloud(mesh, curves)
    if cloud is None or not any(c.required for c in failed):
        return False
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    middle, extent = (low + high) / 2, max(float((high - low).max()), 1e-9)
    scale = (PANEL_PX - 48) / extent
    width = len(SIDES) * (PANEL_PX + GAP_PX) + GAP_PX
    font: Any = ImageFont.load_default(size=TEXT_PX)
    lines = _sentences(failed, font, width - 2 * GAP_PX - 34)
    height = PANEL_PX + 2 * GAP_PX + LINE_PX * (sum(len(part) for _, part in lines) + 2)
    sheet = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(sheet)
    for i, (name, axes) in enumerate(SIDES):
        left = GAP_PX + i * (PANEL_PX + GAP_PX)
        panel = Image.fromarray(_panel(cloud, axes, middle, scale))
        # points leave gaps in a surface: close them
        sheet.paste(panel.filter(ImageFilter.MedianFilter(3)), (left, GAP_PX))
        draw.text((left + 6, GAP_PX + PANEL_PX - LINE_PX), name, fill=QUIET, font=font)
        for number, check in enumerate(failed, start=1):
            for point in check.at[:MOST_MARKS]:
                u, v = _on_page(np.array([point]), axes, middle, scale)[0]
                inside = np.clip([u, v], 10, PANEL_PX - 10)  # far away: at the panel's edge
                _draw_ring(draw, left + inside[0], GAP_PX + inside[1], str(number), font)
    y = PANEL_PX + 2 * GAP_PX
    for number, (check, part) in enumerate(zip(failed, [p for _, p in lines], strict=True), 1):
        _mark(draw, GAP_PX + 10, y + 8, str(number) if check.at else "-", font)
        for line in part:
            draw.text((GAP_PX + 34, y), line, fill=INK, font=font)
            y += LINE_PX
    size = " x ".join(f"{s:.4g}" for s in high - low)
    draw.text((GAP_PX, y + 4), f"size {size} mm", fill=QUIET, font=font)
    write_image(path, sheet)
    return True


def _cloud(mesh: Mesh | None, curves: Curves | None) -> _Cloud | None:
    """Choose the points to draw: spread over the faces by their area, or along the centre lines."""
    if mesh is not None and len(mesh.faces):
        corners = mesh.vertices[mesh.faces]
        corners = corners[np.isfinite(corners).all(axis=(1, 2))]
        if len(corners):
            return _of_faces(corners)
    if curves is None:
        return None
    lines = []
    for polygon, closed in zip(curves.polygons, curves.closed, strict=True):
        path = np.concatenate([polygon, polygon[:1]]) if closed else polygon
        steps = np.linspace(0, len(path) - 1, 4000)
        k = np.minimum(steps.astype(int), len(path) - 2)
        lines.append(path[k] + (steps - k)[:, None] * (path[k + 1] - path[k]))
    points = np.concatenate(lines)
    return _Cloud(points, np.broadcast_to(TOWARDS_EYE, points.shape))


def _of_faces(corners: Array) -> _Cloud:
    """Sample points on triangles (m, 3, 3) at random by area, with a fixed seed."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(twice > 0, twice, 1.0)[:, None]
    share = twice / max(float(twice.sum()), 1e-300)
    count = np.maximum(1, np.round(share * MOST_POINTS / 2)).astype(np.int64)
    which = np.repeat(np.arange(len(corners)), count)
    rng = np.random.default_rng(0)
    if len(which) > MOST_POINTS:
        which = rng.choice(which, MOST_POINTS, replace=False)
    a, b = rng.random((2, len(which)))
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    p, q, r = (corners[which, i] for i in range(3))
    return _Cloud(p + a[:, None] * (q - p) + b[:, None] * (r - p), unit[which])


def _on_page(points: Array, axes: Array, middle: Array, scale: float) -> Array:
    """Project points (n, 3) to pixels (n, 2) of a panel."""
    seen = (points - middle) @ axes.T * scale
    return np.column_stack([PANEL_PX / 2 + seen[:, 0], PANEL_PX / 2 - seen[:, 1]])


def _panel(cloud: _Cloud, axes: Array, middle: Array, scale: float) -> NDArray[np.uint8]:
    """Draw the cloud in one panel (PANEL_PX, PANEL_PX, 3): the nearest point in each pixel, shaded."""
    page = np.floor(_on_page(cloud.points, axes, middle, scale)).astype(np.int64)
    inside = ((page >= 0) & (page < PANEL_PX)).all(axis=1)
    depth = cloud.points @ axes[2]
    shade = np.abs(cloud.normals @ axes.T @ TOWARDS_EYE)
    order = np.flatnonzero(inside)[np.argsort(depth[inside], kind="stable")]  # nearest last
    panel = np.full((PANEL_PX, PANEL_PX, 3), PAPER, dtype=np.uint8)
    colour = np.array(SURFACE) * (0.45 + 0.55 * shade[order])[:, None]
    panel[page[order, 1], page[order, 0]] = colour.astype(np.uint8)
    return panel


def _draw_ring(draw: Any, x: float, y: float, label: str, font: Any) -> None:
    """Draw a ring around a place with its number beside it, so that neither hides the place."""
    aside = 16 if x < PANEL_PX * len(SIDES) else -16
    draw.line((x + np.sign(aside) * 5, y - 5, x + aside, y - 16), fill=MARK, width=2)
    draw.ellipse((x - 7, y - 7, x + 7, y + 7), outline=MARK, width=2)
    _mark(draw, x + aside, y - 16, label, font)


def _mark(draw: Any, x: float, y: float, label: str, font: Any) -> None:
    """Draw a disc with a number."""
    draw.ellipse((x - 8, y - 8, x + 8, y + 8), fill=MARK)
    box = draw.textbbox((0, 0), label, font=font)
    at = (x - (box[0] + box[2]) / 2, y - (box[1] + box[3]) / 2)
    draw.text(at, label, fill=PAPER, font=font)


def _sentences(failed: Sequence[Check], font: Any, width: float) -> list[tuple[Check, list[str]]]:
    """Wrap each check's sentence to the width of the sheet."""
    result = []
    for check in failed:
        measured, limit = _value(check.measured), _value(check.limit)
        head = f"{check.name}: {measured} {check.unit}".rstrip()
        head += f" (limit {limit})" if limit else ""
        head += "" if check.required else ", for information"
        lines, line = [], ""
        # the font lacks these characters
        text = f"{head}. {check.detail}".replace("²", "^2").replace("³", "^3")
        for word in text.split():
            longer = f"{line} {word}".strip()
            if line and font.getlength(longer) > width:
                lines.append(line)
                longer = word
            line = longer
        result.append((check, [*lines, line]))
    return result


def _value(value: float | str | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{value:.5g}"
