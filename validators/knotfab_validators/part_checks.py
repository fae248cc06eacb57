"""Run all geometric checks that the given files allow, and time each group."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import HELD, KNOTS, MESH, PRINTING, UPRIGHT, Check
from knotfab_validators.arrays import Array
from knotfab_validators.asked_mount import asked_of_mount, threads_of
from knotfab_validators.check import skip_check, time_stage
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, part_bars
from knotfab_validators.geometry.surface import TooMuchWork
from knotfab_validators.knots.knot_types import knot_checks
from knotfab_validators.mesh.surface_checks import check_mesh
from knotfab_validators.printing.bars import check_bars
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.slices import slice_layers
from knotfab_validators.printing.standing import check_level
from knotfab_validators.printing.upright import Upright
from knotfab_validators.tube.centre_line import check_centre_lines
from knotfab_validators.tube.clearance import check_clearance
from knotfab_validators.tube.mount_members import PLATE_HOLES, check_mount
from knotfab_validators.tube.region import check_build_volume, check_region
from knotfab_validators.tube.solid_matter import strand_faces
from knotfab_validators.tube.thickness import check_bend, check_length, check_thickness
from knotfab_validators.tube.tube_fit import check_cut, check_tube, measure_proud

if TYPE_CHECKING:
    from knotfab_formats.piece import Mount
    from knotfab_validators.files.scene import Scene

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # rotates y up into z up


def part_checks(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    seconds: dict[str, float],
    skip: Collection[str] = (),
    printed: Mesh | None = None,
    wall_mm: float = np.inf,
) -> list[Check]:
    """Make all checks but the shadow's: mesh, tube, curves, knot type, region and printer.

    The thickness must reach the tube's radius plus, if there is a scene, half its clearance;
    without a known radius it is only measured. Checks whose file is not given are skipped, and say
    so. A group that `skip` names entirely is not measured, except that printability needs the
    surface. `printed` is the part before it shrinks, if it does; `wall_mm` how
    thick a tube's wall prints, inf if it prints full. The seconds of each group
    are added to `seconds`.

    A part without knots is searched for its centre lines (`centre_line`). Thickness, knot type and
    clearance are then measured on these estimates, and are not required.
    """
    whole = mesh if printed is None else printed
    if _is_upright(scene) and mesh is not None:
        mesh = part_bars(mesh).strands
    checks = _check_lines(mesh, curves, scene, seconds, skip)
    checks += _leave_out(["tube"], skip) or [_check_tube(mesh, curves, scene, seconds)]
    checks += _leave_out(["mount"], skip) or [_check_mount(mesh, curves, scene, seconds)]
    checks += _check_surface(mesh, curves, scene, seconds, skip, whole, wall_mm)
    if scene is None or not _is_upright(scene) or set(UPRIGHT) <= set(skip):
        return checks
    with time_stage(seconds, "upright"):
        return [*checks, *_check_feet(whole, curves, scene)]


def _is_upright(scene: Scene | None) -> bool:
    """Return whether the piece is designed to print without supports."""
    return (
        scene is not None
        and scene.piece.supports == "none"
        and scene.printer.process == "filament"
        and scene.material.process == "filament"
    )


def _check_feet(mesh: Mesh | None, curves: Curves | None, scene: Scene) -> list[Check]:
    """Check what knots.json says of feet and bars against the part as it is printed."""
    if mesh is None or curves is None or curves.radius_mm is None or not mesh.usable:
        why = f"not given the {'knots' if mesh is not None and mesh.usable else 'part'}"
        return [skip_check(name, why, required=mesh is not None) for name in ("cut", "bars")]
    own, parted = curves.scaled(1 / scene.material.shrinks_to), part_bars(mesh)
    cut = skip_check("cut", "its feet end in the mount")
    if not _is_mounted(scene):
        cut = check_cut(mesh, own)
    assert own.radius_mm is not None
    try:
        layers = slice_layers(parted.strands, scene.printer.layer_height_mm)
    except TooMuchWork as error:
        return [cut, skip_check("bars", f"not tested: {error}", required=True)]
    return [cut, check_bars(layers, parted.bars, own.bars, 1.25 * own.radius_mm)]


def _check_surface(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    seconds: dict[str, float],
    skip: Collection[str],
    printed: Mesh | None,
    wall_mm: float,
) -> list[Check]:
    """Check the surface, the region and the printability."""
    left = _leave_out(PRINTING, skip)
    # printability is meaningless on a broken surface: if it is asked for, the surface is checked too
    checks = (left and _leave_out(MESH, skip)) or _check_mesh(mesh, curves, scene, seconds)
    if mesh is not None and scene is not None and scene.mount.kind == "hang":
        checks += _leave_out(HELD, skip) or [_check_level(mesh, scene)]
    printed = mesh if printed is None else printed
    if scene is None:
        checks += [skip_check(name, "not given the scene") for name in ("region", "build_volume")]
    else:
        with time_stage(seconds, "region"):
            pose = None if scene.pose is None else scene.pose.matrix
            checks.append(check_region(scene.region, pose, curves, mesh, scene.surface))
            checks.append(_check_build_volume(printed, scene))
    return checks + (left or _check_printability(printed, curves, scene, checks, seconds, wall_mm))


def _leave_out(names: Collection[str], skip: Collection[str]) -> list[Check]:
    """Skip a group of checks that nobody asked for; return nothing if any of them was."""
    asked = not set(names) <= set(skip)
    return [] if asked else [skip_check(name, "left out on request") for name in names]


def _check_lines(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    seconds: dict[str, float],
    skip: Collection[str],
) -> list[Check]:
    """Check that centre lines were found, the gaps between strands, and the knot types."""
    line, found = _find_lines(mesh, curves, scene, seconds, skip)
    kinds = _leave_out(KNOTS, skip) or _check_knots(mesh, curves or found, scene, seconds)
    if found is not None:
        kinds = [replace(kind, required=False) for kind in kinds]
    elif curves is None and line.status == "fail":
        kinds = [skip_check(k.name, f"not given the knots; {line.detail}") for k in kinds]
    gap = _leave_out(["clearance"], skip) or [_check_gap(mesh, curves, scene, seconds, found)]
    return [line, *gap, *kinds]


def _find_lines(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    seconds: dict[str, float],
    skip: Collection[str],
) -> tuple[Check, Curves | None]:
    """Find the centre lines of a part that came without any, with the check that reports them."""
    why = "not given the part" if mesh is None else "given with the knots" if curves else None
    if why is None and _is_mounted(scene):
        why = "a part with a mount is more than tubes"
    if mesh is None or why is not None or "centre_line" in skip:
        return skip_check("centre_line", why or "left out on request"), None
    with time_stage(seconds, "centre line"):
        return check_centre_lines(mesh)


def _check_mesh(
    mesh: Mesh | None, curves: Curves | None, scene: Scene | None, seconds: dict[str, float]
) -> list[Check]:
    if mesh is None:
        return [skip_check(name, "not given the part") for name in MESH]
    with time_stage(seconds, "mesh"):
        if scene is None or scene.mount.kind == "none":
            if curves is None or not _is_upright(scene):
                return check_mesh(mesh, curves)
            # tubes that are cut flat fall short of Pappus' volume: the check `tube` reports the cut
            holes = [1 if closed else 0 for closed in curves.closed]
            return check_mesh(mesh, bodies=len(holes), genus=holes)
        bodies, genus = _predict_topology(scene.mount, curves)
        return check_mesh(mesh, bodies=bodies, genus=genus)


def _check_tube(
    mesh: Mesh | None, curves: Curves | None, scene: Scene | None, seconds: dict[str, float]
) -> Check:
    """Check that the surface is the tube around the curves."""
    if mesh is None:
        return skip_check("tube", "not given the part")
    asked = None if scene is None else scene.piece.tube_radius_mm
    with time_stage(seconds, "tube"):
        flat = _is_upright(scene) and not _is_mounted(scene)
        return check_tube(mesh, curves, mounted=_is_mounted(scene), asked_mm=asked, flat=flat)


def _check_mount(
    mesh: Mesh | None, curves: Curves | None, scene: Scene | None, seconds: dict[str, float]
) -> Check:
    """Check that the mount's members are whole, and that nothing else joins strands."""
    if scene is None or not _is_mounted(scene):
        return skip_check("mount", "not given a scene with a mount")
    if mesh is None or curves is None:
        return skip_check("mount", f"not given the {'part' if mesh is None else 'knots'}")
    with time_stage(seconds, "tube"):
        if isinstance(asked := asked_of_mount(scene), str):
            return Check("mount", "fail", True, "unknown", None, "", asked)
        return check_mount(mesh, curves, asked)


def _check_gap(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    seconds: dict[str, float],
    found: Curves | None,
) -> Check:
    """Check the gaps between strands; if the part has no curves, those that were `found` separate them."""
    if mesh is None:
        return skip_check("clearance", "not given the part")
    with time_stage(seconds, "clearance"):
        required = scene.piece.clearance_mm if scene is not None and curves is not None else None
        strands = _keep_strands(mesh, curves) if _is_mounted(scene) else mesh
        gap = check_clearance(strands, curves or found, required)
    return gap if found is None else replace(gap, required=False)


def _is_mounted(scene: Scene | None) -> bool:
    return scene is not None and scene.mount.kind != "none"


def _keep_strands(mesh: Mesh, curves: Curves | None) -> Mesh:
    """Return the mesh without the mount's faces, which lead from strand to strand."""
    if curves is None or curves.radius_mm is None or not all(curves.closed):
        return mesh
    if not np.isfinite(mesh.vertices).all():
        return mesh
    own = strand_faces(mesh.vertices, mesh.faces, curves.polygons, curves.radius_mm)
    return Mesh(mesh.vertices, mesh.faces[own]) if own.any() else mesh


def _predict_topology(
    mount: Mount, curves: Curves | None
) -> tuple[int | None, Sequence[int] | None]:
    """Predict how many bodies a mounted part must have, and their genera; None where that is not known.

    A peg that ends on a plate closes a loop for each one after a knot's first, and each knot brings
    its own; a peg that ends in a hole of the wall closes none.
    """
    if curves is None or not (mount.pegs or curves.members):
        return None, None
    if mount.kind == "wall" and mount.foot == "dowel":
        return len(curves.polygons), [1] * len(curves.polygons)
    holes = {"wall": PLATE_HOLES, "hang": 1}.get(mount.kind, 0)  # a second eyelet is a body more
    if (plate := curves.plate) is not None:
        holes = len(plate.holes) + len(plate.openings)
    return 1, [(sum(mount.pegs) or len(curves.members)) + holes]


def _check_level(mesh: Mesh, scene: Scene) -> Check:
    if scene.mount.thread_mm is None or scene.pose is None:
        return skip_check("level", "the scene does not say where the thread is", required=True)
    pose = np.array(scene.pose.matrix, dtype=np.float64)
    threads = threads_of(scene.mount, np.asarray(np.linalg.inv(pose), dtype=np.float64))
    up = pose[1, :3] / np.linalg.norm(pose[1, :3])  # the scene's y in the part's coordinates
    return check_level(mesh, threads, up)


def _check_knots(
    mesh: Mesh | None, curves: Curves | None, scene: Scene | None, seconds: dict[str, float]
) -> list[Check]:
    if curves is None:
        return [skip_check(name, "not given the knots") for name in KNOTS]
    with time_stage(seconds, "thickness"):
        checks = _check_curves(curves, scene)
    with time_stage(seconds, "knot type"):
        kinds = _count_knots(curves, scene, knot_checks(curves, scene.promised if scene else None))
    # a part is built of unlinked unknots; curves alone are asked for their thickness, and keep what
    # their own file promises
    return checks + [
        kind
        if mesh is not None or (curves.stated and _breaks_promise(kind))
        else replace(kind, required=False)
        for kind in kinds
    ]


def _count_knots(
    curves: Curves, scene: Scene | None, found: tuple[Check, Check]
) -> tuple[Check, Check]:
    """Fail `knot_type` if there are more or fewer knots than a scene says."""
    asked, there = scene.piece.knots if scene is not None else None, len(curves.polygons)
    if asked is None or asked == there or found[0].status == "fail":
        return found
    detail = f"the scene's piece.knots is {asked}, and there are {there}"
    wrong = replace(found[0], status="fail", required=True, limit=str(asked), detail=detail)
    return wrong, found[1]


def _breaks_promise(check: Check) -> bool:
    return check.name == "knot_type" and check.status == "fail" and check.limit is not None


def _check_build_volume(mesh: Mesh | None, scene: Scene) -> Check:
    if mesh is None:
        return skip_check("build_volume", "not given the part")
    room = scene.printer.stated("build_volume_mm")
    if room is None:
        why = "the scene names a printer without its build_volume_mm"
        return skip_check("build_volume", why)
    return check_build_volume(mesh, room)


def _check_printability(
    mesh: Mesh | None,
    curves: Curves | None,
    scene: Scene | None,
    before: Sequence[Check],
    seconds: dict[str, float],
    wall_mm: float,
) -> list[Check]:
    """Check printability if the surface is sound enough for it to mean something."""
    if mesh is None:
        return [skip_check(name, "not given the part") for name in PRINTING]
    broken = [c.name for c in before if c.name in MESH and c.status == "fail" and c.required]
    lacking = f"the surface is broken ({', '.join(broken)})" if broken else None
    printer = scene.printer if scene is not None else None
    stands = scene is not None and scene.mount.kind == "stand"
    desk = _turn_upright(scene) if stands else None
    proud = None
    if curves is not None and curves.radius_mm is not None:
        as_printed = 1 / scene.material.shrinks_to if scene is not None else 1.0
        proud = partial(measure_proud, mesh, curves.scaled(as_printed))
    upright = None
    if scene is not None and _is_upright(scene):
        upright = Upright(mesh, scene.material.young_modulus_mpa, wall_mm)
        mesh = part_bars(mesh).strands
    return printability_checks(
        mesh,
        printer,
        seconds=seconds,
        stands=stands,
        desk=desk,
        lacking=lacking,
        proud=proud,
        upright=upright,
    )


def _turn_upright(scene: Scene | None) -> Array | None:
    """Return the rotation (3, 3) that puts a stand upright; None if it is printed upright."""
    if scene is None or scene.pose is None:
        return None
    turn = Y_UP @ np.array(scene.pose.matrix, dtype=np.float64)[:3, :3]
    return None if np.allclose(turn[2], [0.0, 0.0, 1.0], atol=1e-9) else turn


def _check_curves(curves: Curves, scene: Scene | None) -> list[Check]:
    """Check thickness, bend and length."""
    radius = curves.radius_mm
    if radius is None and scene is not None:
        radius = scene.piece.tube_radius_mm
    clearance = scene.piece.clearance_mm if scene is not None else 0.0
    required = None if radius is None else radius + clearance / 2
    if required is None:
        found = check_thickness(curves, None)
        unknown = "no radius is given to compare it with"
        checks = [replace(found, detail=f"{found.detail}; {unknown}")]
    else:
        checks = [check_thickness(curves, required)]
    if scene is None:
        return checks + [skip_check(name, "not given the scene") for name in ("bend", "length")]
    bend = scene.material.min_bend_radius_mm or required
    if bend is None:
        checks.append(skip_check("bend", "neither a bend radius nor the tube's radius is given"))
    else:
        checks.append(check_bend(curves, bend))
    return [*checks, check_length(curves, scene.material.max_length_mm)]
