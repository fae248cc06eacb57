"""A piece too large for the printer in several: whole knots, or cut ones, laid out on plates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.meshes import Mesh, box_of
from knotfab.geometry.overhang import Rules
from knotfab.knots import Knot, Knots
from knotfab.part.clean import clean_body
from knotfab.part.connector import cut_body
from knotfab.part.cut import CLEARANCE_MM, Line, find_cuts
from knotfab.part.pose import PrintPose, choose_pose
from knotfab_formats.report import PlateFile, PlatesFigures, PoseFigures

__all__ = ["Plates", "PrintPlate", "Printable", "lay_on_plates"]

APART_MM = 5.0  # between pieces on one plate


@dataclass(frozen=True)
class Printable:
    """One body of the whole piece (scene coordinates), with what is needed to cut it."""

    name: str
    mesh: Mesh
    line: Line

    def scaled(self, share: float) -> Printable:
        """Scale every length by a factor."""
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
    """All plates; `cuts` counts the cuts of each body, `pins` gives their diameters and lengths, mm."""

    plates: list[PrintPlate]
    cuts: list[int]
    pins: list[tuple[float, float]]
    poses: list[PoseFigures]

    def files(self, suffix: str = "") -> list[str]:
        """Return the plates' file names; `suffix` is such as "-01" of a sequence's frame."""
        return [f"plate{suffix}-{number}.3mf" for number in range(1, len(self.plates) + 1)]

    def figures(self, suffix: str = "") -> PlatesFigures:
        """Return what a report says of them."""
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
    """Lay every body on a plate in a print pose of its own; bodies that no plate holds are cut.

    Pieces are cut so that their supports fit beside them (`rules.margin_mm`), or where no cut leaves that
    room, so that they fit themselves, as a whole piece would (`choose_pose`).

    Args:
        part_pose: pose of the assembled piece, as it is written to part.stl.
        gap_mm: the least between strands; see `cut_body`.
        upright: the turn that a mount asks for; a body that it does not let fit may lie otherwise.

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
    return Plates(_pack(posed, clear, to_part), counts, pins, poses)


def _cut_to_fit(
    one: Printable,
    rooms: Sequence[tuple[float, float, float]],
    nozzle: float,
    gap: float,
    pose: Callable[[str, Mesh, Array, float, bool], _PosedBody],
) -> tuple[list[_PosedBody], list[tuple[float, float]]]:
    """Return the posed pieces of a body, and their pins; a little smaller where one misses the printer.

    `rooms` are tried in their order; where none serves, the error says why the last does not.
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


def _pack(
    posed: Sequence[_PosedBody], room: tuple[float, float, float], to_part: Array
) -> list[PrintPlate]:
    """Return rows of bodies, the deepest first, on as few plates as that takes."""
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
