"""The broken parts of the corpus: each is a good one with one named fault, and one check must reject it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from .broken_knots import broken_knots
from .broken_mesh import broken_files, broken_mesh, refused_files
from .broken_print import broken_print
from .case import (
    LAMPS,
    Broken,
    Place,
    change_scene,
    make_part,
    places_of,
    with_lamps,
    with_picture,
    with_scene,
)
from .curves import Array, bulge, circle, torus_knot
from .files import Part
from .parts import Body, ball, join, tube


def broken_parts() -> list[Broken]:
    """All but the files made by hand, which take seconds to make."""
    return [*broken_mesh(), *broken_knots(), *broken_shadow(), *broken_print(), *broken_files()]


def broken() -> list[Broken]:
    """All broken cases; their names differ."""
    cases = [*broken_parts(), *refused_files()]
    assert len({case.name for case in cases}) == len(cases)
    return cases


RADIUS, SIDES = 3.0, 24
WIDTH_MM = 120.0  # the frame's width
# strands of 6 mm, 60 mm before the wall, leave no place half dark
WIDE = {"light_diameter_mm": 250.0}
PIXEL_MM = WIDTH_MM / 1024 * 500 / 560  # a pixel of the compared shadow, at the middle of the part


def broken_shadow() -> Iterator[Broken]:
    """Faults that only the projection shows."""
    yield from _of_outline()
    yield from _of_mounts()
    yield from _of_pictures()
    yield from _of_scene()
    yield from _of_lamps()


def _make_lopsided() -> Part:
    """A ring with a nose: no mirror or turn takes it to itself."""
    curve = bulge(circle(28.0), 10, np.array([12.0, 16.0, 3.0]), 8.0)
    return with_scene(make_part(curve))


def _of_outline() -> Iterator[Broken]:
    for name, by in (("right", (1, 0, 0)), ("down", (0, -1, 0)), ("aslant", (0.7, 0.7, 0))):
        yield Broken(
            f"a shadow shifted by 1 px, {name}",
            partial(_shift, PIXEL_MM * np.array(by)),
            "outline",
            lambda p: places_of(p.knots[0]),
            2 * RADIUS,
        )
    yield from [
        Broken("a bump in the outline", lambda: _bump(0.1), "outline", _at_bump, 2 * RADIUS),
        Broken("a dent in the outline", lambda: _bump(-0.1), "outline", _at_bump, 2 * RADIUS),
        Broken("a tube of eight sides", lambda: replace(_make_lopsided(), body=_swept(_make_lopsided(), 8)),
         "outline", lambda p: places_of(p.knots[0]), 2 * RADIUS),
        Broken("a ball in the light", lambda: _with_ball((60.0, 60.0, 30.0)), "outline",
         lambda _: places_of(np.array([60.0, 60.0, 30.0])), 10.0),
    ]  # fmt: skip


def _of_mounts() -> Iterator[Broken]:
    yield Broken(
        "a mount that shows beside the tube",
        lambda: change_scene(_with_ball((60.0, 60.0, 30.0)), "mount", kind="wall"),
        "intrusion",
    )


def _of_pictures() -> Iterator[Broken]:
    other = with_scene(make_part(torus_knot(2, 3)))
    pictures: dict[str, Callable[[Part], Part]] = {
        "of something else": lambda p: replace(p, pictures=other.pictures),
        "mirrored": lambda p: _drawn(p, lambda m: m[:, ::-1]),
        "upside down": lambda p: _drawn(p, lambda m: m[::-1]),
        "on its side": lambda p: _drawn(p, lambda m: m.T),
        "moved by a radius": lambda p: _drawn(p, lambda m: np.roll(m, 6, axis=1)),
        "without a piece": lambda p: _drawn(p, _cut),
        "with a blot": lambda p: _drawn(p, _blot),
        "smoothed by a radius": lambda p: _drawn(p, lambda m: gaussian_filter(m * 1.0, 6) > 0.5),
        "inverted": lambda p: _drawn(p, lambda m: ~m),
        "empty": lambda p: _drawn(p, lambda m: np.zeros_like(m)),
    }
    yield Broken(
        "a picture that nobody knows again",
        partial(_apply, pictures["of something else"]),
        "recognisable",
    )
    for name, change in pictures.items():
        yield Broken(f"a picture {name}", partial(_apply, change), "shadow")


def _of_scene() -> Iterator[Broken]:
    views: dict[str, dict[str, Any]] = {
        "a light 30 degrees to the side": {"azimuth_deg": 30.0},
        "a light at half the distance": {"light_distance_mm": 150.0},
        "a wall twice as far": {"wall_distance_mm": 120.0},
        "a wall that leans": {"wall_tilt_deg": 40.0},
        "a frame 10 % wider": {"frame_width_mm": 132.0},
    }
    for name, view in views.items():
        yield Broken(name, partial(_view_otherwise, view), "shadow")
    yield Broken("a lamp wider than it hides", partial(_view_otherwise, WIDE), "half_light")
    yield Broken("a part mirrored", _mirror, "shadow")
    yield Broken("a pose turned by 10 degrees", lambda: _turn_pose(10.0), "shadow")
    yield Broken("a pose upside down", lambda: _turn_pose(180.0), "shadow")
    yield Broken("a pose 10 mm to the side", lambda: _turn_pose(0.0, 10.0), "shadow")
    yield Broken("one of two tubes missing", _one_of_two, "shadow")
    yield Broken("one of two tubes missing, to whoever looks", _one_of_two, "recognisable")


def _of_lamps() -> Iterator[Broken]:
    colours = {"red": LAMPS["blue"][0], "blue": LAMPS["red"][0]}
    swapped = {name: {"lamp_colour": colour} for name, colour in colours.items()}
    yield Broken("two lamps with each other's colour", partial(_lit, swapped), "lamp_colours")
    yield Broken(
        "a lamp out of its place", partial(_lit, {"blue": {"light_up_mm": 80.0}}), "colours"
    )
    far = {"green": {"light_right_mm": 900.0}}
    yield Broken("no shadow of one lamp on the screen", partial(_lit, far), "colours")


def _lit(otherwise: Mapping[str, Mapping[str, Any]]) -> Part:
    """Two rings under three lamps, some of which are other lamps than the pictures are of."""
    part = with_lamps(make_part([circle(34.0), circle(20.0)]))
    assert part.scene is not None
    views = [{**view, **otherwise.get(view["name"], {})} for view in part.scene["views"]]
    return replace(part, scene={**part.scene, "views": views})


def _apply(change: Callable[[Part], Part]) -> Part:
    return change(_make_lopsided())


def _view_otherwise(view: Mapping[str, Any]) -> Part:
    """Another view than the one that the picture is of."""
    return change_scene(_make_lopsided(), "view", **view)


def _shift(by: Array) -> Part:
    """The part moved against its knots and its scene."""
    part = _make_lopsided()
    assert part.body is not None
    return replace(part, body=part.body.move(by))


def _swept(part: Part, sides: int) -> Body:
    return tube(part.knots[0], RADIUS, sides)


def _bump(by: float) -> Part:
    """The surface moved outwards by `by` mm about the outermost vertex of ring 60."""
    part = _make_lopsided()
    assert part.body is not None
    body, centre = part.body, np.repeat(part.knots[0], SIDES, axis=0)
    out = (body.vertices - centre) / np.linalg.norm(body.vertices - centre, axis=1)[:, None]
    away = np.linalg.norm(body.vertices - _outermost(part), axis=1)
    push = by * np.exp(-((away / 1.5) ** 2))
    return replace(part, body=Body(body.vertices + push[:, None] * out, body.faces))


def _outermost(part: Part) -> Array:
    """The vertex of ring 60 that is farthest from the middle, seen from above."""
    assert part.body is not None
    ring = part.body.vertices.reshape(-1, SIDES, 3)[60]
    middle = part.knots[0].mean(axis=0)
    found: Array = ring[np.linalg.norm((ring - middle)[:, :2], axis=1).argmax()]
    return found


def _at_bump(_: Part) -> tuple[Place, ...]:
    return places_of(_outermost(_make_lopsided()))


def _with_ball(at: tuple[float, float, float]) -> Part:
    """A ball of 3 mm beside the tube, where the picture has none."""
    part = _make_lopsided()
    assert part.body is not None
    return replace(part, body=join(part.body, ball(3.0, 16).move(at)))


def _drawn(part: Part, change: Callable[[Any], Any]) -> Part:
    return replace(
        part, pictures={n: np.ascontiguousarray(change(m)) for n, m in part.pictures.items()}
    )


def _cut(mask: Any) -> Any:
    """Clear a quarter of the picture."""
    left = mask.copy()
    left[: len(mask) // 2, mask.shape[1] // 2 :] = False
    return left


def _blot(mask: Any) -> Any:
    """Fill a square of 30 pixels in the middle."""
    blot = mask.copy()
    h, w = mask.shape
    blot[h // 2 - 15 : h // 2 + 15, w // 2 - 15 : w // 2 + 15] = True
    return blot


def _mirror() -> Part:
    """Part and knots seen in a mirror: x turned round about the middle."""
    part = _make_lopsided()
    assert part.body is not None
    low, high = part.body.vertices.min(axis=0)[0], part.body.vertices.max(axis=0)[0]
    turn, shift = np.array([-1.0, 1.0, 1.0]), np.array([low + high, 0.0, 0.0])
    body = Body(part.body.vertices * turn + shift, part.body.faces[:, ::-1])
    return replace(part, body=body, knots=tuple(k * turn + shift for k in part.knots))


def _turn_pose(degrees: float, aside: float = 0.0) -> Part:
    """The pose turned about the light's axis, and moved."""
    part = _make_lopsided()
    assert part.scene is not None
    pose = np.array(part.scene["pose"]["matrix"])
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s, 0, aside], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return change_scene(part, "pose", matrix=(turn @ pose).tolist())


def _one_of_two() -> Part:
    """The picture shows two rings, the part and knots.json have the larger one."""
    both = with_scene(make_part([circle(30.0), circle(18.0)]))
    alone = with_scene(make_part(circle(30.0)))
    assert both.body is not None
    return with_picture(alone, both.body)
