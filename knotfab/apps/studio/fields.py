"""The fields of the studio's page, which are options of a build, and the settings that they add up to."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any

from knotfab.base.errors import OPTION
from knotfab.design.frames import LONGER_FRAME_MM
from knotfab.picture.fonts import list_families
from knotfab.pipeline.options import READERS, BuildOptions, options_from
from knotfab.pipeline.values import as_text
from knotfab.scene.catalogue import materials, printers
from knotfab_formats.errors import InputError

Value = str | int | float | bool
_LONGEST = 60  # characters in a field


# the labels of the options of `knotfab build` that the page sets; none of them names a file
FIELDS = {
    "size": "Longer side on the wall", "lamp_distance": "Lamp to piece", "wall_distance": "Piece to wall",
    "mount": "Mount", "plate": "Plate", "supports": "Supports", "printer": "Printer",
    "material": "Material", "accuracy": "Accuracy", "print": "Check it against the printer",
    "accept": "Build it even if nobody would know it", "ink": "What is drawn", "crop": "Crop",
    "smooth": "Smooth", "lines": "Lines", "lamps": "Lamps", "font": "Font",
}  # fmt: skip
# menus of names that options take as any text
_MENUS: dict[str, Callable[[], Iterable[str]]] = {
    "printer": printers, "material": materials, "font": cache(list_families),
    "lamps": lambda: ["rgb", "warm+cold"],
}  # fmt: skip
# fields that belong to a picture: another one starts without them
READING = ("ink", "crop", "smooth", "lines")
_FLAGS = ("print", "accept")
_OPTIONS = {field.name.strip("_") for field in fields(BuildOptions)}
DEFAULTS: dict[str, Value] = {"print": True, "mount": "auto", "accuracy": "standard"}


def usual_numbers() -> dict[str, float]:
    """Return the numbers that a build takes where fields are empty."""
    keys = {name: READERS[name].args for name in FIELDS if name in READERS}
    found = {name: model.model_fields[key].default for name, (model, key) in keys.items()}
    numbers = {name: value for name, value in found.items() if isinstance(value, float)}
    return {"size": LONGER_FRAME_MM, **numbers}


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
    if len(text) > _LONGEST or not text.isprintable():
        raise ValueError(f"Give no more than {_LONGEST} letters and digits.")
    try:
        if name in _MENUS:
            if text not in _MENUS[name]():
                raise ValueError("This is not known. Choose another.")
            return text
        if name in READERS:
            on = {"true": True, "false": False}.get(text.lower())
            plain = text.removesuffix("px").strip()
            return as_field(READERS[name](plain if on is None else on))
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
    """Replace the options in a sentence of the command line by the labels of the page's fields.

    Options that the page does not have are called the command line's.
    """

    def label(found: re.Match[str]) -> str:
        name, value = found[1].replace("-", "_"), found[2]
        if name not in FIELDS:
            return f"{found[0]} of the command line" if name in _OPTIONS else found[0]
        if not value:
            return f"“{FIELDS[name]}”"
        return f"“{FIELDS[name]}” {value}" if name in _FLAGS else f"“{FIELDS[name]}”: {value}"

    sentence = sentence.replace(" LEFT,TOP,WIDTH,HEIGHT", "")
    said = OPTION.sub(label, sentence.replace("--accept unrecognisable", "--accept"))
    return re.sub("such as “[^”]*”: ", "such as ", said)


class Settings:
    """The contents of the page's fields.

    `values` holds what is valid by itself; `wrong` the `text` of other fields and `why` it is wrong.
    """

    def __init__(self, values: Mapping[str, Value] = DEFAULTS) -> None:
        self.values = {key: value for key, value in values.items() if key in FIELDS}
        self.wrong: dict[str, dict[str, str]] = {}

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

    def options(self, text: bool) -> BuildOptions:
        """Return the options of a build, which include the font only for a `text`."""
        given: dict[str, Any] = {k: v for k, v in self.values.items() if k != "font" or text}
        return options_from(given)

    def forget_reading(self) -> None:
        """Reset the fields of a picture, before another one is read."""
        for key in READING:
            self.values.pop(key, None)
            self.wrong.pop(key, None)

    def _mark(self, name: str, held: object, why: str) -> None:
        text = "" if held is None else str(held)[:60]
        self.wrong[name] = {"text": text, "why": why}
