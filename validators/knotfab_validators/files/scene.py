"""Read scene.toml and knots.json as a validator sees them, with the files beside the scene."""

from __future__ import annotations

import json
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from pydantic import PrivateAttr

from knotfab_formats.bounds import Matrix
from knotfab_formats.errors import InputError, short
from knotfab_formats.piece import FramePlate, Pose
from knotfab_formats.read import parse_toml, scene_of
from knotfab_formats.scene import Scene as AskedScene
from knotfab_validators.arrays import Array
from knotfab_validators.check import BadFile, read_bytes
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.curves import Bar, Curves, Member, Slab, edges_of
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.surface import survey

MOST_BYTES = 1_000_000
# defaults of keys that a scene may leave out (a build writes both)
FLOOR = 0.96  # the IoU that a shadow must reach
ROOM = (240.0, 240.0, 180.0)  # size of the region, mm


class Scene(AskedScene):
    """One scene; its pose is the rigid motion that takes the part, once it has shrunk, to the scene."""

    _surface: Mesh | None = PrivateAttr(None)

    @property
    def surface(self) -> Mesh | None:
        """The region's closed mesh, mm, before it is moved by `center_mm`; None for other regions."""
        return self._surface

    @property
    def promised(self) -> str | None:
        """The type that one of the knots must have, all others being unknots; None if nothing is promised."""
        return self.piece.knot if "knot" in self.piece.model_fields_set else None

    @property
    def unprinted(self) -> bool:
        """True if the scene says that the piece is not to be printed."""
        return "printed" in self.piece.model_fields_set and not self.piece.printed

    @property
    def iou_floor(self) -> float | None:
        """The IoU that the shadow must reach; None where the scene leaves it open."""
        if "iou_floor" not in self.accuracy.model_fields_set:
            return FLOOR
        return self.accuracy.iou_floor

    @property
    def outline_px(self) -> float:
        """The largest error of the shadow's outline that is accepted, px."""
        return self.accuracy.max_outline_error_px or self.settings.outline_px


def read_scene(path: Path) -> Scene:
    """Read a scene.toml of schema 1; absent keys take their documented defaults.

    Raises:
        BadFile: the file cannot be read, or a key has an impossible value.
    """
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
        raw = parse_toml(text, path.name)
    except UnicodeDecodeError as error:
        raise BadFile(f"{path.name}: is not UTF-8 text ({error})") from error
    except InputError as error:
        raise BadFile(f"{path.name}: {error.why[:200]}") from error
    return parse_scene(raw, path.name, path.parent)


def parse_scene(
    data: dict[str, Any], name: str = "scene.toml", folder: Path | None = None
) -> Scene:
    """Build the scene from the parsed content of a scene.toml.

    Args:
        folder: where the mesh of a region lies; None: it is not read.

    Raises:
        BadFile: as `read_scene`.
    """
    try:
        scene = scene_of(data, name, Scene)
        _ = scene.settings
    except InputError as error:
        about = "" if error.what == name else f"{error.what}: "
        raise BadFile(f"{name}: {about}{error.why}") from error
    for view in scene.views:
        if view != view.as_written():
            raise BadFile(
                f"{name}: view {view.name} says how to read its picture: written by knotfab 1.x: build it "
                "again with --scene"
            )
    region, update = scene.region, dict[str, Any]()
    if (region.file is not None) != (region.kind == "mesh"):
        raise BadFile(f"{name}: [region] file goes with kind mesh, and with no other kind")
    if region.kind != "mesh" and "size_mm" not in region.model_fields_set:
        update["region"] = region.but(size_mm=ROOM)
    if scene.mount.kind == "auto":
        update["mount"] = scene.mount.but(kind="none")
    if scene.pose is not None:
        update["pose"] = _read_pose(scene.pose, name, scene.material.shrinks_to)
    if scene.lamps.table:
        where = f"{name}: [lamps] table"
        table = _read_plates(scene.lamps.table, where)
        for bar in (bar for plate in table for bar in plate.bars):
            _require_motion(bar.matrix, f"{where}: the matrix of a bar")
        update["lamps"] = scene.lamps.but(table=table)
    scene = scene.but(**update)
    if folder is not None and region.file is not None:
        scene._surface = read_region_mesh(folder / region.file, f"{name}: [region] file")
    return scene


def _read_pose(pose: Pose, name: str, shrinks_to: float) -> Pose:
    """Take the shrinkage out of the pose."""
    matrix = _require_motion(pose.matrix, f"{name}: [pose] matrix", shrinks_to)
    return Pose.model_construct(matrix=matrix)


def _read_plates(plates: tuple[FramePlate, ...], where: str) -> tuple[FramePlate, ...]:
    """Return the plates with rigid motions, and with file names beside the scene."""
    found = []
    for number, plate in enumerate(plates, start=1):
        file = plate.file or f"table-{number}.3mf"
        if PurePath(file).name != file:
            raise BadFile(f"{where}: {short(file)} is not the name of a file beside the scene")
        motions = tuple(_require_motion(one, f"{where}: a matrix") for one in plate.matrices)
        found.append(plate.but(file=file, matrices=motions))
    return tuple(found)


def _require_motion(rows: Matrix, what: str, scale: float = 1.0) -> Matrix:
    """Check that 4 x 4 rows are a rigid motion times `scale`, and return that motion."""
    matrix = np.array(rows, dtype=np.float64)
    matrix[:3, :3] /= scale
    turn = matrix[:3, :3]
    rigid = (
        np.abs(turn @ turn.T - np.eye(3)).max() < 1e-6
        and np.linalg.det(turn) > 0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    )
    if not rigid:
        besides = "" if scale == 1.0 else f" that shrinks the part to {scale:g} of its size"
        raise BadFile(f"{what} is not a rigid motion{besides}")
    a, b, c, d = ((*(float(x) for x in row),) for row in matrix)
    return a, b, c, d  # type: ignore[return-value]


def read_region_mesh(path: Path, where: str) -> Mesh:
    """Read the closed mesh of an STL file, in mm.

    Args:
        where: how an error names the key of the scene.

    Raises:
        BadFile: it cannot be read, has a hole or faces wound against each other, or is inside out.
    """
    try:
        mesh = read_mesh(path)
    except BadFile as error:
        raise BadFile(f"{where}: {error}") from error
    found = survey(mesh)
    if not found.closed:
        edges = len(found.open_edges) + len(found.flipped_edges)
        raise BadFile(f"{where}: {path.name} is not a closed surface ({edges} edges are not right)")
    if not found.volumes_mm3.sum() > 0:
        raise BadFile(f"{where}: {path.name} encloses nothing, or is turned inside out")
    return mesh


# Read knots.json: centre lines as polygons, validated before anything is measured on them.

UNIT = 1e-6  # tolerance of a unit vector's length
MOST_KNOTS_BYTES = 24_000_000  # some 400,000 points; Python holds `[],` in thirty times its bytes


def read_knots(path: Path) -> Curves:
    """Read the curves of a knots.json of schema 1.

    Raises:
        BadFile: the file cannot be read, or is not such a file: the message names the knot and the
            point.
    """
    content = read_bytes(path, MOST_KNOTS_BYTES)
    try:
        data = json.loads(content.decode("utf-8-sig"), object_pairs_hook=_require_once)
    except UnicodeDecodeError as error:
        raise BadFile(f"{path.name}: is not UTF-8 text ({error})") from error
    except _RepeatedKey as error:
        raise BadFile(f"{path.name}: {error}") from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise BadFile(f"{path.name}: is not JSON ({short(error)})") from error
    return parse_knots(data, path.name)


def parse_knots(data: Any, name: str = "knots.json") -> Curves:
    """Build the curves from the parsed content of a knots.json; raises BadFile as `read_knots` does."""
    from pydantic import ValidationError

    from knotfab_formats.knots import KnotsFile, why_no_knots

    try:
        said = KnotsFile.model_validate(data)
    except ValidationError as error:
        raise BadFile(f"{name}: {why_no_knots(error)}") from error
    return Curves(
        polygons=tuple(_polygon(knot, f"{name}: knot {i}") for i, knot in enumerate(said.knots)),
        types=tuple(knot.promise for knot in said.knots),
        closed=tuple(knot.closed for knot in said.knots),
        radius_mm=said.radius_mm,
        members=tuple(
            _member(m, f"{name}: members: number {i}") for i, m in enumerate(said.members)
        ),
        plate=None if said.plate is None else _read_slab(said.plate, f"{name}: plate"),
        bars=tuple(
            Bar(np.array(b.start), np.array(b.end), b.width_mm, b.height_mm) for b in said.bars
        ),
        cut_mm=0.0 if said.feet is None else said.feet.cut_mm,
        rods=tuple(_read_rod(rod, f"{name}: rods: number {i}") for i, rod in enumerate(said.rods)),
        hulls=tuple(
            _read_hull(hull, f"{name}: hulls: number {i}") for i, hull in enumerate(said.hulls)
        ),
        stated=all(knot.type for knot in said.knots if knot.closed),
    )


# share of a usual edge below which a closing edge is the rounding of a repeated point
ROUNDED = 1e-6


class _RepeatedKey(ValueError):
    """A JSON key occurs twice: readers disagree about which one counts."""


def _require_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _RepeatedKey(f"has the key {short(twice)} twice")
    return found


def _polygon(knot: Any, where: str) -> Array:
    points, closed = np.array(knot.points, dtype=np.float64), knot.closed
    least = 3 if closed else 2
    if len(points) < least:
        raise BadFile(f"{where}: needs at least {least} points [x, y, z], got {len(points)}")
    edges = edges_of([points], [closed])
    length = np.linalg.norm(edges.end - edges.start, axis=1)
    # a curve drawn from 0 to 2 pi ends where it began, but for rounding
    rounded = closed and length[-1] < ROUNDED * np.median(length)
    if rounded or not length.min() > 0:
        i = int(length.argmin())
        why = " (the last point joins the first, it must not be repeated)" if closed else ""
        raise BadFile(f"{where}: points {i} and {(i + 1) % len(points)} coincide{why}")
    return points


def _member(said: Any, where: str) -> Member:
    start, end = np.array(said.start), np.array(said.end)
    foot = None if said.foot is None else np.array(said.foot)
    if foot is not None and abs(float(np.linalg.norm(foot)) - 1) > UNIT:
        raise BadFile(f"{where} foot must be a vector of length 1")
    if not np.linalg.norm(end - start) > 0:
        raise BadFile(f"{where} begins where it ends")
    return Member(start, end, said.radius_mm, foot)


def _read_rod(said: Any, where: str) -> Member:
    start, end = np.array(said.start), np.array(said.end)
    if not np.linalg.norm(end - start) > 0:
        raise BadFile(f"{where} begins where it ends")
    return Member(start, end, (said.radius_mm, said.radius_mm))


def _read_hull(said: Any, where: str) -> tuple[str, Array]:
    corners = np.array(said.corners, dtype=np.float64)
    if np.linalg.matrix_rank(corners - corners[0], tol=1e-6) < 3:
        raise BadFile(f"{where}: its corners enclose nothing")
    return short(said.name), corners


def _read_slab(said: Any, where: str) -> Slab:
    outline, out = np.array(said.outline), np.array(said.out)
    if abs(float(np.linalg.norm(out)) - 1) > UNIT:
        raise BadFile(f"{where} out must be a vector of length 1")
    openings = tuple(np.array(opening) for opening in said.openings)
    height = np.concatenate([outline, *openings]) @ out
    if np.ptp(height) > UNIT * max(1.0, float(np.abs(outline).max())):
        raise BadFile(f"{where} outline must lie in one plane, square to out")
    holes = np.array(said.holes).reshape(-1, 3)
    return Slab(outline, holes, said.hole_mm, said.thickness_mm, out, openings)
