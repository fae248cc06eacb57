"""Closed braids, (n, 3) float64; other curves: `tests.corpus.curves`.

A braid of positive letters is right-handed, as the common trefoil in books.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array
from knotfab_formats.errors import InputError

_STEPS = 6  # vertices that a braid's strand has in each letter


def closed_braid(word: Sequence[int], spacing: float = 3.0) -> list[Array]:
    """Return the components of a braid's closure, turning about the axis z, strand 1 innermost.

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
