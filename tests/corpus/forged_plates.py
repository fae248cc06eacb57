"""Faults of the plate on a wall, of the plate in which a piece stands, and of a stand's base."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from .curves import Array
from .forging import Forge, Held, ball, box, hull_of, rod, span_of


def of_wall_plate() -> Iterator[tuple[str, Forge]]:
    """Forge the plate that pegs stand on, printed face up: from z = 0 to its thickness."""

    def foot(held: Held) -> Array:
        return np.array(held.knots["members"][0]["to"])

    def sides(held: Held) -> tuple[float, Array, Array]:
        low, high = span_of(held)
        return float(foot(held)[2]), low, high

    def groove(held: Held, from_back: bool, left: float, x: float = 0.3) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2
        middle[0] = low[0] + x * (high - low)[0]
        middle[2] = (thick - left) / 2 if from_back else thick - (thick - left) / 2
        held.cut(box(middle, (2.0, 2 * (high - low)[1], thick - left)))

    def saw(held: Held) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2 + [20.0, 25.0, 0.0]
        held.cut(box(middle * [1, 1, 0] + [0, 0, thick / 2], (0.3, 60.0, 2 * thick)))

    def hollow(held: Held) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2 * [1, 1, 0] + [0, 0, thick / 2]
        held.cut(box(middle, (40.0, 40.0, thick - 1.0)))

    def under(held: Held, size: float) -> None:
        at = foot(held)
        held.cut(box(at * [1, 1, 0.4], (size, size, 0.6)))

    def drill(held: Held, at: tuple[float, float], wide: float) -> None:
        _, low, high = sides(held)
        x, y = low[:2] + np.array(at) * (high - low)[:2]
        held.cut(rod(np.array([x, y, -1.0]), np.array([x, y, 9.0]), wide / 2))

    def trim(held: Held, normal: Array, share: float) -> None:
        low, high = span_of(held)
        (whole,) = held.bodies
        plate = whole.trim_by_plane((0.0, 0.0, -1.0), -float(foot(held)[2]))
        rest = whole.trim_by_plane((0.0, 0.0, 1.0), float(foot(held)[2]))
        at = float(np.where(normal > 0, low, high) @ normal + share)
        held.bodies = [plate.trim_by_plane(tuple(normal), at) + rest]

    def screw(held: Held) -> None:
        _, low, high = sides(held)
        drill(held, (5.0 / float((high - low)[0]), 0.5), 8.0)

    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    yield "plate grooved from behind", partial(groove, from_back=True, left=0.5)
    yield "plate grooved in its face", partial(groove, from_back=False, left=2.7, x=0.6)
    yield "plate sawn", saw
    yield "plate hollow", hollow
    yield "void under a peg", partial(under, size=4.0)
    yield "small void under a peg", partial(under, size=0.8)
    yield "pinhole in the plate", partial(drill, at=(0.4, 0.35), wide=0.5)
    yield "third screw hole", partial(drill, at=(0.5, 0.9), wide=4.0)
    yield "screw hole too wide", screw
    yield "plate narrower", partial(trim, normal=x, share=3.0)
    yield "plate thinner", partial(trim, normal=z, share=0.5)


def of_base() -> Iterator[tuple[str, Forge]]:
    """Forge the base of a stand, printed as it stands: from z = 0 up."""

    def foot(held: Held) -> Array:
        return np.array(held.knots["members"][0]["to"])

    def ends(held: Held) -> tuple[Array, Array]:
        corners = np.array(held.knots["hulls"][0]["corners"])
        return corners.min(axis=0), corners.max(axis=0)

    def groove(held: Held, deep: float) -> None:
        low, high = ends(held)
        at = (low + high) / 2 * [1, 1, 0] + low * [0, 0, 1]
        held.cut(box(at + [4.0, 0, 0], (1.5, 999.0, 2 * deep)))

    def corner(held: Held) -> None:
        low, _ = ends(held)
        held.cut(box(low, (12.0, 12.0, 90.0)))

    def shrink(held: Held, share: float) -> None:
        one = held.knots["hulls"][0]
        corners = np.array(one["corners"])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        small = {**one, "corners": (middle + (corners - middle) * [share, share, 1.0]).tolist()}
        held.cut(hull_of(one) - hull_of(small))
        one["corners"] = small["corners"]

    def slab(held: Held) -> None:
        low, high = ends(held)
        at = (low + high) / 2
        held.cut(box([at[0], at[1], low[2] + 1.2], (*(0.7 * (high - low)[:2]), 0.5)))

    def pinhole(held: Held) -> None:
        at = foot(held) * [1, 1, 0] + [9.0, 1.0, 0.0]
        held.cut(rod(at - [0, 0, 1.0], at + [0, 0, 30.0], 0.3))

    yield "base grooved from below", partial(groove, deep=2.0)
    yield "base scratched from below", partial(groove, deep=0.4)
    yield "base hollow", slab
    yield "base without a corner", corner
    yield "void under a post", lambda held: held.cut(ball(foot(held) - [0, 0, 1.6], 0.8))
    yield "pinhole in the base", pinhole
    yield "base smaller in all files", partial(shrink, share=0.3)


def of_foot_plate() -> Iterator[tuple[str, Forge]]:
    """Forge the plate in which a piece stands by its valleys, printed face up."""

    def slab(held: Held) -> tuple[Array, Array, float]:
        plate = held.knots["plate"]
        outline = np.array(plate["outline"])
        return outline, outline.mean(axis=0), float(plate["thickness_mm"])

    def groove(held: Held, deep: float, behind: bool) -> None:
        _, middle, thick = slab(held)
        z = middle[2] - (thick if behind else 0.0)
        held.cut(box([middle[0] + 8.0, middle[1], z], (1.0, 999.0, 2 * deep)))

    def drill(held: Held, wide: float, listed: bool) -> None:
        _, middle, thick = slab(held)
        at = np.array([middle[0] + 14.0, middle[1] + 12.0, middle[2]])
        held.cut(rod(at - [0, 0, 2 * thick], at + [0, 0, 0.01], wide / 2))
        if listed:
            held.knots["plate"]["holes"].append(at.tolist())

    def thin(held: Held, by: float, listed: bool) -> None:
        _, middle, thick = slab(held)
        held.cut(box([middle[0], middle[1], middle[2] - thick], (999.0, 999.0, 2 * by)))
        if listed:
            held.knots["plate"]["thickness_mm"] -= by

    def void(held: Held, under_foot: bool) -> None:
        _, middle, thick = slab(held)
        at = middle.copy()
        if under_foot:
            points = np.array(held.knots["knots"][0]["points"])
            at = points[int(points[:, 2].argmin())].copy()
        at[2] = middle[2] - thick / 2
        held.cut(box(at, (2.0, 2.0, 0.5)))

    def smaller(held: Held, listed: bool) -> None:
        outline, middle, thick = slab(held)
        points = np.concatenate([k["points"] for k in held.knots["knots"]])
        foot = points[points[:, 2] < middle[2] + 2.0, 1].max()  # of the highest foot in the picture
        edge = float(foot) - 1.0
        held.cut(box([middle[0], edge + 50.0, middle[2] - thick / 2], (999.0, 100.0, thick + 0.02)))
        if listed:
            outline[:, 1] = np.minimum(outline[:, 1], edge)
            held.knots["plate"]["outline"] = outline.tolist()

    yield "plate grooved from behind", partial(groove, deep=1.1, behind=True)
    yield "plate scratched", partial(groove, deep=0.2, behind=False)
    yield "pinhole in the plate", partial(drill, wide=0.6, listed=False)
    yield "a third hole that knots.json lists", partial(drill, wide=4.0, listed=True)
    yield "plate thinner", partial(thin, by=0.3, listed=False)
    yield "plate thinner in all files", partial(thin, by=0.9, listed=True)
    yield "void in the plate", partial(void, under_foot=False)
    yield "void under a foot", partial(void, under_foot=True)
    yield "plate smaller", partial(smaller, listed=False)
    yield "plate smaller in all files", partial(smaller, listed=True)
    yield "no plate in knots.json", lambda held: held.knots.pop("plate")
