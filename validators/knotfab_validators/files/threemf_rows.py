"""Rows of three numbers in a 3MF's usual notation, which numpy parses at once."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = {"vertices": (b"vertex", b"x y z"), "triangles": (b"triangle", b"v1 v2 v3")}
TAG = re.compile(b"<(" + "|".join(KINDS).encode() + b")>")
MOST_TAGS = 100_000  # blocks of rows beyond this many are left in the text
NUMBERS = b"0123456789.- \t\r\n"


@dataclass(frozen=True)
class Rows:
    """The numbers (n, 3) of the rows between the tags of `kind`; whole ones for triangles."""

    kind: str
    numbers: NDArray[Any]


def cut_rows(text: bytes) -> tuple[bytes, dict[int, Rows]]:
    """Cut the rows that numpy can parse out of the text; return the rest, and the rows by their tag's offset.

    Rows are `<vertex x="1.5" y="-2" z="0" />` within <vertices>, and `<triangle v1="0" v2="1"
    v3="2"/>` within <triangles>: plain decimals, no other attributes. If anything else stands
    between two such tags, all rows between them stay in the text.
    """
    kept: list[bytes] = []
    found: dict[int, Rows] = {}
    begin = length = at = 0
    for _ in range(MOST_TAGS):
        if (tag := TAG.search(text, at)) is None:
            break
        kind, at = tag[1].decode(), tag.end()
        end = text.find(b"</" + tag[1] + b">", at)
        numbers = _read_rows(text[at:end], kind) if end >= 0 else None
        if numbers is not None:
            kept.append(text[begin:at])
            found[length + tag.start() - begin] = Rows(kind, numbers)
            length += at - begin
            begin = at = end
    return b"".join([*kept, text[begin:]]), found


def _read_rows(rows: bytes, kind: str) -> NDArray[Any] | None:
    """Parse the numbers (n, 3) of rows; None if there is anything else."""
    element, keys = KINDS[kind]
    first, second, third = keys.split()
    count = rows.count(b"<")
    shape = b'<%s%s=""%s=""%s=""/>' % (element, first, second, third)
    if rows.translate(None, NUMBERS) != shape.translate(None, NUMBERS) * count:
        return None
    rows = rows.replace(b'<%s %s="' % (element, first), b"")
    for between in (b'" %s="' % second, b'" %s="' % third, b'"/>', b'" />'):
        rows = rows.replace(between, b",")
    with warnings.catch_warnings(action="ignore"):  # old numpy warns where new numpy raises
        try:
            number = np.float64 if kind == "vertices" else np.int64
            numbers: NDArray[Any] = np.fromstring(rows.rstrip()[:-1], number, sep=",")
        except ValueError:
            return None
    return numbers.reshape(-1, 3) if len(numbers) == 3 * count else None
