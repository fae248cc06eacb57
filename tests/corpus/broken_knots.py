"""Broken knots: too near, too bent, too long, of a wrong type, linked, or outside region or printer."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .case import Broken, Place, between, make_part, make_tied_part, places_of, with_scene
from .curves import (
    Array,
    borromean,
    circle,
    ellipse,
    figure_eight,
    granny,
    hopf,
    lissajous,
    mirror,
    square,
    torus_knot,
    whitehead,
)
from .files import Part, encode
from .good import bend_of_circle, beside, curl, in_region, length_of
from .parts import box

RADIUS = 3.0
NEAR = 2 * RADIUS


def broken_knots() -> Iterator[Broken]:
    """Faults of the centre lines; the tube is theirs."""
    yield from _too_near()
    yield from _too_bent()
    yield from _of_types()
    yield from _of_scene()
    yield from _of_links()
    yield from _outside()


def _too_near() -> Iterator[Broken]:
    for check in ("thickness", "clearance"):
        yield Broken(
            f"a gap 1 % under the clearance: {check}",
            lambda: beside(2 * RADIUS + 0.99 * 0.8, 0.8),
            check,
            between,
            NEAR,
        )
        yield Broken(
            f"a gap of half the clearance: {check}",
            lambda: beside(2 * RADIUS + 0.2, 0.4),
            check,
            between,
            NEAR,
        )
    for factor in (0.999, 0.95):
        yield Broken(
            f"strands {factor} diameters apart: thickness",
            partial(make_tied_part, partial(_pair, factor * 2 * RADIUS), RADIUS),
            "thickness",
            between,
            NEAR,
        )
    yield from [
        Broken("a knot that touches itself", lambda: replace(make_part(curl(0.0), 2.0), body=None),
         "thickness", lambda p: places_of(p.knots[0][[0, 80]]), NEAR),
        Broken("knots that touch", lambda: make_part([circle(), circle()[:, [0, 2, 1]] + [60.0, 0.0, 0.0]]),
         "knot_type", lambda p: places_of(p.knots[0][0]), NEAR),
    ]  # fmt: skip


def _too_bent() -> Iterator[Broken]:
    sharp = ellipse(40.0, 20.0, 160)
    tightest = _tightest(sharp)
    yield Broken(
        "a bend at 0.99 of the limit",
        lambda: with_scene(make_part(sharp), material={"min_bend_radius_mm": tightest / 0.99}),
        "bend",
        lambda p: places_of(p.knots[0][[0, 80]]),
        NEAR,
    )
    yield Broken(
        "a ring bent at 0.99 of the limit",
        lambda: with_scene(
            make_part(circle()), material={"min_bend_radius_mm": bend_of_circle(30.0, 96) / 0.99}
        ),
        "bend",
        lambda p: places_of(p.knots[0]),
        NEAR,
    )
    yield Broken("a kink", _make_kink, "thickness", lambda p: places_of(p.knots[0][20]), NEAR)
    yield Broken(
        "a length 1 % over the budget",
        lambda: with_scene(
            make_part(circle()), material={"max_length_mm": length_of(circle()) / 1.01}
        ),
        "length",
    )
    yield Broken(
        "two knots 1 % over the budget",
        lambda: with_scene(
            make_part([circle(30.0), circle(18.0)]),
            material={"max_length_mm": (length_of(circle()) + length_of(circle(18.0))) / 1.01},
        ),
        "length",
    )


def _of_types() -> Iterator[Broken]:
    wrong: dict[str, tuple[str, float, Callable[[], Array]]] = {
        "a trefoil where an unknot was promised": ("unknot", 3.0, lambda: torus_knot(2, 3)),
        "a left trefoil where a right one was promised": ("right-handed trefoil", 3.0,
         lambda: mirror(torus_knot(2, 3))),
        "a right trefoil where a left one was promised": ("left-handed trefoil", 3.0,
         lambda: torus_knot(2, 3)),
        "an unknot where a trefoil was promised": ("3_1", 3.0, circle),
        "a figure-eight where a trefoil was promised": ("3_1", 3.0, figure_eight),
        "a trefoil where a figure-eight was promised": ("4_1", 3.0, lambda: torus_knot(2, 3)),
        "a cinquefoil where an unknot was promised": ("unknot", 3.0, lambda: torus_knot(2, 5)),
        "a cinquefoil where a figure-eight was promised": ("4_1", 3.0, lambda: torus_knot(2, 5)),
        "a three-twist where a cinquefoil was promised": ("5_1", 1.0, lambda: lissajous(3, 2, 7, 0.7, 0.2)),
        "a granny where a trefoil was promised": ("3_1", 2.0, granny),
        "a granny where a square was promised": ("square", 2.0, granny),
        "a square where a granny was promised": ("granny", 2.0, square),
        "a left cinquefoil where a right one was promised": ("right-handed 5_1", 3.0,
         lambda: mirror(torus_knot(2, 5))),
        "a torus knot of 3 and 4 where a trefoil was promised": ("3_1", 2.0,
         lambda: torus_knot(3, 4, n=300)),
    }  # fmt: skip
    for name, (promise, radius, curve) in wrong.items():
        # an unknot has no place where it is not knotted
        places = None if curve is circle else _all
        make = partial(make_tied_part, curve, radius, [promise], sides=16)
        yield Broken(name, make, "knot_type", places, NEAR)
    yield Broken(
        "two tubes, one a trefoil where unknots were promised",
        lambda: make_part([circle(), torus_knot(2, 3) + [90.0, 0.0, 0.0]]),
        "knot_type",
        lambda p: places_of(p.knots[1]),
        NEAR,
    )


def _of_scene() -> Iterator[Broken]:
    """The knots keep what their own file promises, and that is not what the scene asks for."""
    wrong: dict[str, tuple[str, tuple[str, ...], Callable[[], Sequence[Array]]]] = {
        "a left trefoil and a scene of an unknot": ("unknot", ("left-handed 3_1",),
         lambda: [mirror(torus_knot(2, 3))]),
        "a left trefoil and a scene of a right one": ("right trefoil", ("3_1",),
         lambda: [mirror(torus_knot(2, 3))]),
        "an unknot and a scene of a trefoil": ("trefoil", ("unknown",), lambda: [circle()]),
        "a trefoil and a scene of no knot that there is": ("clover", ("3_1",), lambda: [torus_knot(2, 3)]),
        "two unknots and a scene of a trefoil": ("trefoil", ("unknot", "unknown"),
         lambda: [circle(), circle(18.0)]),
        "two trefoils and a scene of one": ("trefoil", ("3_1", "3_1"),
         lambda: [torus_knot(2, 3), torus_knot(2, 3) + [90.0, 0.0, 0.0]]),
    }  # fmt: skip
    for name, (asked, types, curves) in wrong.items():
        yield Broken(name, partial(_asked_for, asked, types, curves), "knot_type")


def _asked_for(asked: str, types: Sequence[str], curves: Callable[[], Sequence[Array]]) -> Part:
    return with_scene(make_part(curves(), types=types, sides=16), piece={"knot": asked})


def _of_links() -> Iterator[Broken]:
    links: dict[str, tuple[float, Callable[[], Sequence[Array]]]] = {
        "Hopf link": (3.0, hopf),
        "Hopf link and a ring": (3.0, lambda: [circle(10.0) + [0, 60.0, 0], *hopf()]),
        "Whitehead link": (2.0, whitehead),
        "Borromean rings": (2.0, borromean),
        "doubly linked tubes": (2.0, _twice),
    }
    for name, (radius, curves) in links.items():
        yield Broken(
            f"{name} where an unlink was promised",
            partial(make_tied_part, curves, radius),
            "linking",
            _all,
            15.0,  # between the strands, which are up to 24 mm apart
        )


def _outside() -> Iterator[Broken]:
    regions: dict[str, tuple[dict[str, Any], Callable[[Part], Iterable[Place]]]] = {
        "box": ({"kind": "box", "size_mm": [65.8, 66.0, 6.0]}, _ends),
        "low box": ({"kind": "box", "size_mm": [70.0, 70.0, 5.8]}, _all),
        "box off the middle": ({"kind": "box", "size_mm": [66.0, 70.0, 8.0], "center_mm": [0.1, 0.0, 0.0]},
         lambda p: places_of(p.knots[0][48])),
        "cylinder": ({"kind": "cylinder", "size_mm": [65.8, 80.0, 65.8]}, _ends),
        "low cylinder": ({"kind": "cylinder", "size_mm": [90.0, 65.8, 90.0]},
         lambda p: places_of(p.knots[0][[24, 72]])),
        "sphere": ({"kind": "sphere", "size_mm": [65.8] * 3}, _all),
    }  # fmt: skip
    for name, (region, places) in regions.items():
        yield Broken(
            f"0.1 mm outside the {name}", partial(in_region, region), "region", places, NEAR
        )
    room = encode(box((-32.9, -40, -10), (32.9, 40, 10)), "stl")
    mesh = {"kind": "mesh", "file": "room.stl"}
    yield from [
        Broken("0.1 mm outside the mesh",
         lambda: replace(with_scene(make_part(circle()), region=mesh), raw={"room.stl": room}), "region",
         _ends, NEAR),
        Broken("larger than the printer by 0.1 mm", lambda: _in_room(-0.1), "build_volume", _sides,
         2 * NEAR),
        Broken("0.1 mm below the bed", lambda: _off_bed((0, 0, -0.1)), "build_volume", _all, NEAR),
        Broken("0.1 mm beside the bed", lambda: _off_bed((-4.1, 0, 0)), "build_volume",
         lambda p: places_of(p.knots[0][48]), NEAR),
    ]  # fmt: skip


def _all(part: Part) -> tuple[Place, ...]:
    return places_of(np.concatenate(part.knots))


def _ends(part: Part) -> tuple[Place, ...]:
    return places_of(part.knots[0][[0, 48]])


def _sides(part: Part) -> tuple[Place, ...]:
    return places_of(part.knots[0][[0, 24]])


def _pair(apart: float) -> list[Array]:
    return [circle(), circle() + np.array([60.0 + apart, 0.0, 0.0])]


def _twice() -> list[Array]:
    """Two rings that wind round each other twice."""
    return [_half(0.0), _half(np.pi)]


def _half(phase: float) -> Array:
    """One of two strands of a torus link (2, 4)."""
    t = 2 * np.pi * np.arange(140) / 140
    r = 24 + 9 * np.cos(2 * t + phase)
    return np.column_stack([r * np.cos(t), r * np.sin(t), -9 * np.sin(2 * t + phase)])


def _tightest(curve: Array) -> float:
    """MinRad of a polygon: the least of its shorter edge over 2 tan of half the turning angle."""
    edge = np.roll(curve, -1, axis=0) - curve
    before = np.roll(edge, 1, axis=0)
    long, short = np.linalg.norm(edge, axis=1), np.linalg.norm(before, axis=1)
    turn = np.arctan2(np.linalg.norm(np.cross(before, edge), axis=1), (before * edge).sum(axis=1))
    return float((np.minimum(long, short) / (2 * np.tan(turn / 2))).min())


def _make_kink() -> Part:
    """A ring with one vertex pulled out by 4 mm: the bend there is far below the radius."""
    curve = circle()
    curve[20] *= 34.0 / 30.0
    return replace(make_part(curve), body=None)


def _in_room(spare: float) -> Part:
    part = make_part(circle())
    assert part.body is not None
    size = part.body.vertices.max(axis=0)
    size[:2] += spare
    return with_scene(part, printer={"build_volume_mm": size.tolist()})


def _off_bed(by: tuple[float, float, float]) -> Part:
    part = make_part(circle())
    assert part.body is not None
    knots = tuple(k + np.array(by) for k in part.knots)
    return with_scene(replace(part, body=part.body.move(by), knots=knots))
