"""Answer each request with a verdict.

Slow imports happen while no request is waiting, so that a parent can start this process early; and a
graphics library that crashes takes only this process with it. A request without files is answered once
all is loaded, and compiled loops are cached for other processes.

Request: {"part", "knots", "scene", "pictures_dir", "failures": path or null, "skip": [name, …],
"unit": that of a part whose file knows none ("mm"), "piece": a unique name of these files, which
are read once}. No more is spent on it than `limits.MEASURING`. If two processes share a piece, each is
asked for a half, "only": "geometry" or "shadows"; one is then asked to conclude from what both "found":
[answer, answer]. Answer:
{"status", "exit_code", "conclusion", "size_mm", "notes", "checks", "views", "picture", "seconds"},
or {"error": sentence} for bad files.
"""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from knotfab_formats.errors import plain, read_as
from knotfab_formats.limits import MEASURING, limit_process
from knotfab_formats.verdict import Verdict

if TYPE_CHECKING:
    from knotfab_validators.geometry.mesh import Mesh
    from knotfab_validators.shadows.view import ViewGeometry
    from knotfab_validators.validate import Piece

GEOMETRY = ("knotfab_validators.part_checks", "igl", "pymeshlab", "scipy.sparse.csgraph")
SHADOWS = ("knotfab_validators.shadows.part_shadows", "scipy.ndimage")


def prepare(*parts: str) -> Iterator[None]:
    """Load what the checks need, step by step: libraries, compiled loops, VTK and its OpenGL.

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
        _draw()


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


def _draw() -> None:
    from knotfab_validators.shadows.render import SilhouetteRenderer, why_no_rendering

    if why_no_rendering() is None:
        mesh = _triangle()
        with SilhouetteRenderer(mesh.vertices, mesh.faces) as renderer:
            renderer.render(_view())


@lru_cache(maxsize=1)
def _read(piece: str, part: str | None, knots: str | None, scene: str | None, unit: str) -> Piece:
    """Read the files of a piece; its unique name lets the last one be reused."""
    from knotfab_validators.validate import read_piece

    del piece
    return read_piece(part, knots, scene, unit)


def answer(request: dict[str, Any], told: object) -> dict[str, Any]:
    """Answer a request with the verdict on its files."""
    from knotfab_validators.check import BadFile
    from knotfab_validators.files.picture import PictureError
    from knotfab_validators.validate import Found, conclude_piece, measure_piece

    del told
    seconds, gigabytes = MEASURING
    limit_process(seconds * (os.cpu_count() or 1), gigabytes)
    part, knots, scene = (request[name] for name in ("part", "knots", "scene"))
    if part is None and knots is None and "found" not in request:
        only = request.get("only")
        for half in ("geometry", "shadows") if only is None else (only,):
            for _ in prepare(half, *(("layers",) if half == "geometry" else ())):
                pass
    try:
        piece = _read(request["piece"], part, knots, scene, request.get("unit", "mm"))
        found: list[Found | Verdict] = [read_as(Verdict, half) for half in request.get("found", ())]
        found = found or [
            measure_piece(piece, request["skip"], request["pictures_dir"], request.get("only"))
        ]
        verdict = conclude_piece(piece, found, request["failures"])
    except (BadFile, PictureError) as error:
        return {"error": str(error)}
    except MemoryError:
        named = PurePath(part or knots or scene).name
        return {"error": f"{named}: measuring it takes more than {gigabytes:g} GB"}
    return dict(plain(verdict))
