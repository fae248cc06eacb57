"""Answer each request with a verdict.

Slow imports happen while no request is waiting, so that a parent can start this process early; and a
graphics library that crashes takes only this process with it. A request without files is answered once
all is loaded, and compiled loops are cached for other processes.

Request: {"part", "knots", "scene", "pictures_dir", "failures": path or null, "skip": [name, …],
"unit": that of a part whose file knows none ("mm"), "beside": whether the shadows are measured beside
the geometry, in a copy of this process (Linux)}. No more is spent on it than `limits.MEASURING`. Answer:
{"status", "exit_code", "conclusion", "size_mm", "notes", "checks", "views", "picture", "seconds"},
or {"error": sentence} for bad files.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from knotfab_formats.errors import plain
from knotfab_formats.libraries import add_parts, defer_idle_modules, recording
from knotfab_formats.limits import MEASURING, limit_process

if TYPE_CHECKING:
    from knotfab_validators.geometry.mesh import Mesh
    from knotfab_validators.shadows.view import ViewGeometry

_S = TypeVar("_S")
_T = TypeVar("_T")
GEOMETRY = ("knotfab_validators.part_checks", "igl", "pymeshlab", "scipy.sparse.csgraph")
COMMON = ("numba", "scipy.ndimage", "scipy.spatial", "scipy.sparse.csgraph", "shapely")
SHADOWS = ("knotfab_validators.shadows.part_shadows", "scipy.ndimage")


def prepare(*parts: str) -> Iterator[None]:
    """Load what the checks need, step by step: libraries, compiled loops, VTK.

    Args:
        parts: any of "geometry", "shadows", "graphics", "layers" (of a part that prints without supports).
    """
    importlib.import_module(".validate", __package__)
    for name in (
        *(GEOMETRY if "geometry" in parts else ()),
        *(SHADOWS if "shadows" in parts else ()),
    ):
        yield
        with contextlib.suppress(ImportError):  # the check that needs it reports this
            importlib.import_module(name)
    yield
    if "geometry" in parts:
        _measure_surface()
        yield
    if "layers" in parts:
        _grow_layers()
        yield
    if "shadows" in parts:
        _cast_shadows()
        yield
    if "graphics" in parts:
        _load_graphics()


def _triangle() -> Mesh:
    import numpy as np

    from knotfab_validators.geometry.mesh import merge_equal

    return merge_equal(np.eye(3)[None])


def _view() -> ViewGeometry:
    import numpy as np

    from knotfab_validators.shadows.view import ViewGeometry

    x, y, z = np.eye(3)
    return ViewGeometry(light=10 * z, origin=y - x, du=x, dv=-y, right=x, up=y, width=3, height=3)


def _measure_surface() -> None:
    """Run every compiled loop that measures the part."""
    import numpy as np

    from knotfab_validators.geometry.curves import Curves
    from knotfab_validators.geometry.rays import count_above
    from knotfab_validators.geometry.surface import flat_faces, overlapping_boxes
    from knotfab_validators.geometry.triangles import triangle_triangle
    from knotfab_validators.tube.clearance import check_clearance

    triangle, mesh = np.eye(3)[None], _triangle()
    triangle_triangle(triangle, triangle)
    flat_faces(mesh)
    overlapping_boxes(mesh)
    count_above(mesh.vertices, mesh.vertices, mesh.faces)
    check_clearance(mesh, Curves((np.eye(3),), ("unknot",), (True,), 0.1), None)


def _grow_layers() -> None:
    """Run every compiled loop that follows a part's growth: a tetrahedron whose top hangs over air."""
    import numpy as np

    from knotfab_validators.geometry.mesh import merge_equal
    from knotfab_validators.printing.upright import Upright, check_upright

    corners = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [9, 9, 3]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    check_upright(Upright(merge_equal(corners[faces]), 2300.0), 0.2)


def _cast_shadows() -> None:
    """Run every compiled loop that casts shadows."""
    import numpy as np

    from knotfab_validators.shadows.exact_shadow import ShadowCaster
    from knotfab_validators.shadows.misplacement import layered_mask
    from knotfab_validators.shadows.outlines import depth_in
    from knotfab_validators.shadows.told import fill_triangles, fit_picture
    from knotfab_validators.shadows.tube_field import tube_field

    mesh, geometry = _triangle(), _view()
    depth_in(ShadowCaster(mesh.vertices, mesh.faces).render(geometry))
    tube_field([np.eye(3)], 0.1, geometry)
    layered_mask(mesh, geometry, 0.5)
    fill_triangles(mesh.vertices[:2], mesh.faces, 2)
    fit_picture(np.eye(2), np.eye(2), 1, 1)


def load_common(graphics: bool) -> None:
    """Load the libraries that a build needs as well, so that this process may be a copy of the build's."""
    defer_idle_modules()
    for name in COMMON:
        importlib.import_module(name)
    _triangle()  # with its first loop numba loads what all rest on
    if graphics:
        _load_graphics()


def _load_graphics() -> None:
    """Load VTK, but open no window: a copy of this process could not draw by its OpenGL."""
    if "pyvista.plotting" in sys.modules:
        return
    from knotfab_validators.shadows.render import why_no_rendering

    if run_beside(lambda: None, why_no_rendering)[1] is None:
        importlib.import_module("pyvista.plotting")


def run_beside(
    here: Callable[[], _T], there: Callable[[], _S], beside: bool = True
) -> tuple[_T, _S]:
    """Return what two calls return; the second is made in a copy of this process, if `beside`, on Linux.

    A copy that crashes takes this process with it.
    """
    if not beside or sys.platform != "linux":
        return here(), there()
    ours, theirs = os.pipe()
    gc.freeze()  # what both have is looked through by neither, and stays one
    copy = os.fork()
    if copy == 0:
        _work_as_copy(there, theirs)
    os.close(theirs)
    try:
        found = here()
    finally:
        gc.unfreeze()
        with open(ours, "rb") as pipe:
            sent = pipe.read()
        code = os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1])
    if code < 0:
        os.kill(os.getpid(), -code)
    if code:
        os._exit(code)
    error, other, parts = pickle.loads(sent)  # of this program's own copy
    add_parts(parts)
    if error is not None:
        raise error
    return found, other


def _work_as_copy(work: Callable[[], object], theirs: int) -> None:
    code, error, found = 1, None, None
    try:
        ctypes.CDLL(None).prctl(1, int(signal.SIGTERM))  # it goes with its parent
        with recording() as parts:
            try:
                found = work()
            except Exception as failed:
                error = failed
        with open(theirs, "wb") as pipe:
            pickle.dump((error, found, parts), pipe)
        code = 0
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)  # no tidying up of what is the parent's


def answer(request: dict[str, Any], told: object) -> dict[str, Any]:
    """Answer a request with the verdict on its files."""
    from knotfab_validators.check import BadFile
    from knotfab_validators.files.picture import PictureError
    from knotfab_validators.validate import conclude_piece, measure_piece, read_piece

    del told
    spend_s, gigabytes = MEASURING
    limit_process(spend_s * (os.cpu_count() or 1), gigabytes)
    part, knots, scene = (request[name] for name in ("part", "knots", "scene"))
    beside = request.get("beside", False)
    if part is None and knots is None:
        _triangle()  # once for both
        geometry, shadows = prepare("geometry", "layers"), prepare("shadows")
        run_beside(lambda: [*geometry], lambda: [*shadows], beside)
    beside = beside and bool(part and scene)
    try:
        piece = read_piece(part, knots, scene, request.get("unit", "mm"))
        for name in (GEOMETRY[0], SHADOWS[0]) if beside else ():
            importlib.import_module(name)  # once for both
        measure = partial(measure_piece, piece, request["skip"], request["pictures_dir"])
        halves = run_beside(partial(measure, "geometry"), partial(measure, "shadows"), beside)
        verdict = conclude_piece(piece, halves, request["failures"])
    except (BadFile, PictureError) as error:
        return {"error": str(error)}
    except MemoryError:
        named = PurePath(part or knots or scene).name
        return {"error": f"{named}: measuring it takes more than {gigabytes:g} GB"}
    return dict(plain(verdict))
