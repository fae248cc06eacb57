"""The fonts of an SVG's text: those that it names where this machine has them, sans serif otherwise."""

from __future__ import annotations

import unicodedata
from xml.etree.ElementTree import Element

from knotfab.picture.fonts import find_family, find_font, supply_fonts
from knotfab.picture.svg.style import Styles
from knotfab.picture.svg.xml import SVG

_SANS, _SERIF, _MONO = "DejaVu Sans", "DejaVu Serif", "DejaVu Sans Mono"
_GENERIC = {
    **dict.fromkeys(("serif", "ui-serif", "math"), _SERIF),
    **dict.fromkeys(("monospace", "ui-monospace"), _MONO),
    **dict.fromkeys(("sans-serif", "ui-sans-serif", "system-ui", "inherit", "initial"), _SANS),
}
# categories that need no glyph: controls, separators, and marks, which a font may leave to shaping
_UNDRAWN = ("Cc", "Cf", "Mn", "Zl", "Zp", "Zs")


def choose_fonts(root: Element, styles: Styles, what: str) -> tuple[str, ...] | None:
    """Put a family that there is wherever the text's family is set.

    Returns:
        Files of fonts that the text needs, beside those that come along; None where there is no text.

    Raises:
        InputError: no font of this machine has a character of the text; `what` names the picture.
    """
    texts = [e for text in root.iter(f"{{{SVG}}}text") for e in text.iter()]
    said = "".join("".join(e.itertext()) for e in root.iter(f"{{{SVG}}}text"))
    if not said.strip():
        return None
    files: dict[str, None] = {}
    parents = {child: parent for parent in root.iter() for child in parent}
    speaking = {e for e in texts if (e.text or "").strip()}
    speaking |= {parents[e] for e in texts if (e.tail or "").strip() and e in parents}
    asked: set[Element] = set()
    for element in speaking:
        at: Element | None = element
        while at is not None and "font-family" not in styles.of.get(at, {}):
            at = parents.get(at)
        if at is not None:
            asked.add(at)
        if styles.of.get(element, {}).get("direction") == "rtl" and not len(element):
            # the library takes every line to begin at the left
            element.text = f"\u2067{element.text}\u2069"
    for element in root.iter():
        if "font-family" not in styles.of.get(element, {}):
            continue
        named = styles.of[element]["font-family"]
        family = _SANS
        if element in asked:
            family, found = _choose(named)
            files.update(dict.fromkeys(found))
            first = named.split(",")[0].strip(" \"'")
            if first and family.lower() != first.lower() and first.lower() not in _GENERIC:
                styles.note(
                    f"its text is drawn in {family} instead of {first}, which this machine lacks "
                    "(turn it to paths in the editor to keep its look)"
                )
        styles.of[element]["font-family"] = f"'{family}'"
    supplied = (*files, *supply_fonts(None))
    for character in dict.fromkeys(said):
        if unicodedata.category(character) not in _UNDRAWN:
            path = find_font(character, supplied, what)
            if path not in supplied:
                files[path] = None
    return tuple(files)


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
