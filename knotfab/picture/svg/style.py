"""An SVG drawing's CSS, made safe for resvg: no links, no selectors that backtrack.

resvg knows CSS 2 and the colours of CSS 3. What goes beyond that is left out, so that the value it would
replace counts, and a note says what to do. All scanning is linear in the length of the text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from urllib.parse import unquote
from xml.etree.ElementTree import Element

from knotfab.picture.svg.clean import move_page, refuse_outside, rename_ids
from knotfab.picture.svg.css import (
    Declarations,
    expand_font,
    find_links,
    is_colour,
    page_colour,
    read_declarations,
    read_functions,
    read_length,
    rem_in_px,
    split_statements,
    strip_css,
    write_declarations,
)
from knotfab.picture.svg.xml import XLINK, local_name
from knotfab_formats.errors import InputError

_COLOURS = ("fill", "stroke", "color", "stop-color", "flood-color", "lighting-color")
_GEOMETRY = ("cx", "cy", "d", "height", "r", "rx", "ry", "width", "x", "y")
_WORDS = re.findall(
    r"[a-z-]+",
    """
    alignment-baseline baseline-shift clip-rule color-interpolation color-interpolation-filters direction
    display dominant-baseline fill-rule font-kerning font-size font-stretch font-style font-variant
    font-weight image-rendering isolation letter-spacing mask-type mix-blend-mode overflow paint-order
    shape-rendering stroke-linecap stroke-linejoin text-anchor text-decoration text-rendering visibility
    word-spacing writing-mode
    """,
)  # keywords or numbers, which CSS accepts in capitals too
_LINKS = ("clip-path", "filter", "marker", "marker-end", "marker-mid", "marker-start", "mask")
_NUMBERS = (
    *("fill-opacity", "flood-opacity", "opacity", "stop-opacity", "stroke-dasharray"),
    *("stroke-dashoffset", "stroke-miterlimit", "stroke-opacity", "stroke-width"),
)
_PASSED = frozenset([*_COLOURS, *_WORDS, *_LINKS, *_NUMBERS])
_OTHER_NAMES = {
    "mask-image": "mask",
    "-webkit-mask": "mask",
    "-webkit-mask-image": "mask",
    "-webkit-clip-path": "clip-path",
    "-webkit-filter": "filter",
}
_PARTS = ("font", "font-family", "vector-effect", "transform", "transform-origin")
_MOVES = "CSS transforms are not drawn: flatten them in the editor"
_TOLD = {
    **dict.fromkeys(("translate", "rotate", "scale", "offset-path", "transform-box"), _MOVES),
    **dict.fromkeys(
        ("text-transform", "white-space", "text-orientation", "font-variant-caps"),
        "{name} is not drawn: type the text as it is to look, or turn it to paths",
    ),
    "animation": "its animation is left out",
    "animation-name": "its animation is left out",
}
_RESETS = ("unset", "revert", "revert-layer")
_PLAIN = {"all", "screen", "only screen", "only all", "(prefers-color-scheme:light)"}
_PLAIN |= {"(prefers-contrast:no-preference)", "(prefers-reduced-motion:no-preference)"}
_NEVER = {"print", "speech", "only print", "(prefers-color-scheme:dark)", "(prefers-contrast:more)"}
_NEVER |= {"(prefers-reduced-motion:reduce)"}
_ANCESTORS = 3  # descendant combinators in a selector; resvg tries all ways to match more
_NESTED = 8  # depth of nested blocks
_LONGEST = 100_000  # most characters of a value after its variables are expanded


class Styles:
    """Rewriting of a tree's style sheets, style attributes and attributes, in place.

    `notes` collects what was changed; `page` is the colour behind the drawing, if it has one. `choose_family`
    maps a list of fonts to the family that is drawn; it is None where the drawing has no text.
    """

    def __init__(
        self, root: Element, what: str, choose_family: Callable[[str, Element | None], str] | None
    ) -> None:
        self.notes: dict[str, None] = {}
        self.page: str | None = None
        self.root, self._what, self._choose_family = root, what, choose_family
        self._ids = rename_ids(root)
        self._dashed, self._inside = False, ""
        sheets = []
        for parent in list(root.iter()):
            for child in [c for c in parent if local_name(c) == "style"]:
                if child.get("type", "").strip().lower() in ("", "text/css") and self._applies(
                    child.get("media", "")
                ):
                    sheets.append((child, list(self._rules("".join(child.itertext()), 0))))
                else:
                    parent.remove(child)
        own = {
            e: read_declarations(e.attrib.pop("style")) for e in root.iter() if "style" in e.attrib
        }
        self._variables: dict[str, str | None] = {}
        for body in (*(b for _, rules in sheets for _, b in rules), *own.values()):
            for name, value in body:
                if name.startswith("--"):
                    same = self._variables.get(name, value) == value
                    self._variables[name] = value if same else None
        for child, rules in sheets:
            self._write_sheet(child, rules)
        for element in root.iter():
            self._write_attributes(element)
            self._write_style(element, own.get(element, []))
        move_page(self.root)
        if any(e.get("pathLength") for e in root.iter()) and self._dashed:
            self._note(
                "pathLength is not read: its dashes are as long as they are drawn without it"
            )

    def _note(self, sentence: str) -> None:
        self.notes[sentence] = None

    def _applies(self, query: str) -> bool:
        """Return whether a media query holds on a light screen; note what it asks beyond that."""
        unknown = False
        for option in query.lower().split(","):
            parts = [" ".join(p.replace(":", " : ").split()) for p in option.split(" and ")]
            parts = [p.replace(" : ", ":").replace("( ", "(").replace(" )", ")") for p in parts]
            if all(part in _PLAIN or not part for part in parts):
                return True
            unknown |= not any(part in _NEVER for part in parts)
        if unknown:
            self._note(
                f"its style for {query.strip()[:40]!r} (@media) is left out: give the drawing one style"
            )
        return False

    def _rules(self, css: str, depth: int) -> Iterator[tuple[str, Declarations]]:
        """Yield the selector and declarations of each rule that applies."""
        for prelude, block in split_statements(strip_css(css)):
            if not prelude.startswith("@"):
                if block is not None:
                    yield prelude, read_declarations(block, self._tell_nested)
                continue
            word, _, rest = prelude[1:].partition(" ")
            name = re.match(r"[\w-]*", word)[0].lower()  # type: ignore[index]
            if (
                name == "import" and "font" not in prelude.lower()
            ):  # fonts of a service are left out
                raise InputError(
                    self._what,
                    f"the element <style> imports a style sheet ({prelude[:60]})",
                    "Save it as a plain SVG that stands alone (links embedded or removed).",
                )
            if name.endswith("keyframes"):
                self._note("its animation is left out")
            elif block is None or name in ("import", "font-face"):
                continue
            elif name in ("supports", "container", "scope", "starting-style"):
                self._note(f"its style under @{name} is left out: give the drawing one style")
            elif (name == "media" and self._applies(rest)) or name == "layer":
                if depth == _NESTED:
                    raise InputError(
                        self._what, "its style sheet is nested too deep", "Save it as a plain SVG."
                    )
                yield from self._rules(block, depth + 1)

    def _tell_nested(self, prelude: str) -> None:
        self._note(f"the style of {prelude[:40]!r} is left out, which is nested in another")

    def _write_sheet(self, element: Element, rules: list[tuple[str, Declarations]]) -> None:
        lines = []
        for prelude, body in rules:
            selectors = [s for part in prelude.split(",") if (s := self._selector(part.strip()))]
            written = self._write(body, None, selectors)
            if selectors and written:
                lines.append(f"{','.join(selectors)}{{{write_declarations(written)}}}")
        for child in list(element):
            element.remove(child)
        element.attrib.clear()
        element.text = "\n".join(lines)

    def _selector(self, text: str) -> str | None:
        """Return a selector that resvg matches without backtracking, or None."""
        text = text.replace(":root", "svg")
        plain = text.replace(":first-child", "").replace("svg|", "")
        steps = plain.replace(">", " > ").split()
        ancestors = len(steps) - 1 - 2 * steps.count(">")
        if plain and not set(plain) & set(":()+~\\&|@<") and ancestors <= _ANCESTORS:
            return text.replace("svg|", "")
        if not any(text.endswith(p) for p in (":hover", ":focus", ":active", ":target")):
            self._note(f"the style of {text[:40]!r} is left out, a selector that is not known")
        return None

    def _write_attributes(self, element: Element) -> None:
        for name in list(element.attrib):
            value = element.attrib[name]
            if value.lower().rstrip().endswith("rem") or "rem " in value.lower():
                element.set(name, value := rem_in_px(value))
            if name == f"{{{XLINK}}}href":
                if value.startswith("#"):
                    element.set(name, "#" + self._id(value[1:]))
            elif name in _PASSED or name in ("font-family", "vector-effect"):
                del element.attrib[name]
                for key, text in self._write([(name, value)], element, []):
                    element.set(key, text)
            elif name == "transform" and "var(" in value:
                element.set(name, self._resolve(value) or "")

    def _write_style(self, element: Element, body: Declarations) -> None:
        written = self._write(body, element, [])
        kept = []
        shape = not local_name(element).startswith(("text", "tspan"))
        for name, value in written:
            bare = value.partition("!")[0].strip()
            if name in _GEOMETRY:
                if name == "d":
                    element.set("d", bare.removeprefix("path(").strip(" \"')"))
                elif shape and read_length(bare, 1.0) is not None:
                    element.set(name, bare)
            elif name in ("transform", "transform-origin"):
                element.set(self._transform_name(element, name), bare)
            else:
                kept.append((name, value))
        if kept:
            element.set("style", write_declarations(kept))

    def _transform_name(self, element: Element, name: str) -> str:
        kind = local_name(element)
        if name == "transform" and kind in ("linearGradient", "radialGradient"):
            return "gradientTransform"
        return "patternTransform" if name == "transform" and kind == "pattern" else name

    def _write(
        self, body: Declarations, element: Element | None, selectors: list[str]
    ) -> Declarations:
        """Return the declarations that resvg draws; `element` is None for a style sheet."""
        written: Declarations = []
        self._inside = "style" if element is None else local_name(element)
        for name, value in body:
            name = _OTHER_NAMES.get(name, name)
            if name in _TOLD:
                if value.strip().lower() not in ("none", "normal", "view-box", ""):
                    self._note(_TOLD[name].format(name=name))
                continue
            background = name in ("background", "background-color")
            if not (name in _PASSED or name in _PARTS or name in _GEOMETRY or background):
                continue
            found = self._resolve(value)
            if found is None:
                self._note(f"{name}: {value[:40]} is left out, a variable that has no one value")
                continue
            plain, mark, _ = found.partition("!")
            before = dict(self.notes)
            read = self._read(name, plain.strip(), element, selectors)
            if (
                not read
                and name in _COLOURS
                and (
                    any(key == name for key, _ in written)
                    or (element is not None and name in element.attrib)
                )
            ):
                self.notes = before  # editors write a plain colour first, then a newer one
            for key, text in read:
                written.append((key, f"{text} !important" if mark else text))
        return written

    def _read(
        self, name: str, text: str, element: Element | None, selectors: list[str]
    ) -> Declarations:
        word = text.lower()
        if not text or word in _RESETS:
            return []
        if any(f"{sum_}(" in word for sum_ in ("calc", "min", "max", "clamp")):
            self._note(
                f"{name}: a sum ({word.partition('(')[0][-8:]}) is left out: write its value"
            )
            return []
        if "rem" in word:
            text = rem_in_px(text)
            word = text.lower()
        if name.startswith("background"):
            if element is self.root or set(selectors) & {"svg", "*"}:
                self.page = page_colour(word) or (None if element is self.root else self.page)
            return []
        if name == "font":
            return [p for k, v in expand_font(text) for p in self._read(k, v, element, selectors)]
        if name == "font-family":
            chosen = self._choose_family(text, element) if self._choose_family else None
            return [] if chosen is None else [(name, f"'{chosen}'")]
        if name == "vector-effect":
            if word == "non-scaling-stroke":
                self._note(
                    "strokes that keep their width (vector-effect: non-scaling-stroke) are drawn as if "
                    "they scaled: turn them to paths in the editor"
                )
            return []
        if name in ("transform", "transform-origin"):
            return self._read_transform(name, word, element)
        if name in _GEOMETRY:
            if element is None and not set(selectors) & {"svg", "*"}:
                self._note(f"{name} in a style sheet is not drawn: write it as an attribute")
            return [] if element is None else [(name, text)]
        if name in _COLOURS:
            return self._read_paint(name, text)
        if name in _LINKS:
            return self._read_link(name, text)
        self._dashed |= name == "stroke-dasharray" and word != "none"
        return [(name, word)]

    def _read_transform(self, name: str, word: str, element: Element | None) -> Declarations:
        """Convert a transform of a style attribute to SVG's syntax, without units."""
        if word == "none":
            return []
        if name == "transform-origin":
            lengths = [read_length(part) for part in word.split()[:2]]
            found = " ".join(f"{n:.9g}" for n in lengths if n is not None)
            known = None not in lengths and len(lengths) == 2 and element is not self.root
        else:
            found = " ".join(read_functions(word))
            known = bool(found)
        if element is None or not known:
            self._note(_MOVES)
            return []
        return [(name, found)]

    def _read_paint(self, name: str, text: str) -> Declarations:
        link, rest = "", text
        if text.lower().startswith("url("):
            found = next(find_links(text), None)
            if found is None:
                return []
            link, rest = f"url(#{self._link(found[2], name)})", text[found[1] :].strip()
        word = rest.lower()
        if word == "initial":
            word = {"stroke": "none", "lighting-color": "#ffffff"}.get(name, "#000000")
        known = word in ("none", "inherit", "transparent", "context-fill", "context-stroke", "")
        if word == "currentcolor":
            word, known = "currentColor", True
        if not known and not is_colour(word):
            self._note(
                f"{name}: {rest[:40]} is left out, a colour that is not known: write it as #rrggbb"
            )
            word = ""
        return [(name, f"{link} {word}".strip())] if link or word else []

    def _read_link(self, name: str, text: str) -> Declarations:
        found = list(find_links(text))
        if not found:
            kind = text.partition("(")
            if kind[1] and name in ("clip-path", "mask"):
                self._note(f"{name}: {kind[0].lower()}() is left out, which is not known")
                return []
            return [(name, text.lower())]
        targets = [self._link(link, name) for _, _, link in found]
        if name == "filter":
            if any(target not in self._ids.values() for target in targets):
                return []  # browsers draw elements whose filter is missing
            return [(name, " ".join(f"url(#{target})" for target in targets))]
        return [(name, f"url(#{targets[0]})")]

    def _link(self, link: str, name: str) -> str:
        if link and not link.startswith("#"):
            refuse_outside(link, self._inside, self._what)
        return self._id(link[1:])

    def _id(self, asked: str) -> str:
        return self._ids.get(asked) or self._ids.get(unquote(asked)) or "gone"

    def _resolve(self, value: str, depth: int = 0) -> str | None:
        """Expand var(); None if a variable has no value, or several in this drawing."""
        at = value.find("var(")
        if at < 0:
            return value
        parts, end = [], 0
        while at >= 0:
            stop, level = at + 4, 1
            while stop < len(value) and level:
                level += {"(": 1, ")": -1}.get(value[stop], 0)
                stop += 1
            name, comma, other = value[at + 4 : stop - 1].partition(",")
            found = self._variables.get(name.strip())
            if found is not None and depth < _NESTED:
                found = self._resolve(found, depth + 1)
            if found is None and comma and name.strip() not in self._variables:
                found = self._resolve(other.strip(), depth + 1) if depth < _NESTED else None
            if found is None:
                return None
            parts += [value[end:at], found]
            if sum(map(len, parts)) > _LONGEST:
                return None
            end, at = stop, value.find("var(", stop)
        return "".join([*parts, value[end:]])
