"""Errors that a user can act on: each names the thing, the reason and the remedy (docs/contract.md)."""

from __future__ import annotations

import re

__all__ = ["InputError", "KnotfabError", "short", "shown", "spelled"]


def shown(thing: object, most: int = 600) -> str:
    """Quote on one line: bytes that are no UTF-8, and signs that steer a terminal, as their numbers.

    Args:
        most: characters; what is longer is cut.
    """
    try:
        text = str(thing)
    except (ValueError, RecursionError):  # a number of thousands of digits; lists in lists
        return "something too long to be shown"
    signs = [
        c
        if c.isprintable()
        else f"\\x{ord(c) - 0xDC00:02x}"
        if "\udc80" <= c <= "\udcff"
        else repr(c)[1:-1]
        for c in text[: most + 1]
    ]
    plain = "".join(signs)
    return plain if len(plain) <= most else f"{plain[:most]} …"


def short(thing: object) -> str:
    """Quote what a file holds, in a sentence about that file."""
    return shown(thing, 80)


def spelled(text: str) -> str:
    """Give a text that any encoding of Unicode holds: bytes of a name that are no UTF-8 as their numbers."""
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
