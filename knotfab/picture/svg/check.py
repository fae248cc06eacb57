"""What of an SVG drawing is safe to draw, and what of it resvg draws otherwise than a browser.

Nothing is rewritten to look right: what is not drawn is told, with what to do in the editor. All scanning is
linear in the length of the text.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable, Iterator
from urllib.parse import unquote, unquote_to_bytes
from xml.etree.ElementTree import Element

from knotfab.picture.raster import data_uri, decode, image_uri
from knotfab.picture.svg.xml import SVG, local_name, looks_like_svg
from knotfab_formats.errors import InputError

Notes = dict[str, None]  # sentences, in their order

_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_ALONE = "Save it as a plain SVG that stands alone (links embedded or removed)."
_FLATTEN = "flatten it in the editor (as paths with plain attributes, or save it as a PNG)"
_STILL = "its animation is left out"
_SCRIPT = "its script is not run"
# elements that are not drawn: what is said of them
_LEFT_OUT = {
    "script": _SCRIPT,
    **dict.fromkeys(("animate", "animateColor", "animateMotion", "animateTransform", "set"), _STILL),
    "foreignObject": "the HTML in it (<foreignObject>) is left out: turn it to paths or SVG text",
    "flowRoot": "its flowed text (<flowRoot>) is left out: turn it to text or to paths in Inkscape "
    "(Text > Convert to Text) to have it drawn",
    **dict.fromkeys(("meshgradient", "meshGradient"), "its mesh gradients are left out"),
    "hatch": "its hatches are left out",
    "solidcolor": "its named colours (<solidcolor>) are left out",
    **dict.fromkeys(("audio", "video", "canvas", "iframe"), "the media in it are left out"),
}  # fmt: skip
_UNSEEN = (
    "metadata", "title", "desc", "cursor", "view", "color-profile", "font", "font-face", "mpath",
)  # fmt: skip
# what resvg draws otherwise or not at all: a sign of it in CSS or in an attribute, written "name:value"
_NOT_DRAWN = (
    (r"var\(", "variables (var)"),
    (r"(?:calc|min|max|clamp)\(", "sums (calc)"),
    (r"(?:color|ok)?-?(?:lch|lab|color|color-mix|light-dark|hwb|device-cmyk)\(", "newer colours"),
    (r"hsla?\([^)]{0,40}(?:deg|turn|rad)", "angles of colours in units"),
    (r"shape-inside|shape-subtract|inline-size\s*:\s*[1-9]", "texts that flow in a shape"),
    (r"\brem\b|\d(?:rem|vw|vh|ch|cap|lh)\b", "lengths in rem and their like"),
    (r"(?:^|[;{\s])(?:transform(?:-origin)?|translate|rotate|scale|offset-path)\s*:(?!\s*none)",
     "transforms in CSS"),
    (r"non-scaling-stroke", "strokes that keep their width (vector-effect)"),
    (r"(?:text-transform|white-space|text-orientation|font-variant-caps)\s*:(?!\s*(?:none|normal))",
     "changed letters and blanks of text"),
    (r"(?:clip-path|mask)\s*:\s*(?!none|url|inherit|unset)[\w-]{1,40}\(", "shapes in clip-path and mask"),
    (r"-webkit-(?:mask|clip-path|filter)|mask-image", "masks of newer CSS"),
    (r"mask\s*:\s*url\([^)]{0,200}\)\s*[^\s;}]", "masks of newer CSS"),
    (r"(?:^|[;{\s])d\s*:", "outlines in CSS (d)"),
    (r"(?:^|[;{\s])[A-Z-]{2,30}\s*:|\b(?!currentColor)(?i:currentcolor)\b", "words in capitals"),
    (r"(?:display|visibility|fill-rule|clip-rule|overflow)\s*:\s*[a-z]{0,20}[A-Z]", "words in capitals"),
)  # fmt: skip
_OF_SHEETS = (
    (r"@(?:supports|container|scope|starting-style|layer)", "styles under conditions (@supports, @layer)"),
    (r"@media(?!\s*(?:print|speech|only print|\(prefers-(?:color-scheme:\s*dark|contrast:\s*more)\)))",
     "styles for some screens (@media)"),
    (r"(?:^|[;{\s])(?:cx|cy|r|rx|ry|x|y|width|height)\s*:", "sizes in a style sheet"),
    (r"[~+\\|]|:(?:not|is|where|has|nth[a-z-]*)\(|:(?!root|first-child|hover|focus|active|target)[a-z-]{1,40}[^;{}()]{0,200}\{",
     "selectors beyond CSS 2"),
    (r"(?:^|\})[^@{}]{1,200}\{[^{}]{0,400}\{", "styles nested in each other"),
)  # fmt: skip
_SIGNS = [(re.compile(sign), said) for sign, said in _NOT_DRAWN]
_SHEET_SIGNS = [(re.compile(sign), said) for sign, said in _OF_SHEETS]
_NO_STYLE = (
    *("d", "points", "id", "class", "transform", "gradientTransform", "patternTransform", "values"),
    *("scale", "rotate"),
)
_URL = re.compile(r"""url\(\s*["']?\s*([^"')\s]*)""", re.I)
_ESCAPE = re.compile(r"\\([0-9a-fA-F]{1,6})\s?")
_LONGEST = 1_000_000  # most characters of a style sheet
_MOST_STEPS = 8  # of a selector


def check_drawing(
    root: Element, what: str, notes: Notes, draw: Callable[[bytes, str], bytes]
) -> None:
    """Leave of a tree what is safe to draw; `notes` tell what is left out or drawn otherwise.

    Args:
        what: how an error names the picture.
        draw: renders the bytes of an embedded SVG file to a PNG.

    Raises:
        InputError: an element refers to something outside the file, or embeds what cannot be read.
    """
    _prune(root, notes)
    ids = {element.get("id", "") for element in root.iter()}
    for element in root.iter():
        name = local_name(element)
        for key in list(element.attrib):
            bare = key.rpartition("}")[2]
            if bare.lower().startswith("on"):
                notes[_SCRIPT] = None
                del element.attrib[key]
            elif key == "requiredFeatures":  # which browsers do not read
                del element.attrib[key]
            elif key in _HREFS:
                _check_link(element, key, what, draw)
            elif key.startswith("{") and not key.endswith("}space"):
                del element.attrib[key]
            elif key not in _NO_STYLE:
                text = element.attrib[key]
                _check_css(text if key == "style" else f"{key}:{text}", name, what, ids, notes)
        if name == "style":
            _check_sheet(element, what, ids, notes)
    if root.attrib.pop("transform", ""):
        notes[f"a transform of the whole page is not drawn: {_FLATTEN}"] = None
    for element in root.iter(f"{{{SVG}}}feDisplacementMap"):
        if element.get("scale", "0").strip() not in ("", "0"):
            notes[f"a filter that displaces outlines is drawn too strong: {_FLATTEN}"] = None
    dashed = any("dasharray" in key + value for e in root.iter() for key, value in e.attrib.items())
    if dashed and any(e.get("pathLength") for e in root.iter()):
        notes[f"pathLength is not read, and its dashes are longer or shorter: {_FLATTEN}"] = None
    if any(re.search(r"[^\w.:-]", one) for one in ids):
        notes[f"names (id) with blanks or signs in them are not found: {_FLATTEN}"] = None
    _refuse_symbols(root, what)


def page_colour(root: Element) -> str | None:
    """Return the hexadecimal colour behind a drawing, if its style has one."""
    found = re.search(r"background(?:-color)?\s*:\s*(#[0-9a-fA-F]{3,8})\b", root.get("style", ""))
    return found[1] if found else None


def _prune(parent: Element, notes: Notes) -> None:
    """Remove elements that are not SVG or not drawn; the order of the rest, and text between, stays."""
    before: Element | None = None
    for child in list(parent):
        name = local_name(child) if isinstance(child.tag, str) else ""
        if name == "style":  # HTML style sheets apply as well, as in browsers
            child.tag = f"{{{SVG}}}style"
        ours = isinstance(child.tag, str) and child.tag.startswith(f"{{{SVG}}}")
        if ours and name not in _LEFT_OUT and name not in _UNSEEN:
            _prune(child, notes)
            before = child
            continue
        empty = name == "flowRoot" and not "".join(child.itertext()).strip()
        # by SVG that stands beside it
        replaced = local_name(parent) == "switch" and len(parent) > 1
        if ours and name in _LEFT_OUT and not empty and not replaced:
            notes[_LEFT_OUT[name]] = None
        if child.tail and before is not None:
            before.tail = (before.tail or "") + child.tail
        elif child.tail:
            parent.text = (parent.text or "") + child.tail
        parent.remove(child)


def _check_link(element: Element, key: str, what: str, draw: Callable[[bytes, str], bytes]) -> None:
    """Keep a link within the file, and embed a picture as a PNG; refuse what reaches outside."""
    name, link = local_name(element), element.attrib.pop(key).strip()
    if name in ("a", "style"):
        return
    if not link.startswith("#") and link:
        if name not in ("image", "feImage") or not link.lower().startswith("data:"):
            _refuse_outside(link, name, what)
        link = _embed_picture(link, f"{what}, the picture embedded in <{name}>", draw)
    element.set(_HREFS[1], unquote(link) if link.startswith("#") else link)


def _check_css(text: str, name: str, what: str, ids: set[str], notes: Notes) -> None:
    """Refuse links of a style that reach outside, and tell what of it is not drawn."""
    text = _ESCAPE.sub(lambda m: chr(min(int(m[1], 16), 0x10FFFF)), text) if "\\" in text else text
    text = " ".join(text.split())  # so that no sign takes long
    for target in _URL.findall(text):
        if target and not target.startswith("#"):
            _refuse_outside(target, name, what)
        if "filter" in text and unquote(target[1:]) not in ids:
            notes[f"what has a filter that is missing is not drawn: {_FLATTEN}"] = None
    _tell(text, _SIGNS, notes)


def _check_sheet(element: Element, what: str, ids: set[str], notes: Notes) -> None:
    """Check a style sheet; one of another kind, such as SCSS, is emptied."""
    css = "".join(element.itertext())
    first, *rest = css.replace("<!--", "").replace("-->", "").split("/*")
    css = " ".join([first, *(part.partition("*/")[2] for part in rest)])
    if element.get("type", "").strip().lower() not in ("", "text/css") or len(css) > _LONGEST:
        css = ""
    if "\\" in css:
        css = _ESCAPE.sub(lambda m: chr(min(int(m[1], 16), 0x10FFFF)), css)
    for found in re.finditer(r"@import([^;]*)", css, re.I):
        if "font" not in found[1].lower():  # fonts of a service are left out
            why = f"the element <style> imports a style sheet (@import{found[1][:60]})"
            raise InputError(what, why, _ALONE)
    if "@keyframes" in css.lower() or "-keyframes" in css.lower():
        notes[_STILL] = None
    css = re.sub("@import[^;]*;?", " ", css, flags=re.I)
    for word in ("keyframes", "font-face"):
        css = "".join(_without_blocks(css, word))
    css = " ".join(css.split())
    for prelude in (part.rpartition("}")[2] for part in css.split("{")[:-1]):
        if max(map(len, map(str.split, prelude.split(",")))) > _MOST_STEPS:  # tried in all ways
            why = f"a style of it has a selector of more than {_MOST_STEPS} steps"
            raise InputError(
                what, why, "Save it as a plain SVG with attributes in place of styles."
            )
    _check_css(css, "style", what, ids, notes)
    _tell(css, _SHEET_SIGNS, notes)
    for child in list(element):
        element.remove(child)
    element.attrib.clear()
    element.text = css


def _without_blocks(css: str, word: str) -> Iterator[str]:
    """Yield the parts of a style sheet outside the blocks of rules of this name."""
    at = 0
    for found in re.finditer(rf"@[\w-]{{0,20}}{word}[^{{]{{0,200}}\{{", css, re.I):
        if found.start() < at:
            continue
        yield css[at : found.start()]
        depth, at = 1, found.end()
        for sign in re.compile("[{}]").finditer(css, at):
            depth += 1 if sign[0] == "{" else -1
            at = sign.end()
            if not depth:
                break
        else:
            at = len(css)
    yield css[at:]


def _tell(text: str, signs: list[tuple[re.Pattern[str], str]], notes: Notes) -> None:
    for sign, said in signs:
        if sign.search(text):
            notes[f"{said} are not drawn as a browser draws them: {_FLATTEN}"] = None


def _refuse_outside(link: str, name: str, what: str) -> None:
    """Refuse an element that refers outside the file, of which only embedded pictures are drawn."""
    shown = link if len(link) <= 60 else link[:57] + "..."
    kind = re.match(r"data:([\w.+/-]*)", link, re.I)
    reason = f"refers to something outside the file ({shown!r})"
    if kind is not None:
        reason = f"embeds {kind[1] or 'text'}, which is not read there"
    raise InputError(what, f"the element <{name}> {reason}", _ALONE)


def _refuse_symbols(root: Element, what: str) -> None:
    """Refuse a drawing that only defines symbols for others to use."""
    named = [e.get("id", "") for e in root.iter(f"{{{SVG}}}symbol") if e.get("id")]
    rest = [local_name(child) for child in root]
    while rest.count("g") == len(rest) == 1 and len(root):  # the whole page in one group
        root = root[0]
        rest = [local_name(child) for child in root]
    if named and set(rest) <= {"symbol", "defs", "style"}:
        shown = ", ".join(named[:4]) + (", ..." if len(named) > 4 else "")
        raise InputError(
            what,
            f"it only defines symbols ({shown}) and draws none",
            f'Add <use href="#{named[0]}"/> to it, or export one symbol as an SVG of its own.',
        )


def _embed_picture(link: str, what: str, draw: Callable[[bytes, str], bytes]) -> str:
    """Return an embedded picture of any kind as the data URI of a PNG."""
    head, _, body = link.partition(",")
    try:
        data = unquote_to_bytes(body)
        if head.lower().rstrip().endswith("base64"):
            plain = b"".join(data.split()).rstrip(b"=")
            data = base64.b64decode(plain + b"=" * (-len(plain) % 4))
    except (binascii.Error, ValueError) as error:
        raise InputError(what, "it is damaged", "Embed it again.") from error
    if looks_like_svg(data):
        return data_uri(draw(data, what), "image/png")
    image, kind = decode(data, what, smallest=1)
    if kind == "PNG":
        return data_uri(data, "image/png")
    return image_uri(image.convert("RGBA" if image.has_transparency_data else "RGB"))
