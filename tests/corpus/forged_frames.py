"""Faults of the frame that holds lamps, and of bars and feet of a piece that prints without supports."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from .curves import Array
from .forging import Forge, Held, ball, box, rod, span_of


def of_frame() -> Iterator[tuple[str, Forge]]:
    """Forge the bars of the lamps' frame, which are cut in their own coordinates."""

    def bars(held: Held) -> list[tuple[Any, Array]]:
        """Return each bar, and the motion (4, 4) from its own coordinates to the bed."""
        (plate,) = held.scene["lamps"]["table"]
        return [
            (bar, np.linalg.inv(np.array(motion)) @ np.array(bar["matrix"]))
            for bar, motion in zip(plate["bars"], plate["matrices"], strict=True)
        ]

    def cut(
        held: Held, number: int, at: Callable[[Any], tuple[float, ...]], sides: tuple[float, ...]
    ) -> None:
        bar, motion = bars(held)[number]
        tool = box(np.array(at(bar)), sides, np.eye(3)).transform(motion[:3])  # type: ignore[arg-type]
        held.frame[number] -= tool

    def middle(bar: Any) -> tuple[float, ...]:
        return 0.55 * bar["length_mm"], 0.0, bar["thickness_mm"] / 2

    def slit(held: Held, number: int, left: float) -> None:
        thick = bars(held)[number][0]["thickness_mm"]
        at = lambda bar: (0.55 * bar["length_mm"], 0.0, 0.0)  # noqa: E731
        cut(held, number, at, (0.8, 99.0, 2 * (thick - left)))

    def narrow(held: Held, number: int) -> None:
        cut(
            held,
            number,
            lambda bar: (0.55 * bar["length_mm"], bar["width_mm"] / 2, 2.5),
            (1.0, bars(held)[number][0]["width_mm"] * 1.7, 99.0),
        )

    def tail(held: Held) -> None:
        number = next(k for k, (bar, _) in enumerate(bars(held)) if bar["tail"])
        cut(held, number, lambda bar: (bar["length_mm"] + 1.0, 0.0, 2.5), (0.4, 99.0, 99.0))

    def ridge(held: Held) -> None:
        for number, (bar, _) in enumerate(bars(held)):
            for x0, x1, y0, y1, high in bar["ridges"][:1]:
                top = bar["thickness_mm"] + high
                at = ((x0 + x1) / 2, (y0 + y1) / 2, top - 2.0)
                cut(held, number, lambda _, at=at: at, (abs(x1 - x0) + 1, abs(y1 - y0) + 1, 4.1))

    def boss(held: Held) -> None:
        for number, (bar, _) in enumerate(bars(held)):
            for x, y, wide, high in (hole for hole in bar["holes"] if hole[3] > 0):
                at = (x + wide / 2 + 1.5, y, bar["thickness_mm"] + high / 2)
                cut(held, number, lambda _, at=at: at, (2.0, 1.0, high - 1.0))

    def extra(held: Held) -> None:
        number = int(np.argmax([bar["length_mm"] for bar, _ in bars(held)]))
        bar = bars(held)[number][0]
        cut(held, number, middle, (3.0, 20.0, 99.0))
        bar.setdefault("holes", []).append([0.55 * bar["length_mm"], 0.0, 24.0, 0.0])

    def thin(held: Held) -> None:
        held.frame = [
            solid.trim_by_plane((0.0, 0.0, 1.0), 2.0).translate((0.0, 0.0, -2.0))
            for solid in held.frame
        ]
        for bar, _ in bars(held):
            bar["thickness_mm"] = 3.0
            up = np.array(bar["matrix"])
            up[:3, 3] += 2.0 * up[:3, 2]
            bar["matrix"] = up.tolist()
        (plate,) = held.scene["lamps"]["table"]
        for k, motion in enumerate(plate["matrices"]):
            moved = np.array(motion)
            moved[:3, 3] += 2.0 * moved[:3, 2]
            plate["matrices"][k] = moved.tolist()

    def none(held: Held) -> None:
        held.scene["lamps"]["table"][0].pop("bars")

    def fewer(held: Held) -> None:
        (plate,) = held.scene["lamps"]["table"]
        number = next(k for k, b in enumerate(plate["bars"]) if b["ridges"] and b["tail"])
        for listed in (held.frame, plate["bars"], plate["matrices"]):
            listed.pop(number)

    def aside(held: Held) -> None:
        (plate,) = held.scene["lamps"]["table"]
        number = next(k for k, b in enumerate(plate["bars"]) if b["tail"])
        for rows in (plate["matrices"][number], plate["bars"][number]["matrix"]):
            rows[0][3] += 2.0

    def plugged(held: Held) -> None:
        for number, (bar, motion) in enumerate(bars(held)):
            for x, side in bar["sockets"][:1]:
                at = np.array([x, side * (bar["width_mm"] / 2 - 4.0), bar["thickness_mm"] / 2])
                held.frame[number] += box(at, (9.0, 5.0, bar["thickness_mm"])).transform(motion[:3])

    for number in (0, 1, -1):
        yield f"bar {number} slit to 0.8 mm", partial(slit, number=number, left=0.8)
    yield "bar slit to 4.5 mm", partial(slit, number=1, left=4.5)
    yield "bar sawn to a sixth", partial(narrow, number=0)
    yield "bar with a void", lambda held: cut(held, 0, middle, (3.0, 3.0, 2.0))
    yield "bar with a slot", lambda held: cut(held, 1, middle, (10.0, 0.4, 99.0))
    yield "dovetail cut", tail
    yield "ridges lower", ridge
    yield "walls around holes slit", boss
    yield "a hole that the scene lists", extra
    yield "bars thin in all files", thin
    yield "no bars in the scene", none
    yield "an arm left out of all files", fewer
    yield "an arm out of place in all files", aside
    yield "sockets plugged", plugged


def of_arches() -> Iterator[tuple[str, Forge]]:
    """Forge bars and feet of a piece that prints without supports."""

    def bar(held: Held, number: int) -> tuple[Array, Array, float, float]:
        one = held.knots["bars"][number]
        return np.array(one["from"]), np.array(one["to"]), one["width_mm"], one["height_mm"]

    def around(held: Held, number: int, share: float = 0.5) -> tuple[Array, Array]:
        start, end, _, _ = bar(held, number)
        along = (end - start) / np.linalg.norm(end - start)
        side = np.cross([0.0, 0.0, 1.0], along)
        return start + share * (end - start), np.stack([along, side, [0.0, 0.0, 1.0]])

    def left_out(held: Held, listed: bool) -> None:
        at, axes = around(held, 0)
        start, end, wide, high = bar(held, 0)
        length = float(np.linalg.norm(end - start))
        held.cut(box(at, (length + 0.1, wide + 0.1, high + 0.1), axes))
        if listed:
            held.knots["bars"].pop(0)

    def cut(
        held: Held, sides: tuple[float, float, float], off: tuple[float, float, float] = (0, 0, 0)
    ) -> None:
        at, axes = around(held, 1)
        held.cut(box(at + np.array(off) @ axes, sides, axes))

    def moved(held: Held) -> None:
        at, axes = around(held, 0)
        start, end, wide, high = bar(held, 0)
        length = float(np.linalg.norm(end - start))
        left_out(held, False)
        held.add(box(at + [0.0, 0.0, 6.0], (length, wide, high), axes))

    def thick(held: Held) -> None:
        at, axes = around(held, 2)
        start, end, _, _ = bar(held, 2)
        length = float(np.linalg.norm(end - start))
        held.add(box(at, (length + 0.4, 3.0, 2.0), axes))

    def feet(held: Held) -> list[Array]:
        """Return the lowest point of each valley of the first knot."""
        points = np.array(held.knots["knots"][0]["points"])
        z = points[:, 2]
        low = (z < np.roll(z, 1)) & (z <= np.roll(z, -1))
        return list(points[low])

    def foot(held: Held, deep: float) -> None:
        x, y, _ = feet(held)[0]
        held.cut(box([x, y, 0.0], (14.0, 14.0, 2 * deep)))

    def all_feet(held: Held) -> None:
        held.bodies = [
            body.trim_by_plane((0.0, 0.0, 1.0), 1.5).translate((0.0, 0.0, -1.5))
            for body in held.bodies
        ]
        for knot in held.knots["knots"]:
            knot["points"] = (np.array(knot["points"]) - [0, 0, 1.5]).tolist()
        for one in held.knots["bars"]:
            for key in ("from", "to"):
                one[key][2] -= 1.5
        held.knots["feet"]["cut_mm"] += 1.5

    def joined(held: Held) -> None:
        low, high = span_of(held)
        at = (low + high) / 2 * [1, 1, 0]
        held.add(box(at + [0, 0, 0.2], (*(high - low)[:2], 0.4)))

    def pinhole(held: Held) -> None:
        at = feet(held)[0] * [1, 1, 0]
        held.cut(rod(at - [0, 0, 1], at + [0, 0, 1.5], 0.3))

    yield "bar left out", partial(left_out, listed=False)
    yield "bar left out of all files", partial(left_out, listed=True)
    yield "bar necked", partial(cut, sides=(0.4, 0.5, 9.0), off=(0.0, 0.4, 0.0))
    yield "bar slit across", partial(cut, sides=(0.1, 9.0, 9.0))
    yield "bar moved up", moved
    yield "bar too strong to break away", thick
    yield "foot cut too high", partial(foot, deep=1.0)
    yield "foot cut a little too high", partial(foot, deep=0.25)
    yield "all feet cut above their middle in all files", all_feet
    yield "feet joined by a sheet", joined
    yield "void above a foot", lambda held: held.cut(ball(feet(held)[1] + [0, 0, 0.2], 0.5))
    yield "pinhole in a foot", pinhole
    yield "no bars in knots.json", lambda held: held.knots.pop("bars")
    yield "no feet in knots.json", lambda held: held.knots.pop("feet")
