"""Words and strokes of a mount's drawing: how to set a piece up, and what being off costs."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import arc_lengths
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement
from knotfab.hold.wall import mark_depth_mm
from knotfab.render.pages import length
from knotfab_formats.print_figures import RootsFigures
from knotfab_formats.verdict import Misplacement
from knotfab_formats.views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LAMP_MM = 10.0  # the misplacement for which the loss is told
HEAR_MM = 0.05  # smaller offsets count as none

# How the report's keys read, and what goes with them.
LAMP_WAYS = {"right": "to the side", "up": "up or down", "towards": "nearer or farther"}
TURN_WAYS = {"up": "left or right", "right": "forward or back", "axis": "like a wheel"}


def _tell_offset(right: float, up: float, from_: str) -> str:
    """Say where a point is, as "12 mm above and 3 mm to the left of" what it is measured from."""
    ways = (up, "above", "below"), (right, "to the right of", "to the left of")
    said = [
        f"{length(abs(v))} mm {more if v > 0 else less}"
        for v, more, less in ways
        if abs(v) >= HEAR_MM
    ]
    return f"{' and '.join(said)} {from_}" if said else from_


def _roots_steps(roots: RootsFigures, hole_mm: float, holes: Array) -> list[str]:
    """Say how the strips in which a piece stands are fixed to the wall."""
    tape = f"double-sided tape along the backs of its strips ({roots.area_cm2:.0f} cm²)"
    if not len(holes):
        return [f"Press the piece to the wall, the way up that is drawn, with {tape}."]
    right, up = (-holes.mean(axis=0)).tolist()
    if roots.tape == "pads":
        tape = "double-sided tape behind its two pads"
    return [
        f"Drive two nails or screws with heads narrower than {length(hole_mm)} mm into the wall, "
        f"{length(float(np.ptp(holes[:, 0])))} mm apart on a level line; the middle of the frame is "
        f"{_tell_offset(right, up, 'half-way between them')}.",
        f"Hang the piece on them by the holes in its pads, and press it to the wall with {tape}.",
    ]


def steps_of(mounted: Mounted, place: Placement, view: View) -> list[str]:
    """List the steps by which a person sets a view up, one or two sentences each."""
    lamp = "lamp" if view.kind == "shadow" else "eye"
    off = f"{length(place.off_wall_mm)} mm off"
    opposite = _tell_offset(place.right_mm, place.up_mm, "the middle of the frame")
    if place.base is not None:
        steps = _desk_steps(place, view, lamp)
    elif (roots := mounted.roots_figures) is not None:
        steps = _roots_steps(roots, mounted.scene.mount.hole_diameter_mm, place.holes)
        steps.append(
            f"Put the middle of the {lamp} {off} the wall, square to it, opposite {opposite}."
        )
    elif place.outline is not None and mounted.wall is not None:
        s, across = mounted.wall.settings, float(np.ptp(place.holes[:, 0]))
        right, up = (-place.holes.mean(axis=0)).tolist()
        steps = [
            f"Drill two holes {length(across)} mm apart on a level line; the middle of the frame is "
            f"{_tell_offset(right, up, 'half-way between them')}.",
            "Screw the plate on, the way up that is drawn (screws of at most "
            f"{length(s.hole_diameter_mm)} mm). Keep the corners of the frame in pencil until the "
            "lamp stands.",
            f"Put the middle of the {lamp} {off} the plate's face, square to it, opposite {opposite}.",
        ]
    elif mounted.wall is not None and mounted.wall.settings.foot == "plate":
        across = float(place.holes[1, 0] - place.holes[0, 0])
        s = mounted.wall.settings
        marked = "The notches in its edges mark their middles. " if mark_depth_mm(s) else ""
        steps = [
            f"Drill two holes {length(across)} mm apart on a level line; the middle of the frame "
            "is half-way between them.",
            f"Screw the plate on with its arrow up (screws of at most {length(s.hole_diameter_mm)} mm). "
            f"{marked}Strings between opposite ones cross in the middle of the frame."
            if marked
            else f"Screw the plate on, the way up that is drawn (screws of at most "
            f"{length(s.hole_diameter_mm)} mm).",
            f"Put the middle of the {lamp} {off} the plate's face, square to it, opposite {opposite}.",
        ]
    elif mounted.wall is not None:
        s = mounted.wall.settings
        steps = [
            f"Print the drill template at 100 %, join its pages and tape it to the wall, arrow up. "
            f"Drill the {len(place.holes)} numbered holes square to the wall, "
            f"{length(s.dowel_depth_mm + 1)} mm deep.",
            "Push the pegs in until they meet the wall. Keep the corners of the frame in pencil "
            "until the lamp stands.",
            f"Put the middle of the {lamp} {off} the wall, square to it, opposite {opposite}.",
        ]
    else:
        thread, verb = "", "Hold"
        if mounted.hang is not None:
            verb = "Hang"
            thread = f"{_tell_threads((mounted.hang.threads - place.middle) @ place.wall.T)} "
        steps = [
            "Mark the corners of the frame on the wall.",
            f"{thread}{verb} the piece before the frame as the views show: {_tell_reach(mounted, place)}.",
            f"Put the middle of the {lamp} {off} the wall, square to it, opposite {opposite}.",
        ]
    distances = [mark.lamp_mm for mark in place.marks]
    if max(distances) - min(distances) < HEAR_MM:
        each = f"{length(distances[0])} mm from every {' '.join(place.marks[0].name.split()[-4:])}"
    else:
        each = "; ".join(
            f"{length(mark.lamp_mm)} mm from the {_name_marks(place, mark.lamp_mm)}"
            for i, mark in enumerate(place.marks)
            if not any(abs(mark.lamp_mm - d) < HEAR_MM for d in distances[:i])
        )
    what = "the middle of each edge" if "edge" in place.marks[0].name else "the corners"
    return [*steps, f"Check with a tape from {what}: the {lamp} is {each}."]


def _tell_threads(places: Array) -> str:
    """Say where threads carry a piece; places (1 or 2, 3) are right of, above, and before the middle."""
    told = [
        f"{_tell_side(up, 'above')} and {_tell_side(across, 'right of')} the frame's middle, "
        f"{length(out)} mm off the wall"
        for across, up, out in places.tolist()
    ]
    if len(told) == 1:
        return f"Tie it to a thread by its eyelet: the thread carries it {told[0]}."
    apart = length(float(np.linalg.norm((places[1] - places[0])[[0, 2]])))
    return (
        f"Tie a thread to each of its two eyelets, so that it cannot turn: one carries it {told[0]}, the "
        f"other {told[1]}. Both go straight up, {apart} mm apart."
    )


def _name_marks(place: Placement, lamp_mm: float) -> str:
    """Name the marks at this distance from the lamp."""
    alike = [m.name for m in place.marks if abs(m.lamp_mm - lamp_mm) < HEAR_MM]
    thing = max((f" {w} " for w in ("edge", "corner")), key=lambda w: w in alike[0])
    last = alike[-1] if len(alike) == 1 else alike[-1].replace(thing, f"{thing.rstrip()}s ")
    firsts = [name.split(thing)[0] for name in alike[:-1]]
    return " and ".join([*firsts, last])


def _tell_reach(mounted: Mounted, place: Placement) -> str:
    """Say between which places a piece that hangs free must be."""
    points = np.concatenate([vertices for vertices, _ in mounted.bodies]) - place.middle
    (x0, y0, z0), (x1, y1, z1) = (f(points @ place.wall.T, axis=0) for f in (np.min, np.max))
    up = f"from {_tell_side(y0, 'below')} to {_tell_side(y1, 'above')}"
    across = f"from {_tell_side(x0, 'left of')} to {_tell_side(x1, 'right of')}"
    return f"{up}, and {across}, the frame's middle, {length(z0)} to {length(z1)} mm off the wall"


def _tell_side(value: float, way: str) -> str:
    other = {"below": "above", "above": "below", "left of": "right of", "right of": "left of"}
    usual = value < 0 if way in ("below", "left of") else value > 0
    return f"{length(abs(value))} mm {way if usual else other[way]}"


def _desk_steps(place: Placement, view: View, lamp: str) -> list[str]:
    base = place.base
    assert base is not None
    gap = level_wall(place, base.bottom)
    across = float(place.level[0] @ place.lamp) - (base.left + base.right) / 2
    aside = ""
    if abs(across) >= 1.0:  # a smaller offset to the side of a stand counts as none
        aside = f", {length(abs(across))} mm to the {'right' if across > 0 else 'left'}"
    high = float(place.level[1] @ place.lamp) - base.bottom
    before = float(place.level[2] @ place.lamp) - base.front
    off = length(base.back - gap)
    if "corner" in base.wall_side:
        way = "anticlockwise" if base.turned_deg > 0 else "clockwise"
        wall = (
            f"Stand the wall of {view.name} {off} mm behind the {base.wall_side} of the base, turned by "
            f"{abs(base.turned_deg):.1f}° {way} from the first, as the drawing from above shows."
        )
        opposite, middle = (
            f"the base's {base.lamp_side}, square to that wall",
            "before the base's middle",
        )
    else:
        wall = f"Stand the wall of {view.name} {off} mm from the {base.wall_side} of the base, along it."
        opposite, middle = f"the base's {base.lamp_side}", "before that edge's middle"
    if base.turned_deg == 0:
        wall = f"Stand the piece with the back of its base {off} mm before the wall, along it."
    return [
        wall,
        f"Put the middle of the {lamp} {length(high)} mm above the desk and {length(before)} mm in "
        f"front of {opposite}, straight {middle}{aside}.",
    ]


def level_wall(place: Placement, height: float) -> float:
    """Return how far the wall reaches towards the lamp at this height of the scene, mm."""
    out, up = place.wall[2] @ place.level.T, height - float(place.level[1] @ place.middle)
    return float(place.level[2] @ place.middle) - up * float(out[1]) / float(out[2])


def lamp_facts(view: View) -> list[str]:
    """Say which lamp is needed, and what effect its size has."""
    if view.kind != "shadow":
        return ["Look with one eye, from the point that is drawn."]
    facts = ["One lamp alone, all others off, bare: no shade, no reflector."]
    if view.light_size_mm > 0:
        blur = view.light_size_mm * view.wall_distance_mm / view.light_distance_mm
        facts.append(
            f"Its light comes from {_lamp_shape(view)}; outlines blur by {length(blur)} mm. "
            "A larger one blurs more, in proportion."
        )
    else:
        facts.append("As small as can be had: the scene takes it for a point.")
    return facts


def _lamp_shape(view: View) -> str:
    sides = f"{length(view.light_width_mm)} x {length(view.light_height_mm)} mm"
    if view.light_shape == "leds":
        columns, rows = view.light_leds
        return f"{columns} x {rows} LEDs of {length(view.light_diameter_mm)} mm over {sides}"
    if view.light_has_sides:
        return f"a {view.light_shape} of {sides}"
    return f"a spot of {length(view.light_diameter_mm)} mm"


def tell_turn(way: str, turn_deg: float, threads_apart_mm: float | None = None) -> str:
    """Say how a piece is turned about an axis of the view, or how its two threads then differ."""
    if threads_apart_mm is None or way == "right":
        return f"the piece turned by {turn_deg:g}° {TURN_WAYS[way]}"
    off = length(threads_apart_mm * sin(radians(turn_deg)))
    return f"one thread {off} mm {'nearer the wall' if way == 'up' else 'longer'} than the other"


def costs_of(
    misplacement: Misplacement | None,
    view: View,
    *,
    on_wall: bool,
    threads_apart_mm: float | None = None,
) -> list[str]:
    """Say what is lost when lamp or piece are out of place, one line each.

    A piece fixed to its wall turns with it, as if the lamp moved about both.

    Args:
        misplacement: None if it was not measured. on_wall: whether the piece is fixed to the wall.
        threads_apart_mm: distance of the two threads that it hangs on, which keep it from turning by itself.
    """
    if misplacement is None:
        return ["Not measured: too little to see, or nothing rendered."]
    lamp, turn = misplacement.lamp_iou_per_mm, misplacement.turn_iou_per_deg or {}
    shift = LAMP_MM * view.wall_distance_mm / view.light_distance_mm
    lines = []
    for key, way in LAMP_WAYS.items():
        moves = f" (the shadow moves {length(shift)} mm)" if key != "towards" else ""
        lines.append(f"Lamp {length(LAMP_MM)} mm {way}: {_tell_loss(LAMP_MM * lamp[key])}{moves}")
    if on_wall:
        reach = (view.light_distance_mm + view.wall_distance_mm) * sin(radians(1.0))
        return [
            *lines,
            f"Wall and piece turned by 1° left or right: {_tell_loss(reach * lamp['right'])}",
            f"Wall and piece leaning by 1° forward or back: {_tell_loss(reach * lamp['up'])}",
        ]
    for key in TURN_WAYS:
        told = tell_turn(key, 1.0, threads_apart_mm).removeprefix("the ")
        lines.append(f"{told[0].upper()}{told[1:]}: {_tell_loss(turn[key])}")
    return lines


def _tell_loss(loss: float) -> str:
    return (
        f"about {min(max(loss, 0.01), 1.0):.0%} less alike"
        if loss >= 0.005
        else "less than 1% less alike"
    )


# Strokes of a mount's drawings: the piece, lamps, walls and notes, in mm of the page.

INK, PIECE, LIGHT, FAINT = "black", "#8a8478", "#e0a400", "0.6"
WORDS = "words"  # the name, in an SVG, of parts beside the drawing that are told with it


def fill(axes: Axes, polygons: Sequence[Array], color: str, above: float | None = None) -> None:
    """Fill polygons and their holes as one path; nothing below the height `above` is drawn."""
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    rings = [Outline(np.append(p, p[:1], axis=0), closed=True) for p in polygons]
    if rings:
        patch = PathPatch(Outline.make_compound_path(*rings), fc=color, lw=0)
        axes.add_patch(patch)
        if above is not None:
            patch.set_clip_path(Rectangle((0.0, above), 210.0, 297.0, transform=axes.transData))


def cross(axes: Axes, at: Array, reach: float, width: float) -> None:
    """Draw a cross at a point (2,), `reach` mm to each side, in strokes `width` points wide."""
    for arm in (np.array([reach, 0.0]), np.array([0.0, reach])):
        axes.plot(*np.stack([at - arm, at + arm]).T, color=INK, lw=width)


def draw_lamp(axes: Axes, at: Array, across: float) -> None:
    """Draw a lamp `across` mm of the page wide, with its axes."""
    from matplotlib.patches import Circle

    axes.add_patch(
        Circle((float(at[0]), float(at[1])), max(0.5 * across, 0.5), fc=LIGHT, lw=0.3, ec=INK)
    )
    cross(axes, at, 2.5, 0.25)


def hatch(axes: Axes, wall: Array) -> None:
    """Hatch the back of a wall, whose line is (n, 2), with short strokes."""
    steps = np.diff(wall, axis=0)
    ends = arc_lengths(wall, closed=False)
    for s in np.arange(1.5, ends[-1], 2.5):
        k = int(np.searchsorted(ends, s)) - 1
        unit = steps[k] / (ends[k + 1] - ends[k])
        at = wall[k] + (s - ends[k]) * unit
        behind = np.array([-unit[1], unit[0]]) - unit
        axes.plot(*np.stack([at, at + behind]).T, color=FAINT, lw=0.3)


def note(axes: Axes, at: Array, text: str, **style: Any) -> None:
    """Write a text at a point (2,) of the page, mm."""
    axes.text(float(at[0]), float(at[1]), text, **style)


def lamp_name(view: View) -> str:
    """Name the lamp with its size, or the eye."""
    if view.kind != "shadow":
        return "eye"
    return f"lamp, {length(view.light_size_mm)} mm" if view.light_size_mm > 0 else "lamp"
