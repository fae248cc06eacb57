"""The report on how a piece lies on the bed: its pose, its plates, and what its supports need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.geometry.overhang import Rules
from knotfab.geometry.polylines import number_runs
from knotfab.geometry.tube import Mesh, box_of, face_normals
from knotfab.part.orient import spread_turns
from knotfab.report.for_maker import tell_flatter
from knotfab_formats.print_figures import Flatter, Kept, PoseFigures, Print, SupportAccess

if TYPE_CHECKING:
    from knotfab.part.assemble import Part
    from knotfab.part.orient import Flattening


def report_posing(
    print_: Print,
    part: Part,
    flattening: Flattening | None,
    suffix: str = "",
    *,
    printing: bool = False,
    access: SupportAccess | None = None,
) -> tuple[Print, list[str]]:
    """Add pose, plates and supports to the figures of a piece, with notes on them.

    Args:
        suffix: of the plates' files, such as "-01" of a sequence's frame.
        printing: whether it is printed; if so, the cost of supports is added, and whether they come out.
        access: what `find_access` says of the part.
    """
    pose = _pose_figures(part, flattening)
    scene, notes = part.mounted.scene, list[str]()
    if printing and pose.box_cm3 is not None and scene.printer.process == "powder":
        notes.append(
            "It is printed in powder, which carries it: no supports, and any pose will do. Its box of "
            f"{pose.box_cm3:.0f} cm³ is what it takes of the powder bed."
        )
    if (shrinkage := pose.shrinkage_percent) is not None:
        larger = 100 / (1 - shrinkage / 100) - 100
        notes.append(
            f"All files are written {larger:.2f} % larger, for the material shrinks "
            f"by {shrinkage:g} %: switch off what your slicer or print service does about it."
        )
    notes += _tell_flattening(flattening)
    if printing:
        print_, told = _with_supports(print_, part, suffix, access)
        notes += told
    return replace(print_, pose=pose), notes


def _pose_figures(part: Part, flattening: Flattening | None) -> PoseFigures:
    """Report how the piece lies and why, and its depth before it was made flatter."""
    account, powder = part.pose.account, part.mounted.scene.printer.process == "powder"
    if account is not None:
        pose = account.figures()
    else:
        by = "the volume of its box" if powder else "least height"
        pose = PoseFigures(
            chosen_by="the mount" if part.mounted.upright is not None else by,
            height_mm=round(float(part.pose.size_mm[2]), 2),
            box_cm3=round(float(part.pose.size_mm.prod()) / 1000, 1),
        )
    depth = distance = None
    if flattening is not None:
        first, kept = round(flattening.from_mm, 2), round(flattening.to_mm, 2)
        depth = Kept(first, kept, flattening.proposed_mm)
        if flattening.unheld:
            distance = Kept(round(flattening.wall_mm[0], 2), round(flattening.wall_mm[1], 2))
    return replace(
        pose,
        shrinkage_percent=part.mounted.scene.material.shrinkage_percent or None,
        depth_mm=depth,
        wall_distance_mm=distance,
    )


def _tell_flattening(flattening: Flattening | None) -> list[str]:
    """Say that a piece was rebuilt nearer to the wall or flatter, or would have to be."""
    if flattening is None:
        return []
    notes = []
    if flattening.unheld:
        first, kept = flattening.wall_mm
        notes.append(
            f"At {first:.0f} mm from the wall, {flattening.from_mm:.0f} mm deep, {flattening.unheld}: "
            f"so it was rebuilt at {kept:.0f} mm, {flattening.to_mm:.0f} mm deep."
        )
    elif flattening.to_mm < flattening.from_mm:
        notes.append(
            f"Its depth was lowered from {flattening.from_mm:.0f} to {flattening.to_mm:.0f} mm, "
            "as no pose kept the printer's limit for supports."
        )
    if flattening.proposed_mm is not None:
        notes.append(
            "No pose keeps the printer's limit for supports: a depth of about "
            f"{flattening.proposed_mm:g} mm would (--depth {flattening.proposed_mm:g})."
        )
    return notes


def find_access(part: Part) -> SupportAccess | None:
    """Measure whether supports come out; None without any."""
    from knotfab.part.assemble import rules_of

    rules = rules_of(part.mounted.scene)
    if not rules.supports or rules.powder:
        return None
    return measure_access(part.bodies, rules)


def _with_supports(
    print_: Print, part: Part, suffix: str, access: SupportAccess | None
) -> tuple[Print, list[str]]:
    """Add flatter pieces and access to supports to the figures, with notes on them."""
    from knotfab.part.assemble import rules_of
    from knotfab.part.orient import estimate_flatter

    scene, notes, flatter = part.mounted.scene, list[str](), None
    seconds, grams, supports = print_.time_s, print_.filament_g, print_.support_g
    tall = part.pose.account is not None and scene.piece.depth != 0
    # with several views less depth of one is less width of another
    if tall and len(scene.views) == 1 and seconds and grams and supports is not None:
        sliced = Flatter(1.0, seconds / 3600, grams, supports)
        knots = part.pose.knots.moved(part.pose.matrix)
        flatter = tuple(estimate_flatter(knots, sliced, rules_of(scene)))
        if not suffix:  # the table of a sequence has the note of each frame
            notes.append(tell_flatter(flatter))
    if access is not None and access.worst is not None and not suffix:
        notes.append(tell_access(access))
    return replace(print_, flatter=flatter, support_access=access), notes


# Whether a straight tool reaches the supports from outside, to take them out.


# A straight round tool has this diameter: a finger, the jaws of a cutter, the nose of pliers, a hook.
TOOLS_MM = {"finger": 16.0, "cutter": 8.0, "pliers": 4.0, "hook": 2.0}
SAMPLES = 300  # undersides looked at
WAYS = 48  # directions of a tool
# a share of a tool's radius: it may brush a strand, and triangles stand for the surface
NEARLY = 0.85
STEP = 0.5  # the least way from one look to the next, as a share of the tool's radius
# the widest gap between points that stand for the surface; finer meshes are thinned to half of it
SPACING_MM = 1.0


def tell_access(access: SupportAccess) -> str:
    """Say in one sentence how the supports come off."""
    by_hand, cut = access.reached["finger"], access.reached["cutter"]
    text = f"Supports: {by_hand:.0%} come off by hand, {cut - by_hand:.0%} more with a cutter"
    if access.worst is None or access.worst_tool == "finger":
        return text + "."
    x, y, z = access.worst
    where = f"{x:.0f} mm from the left, {y:.0f} from the front, {z:.0f} above the bed"
    with_ = f"a {access.worst_tool}" if access.worst_tool else "a bent tool"
    return f"{text}; the hardest place, {where}, needs {with_}."


def measure_access(bodies: Sequence[Mesh], rules: Rules) -> SupportAccess:
    """Find which tools reach, from outside, the undersides of a piece that need support.

    A tool is a cylinder with a ball for a tip. The tip touches the underside, the axis goes straight
    out in one of `WAYS` directions, and the surface must keep away from it by the tool's radius all the
    way (sphere tracing: each step is as long as the nearest surface allows; Hart 1996). Supports do not
    block a tool, since they come out from the outside inwards.

    Args:
        bodies: meshes in print coordinates, the bed at z = 0.
        rules: the printer's for overhangs.
    """
    if not rules.supports or rules.powder:
        return _access_figures(0.0, dict.fromkeys(TOOLS_MM, 1.0))
    middle, normal, size = _sample(np.concatenate([v[f] for v, f in bodies]))
    steep = -normal[:, 2] > np.sin(np.radians(rules.max_overhang_deg)) + 1e-6
    under = np.flatnonzero(steep & (middle[:, 2] > 2 * rules.layer_mm))
    area = size[under] / 100
    if not len(under):
        return _access_figures(0.0, dict.fromkeys(TOOLS_MM, 1.0))
    # look as often at each mm² of underside
    along = (np.arange(min(SAMPLES, len(under))) + 0.5) / min(SAMPLES, len(under))
    chosen = np.unique(under[np.searchsorted(area.cumsum(), along * area.sum())])
    place, out = middle[chosen], normal[chosen]
    surface = cKDTree(_thin(middle))
    low, high = box_of(bodies)
    ways = spread_turns(WAYS)[3:, 2]
    best = np.zeros(len(place))  # diameter of the thickest tool that comes in
    # a thinner tool reaches each place that a thick one reaches, in the same way
    for diameter in sorted(TOOLS_MM.values(), reverse=True):
        rest = np.flatnonzero(best == 0)
        hit = _reaches(place[rest], out[rest], ways, diameter / 2, surface, low, high)
        best[rest[hit]] = diameter
    inside = np.minimum(place - low, high - place).min(axis=1)  # how deep in the box
    deepest = np.lexsort((-inside, best))[0]
    tool = next((name for name, d in TOOLS_MM.items() if d == best[deepest]), None)
    reached = {name: float((best >= diameter).mean()) for name, diameter in TOOLS_MM.items()}
    x, y, z = (round(float(c), 2) for c in place[deepest])
    return _access_figures(float(area.sum()), reached, (x, y, z), tool)


def _access_figures(
    area: float,
    reached: dict[str, float],
    worst: tuple[float, float, float] | None = None,
    tool: str | None = None,
) -> SupportAccess:
    return SupportAccess(
        area_cm2=round(area, 2),
        tools_mm=TOOLS_MM,
        reached={name: round(share, 3) for name, share in reached.items()},
        worst=worst,
        worst_tool=tool,
    )


def _reaches(
    place: Array, out: Array, ways: Array, radius: float, surface: cKDTree, low: Array, high: Array
) -> NDArray[np.bool_]:
    """Return whether a tool of this radius with its tip at each place gets out of the box some way, (n,)."""
    found = np.zeros(len(place), dtype=np.bool_)
    tip = place + radius * out
    free, _ = surface.query(tip)
    spot, way = (k.ravel() for k in np.indices((len(place), len(ways))))
    at = tip[spot]
    left = (free >= NEARLY * radius)[spot]
    while left.any():
        at, spot, way = at[left], spot[left], way[left]
        found[spot[((at < low - radius) | (at > high + radius)).any(axis=1)]] = True
        going = ~found[spot]
        at, spot, way = at[going], spot[going], way[going]
        away, _ = surface.query(at)
        at = at + np.maximum(away - NEARLY * radius, STEP * radius)[:, None] * ways[way]
        left = away >= NEARLY * radius
    return found


def _sample(corners: Array) -> tuple[Array, Array, Array]:
    """Sample triangles (m, 3, 3): points (k, 3), unit normals (k, 3), and the area of each, mm².

    The points lie in rows along each triangle's longest edge, rows and points at most `SPACING_MM`
    apart: a sliver is sampled only along its length.
    """
    across = face_normals(corners)
    double = np.linalg.norm(across, axis=1)
    corners, across, double = corners[double > 0], across[double > 0], double[double > 0]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = edges.argmax(axis=1)
    every = np.arange(len(corners))
    a, b, c = (corners[every, (longest + k) % 3] for k in range(3))
    length = edges[every, longest]
    rows = np.ceil(double / length / SPACING_MM).astype(np.int64)
    face, number = number_runs(rows)
    bottom, top = number / rows[face], (number + 1) / rows[face]
    up = np.where(rows[face] == 1, 1 / 3, (bottom + top) / 2)
    count = np.ceil(length[face] * (1 - up) / SPACING_MM).astype(np.int64)
    strip = double[face] / 2 * ((1 - bottom) ** 2 - (1 - top) ** 2)
    row, number = number_runs(count)
    face, up = face[row], up[row, None]
    along = ((number + 0.5) / count[row])[:, None] * (1 - up)
    points = a[face] + along * (b[face] - a[face]) + up * (c[face] - a[face])
    return points, (across / double[:, None])[face], (strip / count)[row]


def _thin(points: Array) -> Array:
    """Keep one point in each cell of half the spacing."""
    cell = np.floor(2 * (points - points.min(axis=0)) / SPACING_MM).astype(np.int64)
    wide, high = cell[:, 1].max() + 1, cell[:, 2].max() + 1
    _, kept = np.unique((cell[:, 0] * wide + cell[:, 1]) * high + cell[:, 2], return_index=True)
    return np.asarray(points[kept])
