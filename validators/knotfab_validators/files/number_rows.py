"""Rows of three numbers in XML that is written one way, as nearly all 3MFs are: read by a compiled loop."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array
from knotfab_validators.compiled import compiled

__all__ = ["Rows", "cut_rows"]

Bytes = NDArray[np.uint8]

KINDS = {
    "vertices": (b'<vertex x="', b'" y="', b'" z="'),
    "triangles": (b'<triangle v1="', b'" v2="', b'" v3="'),
}
TAG = re.compile(b"<(" + "|".join(KINDS).encode() + b")>")
MOST_TAGS = 100_000  # the text behind so many is left as it is
# a number of so many digits is exact as a whole number, and so is the power of ten below it
MOST_DIGITS = 15


@dataclass(frozen=True)
class Rows:
    """What stood between the tags of `kind`: (n, 3) numbers; whole ones and not negative of triangles."""

    kind: str
    numbers: Array


def cut_rows(text: bytes) -> tuple[bytes, dict[int, Rows]]:
    """The text without the rows that could be read, and these by the place in it of the tag before them.

    Rows are `<vertex x="1.5" y="-2" z="0" />` within <vertices>, and `<triangle v1="0" v2="1" v3="2"/>`
    within <triangles>: plain decimals, no other attributes. Where anything else stands between two such
    tags, all of it is left as it is.
    """
    kept: list[bytes] = []
    found: dict[int, Rows] = {}
    shown = np.frombuffer(text, dtype=np.uint8)
    begin = length = at = 0
    for _ in range(MOST_TAGS):
        if (tag := TAG.search(text, at)) is None:
            break
        kind = tag[1].decode()
        at = tag.end()
        end, numbers = _read_rows(shown, at, *_keys(kind), kind == "triangles")
        if text.startswith(f"</{kind}>".encode(), end):
            kept.append(text[begin:at])
            found[length + tag.start() - begin] = Rows(kind, numbers)
            length += at - begin
            begin = at = end
    return b"".join([*kept, text[begin:]]), found


def _keys(kind: str) -> tuple[Bytes, Bytes, Bytes]:
    first, second, third = (np.frombuffer(key, dtype=np.uint8) for key in KINDS[kind])
    return first, second, third


@compiled
def _read_rows(
    text: Bytes, at: int, first: Bytes, second: Bytes, third: Bytes, whole: bool
) -> tuple[int, Array]:
    """The rows from a place on, (n, 3), and the place of the first thing that is none, spaces left out."""
    room = 1024
    rows = np.empty((room, 3))
    count = 0
    end = len(text)
    keys = (first, second, third)
    while True:
        while at < end and (text[at] == 32 or text[at] == 9 or text[at] == 10 or text[at] == 13):
            at += 1
        place = at
        right = True
        if count == room:
            more = np.empty((2 * room, 3))
            more[:room] = rows
            rows, room = more, 2 * room
        for k in range(3):
            key = keys[k]
            if place + len(key) > end:
                right = False
                break
            for i in range(len(key)):
                if text[place + i] != key[i]:
                    right = False
                    break
            if not right:
                break
            place += len(key)
            negative = place < end and text[place] == 45 and not whole
            if negative:
                place += 1
            digits, behind, value = 0, 0, 0
            while place < end and 48 <= text[place] <= 57 and digits <= MOST_DIGITS:
                value = 10 * value + int(text[place]) - 48
                digits += 1
                place += 1
            right = digits > 0
            if place < end and text[place] == 46 and not whole:
                place += 1
                while place < end and 48 <= text[place] <= 57 and digits <= MOST_DIGITS:
                    value = 10 * value + int(text[place]) - 48
                    digits += 1
                    behind += 1
                    place += 1
                right = right and behind > 0
            if not right or digits > MOST_DIGITS:
                right = False
                break
            power = 1.0
            for _ in range(behind):
                power *= 10.0
            number = float(value) / power  # both are exact, and so the quotient is rounded once
            rows[count, k] = -number if negative else number
        if not right or place >= end or text[place] != 34:
            break
        place += 1
        while place < end and (
            text[place] == 32 or text[place] == 9 or text[place] == 10 or text[place] == 13
        ):
            place += 1
        if place + 2 > end or text[place] != 47 or text[place + 1] != 62:
            break
        at = place + 2
        count += 1
    return at, rows[:count].copy()
