"""The triangles of a PLY file (Stanford): text or binary of either byte order, polygons cut into fans."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.geometry.mesh import Corners

__all__ = ["corners_ply", "is_ply"]


MOST_HEADER = 100_000  # bytes
MOST_CORNERS = 10_000  # corners of one face
BLANKS = b"\r\n\0 "  # that some programs put after the end
KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass
class _Element:
    """What the header says of an element: `properties` are (name, kind, kind of a list's count)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)

    @property
    def least_bytes(self) -> int:
        return sum(int((length or kind)[1]) for _, kind, length in self.properties)

    def number(self, name: str) -> int:
        """Return the number of the property of that name; -1 if none."""
        names = [n for n, _, _ in self.properties]
        return names.index(name) if name in names else -1


def is_ply(content: bytes) -> bool:
    return content[:4] in (b"ply\n", b"ply\r")


def corners_ply(content: bytes, name: str) -> Corners:
    """(m, 3, 3) corners of the element `face`; other elements and properties are passed over.

    Units are not known to the format, and taken as mm.

    Raises:
        BadFile: the header is broken, the file is shorter than it promises, or a face names a
            vertex that is not there.
    """
    order, elements, start = _header(content, name)
    body: _Body = (
        _Text(content, start, name) if order == "" else _Binary(content, start, name, order)
    )
    vertices: Array | None = None
    faces: Ints | None = None
    for element in elements:
        if element.name == "vertex":
            columns = [element.number(axis) for axis in "xyz"]
            if min(columns) < 0 or any(length for _, _, length in element.properties):
                raise BadFile(f"{name}: its vertices have no plain x, y and z")
            vertices = body.table(element)[:, columns]
        elif element.name == "face":
            polygons = body.lists(element, _indices(element, name))
            if any(group.shape[1] < 3 for group in polygons):
                raise BadFile(f"{name}: has a face of fewer than three corners")
            faces = _fans(polygons)
        elif element.name == "tristrips":
            raise BadFile(f"{name}: has strips of triangles, which are not read")
        else:
            body.lists(element, -1)
    body.require_end()
    if vertices is None or faces is None:
        raise BadFile(f"{name}: has no vertices or no faces")
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        bad = int(faces.max() if faces.max() >= len(vertices) else faces.min())
        raise BadFile(f"{name}: a face names vertex {bad}, and there are {len(vertices)}")
    corners: Corners = vertices[faces]
    return corners


def _indices(element: _Element, name: str) -> int:
    at = max(element.number("vertex_indices"), element.number("vertex_index"))
    if at < 0 or element.properties[at][2] is None or element.properties[at][1][0] == "f":
        raise BadFile(f"{name}: its faces have no list of vertex_indices")
    return at


def _fans(polygons: list[Ints]) -> Ints:
    """(m, 3) triangles of polygons, given in groups (k, corners) of equal numbers of corners."""
    parts = [np.empty((0, 3), dtype=np.int64)]
    for group in polygons:
        for i in range(1, group.shape[1] - 1):
            parts.append(group[:, [0, i, i + 1]])
    return np.concatenate(parts)


def _header(content: bytes, name: str) -> tuple[str, list[_Element], int]:
    """Byte order (none: text), the elements, and where the header ends."""
    end = content.find(b"end_header", 0, MOST_HEADER)
    stop = content.find(b"\n", end)
    if end < 0 or stop < 0:
        raise BadFile(f"{name}: its PLY header has no end")
    order, elements = None, []
    for line in content[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                order = ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2])))
            elif words[0] == "property" and words[1] == "list":
                elements[-1].properties.append((words[4], KINDS[words[3]], KINDS[words[2]]))
            elif words[0] == "property":
                elements[-1].properties.append((words[2], KINDS[words[1]], None))
            else:
                raise ValueError
        except (ValueError, KeyError, IndexError) as error:
            raise BadFile(f"{name}: its PLY header has a broken line, {line[:60]!r}") from error
    if order is None:
        raise BadFile(f"{name}: its PLY header names no format")
    for element in elements:
        room = len(content) - stop - 1
        least = element.least_bytes if order else 2 * len(element.properties) - 1
        if element.count < 0 or element.count * max(least, 1) > room + 1:
            raise BadFile(
                f"{name}: promises {element.count} of {element.name}, more than the file can hold"
            )
    return order, elements, stop + 1


class _Body:
    """What follows the header, read element after element."""

    def __init__(self, content: bytes, start: int, name: str) -> None:
        self.content, self.at, self.name = content, start, name

    def table(self, element: _Element) -> Array:
        """(count, properties) of an element without lists."""
        raise NotImplementedError

    def lists(self, element: _Element, wanted: int) -> list[Ints]:
        """The lists of one property, in groups of equal length; passes over all if `wanted` < 0."""
        groups: dict[int, list[list[int]]] = {}
        for _ in range(element.count):
            for number, (_, kind, length) in enumerate(element.properties):
                count = 1 if length is None else self._whole(length)
                if not 0 <= count <= MOST_CORNERS:
                    raise BadFile(f"{self.name}: has a list of {count} entries")
                values = self._take(kind, count, keep=number == wanted)
                if number == wanted:
                    groups.setdefault(count, []).append(values)
        return [np.array(rows, dtype=np.int64).reshape(len(rows), n) for n, rows in groups.items()]

    def require_end(self) -> None:
        """Raise if there is more than the header promises."""
        raise NotImplementedError

    def _too_long(self) -> BadFile:
        return BadFile(f"{self.name}: goes on after what its header promises")

    def _whole(self, kind: str) -> int:
        return self._take(kind, 1, keep=True)[0]

    def _take(self, kind: str, count: int, *, keep: bool) -> list[int]:
        raise NotImplementedError

    def _cut_off(self) -> BadFile:
        return BadFile(f"{self.name}: is cut off, or its header is wrong")


class _Binary(_Body):
    def __init__(self, content: bytes, start: int, name: str, order: str) -> None:
        super().__init__(content, start, name)
        self.order = order

    def require_end(self) -> None:
        if self.content[self.at :].strip(BLANKS):
            raise self._too_long()

    def table(self, element: _Element) -> Array:
        kinds: Any = [
            (str(i), self.order + kind) for i, (_, kind, _) in enumerate(element.properties)
        ]
        rows = self._rows(np.dtype(kinds), element.count)
        with np.errstate(invalid="ignore"):  # NaNs that signal
            return np.column_stack([rows[n].astype(np.float64) for n in rows.dtype.names or ()])

    def lists(self, element: _Element, wanted: int) -> list[Ints]:
        uniform = self._uniform(element)
        if uniform is None:
            return super().lists(element, wanted)
        rows = self._rows(uniform, element.count)
        return (
            [rows[f"v{wanted}"].reshape(element.count, -1).astype(np.int64)] if wanted >= 0 else []
        )

    def _uniform(self, element: _Element) -> np.dtype[Any] | None:
        """The layout of a row if all rows have lists as long as the first one's."""
        if not element.count:
            return None
        layout: list[Any] = []
        here = self.at
        for number, (_, kind, length) in enumerate(element.properties):
            count = 1
            if length is not None:
                layout.append((f"n{number}", self.order + length))
                count = self._whole(length)
            if not 0 <= count <= MOST_CORNERS:
                raise BadFile(f"{self.name}: has a list of {count} entries")
            layout.append((f"v{number}", self.order + kind, (count,)))
            self._take(kind, count, keep=False)
        row, first, self.at = np.dtype(layout), self.at, here
        if first - here != row.itemsize or here + row.itemsize * element.count > len(self.content):
            return None
        rows = np.frombuffer(self.content, row, element.count, here)
        counts = [n for n in row.names or () if n.startswith("n")]
        return row if all((rows[n] == rows[n][0]).all() for n in counts) else None

    def _rows(self, row: np.dtype[Any], count: int) -> NDArray[Any]:
        if self.at + row.itemsize * count > len(self.content):
            raise self._cut_off()
        rows = np.frombuffer(self.content, row, count, self.at)
        self.at += row.itemsize * count
        return rows

    def _take(self, kind: str, count: int, *, keep: bool) -> list[int]:
        size = int(kind[1]) * count
        if self.at + size > len(self.content):
            raise self._cut_off()
        self.at += size
        if not keep:
            return []
        values = np.frombuffer(self.content, self.order + kind, count, self.at - size)
        return [int(v) for v in values] if kind[0] != "f" else [-1] * count


class _Text(_Body):
    def __init__(self, content: bytes, start: int, name: str) -> None:
        super().__init__(content, start, name)
        self.words = content[start:].split()
        self.at = 0
        if b"_" in content[start:]:  # Python's own way of writing numbers
            raise BadFile(f"{name}: has a word that is no number")

    def require_end(self) -> None:
        if self.at < len(self.words):
            raise self._too_long()

    def table(self, element: _Element) -> Array:
        width = len(element.properties)
        words = self.words[self.at : self.at + element.count * width]
        if len(words) < element.count * width:
            raise self._cut_off()
        self.at += len(words)
        try:
            return np.array(words, dtype=np.float64).reshape(-1, width)
        except ValueError as error:
            raise BadFile(f"{self.name}: has a vertex that is not all numbers") from error

    def _take(self, kind: str, count: int, *, keep: bool) -> list[int]:
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            raise self._cut_off()
        self.at += count
        if not keep:
            return []
        try:
            values = [int(word) for word in words]
        except ValueError as error:
            raise BadFile(f"{self.name}: has a face with a corner that is no index") from error
        if any(abs(value) > 2**62 for value in values):
            raise BadFile(f"{self.name}: a face names a vertex that cannot be")
        return values
