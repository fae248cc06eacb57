"""Style sheets and style attributes as values that the SVG library knows, element by element.

The library reads SVG 1.1's CSS: no variables, no newer colours, no transforms with units, no geometry. So
the cascade is done here (selectors by cssselect2), and what it comes to is written into the tree.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from xml.etree.ElementTree import Element

import cssselect2
import tinycss2

from knotfab.picture.svg.clean import refuse_outside
from knotfab.picture.svg.colour import to_hex
from knotfab.picture.svg.size import read_length
from knotfab.picture.svg.xml import SVG, local_name
from knotfab_formats.errors import InputError

Tokens = Sequence[Any]

COLOURS = ("fill", "stroke", "color", "stop-color", "flood-color", "lighting-color")
GEOMETRY = ("cx", "cy", "d", "height", "r", "rx", "ry", "width", "x", "y")
MOVING = ("rotate", "scale", "transform", "transform-box", "transform-origin", "translate")
_KNOWN = frozenset(
    re.findall(
        r"[a-z-]+",
        """
        alignment-baseline background background-color baseline-shift clip-path clip-rule
        color-interpolation color-interpolation-filters direction display dominant-baseline fill-opacity
        fill-rule filter flood-opacity font font-family font-kerning font-size font-stretch font-style
        font-variant font-weight image-rendering isolation letter-spacing marker marker-end marker-mid
        marker-start mask mask-type mix-blend-mode opacity overflow paint-order shape-rendering stop-opacity
        stroke-dasharray stroke-dashoffset stroke-linecap stroke-linejoin stroke-miterlimit stroke-opacity
        stroke-width text-anchor text-decoration text-rendering vector-effect visibility word-spacing
        writing-mode
        """,
    )
).union(COLOURS, GEOMETRY, MOVING)
_INHERITED = (
    "fill",
    "stroke",
    "color",
    "font",
    "text",
    "letter",
    "word",
    "marker",
    "visib",
    "clip-rule",
)
_APART = frozenset([*GEOMETRY, *MOVING, "vector-effect"])
_URL = re.compile(r"url\(([^)]*)\)")
_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_BLOCKS = ("media", "supports", "layer", "container", "scope")
_DEEPEST = 32  # variables that stand for variables
_LONGEST = 100_000  # characters of a value, its variables written out
_SEEN = re.compile(
    r"(?:only\s+)?(?:all|screen)|\((?:prefers-color-scheme|prefers-contrast|prefers-reduced-motion)"
    r"\s*:\s*(?:light|no-preference)\s*\)",
    re.I,
)
_FONT = re.compile(
    r"(?P<before>(?:[a-z0-9-]+\s+)*?)(?P<size>(?:[\d.]+(?:[a-z]+|%))|(?:xx?-)?(?:small|large)|medium|larger"
    r"|smaller)\s*(?:/\s*\S+)?\s+(?P<family>\S.*)",
    re.I | re.S,
)


@dataclass
class Styles:
    """Style sheets and attributes of a drawing, resolved.

    `of`: each element's own values, by property, variables and colours written out; `fonts`: families
    that it declares by @font-face; `notes`: sentences on what is not drawn as it says.
    """

    of: dict[Element, dict[str, str]] = field(default_factory=dict)
    fonts: set[str] = field(default_factory=set)
    notes: dict[str, None] = field(default_factory=dict)

    def note(self, sentence: str) -> None:
        """Tell of it once."""
        self.notes[sentence] = None


class _UnknownVariable(ValueError):
    """A variable that nothing sets, or that stands for itself."""


def compute_styles(root: Element, what: str) -> Styles:
    """Take the values of all elements out of the style sheets, style attributes and attributes of a tree.

    The elements keep none of them. Where a value cannot be read, the one that it would replace counts,
    as CSS has it.

    Raises:
        InputError: a style sheet loads another (@import).
    """
    styles = Styles()
    matcher = cssselect2.Matcher()
    for element in root.iter(f"{{{SVG}}}style"):
        if _applies(element.get("media", "")) and element.get("type", "text/css") == "text/css":
            sheet = tinycss2.parse_stylesheet(
                "".join(element.itertext()), skip_comments=True, skip_whitespace=True
            )
            _add_rules(sheet, "", matcher, styles, what)
    _visit(cssselect2.ElementWrapper.from_xml_root(root), matcher, {}, styles)
    return styles


def _applies(query: str) -> bool:
    """Tell whether a media query holds for a picture on a light screen."""
    parts = [part.strip() for part in query.split(",")]
    return not query.strip() or any(
        all(_SEEN.fullmatch(p.strip()) for p in re.split(r"\band\b", part)) for part in parts
    )


def _add_rules(
    rules: Tokens, parent: str, matcher: cssselect2.Matcher, styles: Styles, what: str
) -> None:
    """Add the rules of a sheet, or of a block in it; `parent`: the selector that a nested one adds to."""
    for rule in rules:
        if rule.type == "qualified-rule":
            selector = tinycss2.serialize(rule.prelude).strip()
            if parent:
                around = f":is({parent})"
                selector = (
                    selector.replace("&", around) if "&" in selector else f"{around} {selector}"
                )
            content = tinycss2.parse_blocks_contents(
                rule.content, skip_comments=True, skip_whitespace=True
            )
            try:
                for compiled in cssselect2.compile_selector_list(selector):
                    matcher.add_selector(compiled, content)
            except cssselect2.SelectorError:
                styles.note(
                    f"the style of {selector[:40]!r} is left out, a selector that is not known"
                )
            _add_rules(
                [r for r in content if r.type.endswith("rule")], selector, matcher, styles, what
            )
        elif rule.type == "at-rule":
            _add_at_rule(rule, parent, matcher, styles, what)


def _add_at_rule(
    rule: Any, parent: str, matcher: cssselect2.Matcher, styles: Styles, what: str
) -> None:
    name = rule.lower_at_keyword
    prelude = tinycss2.serialize(rule.prelude).strip()
    if name == "import":
        if "font" in prelude.lower():  # a service that has fonts: they are never fetched
            return
        raise InputError(
            what,
            f"the element <style> imports a style sheet (@import {prelude[:60]})",
            "Save it as a plain SVG that stands alone (links embedded or removed).",
        )
    if name == "font-face":
        for declaration in tinycss2.parse_blocks_contents(rule.content or []):
            if declaration.type == "declaration" and declaration.lower_name == "font-family":
                styles.fonts.add(tinycss2.serialize(declaration.value).strip(" \"'").lower())
    elif name.endswith("keyframes"):
        styles.note("its animation is left out")
    elif name in _BLOCKS and rule.content and (name != "media" or _applies(prelude)):
        inner = tinycss2.parse_rule_list(rule.content, skip_comments=True, skip_whitespace=True)
        _add_rules(inner, parent, matcher, styles, what)


def _visit(
    wrapper: Any, matcher: cssselect2.Matcher, variables: dict[str, Tokens], styles: Styles
) -> None:
    """Compute an element's values, and those of the elements in it (a tree is no deeper than its limit)."""
    element: Element = wrapper.etree_element
    ranked: list[tuple[tuple[Any, ...], str, Tokens]] = []
    for name in [n for n in element.attrib if n in _KNOWN and n not in GEOMETRY]:
        if name not in ("transform", "transform-origin") or "var(" in element.attrib[name]:
            value = tinycss2.parse_component_value_list(element.attrib.pop(name))
            ranked.append(((0,), name, value))
    for specificity, order, pseudo, content in matcher.match(wrapper):
        if pseudo is None:
            ranked += _rank(content, (1, specificity, order))
    style = element.attrib.pop("style", "")
    ranked += _rank(_parse_declarations(style), (2,))
    # the strongest comes first, and among equals the last
    ranked = [r for _, r in sorted(enumerate(ranked), key=lambda k: (k[1][0], k[0]), reverse=True)]
    own = dict(variables)
    own.update({name: value for _, name, value in reversed(ranked) if name.startswith("--")})
    chosen: dict[str, str] = {}
    for _, name, value in ranked:
        if name.startswith("animation"):
            styles.note("its animation is left out")
        if name in chosen or name not in _KNOWN:
            continue
        try:
            written = tinycss2.serialize(list(_write_out(value, own, 0))).strip()
        except _UnknownVariable:
            continue
        if len(written) <= _LONGEST and (read := _read_value(name, written, styles)) is not None:
            chosen[name] = read
    if "font" in chosen:
        chosen = {**_expand_font(chosen.pop("font")), **chosen}
    if not local_name(element).startswith(("text", "tspan")):
        for name in [n for n in GEOMETRY if n in chosen]:
            element.set(name, re.sub(r"""^path\(\s*["']|["']\s*\)$""", "", chosen[name]))
    styles.of[element] = chosen
    for child in wrapper.iter_children():
        _visit(child, matcher, own, styles)


@lru_cache(1024)
def _parse_declarations(style: str) -> Tokens:
    return tuple(tinycss2.parse_blocks_contents(style))


def _rank(content: Tokens, rank: tuple[Any, ...]) -> list[tuple[tuple[Any, ...], str, Tokens]]:
    """Return declarations with their place in the cascade; !important declarations come above all others."""
    return [
        (
            (3, *rank) if d.important else rank,
            d.name if d.name.startswith("--") else d.lower_name,
            d.value,
        )
        for d in content
        if d.type == "declaration"
    ]


def _write_out(tokens: Tokens, variables: dict[str, Tokens], depth: int) -> Iterator[Any]:
    """Yield the tokens of a value with its var() written out."""
    if depth > _DEEPEST:
        raise _UnknownVariable
    for token in tokens:
        if token.type == "comment":
            continue
        if token.type == "function" and token.lower_name == "var":
            inside = [t for t in token.arguments if t.type not in ("whitespace", "comment")]
            name = inside[0].value if inside and inside[0].type == "ident" else ""
            comma = [
                i for i, t in enumerate(token.arguments) if t.type == "literal" and t.value == ","
            ]
            try:
                if name not in variables:
                    raise _UnknownVariable
                found = list(_write_out(variables[name], variables, depth + 1))
                if len(found) > _LONGEST:
                    raise _UnknownVariable
            except _UnknownVariable:
                if not comma:
                    raise
                found = list(_write_out(token.arguments[comma[0] + 1 :], variables, depth + 1))
            yield from found
        elif token.type == "function":
            arguments = list(_write_out(token.arguments, variables, depth + 1))
            yield type(token)(token.source_line, token.source_column, token.name, arguments)
        else:
            yield token


def _read_value(name: str, text: str, styles: Styles) -> str | None:
    """Read a value as the library knows it; None where there is none that it knows."""
    if name != "d" and re.search(r"[\d.]rem\b|\b(?:calc|min|max|clamp)\(", text, re.I):
        text = _read_lengths(text)
        if re.search(r"\b(?:calc|min|max|clamp|unknown)\(", text, re.I):
            styles.note(f"{name}: a sum (calc) of several units is left out")
            return None
    word = text.lower()
    if word in ("unset", "revert", "revert-layer"):
        return "inherit" if name.startswith(_INHERITED) else None
    if name in COLOURS:
        return _read_paint(name, text, styles)
    if name.startswith("background"):
        return to_hex(text)
    text = re.sub(r"""url\(\s*["']?([^"')]*?)["']?\s*\)""", r"url(\1)", text, flags=re.I)
    shape = re.match(
        r"(circle|ellipse|inset|polygon|path|rect|xywh|shape|[a-z-]*gradient|image-set)\(", word
    )
    if name in ("clip-path", "mask") and shape is not None:
        styles.note(f"{name}: {shape[1]}() is left out, which is not known")
        return None
    return text


def _read_paint(name: str, text: str, styles: Styles) -> str | None:
    """Read a paint: a colour, or a reference with a colour to fall back to."""
    if text.lower() == "initial":
        return "none" if name == "stroke" else "#ffffff" if name == "lighting-color" else "#000000"
    reference = re.match(r"url\([^)]*\)\s*", text, re.I)
    rest = text[reference.end() :] if reference else text
    if reference and not rest:
        return text
    colour = to_hex(rest)
    if colour is None:
        styles.note(f"{name}: {rest[:40]} is left out, a colour that is not known")
        return reference[0] if reference else None
    return f"{reference[0]}{colour}" if reference else colour


def _read_lengths(text: str) -> str:
    """Read lengths in rem in px, and sums (calc) worked out where their units allow it."""
    text = re.sub(r"(?<![\w.])([\d.]+)rem\b", lambda m: f"{16 * float(m[1]):g}px", text)
    for _ in range(_DEEPEST):  # the innermost first
        text, changed = re.subn(
            r"\bcalc\(((?:[^()]|(?<![a-z])\([^()]*\))*)\)", _work_out, text, flags=re.I
        )
        if not changed:
            break
    return text


def _work_out(match: re.Match[str]) -> str:
    """Compute a sum of numbers, of lengths in px, or of any one other unit."""
    units = set()

    def bare(number: re.Match[str]) -> str:
        unit = number[2].lower()
        length = None if unit in ("", "em", "ex", "%") else read_length(number[0])
        units.add(unit if length is None else "px")
        return number[1] if length is None else repr(length)

    sum_ = re.sub(r"(\d+\.?\d*|\.\d+)([a-z%]*)", bare, match[1], flags=re.I)
    try:
        if len(sum_) > 200 or len(units - {""}) > 1:  # characters of a calc()
            raise ValueError
        result = _evaluate(ast.parse(sum_.strip(), mode="eval").body)
    except (ValueError, SyntaxError, ZeroDivisionError, KeyError):
        return f"unknown({match[1]})"
    return f"{result:.9g}{next(iter(units - {''}), '')}"


def _evaluate(node: ast.expr) -> float:
    """Give the value of an expression of numbers and + - * /; KeyError or ValueError where it is another."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluate(node.operand)
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_evaluate(node.left), _evaluate(node.right))
    raise ValueError


def _expand_font(text: str) -> dict[str, str]:
    """Return the parts of the shorthand `font`."""
    found = _FONT.fullmatch(text.strip())
    if found is None:
        return {}
    values = {"font-size": found["size"], "font-family": found["family"]}
    for word in found["before"].lower().split():
        if word in ("italic", "oblique"):
            values["font-style"] = word
        elif word == "small-caps":
            values["font-variant"] = word
        elif word in ("bold", "bolder", "lighter") or word.isdigit():
            values["font-weight"] = word
        elif word.endswith(("condensed", "expanded")):
            values["font-stretch"] = word
    return values


def write_styles(root: Element, styles: Styles, what: str) -> str | None:
    """Give each element a style attribute with the values that the library reads; returns the page's colour.

    Raises:
        InputError: a value refers to something outside the file.
    """
    for element in root.iter():
        own = styles.of.get(element, {})
        written = {
            k: v for k, v in own.items() if k not in _APART and not k.startswith("background")
        }
        for value in written.values():
            for link in _URL.findall(value):
                if link and not link.startswith("#"):
                    refuse_outside(link, local_name(element), what)
        if written:
            element.set("style", ";".join(f"{k}:{v}" for k, v in written.items()))
    for sheet in [(p, e) for p in root.iter() for e in p if local_name(e) == "style"]:
        sheet[0].remove(sheet[1])
    own = styles.of[root]
    return own.get("background-color", own.get("background"))
