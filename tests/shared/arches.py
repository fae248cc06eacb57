"""Parts that print without supports, by code: closed chains of arches on flat feet, bars and plates."""

from dataclasses import dataclass, replace

import manifold3d
import numpy as np
from solids import blocks, move, together
from validator_parts import tube

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Bar, Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.upright import Upright, check_upright

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
    half, turn = height / np.tan(flank), np.linspace(-flank, flank, 25)
    middle = bend / np.cos(flank)  # of the arc in a corner, above a valley or below a peak
    rows = []
    for k in range(2 * arches):
        up = 1 if k % 2 else -1  # peaks at 0, 2, …, valleys at 1, 3, …
        corner = (height if up < 0 else 0.0) + up * middle
        rows.append(
            np.column_stack([k * half + bend * np.sin(turn), corner - up * bend * np.cos(turn)])
        )
        start, end = rows[-1][-1], [(k + 1) * half - rows[0][-1, 0], height - rows[-1][-1, 1]]
        steps = int(np.hypot(*(end - start)) / 0.5)
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


def judge(mesh: Mesh) -> dict[str, Check]:
    return {c.name: c for c in check_upright(Upright(mesh, PLA), LAYER)}


def failed(mesh: Mesh) -> set[str]:
    return {name for name, check in judge(mesh).items() if check.status == "fail"}
