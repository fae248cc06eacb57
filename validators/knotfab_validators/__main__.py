"""`python -m knotfab_validators`: requests as JSON lines on stdin, a verdict as a JSON line for each.

What is slow to load is loaded while no request waits, so that a parent can start this process early; and a
graphics library that crashes takes only this process with it. A request without files is answered once all is
loaded, and compiled loops are kept for other processes.

Request: {"part", "knots", "scene", "pictures_dir", "failures": path or null, "skip": [name, …],
"processes": 1, or 2 that share the work, "unit": of a part whose file knows none ("mm"), "asked":
whatever tells it from others}.
Answer: {"status", "exit_code", "conclusion", "size_mm", "notes", "checks", "views", "picture", "seconds"},
or {"error": sentence} for bad files; and "asked", as it was.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import sys
from collections.abc import Iterator
from typing import IO, TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from knotfab_validators.geometry.mesh import Mesh
    from knotfab_validators.shadows.view import ViewGeometry

NO_GRAPHICS = "--no-graphics"


def _steps(graphics: bool) -> Iterator[Literal[True]]:
    """Load what the checks use, piece by piece: their libraries, compiled loops, VTK and its OpenGL."""
    importlib.import_module(".validate", __package__)
    for name in ("igl", "pymeshlab", "scipy.spatial", "scipy.sparse.csgraph", "scipy.ndimage"):
        yield True
        with contextlib.suppress(ImportError):  # the check that needs it will say so
            importlib.import_module(name)
    yield True
    geometry, mesh = _measure_triangle()
    yield True
    if graphics:
        _draw(geometry, mesh)


def _measure_triangle() -> tuple[ViewGeometry, Mesh]:
    """Run every compiled loop."""
    import numpy as np

    from knotfab_validators.files.number_rows import cut_rows
    from knotfab_validators.geometry.curves import Curves
    from knotfab_validators.geometry.heap import overlapping_boxes
    from knotfab_validators.geometry.mesh import merge_equal
    from knotfab_validators.geometry.surface import flat_faces
    from knotfab_validators.geometry.triangles import triangle_triangle
    from knotfab_validators.shadows.cast import ShadowCaster
    from knotfab_validators.shadows.distance import depth_in
    from knotfab_validators.shadows.layers import layered_mask
    from knotfab_validators.shadows.tube_field import tube_field
    from knotfab_validators.shadows.view import ViewGeometry
    from knotfab_validators.tube.clearance import check_clearance

    x, y, z = np.eye(3)
    geometry = ViewGeometry(
        light=10 * z, origin=y - x, du=x, dv=-y, right=x, up=y, width=3, height=3
    )
    triangle = np.eye(3)[None]
    mesh = merge_equal(triangle)
    triangle_triangle(triangle, triangle)
    flat_faces(mesh)
    overlapping_boxes(mesh)
    cut_rows(b"<vertices></vertices><triangles></triangles>")
    check_clearance(mesh, Curves((np.eye(3),), ("unknot",), (True,), 0.1), None)
    depth_in(ShadowCaster(mesh.vertices, mesh.faces).render(geometry))
    tube_field([np.eye(3)], 0.1, geometry)
    layered_mask(mesh, geometry, 0.5)
    return geometry, mesh


def _draw(geometry: ViewGeometry, mesh: Mesh) -> None:
    from knotfab_validators.shadows.render import SilhouetteRenderer, why_no_rendering

    if why_no_rendering() is None:
        with SilhouetteRenderer(mesh.vertices, mesh.faces) as renderer:
            renderer.render(geometry)


def _is_asked(requests: IO[bytes]) -> bool:
    """Whether a request is waiting, or none will come any more; Windows cannot say."""
    if os.name == "nt":
        return False
    return bool(select.select([requests], [], [], 0)[0])


def main() -> None:
    """Answer requests until there are no more."""
    # libraries in C++ write to standard output as they like: the answers have one of their own
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    gc.set_threshold(20_000, 20, 20)  # the libraries make a million things that stay
    requests = open(0, "rb", buffering=0, closefd=False)  # noqa: SIM115  (nothing read ahead: `_is_asked`)
    steps = _steps(graphics=NO_GRAPHICS not in sys.argv)
    while True:
        while not _is_asked(requests) and next(steps, False):
            pass  # once asked, each of two processes that share the work loads its own part of the rest
        line = requests.readline()
        if not line:
            break
        if line.strip():
            request = json.loads(line)
            if request["part"] is None and request["knots"] is None:
                for _ in steps:
                    pass
            answer = {**_answer(request), "asked": request.get("asked")}
            print(json.dumps(answer), file=answers, flush=True)
    gc.freeze()  # a parent waits for the end: what is left is not looked through for it


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    from knotfab_validators.files.bad_file import BadFile
    from knotfab_validators.validate import validate

    paths = {k: request[k] for k in ("part", "knots", "scene", "pictures_dir", "failures")}
    try:
        verdict = validate(
            **paths,
            skip=request["skip"],
            processes=request["processes"],
            unit=request.get("unit", "mm"),
        )
    except BadFile as error:
        return {"error": str(error)}
    return {**verdict.to_dict(), "exit_code": verdict.exit_code, "seconds": verdict.seconds}


if __name__ == "__main__":
    main()
