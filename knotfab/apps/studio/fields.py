"""The settings of a studio: those that hold, those of pictures that wait, and fields that are wrong."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from knotfab.base.errors import OPTION, read_length, read_number
from knotfab.picture.fonts import list_families
from knotfab.pipeline.options import BuildOptions, options_from
from knotfab.pipeline.prepare import check_options
from knotfab.pipeline.read_options import read_seconds
from knotfab.scene.catalogue import materials, printers
from knotfab_formats.errors import InputError, KnotfabError

# The fields of the page: what a person may write into each, and what is said where it is wrong.


Value = str | int | float | bool
_LONGEST, _LONGEST_STROKES = 60, 20_000  # characters that a field holds; of what brushes paint


@dataclass(frozen=True)
class _Field:
    """An option of `knotfab build` that the page sets: its label there, and how what is written is read."""

    label: str
    read: Callable[[str], Value]


def _length(text: str, least: float, most: float, words: tuple[str, ...] = ()) -> Value:
    """Return millimetres of a length with any usual unit, or one of the words."""
    if text in words:
        return text
    example = f"Give one such as {_round(max(2.0, least))} mm"
    value = read_length("", text, f"{example}{''.join(f', or {word}' for word in words)}.")
    if not least <= value <= most:
        raise ValueError(f"Give {_round(least)} to {_round(most)} mm.")
    value = float(f"{value:.6g}")
    return int(value) if value.is_integer() else value


def _share(text: str) -> Value:
    value = read_number("", text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    if not 0 < value < 1:
        raise ValueError("Give a share between 0 and 1, such as 0.4.")
    return value


def _count(text: str, least: int, most: int) -> Value:
    value = read_number("", text)
    if value % 1 or not least <= value <= most:
        raise ValueError(f"Give a whole number from {least} to {most:,}.".replace(",", " "))
    return int(value)


def _pixels(text: str) -> Value:
    value = read_number("", text.removesuffix("px"))
    if not 0 <= value <= 100:
        raise ValueError("Give 0 to 100 pixels of the picture.")
    return value


def _crop(text: str) -> Value:
    plain = re.sub(r"[\s,;]+", ",", text.strip("()[] "))
    parts = plain.split(",")
    if plain in ("auto", "none"):
        return plain
    if len(parts) != 4 or not all(p.isdecimal() and len(p) < 6 for p in parts) or "0" in parts[2:]:
        raise ValueError(
            "Drag a rectangle, or give left, top, width and height in px: 20, 40, 600, 400."
        )
    return ",".join(str(int(p)) for p in parts)


def _subject(text: str) -> Value:
    value = _crop(text)
    if value in ("auto", "none"):
        raise ValueError("Drag a rectangle about the subject, or leave it empty.")
    return value


def _discs(text: str) -> Value:
    """Return discs as x,y,radius, semicolons between them, as brushes paint them."""
    discs = [disc.split(",") for disc in text.replace(" ", "").split(";")]
    if not all(len(d) == 3 and all(p.isdecimal() and len(p) < 6 for p in d) for d in discs):
        raise ValueError("Give discs as x, y and radius in px: 320,240,12; 350,240,12.")
    return ";".join(",".join(str(int(p)) for p in disc) for disc in discs)


def _time(text: str) -> Value:
    try:
        seconds = read_seconds(text)
    except InputError as error:
        raise InputError("", error.why, "Give a time such as 90 s or 1.5 min.") from None
    if not 2 <= seconds <= 7 * 86400:
        raise ValueError("Give a time from 2 s to a week.")
    return f"{seconds:g}s"


def _flag(text: str) -> Value:
    if text not in ("true", "false"):
        raise ValueError("This is neither on nor off.")
    return text == "true"


def _one_of(text: str, known: Callable[[], Mapping[str, Any]] | Mapping[str, Any]) -> Value:
    names = known() if callable(known) else known
    if text not in names:
        raise ValueError("This is not known. Choose another.")
    return text


def _ink(text: str) -> Value:
    from PIL import ImageColor

    if text in ("auto", "dark", "light", "alpha", "flood"):
        return text
    try:
        return "#{:02x}{:02x}{:02x}".format(*ImageColor.getrgb(text)[:3])
    except ValueError:
        raise ValueError("This is no colour. Give one such as red or #d02010.") from None


def _choice(*words: str) -> Callable[[str], Value]:
    return partial(_one_of, known=dict.fromkeys(words))


def _round(value: float) -> str:
    return f"{value:,.6g}".replace(",", " ") if value >= 10_000 else f"{value:g}"


@cache
def _families() -> dict[str, None]:
    return dict.fromkeys(list_families())


_KNOTS = (
    "unknot",
    "trefoil",
    "left trefoil",
    "figure-eight",
    "cinquefoil",
    "5_2",
    "8_19",
    "3_1#4_1",
)
_far = partial(_length, least=1.0, most=100_000.0)
_wide = partial(_length, least=5.0, most=10_000.0)
# the options of `knotfab build` that the page sets; none of them names a file
FIELDS: dict[str, _Field] = {
    "width": _Field("Width on the wall", _wide),
    "height": _Field("Height on the wall", _wide),
    "lamp_distance": _Field("Lamp to piece", _far),
    "wall_distance": _Field("Piece to wall", partial(_length, least=1.0, most=10_000.0)),
    "lamp_diameter": _Field("Lamp diameter", partial(_length, least=0.0, most=1000.0)),
    "tube_radius": _Field("Tube radius", partial(_length, least=0.1, most=200.0, words=("auto",))),
    "depth": _Field("Depth", partial(_length, least=0.5, most=5000.0, words=("auto", "flat"))),
    "knots": _Field("Knots", _choice("auto", "1")),
    "knot": _Field("Knot type", _choice(*_KNOTS)),
    "free": _Field("Pose and distances", _choice("view")),
    "mount": _Field("Mount", _choice("auto", "wall", "stand", "hang", "none")),
    "printer": _Field("Printer", partial(_one_of, known=printers)),
    "material": _Field("Material", partial(_one_of, known=materials)),
    "accuracy": _Field("Accuracy", _choice("sketch", "draft", "standard", "fine")),
    "time_budget": _Field("Time", _time),
    "seed": _Field("Seed", partial(_count, least=0, most=2**31 - 1)),
    "print": _Field("Check it against the printer", _flag),
    "colours": _Field("A colour for each body", _flag),
    "accept": _Field("Build it even if nobody would know it", _choice("unrecognisable")),
    "ink": _Field("What is drawn", _ink),
    "invert": _Field("Invert", _flag),
    "threshold": _Field("Threshold", _share),
    "crop": _Field("Crop", _crop),
    "subject": _Field("Subject", _subject),
    "keep": _Field("Belongs to it", _discs),
    "drop": _Field("Does not belong", _discs),
    "specks": _Field("Specks", partial(_count, least=0, most=10_000_000)),
    "smooth": _Field("Smooth", _pixels),
    "keep_largest": _Field("Largest pieces", partial(_count, least=0, most=10_000)),
    "thicken": _Field("Thin strokes", partial(_length, least=0.1, most=100.0, words=("auto",))),
    "lines": _Field("Lines", _choice("auto", "on", "off")),
    "tone": _Field("Shading", _choice("lines", "off")),
    "lamps": _Field("Lamps", _choice("rgb", "warm+cold", "switch")),
    "font": _Field("Font", partial(_one_of, known=_families)),
}  # fmt: skip
# fields on reading a picture: these go with the picture, and another one begins without them
READING = (
    "ink", "invert", "threshold", "crop", "subject", "keep", "drop", "specks", "smooth", "keep_largest",
    "thicken", "lines", "tone",
)  # fmt: skip
DEFAULTS: dict[str, Value] = {"print": True, "mount": "auto", "accuracy": "standard"}
_OTHER_WORDS = {"sequence": "Sequence", "size": "the longer side", "force": "", "out": ""}
_FLAGS = ("print", "invert", "colours", "sequence", "accept", "force")


def read_field(name: str, given: object) -> Value | None:
    """Read a field as the option takes it; None where it is left empty.

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
    try:
        return FIELDS[name].read(lower)
    except InputError as error:
        why = error.why.replace("it is", "This is", 1)
        raise ValueError(f"{why[:1].upper()}{why[1:]}. {in_page_words(error.remedy)}") from None


def in_page_words(sentence: str) -> str:
    """Return a sentence of the command line as the page says it: the labels of fields instead of options."""

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

    `values` are right, each by itself; `readings` are how pictures are read that are not the first chosen.
    `wrong` are the fields that hold something else, or do not go together: their `text`, and `why`.
    """

    def __init__(
        self,
        values: Mapping[str, Value] = DEFAULTS,
        readings: Mapping[str, dict[str, Value]] | None = None,
    ) -> None:
        self.values = {key: value for key, value in values.items() if key in FIELDS}
        self.readings = dict(readings or {})
        self.wrong: dict[str, dict[str, str]] = {}
        self._together = ""  # the field that is marked because all together are refused

    def change(self, given: Mapping[str, Any]) -> bool:
        """Take what fields hold now; None or "" takes a setting back. Returns whether any has changed.

        Raises:
            InputError: there is no such setting; nothing has changed.
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
        """Mark the field that was `changed` last where each is right by itself and all together are not."""
        if self._together and self._together in self.wrong:
            del self.wrong[self._together]
        self._together = ""
        try:
            check_options(options)
        except KnotfabError as error:
            self._together = changed
            self._mark(changed, self.values.get(changed), plain(str(error)))

    def options(self, text: bool, sequence: bool) -> BuildOptions:
        """Return the options of a build of such pictures."""
        given: dict[str, Any] = {k: v for k, v in self.values.items() if k != "font" or text}
        strokes = {key: given.pop(key) for key in ("keep", "drop") if key in given}
        if "subject" in given:  # without it discs correct nothing
            given |= {key: tuple(discs.split(";")) for key, discs in strokes.items()}
        return options_from({**given, "sequence": sequence})

    def pass_on(self, before: tuple[str, ...], after: tuple[str, ...]) -> None:
        """Keep the settings of reading with their pictures, and take those of the new first one."""
        if before == after or not after:
            return
        kept = {key: self.values.pop(key) for key in READING if key in self.values}
        self.readings |= {name: kept for name in before}
        self.values |= self.readings.get(after[0], {})
        for key in READING:
            self.wrong.pop(key, None)

    def _mark(self, name: str, held: object, why: str) -> None:
        text = "" if held is None else str(held)[:60]  # characters quoted of a wrong field
        self.wrong[name] = {"text": text, "why": why}
