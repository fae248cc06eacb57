"""Check that the printed frame for several lamps puts screen and lamps where the scene has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import at_most
from knotfab_validators.files.mesh import Plate
from knotfab_validators.geometry.mesh import Mesh, winding_numbers
from knotfab_validators.mesh.surface_checks import check_mesh
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.table_bars import check_table_bars
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from knotfab_validators.tube.region import check_build_volume

if TYPE_CHECKING:
    from knotfab_validators.files.scene import Scene

OFF_MM = 0.5  # tolerance of the places of a lamp's hole and of the screen's slot
MOST_DARK = 0.001
PX = 256  # px of the picture's frame, each way, when its shaded share is measured
WIDEST_MM = 20.0  # the widest hole for a rod
STEP_MM = 0.05  # step at which matter is looked for along a line
BELOW_MM = 0.6  # depth below the frame's top at which its holes are looked for


def check_table(plates: Sequence[Plate], scene: Scene) -> list[Check]:
    """Check the frame's files: `table_mesh`, `table_bars`, `table` and `table_shadow`, all required.

    - `table_mesh`: how many of the surface's checks any plate fails, and how many do not fit the bed.
    - `table_bars`: whether matter fills every bar as the scene has it (`check_table_bars`).
    - `table`: with every body moved as the scene says, how far the hole that is right below each lamp lies
      beside it, and how far the front of the screen's slot lies from the wall: at most `OFF_MM`.
    - `table_shadow`: how much of the picture lies in its shadow, under any lamp: at most `MOST_DARK`.
    """
    room = scene.printer.stated("build_volume_mm")
    failed, said = 0, ""
    for plate in plates:
        found = [c for c in check_mesh(plate.mesh) if c.required]
        if room is not None:
            found.append(check_build_volume(plate.mesh, room))
        found = [c for c in found if c.status == "fail"]
        failed += len(found)
        said = said or (f"; {plate.name}: {found[0].name}, {found[0].detail}" if found else "")
    detail = f"of the surfaces and sizes of {len(plates)} plates{said}"
    surface = at_most("table_mesh", failed, 0, "checks", detail)
    wrong = [plate.name for plate in plates if plate.bodies != len(plate.to_part)]
    if wrong:
        why = f"{wrong[0]} holds other bodies than the scene has places for"
        return [surface, Check("table", "fail", True, "unknown", OFF_MM, "mm", why)]
    frame = _assemble(plates)
    filled = check_table_bars(plates, scene)
    return [surface, filled, _check_places(frame, scene), _check_shadow(frame, scene)]


def _assemble(plates: Sequence[Plate]) -> Mesh:
    """Join all bodies, where the scene puts them."""
    vertices = np.concatenate([p.in_part(p.mesh.vertices, p.body) for p in plates])
    shift = np.cumsum([0] + [len(p.mesh.vertices) for p in plates[:-1]])
    faces = np.concatenate([p.mesh.faces + s for p, s in zip(plates, shift, strict=True)])
    return Mesh(vertices, faces)


def _check_shadow(frame: Mesh, scene: Scene) -> Check:
    """Check `table_shadow` under each lamp."""
    caster = ShadowCaster(frame.vertices, frame.faces)
    dark = {v.name: float(caster.render(view_geometry(v, PX, PX)).mean()) for v in scene.views}
    worst = max(dark, key=lambda name: dark[name])
    detail = f"share of the picture in the frame's own shadow, under the lamp {worst}"
    return at_most("table_shadow", dark[worst], MOST_DARK, "", detail)


def _check_places(frame: Mesh, scene: Scene) -> Check:
    """Check `table` on the bodies where the scene puts them."""
    views = [view_geometry(view, 2, 2) for view in scene.views]
    up = views[0].up
    top = _find_top(frame, up)
    off = {
        view.name: _off_hole(frame, geometry, top - BELOW_MM)
        for view, geometry in zip(scene.views, views, strict=True)
    }
    off["the screen"] = _off_slot(frame, views[0], top)
    worst = max(off, key=lambda name: off[name])
    detail = (
        f"how far the frame's hole below a lamp, or its slot, is out of its place, most: {worst}"
    )
    return at_most("table", off[worst], OFF_MM, "mm", detail)


def _find_top(frame: Mesh, up: Array) -> float:
    """Find the height of the frame's top: where most of the surface looks up."""
    a, b, c = np.moveaxis(frame.vertices[frame.faces], 1, 0)
    twice = np.cross(b - a, c - a) @ up
    level = (twice > 0) & (np.abs((b - a) @ up) + np.abs((c - a) @ up) < 1e-3)
    heights, at = np.unique(np.round(a[level] @ up, 2), return_inverse=True)
    return float(heights[np.bincount(at, twice[level]).argmax()]) if len(heights) else 0.0


def _off_hole(frame: Mesh, geometry: ViewGeometry, height: float) -> float:
    """Measure how far the hole at the foot of a lamp is from it, mm; 20 if there is none."""
    foot = geometry.light + (height - geometry.light @ geometry.up) * geometry.up
    free = []
    for axis in (geometry.right, -geometry.right, geometry.axis, -geometry.axis):
        away = np.arange(0.0, WIDEST_MM, STEP_MM)
        solid = np.flatnonzero(_is_solid(frame, foot + away[:, None] * axis))
        if len(solid) == 0 or solid[0] == 0:
            return WIDEST_MM
        free.append(float(away[solid[0]]))
    right, left, front, back = free
    return float(np.hypot(right - left, front - back)) / 2


def _off_slot(frame: Mesh, geometry: ViewGeometry, top: float) -> float:
    """Measure how far the front of the slot is from the wall, mm: matter above the frame begins there."""
    up = geometry.up
    middle = geometry.middle + (top + 2.0 - geometry.middle @ up) * up
    away = np.arange(-WIDEST_MM, WIDEST_MM, STEP_MM)
    solid = _is_solid(frame, middle + away[:, None] * geometry.axis)
    begins = away[1:][solid[1:] & ~solid[:-1]]
    return float(np.abs(begins).min()) if len(begins) else WIDEST_MM


def _is_solid(frame: Mesh, points: Array) -> Mask:
    """Return which points (n, 3) lie in the frame."""
    return np.asarray(winding_numbers(points, frame, exact=False) > 0.5)
