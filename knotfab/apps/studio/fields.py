"""The fields of the studio's page: how their text is read, and the settings that they add up to."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from knotfab.base.errors import OPTION, read_length, read_number
from knotfab.picture.fonts import list_families
from knotfab.pipeline.options import BuildOptions, options_from
from knotfab.pipeline.prepare import check_options
from knotfab.pipeline.read_options import read_option, read_seconds
from knotfab.scene.catalogue import materials, printers
from knotfab_formats.errors import InputError, KnotfabError

Value = str | int | float | bool
_LONGEST, _LONGEST_STROKES = 60, 20_000  # characters in a field; in those that brushes fill


@dataclass(frozen=True)
class _Field:
    """An option of `knotfab build` that the page sets.

    Without `read` its text is read as on the command line; `hint` then replaces the remedy.
    """

    label: str
    read: Callable[[str], Value] | None = None
    hint: str = ""


def _read_length(text: str, least: float, most: float, words: tuple[str, ...] = ()) -> Value:
    if text in words:
        return text
    example = f"Give one such as {_round(max(2.0, least))} mm"
    value = read_length("", text, f"{example}{''.join(f', or {word}' for word in words)}.")
    if not least <= value <= most:
        raise ValueError(f"Give {_round(least)} to {_round(most)} mm.")
    value = float(f"{value:.6g}")
    return int(value) if value.is_integer() else value


def _read_time(text: str) -> Value:
    try:
        seconds = read_seconds(text)
    except InputError as error:
        raise InputError("", error.why, "Give a time such as 90 s or 1.5 min.") from None
    if not 2 <= seconds <= 7 * 86400:
        raise ValueError("Give a time from 2 s to a week.")
    return f"{seconds:g}s"


def _read_flag(text: str) -> Value:
    if text not in ("true", "false"):
        raise ValueError("This is neither on nor off.")
    return text == "true"


def _choose(text: str, known: Callable[[], Iterable[str]] | Iterable[str]) -> Value:
    if text not in (known() if callable(known) else known):
        raise ValueError(_MENU)
    return text


def _read_as_option(name: str, text: str) -> Value:
    """Read a field's text as the command line reads the option, but more liberally in units and commas."""
    if name in ("keep", "drop"):
        given: Any = tuple(text.split(";"))
    elif name in ("crop", "subject"):
        given = re.sub(r"[\s,;]+", ",", text.strip("()[] "))
    elif name == "threshold" and text.endswith("%"):
        given = read_number("", text[:-1]) / 100
    else:
        given = text.removesuffix("px").strip()
    value = read_option(name, given)
    if name == "seed" and value > _MOST_SEED:
        raise ValueError(FIELDS[name].hint)
    return as_text(value)


def as_text(value: Any) -> Value:
    """Return a key's value as a field holds it: tuples as text, with commas or semicolons."""
    if not isinstance(value, tuple):
        held: Value = value
        return held
    return (";" if isinstance(value[0], tuple) else ",").join(str(as_text(one)) for one in value)


def _choice(*words: str) -> Callable[[str], Value]:
    return partial(_choose, known=words)


def _round(value: float) -> str:
    return f"{value:,.6g}".replace(",", " ") if value >= 10_000 else f"{value:g}"


_MOST_SEED = 2**31 - 1
_KNOTS = (
    "unknot", "trefoil", "left trefoil", "figure-eight", "cinquefoil", "5_2", "8_19", "3_1#4_1",
)  # fmt: skip
_far = partial(_read_length, least=1.0, most=100_000.0)
_wide = partial(_read_length, least=5.0, most=10_000.0)
_MENU = "This is not known. Choose another."
_DISCS = "Give discs as x, y and radius in px: 320,240,12; 350,240,12."
# the options of `knotfab build` that the page sets; none of them names a file
FIELDS: dict[str, _Field] = {
    "width": _Field("Width on the wall", _wide),
    "height": _Field("Height on the wall", _wide),
    "lamp_distance": _Field("Lamp to piece", _far),
    "wall_distance": _Field("Piece to wall", partial(_read_length, least=1.0, most=10_000.0)),
    "lamp_diameter": _Field("Lamp diameter", partial(_read_length, least=0.0, most=1000.0)),
    "tube_radius": _Field("Tube radius", partial(_read_length, least=0.1, most=200.0, words=("auto",))),
    "depth": _Field("Depth", partial(_read_length, least=0.5, most=5000.0, words=("auto", "flat"))),
    "knots": _Field("Knots", _choice("auto", "1")),
    "knot": _Field("Knot type", _choice(*_KNOTS)),
    "free": _Field("Pose and distances", _choice("view")),
    "mount": _Field("Mount", hint=_MENU),
    "printer": _Field("Printer", partial(_choose, known=printers)),
    "material": _Field("Material", partial(_choose, known=materials)),
    "accuracy": _Field("Accuracy", hint=_MENU),
    "time_budget": _Field("Time", _read_time),
    "seed": _Field("Seed", hint="Give a whole number from 0 to 2 147 483 647."),
    "print": _Field("Check it against the printer", _read_flag),
    "colours": _Field("A colour for each body", _read_flag),
    "accept": _Field("Build it even if nobody would know it", hint=_MENU),
    "ink": _Field("What is drawn"),
    "invert": _Field("Invert", _read_flag),
    "threshold": _Field("Threshold", hint="Give a share between 0 and 1, such as 0.4."),
    "crop": _Field(
        "Crop", hint="Drag a rectangle, or give left, top, width and height in px: 20, 40, 600, 400."
    ),
    "subject": _Field("Subject", hint="Drag a rectangle about the subject, or leave it empty."),
    "keep": _Field("Belongs to it", hint=_DISCS),
    "drop": _Field("Does not belong", hint=_DISCS),
    "specks": _Field("Specks", hint="Give a whole number of pixels, such as 200."),
    "smooth": _Field("Smooth"),
    "keep_largest": _Field("Largest pieces", hint="Give a whole number from 1, such as 3."),
    "thicken": _Field("Thin strokes", partial(_read_length, least=0.1, most=100.0, words=("auto",))),
    "lines": _Field("Lines", hint=_MENU),
    "lamps": _Field("Lamps", _choice("rgb", "warm+cold", "switch")),
    "font": _Field("Font", partial(_choose, known=cache(list_families))),
}  # fmt: skip
# fields that belong to a picture; another one starts without them
READING = (
    "ink", "invert", "threshold", "crop", "subject", "keep", "drop", "specks", "smooth", "keep_largest",
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
    lower = text if name in ("font", "knot", "printer", "material") else text.lower()
    field = FIELDS[name]
    try:
        return _read_as_option(name, lower) if field.read is None else field.read(lower)
    except InputError as error:
        if field.hint:
            raise ValueError(field.hint) from None
        why = error.why.replace("it is", "This is", 1)
        raise ValueError(f"{why[:1].upper()}{why[1:]}. {in_page_words(error.remedy)}") from None


def in_page_words(sentence: str) -> str:
    """Replace the options in a sentence of the command line by the labels of the page's fields."""

    def label(found: re.Match[str]) -> str:
        name, value = found[1].replace("-", "_"), found[2]
        if name not in FIELDS and name not in _OTHER_WORDS:
            return found[0]
        named = FIELDS[name].label if name in FIELDS else _OTHER_WORDS[name]
        if not value:
            return f"“{named}”"
        return f"“{named}” {value}" if name in _FLAGS else f"“{named}”: {value}"

    for placeholder in (" LEFT,TOP,WIDTH,HEIGHT", " X,Y,RADIUS", " X,Y,R"):
        sentence = sentence.replace(placeholder, "")
    return OPTION.sub(label, sentence.replace("--accept unrecognisable", "--accept"))


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
        strokes = {key: given.pop(key) for key in ("keep", "drop") if key in given}
        if "subject" in given:  # without it discs correct nothing
            given |= {key: tuple(discs.split(";")) for key, discs in strokes.items()}
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
