"""Files of the part; 3MF by lib3mf, in mm, one object, the same bytes each time."""

from __future__ import annotations

import ctypes
import io
import locale
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
from numpy.typing import NDArray

from knotfab.base.apps import VERSION
from knotfab.geometry.tube import Mesh, face_normals, join_meshes, split_shells
from knotfab_formats.libraries import took_part


@dataclass(frozen=True)
class About:
    """A file's words about itself, under the names of the core specification; "" leaves a line out.

    There is no date: the same build makes the same bytes.
    """

    title: str = "knotfab"
    designer: str = ""
    description: str = ""
    licence: str = ""
    thumbnail_png: bytes = b""


def write_3mf(path: Path, bodies: Sequence[Mesh], about: About = About()) -> None:
    """Write `bodies` (vertices (n, 3) mm, faces (m, 3)) as the shells of one mesh, in ONE object.

    A slicer lets each object that a file places drop onto the bed, PrusaSlicer even each component
    of an object: only the shells of a single mesh stay where they are. The file holds no settings.

    Args:
        about: what the package says of itself; its title is the object's name as well.

    Raises:
        ValueError: a body without faces, or a vertex below zero or not finite (3MF wants the
            positive octant).
    """
    _require_positive(bodies)
    model, wrapper = _new_model(about)
    whole = _add_mesh(wrapper, model, join_meshes(bodies), about.title, 1)
    _write_model(path, model, whole, [about.title])


def write_coloured_3mf(
    path: Path, bodies: Sequence[Mesh], names: Sequence[str], colors: Sequence[str], about: About
) -> None:
    """Write `bodies` as objects with names and colours, for printers with several filaments.

    They are the components of one more object, the only item of the build: by the standard that
    makes them one thing. If a slicer asks whether to load them as one, the answer is yes.

    Args:
        names, colors: one for each body; colours as "#rrggbb" in sRGB.

    Raises:
        ValueError: as `write_3mf`; or there is a name or colour too few, or a colour is malformed.
    """
    _require_positive(bodies)
    if not len(names) == len(colors) == len(bodies):
        raise ValueError(f"{len(bodies)} bodies want as many names and colours")
    model, wrapper = _new_model(about)
    paint = _palette(wrapper, model, colors)
    whole = model.AddComponentsObject()
    for number, (mesh, name, color) in enumerate(zip(bodies, names, colors, strict=True), start=1):
        body = _add_mesh(wrapper, model, mesh, name, number)
        body.SetObjectLevelProperty(*paint[color.lower()])
        component = whole.AddComponent(body, wrapper.GetIdentityTransform())
        component.SetUUID(_uuid(f"component/{number}/{name}"))
    whole.SetName(about.title)
    whole.SetUUID(_uuid("whole/" + "/".join(names)))
    _write_model(path, model, whole, names)


def _require_positive(bodies: Sequence[Mesh]) -> None:
    if not bodies:
        raise ValueError("no bodies make no 3MF")
    for number, (vertices, faces) in enumerate(bodies, start=1):
        if not len(faces) or not np.isfinite(vertices).all() or vertices.min() < 0:
            raise ValueError(
                f"body {number} needs faces, and finite vertices in the positive octant"
            )


def _new_model(about: About) -> tuple[Any, Any]:
    """Make a model in millimetres with its words about itself; return lib3mf's wrapper, too."""
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    took_part("lib3mf", "wrote the 3MF files")
    told = {
        "Title": about.title,
        "Designer": about.designer,
        "Description": about.description,
        "LicenseTerms": about.licence,
        "Application": f"knotfab {VERSION}",
    }
    group = model.GetMetaDataGroup()
    for name, value in told.items():
        if value:
            group.AddMetaData("", name, value, "xs:string", True)
    if about.thumbnail_png:
        model.CreatePackageThumbnailAttachment().ReadFromBuffer(list(about.thumbnail_png))
    return model, wrapper


def _add_mesh(wrapper: Any, model: Any, mesh: Mesh, name: str, number: int) -> Any:
    body = model.AddMeshObject()
    body.SetName(name)
    _set_geometry(wrapper, body, *mesh)
    body.SetUUID(_uuid(f"object/{number}/{name}"))
    return body


def _write_model(path: Path, model: Any, whole: Any, names: Sequence[str]) -> None:
    """Write `whole` as the only item, where it is.

    Every UUID follows from the names, and lib3mf keeps the archive's dates constant, so the file is
    the same byte for byte.
    """
    import lib3mf

    item = model.AddBuildItem(whole, lib3mf.get_wrapper().GetIdentityTransform())
    item.SetUUID(_uuid("item/" + "/".join(names)))
    model.SetBuildUUID(_uuid("build/" + "/".join(names)))
    writer = model.QueryWriter("3mf")
    writer.SetDecimalPrecision(6)  # decimals of a millimetre, written out
    packed = io.BytesIO()  # lib3mf ends the process where a file of its own cannot be written
    write = lib3mf.WriteCallback(lambda data, n, _: packed.write(ctypes.string_at(data, n)) * 0)
    seek = lib3mf.SeekCallback(lambda place, _: packed.seek(place) * 0)
    with _locale_kept():
        writer.WriteToCallback(write, seek, 0)
    path.write_bytes(packed.getvalue())


def read_back_strict(path: Path) -> list[str]:
    """List what lib3mf's strict reader finds wrong with `path`: empty for a clean file."""
    import lib3mf

    reader = lib3mf.get_wrapper().CreateModel().QueryReader("3mf")
    reader.SetStrictModeActive(True)
    took_part("lib3mf", "read them back strictly")
    try:
        with _locale_kept():
            reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        return [str(error)]
    return [str(reader.GetWarning(i)) for i in range(reader.GetWarningCount())]


def read_shells(path: Path) -> list[Mesh]:
    """Read the closed surfaces of a file that `write_3mf` wrote, in its order.

    Transforms are not applied: it writes none but the identity.

    Raises:
        ValueError: the file is not a 3MF, or holds no mesh.
    """
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    try:
        with _locale_kept():
            model.QueryReader("3mf").ReadFromFile(str(path))
        objects = model.GetMeshObjects()
        shells: list[Mesh] = []
        while objects.MoveNext():
            shells += split_shells(_read_geometry(wrapper, objects.GetCurrentMeshObject()))
    except lib3mf.ELib3MFException as error:
        raise ValueError(f"{path.name} is not a 3MF file, or is damaged: {error}") from error
    if not shells:
        raise ValueError(f"{path.name} holds no mesh")
    return shells


def _palette(wrapper: Any, model: Any, colors: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Add the colours to the model as base materials; return each one's resource and property."""
    wanted = dict.fromkeys(color.lower() for color in colors)
    for color in wanted:
        if not re.fullmatch("#[0-9a-f]{6}", color):
            raise ValueError(f"{color!r} is no colour: #rrggbb is one")
    group = model.AddBaseMaterialGroup()
    number = group.GetResourceID()
    found = {}
    for color in wanted:
        red, green, blue = bytes.fromhex(color[1:])
        shade = wrapper.RGBAToColor(red, green, blue, 255)
        found[color] = number, group.AddMaterial(color, shade)
    return found


def _set_geometry(
    wrapper: Any, body: Any, vertices: NDArray[np.float64], faces: NDArray[np.int32]
) -> None:
    # MeshObject.SetGeometry copies structure by structure in Python, 0.7 s for 300,000 faces; the
    # library function beneath it takes the arrays as they are.
    positions = np.ascontiguousarray(vertices, dtype=np.float32)
    triangles = np.ascontiguousarray(faces, dtype=np.uint32)
    import lib3mf

    wrapper.checkError(
        body,
        wrapper.lib.lib3mf_meshobject_setgeometry(
            body._handle,
            ctypes.c_uint64(len(positions)),
            positions.ctypes.data_as(ctypes.POINTER(lib3mf.Position)),
            ctypes.c_uint64(len(triangles)),
            triangles.ctypes.data_as(ctypes.POINTER(lib3mf.Triangle)),
        ),
    )


def _read_geometry(wrapper: Any, body: Any) -> Mesh:
    """Read vertices (n, 3) and faces (m, 3) into arrays at once, for the reason given in `_set_geometry`."""
    import lib3mf

    vertices = np.empty((body.GetVertexCount(), 3), dtype=np.float32)
    faces = np.empty((body.GetTriangleCount(), 3), dtype=np.uint32)
    for array, structure, read in (
        (vertices, lib3mf.Position, wrapper.lib.lib3mf_meshobject_getvertices),
        (faces, lib3mf.Triangle, wrapper.lib.lib3mf_meshobject_gettriangleindices),
    ):
        needed = ctypes.c_uint64()
        pointer = array.ctypes.data_as(ctypes.POINTER(structure))
        count = ctypes.c_uint64(len(array))
        wrapper.checkError(body, read(body._handle, count, ctypes.byref(needed), pointer))
    return vertices.astype(np.float64), faces.astype(np.int32)


@contextmanager
def _locale_kept() -> Iterator[None]:
    """Restore the locale afterwards: lib3mf sets it to "C", in which Python opens text files as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _uuid(name: str) -> str:
    return str(uuid5(NAMESPACE_URL, f"knotfab:{name}"))


# Binary STL: the whole part in one file, the same bytes for the same meshes.


# A header that began with "solid" would be taken for a text STL; a date would spoil repeatability.
HEADER = b"knotfab binary STL, millimetres"
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(path: Path, bodies: Sequence[Mesh]) -> None:
    """Write all `bodies` (vertices (n, 3) mm, faces (m, 3)) into one binary STL.

    Coordinates are rounded to the format's single precision. Equal vertices stay equal, so a closed
    mesh stays closed. Normals are those of the unrounded faces.

    Raises:
        ValueError: no faces at all, or a coordinate that is not finite.
    """
    corners = [vertices[faces] for vertices, faces in bodies]
    triangles = np.concatenate(corners) if corners else np.empty((0, 3, 3))
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ValueError("an STL needs faces with finite corners")
    normal = face_normals(triangles)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    facets = np.zeros(len(triangles), dtype=FACET)
    facets["normal"] = normal / np.maximum(length, 1e-300)[:, None]
    facets["corners"] = triangles
    with path.open("wb") as file:
        file.write(HEADER.ljust(80, b"\0"))
        file.write(np.uint32(len(facets)).astype("<u4").tobytes())
        file.write(facets.tobytes())
