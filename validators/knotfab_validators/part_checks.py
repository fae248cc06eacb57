"""Run all geometric checks that the given files allow, and time each group."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
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
    surface. `printed` is the part before it shrinks, if it does; `wall_mm` how thick a tube's wall
    prints, inf if it prints full. The seconds of each group are added to `seconds`.

    A part without knots is searched for its centre lines (`centre_line`). Thickness, knot type and
    clearance are then measured on these estimates, and are not required.
    """
    whole = mesh if printed is None else printed
    if _is_upright(scene) and mesh is not None:
        mesh = part_bars(mesh).strands
    piece = _Piece(mesh, whole, curves, scene, seconds, skip, wall_mm)
    checks = [
        *piece.check_lines(),
        *(piece.leave_out(["tube"]) or [piece.check_tube()]),
        *(piece.leave_out(["mount"]) or [piece.check_mount()]),
        *piece.check_surface(),
    ]
    if scene is None or not piece.is_upright or set(UPRIGHT) <= set(skip):
        return checks
    with time_stage(seconds, "upright"):
        return [*checks, *piece.check_feet(scene)]


def _is_upright(scene: Scene | None) -> bool:
    """Return whether the piece is designed to print without supports."""
    return (
        scene is not None
        and scene.piece.supports == "none"
        and scene.printer.process == "filament"
        and scene.material.process == "filament"
    )


@dataclass(frozen=True)
class _Piece:
    """What there is of a piece; `mesh` is the part without break-away bars, `whole` as it is printed."""

    mesh: Mesh | None
    whole: Mesh | None
    curves: Curves | None
    scene: Scene | None
    seconds: dict[str, float]
    skip: Collection[str]
    wall_mm: float

    @property
    def is_upright(self) -> bool:
        return _is_upright(self.scene)

    @property
    def is_mounted(self) -> bool:
        return self.scene is not None and self.scene.mount.kind != "none"

    @property
    def has_cut_feet(self) -> bool:
        """Whether an upright piece stands on its own feet, not in a plate."""
        return not self.is_mounted or (self.scene is not None and self.scene.mount.kind == "hang")

    def leave_out(self, names: Collection[str]) -> list[Check]:
        """Skip a group of checks that nobody asked for; return nothing if any of them was."""
        asked = not set(names) <= set(self.skip)
        return [] if asked else [skip_check(name, "left out on request") for name in names]

    def check_lines(self) -> list[Check]:
        """Check that centre lines were found, the gaps between strands, and the knot types."""
        line, found = self._find_lines()
        kinds = self.leave_out(KNOTS) or self._check_knots(self.curves or found)
        if found is not None:
            kinds = [replace(kind, required=False) for kind in kinds]
        elif self.curves is None and line.status == "fail":
            kinds = [skip_check(k.name, f"not given the knots; {line.detail}") for k in kinds]
        return [line, *(self.leave_out(["clearance"]) or [self._check_gap(found)]), *kinds]

    def _find_lines(self) -> tuple[Check, Curves | None]:
        """Find the centre lines of a part that came without any, with the check that reports them."""
        why = None
        if self.mesh is None:
            why = "not given the part"
        elif self.curves:
            why = "given with the knots"
        elif self.is_mounted:
            why = "a part with a mount is more than tubes"
        if self.mesh is None or why is not None or "centre_line" in self.skip:
            return skip_check("centre_line", why or "left out on request"), None
        with time_stage(self.seconds, "centre line"):
            return check_centre_lines(self.mesh)

    def _check_gap(self, found: Curves | None) -> Check:
        """Check the gaps between strands; if there are no curves, those that were `found` separate them."""
        mesh, curves, scene = self.mesh, self.curves, self.scene
        if mesh is None:
            return skip_check("clearance", "not given the part")
        with time_stage(self.seconds, "clearance"):
            required = (
                scene.piece.clearance_mm if scene is not None and curves is not None else None
            )
            strands = _keep_strands(mesh, curves) if self.is_mounted else mesh
            gap = check_clearance(strands, curves or found, required)
        return gap if found is None else replace(gap, required=False)

    def _check_knots(self, curves: Curves | None) -> list[Check]:
        scene = self.scene
        if curves is None:
            return [skip_check(name, "not given the knots") for name in KNOTS]
        with time_stage(self.seconds, "thickness"):
            checks = _check_curves(curves, scene)
        with time_stage(self.seconds, "knot type"):
            promised = scene.promised if scene else None
            kinds = _count_knots(curves, scene, knot_checks(curves, promised))
        # a part is built of unlinked unknots; curves alone are asked for their thickness, and keep what
        # their own file promises
        return checks + [
            kind
            if self.mesh is not None or (curves.stated and _breaks_promise(kind))
            else replace(kind, required=False)
            for kind in kinds
        ]

    def check_tube(self) -> Check:
        """Check that the surface is the tube around the curves."""
        if self.mesh is None:
            return skip_check("tube", "not given the part")
        asked = None if self.scene is None else self.scene.piece.tube_radius_mm
        mounted = self.is_mounted
        with time_stage(self.seconds, "tube"):
            flat = self.is_upright and self.has_cut_feet
            return check_tube(self.mesh, self.curves, mounted=mounted, asked_mm=asked, flat=flat)

    def check_mount(self) -> Check:
        """Check that the mount's members are whole, and that nothing else joins strands."""
        mesh, curves, scene = self.mesh, self.curves, self.scene
        if scene is None or not self.is_mounted:
            return skip_check("mount", "not given a scene with a mount")
        if mesh is None or curves is None:
            return skip_check("mount", f"not given the {'part' if mesh is None else 'knots'}")
        with time_stage(self.seconds, "tube"):
            if isinstance(asked := asked_of_mount(scene), str):
                return Check("mount", "fail", True, "unknown", None, "", asked)
            return check_mount(mesh, curves, asked)

    def check_surface(self) -> list[Check]:
        """Check the surface, the region and the printability."""
        mesh, scene = self.mesh, self.scene
        left = self.leave_out(PRINTING)
        # printability is meaningless on a broken surface: if it is asked for, the surface is checked too
        checks = (left and self.leave_out(MESH)) or self._check_mesh()
        if mesh is not None and scene is not None and scene.mount.kind == "hang":
            checks += self.leave_out(HELD) or [_check_level(mesh, scene)]
        if scene is None:
            names = "region", "build_volume"
            checks += [skip_check(name, "not given the scene") for name in names]
        else:
            with time_stage(self.seconds, "region"):
                pose = None if scene.pose is None else scene.pose.matrix
                checks.append(check_region(scene.region, pose, self.curves, mesh, scene.surface))
                checks.append(_check_build_volume(self.whole, scene))
        return checks + (left or self._check_printability(checks))

    def _check_mesh(self) -> list[Check]:
        mesh, curves, scene = self.mesh, self.curves, self.scene
        if mesh is None:
            return [skip_check(name, "not given the part") for name in MESH]
        with time_stage(self.seconds, "mesh"):
            if scene is None or scene.mount.kind == "none":
                if curves is None or not self.is_upright:
                    return check_mesh(mesh, curves)
                # tubes cut flat fall short of Pappus' volume: the check `tube` reports the cut
                holes = [1 if closed else 0 for closed in curves.closed]
                return check_mesh(mesh, bodies=len(holes), genus=holes)
            bodies, genus = _predict_topology(scene.mount, curves)
            return check_mesh(mesh, bodies=bodies, genus=genus)

    def _check_printability(self, before: Sequence[Check]) -> list[Check]:
        """Check printability if the surface is sound enough for it to mean something."""
        mesh, curves, scene = self.whole, self.curves, self.scene
        if mesh is None:
            return [skip_check(name, "not given the part") for name in PRINTING]
        broken = [c.name for c in before if c.name in MESH and c.status == "fail" and c.required]
        stands = scene is not None and scene.mount.kind == "stand"
        proud = None
        if curves is not None and curves.radius_mm is not None:
            as_printed = 1 / scene.material.shrinks_to if scene is not None else 1.0
            proud = partial(measure_proud, mesh, curves.scaled(as_printed))
        upright = None
        if scene is not None and self.is_upright:
            upright = Upright(mesh, scene.material.young_modulus_mpa, self.wall_mm)
            mesh = part_bars(mesh).strands
        return printability_checks(
            mesh,
            scene.printer if scene is not None else None,
            seconds=self.seconds,
            stands=stands,
            desk=_turn_upright(scene) if stands else None,
            lacking=f"the surface is broken ({', '.join(broken)})" if broken else None,
            proud=proud,
            upright=upright,
        )

    def check_feet(self, scene: Scene) -> list[Check]:
        """Check what knots.json says of feet and bars against the part as it is printed."""
        mesh, curves = self.whole, self.curves
        if mesh is None or curves is None or curves.radius_mm is None or not mesh.usable:
            why = f"not given the {'knots' if mesh is not None and mesh.usable else 'part'}"
            return [skip_check(name, why, required=mesh is not None) for name in ("cut", "bars")]
        own, parted = curves.scaled(1 / scene.material.shrinks_to), part_bars(mesh)
        cut = skip_check("cut", "its feet end in the mount")
        if self.has_cut_feet:
            cut = check_cut(mesh, own)
        assert own.radius_mm is not None
        lines = parted.strands, scene.printer.layer_height_mm
        try:
            return [cut, check_bars(*lines, parted.bars, own.bars, 1.25 * own.radius_mm)]
        except TooMuchWork as error:
            return [cut, skip_check("bars", f"not tested: {error}", required=True)]


def _keep_strands(mesh: Mesh, curves: Curves | None) -> Mesh:
    """Return the mesh without the mount's faces, which lead from strand to strand."""
    if curves is None or curves.radius_mm is None or not all(curves.closed):
        return mesh
    if not np.isfinite(mesh.vertices).all():
        return mesh
    own = strand_faces(mesh, curves)
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
