"""What is flat on the wall and holds the piece's valleys: roots in its own shadow, or a thin plate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.design.candidates import FILLET_MM
from knotfab.geometry.tube import Mesh, as_manifold
from knotfab.hold.beams import DOWN, JOINT_RADII, Holder, Stiffness, sag_moves, worst_of
from knotfab.hold.roots import MOST_OUTSIDE, RISES, WIDTH_MM, NoWayError, Roots, lay_roots
from knotfab.hold.solids import Fixture
from knotfab.hold.space_frame import Beams, assemble_frame, round_beams
from knotfab.hold.struts import GROUND, Candidates, Sites, sites_of
from knotfab.knots import Knots
from knotfab.picture.silhouette import trace_polygon
from knotfab.scene.camera import Camera
from knotfab_fixtures.solids import outlined_plate
from knotfab_formats.piece import Mount
from knotfab_formats.scene import SettledScene

if TYPE_CHECKING:
    from manifold3d import Manifold
    from shapely import Geometry, Polygon

STRIP_MM = 12.0  # wide are strips that join islands
RIM_MM = 4.0  # about a screw's hole
OFF_MM = 1.0  # a screw's hole keeps so far off the plate's own outline
WITHIN_MM = 0.1  # an outline is drawn with straight lines so near to it
NEUTRAL_MM, CORNER_MM = 3.0, 14.0  # about the piece, and corners, of a rounded plate
PRINT_MM = 0.2  # about a foot, which a plate reaches past at least
LEAST_BACK_MM = 0.15  # of a plate below the lowest foot
_AT_ONCE = 4  # joints on the wall whose responses are solved for together


@dataclass(frozen=True)
class FootPlate:
    """A plate whose face is the wall, or roots that lie on it.

    `outline` (n, 2), anticlockwise, `openings` in it, clockwise, and `holes` (k, 2), the middles of the screw
    holes, are mm right and up from the frame's middle. `feet` counts the valleys of each knot that stand in
    it, and `handles` what these add to the body's: a ring that lies in the plate whole adds none. Strips are
    `width_mm` wide, 0 for a plate; `taped`: along their whole length, not at their pads alone.
    """

    outline: Array
    openings: tuple[Array, ...]
    holes: Array
    feet: tuple[int, ...]
    handles: tuple[int, ...]
    width_mm: float = 0.0
    taped: bool = False


@dataclass(frozen=True, kw_only=True)
class StandingPiece(Holder):
    """A piece in its plate."""

    plate: FootPlate


@dataclass(frozen=True)
class _Foot:
    """A piece of tube in the plate: its middle, right and up from the frame's, and reach, mm."""

    knot: int
    middle: Array
    reach_mm: float
    genus: int  # 1: a ring, whole


def plan_foot_plate(
    knots: Knots,
    tubes: list[Mesh],
    camera: Camera,
    stiffness: Stiffness,
    settings: Mount,
    target: Mask | None = None,
) -> StandingPiece:
    """Plan the plate of a piece whose valleys reach below its face.

    Args:
        knots, tubes: a tube for each knot, in scene coordinates. settings: with a plate for feet.
        target: (H, W) the picture's silhouette, where roots may lie as in the knots' own shadow.

    Raises:
        SceneError: a knot has no valley there, a valley comes out of the plate's back, or no shadow leads
            roots from one foot to another.
    """
    face = camera.middle + settings.before_wall_mm * camera.wall_axes[2]
    to_wall = np.column_stack([camera.wall_axes, -camera.wall_axes @ face])
    below = [as_manifold(tube).transform(to_wall).trim_by_plane((0, 0, -1), 0) for tube in tubes]
    feet = _find_feet(below, settings.thickness_mm)
    knot_of = np.array([foot.knot for foot in feet], dtype=np.int64)
    count = np.bincount(knot_of, minlength=len(tubes))
    if not count.all():
        bare = int(count.argmin())
        raise SceneError(
            f"a plate that the piece stands in (--plate {settings.plate})",
            f"no valley of knot {bare + 1} of {len(tubes)} reaches the wall",
            "Use --plate pegs",
        )
    # a body is joined to another over patches: its Euler characteristic is the sum less that of the patches
    handles = np.bincount(knot_of, [1 - foot.genus for foot in feet], len(tubes)).astype(int)
    own = tuple(count.tolist()), tuple(handles.tolist())
    held = _hold_feet(knots, feet, camera)
    moves = sag_moves(knots, *held, stiffness)
    shadow = _cast_tubes(knots, camera, to_wall)
    if settings.plate != "roots":
        plate = FootPlate(*_shape_plate(shadow, feet, camera, settings), *own)
        return _standing(plate, moves, knots)
    prints, middles = _print_feet(below), np.array([foot.middle for foot in feet])
    dark = _find_dark(shadow, camera, settings, target)
    most_mm2 = MOST_OUTSIDE * float(np.prod(camera.frame_mm))
    found = list[StandingPiece]()
    for rise in RISES:
        try:
            how = settings.hole_diameter_mm, WIDTH_MM, most_mm2, rise
            roots = lay_roots(dark, middles, prints, *how)
        except NoWayError:
            if not found:
                raise
            continue
        plate = FootPlate(*_rings_of(roots.sheet), roots.holes, *own, WIDTH_MM, taped=True)
        found.append(_standing(plate, moves, knots))  # tape holds each foot where it is
        if len(roots.holes):
            on_pads = partial(_hold_by_pads, roots, len(feet), camera, settings, stiffness)
            swayed = sag_moves(knots, *held, stiffness, hold=on_pads)
            screwed = _standing(replace(plate, taped=False), swayed, knots)
            if screwed.sag_mm <= stiffness.max_sag_mm:
                return screwed
    return found[0]


def _standing(plate: FootPlate, moves: Array, knots: Knots) -> StandingPiece:
    sag, at = worst_of(moves, knots.points)
    return StandingPiece(plate=plate, sag_mm=sag, sag_at=at, moves=moves)


def on_rounded(scene: SettledScene) -> SettledScene:
    """Return the scene with a rounded plate in place of roots, its face where theirs is.

    The wall comes nearer by the thickness of roots, and the picture there is smaller, in the same light.
    """
    view = scene.views[0]
    near = view.wall_distance_mm - scene.mount.before_wall_mm
    share = (view.light_distance_mm + near) / (view.light_distance_mm + view.wall_distance_mm)
    keys = {
        "wall_distance_mm": near,
        "frame_up_mm": share * view.frame_up_mm + (1 - share) * view.light_up_mm,
        "frame_width_mm": share * view.frame_width_mm,
        "frame_height_mm": share * view.frame_height_mm,
    }
    if view.thicken_mm:
        keys["thicken_mm"] = share * view.thicken_mm
    return scene.but(views=(view.but(**keys),), mount=scene.mount.but(plate="rounded"))


def ears_mm(settings: Mount) -> float:
    """Return how much wider, over both sides, the plate is for the ears that hold its screws."""
    return 2 * (settings.hole_diameter_mm + OFF_MM + RIM_MM)


def foot_plate_fixture(plate: FootPlate, camera: Camera, settings: Mount) -> Fixture:
    """Make a plate whose face lies on the receiver plane, or roots whose back does."""
    wall = np.column_stack(list(camera.wall_axes))
    rings = [ring.tolist() for ring in (plate.outline, *plate.openings)]
    sizes = settings.thickness_mm, settings.hole_diameter_mm, plate.holes.tolist(), rings
    back = camera.middle - (settings.thickness_mm - settings.before_wall_mm) * wall[:, 2]
    return Fixture("plate", outlined_plate, sizes, np.column_stack([wall, back]))


def _find_feet(below: list[Manifold], thickness_mm: float) -> list[_Foot]:
    """Find the pieces of each tube that do not meet below the wall's face, z = 0."""
    found = []
    for number, own in enumerate(below):
        for foot in own.decompose():
            x0, y0, z0, x1, y1, _ = foot.bounding_box()
            if -z0 > thickness_mm - LEAST_BACK_MM:
                need = np.ceil(10 * (LEAST_BACK_MM - z0)) / 10
                raise SceneError(
                    "the wall's plate",
                    f"the tube reaches {-z0:.2f} mm behind its face, and it is {thickness_mm:g} mm thick",
                    f"Use mount.plate_thickness_mm = {need:g} (in scene.toml, with --scene)",
                )
            middle = np.array([x0 + x1, y0 + y1]) / 2
            found.append(_Foot(number, middle, float(np.hypot(x1 - x0, y1 - y0)) / 2, foot.genus()))
    return found


def _shape_plate(
    shadow: Geometry, feet: list[_Foot], camera: Camera, settings: Mount
) -> tuple[Array, tuple[Array, ...], Array]:
    """Shape a plate: its outline (n, 2), no openings, and the middles of its screw holes (2, 2)."""
    import shapely

    within = shapely.union_all([shapely.Point(f.middle).buffer(f.reach_mm + RIM_MM) for f in feet])
    if settings.plate == "full":
        across, up = camera.frame_mm
        body = shapely.box(-across / 2, -up / 2, across / 2, up / 2).union(within)
    elif settings.plate == "rounded":
        box = shapely.box(*shadow.union(within).buffer(NEUTRAL_MM).bounds)
        body = box.buffer(-CORNER_MM).buffer(CORNER_MM).union(within)
    else:
        body = shadow.buffer(settings.plate_margin_mm + FILLET_MM).buffer(-FILLET_MM).union(within)
    sheet = _fill_holes(_bridge_islands(body))
    holes, ears = _find_holes(sheet, settings.hole_diameter_mm)
    return *_rings_of(_fill_holes(sheet.union(ears)).simplify(WITHIN_MM)), holes


def _rings_of(sheet: Polygon) -> tuple[Array, tuple[Array, ...]]:
    """Return a sheet's outline, anticlockwise, and its openings, clockwise, without the closing corners."""
    import shapely

    turned = shapely.geometry.polygon.orient(sheet, 1.0)
    outline, *openings = (np.array(r.coords)[:-1] for r in (turned.exterior, *turned.interiors))
    return outline, tuple(openings)


def _find_dark(shadow: Geometry, camera: Camera, settings: Mount, target: Mask | None) -> Geometry:
    """Find where strips stay in the dark of knots and picture, by their face as by their back."""
    import shapely

    if target is not None:
        at = camera.corner - camera.middle
        right, up = camera.wall_axes[:2]

        def to_wall(pixels: Array) -> Array:
            places = at + pixels[:, :1] * camera.du + pixels[:, 1:] * camera.dv
            return np.column_stack([places @ right, places @ up])

        shadow = shadow.union(shapely.transform(trace_polygon(target), to_wall).buffer(0))
    lamp = camera.wall_axes @ (camera.eye - camera.middle)
    nearer = 1.0 - settings.before_wall_mm / float(lamp[2])
    origin = (float(lamp[0]), float(lamp[1]))
    return shadow.intersection(shapely.affinity.scale(shadow, nearer, nearer, origin=origin))


def _print_feet(below: list[Manifold]) -> Geometry:
    """Draw what the tubes below a plate's face cover of it, and a rim about that."""
    import shapely

    rings = [shapely.Polygon(ring) for own in below for ring in own.project().to_polygons()]
    return shapely.union_all(rings).buffer(PRINT_MM)


def _cast_tubes(knots: Knots, camera: Camera, to_wall: Array) -> Geometry:
    """Cast the tubes on the wall, approximately."""
    to_wall_mm, to_piece_mm = (
        float(np.linalg.norm(at)) for at in (camera.eye - camera.middle, camera.eye)
    )
    wide = knots.radius_mm * to_wall_mm / to_piece_mm
    cast = [camera.cast(knot.points) @ to_wall[:, :3].T + to_wall[:, 3] for knot in knots.knots]
    import shapely

    rings = [shapely.LineString(np.append(line, line[:1], axis=0)[:, :2]) for line in cast]
    return shapely.union_all([ring.simplify(WITHIN_MM).buffer(wide) for ring in rings])


def _bridge_islands(body: Geometry) -> Polygon:
    """Connect a sheet's islands by strips along the shortest ways between them."""
    import shapely

    islands = list(shapely.get_parts(body))
    sheet = islands.pop()
    while islands:
        nearest = min(range(len(islands)), key=lambda k: float(sheet.distance(islands[k])))
        other = islands.pop(nearest)
        way = shapely.shortest_line(sheet, other)
        sheet = shapely.union_all([sheet, other, way.buffer(STRIP_MM / 2)])
    return sheet


def _fill_holes(sheet: Polygon) -> Polygon:
    """Fill the sheet's holes, since shadows fall there, too."""
    import shapely

    return shapely.Polygon(sheet.exterior)


def _find_holes(sheet: Polygon, wide_mm: float) -> tuple[Array, Geometry]:
    """Place two screw holes on a level line beside the sheet, (2, 2), and ears that hold them.

    The line is where the sheet is widest, or nearest to the frame's middle, so that the ears stand
    out least.
    """
    import shapely

    x0, y0, x1, y1 = sheet.bounds

    def span(y: float) -> tuple[float, float]:
        low, _, high, _ = sheet.intersection(shapely.LineString([(x0 - 1, y), (x1 + 1, y)])).bounds
        return float(low), float(high)

    levels = np.linspace(y0, y1, 65)[8:-8].tolist()
    y = max(levels, key=lambda level: np.subtract(*span(level)[::-1]) - 0.1 * abs(level))
    low, high = span(y)
    out, wide = wide_mm / 2 + OFF_MM, wide_mm / 2 + RIM_MM
    holes = np.array([[low - out, y], [high + out, y]])
    roots = np.array([[low + wide, y], [high - wide, y]])
    ends = zip(holes, roots, strict=True)
    return holes, shapely.union_all([shapely.LineString(pair).buffer(wide) for pair in ends])


def _hold_feet(knots: Knots, feet: list[_Foot], camera: Camera) -> tuple[Sites, Candidates]:
    """Hold the vertices over each foot: their sites, and short members to the wall.

    A foot that lies in the plate is held at both ends, where it is half as deep as at its lowest.
    """
    wall = camera.wall_axes
    held: dict[int, list[int]] = {k: [] for k in range(len(knots.knots))}
    for foot in feet:
        local = (knots.knots[foot.knot].points - camera.middle) @ wall.T
        away = np.linalg.norm(local[:, :2] - foot.middle, axis=1)
        near = np.flatnonzero(away <= max(foot.reach_mm, float(away.min())))
        depth = local[near, 2] - knots.radius_mm
        deep = near[depth <= 0.5 * depth.min()] if depth.min() < 0 else near
        step = np.diff(deep, prepend=-2, append=deep[-1] + 2) > 1
        held[foot.knot] += [int(near[depth.argmin()]), *deep[step[:-1] | step[1:]].tolist()]
    also = {k: np.unique(vertices).astype(np.int64) for k, vertices in held.items()}
    sites = sites_of(knots, JOINT_RADII, also)
    first = np.concatenate(
        [
            np.flatnonzero((sites.knot == k) & np.isin(sites.vertex, vertices))
            for k, vertices in also.items()
        ]
    )
    start = sites.point[first]
    # the plate holds a foot as far as its own thickness: a short, stout member
    end = start - knots.radius_mm * wall[2]
    radius = np.full(len(first), knots.radius_mm)
    ground = np.full(len(first), GROUND)
    return sites, Candidates(first, ground, start, end, radius)


def _hold_by_pads(
    roots: Roots,
    feet: int,
    camera: Camera,
    settings: Mount,
    stiffness: Stiffness,
    beams: Beams,
    ends: Indices,
) -> tuple[Beams, Mask]:
    """Stand a frame's ends, that would be rigid, on strips that are held at their pads and lean on the wall.

    Also return which unknowns are held, (6 n,).
    """
    wall, thick, n = camera.wall_axes, settings.thickness_mm, len(beams.joints)
    flat = (beams.joints[ends] - camera.middle) @ wall[:2].T
    away = np.linalg.norm(flat[:, None] - roots.points[:feet], axis=2)
    stout = round_beams(
        np.concatenate([beams.joints, camera.middle + roots.points @ wall[:2]]),
        np.concatenate([np.column_stack([ends, n + away.argmin(axis=1)]), n + roots.ends]),
        np.full(len(ends) + len(roots.ends), float(thick)),
    )
    strip, edgewise = slice(len(ends), None), stout.inertia.copy()
    edgewise[strip] = roots.widths**3 * thick / 12
    stout.area[strip] = roots.widths * thick
    stout.inertia[strip] = roots.widths * thick**3 / 12
    stout.twist[strip] = roots.widths * thick**3 / 3
    joined = (
        np.concatenate([getattr(beams, name), getattr(stout, name)])
        for name in ("ends", "area", "inertia", "twist")
    )
    edgewise = np.concatenate([beams.inertia, edgewise])
    whole = replace(Beams(stout.joints, *joined), flat=wall[2], edgewise=edgewise)
    held = np.zeros((len(stout.joints), 6), dtype=bool)
    held[n + feet : n + feet + len(roots.holes)] = True
    return whole, lean_on_wall(
        whole, held.ravel(), np.arange(n, len(stout.joints)), wall[2], stiffness
    )


def lean_on_wall(
    beams: Beams, held: Mask, joints: Indices, out: Array, stiffness: Stiffness
) -> Mask:
    """Hold those joints of a frame that its weight presses into the wall, whose normal is `out` (3,).

    Nothing holds a joint that lifts off. A wall that is not square to an axis of the scene holds none.

    Returns:
        Which unknowns are held, (6 n,).
    """
    from scipy.optimize import nnls

    axis = int(np.abs(out).argmax())
    off = 6 * joints[~held[6 * joints + axis]] + axis
    if abs(out[axis]) < 1 - 1e-9 or not len(off):
        return held
    how = stiffness.young_mpa, stiffness.density_g_cm3, DOWN, held
    frame = assemble_frame(beams, np.empty(0, dtype=np.int64), *how)
    away = out[axis] * frame.displacements().ravel()[off]
    # the forces p >= 0 of the wall, which leave no joint within it, have the least p G p / 2 + away p; most
    # joints bear none, so those that are farthest within it are added a few at a time
    left, force, least = away, np.empty(0), -1e-9 * np.abs(away).max()
    borne, yields = np.empty(0, dtype=np.int64), np.empty((len(off), 0))
    while len(within := np.setdiff1d(np.flatnonzero(left < least), borne)):
        more = within[np.argsort(left[within])[:_AT_ONCE]]
        borne = np.append(borne, more)
        yields = np.hstack([yields, frame.moves_under(off[more])[off]])
        among = yields[borne]
        lower = np.linalg.cholesky(among + 1e-9 * among.max() * np.eye(len(borne)))
        force, _ = nnls(lower.T, -np.linalg.solve(lower, away[borne]))
        left = away + yields @ force
    held = held.copy()
    held[off[borne[force > 0]]] = True
    return held
