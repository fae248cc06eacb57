"""Make the part from a finished search: tubes, mount and print pose; without supports, feet and bars too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import Design
from knotfab.design.settings import outline_mm
from knotfab.effects.base import World
from knotfab.geometry.legs import Bar
from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import WITHIN_MM, Faces, Mesh, as_manifold, as_mesh, face_normals, sweep
from knotfab.hold.eyelet import Bed
from knotfab.hold.lamp_frame import Table, frame_or_reason
from knotfab.hold.mount import Mounted, lay_bed, mount_piece
from knotfab.knots import Knots
from knotfab.part.pose import PrintPose, choose_pose
from knotfab.picture.read import Target
from knotfab.scene.camera import cameras_of, view_axes
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.slicer_ini import SUPPORT_LINE_NOZZLES
from knotfab_formats.upright import MOST_BRIDGE_MM

BESIDE_MM = 5.0  # a slicer's supports reach out of a piece's outline by at most this
BESIDE_SHARE = 0.05  # a share of the printer's bed: a small one is used to its edge
# share of the outline's error that a thinner line may use: the mesh stands out by at most 1.5 times as much
_OFF_LINE = 0.44
_ANY_SIZE = (1e6, 1e6, 1e6)


@dataclass(frozen=True, repr=False)
class Part:
    """The piece: `bodies` in print pose, with the tubes and mount that they were made of.

    `standing` belongs to a piece that prints without supports; its bars are the last of the bodies.
    """

    bodies: list[Mesh]
    pose: PrintPose
    mounted: Mounted
    standing: Standing | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The bodies' names; those of the bars come last."""
        names = tuple(self.mounted.names)
        bars = len(self.bodies) - len(names)
        return names + tuple(f"bar {number}" for number in range(1, bars + 1))

    @cached_property
    def framing(self) -> tuple[Table | None, str]:
        """The frame that holds screen, piece and lamps, if any; or why there can be none."""
        return frame_or_reason(self.mounted)


def part_of(
    made: Design,
    printing: bool,
    targets: Sequence[Target],
    progress: Progress | None = None,
    *,
    thoroughly: bool = True,
) -> Part:
    """Make one watertight tube for each knot, with its mount if it is to be printed, in print pose.

    Args:
        targets: the pictures of all views.
        thoroughly: as for `plan_wall`.

    Raises:
        NotHeldError: a wall mount does not hold the piece (`plan_wall`).
        SceneError: the piece does not fit the printer, or its mount does not fit the piece.
    """
    progress = progress or Progress("quiet")
    with progress.stage("part"):
        tubes = sweep_knots(made)
    scene = made.scene
    own: dict[str, Any] = {"piece": scene.piece.but(printed=printing)}
    if not printing:
        own["mount"] = scene.mount.but(kind="none")
    scene = scene.but(**own)
    cameras = cameras_of(scene.views, targets)
    masks = [target.mask for target in targets]
    with progress.stage("mount"):
        bed = None
        if printing and scene.piece.supports == "none":
            bed = lay_bed(made.result.braced, made.knots.radius_mm, World.from_scene(scene))
        mounted = mount_piece(scene, made.knots, tubes, cameras, masks, bed, thoroughly=thoroughly)
    if scene.mount.kind == "auto" and mounted.wall is not None and not scene.mount.on_feet:
        progress.say(
            f"{len(tubes)} loose knots: a wall mount holds them (--mount none leaves it out)"
        )
    with progress.stage("part"):
        mounted, pose = _choose_pose(made, mounted, printing)
        bodies = list(pose.tubes)
        if mounted.scene.mount.kind != "none":
            bodies = [clean_body(body) for body in bodies]
        standing = None
        if bed is not None:
            pose, bodies, standing = stand(pose, bodies, bed, mounted.scene.mount.on_feet)
            bodies = [*bodies, *(bar.make_body() for bar in standing.bars)]
    return Part(bodies, pose, mounted, standing)


def sweep_knots(made: Design) -> list[Mesh]:
    """Make each knot's tube, on a line as near to its own as the outline of its shadow asks."""
    scene, radius, sides = made.scene, made.knots.radius_mm, made.settings.mesh_sides
    asked = scene.accuracy.max_outline_error_px
    allowed = outline_mm(scene.views, asked, scene.piece.depth or 0.0, radius)
    within = min(WITHIN_MM, _OFF_LINE * allowed)
    return [sweep(k.points, radius, sides, within) for k in made.knots.knots]


def _choose_pose(made: Design, mounted: Mounted, printing: bool) -> tuple[Mounted, PrintPose]:
    """Choose the print pose of the whole.

    A mount that may lie down is returned without its `upright` if the printer does not hold it so.
    """
    frame, printer = made.scene.views[0].frame_mm, made.scene.printer
    # a stand that must lie down is more than its knots, which are all that an estimate knows
    rules = rules_of(made.scene) if mounted.stand is None else None
    shrink = shrink_of(made.scene)
    knots, bodies, upright = made.knots, mounted.bodies, mounted.upright
    if made.scene.piece.supports == "none" and printing:
        upright = view_axes(made.scene.views[0])  # strands stand along the light's axis
    if shrink[0, 0] != 1.0:  # the printed part is larger by its shrinkage
        knots, bodies = enlarge_knots(made), [(1 / shrink[0, 0] * v, f) for v, f in bodies]
    room = printer.build_volume_mm if printing else _ANY_SIZE
    try:
        whole = choose_pose(knots, bodies, room, frame, upright, rules, mounted.fixed_mm)
    except SceneError:
        if mounted.upright is None or mounted.must_be_upright:
            raise
        return _choose_pose(made, replace(mounted, upright=None), printing)
    return mounted, replace(whole, matrix=shrink @ whole.matrix)


def shrink_of(scene: ResolvedScene) -> Array:
    """Return the shrinkage of a printed part as a matrix (4, 4); the identity without any."""
    return np.diag([*np.full(3, scene.material.shrinks_to), 1.0])


def enlarge_knots(made: Design) -> Knots:
    """Return a design's knots in the scene's axes, enlarged by what their material will shrink."""
    return made.knots.moved(np.diag(1 / np.diag(shrink_of(made.scene))))


def rules_of(scene: ResolvedScene) -> Rules:
    """Read the printer's limits on overhangs, and how far supports reach beside a piece."""
    printer = scene.printer
    powder = printer.process == "powder"
    supports = printer.supports and scene.piece.supports != "none"
    beside = supports and not powder and scene.material.process == "filament"
    return Rules(
        printer.max_overhang_deg,
        printer.layer_height_mm,
        supports,
        printer.max_support_cm3,
        printer.max_bridge_mm,
        min(BESIDE_MM, BESIDE_SHARE * min(printer.build_volume_mm)) if beside else 0.0,
        SUPPORT_LINE_NOZZLES * printer.nozzle_mm,
        powder,
    )


CUT_RADII = 0.5  # how much of the lowest feet is cut off, so that each stands flat


@dataclass(frozen=True)
class Standing:
    """How a piece stands: what is cut off its feet, mm, and its bars."""

    cut_mm: float
    bars: tuple[Bar, ...]


def stand(
    pose: PrintPose, bodies: list[Mesh], bed: Bed, in_plate: bool = False
) -> tuple[PrintPose, list[Mesh], Standing]:
    """Cut the feet of a piece level and lay it on them, unless they end in a plate.

    Args:
        pose: with the light's axis up. bodies: in its coordinates.

    Returns:
        The pose and the bodies, cut, without the bars, which are in the pose's coordinates.
    """
    knots = pose.knots
    cut = 0.0 if in_plate else CUT_RADII * knots.radius_mm
    shift = np.eye(4)
    shift[2, 3] = -cut
    to_pose = np.asarray(np.linalg.inv(pose.matrix), dtype=np.float64)
    bars = tuple(bar.moved(to_pose).moved(shift) for bar in bed.bars)
    assert max((bar.gap_mm for bar in bars), default=0.0) < MOST_BRIDGE_MM
    cuts = [_cut_level(body, cut) if cut else body for body in bodies]
    laid = replace(
        pose,
        matrix=pose.matrix @ np.linalg.inv(shift),
        knots=Knots(knots.moved(shift).knots, knots.radius_mm),
        tubes=tuple(cuts),
    )
    return laid, cuts, Standing(cut, bars)


def _cut_level(body: Mesh, height: float) -> Mesh:
    """Return the share of a body above a height, laid on the bed."""
    vertices, faces = as_mesh(as_manifold(body).trim_by_plane((0.0, 0.0, 1.0), height))
    vertices[:, 2] = np.maximum(vertices[:, 2] - height, 0.0)
    return clean_body((vertices, faces))


# A united body as it will be written: in single precision, and still not crossing itself.


# Slivers along the seams of a union may turn over when their corners are rounded; edges shorter than
# these are collapsed, the least that is enough.
_SLIVER_MM = 1e-3  # high: a face that rounding may turn over
TOLERANCES_MM = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)


def clean_body(body: Mesh) -> Mesh:
    """Round a body to what single precision (STL) holds exactly, if possible without crossings.

    Tolerances are tried until libigl's exact predicates find no two faces that cross and none
    without an area. If none is enough, the result of the last is returned and the validators will
    say so.

    Args:
        body: a closed mesh in print coordinates.
    """
    for tolerance in TOLERANCES_MM:
        # the second time, what is rounded already: that finds the slivers that rounding turned over
        for _ in range(2):
            vertices, faces = as_mesh(as_manifold(body).simplify(tolerance))
            body = vertices.astype(np.float32).astype(np.float64), faces
            surface = _Surface(*body)
            if surface.is_clean:
                return body
        for find in ("crossing_slivers", "crossing"):  # all faces take half a second
            if len(pairs := getattr(surface, find)):
                joined = _join_corners(body, pairs, 2 * tolerance)
                if _Surface(*joined).is_clean and not as_manifold(joined).is_empty():
                    return joined
    return body


def _join_corners(body: Mesh, pairs: Indices, within_mm: float) -> Mesh:
    """Join the ends of edges shorter than `within_mm` of pairs of faces (k, 2) that cross.

    A slit so narrow between two long faces is none that simplifying would close, since that turns a face.
    """
    vertices, faces = body
    crossing = faces[np.unique(pairs)]
    edges = np.concatenate([np.roll(crossing, k, axis=1)[:, :2] for k in range(3)])
    short = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) < within_mm
    to = np.arange(len(vertices))
    for one, other in np.sort(edges[short], axis=1):
        to[to == to[other]] = to[one]
    joined: Indices = to[faces]
    used, joined = np.unique(
        joined[(joined != np.roll(joined, 1, axis=1)).all(axis=1)], return_inverse=True
    )
    return vertices[used], joined.reshape(-1, 3).astype(np.int32)


@dataclass(frozen=True, eq=False)
class _Surface:
    """A surface. Its pairs (k, 2) of faces that cross are looked for once, when they are asked for."""

    vertices: Array
    faces: Faces

    @cached_property
    def is_clean(self) -> bool:
        """Whether no faces cross, none is without an area, and no two corners are one.

        Slivers and what meets them are asked first: what rounding turns over is among them, nearly always.
        """
        return bool(
            self._doubled.all()
            and not len(self.crossing_slivers)
            and len(np.unique(self.vertices, axis=0)) == len(self.vertices)
            and not len(self.crossing)
        )

    @cached_property
    def crossing_slivers(self) -> Indices:
        """Pairs among slivers and what meets them."""
        corners = self.vertices[self.faces]
        edges = corners - np.roll(corners, 1, axis=1)
        slivers = self._doubled <= _SLIVER_MM * np.linalg.norm(edges, axis=2).max(axis=1)
        thin = np.zeros(len(self.vertices), dtype=bool)
        thin[self.faces[slivers]] = True
        asked = np.flatnonzero(thin[self.faces].any(axis=1))
        return asked[_find_crossing(self.vertices, self.faces[asked])]

    @cached_property
    def crossing(self) -> Indices:
        return _find_crossing(self.vertices, self.faces)

    @cached_property
    def _doubled(self) -> Array:
        """The faces' areas, doubled."""
        return np.asarray(np.linalg.norm(face_normals(self.vertices[self.faces]), axis=1))


def _find_crossing(vertices: Array, faces: Faces) -> Indices:
    """Return pairs (k, 2) of faces that cross, by libigl's exact predicates."""
    from igl import predicates

    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int64)
    )
    return np.asarray(pairs)
