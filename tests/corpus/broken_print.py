"""Parts that a printer cannot make: too thin or narrow, in the air, over too wide a gap, or toppling."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .case import Broken, Place, make_part, places_of, with_scene
from .curves import circle
from .files import Part
from .parts import Body, blocks, box, drum, join

NEAR = 4.0
NO_SUPPORTS = {"supports": False}


def plain(
    body: Body,
    format: str = "stl",
    printer: Mapping[str, Any] | None = None,
    lying: bool = False,
    **tables: Mapping[str, Any],
) -> Part:
    """A part without knots in a scene that asks nothing of its shadow."""
    asked = {"printer": printer or {}, "accuracy": {"iou_floor": "auto"}, **tables}
    part = with_scene(Part(body), lying, **asked)
    return replace(part, format=format)


def slab(thick: float) -> Body:
    """A foot of 10 x 30 x 3 mm with an upright wall of `thick` mm along its middle."""
    cells = np.zeros((3, 1, 2), dtype=bool)
    cells[:, :, 0] = True
    cells[1] = True
    x = (2.0, 7.0 - thick / 2, 7.0 + thick / 2, 12.0)
    return blocks(cells, x, (2.0, 32.0), (0.0, 3.0, 18.0))


def slot(wide: float) -> Body:
    """A block of about 20 x 30 x 15 mm with a slot of `wide` mm from above."""
    cells = np.ones((3, 1, 2), dtype=bool)
    cells[1, :, 1] = False
    x = (2.0, 12.0, 12.0 + wide, 22.0 + wide)
    return blocks(cells, x, (2.0, 32.0), (0.0, 3.0, 15.0))


def arch(span: float) -> Body:
    """Two pillars `span` mm apart with a beam over them."""
    cells = np.ones((3, 1, 2), dtype=bool)
    cells[1, :, 0] = False
    return blocks(cells, (2.0, 10.0, 10.0 + span, 18.0 + span), (2.0, 12.0), (0.0, 15.0, 20.0))


def table() -> Body:
    """A plate of 30 x 30 mm on four legs."""
    cells = np.zeros((3, 3, 2), dtype=bool)
    cells[:, :, 1] = True
    cells[::2, ::2, 0] = True
    sides = (2.0, 8.0, 26.0, 32.0)
    return blocks(cells, sides, sides, (0.0, 15.0, 20.0))


def island() -> Body:
    """A gallows with a block that hangs down from its arm: the block begins in the air."""
    cells = np.zeros((3, 1, 4), dtype=bool)
    cells[0] = True
    cells[:, :, 2] = True
    cells[2, :, 1:3] = True
    cells[:, :, 3] = True
    return blocks(cells, (2.0, 12.0, 20.0, 28.0), (2.0, 12.0), (0.0, 8.0, 16.0, 22.0, 26.0))


def gallows(reach: float) -> Body:
    """A post on a foot of 8 x 10 mm with an arm that reaches out by `reach` mm."""
    cells = np.zeros((2, 1, 2), dtype=bool)
    cells[0] = True
    cells[1, :, 1] = True
    return blocks(cells, (2.0, 10.0, 10.0 + reach), (2.0, 12.0), (0.0, 20.0, 28.0))


def on_its_side(body: Body) -> Body:
    """The body as it is printed when what was upright (its z) lies along y."""
    turned = body.vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    low = turned.min(axis=0)
    return Body(turned - low + (2.0, 2.0, 0.0), body.faces)


def funnel(degrees: float) -> Body:
    """A round body that widens upwards, by so much from the vertical."""
    body = drum(10.0, 12.0, 48)
    wide = 1 + 12.0 * np.tan(np.radians(degrees)) / 10.0
    scale = np.where(body.vertices[:, 2] > 6, wide, 1.0)[:, None]
    vertices = body.vertices * np.concatenate([scale, scale, np.ones_like(scale)], axis=1)
    return Body(vertices, body.faces).move((40, 40, 0))


WALL, CORNER, FUNNEL = (7.0, 17.0, 10.0), (24.0, 7.0, 8.0), (25.0, 25.0, 6.0)
# name, body, check that must reject it, place of the fault, within mm, keys of the printer
FAULTS: list[tuple[str, Callable[[], Body], str, Place, float, Mapping[str, Any]]] = [
    ("a wall 0.9 nozzles thick", lambda: slab(0.36), "feature", WALL, 18.0, {}),
    ("a wall 0.99 nozzles thick", lambda: slab(0.396), "feature", WALL, 18.0, {}),
    ("a wall 0.9 of a wide nozzle", lambda: slab(0.72), "feature", WALL, 18.0, {"nozzle_mm": 0.8}),
    ("a plate 0.3 mm thick", lambda: box((2, 2, 0), (42, 42, 0.3)), "feature", (22.0, 22.0, 0.15), 30.0, {}),
    ("a roof 0.36 mm thick", lambda: _roof(), "feature", (17.0, 12.0, 10.0), 18.0, {}),
    ("a box in metres", lambda: box((2, 2, 0), (27, 22, 12)).scale(1e-3), "feature",
     (0.014, 0.012, 0.006), NEAR, {}),
    ("a slot 0.9 nozzles wide", lambda: slot(0.36), "gap", (12.2, 17.0, 9.0), 18.0, {}),
    ("a slot 0.9 of a wide nozzle", lambda: slot(0.72), "gap", (12.4, 17.0, 9.0), 18.0, {"nozzle_mm": 0.8}),
    ("two boxes 0.9 nozzles apart",
     lambda: join(box((2, 2, 0), (12, 22, 10)), box((12.36, 2, 0), (22, 22, 10))),
     "gap", (12.2, 12.0, 5.0), 12.0, {}),
    ("a floating piece", lambda: join(box((2, 2, 0), (22, 22, 5)), box((5, 5, 12), (15, 15, 20))),
     "floating", (10.0, 10.0, 12.0), 8.0, NO_SUPPORTS),
    ("a floating piece beside", lambda: join(box((2, 2, 0), (22, 22, 25)), box((30, 5, 3), (40, 15, 20))),
     "floating", (35.0, 10.0, 3.0), 8.0, NO_SUPPORTS),
    ("the whole part in the air", lambda: box((2, 2, 4), (22, 22, 10)), "floating",
     (12.0, 12.0, 4.0), 15.0, NO_SUPPORTS),
    ("an island", island, "islands", CORNER, 8.0, NO_SUPPORTS),
    ("a bridge of 40 mm", lambda: arch(40.0), "bridge", (30.0, 7.0, 15.0), 8.0, NO_SUPPORTS),
    ("a bridge 12 % too long", lambda: arch(11.2), "bridge", (15.6, 7.0, 15.0), 8.0, NO_SUPPORTS),
    ("a bridge longer than asked", lambda: arch(9.0), "bridge", (14.5, 7.0, 15.0), 8.0,
     {**NO_SUPPORTS, "max_bridge_mm": 5.0}),
    ("a ledge of 15 mm", lambda: gallows(15.0), "bridge", (25.0, 7.0, 20.0), 8.0, NO_SUPPORTS),
    ("a funnel of 55 degrees", lambda: funnel(55.0), "overhang", FUNNEL, 30.0, NO_SUPPORTS),
    ("a funnel steeper than asked", lambda: funnel(40.0), "overhang", FUNNEL, 30.0,
     {**NO_SUPPORTS, "max_overhang_deg": 35.0}),
    ("a ledge without supports", lambda: gallows(15.0), "overhang", (18.0, 7.0, 20.0), 10.0, NO_SUPPORTS),
    ("more support than allowed", table, "support_volume", (17.0, 17.0, 15.0), 18.0,
     {"max_support_cm3": 5.0}),
]  # fmt: skip


def broken_print() -> Iterator[Broken]:
    """Faults that the printer's figures show."""
    for name, body, meant, place, within, printer in FAULTS:
        yield Broken(name, partial(_plain, body, printer), meant, partial(_always, place), within)
    yield from _of_tubes()
    yield from _toppling()


def _plain(body: Callable[[], Body], printer: Mapping[str, Any]) -> Part:
    return plain(body(), printer=printer)


def _always(place: Place, _: Part) -> list[Place]:
    return [place]


def _of_tubes() -> Iterator[Broken]:
    yield from [
        Broken("a tube thinner than the nozzle",
               lambda: with_scene(make_part(circle(8.0), 0.18), accuracy={"iou_floor": "auto"}),
               "feature", lambda p: places_of(p.knots[0]), 1.0),
        Broken("two rings 0.9 nozzles apart", _rings, "gap",
               lambda p: places_of(p.knots[0][0] * [1, 1, 0] + [3.2, 0, 3.0]), 6.0),
        Broken("a ring on more support than allowed",
               lambda: with_scene(_lift_ring(), printer={"max_support_cm3": 1.0}), "support_volume"),
    ]  # fmt: skip


def _rings() -> Part:
    rings = make_part([circle(), circle() + [66.36, 0.0, 0.0]], sides=64)
    wide = {"frame_width_mm": 180.0, "frame_height_mm": 100.0}
    return with_scene(rings, piece={"clearance_mm": 0.2}, view=wide)


def _toppling() -> Iterator[Broken]:
    stand = {"kind": "stand"}
    for name, reach in (("topples", 25.0), ("topples by a hair", 15.2)):
        yield Broken(
            f"a stand that {name}",
            partial(plain, gallows(reach), mount=stand),
            "standing",
            lambda _: [(10.0, 7.0, 16.0)],  # over the edge of its foot
            6.0,
        )
    yield from [
        Broken("a stand that topples, printed on its side", partial(plain, on_its_side(gallows(25.0)),
         lying=True, mount=stand), "standing", lambda _: [(10.0, 18.0, 5.0)], 6.0),
        Broken("a stand that hangs in the air", partial(plain, box((2, 2, 3), (22, 22, 10)), mount=stand),
         "standing"),
    ]  # fmt: skip


def _roof() -> Body:
    """Two walls with a thin plate over them."""
    cells = np.ones((3, 1, 2), dtype=bool)
    cells[1, :, 0] = False
    return blocks(cells, (2.0, 7.0, 27.0, 32.0), (2.0, 22.0), (0.0, 10.0, 10.36))


def _lift_ring() -> Part:
    part = make_part(circle())
    assert part.body is not None
    up = np.array([0.0, 0.0, 12.0])
    return Part(part.body.move(up), tuple(k + up for k in part.knots), part.types, part.radius)
