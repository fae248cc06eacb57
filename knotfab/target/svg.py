"""SVG pictures: refuse whatever reaches outside the file, then render to a canonical PNG."""

from __future__ import annotations

import base64
import binascii
import re
import struct
from typing import Any
from urllib.parse import unquote_to_bytes
from xml.etree.ElementTree import Element, ParseError, tostring

from knotfab.errors import InputError
from knotfab.target.raster import LARGEST_SIDE, SMALLEST_SIDE, decode
from knotfab.target.svg_size import CSS_DPI, set_pixel_size

__all__ = ["LONGER_SIDE", "looks_like_svg", "render", "render_svg"]

LONGER_SIDE = 2048

_SVG = "{http://www.w3.org/2000/svg}"
_LINKS = ("href", "src")
_EMBEDDED = re.compile(r"data:image/(?:png|jpe?g)(?P<options>[^,]*),(?P<data>.*)", re.I | re.S)
_URL = re.compile(r"url\(\s*[\"']?([^\"')]*)", re.I)
_CSS_COMMENT = re.compile(r"/\*.*?(?:\*/|$)", re.S)
_CSS_ESCAPE = re.compile(r"\\(?:([0-9a-fA-F]{1,6})\s?|(.))", re.S)
_ALONE = "Save it as a plain SVG that stands alone (links embedded or removed)."


def looks_like_svg(data: bytes) -> bool:
    """Whether the bytes begin as an XML text that soon opens an svg element."""
    head = data[:4096].replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n")
    return head.startswith(b"<") and b"<svg" in data[:65536].replace(b"\0", b"")


def _unescape(css: str) -> str:
    """Drop the comments of a CSS text and resolve its escapes, so that nothing hides behind them."""

    def character(match: re.Match[str]) -> str:
        if match[1] is None:
            return str(match[2])
        code = int(match[1], 16)
        return chr(code) if code < 0x110000 else "\ufffd"

    return _CSS_ESCAPE.sub(character, _CSS_COMMENT.sub("", css))


def _check_css(css: str, name: str, what: str) -> None:
    plain = _unescape(css)
    if "@import" in plain.lower():
        raise InputError(what, f"the element <{name}> imports a style sheet (@import)", _ALONE)
    for match in _URL.finditer(plain):
        _check_link(match[1], name, what)


def _check_link(link: str, name: str, what: str) -> None:
    """Only a fragment of the same file, or an embedded PNG or JPEG, may be referred to."""
    link = link.strip()
    if not link or link.startswith("#"):
        return
    embedded = _EMBEDDED.fullmatch(link)
    if embedded is None:
        shown = link if len(link) <= 60 else link[:57] + "..."
        raise InputError(
            what, f"the element <{name}> refers to something outside the file ({shown!r})", _ALONE
        )
    try:
        data = unquote_to_bytes(embedded["data"])
        if embedded["options"].strip().lower().endswith("base64"):
            data = base64.b64decode(data)
    except (binascii.Error, ValueError) as error:
        raise InputError(
            what, f"the picture embedded in <{name}> is damaged", "Embed it again."
        ) from error
    decode(data, f"{what}, the picture embedded in <{name}>", smallest=1)


def _check_element(element: Element, what: str) -> None:
    name = str(element.tag).rpartition("}")[2]
    if name.lower() == "script":
        raise InputError(what, f"it contains a script (the element <{name}>)", _ALONE)
    for key, value in element.attrib.items():
        attribute = key.rpartition("}")[2].lower()
        if attribute in _LINKS:
            _check_link(value, name, what)
        elif attribute.startswith("on") and key == attribute:
            raise InputError(what, f"the element <{name}> carries a script ({attribute})", _ALONE)
        elif "url" in value.lower() or "\\" in value or "@" in value:
            _check_css(value, name, what)
    if name.lower() == "style" and element.text:
        _check_css(element.text, name, what)


def _parse(data: bytes, what: str) -> Element:
    """The root element of a harmless SVG.

    Raises:
        InputError: not XML, not SVG, entity declarations, or anything that reaches outside.
    """
    from defusedxml.common import DefusedXmlException, EntitiesForbidden
    from defusedxml.ElementTree import fromstring

    if re.search(rb"<\?xml-stylesheet\b", data.replace(b"\0", b"")):
        raise InputError(what, "the instruction <?xml-stylesheet?> loads a style sheet", _ALONE)
    try:
        root: Element = fromstring(data, forbid_dtd=False, forbid_entities=True)
    except EntitiesForbidden as error:
        raise InputError(
            what,
            f"it declares an XML entity (<!ENTITY {error.name}>), which may hide a bomb",
            "Save it as a plain SVG without a document type.",
        ) from error
    except DefusedXmlException as error:
        raise InputError(
            what,
            "its document type (<!DOCTYPE>) refers to something outside the file",
            "Save it as a plain SVG without a document type.",
        ) from error
    except (ParseError, ValueError, LookupError) as error:
        raise InputError(
            what, f"it is not valid XML ({error})", "Export the SVG again from its editor."
        ) from error
    if root.tag != f"{_SVG}svg":
        raise InputError(
            what,
            f"its outermost element is <{str(root.tag).rpartition('}')[2]}>, "
            'not <svg xmlns="http://www.w3.org/2000/svg">',
            "Export the picture as SVG.",
        )
    for element in root.iter():
        if isinstance(element.tag, str):
            _check_element(element, what)
    return root


def render_svg(data: bytes, what: str) -> bytes:
    """Check an SVG file and render it to a canonical PNG.

    Args:
        data: the file's bytes, any XML encoding, not compressed.
        what: how an error names the picture.

    Returns:
        An RGBA PNG, the longer side 2048 px (more only where the shorter would fall below 16 px),
        the aspect ratio kept, transparent where nothing is drawn.

    Raises:
        InputError: anything but a harmless SVG that can be rendered; it names the element.
    """
    if data[:2] == b"\x1f\x8b":
        raise InputError(what, "it is a compressed SVG", "Save it as a plain, uncompressed SVG.")
    root = _parse(data, what)
    set_pixel_size(root, LARGEST_SIDE, what)
    text = any(str(e.tag) in (f"{_SVG}text", f"{_SVG}tspan") for e in root.iter())
    # Rendered from the tree that was checked: no second parser sees the original bytes.
    return render(tostring(root, encoding="unicode"), what, fonts=text)


def render(svg: str, what: str, *, fonts: bool = False) -> bytes:
    """Render trusted SVG text to an RGBA PNG as `render_svg` says; `fonts` serves <text>."""
    png = _render_at(svg, what, LONGER_SIDE, fonts)
    if min(struct.unpack(">II", png[16:24])) < SMALLEST_SIDE:  # width and height in the header
        png = _render_at(svg, what, LARGEST_SIDE, fonts)
    return png


def _render_at(svg: str, what: str, side: int, fonts: bool) -> bytes:
    """A PNG whose longer side is `side` pixels (given both, resvg keeps the aspect ratio)."""
    import resvg_py

    options: dict[str, Any] = {"skip_system_fonts": True}
    if fonts:
        import matplotlib

        options = {
            "font_dirs": [f"{matplotlib.get_data_path()}/fonts/ttf"],
            "font_family": "DejaVu Sans",
            "sans_serif_family": "DejaVu Sans",
            "serif_family": "DejaVu Serif",
            "monospace_family": "DejaVu Sans Mono",
        }
    try:
        # without a resolution resvg takes every length in mm, pt, in, ... for nothing
        png = resvg_py.svg_to_bytes(svg, width=side, height=side, dpi=CSS_DPI, **options)
    except ValueError as error:
        raise InputError(
            what,
            f"it cannot be rendered ({error})",
            "Open it in an SVG editor, check its size, and save it as a plain SVG.",
        ) from error
    return bytes(png)
