"""Errors that a user can act on: each names the thing, the reason and the remedy (docs/contract.md)."""

from __future__ import annotations

import re

__all__ = ["InputError", "KnotfabError", "short", "shown", "spelled"]

_MOST_SHOWN = 600  # characters quoted of the subject of a sentence
_MOST_QUOTED = 80  # characters quoted of a file, in a sentence about it


def shown(text: object) -> str:
    """A text for a line: bytes that are no UTF-8, and signs that steer a terminal, as their numbers."""
    signs = [
        c
        if c.isprintable()
        else f"\\x{ord(c) - 0xDC00:02x}"
        if "\udc80" <= c <= "\udcff"
        else repr(c)[1:-1]
        for c in str(text)
    ]
    plain = "".join(signs)
    return plain if len(plain) <= _MOST_SHOWN else f"{plain[:_MOST_SHOWN]} …"


def short(thing: object) -> str:
    """Quote a file in a sentence: on one line, and cut where it is long."""
    try:
        text = thing if isinstance(thing, str) else str(thing)
    except (ValueError, RecursionError):  # a number of thousands of digits; lists in lists
        return "something too long to be shown"
    shown = text[: _MOST_QUOTED + 1]
    shown = "".join(c if c.isprintable() else "?" for c in shown)
    return shown if len(text) <= _MOST_QUOTED else shown[:_MOST_QUOTED] + "..."


def spelled(text: str) -> str:
    """A text that any encoding of Unicode holds: bytes of a name that are no UTF-8 as their numbers."""
    return re.sub("[\ud800-\udfff]", lambda found: shown(found[0]), text)


class KnotfabError(Exception):
    """Base of every error knotfab raises on purpose; `exit_code` follows the contract."""

    exit_code = 2

    def __init__(self, what: str, why: str, remedy: str) -> None:
        self.what, self.why, self.remedy = shown(what), why, remedy
        # a remedy that ends in a command or a path keeps what can be copied
        stop = "" if ": " in remedy or not remedy[-1:].isalnum() else "."
        about = f"{self.what}: " if what else ""
        super().__init__(f"{about}{why}. {remedy}{stop}")


class InputError(KnotfabError):
    """The picture, the scene file or the call is wrong."""

    exit_code = 2
