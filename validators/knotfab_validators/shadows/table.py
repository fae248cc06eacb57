"""Check the printed frame for several lamps: its places of screen and lamps, and the matter of its bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import at_most, places, spot
from knotfab_validators.files.mesh import Plate
from knotfab_validators.geometry.mesh import Mesh, connect, winding_numbers
from knotfab_validators.mesh.surface_checks import check_mesh
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from knotfab_validators.tube.region import check_build_volume
from knotfab_validators.tube.solid_matter import Solid, find_hollow, hull_of, prism, round_outline

if TYPE_CHECKING:
    from knotfab_formats.piece import FrameBar
    from knotfab_validators.files.scene import Scene

OFF_MM = 0.5  # tolerance of the places of a lamp's hole, of the screen's slot and of joints
MOST_DARK = 0.001
PX = 256  # px of the picture's frame, each way, when its shaded share is measured
WIDEST_MM = 20.0  # the widest hole for a rod
STEP_MM = 0.05  # step at which matter is looked for along a line
BELOW_MM = 0.6  # depth below the frame's top at which its holes are looked for


def check_table(plates: Sequence[Plate], scene: Scene) -> list[Check]:
    """Check the frame's files: `table_mesh`, `table_bars`, `table` and `table_shadow`, all required.

    - `table_mesh`: how many of the surface's checks any plate fails, and how many do not fit the bed.
    - `table_bars`: whether matter fills every bar as the scene has it (`check_table_bars`).
    - `table`: with every body moved as the scene says, how far the hole that is right below each lamp lies
      beside it, and how far the front of the screen's slot lies from the wall: at most `OFF_MM`.
    - `table_shadow`: how much of the picture lies in its shadow, under any lamp: at most `MOST_DARK`.
    """
    room = scene.printer.stated("build_volume_mm")
    failed, said = 0, ""
    for plate in plates:
        found = [c for c in check_mesh(plate.mesh) if c.required]
        if room is not None:
            found.append(check_build_volume(plate.mesh, room))
        found = [c for c in found if c.status == "fail"]
        failed += len(found)
        said = said or (f"; {plate.name}: {found[0].name}, {found[0].detail}" if found else "")
    detail = f"of the surfaces and sizes of {len(plates)} plates{said}"
    surface = at_most("table_mesh", failed, 0, "checks", detail)
    wrong = [plate.name for plate in plates if plate.bodies != len(plate.to_part)]
    if wrong:
        why = f"{wrong[0]} holds other bodies than the scene has places for"
        return [surface, Check("table", "fail", True, "unknown", OFF_MM, "mm", why)]
    frame = _assemble(plates)
    filled = check_table_bars(plates, scene)
    return [surface, filled, _check_places(frame, scene), _check_shadow(frame, scene)]


def _assemble(plates: Sequence[Plate]) -> Mesh:
    """Join all bodies, where the scene puts them."""
    vertices = np.concatenate([p.in_part(p.mesh.vertices, p.body) for p in plates])
    shift = np.cumsum([0] + [len(p.mesh.vertices) for p in plates[:-1]])
    faces = np.concatenate([p.mesh.faces + s for p, s in zip(plates, shift, strict=True)])
    return Mesh(vertices, faces)


def _check_shadow(frame: Mesh, scene: Scene) -> Check:
    """Check `table_shadow` under each lamp."""
    caster = ShadowCaster(frame.vertices, frame.faces)
    dark = {v.name: float(caster.render(view_geometry(v, PX, PX)).mean()) for v in scene.views}
    worst = max(dark, key=lambda name: dark[name])
    detail = f"share of the picture in the frame's own shadow, under the lamp {worst}"
    return at_most("table_shadow", dark[worst], MOST_DARK, "", detail)


def _check_places(frame: Mesh, scene: Scene) -> Check:
    """Check `table` on the bodies where the scene puts them."""
    views = [view_geometry(view, 2, 2) for view in scene.views]
    up = views[0].up
    top = _find_top(frame, up)
    off = {
        view.name: _off_hole(frame, geometry, top - BELOW_MM)
        for view, geometry in zip(scene.views, views, strict=True)
    }
    off["the screen"] = _off_slot(frame, views[0], top)
    worst = max(off, key=lambda name: off[name])
    detail = (
        f"how far the frame's hole below a lamp, or its slot, is out of its place, most: {worst}"
    )
    return at_most("table", off[worst], OFF_MM, "mm", detail)


def _find_top(frame: Mesh, up: Array) -> float:
    """Find the height of the frame's top: where most of the surface looks up."""
    a, b, c = np.moveaxis(frame.vertices[frame.faces], 1, 0)
    twice = np.cross(b - a, c - a) @ up
    level = (twice > 0) & (np.abs((b - a) @ up) + np.abs((c - a) @ up) < 1e-3)
    heights, at = np.unique(np.round(a[level] @ up, 2), return_inverse=True)
    return float(heights[np.bincount(at, twice[level]).argmax()]) if len(heights) else 0.0


def _off_hole(frame: Mesh, geometry: ViewGeometry, height: float) -> float:
    """Measure how far the hole at the foot of a lamp is from it, mm; 20 if there is none."""
    foot = geometry.light + (height - geometry.light @ geometry.up) * geometry.up
    free = []
    for axis in (geometry.right, -geometry.right, geometry.axis, -geometry.axis):
        away = np.arange(0.0, WIDEST_MM, STEP_MM)
        solid = np.flatnonzero(_is_solid(frame, foot + away[:, None] * axis))
        if len(solid) == 0 or solid[0] == 0:
            return WIDEST_MM
        free.append(float(away[solid[0]]))
    right, left, front, back = free
    return float(np.hypot(right - left, front - back)) / 2


def _off_slot(frame: Mesh, geometry: ViewGeometry, top: float) -> float:
    """Measure how far the front of the slot is from the wall, mm: matter above the frame begins there."""
    up = geometry.up
    middle = geometry.middle + (top + 2.0 - geometry.middle @ up) * up
    away = np.arange(-WIDEST_MM, WIDEST_MM, STEP_MM)
    solid = _is_solid(frame, middle + away[:, None] * geometry.axis)
    begins = away[1:][solid[1:] & ~solid[:-1]]
    return float(np.abs(begins).min()) if len(begins) else WIDEST_MM


def _is_solid(frame: Mesh, points: Array) -> Mask:
    """Return which points (n, 3) lie in the frame."""
    return np.asarray(winding_numbers(points, frame, exact=False) > 0.5)


# The bars: matter fills each, and they join up.

TAIL_MM, NECK_MM, HEAD_MM, PLAY_MM = 9.0, 8.0, 14.0, 0.2  # a dovetail, and the play in its socket
WALL_MM = 3.0  # thickness of the wall around a hole
LEAST_MM = 4.0, 22.0  # thickness and width of a bar: a dovetail and 2 mm behind it
ROD_MM, MARK_MM = 10.0, 3.5  # the widest hole below a lamp, and the widest other one
SLOT = 0.6  # least share of the screen's width that the slot holds, on both its sides


def check_table_bars(plates: Sequence[Plate], scene: Scene) -> Check:
    """Check `table_bars`: the frame is made of the bars that the scene has, and each is full of matter.

    Matter must fill each bar but for its holes and the sockets of dovetails, and its dovetail, ridges and
    the walls around its holes. Each dovetail must be in a socket of another bar, and all bars joined. Only
    lamps, and one mark, may have holes.
    """
    bars = [bar for listed in scene.lamps.table for bar in listed.bars]
    if [len(listed.bars) for listed in scene.lamps.table] != [p.bodies for p in plates]:
        detail = "the scene does not say what bars the frame has: build the part anew to have them measured"
        return Check("table_bars", "fail", True, "lacking", None, "", detail)
    unfit = _find_unfit(bars, scene)
    if unfit is not None:
        return Check("table_bars", "fail", True, "misfit", None, "", f"{unfit}, by the scene")
    number = 0
    for plate, listed in zip(plates, scene.lamps.table, strict=True):
        whole = plate.in_part(plate.mesh.vertices, plate.body)
        for body, bar in enumerate(listed.bars):
            back = np.linalg.inv(np.array(bar.matrix))
            faces = plate.mesh.faces[plate.body[plate.mesh.faces[:, 0]] == body]
            mesh = Mesh(whole @ back[:3, :3].T + back[:3, 3], faces)
            found = _find_fault(mesh, bar)
            if found is not None:
                what, got, at = found
                at = np.array(bar.matrix)[:3] @ np.append(at, 1.0)
                detail = f"bar {number} of the frame: {what} at {spot(at)} of the scene"
                return Check("table_bars", "fail", True, got, None, "mm", detail, places([at]))
            number += 1
    return Check(
        "table_bars", "pass", True, number, None, "", "bars of the frame that matter fills"
    )


def _find_fault(mesh: Mesh, bar: FrameBar) -> tuple[str, float | str, Array] | None:
    """Find what lacks matter or is plugged: its name, how deep a face lies there, mm, and its place (3,).

    The mesh is in the bar's own coordinates.
    """
    thick, half = bar.thickness_mm, bar.width_mm / 2
    ends = [(np.zeros(2), np.array([1.0, 0.0]))] if bar.socket else []
    ends += [(np.array([x, side * half]), np.array([0.0, -side])) for x, side in bar.sockets]
    sockets = [_prism(_tail(*end, PLAY_MM), 0.0, thick) for end in ends]
    drilled = [
        _prism(round_outline((x, y), wide / 2), 0.0, thick + boss) for x, y, wide, boss in bar.holes
    ]
    holes = tuple(hull_of(corners) for corners in drilled)
    openings = (*holes, *(hull_of(corners) for corners in sockets))
    solids = [Solid("its body", _box(0, bar.length_mm, -half, half, 0, thick), openings)]
    if bar.tail:
        end = np.array([bar.length_mm, 0.0])
        tail = _prism(_tail(end, np.array([1.0, 0.0]), 0.0), 0.0, thick)
        solids.append(Solid("its dovetail", tail))
    for x0, x1, y0, y1, high in bar.ridges:
        solids.append(Solid("a ridge", _box(x0, x1, y0, y1, thick, thick + high), holes))
    for x, y, wide, boss in bar.holes:
        if boss > 0:
            around = _prism(round_outline((x, y), wide / 2 + WALL_MM), thick, thick + boss)
            solids.append(Solid("the wall around a hole", around, holes))
    for solid in solids:
        hollow = find_hollow(mesh, solid)
        if hollow is not None:
            what = f"{solid.name} has a gap, slit or hollow"
            return what, "missing" if np.isinf(hollow[0]) else hollow[0], hollow[1]
    for name, corners in [("a hole", c) for c in drilled] + [("a socket", c) for c in sockets]:
        open_ = find_hollow(mesh, Solid(name, corners))
        if open_ is None or not np.isinf(open_[0]):
            return f"there is matter in {name}", "plugged", corners.mean(axis=0)
    return None


def _box(*sides: float) -> Array:
    x0, x1, y0, y1, low, high = sides
    return _prism(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), low, high)


def _prism(outline: Array, low: float, high: float) -> Array:
    return prism(outline, low, high, np.eye(4)[:3])


def _tail(root: Array, along: Array, play: float) -> Array:
    """Return the outline (4, 2) of a dovetail, wider and longer by `play`."""
    across = np.array([-along[1], along[0]])
    neck, head, deep = NECK_MM / 2 + play, HEAD_MM / 2 + play, TAIL_MM + play
    ends = [(0.0, -neck), (deep, -head), (deep, head), (0.0, neck)]
    return np.array([root + a * along + b * across for a, b in ends])


def _find_unfit(bars: Sequence[FrameBar], scene: Scene) -> str | None:
    """Say why the bars of the scene do not make a frame for its lamps and its screen."""
    views = [view_geometry(view, 2, 2) for view in scene.views]
    up = views[0].up
    motions = [np.array(bar.matrix) for bar in bars]

    def place(k: int, x: float, y: float) -> Array:
        return np.asarray(motions[k][:3] @ (x, y, 0.0, 1.0))

    tails, sockets, marks = [], [], 0
    for k, bar in enumerate(bars):
        if bar.thickness_mm < LEAST_MM[0] or bar.width_mm < LEAST_MM[1]:
            return f"bar {k} is {bar.width_mm:g} × {bar.thickness_mm:g} mm thick, which is too thin"
        if np.abs(motions[k][:3, 2] - up).max() > 1e-3:
            return f"bar {k} does not lie level"
        tails += [(k, place(k, bar.length_mm, 0.0))] if bar.tail else []
        sockets += [(k, place(k, 0.0, 0.0))] if bar.socket else []
        sockets += [(k, place(k, x, side * bar.width_mm / 2)) for x, side in bar.sockets]
        for x, y, wide, boss in bar.holes:
            off = np.array([v.light for v in views]) - place(k, x, y)
            off -= np.outer(off @ up, up)
            lit = np.linalg.norm(off, axis=1).min() <= OFF_MM
            marks += not lit
            if wide > (ROD_MM if lit else MARK_MM) or not (lit or boss == 0):
                return f"bar {k} has a hole of {wide:g} mm that is below no lamp"
    if marks > 1:
        return "it has holes that are below no lamp"
    joined = []
    for k, at in tails:
        near = [s for s, (_, to) in enumerate(sockets) if np.linalg.norm(at - to) <= OFF_MM]
        if not near:
            return f"the dovetail of bar {k} is in no socket"
        joined.append((k, sockets.pop(near[0])[0]))
    if sockets:
        return f"a socket of bar {sockets[0][0]} takes no dovetail"
    ends = np.array(joined, dtype=np.int64).reshape(-1, 2)
    if connect(ends[:, 0], ends[:, 1], len(bars))[1] > 1:
        return "its bars are not all joined"
    return _find_slot_short(bars, motions, scene)


def _find_slot_short(
    bars: Sequence[FrameBar], motions: Sequence[Array], scene: Scene
) -> str | None:
    """Say where ridges fail to hold the screen on both sides."""
    view = view_geometry(scene.views[0], 2, 2)
    wide = scene.views[0].frame_width_mm
    if wide is None:
        return "it does not say how wide the screen is, which the slot holds"
    held = {True: 0.0, False: 0.0}
    for bar, motion in zip(bars, motions, strict=True):
        for x0, x1, y0, y1, _ in bar.ridges:
            ends = np.array([(x, y, 0.0, 1.0) for x in (x0, x1) for y in (y0, y1)]) @ motion[:3].T
            off, along = (ends - view.middle) @ view.axis, (ends - view.middle) @ view.right
            length = float(np.ptp(along))
            if abs(off.min()) <= OFF_MM:
                held[True] += length
            elif -2 * TAIL_MM < off.max() < 0:
                held[False] += length
    short = min(held.values()) / wide
    return f"the slot holds {100 * short:.0f} % of the screen only" if short < SLOT else None
