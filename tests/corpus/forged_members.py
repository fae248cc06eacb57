"""Faults of pegs, posts and struts, of what lists them, of dowels and of an eyelet."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from manifold3d import Manifold

from .curves import Array
from .forging import (
    ALMOST,
    Bar,
    Forge,
    Held,
    axes_of,
    ball,
    bar_of,
    box,
    collar,
    disc,
    hull_of,
    rod,
)


def of_member(number: int) -> Iterator[tuple[str, Forge]]:
    """Forge a peg, post or strut."""
    which = f"member {number}"

    def forge(change: Callable[[Held, Bar], object]) -> Forge:
        return lambda held: change(held, bar_of(held, "members", number))

    def necked(held: Held, bar: Bar, inner: float, thick: float, share: float) -> None:
        held.cut(collar(bar.at(share), bar.along, inner * bar.radius, 1.5 * bar.radius, thick))

    def split(held: Held, bar: Bar) -> None:
        axes = axes_of(bar.along)
        held.cut(box(bar.at(0.5), (0.15, 3 * bar.radius, 8.0), axes))

    def bored(held: Held, bar: Bar) -> None:
        held.cut(rod(bar.at(0.4), bar.at(0.7), 0.4 * bar.radius))

    def left_out(held: Held, bar: Bar) -> None:
        held.cut(rod(*bar.bare, ALMOST * bar.radius))

    def aside(held: Held, bar: Bar) -> None:
        off = 3 * bar.radius * axes_of(bar.along)[0]
        left_out(held, bar)
        held.add(rod(bar.start + off, bar.end + off, bar.radius))

    def thinner(held: Held, bar: Bar) -> None:
        left_out(held, bar)
        held.add(rod(bar.start, bar.end, 0.8 * bar.radius))

    def cut_across(held: Held, bar: Bar, at: float, thick: float) -> None:
        """Cut a bar off at its strand (at = 0), at its foot (at = 1) or between."""
        first, last = bar.bare
        last = last - 0.3 * bar.along
        held.cut(disc(first + at * (last - first), bar.along, 1.7 * bar.radius, thick))

    def grooved(held: Held, bar: Bar) -> None:
        axes = axes_of(bar.along)
        held.cut(box(bar.at(0.5) + bar.radius * axes[0], (0.5, 0.5, 4.0), axes))

    yield f"{which} necked", forge(partial(necked, inner=0.25, thick=0.6, share=0.5))
    yield f"{which} necked by a tenth", forge(partial(necked, inner=0.9, thick=0.4, share=0.6))
    yield f"{which} necked near its foot", forge(partial(necked, inner=0.4, thick=0.3, share=0.9))
    yield f"{which} slit across", forge(partial(cut_across, at=0.6, thick=0.08))
    yield f"{which} slit along", forge(split)
    yield f"{which} with a void", forge(lambda held, bar: held.cut(ball(bar.at(0.5), 0.4)))
    yield f"{which} bored", forge(bored)
    yield f"{which} grooved", forge(grooved)
    yield f"{which} cut off at its strand", forge(partial(cut_across, at=0.0, thick=0.3))
    yield f"{which} cut off at its foot", forge(partial(cut_across, at=1.0, thick=0.2))
    yield f"{which} left out", forge(left_out)
    yield f"{which} moved", forge(aside)
    yield f"{which} thinner", forge(thinner)


def of_lists(*keys: str) -> Iterator[tuple[str, Forge]]:
    """Leave things out of knots.json, and all that says how many there are."""

    def without(held: Held, key: str) -> None:
        del held.knots[key]

    def fewer(held: Held, key: str, silent: bool) -> None:
        one = held.knots[key].pop(0)
        if "from" in one:
            bar = Bar(np.array(one["from"]), np.array(one["to"]), float(np.max(one["radius_mm"])))
            start = bar.bare[0] if key == "members" else bar.start
            held.cut(rod(start, bar.end, ALMOST * bar.radius))
        else:
            held.cut(hull_of(one).translate((0.0, 0.0, -0.01)))
        if silent:
            held.scene["mount"].pop("pegs")

    def thinner(held: Held, key: str) -> None:
        for one in held.knots[key]:
            if "from" in one:
                bar = Bar(np.array(one["from"]), np.array(one["to"]), 0.0)
                old = float(np.max(one["radius_mm"]))
                start = bar.bare[0] if key == "members" else bar.start
                held.cut(rod(start, bar.end, ALMOST * old) - rod(start, bar.end, 0.35))
                one["radius_mm"] = [0.35, 0.35] if key == "members" else 0.35

    for key in keys:
        yield f"no {key} in knots.json", partial(without, key=key)
        yield f"one of {key} left out of all files", partial(fewer, key=key, silent=False)
        if key == "members":
            yield (
                f"one of {key} left out, and nothing says how many",
                partial(fewer, key=key, silent=True),
            )
        if key != "hulls":
            yield f"{key} thinned in all files", partial(thinner, key=key)


def of_dowels() -> Iterator[tuple[str, Forge]]:
    def dowel(held: Held) -> tuple[Array, Array]:
        corners = np.array(held.knots["hulls"][0]["corners"])
        return corners.min(axis=0), corners.max(axis=0)

    def shorten(held: Held, by: float) -> None:
        low, high = dowel(held)
        at = (low + high) / 2
        at[2] = low[2]
        held.cut(box(at, (9.0, 9.0, 2 * by)))

    def cut(held: Held, share: float, tool: Callable[[Array, float], Any]) -> None:
        low, high = dowel(held)
        at = (low + high) / 2
        at[2] = low[2] + share * (high - low)[2]
        held.cut(tool(at, float((high - low)[0]) / 2))

    def shrink(held: Held, wide: float, deep: float) -> None:
        one = held.knots["hulls"][0]
        corners = np.array(one["corners"])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        middle[2] = corners[:, 2].max()
        held.cut(hull_of(one).translate((0.0, 0.0, -0.01)))
        one["corners"] = (middle + (corners - middle) * [wide, wide, deep]).tolist()
        held.add(hull_of(one).translate((0.0, 0.0, 0.01)))

    def thicken(held: Held) -> None:
        low, high = dowel(held)
        middle = (low + high) / 2
        held.add(rod(middle, middle + [0.0, 0.0, 1.5], float((high - low)[0]) / 2 + 0.5))

    z = np.array([0.0, 0.0, 1.0])
    yield "a collar on a dowel", thicken
    yield "dowel shortened", partial(shorten, by=2.0)
    yield "dowel shortened a little", partial(shorten, by=0.4)
    yield "dowel slit across", partial(cut, share=0.5, tool=lambda at, r: disc(at, z, 2 * r, 0.1))
    yield (
        "dowel necked",
        partial(cut, share=0.8, tool=lambda at, r: collar(at, z, 0.5 * r, 2 * r, 0.3)),
    )
    yield (
        "dowel bored",
        partial(cut, share=0.5, tool=lambda at, r: rod(at - 2 * z, at + 2 * z, 0.5 * r)),
    )
    yield "dowel with a void", partial(cut, share=0.4, tool=lambda at, r: ball(at, 0.5))
    yield "dowel thinned in all files", partial(shrink, wide=0.5, deep=1.0)
    yield "dowel shortened in all files", partial(shrink, wide=1.0, deep=0.5)


def of_eyelet() -> Iterator[tuple[str, Forge]]:
    def rods(held: Held) -> list[Bar]:
        """The rods of the first eyelet; the second has as many."""
        return [bar_of(held, "rods", k) for k in range(len(held.knots["rods"]) // 2)]

    def cut(held: Held, number: int, tool: Callable[[Bar], Any]) -> None:
        held.cut(tool(rods(held)[number]))

    def half(held: Held) -> None:
        for bar in rods(held)[:8]:
            held.cut(rod(bar.start, bar.end, ALMOST * bar.radius))

    def plug(held: Held) -> None:
        ring = np.array([bar.start for bar in rods(held)])
        along = np.linalg.svd(ring - ring.mean(axis=0))[2][2]
        held.add(disc(ring.mean(axis=0), along, 4.0, 1.0))

    def thread(held: Held, which: str = "thread_mm") -> None:
        held.scene["mount"][which][0] += 3.0

    def turns(held: Held) -> None:
        held.scene["mount"]["second_thread_mm"] = "none"

    def alone(held: Held) -> None:
        turns(held)
        for bar in (bar_of(held, "rods", k) for k in range(len(rods(held)), 2 * len(rods(held)))):
            held.cut(rod(bar.start, bar.end, ALMOST * bar.radius))
        held.knots["rods"] = held.knots["rods"][: len(rods(held))]

    def second_slit(held: Held) -> None:
        bar = bar_of(held, "rods", len(rods(held)) + 3)
        held.cut(disc(bar.at(0.5), bar.along, 3.0, 0.1))

    def smaller(held: Held) -> None:
        ring = np.array([bar.start for bar in rods(held)])
        middle = ring.mean(axis=0)
        wire = rods(held)[0].radius
        for bar in rods(held):
            held.cut(rod(bar.start, bar.end, ALMOST * wire))
        for one in held.knots["rods"][: len(rods(held))]:
            for key in ("from", "to"):
                one[key] = (middle + 0.6 * (np.array(one[key]) - middle)).tolist()
        held.add(*(rod(bar.start, bar.end, wire) for bar in rods(held)))

    def necked(bar: Bar, inner: float) -> Manifold:
        return collar(bar.at(0.5), bar.along, inner * bar.radius, 3.0, 0.4)

    yield "ring slit", partial(cut, number=3, tool=lambda b: disc(b.at(0.5), b.along, 3.0, 0.1))
    yield "ring necked", partial(cut, number=12, tool=partial(necked, inner=0.4))
    yield "ring necked by a tenth", partial(cut, number=6, tool=partial(necked, inner=0.9))
    yield "ring with a void", partial(cut, number=9, tool=lambda b: ball(b.at(0.5), 0.4))
    yield "ring half missing", half
    yield "ring plugged", plug
    yield "thread elsewhere", thread
    yield "second thread elsewhere", partial(thread, which="second_thread_mm")
    yield "second thread left out of the scene", turns
    yield "second eyelet sawn off in all files", alone
    yield "second ring slit", second_slit
    yield "ring smaller in all files", smaller
