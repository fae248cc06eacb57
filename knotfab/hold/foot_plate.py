"""A thin plate on the wall, as large as frame or picture, in which the piece's valleys stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.candidates import FILLET_MM
from knotfab.geometry.tube import Mesh, as_manifold
from knotfab.hold.beams import JOINT_RADII, Holder, Stiffness, sag_moves, worst_of
from knotfab.hold.solids import Fixture
from knotfab.hold.struts import GROUND, Candidates, sites_of
from knotfab.knots import Knots
from knotfab.scene.camera import Camera
from knotfab_fixtures.solids import outlined_plate
from knotfab_formats.piece import Mount

if TYPE_CHECKING:
    from shapely import Geometry, Polygon

STRIP_MM = 12.0  # wide are strips that join islands
RIM_MM = 4.0  # about a screw's hole
OFF_MM = 1.0  # a screw's hole keeps so far off the plate's own outline
WITHIN_MM = 0.1  # an outline is drawn with straight lines so near to it
LEAST_BACK_MM = 0.15  # of a plate below the lowest foot


@dataclass(frozen=True)
class FootPlate:
    """A plate whose face is the wall.

    `outline` (n, 2), anticlockwise, and `holes` (2, 2), the middles of the screw holes, are mm
    right and up from the frame's middle. `feet` counts the valleys of each knot that stand in it, and
    `handles` what these add to the body's: a ring that lies in the plate whole adds none.
    """

    outline: Array
    holes: Array
    feet: tuple[int, ...]
    handles: tuple[int, ...]


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
    knots: Knots, tubes: list[Mesh], camera: Camera, stiffness: Stiffness, settings: Mount
) -> StandingPiece:
    """Plan the plate of a piece whose valleys reach below the wall's face.

    Args:
        knots, tubes: a tube for each knot, in scene coordinates. settings: with a plate for feet.

    Raises:
        SceneError: a knot has no valley there, or a valley comes out of the plate's back.
    """
    to_wall = np.column_stack([camera.wall_axes, -camera.wall_axes @ camera.middle])
    feet = _find_feet(tubes, to_wall, settings.thickness_mm)
    knot_of = np.array([foot.knot for foot in feet], dtype=np.int64)
    count = np.bincount(knot_of, minlength=len(tubes))
    if not count.all():
        bare = int(count.argmin())
        raise SceneError(
            f"a plate that the piece stands in (--plate {settings.plate})",
            f"no valley of knot {bare + 1} of {len(tubes)} reaches the wall",
            "Use --plate pegs",
        )
    outline, holes = _shape_plate(knots, feet, camera, to_wall, settings)
    moves = _measure_sag(knots, feet, camera, stiffness)
    sag, at = worst_of(moves, knots.points)
    # a body is joined to another over patches: its Euler characteristic is the sum less that of the patches
    handles = np.bincount(knot_of, [1 - foot.genus for foot in feet], len(tubes)).astype(int)
    plate = FootPlate(outline, holes, tuple(count.tolist()), tuple(handles.tolist()))
    return StandingPiece(plate=plate, sag_mm=sag, sag_at=at, moves=moves)


def ears_mm(settings: Mount) -> float:
    """Return how much wider, over both sides, the plate is for the ears that hold its screws."""
    return 2 * (settings.hole_diameter_mm + OFF_MM + RIM_MM)


def foot_plate_fixture(plate: FootPlate, camera: Camera, settings: Mount) -> Fixture:
    """Make the plate, its face on the receiver plane."""
    wall = np.column_stack(list(camera.wall_axes))
    places = np.concatenate([plate.holes, plate.outline]).ravel().tolist()
    sizes = (settings.thickness_mm, settings.hole_diameter_mm, *places)
    back = camera.middle - settings.thickness_mm * wall[:, 2]
    return Fixture("plate", outlined_plate, sizes, np.column_stack([wall, back]))


def _find_feet(tubes: list[Mesh], to_wall: Array, thickness_mm: float) -> list[_Foot]:
    """Find the pieces of tube below the wall's face (3, 4) that do not meet there."""
    found = []
    for number, tube in enumerate(tubes):
        below = as_manifold(tube).transform(to_wall).trim_by_plane((0.0, 0.0, -1.0), 0.0)
        for foot in below.decompose():
            x0, y0, z0, x1, y1, _ = foot.bounding_box()
            if -z0 > thickness_mm - LEAST_BACK_MM:
                raise SceneError(
                    "the wall's plate",
                    f"the tube reaches {-z0:.2f} mm behind its face, and it is {thickness_mm:g} mm thick",
                    "Use a thicker one (mount.plate_thickness_mm), or report this scene",
                )
            middle = np.array([x0 + x1, y0 + y1]) / 2
            found.append(_Foot(number, middle, float(np.hypot(x1 - x0, y1 - y0)) / 2, foot.genus()))
    return found


def _shape_plate(
    knots: Knots, feet: list[_Foot], camera: Camera, to_wall: Array, settings: Mount
) -> tuple[Array, Array]:
    """Shape the plate: its outline (n, 2), and the middles of its screw holes (2, 2)."""
    import shapely

    within = shapely.union_all([shapely.Point(f.middle).buffer(f.reach_mm + RIM_MM) for f in feet])
    if settings.plate == "full":
        across, up = camera.frame_mm
        body = shapely.box(-across / 2, -up / 2, across / 2, up / 2).union(within)
    else:
        shadow = _cast_tubes(knots, camera, to_wall)
        body = shadow.buffer(settings.plate_margin_mm + FILLET_MM).buffer(-FILLET_MM).union(within)
    sheet = _fill_holes(_bridge_islands(body))
    holes, ears = _find_holes(sheet, settings.hole_diameter_mm)
    sheet = _fill_holes(sheet.union(ears)).simplify(WITHIN_MM)
    outline = shapely.geometry.polygon.orient(sheet, 1.0)
    return np.array(outline.exterior.coords)[:-1], holes


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


def _measure_sag(
    knots: Knots, feet: list[_Foot], camera: Camera, stiffness: Stiffness
) -> NDArray[np.float64]:
    """Compute how far each vertex moves where those over each foot are held, (N, 3).

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
    return sag_moves(knots, sites, Candidates(first, ground, start, end, radius), stiffness)
