"""The triangles of a 3MF file by lib3mf, after its archive has been found to be harmless."""

from __future__ import annotations

import io
import locale
import re
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import BadFile, Corners

__all__ = ["corners_3mf", "is_3mf"]

MOST_UNPACKED = 1_000_000_000  # bytes of all entries
SUSPICIOUS = 50_000_000  # bytes above which an archive must not be packed too well
MOST_RATIO = 50  # of unpacked to packed; meshes reach about 10
MOST_ENTRIES = 10_000
MOST_TRIANGLES = 20_000_000  # of all instances together
BLOCK = 1 << 20
# an object or a component and which, or a triangle
TAGS = re.compile(
    rb"<(?:\w+:)?(object|component|triangle)\b(?:[^>]{0,500}?\b(?:object)?id=[\"'](\w+)[\"'])?"
)
MM_PER_UNIT = (0.001, 1.0, 10.0, 25.4, 304.8, 1000.0)  # micrometre, mm, cm, inch, foot, metre


def is_3mf(content: bytes) -> bool:
    return content[:4] == b"PK\x03\x04"


def corners_3mf(content: bytes, name: str) -> Corners:
    """(m, 3, 3) corners of all build items, mm.

    Nothing is unpacked to disk, so names such as `../x` in the archive do no harm.

    Raises:
        BadFile: the archive is damaged, unpacks to far more than a mesh would, or is no 3MF.
    """
    import lib3mf

    _require_harmless(content, name)
    before = locale.setlocale(locale.LC_ALL)  # lib3mf sets it to "C", where text files are ASCII
    try:
        model = lib3mf.get_wrapper().CreateModel()
        model.QueryReader("3mf").ReadFromBuffer(content)
        scale = MM_PER_UNIT[int(model.GetUnit())]
        objects = model.MergeToModel().GetMeshObjects()  # one per build item, transforms applied
        parts: list[NDArray[np.floating[Any]]] = [np.empty((0, 3, 3))]
        while objects.MoveNext():
            body = objects.GetCurrentMeshObject()
            n, m = body.GetVertexCount(), body.GetTriangleCount()
            if not n or not m:
                continue
            points = (lib3mf.Position * n)(*body.GetVertices())
            corners = (lib3mf.Triangle * m)(*body.GetTriangleIndices())
            vertices = np.frombuffer(points, dtype=np.float32).reshape(n, 3)
            faces = np.frombuffer(corners, dtype=np.uint32).reshape(m, 3)
            parts.append(vertices[faces] * scale)
    except BadFile:
        raise
    except Exception as error:  # a parser that meets garbage may raise anything
        raise BadFile(f"{name}: is not a 3MF file, or is damaged") from error
    finally:
        locale.setlocale(locale.LC_ALL, before)
    return np.concatenate(parts)


def _require_few(xml: bytes, name: str) -> None:
    """Count the triangles of all instances before any is made: components may multiply without end.

    lib3mf follows components as it reads, so that it must not be asked.
    """
    if b"component" not in xml:
        return
    size: dict[bytes, int] = {}
    here = b""
    for tag, key in TAGS.findall(xml):
        if tag == b"object":
            here = key
            size[here] = 0
        else:
            more = 1 if tag == b"triangle" else size.get(key, 0)
            size[here] = min(size.get(here, 0) + more, 2 * MOST_TRIANGLES)
    if max(size.values(), default=0) > MOST_TRIANGLES:
        raise BadFile(f"{name}: its components make more than {MOST_TRIANGLES} triangles")


def _require_harmless(content: bytes, name: str) -> None:
    """Unpack every entry once, counting: what an archive says of its own sizes proves nothing."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if len(entries) > MOST_ENTRIES:
                raise BadFile(f"{name}: has {len(entries)} entries, too many for a 3MF")
            unpacked = 0
            for entry in entries:
                with archive.open(entry) as stream:
                    head = stream.read(BLOCK)
                    is_model = entry.filename.lower().endswith(".model")
                    xml = [head] if is_model else []
                    if b"<!DOCTYPE" in head or b"<!ENTITY" in head:
                        raise BadFile(f"{name}: has an XML document type, which no 3MF needs")
                    size = len(head)
                    while size and (block := stream.read(BLOCK)):
                        size += len(block)
                        xml += [block] if is_model else []
                        _require_sane(unpacked + size, len(content), name)
                _require_few(b"".join(xml), name)
                unpacked += size
                _require_sane(unpacked, len(content), name)
    except BadFile:
        raise
    except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, ValueError, EOFError,
            NotImplementedError) as error:  # fmt: skip
        raise BadFile(f"{name}: is not a 3MF file, or is damaged") from error


def _require_sane(unpacked: int, packed: int, name: str) -> None:
    if unpacked > MOST_UNPACKED or (unpacked > SUSPICIOUS and unpacked > MOST_RATIO * packed):
        raise BadFile(
            f"{name}: unpacks to more than {unpacked // 10**6} MB from {packed / 1e6:.3g} MB, which is "
            "no mesh"
        )
