"""Words of a mount's drawing: how to set a piece up, and which lamp it takes."""

from __future__ import annotations

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement
from knotfab.hold.wall import WallMount, mark_depth_mm
from knotfab.render.pages import length
from knotfab_formats.print_figures import RootsFigures
from knotfab_formats.views import View

HEAR_MM = 0.05  # smaller offsets count as none


def steps_of(mounted: Mounted, place: Placement, view: View) -> list[str]:
    """List the steps by which a person sets a view up, one or two sentences each."""
    lamp = "lamp" if view.kind == "shadow" else "eye"
    on_plate = _is_plate(mounted.wall) and mounted.roots_figures is None
    face = "the plate's face" if on_plate else "the wall"
    if place.base is not None:
        steps = _desk_steps(place, view, lamp)
    else:
        if mounted.roots_figures is not None:
            hole = mounted.scene.mount.hole_diameter_mm
            steps = roots_steps(mounted.roots_figures, hole, place.holes)
        elif mounted.wall is not None:
            steps = _wall_steps(mounted.wall, place)
        else:
            steps = _free_steps(mounted, place)
        opposite = _tell_offset(place.right_mm, place.up_mm, "the middle of the frame")
        steps.append(
            f"Put the middle of the {lamp} {length(place.off_wall_mm)} mm off {face}, square to it, "
            f"opposite {opposite}."
        )
    edge = " edge" if " edge" in place.marks[0].name else " corner"
    what = "the middle of each edge" if edge == " edge" else "the corners"
    alike: dict[str, list[str]] = {}
    for mark in place.marks:
        alike.setdefault(length(mark.lamp_mm), []).append(mark.name.split(edge)[0])
    thing = edge + place.marks[0].name.split(edge)[1]
    told = []
    for far, names in alike.items():
        which = "every" if len(names) == len(place.marks) else f"the {' and '.join(names)}"
        many = which != "every" and len(names) > 1
        told.append(f"{far} mm from {which}{thing.replace(edge, f'{edge}s') if many else thing}")
    return [*steps, f"Check with a tape from {what}: the {lamp} is {'; '.join(told)}."]


def _is_plate(wall: WallMount | None) -> bool:
    return wall is not None and (wall.plate is not None or wall.settings.foot == "plate")


def _wall_steps(wall: WallMount, place: Placement) -> list[str]:
    """Say how a plate is screwed on, or pegs are pushed into their holes."""
    s, pencil = wall.settings, "Keep the corners of the frame in pencil until the lamp stands."
    if not _is_plate(wall):
        return [
            "Print the drill template at 100 %, join its pages and tape it to the wall, arrow up. Drill "
            f"the {len(place.holes)} numbered holes square to the wall, {length(s.dowel_depth_mm + 1)} "
            "mm deep.",
            f"Push the pegs in until they meet the wall. {pencil}",
        ]
    up, then = "the way up that is drawn", pencil
    if place.outline is None and mark_depth_mm(s):
        up = "its arrow up"
        then = "Strings between opposite notches in its edges cross in the middle of the frame."
    return [
        f"Drill two holes {_tell_pair(place.holes)}",
        f"Screw the plate on, {up} (screws of at most {length(s.hole_diameter_mm)} mm). {then}",
    ]


def roots_steps(roots: RootsFigures, hole_mm: float, holes: Array) -> list[str]:
    """Say how the strips in which a piece stands are fixed to the wall."""
    tape = f"double-sided tape along the backs of its strips ({roots.area_cm2:.0f} cm²)"
    if not len(holes):
        return [f"Press the piece to the wall, the way up that is drawn, with {tape}."]
    if roots.tape == "pads":
        tape = "double-sided tape behind its two pads"
    return [
        f"Drive two nails or screws with heads narrower than {length(hole_mm)} mm into the wall, "
        f"{_tell_pair(holes)}",
        f"Hang the piece on them by the holes in its pads, and press it to the wall with {tape}.",
    ]


def _tell_pair(holes: Array) -> str:
    """Say how far apart two holes are, and where the frame's middle is from them."""
    right, up = (-holes.mean(axis=0)).tolist()
    return (
        f"{length(float(np.ptp(holes[:, 0])))} mm apart on a level line; the middle of the frame is "
        f"{_tell_offset(right, up, 'half-way between them')}."
    )


def _free_steps(mounted: Mounted, place: Placement) -> list[str]:
    """Say where a piece hangs or is held that nothing joins to the wall: its threads and its bounds."""
    thread, verb = "", "Hold"
    if mounted.hang is not None:
        threads = (mounted.hang.threads - place.middle) @ place.wall.T
        thread, verb = f"{_tell_threads(threads)} ", "Hang"
    points = np.concatenate([vertices for vertices, _ in mounted.bodies]) - place.middle
    (x0, y0, z0), (x1, y1, z1) = (f(points @ place.wall.T, axis=0) for f in (np.min, np.max))
    return [
        "Mark the corners of the frame on the wall.",
        f"{thread}{verb} the piece before the frame as the views show: from {_tell_up(y0)} to "
        f"{_tell_up(y1)}, and from {_tell_right(x0)} to {_tell_right(x1)}, the frame's middle, "
        f"{length(z0)} to {length(z1)} mm off the wall.",
    ]


def _tell_threads(places: Array) -> str:
    """Say where threads carry a piece; places (1 or 2, 3) are right of, above, and before the middle."""
    told = [
        f"{_tell_up(up)} and {_tell_right(across)} the frame's middle, {length(out)} mm off the wall"
        for across, up, out in places.tolist()
    ]
    if len(told) == 1:
        return f"Tie it to a thread by its eyelet: the thread carries it {told[0]}."
    apart = length(float(np.linalg.norm((places[1] - places[0])[[0, 2]])))
    return (
        f"Tie a thread to each of its two eyelets, so that it cannot turn: one carries it {told[0]}, the "
        f"other {told[1]}. Both go straight up, {apart} mm apart."
    )


def _tell_offset(right: float, up: float, from_: str) -> str:
    """Say where a point is, as "12 mm above and 3 mm right of" what it is measured from."""
    ways = (up, _tell_up(up)), (right, _tell_right(right))
    said = [text for value, text in ways if abs(value) >= HEAR_MM]
    return f"{' and '.join(said)} {from_}" if said else from_


def _tell_up(value: float) -> str:
    return f"{length(abs(value))} mm {'above' if value > 0 else 'below'}"


def _tell_right(value: float) -> str:
    return f"{length(abs(value))} mm {'right' if value > 0 else 'left'} of"


def _desk_steps(place: Placement, view: View, lamp: str) -> list[str]:
    """Say where base, wall and lamp of a stand are from each other."""
    base = place.base
    assert base is not None
    across = float(place.level[0] @ place.lamp) - (base.left + base.right) / 2
    aside = ""
    if abs(across) >= 1.0:  # a smaller offset to the side of a stand counts as none
        aside = f", {length(abs(across))} mm to the {'right' if across > 0 else 'left'}"
    high = length(float(place.level[1] @ place.lamp) - base.bottom)
    before = length(float(place.level[2] @ place.lamp) - base.front)
    off = length(base.back - level_wall(place, base.bottom))
    opposite, middle = f"the base's {base.lamp_side}", "before that edge's middle"
    if base.turned_deg == 0:
        wall = f"Stand the piece with the back of its base {off} mm before the wall, along it."
    elif "corner" in base.wall_side:
        way = "anticlockwise" if base.turned_deg > 0 else "clockwise"
        wall = (
            f"Stand the wall of {view.name} {off} mm behind the {base.wall_side} of the base, turned by "
            f"{abs(base.turned_deg):.1f}° {way} from the first, as the drawing from above shows."
        )
        opposite, middle = f"{opposite}, square to that wall", "before the base's middle"
    else:
        wall = f"Stand the wall of {view.name} {off} mm from the {base.wall_side} of the base, along it."
    return [
        wall,
        f"Put the middle of the {lamp} {high} mm above the desk and {before} mm in front of {opposite}, "
        f"straight {middle}{aside}.",
    ]


def level_wall(place: Placement, height: float) -> float:
    """Return how far the wall reaches towards the lamp at this height of the scene, mm."""
    out, up = place.wall[2] @ place.level.T, height - float(place.level[1] @ place.middle)
    return float(place.level[2] @ place.middle) - up * float(out[1]) / float(out[2])


def tell_lamp(place: Placement, view: View, top_mm: float | None) -> str:
    """Say where a lamp of several stands; `top_mm` is the height of the frame below them."""
    x, y, z = (place.level @ place.lamp).tolist()
    aside = f"{length(abs(x))} mm {'right' if x > 0 else 'left'}, " if abs(x) >= HEAR_MM else ""
    high = "" if top_mm is None else f", {length(y - top_mm)} mm above the frame"
    return (
        f"{view.name}: {aside}{length(z)} mm before the piece, {tell_height(y)} its middle{high}."
    )


def tell_height(value: float) -> str:
    """Say how high a point is, as "12 mm above"."""
    return "level with" if abs(value) < HEAR_MM else _tell_up(value)


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


def lamp_name(view: View) -> str:
    """Name the lamp with its size, or the eye."""
    if view.kind != "shadow":
        return "eye"
    return f"lamp, {length(view.light_size_mm)} mm" if view.light_size_mm > 0 else "lamp"
