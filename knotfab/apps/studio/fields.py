"""The fields of the studio's page, which are options of a build, and the settings that they add up to."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

from knotfab.base.errors import OPTION
from knotfab.picture.fonts import list_families
from knotfab.pipeline.options import READERS, BuildOptions, options_from
from knotfab.pipeline.prepare import check_options
from knotfab.pipeline.values import as_text, read_seconds
from knotfab.scene.catalogue import materials, printers
from knotfab_formats.errors import InputError, KnotfabError

Value = str | int | float | bool
_LONGEST, _LONGEST_STROKES = 60, 20_000  # characters in a field; in those that brushes fill


# the labels of the options of `knotfab build` that the page sets; none of them names a file
FIELDS = {
    "width": "Width on the wall", "height": "Height on the wall", "lamp_distance": "Lamp to piece",
    "wall_distance": "Piece to wall", "lamp_diameter": "Lamp diameter", "tube_radius": "Tube radius",
    "depth": "Depth", "knots": "Knots", "knot": "Knot type", "free": "Pose and distances",
    "mount": "Mount", "printer": "Printer", "material": "Material", "accuracy": "Accuracy",
    "time_budget": "Time", "seed": "Seed", "print": "Check it against the printer",
    "colours": "A colour for each body", "accept": "Build it even if nobody would know it",
    "ink": "What is drawn", "invert": "Invert", "threshold": "Threshold", "crop": "Crop",
    "specks": "Specks",
    "smooth": "Smooth", "keep_largest": "Largest pieces", "thicken": "Thin strokes", "lines": "Lines",
    "lamps": "Lamps", "font": "Font",
}  # fmt: skip
# menus of names that options take as any text
_MENUS: dict[str, Callable[[], Iterable[str]]] = {
    "printer": printers, "material": materials, "font": cache(list_families), "free": lambda: ["view"],
    "lamps": lambda: ["rgb", "warm+cold", "switch"],
    "knot": lambda: (
        "unknot", "trefoil", "left trefoil", "figure-eight", "cinquefoil", "5_2", "8_19", "3_1#4_1",
    ),
}  # fmt: skip
# fields that belong to a picture; another one starts without them
READING = (
    "ink", "invert", "threshold", "crop", "specks", "smooth", "keep_largest",
    "thicken", "lines",
)  # fmt: skip
DEFAULTS: dict[str, Value] = {"print": True, "mount": "auto", "accuracy": "standard"}
_OTHER_WORDS = {"sequence": "Sequence", "size": "the longer side", "force": "", "out": ""}
_FLAGS = ("print", "invert", "colours", "sequence", "accept", "force")


def read_field(name: str, given: object) -> Value | None:
    """Read a field's content as a value of its option; None if it is empty.

    Raises:
        ValueError: it is wrong; the message is a sentence in the page's words.
    """
    if given is None or given is False:
        return None
    text = str(given).strip().lower() if isinstance(given, bool) else str(given).strip()
    if not text:
        return None
    longest = _LONGEST_STROKES if name in ("keep", "drop") else _LONGEST
    if len(text) > longest or not text.isprintable():
        raise ValueError(f"Give no more than {longest} letters and digits.")
    try:
        if name in _MENUS:
            if text not in _MENUS[name]():
                raise ValueError("This is not known. Choose another.")
            return text
        if name in READERS:
            on = {"true": True, "false": False}.get(text.lower())
            plain = text.removesuffix("px").strip()
            return as_field(READERS[name](plain if on is None else on))
        if name == "time_budget":
            return f"{read_seconds(text):g}s"
        if text.lower() not in ("true", "false"):
            raise ValueError("This is neither on nor off.")
        return text.lower() == "true"
    except InputError as error:
        why = error.why.replace("it is", "This is", 1)
        raise ValueError(f"{why[:1].upper()}{why[1:]}. {in_page_words(error.remedy)}") from None


def as_field(value: Any) -> Value:
    """Return a key's value as a field holds it: tuples as text, with commas or semicolons."""
    if not isinstance(value, tuple):
        held: Value = value
        return held
    return (
        ";".join(map(as_text, value)) if value and isinstance(value[0], tuple) else as_text(value)
    )


def in_page_words(sentence: str) -> str:
    """Replace the options in a sentence of the command line by the labels of the page's fields."""

    def label(found: re.Match[str]) -> str:
        name, value = found[1].replace("-", "_"), found[2]
        if name not in FIELDS and name not in _OTHER_WORDS:
            return found[0]
        named = FIELDS[name] if name in FIELDS else _OTHER_WORDS[name]
        if not value:
            return f"“{named}”"
        return f"“{named}” {value}" if name in _FLAGS else f"“{named}”: {value}"

    sentence = sentence.replace(" LEFT,TOP,WIDTH,HEIGHT", "")
    said = OPTION.sub(label, sentence.replace("--accept unrecognisable", "--accept"))
    return re.sub("such as “[^”]*”: ", "such as ", said)


class Settings:
    """The contents of the page's fields.

    `values` holds what is valid by itself, and `readings` the fields of pictures that are not chosen first.
    `wrong` holds the `text` of other fields and `why` it is wrong, or contradicts others.
    """

    def __init__(
        self,
        values: Mapping[str, Value] = DEFAULTS,
        readings: Mapping[str, dict[str, Value]] | None = None,
    ) -> None:
        self.values = {key: value for key, value in values.items() if key in FIELDS}
        self.readings = dict(readings or {})
        self.wrong: dict[str, dict[str, str]] = {}
        self._together = ""  # the field that is marked because it contradicts others

    def change(self, given: Mapping[str, Any]) -> bool:
        """Set the contents of fields; None or "" resets one. Returns whether any value has changed.

        Raises:
            InputError: there is no such field; nothing has changed.
        """
        for name, value in given.items():
            if name not in FIELDS or not isinstance(value, Value | None):
                what = f"the setting {name[:40]}"
                raise InputError(what, "there is none of that name", "Leave it out.")
        before = dict(self.values)
        for name, value in given.items():
            self.wrong.pop(name, None)
            try:
                read = read_field(name, value)
            except ValueError as error:
                self._mark(name, value, str(error))
                continue
            self.values.pop(name, None)
            if read is not None:
                self.values[name] = read
        return self.values != before

    def check(self, options: BuildOptions, changed: str, plain: Callable[[str], str]) -> None:
        """Mark the field that was `changed` last if the options contradict each other."""
        if self._together and self._together in self.wrong:
            del self.wrong[self._together]
        self._together = ""
        try:
            check_options(options)
        except KnotfabError as error:
            self._together = changed
            self._mark(changed, self.values.get(changed), plain(str(error)))

    def options(self, text: bool, sequence: bool) -> BuildOptions:
        """Return the options of a build, which include the font only for a `text`."""
        given: dict[str, Any] = {k: v for k, v in self.values.items() if k != "font" or text}
        return options_from({**given, "sequence": sequence})

    def pass_on(self, before: tuple[str, ...], after: tuple[str, ...]) -> None:
        """Store the reading fields with the pictures `before`, and load those of the first one `after`."""
        if before == after or not after:
            return
        kept = {key: self.values.pop(key) for key in READING if key in self.values}
        self.readings |= {name: kept for name in before}
        self.values |= self.readings.get(after[0], {})
        for key in READING:
            self.wrong.pop(key, None)

    def _mark(self, name: str, held: object, why: str) -> None:
        text = "" if held is None else str(held)[:60]
        self.wrong[name] = {"text": text, "why": why}
