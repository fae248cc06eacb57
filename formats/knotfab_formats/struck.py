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
_WIRE = "Print the piece, or take centre lines for bending from knots.json"
_NO_WIRE = {"wire_diameter_mm": 0.0, "tool_radius_mm": 0.0, "min_straight_mm": 0.0}
_NO_WIRE |= {"max_bend_deg": 175.0, "springback_percent": 0.0}
_ALSO = "Convert part.stl by trimesh or CAD, take centre lines from knots.json, and G-code from the slicer"
_SUBJECT = (
    "Lift the subject out first, as a phone or rembg does in one tap, and bring the PNG with transparency; "
    "a mask that knotfab 1 wrote, subject-NAME.png, is read as a picture of its own with --ink light"
)
_ROUND = "Throw the picture on a flat wall, or on a tilted one (wall_tilt_deg)"
_ADVISED = "Leave it out: it changed no file, and only the report told of it"
_MOVED = "Move the lamp as compare says, or build the piece again with the --lamp-distance at which it stands"
OPTIONS: dict[str, Struck] = {
    "--also": Struck(_ALSO),
    "--tone": Struck(_GREYS, nothing=("off",)),
    "--subject": Struck(_SUBJECT, nothing=("none",)),
    "--keep": Struck(_SUBJECT),
    "--drop": Struck(_SUBJECT),
    "--bender": Struck(_WIRE, nothing=("lra",)),
    "tradeoff --device": Struck("Leave it out: the search runs on the CPU", nothing=("cpu",)),
    "tradeoff --repeats": Struck("Give the call several folders by --out", nothing=("1",)),
    "tradeoff --jobs": Struck("Builds go one after another, as they are timed", nothing=("1",)),
    "tradeoff --combinations": Struck(
        "Turn keys of [search] together by --scene", nothing=("0", "16")
    ),
    "compare --fix": Struck(_MOVED, flag=True),
    "compare --build": Struck(_MOVED, flag=True),
    "--watch": Struck("Use knotfab studio, which shows a build as it grows.", flag=True),
}
"""Options of the command line by name ("COMMAND --name" if only one command lost it); for callers of the
library, without hyphens."""
KEYS: dict[tuple[str, str], Struck] = {
    ("views", "tone"): Struck(_GREYS, nothing=("off",)),
    ("views", "subject_px"): Struck(_SUBJECT, nothing=("none",)),
    ("views", "keep_px"): Struck(_SUBJECT, nothing=([],)),
    ("views", "drop_px"): Struck(_SUBJECT, nothing=([],)),
    ("views", "subject_mask"): Struck(_SUBJECT, nothing=("",)),
    ("pose", "plates"): Struck(
        "Build with a smaller --size or for another --printer, or cut part.3mf in the slicer",
        nothing=([],),
    ),
    ("piece", "bender"): Struck(_WIRE, nothing=("lra",)),
    **{("material", key): Struck(_WIRE, nothing=(value,)) for key, value in _NO_WIRE.items()},
    ("search", "grace_of"): Struck("Leave it out", nothing=("curves",)),
    ("effects", "contrast"): Struck(_ADVISED, ("auto", "off")),
    ("effects", "hiding"): Struck(_ADVISED, ("auto", "off")),
    ("effects", "wall"): Struck(_ROUND, ("auto", "off")),
    ("material", "transmittance_per_mm"): Struck(_ADVISED, (0,)),
    ("room", "second_lamp_mm"): Struck(_ADVISED, ("none",)),
    ("room", "second_lamp_share"): Struck(_ADVISED, (1,)),
    ("views", "wall_radius_mm"): Struck(_ROUND, ("flat",)),
}
"""Keys of scene.toml by table and name; the name "" stands for a whole table."""
VALUES: dict[tuple[str, str], dict[str, Struck]] = {
    ("material", "process"): {"wire": Struck(_WIRE)},
    ("material", "name"): {
        name: Struck(_WIRE) for name in ("steel-wire-2mm", "aluminium-wire-2mm")
    },
}
"""Values of keys that are still there, by table and name."""
COMMANDS: dict[str, Struck] = {
    "mcp": Struck("Call `knotfab preview --json` and `knotfab build --events -`, or the library.")
}


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
        gone = OPTIONS.get(name) or OPTIONS.get(f"{arguments[0]} {name}")
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
        InputError: an old key or value asks for something.
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
    for table, key in VALUES:
        for part in _as_list(found.get(table)):
            if isinstance(part, dict) and key in part:
                what_ = f"{what}: [{table}] {key} = {part[key]!r}"
                refuse_value(table, key, part[key], what_)
    return found


def refuse_value(table: str, key: str, value: Any, what: str) -> None:
    """Refuse a value that is gone, of a key that is not.

    Raises:
        InputError: it is one.
    """
    gone = VALUES.get((table, key), {})
    if isinstance(value, str) and value in gone:
        raise _gone(what, gone[value])


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _gone(what: str, gone: Struck) -> InputError:
    return InputError(what, "knotfab 2 does not have it", gone.instead)
