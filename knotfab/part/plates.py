"""A piece too large for the printer as several: whole knots, or cut ones, laid out on plates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh, box_of, face_normals
from knotfab.hold.mount import Mounted
from knotfab.knots import Knot, Knots
from knotfab.part.cut import CLEARANCE_MM, Line, cut_body, find_cuts
from knotfab.part.pose import PrintPose, choose_pose
from knotfab.scene.camera import Camera
from knotfab_formats.print_figures import PlateFile, PlatesFigures, PoseFigures

APART_MM = 5.0  # between pieces on one plate


@dataclass(frozen=True)
class Printable:
    """One body of the whole piece (scene coordinates), with what is needed to cut it."""

    name: str
    mesh: Mesh
    line: Line

    def scaled(self, share: float) -> Printable:
        (vertices, faces), line = self.mesh, self.line
        points, radius, beside = share * line.points, share * line.radius, share * line.beside
        line = replace(line, points=points, radius=radius, beside=beside)
        return Printable(self.name, (share * vertices, faces), line)


@dataclass(frozen=True)
class PrintPlate:
    """Bodies that are printed at once, in print coordinates of this plate, and their names.

    `to_part` holds a rigid (4, 4) motion for each body, from the plate to its place in part.stl.
    """

    bodies: list[Mesh]
    names: list[str]
    to_part: list[Array]


@dataclass(frozen=True)
class Plates:
    """All plates; `cuts` counts each body's cuts, `pins` are their diameters and lengths, mm."""

    plates: list[PrintPlate]
    cuts: list[int]
    pins: list[tuple[float, float]]
    poses: list[PoseFigures]

    def files(self, suffix: str = "") -> list[str]:
        """Name the plates' files, with a suffix such as "-01" for a sequence's frame."""
        return [f"plate{suffix}-{number}.3mf" for number in range(1, len(self.plates) + 1)]

    def figures(self, suffix: str = "") -> PlatesFigures:
        """Make the plates' entry in the report."""
        diameters = [diameter for diameter, _ in self.pins]
        return PlatesFigures(
            files=tuple(
                PlateFile(name, tuple(plate.names), _size(plate))
                for name, plate in zip(self.files(suffix), self.plates, strict=True)
            ),
            cuts_of_knots=tuple(self.cuts),
            pin_diameter_mm=(min(diameters), max(diameters)) if self.pins else None,
            pin_length_mm=self.pins[0][1] if self.pins else None,
            pin_clearance_mm=CLEARANCE_MM if self.pins else None,
            poses=tuple(self.poses),
        )


@dataclass(frozen=True)
class _PosedBody:
    name: str
    body: Mesh
    to_scene: Array
    size: Array


def lay_on_plates(
    printables: Sequence[Printable],
    part_pose: PrintPose,
    build_volume_mm: tuple[float, float, float],
    nozzle_mm: float,
    gap_mm: float,
    rules: Rules,
    upright: Array | None = None,
) -> Plates:
    """Lay every body on a plate, each in its own print pose; cut bodies that no plate holds.

    Pieces are cut so that their supports fit beside them (`rules.margin_mm`) or, if no cut leaves that
    room, so that at least the pieces fit, as for a whole piece (`choose_pose`).

    Args:
        part_pose: pose of the assembled piece, as it is written to part.stl.
        gap_mm: the least between strands; see `cut_body`.
        upright: the rotation that a mount asks for; a body that does not fit that way may lie otherwise.

    Raises:
        SceneError: a body does not fit and cannot be cut; names it and the numbers.
    """
    posed: list[_PosedBody] = []
    counts, pins, poses = [], [], []
    width, depth, height = build_volume_mm
    clear = width - 2 * rules.margin_mm, depth - 2 * rules.margin_mm, height

    def pose(name: str, mesh: Mesh, points: Array, radius: float, closed: bool) -> _PosedBody:
        knots = Knots((Knot(points, closed=closed),), radius)
        try:
            found = choose_pose(knots, [mesh], build_volume_mm, None, upright, rules)
        except SceneError:
            if upright is None:
                raise
            found = choose_pose(knots, [mesh], build_volume_mm, None, None, rules)
        if found.account is not None:
            poses.append(found.account.figures(name))
        body = clean_body(found.tubes[0])
        return _PosedBody(name, body, found.matrix, body[0].max(axis=0))

    for one in printables:
        line = one.line
        try:
            posed.append(pose(one.name, one.mesh, line.points, line.radius, True))
            counts.append(0)
            continue
        except SceneError:
            pieces, cuts = _cut_to_fit(one, (clear, build_volume_mm), nozzle_mm, gap_mm, pose)
        posed += pieces
        counts.append(len(cuts))
        pins += cuts
    to_part: Array = np.linalg.inv(part_pose.matrix).astype(np.float64)
    return Plates(_pack_plates(posed, clear, to_part), counts, pins, poses)


def _cut_to_fit(
    one: Printable,
    rooms: Sequence[tuple[float, float, float]],
    nozzle: float,
    gap: float,
    pose: Callable[[str, Mesh, Array, float, bool], _PosedBody],
) -> tuple[list[_PosedBody], list[tuple[float, float]]]:
    """Cut a body and pose the pieces, with their pins; a little smaller if one does not fit.

    `rooms` are tried in their order; if none serves, the error says why the last does not.
    """
    why: SceneError | None = None
    for room, share in product(rooms, (1.0, 0.96, 0.92, 0.85)):
        aim = (room[0] * share, room[1] * share, room[2] * share)
        try:
            cuts = find_cuts(one.line, aim, nozzle, one.name)
            pieces = cut_body(one.mesh, one.line.points, one.line.radius, gap, cuts)
            posed = [
                pose(f"{one.name} piece {n}", p.mesh, p.points, one.line.radius, False)
                for n, p in enumerate(pieces, start=1)
            ]
        except SceneError as error:
            why = error if share == 1.0 else why
            continue
        return posed, [(2 * c.pin_radius, c.pin_length) for c in cuts]
    assert why is not None
    raise why


def _pack_plates(
    posed: Sequence[_PosedBody], room: tuple[float, float, float], to_part: Array
) -> list[PrintPlate]:
    """Pack bodies in rows, the deepest first, on as few plates as that takes."""
    order = sorted(range(len(posed)), key=lambda k: -round(float(posed[k].size[1]), 3))
    plates: list[PrintPlate] = []
    spots: list[list[float]] = []  # for each plate: x and y of the next body, and the row's depth
    for k in order:
        one = posed[k]
        width, depth = float(one.size[0]), float(one.size[1])
        for number, spot in enumerate(spots):
            if spot[0] + width > room[0]:  # a new row
                row = [0.0, spot[1] + spot[2] + APART_MM, 0.0]
            else:
                row = spot
            if row[0] + width <= room[0] and row[1] + depth <= room[1]:
                spots[number] = row
                break
        else:
            number = len(plates)
            plates.append(PrintPlate([], [], []))
            spots.append([0.0, 0.0, 0.0])
        x, y, deep = spots[number]
        # whole 32nds of a millimetre: corners keep the digits that a file holds
        corner = np.array([np.ceil(32 * x) / 32, np.ceil(32 * y) / 32, 0.0])
        spots[number] = [corner[0] + width + APART_MM, y, max(deep, corner[1] + depth - y)]
        back = np.eye(4)
        back[:3, 3] = -corner
        plates[number].bodies.append((one.body[0] + corner, one.body[1]))
        plates[number].names.append(one.name)
        plates[number].to_part.append(to_part @ one.to_scene @ back)
    return plates


def _size(plate: PrintPlate) -> tuple[float, ...]:
    return tuple(round(float(x), 3) for x in box_of(plate.bodies)[1])


# Facts about each body of a piece that are needed to print, or cut, it by itself.


# radii of the tube's shadow from the outline, from which on a place is well inside
FULLY_RADII = 3.0
CROSS = np.concatenate([np.eye(3), -np.eye(3)])


def can_be_split(mounted: Mounted) -> bool:
    """Return whether every knot is a separate body, as it is without a mount or on dowels."""
    return mounted.stand is None and (mounted.wall is None or mounted.wall.settings.foot == "dowel")


def list_printables(
    mounted: Mounted, knots: Knots, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
) -> list[Printable]:
    """List the bodies of a piece that can be split, with their centre lines (scene coordinates).

    Args:
        masks: (H, W) the silhouette of each view, in its camera's pixels.
    """
    found = []
    for number, (body, name) in enumerate(zip(mounted.bodies, mounted.names, strict=True)):
        points = knots.knots[number].points
        barred, beside, beside_of = _find_pegs(mounted, number, points, knots.radius_mm)
        shown = np.min(
            [
                measure_hiding(points, knots.radius_mm, c, m)
                for c, m in zip(cameras, masks, strict=True)
            ],
            axis=0,
        )
        line = Line(points, knots.radius_mm, shown, barred, beside, beside_of)
        found.append(Printable(name, body, line))
    return found


def measure_hiding(
    points: Array, radius_mm: float, camera: Camera, mask: NDArray[np.bool_]
) -> Array:
    """Measure how hidden points are (n,): 0 on the outline or off it, 1 from 3 radii inside."""
    pixel = float(np.linalg.norm(camera.du))
    depth = np.asarray(distance_transform_edt(mask)) * pixel
    uv = np.rint(camera.project(points)).astype(np.int64)
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] < mask.shape[1]) & (uv[:, 1] < mask.shape[0])
    value = np.zeros(len(points))
    value[inside] = depth[uv[inside, 1], uv[inside, 0]]
    return (value / (FULLY_RADII * radius_mm)).clip(max=1.0)


def _find_pegs(
    mounted: Mounted, knot: int, points: Array, radius: float
) -> tuple[NDArray[np.bool_], Array, Indices]:
    """Find vertices next to a peg, the points that bound the knot's pegs, and their vertices."""
    barred = np.zeros(len(points), dtype=np.bool_)
    beside, beside_of = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for peg in mounted.wall.pegs if mounted.wall is not None else ():
        way = peg.foot - peg.top
        length = float(np.linalg.norm(way))
        way = way / length
        at = ((points - peg.top) @ way).clip(0.0, length)
        away = np.linalg.norm(points - peg.top - at[:, None] * way, axis=1)
        wide = max(peg.root_radius_mm, peg.foot_radius_mm, peg.top_radius_mm)
        # the pin and hole of a cut must also not lie under the peg's top
        near = np.linalg.norm(points - peg.top, axis=1) <= 4.0 * radius + wide
        if peg.knot == knot:
            assert mounted.wall is not None
            end = peg.foot + mounted.wall.settings.dowel_depth_mm * way
            box = np.concatenate([end + wide * CROSS, peg.foot + wide * CROSS])
            vertex = int(np.linalg.norm(points - peg.top, axis=1).argmin())
            beside.append(box)
            beside_of.append(np.full(len(box), vertex, dtype=np.int64))
            barred |= near
        barred |= away <= 2.0 * radius + wide  # tube radii from a peg's side
    return barred, np.concatenate(beside), np.concatenate(beside_of)


# A united body as it will be written: in single precision, and still not crossing itself.


# Slivers along the seams of a union may turn over when their corners are rounded; edges shorter than
# these are collapsed, the least that is enough.
TOLERANCES_MM = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)


def clean_body(body: Mesh) -> Mesh:
    """Round a body to what single precision (STL) holds exactly, if possible without crossings.

    Tolerances are tried until libigl's exact predicates find no two faces that cross and none
    without an area. If none is enough, the result of the last is returned and the validators will
    say so.

    Args:
        body: a closed mesh in print coordinates.
    """
    solid = as_manifold(body)
    rounded = body
    # the second time, what is rounded already: that finds the slivers that rounding turned over
    for tolerance in np.repeat(TOLERANCES_MM, 2):
        vertices, faces = as_mesh(solid.simplify(tolerance))
        rounded = vertices.astype(np.float32).astype(np.float64), faces
        if _is_clean(rounded):
            break
        solid = as_manifold(rounded)
    return rounded


def _is_clean(body: Mesh) -> bool:
    from igl import predicates

    vertices, faces = body
    if len(np.unique(vertices, axis=0)) < len(vertices):
        return False  # two corners became one
    if not face_normals(vertices[faces]).any(axis=1).all():
        return False
    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int64)
    )
    return len(pairs) == 0
