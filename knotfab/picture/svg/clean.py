"""Reduce an SVG tree to what is drawn, and report the rest; only links within the file are kept."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable
from urllib.parse import unquote_to_bytes
from xml.etree.ElementTree import Element

from knotfab.picture.raster import data_uri, decode, image_uri
from knotfab.picture.svg.css import read_length
from knotfab.picture.svg.xml import SVG, local_name, looks_like_svg
from knotfab_formats.errors import InputError

_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_ALONE = "Save it as a plain SVG that stands alone (links embedded or removed)."
_STILL = "its animation is left out"
_HTML = (
    "the HTML in it (<foreignObject>) is left out: turn it to paths or SVG text to have it drawn"
)
_FLOWED = (
    "its flowed text (<flowRoot>) is left out: turn it to text or to paths in Inkscape "
    "(Text > Convert to Text) to have it drawn"
)
_LEFT_OUT = {
    "script": "its script is not run",
    "animate": _STILL,
    "animateColor": _STILL,
    "animateMotion": _STILL,
    "animateTransform": _STILL,
    "set": _STILL,
    "foreignObject": _HTML,
    "flowRoot": _FLOWED,
    "meshgradient": "its mesh gradients are left out",
    "meshGradient": "its mesh gradients are left out",
    "hatch": "its hatches are left out",
    "solidcolor": "its named colours (<solidcolor>) are left out",
    **dict.fromkeys(("audio", "video", "canvas", "iframe"), "the media in it are left out"),
}
_UNSEEN = (
    "metadata",
    "title",
    "desc",
    "cursor",
    "view",
    "color-profile",
    "font",
    "font-face",
    "mpath",
)


def clean(
    root: Element, what: str, notes: dict[str, None], draw: Callable[[bytes, str], bytes]
) -> None:
    """Reduce a tree to what a still picture shows; sentences in `notes` tell what was left out.

    Args:
        what: how an error names the picture.
        draw: renders the bytes of an embedded SVG file to a PNG.

    Raises:
        InputError: an element refers to something outside the file, or embeds what cannot be read.
    """
    _choose_switches(root)
    _prune_hidden(root, notes)
    for parent in list(root.iter()):
        for child in [c for c in parent if not _is_for_all(c)]:
            parent.remove(child)
    for element in root.iter():
        for key in ("systemLanguage", "requiredFeatures", "requiredExtensions"):
            element.attrib.pop(key, None)
    for element in root.iter(f"{{{SVG}}}feDisplacementMap"):
        if element.get("scale", "0").strip() not in ("", "0"):  # resvg displaces too far
            element.set("scale", "0")
            notes["a filter that displaces outlines is not drawn: flatten it in the editor"] = None
    for element in root.iter():
        name = local_name(element)
        for key in [k for k in element.attrib if k not in _HREFS]:
            bare = key.rpartition("}")[2]
            if key.startswith("{") and key != "{http://www.w3.org/XML/1998/namespace}space":
                del element.attrib[key]
            elif bare.lower().startswith("on"):
                del element.attrib[key]
                notes[_LEFT_OUT["script"]] = None
        for key in [k for k in _HREFS if k in element.attrib]:
            link = element.attrib.pop(key).strip()
            if name in ("a", "style"):
                continue
            if not link.startswith("#") and link:
                if name not in ("image", "feImage") or not link.lower().startswith("data:"):
                    refuse_outside(link, name, what)
                link = _embed_picture(link, f"{what}, the picture embedded in <{name}>", draw)
            element.set(_HREFS[1], link)


def refuse_outside(link: str, name: str, what: str) -> None:
    """Refuse an element that refers outside the file, of which only embedded pictures are drawn."""
    shown = link if len(link) <= 60 else link[:57] + "..."
    kind = re.match(r"data:([\w.+/-]*)", link, re.I)
    reason = f"refers to something outside the file ({shown!r})"
    if kind is not None:
        reason = f"embeds {kind[1] or 'text'}, which is not read there"
    raise InputError(what, f"the element <{name}> {reason}", _ALONE)


def refuse_symbols(root: Element, what: str) -> None:
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


def _choose_switches(parent: Element) -> None:
    """Replace each <switch> by the child that is drawn: the first for English or for any language.

    An HTML child is chosen only if it is the sole one, since editors add SVG that draws without it.
    """
    for child in parent:
        _choose_switches(child)
        if local_name(child) != "switch":
            continue
        fit = [c for c in child if isinstance(c.tag, str) and _is_for_all(c)]
        fit.sort(key=lambda c: local_name(c) == "foreignObject")
        child.tag = f"{{{SVG}}}g"
        for other in list(child):
            if other is not (fit[0] if fit else None):
                child.remove(other)


def _is_for_all(element: Element) -> bool:
    languages = element.get("systemLanguage", "en").lower().split(",")
    told = any(language.strip().startswith("en") for language in languages)
    return (
        element.tag.startswith(f"{{{SVG}}}")
        and told
        and not element.get("requiredExtensions", "").strip()
    )


def _prune_hidden(parent: Element, notes: dict[str, None]) -> None:
    """Remove elements that are not SVG or not drawn; the order of the rest, and text between, stays."""
    before: Element | None = None
    for child in list(parent):
        name = local_name(child) if isinstance(child.tag, str) else ""
        if name == "style":  # HTML style sheets apply as well, as in browsers
            child.tag = f"{{{SVG}}}style"
        ours = isinstance(child.tag, str) and child.tag.startswith(f"{{{SVG}}}")
        if ours and name not in _LEFT_OUT and name not in _UNSEEN:
            _prune_hidden(child, notes)
            before = child
            continue
        empty = name == "flowRoot" and not "".join(child.itertext()).strip()
        if ours and name in _LEFT_OUT and not empty:
            notes[_LEFT_OUT[name]] = None
        if child.tail:
            if before is None:
                parent.text = (parent.text or "") + child.tail
            else:
                before.tail = (before.tail or "") + child.tail
        parent.remove(child)


def _embed_picture(link: str, what: str, draw: Callable[[bytes, str], bytes]) -> str:
    """Return an embedded picture of any kind as the data URI of a PNG."""
    head, _, body = link.partition(",")
    try:
        data = unquote_to_bytes(body)
        if head.lower().rstrip().endswith("base64"):
            data = base64.b64decode(data)
    except (binascii.Error, ValueError) as error:
        raise InputError(what, "it is damaged", "Embed it again.") from error
    if looks_like_svg(data):
        return data_uri(draw(data, what), "image/png")
    image, kind = decode(data, what, smallest=1)
    if kind == "PNG":
        return data_uri(data, "image/png")
    return image_uri(image.convert("RGBA" if image.has_transparency_data else "RGB"))


def rename_ids(root: Element) -> dict[str, str]:
    """Rename ids to names that resvg finds in references; return the new names by the old."""
    found: dict[str, str] = {}
    taken = {e.get("id") for e in root.iter()}
    for element in root.iter():
        old = element.get("id")
        if old is None:
            continue
        if old not in found:
            new = re.sub(r"[^\w.:-]", "_", old)
            while new != old and new in taken:
                new += "_"
            taken.add(new)
            found[old] = new
        element.set("id", found[old])
    return found


def move_page(root: Element) -> None:
    """Move a transform of the page to its content, about the page's middle, as browsers do."""
    moved = root.attrib.pop("transform", "").strip()
    if not moved:
        return
    try:
        box = [float(n) for n in root.get("viewBox", "").replace(",", " ").split()]
    except ValueError:
        box = []
    sides = [read_length(root.get(side, "")) for side in ("width", "height")]
    if len(box) != 4:
        box = [0.0, 0.0, sides[0] or 100.0, sides[1] or 100.0]
    ratios = [s / b for s, b in zip(sides, box[2:], strict=True) if s and b]
    scale = min(ratios, default=1.0)
    x, y = box[0] + box[2] / 2, box[1] + box[3] / 2
    group = Element(
        f"{{{SVG}}}g",
        {
            "transform": f"translate({x:.9g} {y:.9g}) scale({1 / scale:.9g}) {moved} "
            f"scale({scale:.9g}) translate({-x:.9g} {-y:.9g})"
        },
    )
    group.extend(list(root))
    root[:] = [group]
