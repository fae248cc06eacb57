"""3MF by lib3mf: millimetres, one named object per body, the same bytes for the same meshes."""

from __future__ import annotations

import ctypes
import locale
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
from numpy.typing import NDArray

from knotfab import __version__

__all__ = ["read_back_strict", "write_3mf"]

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]

DECIMALS = 6  # of a millimetre, written out


def write_3mf(
    path: Path, bodies: Sequence[Mesh], names: Sequence[str] | None = None, title: str = "knotfab"
) -> None:
    """Write `bodies` (vertices (n, 3) mm, faces (m, 3)) as one 3MF, an object for each body.

    Transforms are the identity, and every UUID follows from the names: the archive's dates are
    constant in lib3mf, so the file is the same byte for byte.

    Args:
        names: one for each body; "knot 1", "knot 2", … by default.
        title: the package's Title.

    Raises:
        ValueError: a body without faces, a name too few, or a vertex below zero or not finite
            (3MF wants the positive octant).
    """
    import lib3mf

    names = [f"knot {i + 1}" for i in range(len(bodies))] if names is None else names
    if not bodies or len(names) != len(bodies):
        raise ValueError(f"{len(bodies)} bodies and {len(names)} names do not make a 3MF")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    about = model.GetMetaDataGroup()
    about.AddMetaData("", "Title", title, "xs:string", True)
    about.AddMetaData("", "Application", f"knotfab {__version__}", "xs:string", True)
    for number, ((vertices, faces), name) in enumerate(zip(bodies, names, strict=True), start=1):
        if not len(faces) or not np.isfinite(vertices).all() or vertices.min() < 0:
            raise ValueError(f"{name!r} needs faces, and finite vertices in the positive octant")
        body = model.AddMeshObject()
        body.SetName(name)
        _set_geometry(wrapper, body, vertices, faces)
        body.SetUUID(_uuid(f"object/{number}/{name}"))
        item = model.AddBuildItem(body, wrapper.GetIdentityTransform())
        item.SetUUID(_uuid(f"item/{number}/{name}"))
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
