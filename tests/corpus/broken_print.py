"""Parts that a printer cannot make: too thin, too narrow, in the air, over too wide a gap, or toppling."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from .case import Broken, Place, make_part, with_scene
from .curves import circle
from .files import Part
from .parts import Body, blocks, box, join
from .print_parts import arch, funnel, gallows, island, on_its_side, plain, slab, slot, table

NEAR = 4.0
NO_SUPPORTS = {"supports": False}


def broken_print() -> Iterator[Broken]:
    """Faults that the printer's figures show."""
    yield from _too_thin()
    yield from _too_narrow()
    yield from _in_the_air()
    yield from _too_steep()
    yield from _toppling()


def _fault(
    name: str,
    body: Callable[[], Body],
    meant: str,
    place: Place | None,
    within_mm: float = NEAR,
    printer: Mapping[str, Any] | None = None,
) -> Broken:
    return Broken(
        name,
        lambda: plain(body(), printer=printer),
        meant,
        None if place is None else lambda _: [place],
        within_mm,
    )


def _too_thin() -> Iterator[Broken]:
    middle = (7.0, 17.0, 10.0)
    yield _fault("a wall 0.9 nozzles thick", lambda: slab(0.36), "feature", middle, 18.0)
    yield _fault("a wall 0.99 nozzles thick", lambda: slab(0.396), "feature", middle, 18.0)
    yield _fault(
        "a wall 0.9 of a wide nozzle",
        lambda: slab(0.72),
        "feature",
        middle,
        18.0,
        {"nozzle_mm": 0.8},
    )
    yield _fault(
        "a plate 0.3 mm thick",
        lambda: box((2, 2, 0), (42, 42, 0.3)),
        "feature",
        (22.0, 22.0, 0.15),
        30.0,
    )
    yield _fault("a roof 0.36 mm thick", _roof, "feature", (17.0, 12.0, 10.0), 18.0)
    yield Broken(
        "a tube thinner than the nozzle",
        lambda: with_scene(make_part(circle(8.0), 0.18), accuracy={"iou_floor": "auto"}),
        "feature",
        lambda p: [(float(x), float(y), float(z)) for x, y, z in p.knots[0]],
        1.0,
    )
    yield _fault(
        "a box in metres",
        lambda: box((2, 2, 0), (27, 22, 12)).scale(1e-3),
        "feature",
        (0.014, 0.012, 0.006),
    )


def _too_narrow() -> Iterator[Broken]:
    yield _fault("a slot 0.9 nozzles wide", lambda: slot(0.36), "gap", (12.2, 17.0, 9.0), 18.0)
    yield _fault(
        "a slot 0.9 of a wide nozzle",
        lambda: slot(0.72),
        "gap",
        (12.4, 17.0, 9.0),
        18.0,
        {"nozzle_mm": 0.8},
    )
    yield _fault(
        "two boxes 0.9 nozzles apart",
        lambda: join(box((2, 2, 0), (12, 22, 10)), box((12.36, 2, 0), (22, 22, 10))),
        "gap",
        (12.2, 12.0, 5.0),
        12.0,
    )
    yield Broken(
        "two rings 0.9 nozzles apart",
        lambda: with_scene(
            make_part([circle(), circle() + [66.36, 0.0, 0.0]], sides=64),
            piece={"clearance_mm": 0.2},
            view={"frame_width_mm": 180.0, "frame_height_mm": 100.0},
        ),
        "gap",
        lambda p: [(float(p.knots[0][0][0]) + 3.2, float(p.knots[0][0][1]), 3.0)],
        6.0,
    )


def _in_the_air() -> Iterator[Broken]:
    yield _fault(
        "a floating piece",
        lambda: join(box((2, 2, 0), (22, 22, 5)), box((5, 5, 12), (15, 15, 20))),
        "floating",
        (10.0, 10.0, 12.0),
        8.0,
        NO_SUPPORTS,
    )
    yield _fault(
        "a floating piece beside",
        lambda: join(box((2, 2, 0), (22, 22, 25)), box((30, 5, 3), (40, 15, 20))),
        "floating",
        (35.0, 10.0, 3.0),
        8.0,
        NO_SUPPORTS,
    )
    yield _fault(
        "the whole part in the air",
        lambda: box((2, 2, 4), (22, 22, 10)),
        "floating",
        (12.0, 12.0, 4.0),
        15.0,
        NO_SUPPORTS,
    )
    yield _fault("an island", island, "islands", (24.0, 7.0, 8.0), 8.0, NO_SUPPORTS)
    yield _fault(
        "a bridge of 40 mm", lambda: arch(40.0), "bridge", (30.0, 7.0, 15.0), 8.0, NO_SUPPORTS
    )
    yield _fault(
        "a bridge 12 % too long", lambda: arch(11.2), "bridge", (15.6, 7.0, 15.0), 8.0, NO_SUPPORTS
    )
    yield _fault(
        "a bridge longer than asked",
        lambda: arch(9.0),
        "bridge",
        (14.5, 7.0, 15.0),
        8.0,
        {**NO_SUPPORTS, "max_bridge_mm": 5.0},
    )
    yield _fault(
        "a ledge of 15 mm", lambda: gallows(15.0), "bridge", (25.0, 7.0, 20.0), 8.0, NO_SUPPORTS
    )


def _too_steep() -> Iterator[Broken]:
    yield _fault(
        "a funnel of 55 degrees",
        lambda: funnel(55.0),
        "overhang",
        (25.0, 25.0, 6.0),
        30.0,
        NO_SUPPORTS,
    )
    yield _fault(
        "a funnel steeper than asked",
        lambda: funnel(40.0),
        "overhang",
        (25.0, 25.0, 6.0),
        30.0,
        {**NO_SUPPORTS, "max_overhang_deg": 35.0},
    )
    yield _fault(
        "a ledge without supports",
        lambda: gallows(15.0),
        "overhang",
        (18.0, 7.0, 20.0),
        10.0,
        NO_SUPPORTS,
    )
    yield _fault(
        "more support than allowed",
        table,
        "support_volume",
        (17.0, 17.0, 15.0),
        18.0,
        {"max_support_cm3": 5.0},
    )
    yield Broken(
        "a ring on more support than allowed",
        lambda: with_scene(_lift_ring(), printer={"max_support_cm3": 1.0}),
        "support_volume",
    )


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
    yield Broken(
        "a stand that topples, printed on its side",
        partial(plain, on_its_side(gallows(25.0)), lying=True, mount=stand),
        "standing",
        lambda _: [(10.0, 18.0, 5.0)],
        6.0,
    )
    yield Broken(
        "a stand that hangs in the air",
        partial(plain, box((2, 2, 3), (22, 22, 10)), mount=stand),
        "standing",
    )


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
