"""Compare PrusaSlicer's reading of the file with the mesh: it does none of this itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import ceil

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.meshes import Mesh, box_of
from knotfab.geometry.tube import mesh_volume
from knotfab.slicer.gcode import Gcode, points_along
from knotfab.slicer.profile import INFILL_PERCENT, line_width
from knotfab_formats.report import SlicerCheck
from knotfab_formats.scene import ResolvedScene

__all__ = ["compare_gcode", "compare_info", "judge"]


SPACING_MM = 1.0  # between points that stand for a printed line
SAMPLES = 20_000  # points of the surface, over all bodies
# filament over the solid volume: bridges are laid thick, gaps filled generously
MOST_FILAMENT = 1.15
LAYERS_OFF = 1  # layers by which both counts may differ
BOX_MM = 1 / 64  # by which both boxes may differ
VOLUME_SHARE = 1 / 1024  # by which both volumes may differ


def judge(
    name: str, passed: bool, measured: float, limit: float, unit: str, detail: str
) -> SlicerCheck:
    """Return the outcome of one look."""
    return SlicerCheck(name, "pass" if passed else "fail", measured, limit, unit, detail)


def compare_info(said: str, bodies: Sequence[Mesh]) -> tuple[int, SlicerCheck]:
    """Check that `--info` lists one object, of the bodies' size, place and volume.

    Several would drop onto the bed each by itself. It is the one question in which PrusaSlicer says by
    itself that a mesh has holes.
    """
    objects = re.split(r"^\[.*\]$", said, flags=re.MULTILINE)[1:]
    found = [dict(re.findall(r"^(\w+) = +(\S+)", text, re.MULTILINE)) for text in objects]
    low, high = box_of(bodies)
    volume = _volume_mm3(bodies)
    try:
        corners = [
            np.min([[float(o[f"min_{a}"]) for a in "xyz"] for o in found], axis=0),
            np.max([[float(o[f"max_{a}"]) for a in "xyz"] for o in found], axis=0),
        ]
        read = sum(float(o["volume"]) for o in found)
        closed = all(o["manifold"] == "yes" for o in found)
    except (KeyError, ValueError):  # nothing listed, or not in these words
        text = "PrusaSlicer does not say what it read from the file"
        return len(found), judge("reading", False, float("nan"), BOX_MM, "mm", text)
    off = float(np.abs(np.array(corners) - [low, high]).max())
    share = abs(read - volume) / volume
    passed = len(found) == 1 and off <= BOX_MM and share <= VOLUME_SHARE and closed
    size = " x ".join(f"{s:.2f}" for s in high - low)
    detail = f"PrusaSlicer reads one object, {size} mm, {read / 1000:.3f} cm3, closed"
    if not passed:
        what = "" if closed else ", with open edges"
        detail = (
            f"PrusaSlicer reads {len(found)} object(s), {read / 1000:.3f} cm3{what}, {off:.3g} mm from "
            f"the size and place of the one of {volume / 1000:.3f} cm3 in the file"
        )
    return len(found), judge("reading", passed, off, BOX_MM, "mm", detail)


def compare_gcode(
    gcode: Gcode, bodies: Sequence[Mesh], scene: ResolvedScene, shift: Array
) -> list[SlicerCheck]:
    """Return the printed lines against the bodies, moved by `shift` (3,) to their place on the bed.

    - `bed`: every line, supports too, inside the build volume;
    - `place`: the lines of the part reach as far as the mesh, in each direction;
    - `surface`: no place of any body's surface is far from a printed line: a body that was left
      out, dropped onto the bed or moved, or a piece too thin to be printed;
    - `filament`: as much as the mesh is big, less at most what the infill spares;
    - `layers`: as many as the height asks for.
    """
    width, layer = line_width(scene), scene.printer.layer_height_mm
    low, high = box_of(bodies)
    return [
        _bed(gcode, scene, width),
        _place(gcode, low + shift, high + shift, width, layer),
        _surface(gcode, bodies, shift, 2 * width + layer),
        _filament(gcode, bodies),
        _layers(gcode, bodies, float(low[2]), layer),
    ]


def _bed(gcode: Gcode, scene: ResolvedScene, width: float) -> SlicerCheck:
    room = np.array(scene.printer.build_volume_mm)
    half = np.array([width / 2, width / 2, 0.0])
    over = float(max((half - gcode.low)[:2].max(), (gcode.high + half - room).max()))
    what = "supports included" if gcode.support_share > 0 else "there are no supports"
    detail = (
        f"what is printed, {what}, keeps {-over:.2f} mm from the edge of the build volume"
        if over <= 0
        else f"what is printed, {what}, reaches {over:.2f} mm out of the build volume"
    )
    return judge("bed", over <= 0, over, 0.0, "mm", detail)


def _place(gcode: Gcode, low: Array, high: Array, width: float, layer: float) -> SlicerCheck:
    ends = np.concatenate([gcode.start, gcode.end])
    half = np.array([width / 2, width / 2, 0.0])
    first = ends.min(axis=0) - half - [0.0, 0.0, layer]
    off = np.abs(np.array([first - low, ends.max(axis=0) + half - high]))
    # heights are whole layers, sides whole lines; a corner that points up or down is too thin for a
    # line over half a layer more
    share = float((off / [width, width, 1.5 * layer]).max())
    detail = (
        f"the printed part begins and ends within {share:.2f} lines of the mesh, on each side"
        if share <= 1
        else f"the printed part begins or ends {off.max():.2f} mm from where the mesh does"
    )
    return judge("place", share <= 1, share, 1.0, "lines or layers", detail)


def _surface(gcode: Gcode, bodies: Sequence[Mesh], shift: Array, limit: float) -> SlicerCheck:
    from scipy.spatial import cKDTree

    tree = cKDTree(points_along(gcode.start, gcode.end, SPACING_MM))
    total = sum(len(vertices) for vertices, _ in bodies)
    worst, where, shell = 0.0, np.zeros(3), 1
    for number, body in enumerate(bodies, start=1):
        wanted = max(200, SAMPLES * len(body[0]) // total)  # points of each body
        sample = _sample(body, wanted) + shift
        away, _ = tree.query(sample)
        if away.max() > worst:
            worst, where, shell = float(away.max()), sample[away.argmax()] - shift, number
    place = ", ".join(f"{x:.1f}" for x in where)
    detail = (
        f"no place of the surface is further than {worst:.2f} mm from a printed line"
        if worst <= limit
        else f"shell {shell} is not printed at ({place}): the nearest line is {worst:.2f} mm away"
    )
    return judge("surface", worst <= limit, worst, limit, "mm", detail)


def _sample(body: Mesh, wanted: int) -> Array:
    """Return points (k, 3) of the surface: corners and middles of faces, evenly taken from the lists."""
    vertices, faces = body
    corners = vertices[:: max(1, 2 * len(vertices) // wanted)]
    some = faces[:: max(1, 2 * len(faces) // wanted)]
    points: Array = np.concatenate([corners, vertices[some].mean(axis=1)])
    return points


def _filament(gcode: Gcode, bodies: Sequence[Mesh]) -> SlicerCheck:
    volume = _volume_mm3(bodies) / 1000
    laid = gcode.filament_cm3 * (1 - gcode.support_share)
    share = laid / volume
    passed = INFILL_PERCENT / 100 <= share <= MOST_FILAMENT
    detail = f"{laid:.2f} cm3 of filament for {volume:.2f} cm3 of part, supports left out"
    if not passed:
        detail += f": between {INFILL_PERCENT} % and {MOST_FILAMENT:.0%} is plausible"
    return judge("filament", passed, share, MOST_FILAMENT, "of the mesh's volume", detail)


def _layers(gcode: Gcode, bodies: Sequence[Mesh], bottom: float, layer: float) -> SlicerCheck:
    """A layer is there where its middle height cuts a body."""
    tops = [(v[:, 2].min() - bottom, v[:, 2].max() - bottom) for v, _ in bodies]
    middles = (np.arange(ceil(max(high for _, high in tops) / layer) + 1) + 0.5) * layer
    wanted = sum(any(low <= z < high for low, high in tops) for z in middles)
    off = abs(gcode.layers - wanted)
    detail = f"{gcode.layers} layers of the part, where its height at {layer:g} mm makes {wanted}"
    return judge("layers", off <= LAYERS_OFF, float(off), LAYERS_OFF, "layers", detail)


def _volume_mm3(bodies: Sequence[Mesh]) -> float:
    return abs(sum(mesh_volume(*body) for body in bodies))
