"""3MF by lib3mf: millimetres, one named and coloured object per body, the same bytes each time."""

from __future__ import annotations

import ctypes
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

from knotfab import __version__

__all__ = ["Body", "read_back_strict", "read_bodies", "write_3mf"]

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]

DECIMALS = 6  # of a millimetre, written out


@dataclass(frozen=True)
class Body:
    """One object of a 3MF: vertices (n, 3) mm, faces (m, 3)."""

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]


def write_3mf(
    path: Path,
    bodies: Sequence[Mesh],
    names: Sequence[str] | None = None,
    title: str = "knotfab",
    colors: Sequence[str] | None = None,
) -> None:
    """Write `bodies` (vertices (n, 3) mm, faces (m, 3)) as one 3MF, an object for each body.

    The build has a single item. Several bodies are the components of one more object that is this
    item: so the standard says that they are one thing, and programs that let each item of a build
    drop onto the bed keep them together. Transforms are the identity, and every UUID follows from
    the names: the archive's dates are constant in lib3mf, so the file is the same byte for byte.

    Args:
        names: one for each body; "knot 1", "knot 2", … by default.
        title: the package's Title.
        colors: "#rrggbb" in sRGB, one for each body; none by default.

    Raises:
        ValueError: a body without faces, a name or colour too few, no colour, or a vertex below
            zero or not finite (3MF wants the positive octant).
    """
    import lib3mf

    names = [f"knot {i + 1}" for i in range(len(bodies))] if names is None else names
    if not bodies or len(names) != len(bodies):
        raise ValueError(f"{len(bodies)} bodies and {len(names)} names do not make a 3MF")
    if colors is not None and len(colors) != len(bodies):
        raise ValueError(f"{len(bodies)} bodies and {len(colors)} colours do not make a 3MF")
    for (vertices, faces), name in zip(bodies, names, strict=True):
        if not len(faces) or not np.isfinite(vertices).all() or vertices.min() < 0:
            raise ValueError(f"{name!r} needs faces, and finite vertices in the positive octant")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    about = model.GetMetaDataGroup()
    about.AddMetaData("", "Title", title, "xs:string", True)
    about.AddMetaData("", "Application", f"knotfab {__version__}", "xs:string", True)
    paint = _palette(wrapper, model, colors or ())
    objects = []
    for number, ((vertices, faces), name) in enumerate(zip(bodies, names, strict=True), start=1):
        body = model.AddMeshObject()
        body.SetName(name)
        _set_geometry(wrapper, body, vertices, faces)
        body.SetUUID(_uuid(f"object/{number}/{name}"))
        if colors is not None:
            body.SetObjectLevelProperty(*paint[colors[number - 1].lower()])
        objects.append(body)
    whole = objects[0]
    if len(objects) > 1:
        whole = model.AddComponentsObject()
        whole.SetName(title)
        whole.SetUUID(_uuid("whole/" + "/".join(names)))
        for number, body in enumerate(objects, start=1):
            component = whole.AddComponent(body, wrapper.GetIdentityTransform())
            component.SetUUID(_uuid(f"component/{number}/{names[number - 1]}"))
    item = model.AddBuildItem(whole, wrapper.GetIdentityTransform())
    item.SetUUID(_uuid("item/" + "/".join(names)))
    model.SetBuildUUID(_uuid("build/" + "/".join(names)))
    writer = model.QueryWriter("3mf")
    writer.SetDecimalPrecision(DECIMALS)
    with _locale_kept():
        writer.WriteToFile(str(path))


def read_back_strict(path: Path) -> list[str]:
    """What lib3mf's strict reader finds wrong with `path`: empty for a clean file."""
    import lib3mf

    reader = lib3mf.get_wrapper().CreateModel().QueryReader("3mf")
    reader.SetStrictModeActive(True)
    try:
        with _locale_kept():
            reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        return [str(error)]
    return [str(reader.GetWarning(i)) for i in range(reader.GetWarningCount())]


def read_bodies(path: Path) -> list[Body]:
    """The bodies of a file that `write_3mf` wrote, in its order.

    Transforms are not applied: it writes none but the identity.

    Raises:
        ValueError: the file is not a 3MF, or holds no body.
    """
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    try:
        with _locale_kept():
            model.QueryReader("3mf").ReadFromFile(str(path))
        objects = model.GetMeshObjects()
        bodies = []
        while objects.MoveNext():
            body = objects.GetCurrentMeshObject()
            bodies.append(Body(body.GetName(), *_geometry(wrapper, body)))
    except lib3mf.ELib3MFException as error:
        raise ValueError(f"{path.name} is not a 3MF file, or is damaged: {error}") from error
    if not bodies:
        raise ValueError(f"{path.name} holds no body")
    return bodies


def _palette(wrapper: Any, model: Any, colors: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Resource and property of each colour that occurs, as base materials of the model."""
    wanted = list(dict.fromkeys(color.lower() for color in colors))
    for color in wanted:
        if not re.fullmatch("#[0-9a-f]{6}", color):
            raise ValueError(f"{color!r} is no colour: #rrggbb is one")
    if not wanted:
        return {}
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


def _geometry(wrapper: Any, body: Any) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (n, 3) and faces (m, 3), into arrays at once for the same reason."""
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
    """lib3mf leaves the process in the locale "C", where Python opens text files as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _uuid(name: str) -> str:
    return str(uuid5(NAMESPACE_URL, f"knotfab:{name}"))
