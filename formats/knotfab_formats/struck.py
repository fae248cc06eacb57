"""Words of knotfab 1 that version 2 no longer has, each with what to do instead. They go with version 3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from knotfab_formats.errors import InputError


class Struck(NamedTuple):
    """A word that version 2 no longer has."""

    instead: str
    """One sentence with the way out."""
    nothing: tuple[Any, ...] = ()
    """Values that asked for nothing: with one of these the word is read past."""
    flag: bool = False
    """Whether the option takes no value."""


_GREYS = (
    "Draw the picture as dark strokes on white, and lay one tube along each with lines (--lines on)"
)
OPTIONS: dict[str, Struck] = {"--tone": Struck(_GREYS, nothing=("off",))}
"""Options of the command line by name; for callers of the library, without hyphens."""
KEYS: dict[tuple[str, str], Struck] = {("views", "tone"): Struck(_GREYS, nothing=("off",))}
"""Keys of scene.toml by table and name; the name "" stands for a whole table."""
COMMANDS: dict[str, Struck] = {}


def refuse_command(arguments: Sequence[str]) -> None:
    """Refuse a call of a command that is gone.

    Raises:
        InputError: it is one.
    """
    if arguments and (gone := COMMANDS.get(arguments[0])):
        raise _gone(f"knotfab {arguments[0]}", gone)


def pass_options(arguments: Sequence[str]) -> list[str]:
    """Return the arguments without old options that asked for nothing.

    Raises:
        InputError: an old option asked for something.
    """
    left: list[str] = []
    rest = list(arguments)
    while rest:
        word = rest.pop(0)
        if word == "--":
            return [*left, word, *rest]
        name, given, value = word.partition("=")
        gone = OPTIONS.get(name)
        if gone is None:
            left.append(word)
            continue
        if not given and not gone.flag and rest:
            value = rest.pop(0)
        if value not in gone.nothing:
            raise _gone(name, gone)
    return left


def pass_given(given: Mapping[str, Any]) -> dict[str, Any]:
    """Do what `pass_options` does for options given by name, as in `knotfab.build(..., tone="off")`."""
    left = dict(given)
    for name in given:
        gone = OPTIONS.get("--" + name.rstrip("_").replace("_", "-"))
        if gone and left.pop(name) not in (None, False, (), *gone.nothing):
            raise _gone(f"the option {name}", gone)
    return left


def pass_keys(raw: Mapping[str, Any], what: str) -> dict[str, Any]:
    """Return the content of a scene.toml without old keys that asked for nothing.

    Raises:
        InputError: an old key asks for something.
    """
    found = dict(raw)
    for (table, key), gone in KEYS.items():
        if table not in found:
            continue
        if not key:
            if found.pop(table) not in gone.nothing:
                raise _gone(f"{what}: [{table}]", gone)
            continue
        here = found[table]
        parts = [dict(p) if isinstance(p, dict) else p for p in _as_list(here)]
        for part in parts:
            if isinstance(part, dict) and key in part and part.pop(key) not in gone.nothing:
                raise _gone(f"{what}: [{table}] {key}", gone)
        found[table] = parts if isinstance(here, list) else parts[0]
    return found


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _gone(what: str, gone: Struck) -> InputError:
    return InputError(what, "knotfab 2 does not have it", gone.instead)
