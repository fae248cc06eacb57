"""`python -m knotfab_validators`: requests as JSON lines on stdin, a verdict as a JSON line for each.

Everything slow to load is loaded while the first request is still awaited, so that a parent can start this
process early; and a graphics library that crashes takes only this process with it.

Request: {"part", "knots", "scene", "pictures_dir", "failures": path or null, "skip": [name, …],
"processes": 1, or 2 that share the work, "asked": whatever tells it from others}.
Answer: {"status", "exit_code", "checks", "views", "picture", "seconds"}, or {"error": sentence} for
bad files; and "asked", as it was.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import sys
from typing import Any

NO_GRAPHICS = "--no-graphics"


def _warm_up(graphics: bool) -> None:
    """Measure and draw one triangle, so that compiled loops, VTK and its OpenGL are loaded."""
    import numpy as np

    from knotfab_validators.files.number_rows import cut_rows
    from knotfab_validators.geometry.curves import Curves
    from knotfab_validators.geometry.mesh import merge_equal
    from knotfab_validators.geometry.surface import flat_faces
    from knotfab_validators.geometry.triangles import triangle_triangle
    from knotfab_validators.mesh.second_opinion import overlapping_boxes
    from knotfab_validators.shadows.cast import ShadowCaster
    from knotfab_validators.shadows.distance import depth_in
    from knotfab_validators.shadows.render import SilhouetteRenderer, why_no_rendering
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
    if not graphics or why_no_rendering() is not None:
        return
    with SilhouetteRenderer(mesh.vertices, mesh.faces) as renderer:
        renderer.render(geometry)


def _load() -> None:
    """What the checks import as they go."""
    import contextlib

    importlib.import_module(".validate", __package__)
    for name in ("igl", "pymeshlab", "scipy.spatial", "scipy.sparse.csgraph", "scipy.ndimage"):
        with contextlib.suppress(ImportError):  # the check that needs it will say so
            importlib.import_module(name)


def main() -> None:
    """Answer requests until there are no more."""
    # libraries in C++ write to standard output as they like: the answers have one of their own
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    gc.set_threshold(20_000, 20, 20)  # the libraries make a million things that stay
    _load()
    _warm_up(graphics=NO_GRAPHICS not in sys.argv)
    for line in sys.stdin:
        if line.strip():
            request = json.loads(line)
            answer = {**_answer(request), "asked": request.get("asked")}
            print(json.dumps(answer), file=answers, flush=True)
    gc.freeze()  # a parent waits for the end: what is left is not looked through for it


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    from knotfab_validators.validate import validate

    paths = {k: request[k] for k in ("part", "knots", "scene", "pictures_dir", "failures")}
    try:
        verdict = validate(**paths, skip=request["skip"], processes=request["processes"])
    except ValueError as error:
        return {"error": str(error)}
    return {**verdict.to_dict(), "exit_code": verdict.exit_code, "seconds": verdict.seconds}


if __name__ == "__main__":
    main()
