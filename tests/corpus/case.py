"""One case of the corpus: its files, and for a broken one the check that must reject it and where."""

import copy
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from PIL import Image

from .curves import Array
from .files import DEFAULT_VIEW, Mask, Part, shadow
from .parts import Body, tubes

READ = "read"
"""Stands for the readers: a file that they refuse is rejected by them, not by a check."""

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns what is upright as printed (z) into what is upright in a scene (y)."""

Place = tuple[float, float, float]
MARGIN_MM = 4.0  # from the tube to the printer's x and y planes
PIXELS = 256


@dataclass(frozen=True)
class Good:
    """A part that no required check may reject."""

    name: str
    make: Callable[[], Part]


@dataclass(frozen=True)
class Broken:
    """A part with one fault.

    `meant` is the check that must reject it, or `READ`. `places` are where the fault is, mm, part
    coordinates: one of the places that the check names must come within `within_mm` of one of
    them; none where a place makes no sense. `says` is a word that a reader's sentence must have.
    """

    name: str
    make: Callable[[], Part]
    meant: str
    places: Callable[[Part], Iterable[Place]] | None = None
    within_mm: float = 0.0
    says: str = ""


def make_part(
    curves: Sequence[Array] | Array,
    radius: float = 3.0,
    types: Sequence[str] = (),
    sides: int = 24,
    format: str = "stl",
) -> Part:
    """The tubes about some curves, laid on the bed's positive octant, with their knots.json."""
    every = [curves] if isinstance(curves, np.ndarray) else list(curves)
    body = tubes(every, radius, sides)
    shift = np.array([MARGIN_MM, MARGIN_MM, 0.0]) - body.vertices.min(axis=0)
    return Part(
        body=body.move(shift),
        knots=tuple(curve + shift for curve in every),
        types=tuple(types) or ("unknot",) * len(every),
        radius=radius,
        format=format,
    )


def make_tied_part(
    curves: Callable[[], Sequence[Array] | Array],
    radius: float,
    types: Sequence[str] = (),
    sides: int = 24,
) -> Part:
    """`knotted`, of curves that are made only now."""
    return make_part(curves(), radius, types, sides)


def with_scene(part: Part, lying: bool = False, **tables: Mapping[str, Any]) -> Part:
    """The part with a scene about its middle, seen from above, and the shadow it casts as picture.

    `tables` are merged into those of the scene; `view` is merged into its only view. A stand is printed
    as it stands (the print's z is the scene's y), unless `lying`.
    """
    assert part.body is not None
    low, high = part.body.vertices.min(axis=0), part.body.vertices.max(axis=0)
    pose = np.eye(4)
    if tables.get("mount", {}).get("kind") == "stand" and not lying:
        pose[:3, :3] = UPRIGHT
    pose[:3, 3] = -pose[:3, :3] @ (low + high) / 2
    scene: dict[str, Any] = {
        "schema": 1,
        "piece": {"clearance_mm": 0.4},
        "views": [{**DEFAULT_VIEW, **tables.pop("view", {})}],
        "accuracy": {"name": "standard", "iou_floor": 0.92, "max_outline_error_px": 0.5},
        "pose": {"matrix": pose.tolist()},
    }
    if part.radius is not None:
        scene["piece"]["tube_radius_mm"] = part.radius
    for name, table in tables.items():
        scene[name] = {**scene.get(name, {}), **table}
    return with_picture(replace(part, scene=scene), part.body)


def with_picture(part: Part, body: Body) -> Part:
    """The part with the shadow of `body` as its scene's picture."""
    assert part.scene is not None
    (view,) = part.scene["views"]
    wide, high = view["frame_width_mm"], view["frame_height_mm"]
    pixels = (PIXELS, max(1, round(PIXELS * high / wide)))
    picture: Mask = shadow(body, view, pixels, np.array(part.scene["pose"]["matrix"]))
    return replace(part, pictures={view["picture"]: picture})


LAMPS = {
    "red": ([1.0, 0.0, 0.0], -60.0, 0.0),
    "green": ([0.0, 1.0, 0.0], 0.0, 50.0),
    "blue": ([0.0, 0.0, 1.0], 60.0, 0.0),
}
"""Name of a lamp: its colour, and how far beside and above the axis it stands, mm."""


def with_lamps(
    part: Part, lamps: Mapping[str, tuple[list[float], float, float]] = LAMPS, **tables: Any
) -> Part:
    """The part before one screen, which lamps of several colours light, with all pictures of their shadows.

    `tables` are as those of `with_scene`.
    """
    whole = with_scene(part, **tables)
    assert whole.scene is not None and whole.body is not None
    scene = copy.deepcopy(dict(whole.scene))
    (view,) = scene["views"]
    pose, pictures, raw = np.array(scene["pose"]["matrix"]), {}, dict(whole.raw)
    scene["views"], mixed = [], np.zeros((PIXELS, PIXELS, 3))
    for name, (colour, right, up) in lamps.items():
        own = {**view, "name": name, "picture": f"picture-{name}.png"}
        own |= {"light_right_mm": right, "light_up_mm": up, "lamp_colour": colour}
        own |= {"wall": scene["views"][0]["name"]} if scene["views"] else {}
        scene["views"].append(own)
        mask = shadow(whole.body, own, (PIXELS, PIXELS), pose)
        pictures[own["picture"]] = mask
        mixed += np.where(mask[..., None], 0.0, colour)
    scene["lamps"] = {"mode": "mix", "screen": "ends", "picture": "picture-colours.png"}
    scene["lamps"] |= tables.get("lamps", {})
    buffer = io.BytesIO()
    Image.fromarray(np.rint(255 * mixed).clip(0, 255).astype(np.uint8)).save(buffer, format="PNG")
    raw["picture-colours.png"] = buffer.getvalue()
    return replace(whole, scene=scene, pictures=pictures, raw=raw)


def change_scene(part: Part, table: str, **values: Any) -> Part:
    """The part with some keys of one table of its scene changed; the picture stays."""
    assert part.scene is not None
    scene = copy.deepcopy(dict(part.scene))
    if table == "view":
        scene["views"][0].update(values)
    else:
        scene[table] = {**scene.get(table, {}), **values}
    return replace(part, scene=scene)


def between(part: Part) -> tuple[Place, ...]:
    """The middle between the first vertex of one knot and the vertex across of the other."""
    one, other = part.knots
    return places_of((one[0] + other[len(other) // 2]) / 2)


def places_of(points: Array) -> tuple[Place, ...]:
    """Points (n, 3) or (3,) as places."""
    return tuple((float(x), float(y), float(z)) for x, y, z in np.atleast_2d(points))
