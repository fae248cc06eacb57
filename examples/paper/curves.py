"""Templates from formulas: circle, torus knots and links, figure-eight, closed braids, open curves.

Every curve is (n, 3) float64 in the unit of its arguments. Hands are those of the table of knots: T(p, q)
with p q > 0, and a braid of positive letters, are right-handed, as the common trefoil in books.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import gcd

import numpy as np

from knotfab.arrays import Array
from knotfab.errors import InputError

_STEPS = 6  # vertices that a braid's strand has in each letter


def _turn(samples: int) -> Array:
    """[samples] parameters of one full turn."""
    if samples < 3:
        raise InputError(f"{samples} samples", "they make no curve", "Ask for 3 or more")
    return 2 * np.pi * np.arange(samples) / samples


def circle(radius: float = 1.0, samples: int = 200) -> Array:
    """The circle of this radius in the plane z = 0: the paper's template (section 3)."""
    s = _turn(samples)
    return radius * np.column_stack([np.cos(s), np.sin(s), 0 * s])


def torus_knot(p: int, q: int, major: float = 2.0, minor: float = 1.0, samples: int = 400) -> Array:
    """The torus knot T(p, q): p times around the axis z and q times around the torus's own core.

    Args:
        p, q: coprime and not 0; a negative product makes the mirror image.
        major: radius of the core.
        minor: radius of the torus about its core, below `major`.

    Raises:
        InputError: p and q have a common factor (that is a link), or the torus meets its own axis.
    """
    if p == 0 or q == 0 or gcd(p, q) != 1:
        raise InputError(
            f"the torus knot T({p},{q})",
            "its numbers have a common factor",
            "Use coprime numbers, or torus_link for several components.",
        )
    return torus_link(p, q, major, minor, samples)[0]


def torus_link(
    p: int, q: int, major: float = 2.0, minor: float = 1.0, samples: int = 400
) -> list[Array]:
    """The gcd(p, q) components of the torus link T(p, q), each with `samples` vertices.

    Raises:
        InputError: p or q is 0, or the torus meets its own axis.
    """
    if p == 0 or q == 0:
        raise InputError(f"the torus link T({p},{q})", "a number is 0", "Use numbers other than 0.")
    if not 0 < minor < major:
        raise InputError(
            f"a torus of radii {major:g} and {minor:g}",
            "it meets its own axis",
            "Make the second radius the smaller one.",
        )
    count = gcd(p, q)
    s = _turn(samples)
    parts = []
    for k in range(count):
        around, about = p // count * s, q // count * s + 2 * np.pi * k / p
        r = major + minor * np.cos(about)
        # against the sense of z, so that a positive product is right-handed
        parts.append(
            np.column_stack([r * np.cos(around), r * np.sin(around), -minor * np.sin(about)])
        )
    return parts


def hopf_link(radius: float = 1.0, samples: int = 200) -> list[Array]:
    """Two circles, each through the other's middle."""
    one = circle(radius, samples)
    return [one, one[:, [0, 2, 1]] + [radius, 0.0, 0.0]]


def figure_eight(size: float = 1.0, samples: int = 400) -> Array:
    """The figure-eight knot 4_1, within 3 `size` of the axis z and `size` of the plane z = 0."""
    s = _turn(samples)
    r = 2 + np.cos(2 * s)
    return size * np.column_stack([r * np.cos(3 * s), r * np.sin(3 * s), np.sin(4 * s)])


def closed_braid(word: Sequence[int], spacing: float = 3.0) -> list[Array]:
    """The components of a braid's closure, turning about the axis z, strand 1 innermost.

    Letter k > 0 lets strands k and k + 1 cross right-handedly, k < 0 left-handedly. Strands at rest
    are `spacing` apart, and half of it above and below each other where they cross.

    Raises:
        InputError: a letter is 0, or there is none.
    """
    if not word or 0 in word:
        raise InputError(
            f"the braid {list(word)}", "its letters must not be 0", "Give numbers such as 1 or -2."
        )
    count = 1 + max(abs(k) for k in word)
    inner = spacing * max(1.0, 2.0 * len(word) / (2 * np.pi))
    turn = 2 * np.pi / len(word)
    share = np.arange(_STEPS) / _STEPS
    ease = 0.5 - 0.5 * np.cos(np.pi * share)
    seen: set[int] = set()
    parts = []
    for start in range(1, count + 1):
        if start in seen:
            continue
        rows: list[Array] = []
        place = start
        while not rows or place != start:
            seen.add(place)
            for slot, letter in enumerate(word):
                k = abs(letter)
                after = {k: k + 1, k + 1: k}.get(place, place)
                # the strand that goes outwards passes above where the letter is positive
                side = 0.0 if after == place else float(np.sign(letter)) * (after - place)
                r = inner + spacing * (place + (after - place) * ease)
                angle = turn * (slot + share)
                z = 0.5 * spacing * side * np.sin(np.pi * share)
                rows.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), z]))
                place = after
        parts.append(np.concatenate(rows))
    return parts


def arc(radius: float = 1.0, degrees: float = 270.0, samples: int = 200) -> Array:
    """An open arc of a circle in the plane z = 0, both ends included."""
    s = np.radians(degrees) * np.arange(samples) / (samples - 1)
    return radius * np.column_stack([np.cos(s), np.sin(s), 0 * s])


def helix(radius: float = 1.0, pitch: float = 1.0, turns: float = 3.0, samples: int = 300) -> Array:
    """An open right-handed helix about the axis z, both ends included; `pitch` is its rise a turn."""
    s = turns * np.arange(samples) / (samples - 1)
    return np.column_stack(
        [radius * np.cos(2 * np.pi * s), radius * np.sin(2 * np.pi * s), pitch * s]
    )


def spiral(
    inner: float = 1.0, spacing: float = 2.5, turns: float = 3.0, step: float = 0.3
) -> Array:
    """An open flat spiral from radius `inner`, its turns `spacing` apart, vertices `step` apart."""
    fine = np.linspace(0.0, 2 * np.pi * turns, max(64, int(200 * turns)))
    r = inner + spacing * fine / (2 * np.pi)
    line = np.column_stack([r * np.cos(fine), r * np.sin(fine), 0 * fine])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(3, round(along[-1] / step) + 1))
    return np.stack([np.interp(at, along, line[:, k]) for k in range(3)], axis=1)
