"""The XML of one model of a 3MF package, read as a stream: objects, components, build items and unit.

Read by expat and not by lib3mf: that follows components while it reads, so that a few lines of XML
may ask it for a billion triangles, and its time grows with the square of the number of objects.
Here every element costs the same, and nothing is placed before it has been counted. The names are
those of the 3MF Core Specification 1.3 and, for `path`, of its Production Extension 1.1.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any
from xml.parsers import expat

import numpy as np

from knotfab_formats.errors import short
from knotfab_validators.arrays import Array, Ints
from knotfab_validators.check import BadFile
from knotfab_validators.files.threemf_rows import Rows, cut_rows

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
UNDERSTOOD = {  # namespaces that a file may require; any other may change the shape
    CORE,
    PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}
RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
START_PART = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
THUMBNAIL = f"{RELATIONS}/metadata/thumbnail"
UNITS = {  # mm
    "micron": 0.001,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
TYPES = ("model", "solidsupport", "support", "surface", "other")  # types of objects
DEEPEST = 100  # nested elements; a model needs six
MOST_OBJECTS = 50_000
MOST_PLACED = 50_000  # components and build items
BLOCK = 1 << 18  # bytes given to expat at a time
MOST_AT_ONCE = 128_000_000  # bytes up to which a model's rows of numbers are read by numpy
MOST_DOUBTS = 20
LONGEST = 1_000_000  # bytes between the ends of two tags
NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*", re.ASCII)
WHOLE = re.compile(r"\s*\+?\d{1,18}\s*", re.ASCII)

MODEL, RESOURCES, OBJECT = f"{CORE} model", f"{CORE} resources", f"{CORE} object"
MESH, VERTICES, VERTEX = f"{CORE} mesh", f"{CORE} vertices", f"{CORE} vertex"
TRIANGLES, TRIANGLE = f"{CORE} triangles", f"{CORE} triangle"
COMPONENTS, COMPONENT = f"{CORE} components", f"{CORE} component"
METADATA = f"{CORE} metadata"
BUILD, ITEM = f"{CORE} build", f"{CORE} item"
GROUP, MATERIALS = f"{CORE} metadatagroup", f"{CORE} basematerials"
UUID = f"{PRODUCTION} UUID"
NOTHING: set[str] = set()
OWN = {  # the elements of a build's model, with their attributes: slicers read others as they like
    MODEL: {"unit", "http://www.w3.org/XML/1998/namespace lang"},
    METADATA: {"name", "preserve"},
    MATERIALS: {"id"},
    f"{CORE} base": {"name", "displaycolor"},
    OBJECT: {"id", "name", "type", "pid", "pindex", UUID},
    **dict.fromkeys((RESOURCES, MESH, VERTICES, TRIANGLES, COMPONENTS), NOTHING),
    VERTEX: {"x", "y", "z"},
    TRIANGLE: {"v1", "v2", "v3"},
    COMPONENT: {"objectid", UUID},
    BUILD: {UUID},
    ITEM: {"objectid", UUID},
}
TITLES = {"Title", "Designer", "Description", "LicenseTerms", "Application"}
CURA_KINDS = ("infill_mesh", "cutting_mesh", "anti_overhang_mesh", "support_mesh")
INSIDE = {  # the parents in which each element has a meaning
    RESOURCES: MODEL,
    OBJECT: RESOURCES,
    MESH: OBJECT,
    VERTICES: MESH,
    TRIANGLES: MESH,
    COMPONENTS: OBJECT,
    COMPONENT: COMPONENTS,
    METADATA: MODEL,
    BUILD: MODEL,
    ITEM: BUILD,
}


@dataclass(frozen=True)
class Placed:
    """A component or build item.

    Holds the object's number, the package part that it is in (None: this one), and the (4, 3) matrix that
    multiplies (x, y, z, 1) from the right. An item that is not `printed` is there to be looked at.
    """

    number: int
    part: str | None
    matrix: Array
    printed: bool = True


@dataclass
class Shape:
    """An object of one of the `TYPES`: a mesh in the model's unit, or components.

    Points are rounded to single precision, as slicers and lib3mf hold them, so that the checks see
    the same mesh.
    """

    points: array[float] = field(default_factory=lambda: array("f"))
    corners: array[int] = field(default_factory=lambda: array("q"))
    components: list[Placed] = field(default_factory=list)
    kind: str = "model"
    steers: str = ""  # Cura's name of what it is, if that only steers the slicer

    @property
    def vertices(self) -> Array:
        """(n, 3)"""
        return np.frombuffer(self.points, dtype=np.float32).reshape(-1, 3).astype(np.float64)

    @property
    def faces(self) -> Ints:
        """(m, 3)"""
        return np.frombuffer(self.corners, dtype=np.int64).reshape(-1, 3)


@dataclass
class Model:
    """One model part: its objects by number, its build items, and its unit in mm.

    `doubts` are words for what some slicers read in another way than the standard has it.
    """

    unit_mm: float = 1.0
    shapes: dict[int, Shape] = field(default_factory=dict)
    items: list[Placed] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def read_model(blocks: Iterable[bytes], name: str) -> Model:
    """Read the model from XML that comes in blocks.

    Long rows of vertices and triangles in the usual notation are cut out first and parsed by numpy, ten
    times as fast as element by element. They are put back when expat reaches the tag before them. If it
    does not reach all of those tags (one is in a comment), everything is read element by element.

    Raises:
        BadFile: it is not a 3MF model; the message says what is wrong with it.
    """
    stream = iter(blocks)
    text = _gather(stream)
    rest, rows = cut_rows(text) if len(text) <= MOST_AT_ONCE else (text, {})
    reader = _Reader(name, rows)
    parse_xml(
        chain(_slice(rest), stream), name, reader.start, reader.end, reader.declare, reader.watch
    )
    if reader.rows:
        reader = _Reader(name, {})
        parse_xml(_slice(text), name, reader.start, reader.end, reader.declare, reader.watch)
    if not reader.found:
        raise BadFile(f"{name}: its model part is no 3MF model")
    for number, shape in reader.model.shapes.items():
        count, faces = len(shape.points) // 3, shape.faces
        outside = ((faces < 0) | (faces >= count)).any(axis=1)
        if outside.any():
            bad = int(outside.argmax())
            named = int(faces[bad].min() if faces[bad].min() < 0 else faces[bad].max())
            raise BadFile(
                f"{name}: triangle {bad} of object {number} names vertex {named}, and there are {count}"
            )
    return reader.model


def _gather(stream: Iterator[bytes]) -> bytes:
    """Join the first blocks, up to somewhat more than `MOST_AT_ONCE` bytes."""
    taken, size = [], 0
    for block in stream:
        taken.append(block)
        size += len(block)
        if size > MOST_AT_ONCE:
            break
    return b"".join(taken)


def _slice(text: bytes) -> Iterator[bytes]:
    """Split the text into blocks, so that a tag that never ends is noticed."""
    return (text[k : k + BLOCK] for k in range(0, len(text), BLOCK))


def read_relations(blocks: Iterable[bytes], name: str, doubts: list[str]) -> list[str]:
    """Read which parts of the package are models, from the XML of `_rels/.rels` or another part's.

    `doubts` gets words for relations of other kinds than a build's.

    Raises:
        BadFile: it leads out of the package.
    """
    found: list[str] = []

    def start(tag: str, given: dict[str, str]) -> None:
        if tag != f"{RELATIONS} Relationship":
            return
        if given.get("TargetMode", "").lower() == "external":
            target = short(given.get("Target", ""))
            raise BadFile(
                f"{name}: refers to something outside the file, {target}, which 3MF forbids"
            )
        if given.get("Type") == START_PART:
            found.append(given.get("Target", ""))
        elif given.get("Type") != THUMBNAIL:
            doubts.append(f"a relation to {short(given.get('Target', ''))}")

    parse_xml(blocks, name, start, lambda tag: None, lambda prefix, uri: None)
    return found


def parse_xml(
    blocks: Iterable[bytes],
    name: str,
    start: Callable[[str, dict[str, str]], None],
    end: Callable[[str], None],
    declared: Callable[[str, str], None],
    watched: Callable[[Any], None] = lambda parser: None,
) -> None:
    """Feed XML to expat, and refuse a tag whose end never comes."""
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartNamespaceDeclHandler = declared
    watched(parser)

    def refuse(*_: object) -> None:
        raise BadFile(f"{name}: has an XML document type, which no 3MF needs")

    parser.StartDoctypeDeclHandler = refuse
    fed = 0
    try:
        for block in blocks:
            parser.Parse(block, False)
            fed += len(block)
            if fed - parser.CurrentByteIndex > LONGEST + len(block):
                raise BadFile(
                    f"{name}: is not a 3MF file: it has a tag of more than {LONGEST} bytes"
                )
            # distinct names of elements and attributes: expat keeps each
            if len(parser.intern) > 20_000:
                raise BadFile(f"{name}: is not a 3MF file: its XML has too many names")
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise BadFile(f"{name}: is not a 3MF file, or is damaged: its XML has {error}") from error
    except (ValueError, LookupError) as error:  # an unknown encoding
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"{name}: is not a 3MF file, or is damaged ({short(error)})") from error


class _Reader:
    """Handles expat's events; elements whose parent gives them no meaning are skipped."""

    def __init__(self, name: str, rows: dict[int, Rows]) -> None:
        self.name, self.model, self.found, self.rows = name, Model(), False, rows
        self.way: list[str] = [""]
        self.spaces: dict[str, str] = {}
        self.shape, self.placed = Shape(), 0
        self.told: set[str] = set()
        self.materials: set[str | None] = {None}
        self.cura, self.said = "", ""  # metadata of an object that is open, and its text

    def watch(self, parser: Any) -> None:
        """Keep the parser, which knows its position in the text."""
        self.parser = parser
        parser.CharacterDataHandler = self.read
        parser.CommentHandler = lambda _: self._doubt("a comment")
        parser.ProcessingInstructionHandler = lambda *_: self._doubt("an instruction")
        parser.StartCdataSectionHandler = lambda: self._doubt("raw text")
        parser.XmlDeclHandler = self.declare_xml

    def declare_xml(self, version: str, encoding: str | None, alone: int) -> None:
        if (encoding or "utf-8").lower() != "utf-8":
            self._doubt(f"the encoding {short(encoding or '')}")

    def read(self, text: str) -> None:
        if self.way[-1] != METADATA and text.strip():
            self._doubt("text between its elements")
        if self.cura and len(self.said) < 10:
            self.said += text.strip()

    def declare(self, prefix: str, uri: str) -> None:
        self.spaces[prefix] = uri
        if uri == CORE and prefix:
            self._doubt("a prefix before its elements")

    def _doubt(self, what: str) -> None:
        if len(self.model.doubts) < MOST_DOUBTS and what not in self.model.doubts:
            self.model.doubts.append(what)

    def end(self, tag: str) -> None:
        self.way.pop()
        if self.cura and tag == METADATA:
            if self.said.lower() == "true":
                self.shape.steers = self.cura
            self.cura = ""

    def start(self, tag: str, given: dict[str, str]) -> None:
        way = self.way
        if tag == TRIANGLE and way[-1] == TRIANGLES:
            try:
                a, b, c = given["v1"], given["v2"], given["v3"]
                self.shape.corners.extend((int(a), int(b), int(c)))
            except (KeyError, ValueError, OverflowError) as error:
                raise self._wrong("triangle", "indices", given) from error
            if not (digits := a + b + c).isascii() or "_" in digits:
                raise self._wrong("triangle", "indices", given)
        elif tag == VERTEX and way[-1] == VERTICES:
            try:
                a, b, c = given["x"], given["y"], given["z"]
                self.shape.points.extend((float(a), float(b), float(c)))
            except (KeyError, ValueError) as error:
                raise self._wrong("vertex", "numbers", given) from error
            if not (digits := a + b + c).isascii() or "_" in digits:
                raise self._wrong("vertex", "numbers", given)
        elif INSIDE.get(tag, "") == way[-1]:
            self._rare(tag, given)
        elif tag == METADATA and way[-1] == GROUP:
            if (name := given.get("name", "").lower()).endswith(CURA_KINDS):
                self.cura, self.said = short(name), ""
        elif way[-1] not in (MATERIALS, RESOURCES):
            self._doubt(f"the element {short(tag.rpartition(' ')[2])} where it has no meaning")
        self._compare(tag, given)
        if self.rows and tag in (VERTICES, TRIANGLES):
            self._take_rows(tag)
        way.append(tag)
        if len(way) > DEEPEST:
            raise BadFile(f"{self.name}: its XML is nested more than {DEEPEST} deep")

    def _compare(self, tag: str, given: dict[str, str]) -> None:
        """Doubt an element or attribute that no build writes."""
        own, name = OWN.get(tag), short(tag.rpartition(" ")[2])
        if own is None:
            self._doubt(f"the element {name}")
        elif not given.keys() <= own:
            more = min(given.keys() - own).rpartition(" ")[2]
            self._doubt(f"the attribute {short(more)} of {name}")
        if not all(map(str.isprintable, given.values())):
            self._doubt(f"an attribute of {name} of several lines")
        if tag == METADATA and (word := given.get("name", "")) not in TITLES:
            self._doubt(f"the setting {short(word)}")
        if tag == MATERIALS:
            self.materials.add(given.get("id"))
        if tag == OBJECT and given.get("pid") not in self.materials:
            self._doubt("an object of a material that is not there")
        if tag == OBJECT and given.get("type", "model") != "model":
            self._doubt(f"an object of the type {short(given['type'])}")

    def _take_rows(self, tag: str) -> None:
        """Take the rows that were cut out behind this tag, if there were any."""
        rows = self.rows.get(self.parser.CurrentByteIndex)
        if rows is None or tag != f"{CORE} {rows.kind}":
            return
        del self.rows[self.parser.CurrentByteIndex]
        if tag == VERTICES:
            self.shape.points.frombytes(rows.numbers.astype(np.float32).tobytes())
        else:
            self.shape.corners.frombytes(rows.numbers.astype(np.int64).tobytes())

    def _wrong(self, what: str, parts: str, given: dict[str, str]) -> BadFile:
        said = short(", ".join(f"{key} {value}" for key, value in list(given.items())[:3]))
        return BadFile(f"{self.name}: has a {what} that is not three {parts} ({said})")

    def _rare(self, tag: str, given: dict[str, str]) -> None:
        if tag == MODEL:
            self._model(given)
        elif tag == OBJECT:
            number = self._number(given, "id", "an object")
            if number in self.model.shapes:
                raise BadFile(f"{self.name}: has two objects of the number {number}")
            if len(self.model.shapes) == MOST_OBJECTS:
                raise BadFile(f"{self.name}: has more than {MOST_OBJECTS} objects")
            if (kind := given.get("type", "model")) not in TYPES:
                raise BadFile(
                    f"{self.name}: object {number} is of the type {short(kind)}, not known to 3MF"
                )
            self.shape = self.model.shapes[number] = Shape(kind=kind)
            self.within: set[str] = set()
        elif tag in (MESH, VERTICES, TRIANGLES, COMPONENTS):
            if tag in self.within or {MESH, COMPONENTS} <= {tag, *self.within}:
                self._doubt("an object of two meshes, or of a mesh and components")
            self.within.add(tag)
        elif tag == COMPONENT:
            self.shape.components.append(self._read_placement(given, "a component"))
        elif tag == METADATA:
            if (key := given.get("name", "")) in self.told:
                raise BadFile(f"{self.name}: has the metadata {short(key)} twice")
            self.told.add(key)
        elif tag == ITEM:
            self.model.items.append(self._read_placement(given, "a build item"))

    def _model(self, given: dict[str, str]) -> None:
        self.found = True
        unit = given.get("unit", "millimeter")
        if unit not in UNITS:
            raise BadFile(f"{self.name}: its unit is {short(unit)}, which 3MF does not know")
        self.model.unit_mm = UNITS[unit]
        for prefix in given.get("requiredextensions", "").split():
            uri = self.spaces.get(prefix, prefix)
            if uri not in UNDERSTOOD:
                raise BadFile(f"{self.name}: needs an extension of 3MF not read here, {short(uri)}")

    def _number(self, given: dict[str, str], key: str, what: str) -> int:
        word = given.get(key, "")
        if not WHOLE.fullmatch(word):
            raise BadFile(f"{self.name}: has {what} whose {key} is {short(word)}, no number")
        return int(word)

    def _read_placement(self, given: dict[str, str], what: str) -> Placed:
        self.placed += 1
        if self.placed > MOST_PLACED:
            raise BadFile(f"{self.name}: places more than {MOST_PLACED} objects")
        words = given.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()
        if len(words) != 12 or not all(NUMBER.fullmatch(word) for word in words):
            shown = short(" ".join(words))
            raise BadFile(f"{self.name}: has {what} with a transform of no 12 numbers, {shown}")
        matrix = np.array([float(word) for word in words]).reshape(4, 3)
        part = given.get(f"{PRODUCTION} path")
        printed = given.get("printable", "1").strip().lower() not in ("0", "false")
        return Placed(self._number(given, "objectid", what), part, matrix, printed)
