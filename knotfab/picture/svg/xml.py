"""Parse an SVG file in any encoding into a tree, without entity bombs or external loading."""

from __future__ import annotations

import codecs
import re
import zlib
from html.entities import html5
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from knotfab_formats.errors import InputError

SVG = "http://www.w3.org/2000/svg"
XLINK = "http://www.w3.org/1999/xlink"

_DEEPEST = 100  # elements in each other; what draws and what writes them recurses
_MOST = 300_000  # elements
_LARGEST = 64 * 2**20  # bytes of a compressed file, unpacked
_BOMS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_DECLARATION = re.compile(r"<\?xml\s[^>]{0,1000}>")
_ENCODING = re.compile(rb"""<\?xml\s[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)""")
_REFERENCE = re.compile(r"&([A-Za-z_][\w.-]*);")
_PREFIX = re.compile(r"(?:</?|\s)([A-Za-z_][\w.-]*):[A-Za-z_]")
_ROOT = re.compile(r"<(?:[\w.-]+:)?svg\b")
_ALONE = "Save it as a plain SVG that stands alone (links embedded or removed)."
_XML_ENTITIES = ("amp", "lt", "gt", "quot", "apos")


def looks_like_svg(data: bytes) -> bool:
    """Return whether the bytes begin like XML that soon opens an svg element."""
    if data.startswith(b"\x1f\x8b"):
        try:
            data = zlib.decompressobj(31).decompress(data, 65536)
        except zlib.error:
            return False
    head = data[:4096].replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n")
    return head.startswith(b"<") and bool(
        _ROOT.search(data[:65536].replace(b"\0", b"").decode("latin-1"))
    )


def local_name(element: Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def unzip(data: bytes, what: str) -> bytes:
    """Unpack a compressed SVG (.svgz); other data stays as it is."""
    if not data.startswith(b"\x1f\x8b"):
        return data
    packed = zlib.decompressobj(31)
    try:
        plain = packed.decompress(data, _LARGEST)
    except zlib.error as error:
        raise InputError(
            what, "the compressed SVG is damaged", "Save it as a plain, uncompressed SVG."
        ) from error
    if not packed.eof:
        raise InputError(
            what,
            f"the compressed SVG is cut short, or unpacks to more than {_LARGEST // 2**20} MB",
            "Save it as a plain, uncompressed SVG.",
        )
    return plain


def _decode(data: bytes, what: str) -> str:
    """Decode an XML file's text, without its declaration and leading blank lines."""
    data = data.lstrip(b" \t\r\n")
    mark = next((m for m in _BOMS if data.startswith(m)), None)
    said = _ENCODING.match(data[:1000])
    if mark is not None:
        data, encoding = data[len(mark) :], _BOMS[mark]
    elif b"\0" in data[:2]:
        encoding = "utf-16-le" if data[1:2] == b"\0" else "utf-16-be"
    else:
        encoding = "utf-8" if said is None else said[1].decode("ascii")
    try:
        text = data.decode(encoding)
    except LookupError as error:
        raise InputError(
            what, f"its encoding is not known ({encoding})", "Save the SVG as UTF-8."
        ) from error
    except UnicodeError as error:
        raise InputError(
            what, f"it is not valid XML: its text is no {encoding}", "Save the SVG as UTF-8."
        ) from error
    text = text.lstrip("\0 \t\r\n\ufeff")
    if declared := _DECLARATION.match(text):
        text = text[declared.end() :]
    return text.strip("\0 \t\r\n\ufeff")


class _Builder:
    """A tree builder for expat that refuses what is too deep, too large or external."""

    def __init__(self, text: str, what: str) -> None:
        self._what = what
        self._tree = TreeBuilder()
        self._depth = self._count = self._characters = 0
        self._allowed = 4 * len(text) + 10**6
        self._entities: dict[str, int] = {}
        parser = expat.ParserCreate("utf-8", "}")
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._add
        parser.EntityDeclHandler = self._declare
        parser.ExternalEntityRefHandler = self._refuse_outside
        parser.Parse(text.encode(), True)
        self.root: Element = self._tree.close()

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._count += 1
        if self._depth > _DEEPEST:
            raise InputError(
                self._what,
                f"its elements are nested more than {_DEEPEST} deep",
                "Ungroup the drawing in an SVG editor and save it again.",
            )
        if self._count > _MOST:
            raise InputError(
                self._what,
                f"it has more than {_MOST} elements",
                "Simplify it, or save it as a PNG.",
            )
        self._weigh(sum(map(len, attributes.values())))
        self._tree.start(_clark(name), {_clark(k): v for k, v in attributes.items()})

    def _end(self, name: str) -> None:
        self._depth -= 1
        self._tree.end(_clark(name))

    def _add(self, text: str) -> None:
        self._weigh(len(text))
        self._tree.data(text)

    def _weigh(self, characters: int) -> None:
        self._characters += characters
        if self._characters > self._allowed:
            raise self._bomb()

    def _bomb(self) -> InputError:
        return InputError(
            self._what,
            "the XML entities that it declares (<!ENTITY>) write out to a bomb",
            "Save it as a plain SVG without a document type.",
        )

    def _declare(self, name: str, parameter: bool, value: str | None, *rest: Any) -> None:
        if value is None or parameter:
            self._refuse_outside()
        inner = sum(self._entities.get(n, 0) for n in _REFERENCE.findall(value or ""))
        self._entities[name] = len(value or "") + inner
        if self._entities[name] > 10_000:  # characters, all its references written out
            raise self._bomb()

    def _refuse_outside(self, *_: Any) -> int:
        raise InputError(
            self._what,
            "an XML entity in its document type (<!DOCTYPE>) refers to something outside the file",
            "Save it as a plain SVG without a document type.",
        )


def _clark(name: str) -> str:
    return f"{{{name}" if "}" in name else name


def _name_characters(text: str) -> str:
    """Replace HTML's named characters (&nbsp;), which XML does not know."""

    declared = {*_XML_ENTITIES, *re.findall(r"<!ENTITY\s+([^\s%]+)\s", text)}

    def write(match: re.Match[str]) -> str:
        return match[0] if match[1] in declared else html5.get(f"{match[1]};", match[0])

    return _REFERENCE.sub(write, text)


def _bind_prefixes(text: str) -> str:
    """Declare undeclared namespace prefixes in the outermost element."""
    known = {"xlink": XLINK, "svg": SVG}
    declared = {"xml", "xmlns", *re.findall(r"\sxmlns:([\w.-]+)\s*=", text)}
    new = "".join(
        f' xmlns:{p}="{known.get(p, f"urn:prefix:{p}")}"'
        for p in sorted(set(_PREFIX.findall(text)) - declared)
    )
    return _ROOT.sub(lambda match: match[0] + new, text, count=1)


def parse_svg(data: bytes, what: str) -> Element:
    """Parse an SVG file; all drawn elements come back in SVG's namespace.

    Blank lines before the declaration, undeclared prefixes and a missing namespace are mended. Internal
    entities are expanded up to a limit.

    Raises:
        InputError: not XML, not SVG, a bomb, too deep, or a document type that reaches outside.
    """
    text = _name_characters(_decode(unzip(data, what), what))
    if re.search(r"<\?xml-stylesheet\b", text):
        raise InputError(what, "the instruction <?xml-stylesheet?> loads a style sheet", _ALONE)
    try:
        try:
            root = _Builder(text, what).root
        except expat.ExpatError as error:
            if error.code != expat.errors.codes[expat.errors.XML_ERROR_UNBOUND_PREFIX]:
                raise
            root = _Builder(_bind_prefixes(text), what).root
    except expat.ExpatError as error:
        raise InputError(
            what,
            f"it is not valid XML ({error})",
            "Open it in a browser or in Inkscape, which show the fault, and export it again.",
        ) from error
    if local_name(root) != "svg":
        raise InputError(
            what,
            f"its outermost element is <{local_name(root)}>, not <svg>",
            "Export the picture as SVG.",
        )
    own = str(root.tag).rpartition("}")[0]  # "" or "{namespace"
    if own != f"{{{SVG}":
        for element in root.iter():
            if str(element.tag).rpartition("}")[0] == own:
                element.tag = f"{{{SVG}}}{local_name(element)}"
    return root
