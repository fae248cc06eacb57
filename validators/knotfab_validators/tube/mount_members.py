"""Check that a mount holds: matter fills every member, and nothing else joins strands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_most, places, skip_check, spot
from knotfab_validators.geometry.curves import Curves, Member, Slab, point_segment
from knotfab_validators.geometry.mesh import Mesh, bound_triangles, connect, winding_numbers
from knotfab_validators.tube.solid_matter import (
    FACET_MM,
    Hole,
    Solid,
    check_plate,
    clip,
    find_hollow,
    find_plug,
    holes_of,
    inside_plate,
    list_feet,
    strand_faces,
)
from knotfab_validators.tube.tube_fit import LIMIT

NAME = "mount"
PROUD_MM = 0.035  # how far a corner may stand out of a member
INTO_FOOT_MM = 0.15  # depth below the foot's surface at which matter is looked for
PLATE_HOLES = 2  # screw holes in a plate on the wall
ROOT = 1.6, 4.0  # largest width of a member's root in radii, and its height in mm
BESIDE = 5.0  # radii along a knot: a face that spans more joins two strands
SWOLLEN = 1.2  # radii from the centre lines: mitres of the sharpest bends stand out by less
OWN = 1.25  # radii from a centre line within which matter may fill the space between strands


@dataclass(frozen=True)
class Asked:
    """What a scene requires of its mount, in the part's coordinates, mm.

    `pegs`: how many members there are, by knots; empty: not said. `solids`: what must be filled by
    the scene itself (a wall plate). `hulls`: the name of the solids that knots.json must have, such as
    "base", and how thick each must be below every foot at least. `threads`: where eyelets carry
    the piece, (1 or 2, 3). `on_feet`: whether it stands in a plate by its own valleys; `frame` (n, 3):
    corners over which that plate must extend. `holes`: the screw holes of a wall plate; of one in which it
    stands, `plate_mm` are the holes' width and the thickness, and one that is `taped` may have none.
    """

    pegs: tuple[int, ...] = ()
    solids: tuple[Solid, ...] = ()
    hulls: tuple[str, float] | None = None
    threads: Array | None = None
    on_feet: bool = False
    frame: Array = field(default_factory=lambda: np.empty((0, 3)))
    holes: tuple[Hole, ...] = ()
    plate_mm: tuple[float, float] = (0.0, 0.0)
    taped: bool = False


NOTHING_ASKED = Asked()


def check_mount(mesh: Mesh, curves: Curves, asked: Asked = NOTHING_ASKED) -> Check:
    """Check `mount`: matter fills the whole mount, its holes are open, and there is nothing else.

    A solid is full where no face lies in it and one of its points is in matter: in the union of a
    part's solids there are no faces. Every face of the part belongs to a strand, a member, a rod, a solid
    or the plate. A mount whose members knots.json leaves out fails.

    Args:
        curves: closed, their radius known, with members, rods and hulls of the mount.
    """
    radius = curves.radius_mm
    if radius is None or not all(curves.closed):
        detail = "the strands' radius is not known, or one of them is open"
        return _misfit("unknown", detail)
    if not mesh.usable:
        return skip_check(NAME, "the mesh has no faces, or coordinates that are not finite")
    solids = [*asked.solids, *(Solid(name, corners) for name, corners in curves.hulls)]
    if not curves.members and curves.plate is None:
        joined = _find_fused(mesh, curves, radius)
        if len(joined):
            detail = "matter joins strands that are too near each other for a strut"
            return _misfit("joined", detail, joined)
    if asked.on_feet and curves.plate is None:
        return _misfit(
            "missing", "knots.json names no plate, and by the scene the piece stands in one"
        )
    if curves.plate is None:
        lacking = _find_lacking(curves, asked)
        if lacking is not None:
            return _misfit("lacking", f"{lacking}: build the part anew to have its mount measured")
        wanted = sum(asked.pegs)
        if wanted and len(curves.members) != wanted:
            detail = "members in the file of the knots, and those of the scene's mount"
            return Check(NAME, "fail", True, len(curves.members), wanted, "", detail)
        unfit = _find_unfit(curves, solids, asked)
        if unfit is not None:
            return _misfit("misfit", unfit[0], [unfit[1]])
    elif asked.on_feet and (why := _find_other_plate(curves.plate, asked)):
        return _misfit("misfit", why)
    if (surplus := _find_surplus(curves, asked)) is not None:
        return _misfit("surplus", f"knots.json lists {surplus}")
    others, detail = _find_others(mesh, curves, solids)
    if len(others):
        return _misfit("joined", f"{detail}, at {spot(others[0])}", others)
    for hole in asked.holes if curves.plate is None else holes_of(curves.plate):
        plug = find_plug(mesh, hole)
        if plug is not None:
            detail = f"matter lies in a screw hole of {2 * hole.radius_mm:.3g} mm, at {spot(plug)}"
            return _misfit("plugged", detail, [plug])
    if curves.plate is not None:
        feet = list_feet(curves.polygons, curves.plate, radius)
        return check_plate(mesh, curves.plate, np.concatenate([asked.frame, feet]))
    for solid in solids:
        hollow = find_hollow(mesh, solid)
        if hollow is not None:
            deep, at = hollow
            detail = f"the {solid.name} of the mount has a gap, slit or hollow at {spot(at)}"
            got = "missing" if np.isinf(deep) else deep
            return Check(NAME, "fail", True, got, solid.allowed_mm, "mm", detail, places([at]))
    return _check_filled(mesh, curves, radius)


def _misfit(got: str, detail: str, at: Sequence[Array] | Array = ()) -> Check:
    return Check(NAME, "fail", True, got, None, "", detail, places(at))


def _find_lacking(curves: Curves, asked: Asked) -> str | None:
    """Say which parts of a mount knots.json leaves out."""
    if not curves.members:
        return "knots.json names no members of the mount"
    if asked.threads is not None and not curves.rods:
        return "knots.json names no rods of an eyelet"
    if asked.hulls is not None and not any(name == asked.hulls[0] for name, _ in curves.hulls):
        return f"knots.json names no {asked.hulls[0]} among its hulls"
    return None


def _find_surplus(curves: Curves, asked: Asked) -> str | None:
    """Say what knots.json lists that the scene's mount has not, under which matter would belong to it."""
    if curves.plate is not None and (curves.members or curves.rods or curves.hulls):
        return "members, rods or hulls beside a plate, which holds the piece alone"
    if curves.rods and asked.threads is None:
        return "rods of an eyelet, and by the scene the piece hangs on none"
    name = None if asked.hulls is None else asked.hulls[0]
    most = len(curves.members) if name == "dowel" else 1
    if any(own != name for own, _ in curves.hulls) or len(curves.hulls) > most:
        return f"{len(curves.hulls)} hulls, more than the scene's mount has"
    return None


def _find_unfit(curves: Curves, solids: Sequence[Solid], asked: Asked) -> tuple[str, Array] | None:
    """Say where the mount of knots.json is not what the scene requires, such as a foot on nothing."""
    for number, member in enumerate(curves.members):
        if member.foot is None:
            continue
        under = [s for s in solids if s.hull.depth(member.end[None])[0] >= -INTO_FOOT_MM]
        if solids and not under:
            return f"member {number} stands on no plate, base or dowel", member.end
        if asked.hulls is not None:
            name, least = asked.hulls
            side = np.cross(member.foot, np.eye(3)[np.abs(member.foot).argmin()])
            wide = max(s.hull.way_out(member.end, side / np.linalg.norm(side)) for s in under)
            if name == "dowel" and wide > member.radius_mm[1] + INTO_FOOT_MM:
                return f"the dowel of member {number} is thicker than its peg", member.end
            way = max((s.hull.way_out(member.end, -member.foot) for s in under), default=0.0)
            if way < least - INTO_FOOT_MM:
                detail = (
                    f"the {name} is {way:.3g} mm thick below member {number}, not {least:.3g} mm"
                )
                return detail, member.end
    return None if asked.threads is None else _find_unfit_eyelet(curves.rods, asked.threads)


def _find_unfit_eyelet(rods: Sequence[Member], threads: Array) -> tuple[str, Array] | None:
    """Say which of the threads (k, 3) lacks its own eyelet, a ring of consecutive rods."""
    starts, ends = np.array([bar.start for bar in rods]), np.array([bar.end for bar in rods])
    after = np.linalg.norm(ends[:-1] - starts[1:], axis=1) > INTO_FOOT_MM
    rings = np.split(np.arange(len(rods)), 1 + np.flatnonzero(after))
    for ring in rings:
        if len(ring) < 3 or np.linalg.norm(ends[ring[-1]] - starts[ring[0]]) > INTO_FOOT_MM:
            return "the rods of an eyelet close no ring", ends[ring[-1]]
    if len(rings) != len(threads):
        return f"there are {len(rings)} eyelets, and by the scene {len(threads)}", ends[0]
    for thread, ring in zip(threads, rings, strict=True):
        at = np.tile(thread, (len(ring), 1))
        wire = min(rods[ring[0]].radius_mm)
        off = abs(point_segment(at, starts[ring], ends[ring]).min() - wire)
        if off > INTO_FOOT_MM:
            return f"an eyelet's wire is {off:.3g} mm off its thread's place", thread
    return None


def _check_filled(mesh: Mesh, curves: Curves, radius: float) -> Check:
    members, edges = curves.members, curves.edges
    ends = [(k, m.start) for k, m in enumerate(members)]
    ends += [(k, m.end) for k, m in enumerate(members) if m.foot is None]
    for number, end in ends:
        apart = point_segment(np.tile(end, (len(edges.start), 1)), edges.start, edges.end).min()
        if apart > radius and not any(_in_member(end[None], bar)[0] for bar in curves.rods):
            detail = f"member {number} of the mount ends at {spot(end)}, in no strand"
            return _misfit("loose", detail, [end])
    low, high = bound_triangles(*np.moveaxis(mesh.vertices[mesh.faces], 1, 0))
    worst, at, of = 0.0, members[0].start, 0
    members = (*members, *curves.rods)
    for number, member in enumerate(members):
        depth, place = _find_deepest(mesh, member, low, high)
        if depth > worst:
            worst, at, of = depth, place, number
    middles = np.array([(m.start + m.end) / 2 for m in members])
    empty = np.flatnonzero(winding_numbers(middles, mesh) < 0.5)
    if worst <= 1 and len(empty):
        detail = f"there is no matter in {len(empty)} of {len(members)} members of the mount, such as at "
        detail += spot(middles[empty[0]])
        return _misfit("missing", detail, middles[empty])
    allowed = _allowed(min(members[of].radius_mm))
    detail = f"how deep the surface lies at most in one of the {len(members)} members of the mount"
    if worst > 1:
        detail += f", which has a gap, slit or hollow at {spot(at)}"
    where = [at] if worst > 1 else []
    return at_most(NAME, worst * allowed, allowed, "mm", detail, tolerance=1e-9 * allowed, at=where)


def _allowed(radius: float) -> float:
    """Return the depth in a member, mm, at which a face may still lie."""
    return LIMIT * radius + 0.025  # a facet of a member may lie this far inside it


def _find_deepest(mesh: Mesh, member: Member, low: Array, high: Array) -> tuple[float, Array]:
    """Measure the deepest face in a member, as a multiple of the limit, and its place (3,)."""
    wide = max(member.radius_mm)
    a, b = np.minimum(member.start, member.end) - wide, np.maximum(member.start, member.end) + wide
    near = np.arange(len(low))
    for axis in range(3):
        near = near[(low[near, axis] <= b[axis]) & (high[near, axis] >= a[axis])]
    corners, whole = mesh.vertices[mesh.faces[near]], np.ones(len(near), dtype=bool)
    planes = _planes(member)
    for normal, offset in planes:
        within = corners @ normal >= offset
        corners, whole = (
            corners[within.any(axis=1)],
            (whole & within.all(axis=1))[within.any(axis=1)],
        )
    deep, point = _measure_depth(corners, member)
    # faces only partly between the planes are measured by that part
    fans = [
        np.stack([part[[0, k, k + 1]] for k in range(1, len(part) - 1)])
        for triangle in corners[~whole & (deep > 0)]
        if len(part := clip(clip(triangle, *planes[0]), *planes[1])) > 2
    ]
    more, there = _measure_depth(np.concatenate([np.empty((0, 3, 3)), *fans]), member)
    deep = np.concatenate([[0.0], deep[whole], more]) / _allowed(min(member.radius_mm))
    k = int(deep.argmax())
    return float(deep[k]), np.concatenate([[member.start], point[whole], there])[k]


def _measure_depth(corners: Array, member: Member) -> tuple[Array, Array]:
    """Measure how deep triangles (n, 3, 3) reach into a member's infinite cone, and where (n, 3)."""
    unit, _ = _unit(member)
    to = corners - member.start
    flat = to - (to @ unit)[..., None] * unit  # projected along the axis
    after = np.roll(flat, -1, axis=1)
    step, turn = after - flat, np.cross(flat, after) @ unit
    square = np.einsum("nij,nij->ni", step, step)
    share = -np.einsum("nij,nij->ni", flat, step) / np.where(square > 0, square, 1.0)
    foot = flat + np.clip(share, 0.0, 1.0)[..., None] * step
    best = np.linalg.norm(foot, axis=2).argmin(axis=1)
    row = np.arange(len(corners))
    span = np.roll(corners, -1, axis=1)[row, best] - corners[row, best]
    point = corners[row, best] + np.clip(share[row, best], 0.0, 1.0)[:, None] * span
    along, radial = _measure(point, member)
    through = (turn > 0).all(axis=1) | (turn < 0).all(axis=1)  # the axis passes through it
    return _radius_at(member, along) - np.where(through, 0.0, radial), point


def _unit(member: Member) -> tuple[Array, float]:
    span = member.end - member.start
    length = float(np.linalg.norm(span))
    return span / length, length


def _planes(member: Member) -> list[tuple[Array, float]]:
    """Return the half spaces (n · p >= offset) within which a member must be full."""
    unit, _ = _unit(member)
    begin = (unit, float(unit @ member.start))
    if member.foot is None:
        return [begin, (-unit, float(-unit @ member.end))]
    return [begin, (member.foot, float(member.foot @ member.end) - INTO_FOOT_MM)]


def _measure(points: Array, member: Member) -> tuple[Array, Array]:
    """Measure how far points (n, 3) are along a member and from its axis, mm."""
    unit, _ = _unit(member)
    to = points - member.start
    along = to @ unit
    return along, np.linalg.norm(to - along[:, None] * unit, axis=1)


def _radius_at(member: Member, along: Array) -> Array:
    first, last = member.radius_mm
    return np.asarray(first + (last - first) * np.clip(along / _unit(member)[1], 0.0, 1.0))


def _find_other_plate(plate: Slab, asked: Asked) -> str:
    """Say how a plate of knots.json differs from the scene's; empty if it does not."""
    wide, thick = asked.plate_mm
    few = PLATE_HOLES if len(plate.holes) or not asked.taped else 0
    if len(plate.holes) != few or plate.hole_mm < wide - FACET_MM:
        return (
            f"knots.json lists {len(plate.holes)} holes of {plate.hole_mm:.3g} mm in the plate, and by "
            f"the scene there are {PLATE_HOLES} of {wide:.3g} mm"
        )
    if abs(plate.thickness_mm - thick) > FACET_MM:
        return f"the plate is {plate.thickness_mm:.3g} mm thick, and by the scene {thick:.3g} mm"
    return ""


def _find_others(mesh: Mesh, curves: Curves, solids: Sequence[Solid]) -> tuple[Array, str]:
    """Find places (k, 3) of faces that belong to nothing, with what is said of them.

    A face belongs where all its corners lie: in one strand, in the plate, in a member or its root, in a rod,
    or in a solid. The edges of a union lie on both of its surfaces; corners, middles of edges and the middle
    of a face across a seam each lie in one of those.
    """
    vertices, faces = mesh.vertices, mesh.faces
    own = strand_faces(mesh, curves, proud=SWOLLEN, beside=BESIDE)
    rest = np.flatnonzero(~own)
    within = list[Callable[[Array], Mask]]()
    if curves.plate is not None:
        within.append(partial(inside_plate, plate=curves.plate))
    within += [solid.covers for solid in solids]
    within += [partial(_in_member, member=member) for member in (*curves.members, *curves.rods)]
    for inside in within:
        if not len(rest):
            break
        used, corner = np.unique(faces[rest], return_inverse=True)
        rest = rest[~inside(vertices[used])[corner.reshape(-1, 3)].all(axis=1)]
    # a coarser mesh has faces across a seam: each place of them lies in one or the other
    if len(rest):
        corners = vertices[faces[rest]]
        middles = (corners + np.roll(corners, 1, axis=1)) / 2
        places = np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1)
        lies = np.zeros(places.shape[:2], dtype=bool)
        for inside in within:
            lies |= inside(places.reshape(-1, 3)).reshape(lies.shape)
        rest = rest[~lies.all(axis=1)]
    on_strand = np.zeros(len(vertices), dtype=bool)
    on_strand[faces[own]] = True
    touches = np.asarray(on_strand[faces[rest]].any(axis=1))
    if touches.any():
        return _one_of_each(
            mesh, rest, touches
        ), "matter that is no member of the mount touches a strand"
    there = _one_of_each(mesh, rest, np.ones(len(rest), dtype=bool))
    return there, "there is matter that is neither strand nor plate nor member of the mount"


def _in_member(points: Array, member: Member) -> Mask:
    """Return which points (n, 3) are in a member or its root."""
    _, length = _unit(member)
    along, radial = _measure(points, member)
    wide, high = ROOT
    share = np.where((along > length - high) & (member.foot is not None), wide, 1.0)
    within = radial <= share * _radius_at(member, along) + PROUD_MM
    return np.asarray(within & (along > -PROUD_MM) & (along < length + max(member.radius_mm)))


def _find_fused(mesh: Mesh, curves: Curves, radius: float) -> Array:
    """Find places (k, 3) where faces join two strands that are too near for a strut."""
    from scipy.spatial import cKDTree

    rest = np.flatnonzero(~strand_faces(mesh, curves, proud=SWOLLEN, beside=BESIDE))
    edges = curves.edges
    corners = mesh.vertices[mesh.faces[rest]]
    middle = (edges.start + edges.end) / 2
    reach = float(np.linalg.norm(edges.end - edges.start, axis=1).max()) / 2
    far, edge = cKDTree(middle).query(
        corners.reshape(-1, 3), distance_upper_bound=OWN * radius + reach
    )
    on = (far < np.inf).reshape(-1, 3).all(axis=1)
    rest, corners, edge = rest[on], corners[on], edge.reshape(-1, 3)[on]
    foot = middle[edge]
    # all three corners lie on strands; on a single strand it would be the strand's own face
    apart = np.linalg.norm(foot - foot[:, [1, 2, 0]], axis=2).max(axis=1, initial=0.0)
    # in radii: distance of the centre lines that it joins
    short: Mask = np.less(apart, 2.4 * radius)
    return _one_of_each(mesh, rest, short & np.greater(apart, radius))


def _one_of_each(mesh: Mesh, some: Ints, bad: Mask) -> Array:
    """Return the centre (k, 3) of one bad face in each connected patch of faces."""
    if not bad.any():
        return np.empty((0, 3))
    faces = mesh.faces[some]
    label, _ = connect(
        faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1), len(mesh.vertices)
    )
    _, first = np.unique(label[faces[bad, 0]], return_index=True)
    return np.asarray(mesh.vertices[faces[bad][first]].mean(axis=1))
