"""The fonts of an SVG's text: those that it names where this machine has them, sans serif otherwise."""

from __future__ import annotations

import unicodedata
from xml.etree.ElementTree import Element

from knotfab.picture.fonts import find_family, find_font, supply_fonts
from knotfab.picture.svg.xml import SVG

_SANS, _SERIF, _MONO = "DejaVu Sans", "DejaVu Serif", "DejaVu Sans Mono"
_GENERIC = {
    **dict.fromkeys(("serif", "ui-serif", "math"), _SERIF),
    **dict.fromkeys(("monospace", "ui-monospace"), _MONO),
    **dict.fromkeys(("sans-serif", "ui-sans-serif", "system-ui", "inherit", "initial"), _SANS),
}
# categories that need no glyph: controls, separators, and marks, which a font may leave to shaping
_UNDRAWN = ("Cc", "Cf", "Mn", "Zl", "Zp", "Zs")


class TextFonts:
    """The families that the text of a drawing is drawn in; `notes` tell which replace others."""

    def __init__(self, root: Element) -> None:
        self.notes: dict[str, None] = {}
        self._files: dict[str, None] = {}
        self._texts = list(root.iter(f"{{{SVG}}}text"))
        parents = {child: parent for parent in root.iter() for child in parent}
        self._asked: set[Element] = set()  # elements whose family text may have
        for text in self._texts:
            self._asked.update(text.iter())
            at = parents.get(text)
            while at is not None and at not in self._asked:
                self._asked.add(at)
                at = parents.get(at)
        self._said = "".join("".join(text.itertext()) for text in self._texts)

    @property
    def needed(self) -> bool:
        """Whether the drawing has text."""
        return bool(self._said.strip())

    def choose(self, named: str, element: Element | None) -> str:
        """Return the family drawn for a list of families, of an element or of a style sheet (None)."""
        family = _SANS
        if element is None or element in self._asked:
            family, found = _choose(named)
            self._files.update(dict.fromkeys(found))
            first = named.split(",")[0].strip(" \"'")
            if first and family.lower() != first.lower() and first.lower() not in _GENERIC:
                self.notes[
                    f"its text is drawn in {family} instead of {first}, which this machine lacks "
                    "(turn it to paths in the editor to keep its look)"
                ] = None
        return family

    def list_files(self, what: str) -> tuple[str, ...]:
        """Return the files that the text needs, beside those that come along.

        Raises:
            InputError: no font of this machine has a character of the text; `what` names the picture.
        """
        for text in self._texts:
            for element in text.iter():
                style = element.get("style", "").replace(" ", "")
                rtl = element.get("direction") == "rtl" or "direction:rtl" in style
                if rtl and element.text and not len(element):
                    # resvg takes every line to begin at the left
                    element.text = f"\u2067{element.text}\u2069"
        supplied = (*self._files, *supply_fonts(None))
        for character in dict.fromkeys(self._said):
            if unicodedata.category(character) not in _UNDRAWN:
                path = find_font(character, supplied, what)
                if path not in supplied:
                    self._files[path] = None
        return tuple(self._files)


def _choose(named: str) -> tuple[str, tuple[str, ...]]:
    """Choose the first family of a list that there is, and its files where it does not come along."""
    for part in named.split(","):
        family = part.strip(" \"'")
        if family.lower() in _GENERIC:
            return _GENERIC[family.lower()], ()
        found = find_family(family)
        if found is not None:
            return family, found
    return _SANS, ()
