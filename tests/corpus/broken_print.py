"""Parts that a printer cannot make: too thin, too narrow, in the air, over too wide a gap, or toppling."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from .case import Broken, Place, make_part, places_of, with_scene
from .curves import circle
from .files import Part
from .parts import Body, blocks, box, join
from .print_parts import arch, funnel, gallows, island, on_its_side, plain, slab, slot, table

NEAR = 4.0
NO_SUPPORTS = {"supports": False}


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
