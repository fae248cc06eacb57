"""The settings of a studio: those that hold, those of pictures that wait, and fields that are wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from knotfab.base.errors import InputError, KnotfabError
from knotfab.options import BuildOptions, options_from
from knotfab.prepare import check_options
from knotfab.studio.fields import DEFAULTS, FIELDS, READING, Value, read_field

__all__ = ["Settings"]


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
