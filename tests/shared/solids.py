"""Closed meshes with known measures: plain solids, a printer for them, and chains of arches with bars."""

from dataclasses import dataclass, replace

import numpy as np
from validator_parts import tube

from knotfab_formats.piece import Printer
from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Bar, Curves
from knotfab_validators.geometry.mesh import Mesh, merge_equal
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.upright import Upright, check_upright
from tests.corpus.parts import blocks as cells_of


def blocks(x: list[float], y: list[float], z: list[float], filled: object) -> Mesh:
    """The solid of those cells of a rectilinear grid that `filled` (nx, ny, nz) marks."""
    body = cells_of(np.asarray(filled, dtype=bool), x, y, z)
    return Mesh(body.vertices, body.faces)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return blocks(*([a, b] for a, b in zip(low, high, strict=True)), np.ones((1, 1, 1)))


def prism(corners: object, length: float) -> Mesh:
    """A convex polygon (n, 2) in x and z, counter-clockwise seen from -y, drawn out along y."""
    p = np.asarray(corners, dtype=float)
    n = len(p)
    front = np.column_stack([p[:, 0], np.zeros(n), p[:, 1]])
    back = front + [0.0, length, 0.0]
    triangles = []
    for i in range(1, n - 1):
        triangles += [front[[0, i, i + 1]], back[[0, i + 1, i]]]
    for i in range(n):
        j = (i + 1) % n
        triangles += [
            np.array([front[i], back[i], back[j]]),
            np.array([front[i], back[j], front[j]]),
        ]
    return merge_equal(np.array(triangles))


def cone(tip: tuple[float, float, float], radius: float, height: float, sides: int = 48) -> Mesh:
    """A cone that stands on its tip."""
    t = 2 * np.pi * np.arange(sides) / sides
    rim = np.column_stack([radius * np.cos(t), radius * np.sin(t), np.full(sides, height)]) + tip
    top = np.array([0.0, 0.0, height]) + tip
    triangles = []
    for i in range(sides):
        j = (i + 1) % sides
        triangles += [np.array([rim[i], rim[j], top]), np.array([rim[j], rim[i], tip])]
    return merge_equal(np.array(triangles))


def together(*meshes: Mesh) -> Mesh:
    return merge_equal(np.concatenate([m.vertices[m.faces] for m in meshes]))


def inward(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1].copy())


def move(mesh: Mesh, turn: Array | None = None, shift: object = (0.0, 0.0, 0.0)) -> Mesh:
    points = mesh.vertices if turn is None else mesh.vertices @ turn.T
    return Mesh(points + np.asarray(shift, dtype=float), mesh.faces)


def quarter(mesh: Mesh) -> Mesh:
    """Turned by 90° about z, back on the positive octant."""
    turned = move(mesh, np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    low = turned.vertices.min(axis=0)
    return move(turned, shift=(-low[0], -low[1], 0.0))


def bridge(span: float, width: float, height: float = 10.0, pier: float = 5.0) -> Mesh:
    """Two piers and a deck 2 mm thick between them, along x."""
    x = [0.0, pier, pier + span, 2 * pier + span]
    return blocks(x, [0.0, width], [0.0, height, height + 2.0], [[[1, 1]], [[0, 1]], [[1, 1]]])


def table(top: float = 20.0, leg: float = 4.0, height: float = 10.0) -> Mesh:
    """A square top 2 mm thick on one leg in its middle."""
    a = (top - leg) / 2
    filled = np.zeros((3, 3, 2))
    filled[:, :, 1] = filled[1, 1, 0] = 1
    line = [0.0, a, a + leg, top]
    return blocks(line, line, [0.0, height, height + 2.0], filled)


PRINTER = Printer(name="test", nozzle_mm=0.4)
BARE = PRINTER.model_copy(update={"supports": False})  # prints without supports


def run(mesh: Mesh, printer: Printer | None = PRINTER, stands: bool = False) -> dict[str, Check]:
    checks = printability_checks(mesh, printer, seconds={}, stands=stands)
    return {c.name: c for c in checks}


def leaning(angle_deg: float) -> Mesh:
    """A parallelogram whose underside overhangs by an angle; 10 mm high, 20 mm long."""
    shift = 10 * np.tan(np.radians(angle_deg))
    return prism([(0, 0), (6, 0), (6 + shift, 10), (shift, 10)], 20)


LAYER = 0.2
PLA = 2300.0


@dataclass(frozen=True)
class Part:
    mesh: Mesh
    curves: Curves


def chain(
    arches: int = 3,
    height: float = 20.0,
    flank_deg: float = 55.0,
    radius: float = 1.66,
    lift: tuple[float, ...] = (),
    cut: float = 0.5,
    sink: float = 0.0,
) -> Part:
    """A ring of arches; `lift` raises the first valleys above the others, `cut` radii are off the feet."""
    flank, bend = np.radians(flank_deg), 1.3 * radius
    half, turn = height / np.tan(flank), np.linspace(-flank, flank, 15)
    middle = bend / np.cos(flank)  # of the arc in a corner, above a valley or below a peak
    rows = []
    for k in range(2 * arches):
        up = 1 if k % 2 else -1  # peaks at 0, 2, …, valleys at 1, 3, …
        corner = (height if up < 0 else 0.0) + up * middle
        rows.append(
            np.column_stack([k * half + bend * np.sin(turn), corner - up * bend * np.cos(turn)])
        )
        start, end = rows[-1][-1], [(k + 1) * half - rows[0][-1, 0], height - rows[-1][-1, 1]]
        steps = int(np.hypot(*(end - start)) / 1.0)
        rows.append(start + np.linspace(0, 1, steps + 1)[1:-1, None] * (end - start))
    s, z = np.concatenate(rows).T
    around = 2 * arches * half
    z = z - z.min()
    for k, high in enumerate(lift):
        away = np.abs(s - (2 * k + 1) * half)
        z += np.where(away < half, high * np.cos(np.pi / 2 * np.minimum(away / half, 1)) ** 2, 0)
    plan = around / (2 * np.pi)
    angle = 2 * np.pi * s / around
    points = np.column_stack([plan * np.cos(angle), plan * np.sin(angle), z])
    points[:, 2] += radius * (1 - cut) - sink
    vertices, faces = tube(points, radius, 24)
    import manifold3d  # what prints is measured where it is missing

    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    kept = solid.trim_by_plane((0.0, 0.0, 1.0), 0.0).to_mesh64() if cut > 0 else solid.to_mesh64()
    mesh = Mesh(np.array(kept.vert_properties)[:, :3], np.array(kept.tri_verts).astype(np.int64))
    curves = Curves((points,), ("unknot",), (True,), radius, cut_mm=cut * radius)
    return Part(mesh, curves)


def box_bar(a: Array, b: Array, sunk: float, width: float = 0.8, height: float = 0.4) -> Mesh:
    """A level bar between two points of centre lines, from `sunk` mm beyond the one to before the other."""
    way = (b - a)[:2]
    length = float(np.linalg.norm(way))
    x, y = way / length
    turn = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
    sides = [[sunk, length - sunk], [-width / 2, width / 2], [-height / 2, height / 2]]
    return move(blocks(*sides, np.ones((1, 1, 1))), turn, a)


def tie(part: Part, places: list[tuple[Array, Array]], leave_out: int = 0) -> Part:
    """Tie strands by bars between points of their centre lines; the first ones are listed and left out."""
    bars = [box_bar(a, b, part.curves.radius_mm - 0.3) for a, b in places]
    listed = tuple(Bar(a, b, 0.8, 0.4) for a, b in places)
    mesh = together(part.mesh, *bars[leave_out:])
    return Part(mesh, replace(part.curves, bars=listed))


def braced(leave_out: int = 0) -> Part:
    """Four tall arches, of which no leg could stand free, and a bar across each arch in the middle."""
    part = chain(4, height=75.0, flank_deg=80.5)
    points = part.curves.polygons[0]
    at = np.flatnonzero(np.diff(np.sign(points[:, 2] - 30.0)))
    legs = points[at] * [1, 1, 0] + [0, 0, 30.0]
    # the first leg goes down from a peak, the second up to the next one
    pairs = [(legs[2 * k + 1], legs[(2 * k + 2) % len(legs)]) for k in range(4)]
    return tie(part, pairs, leave_out)


def on_plate(void: bool = False) -> Part:
    """A chain whose valleys end in a plate of 1.6 mm; `void`: a hollow below one of them."""
    part = chain(cut=0.5, sink=-0.6)
    plate = blocks([-25, 25], [-25, 25], [0, 1.6], np.ones((1, 1, 1)))
    mesh = together(part.mesh, plate)
    if void:
        hollow = blocks([5, 9], [-2, 2], [0.4, 1.2], np.ones((1, 1, 1)))
        mesh = together(mesh, Mesh(hollow.vertices, hollow.faces[:, ::-1].copy()))
    return Part(mesh, part.curves)


def judge(mesh: Mesh, wall_mm: float = np.inf) -> dict[str, Check]:
    return {c.name: c for c in check_upright(Upright(mesh, PLA, wall_mm), LAYER)}


def failed(mesh: Mesh) -> set[str]:
    return {name for name, check in judge(mesh).items() if check.status == "fail"}
