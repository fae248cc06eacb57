"""Read scene.toml as a validator sees it: the numbers that a finished part is measured against."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from knotfab_validators.files.bad_file import BadFile, read_bytes, short
from knotfab_validators.files.bent import Bend, read_bend
from knotfab_validators.files.lamps import Lamps, Room, read_lamps, read_room, share_walls
from knotfab_validators.files.picture import Reading
from knotfab_validators.files.region import read_region_mesh
from knotfab_validators.files.table import Table, Vector
from knotfab_validators.geometry.mesh import Mesh

__all__ = [
    "Accuracy",
    "Effects",
    "Lamps",
    "Material",
    "Mount",
    "Piece",
    "Placing",
    "Pose",
    "Printer",
    "Region",
    "Scene",
    "View",
    "parse_scene",
    "read_scene",
]

Pose = tuple[tuple[float, ...], ...]  # 4 rows of 4


DEFAULT_PRINTER = "prusa-mk4"
MOST_BYTES = 1_000_000
MOST_DOTS = 200
LAMPS = ("disc", "ball", "rectangle", "leds")
MOST_LEDS = 100  # across or up
MOST_IN_ARRAY = 400  # for each is a shadow to render
SWITCH = ("auto", "on", "off")
INKS = ("auto", "dark", "light", "alpha", "flood")
QUOTED_KEY = re.compile(r"[\"']\s*\.")


@dataclass(frozen=True)
class Piece:
    """`tube_radius_mm` is None where the scene leaves it open ("auto").

    `knot` is the type that one of the knots must have, and all others are unknots; None where the scene
    has no such key: it promises nothing then. `printed` is None where the scene does not say.
    """

    tube_radius_mm: float | None
    clearance_mm: float
    printed: bool | None = None
    knot: str | None = None
    knots: int | None = None


@dataclass(frozen=True)
class Region:
    """What the tube must stay inside, scene coordinates; `size_mm` None: left open.

    Of the kind "mesh" its `surface` is closed, in mm, and yet to be moved by `center_mm`; None where
    the scene was read without the folder that it lies in.
    """

    kind: str
    center_mm: Vector
    size_mm: Vector | None
    surface: Mesh | None = None
    azimuth_deg: float = 0.0  # it is turned about its middle, as a view of these angles is
    elevation_deg: float = 0.0


@dataclass(frozen=True)
class Material:
    """`min_bend_radius_mm` None: the tube's radius plus half the clearance."""

    name: str
    density_g_cm3: float
    min_bend_radius_mm: float | None
    max_length_mm: float
    wire_diameter_mm: float = 0.0
    tool_radius_mm: float = 0.0
    min_straight_mm: float = 0.0
    max_bend_deg: float = 175.0
    springback_percent: float = 0.0
    young_modulus_mpa: float = 2300.0
    yield_mpa: float = 50.0
    shrinkage_percent: float = 0.0

    @property
    def shrinks_to(self) -> float:
        """The share of every length that is left of what is printed."""
        return 1 - self.shrinkage_percent / 100


@dataclass(frozen=True)
class Printer:
    """What the part must fit, and how it is printed.

    `build_volume_mm` and `nozzle_mm` are None where the scene only names a printer, whose data the
    maker keeps; `min_wall_mm`, `min_gap_mm` None: the nozzle's width; `max_support_cm3` None: no limit.
    """

    name: str
    build_volume_mm: Vector | None
    nozzle_mm: float | None = None
    process: str = "filament"
    min_wall_mm: float | None = None
    min_gap_mm: float | None = None
    layer_height_mm: float = 0.2
    supports: bool = True
    max_overhang_deg: float = 45.0
    max_bridge_mm: float = 10.0
    max_support_cm3: float | None = None


@dataclass(frozen=True)
class View:
    """A light or an eye and its picture; a frame's side is None where the picture decides it."""

    name: str
    kind: str
    picture: str
    reading: Reading
    bend: Bend | None  # how the picture is changed before it is drawn
    thicken_mm: float | None  # width on the receiver of strokes that are thinner
    tone: str  # "lines": its greys are drawn, by lines of that width; else "off"
    frame_width_mm: float | None
    frame_height_mm: float | None
    light_distance_mm: float
    light_diameter_mm: float
    light_shape: str
    light_width_mm: float
    light_height_mm: float
    light_leds: tuple[int, int]
    wall_distance_mm: float
    wall_tilt_deg: float
    wall_radius_mm: float | str  # "flat", or of a cylinder: positive is hollow, negative a column
    azimuth_deg: float
    elevation_deg: float
    frame_up_mm: float
    light_right_mm: float = 0.0  # of the lamp, beside the view's axis, and above it
    light_up_mm: float = 0.0
    wall: str = ""  # the name of the view whose wall this one shares
    lamp_colour: Vector = (1.0, 1.0, 1.0)  # linear red, green and blue


@dataclass(frozen=True)
class Accuracy:
    """What the shadow must reach; `iou_floor` None: no floor is given.

    `accept`: what is kept though it would be rejected: "unrecognisable".
    """

    name: str
    iou_floor: float | None
    max_outline_error_px: float
    accept: tuple[str, ...] = ()


@dataclass(frozen=True)
class Effects:
    """Whether effects are simulated: "on", "off", or "auto", where they exceed a threshold, px."""

    penumbra: str = "auto"
    tolerance_px: float = 0.25
    misplacement: str = "auto"
    layers: str = "auto"
    wall: str = "auto"


@dataclass(frozen=True)
class Placing:
    """How far off people place lamp (or eye), piece and wall."""

    lamp_mm: float = 5.0
    turn_deg: float = 1.0
    tilt_deg: float = 0.0


@dataclass(frozen=True)
class Mount:
    """What holds the piece; `pegs` says how many hold each knot, where the scene says it.

    `thread_mm` is where the thread carries a piece that hangs, in the scene.
    """

    kind: str
    foot: str
    pegs: tuple[int, ...]
    thread_mm: Vector | None = None


@dataclass(frozen=True)
class Scene:
    """One scene; `pose` (4 x 4 rows), rigid, takes the part once it has shrunk to the scene, None: absent.

    `plates`: where the part is printed in several pieces, for each plate its file beside the scene and the
    motions (4 x 4 rows) that take its bodies to the part.
    """

    piece: Piece
    region: Region
    material: Material
    printer: Printer
    views: tuple[View, ...]
    accuracy: Accuracy
    mount: Mount
    pose: Pose | None
    plates: tuple[tuple[str, tuple[Pose, ...]], ...] = ()
    effects: Effects = Effects()
    placing: Placing = Placing()
    lamps: Lamps | None = None  # where several light one wall
    room: Room = field(default_factory=Room)

    @property
    def screen_ends(self) -> bool:
        """Whether shadows beside the frame fall on no screen."""
        return self.lamps is not None and self.lamps.screen == "ends"


def read_scene(path: Path) -> Scene:
    """The scene of a scene.toml of schema 1; keys that are absent have their documented defaults.

    Raises:
        BadFile: the file cannot be read, or a key has an impossible value.
    """
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
        _require_short_keys(text, path.name)
        data = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise BadFile(f"{path.name}: is not UTF-8 text ({error})") from error
    except (ValueError, RecursionError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"{path.name}: is not TOML ({str(error)[:200]})") from error
    return parse_scene(data, path.name, path.parent)


def _require_short_keys(text: str, name: str) -> None:
    """tomllib's time grows with the square of a dotted key's length, quoted or not."""
    longest = max(part.count(".") for part in re.split(r"[,\n]", text))
    if longest > MOST_DOTS or len(QUOTED_KEY.findall(text)) > MOST_DOTS:
        raise BadFile(f"{name}: has a key of more than {MOST_DOTS} words")


def parse_scene(
    data: dict[str, Any], name: str = "scene.toml", folder: Path | None = None
) -> Scene:
    """The scene in the parsed content of a scene.toml; raises BadFile as `read_scene` does.

    Args:
        folder: where the mesh of a region lies; None: it is not read.
    """
    if data.get("schema", 1) != 1:
        raise BadFile(f"{name}: schema is {short(data['schema'])}, only 1 is known")
    piece = Table(data.get("piece", {}), f"{name}: [piece]")
    region = Table(data.get("region", {}), f"{name}: [region]")
    material = Table(data.get("material", {}), f"{name}: [material]")
    printer = Table(data.get("printer", {}), f"{name}: [printer]")
    accuracy = Table(data.get("accuracy", {}), f"{name}: [accuracy]")
    effects = Table(data.get("effects", {}), f"{name}: [effects]")
    placing = Table(data.get("placing", {}), f"{name}: [placing]")
    search = Table(data.get("search", {}), f"{name}: [search]")
    views = data.get("views", [{}])
    if not isinstance(views, list) or not views:
        raise BadFile(f"{name}: [[views]] must name at least one view")
    views = share_walls(views, name)
    shrinkage = material.number("shrinkage_percent", 0.0, least=0, most=20)
    return Scene(
        piece=Piece(
            tube_radius_mm=piece.open_number("tube_radius_mm", None, above=0),
            clearance_mm=piece.number("clearance_mm", 0.4, least=0),
            printed=piece.flag("printed", False) if "printed" in piece.data else None,
            knot=piece.word("knot", "") if "knot" in piece.data else None,
            knots=_whole_of(piece.data.get("knots")),
        ),
        region=_region(region, folder),
        material=Material(
            name=material.word("name", "pla"),
            density_g_cm3=material.number("density_g_cm3", 1.24, above=0),
            min_bend_radius_mm=material.open_number("min_bend_radius_mm", None, least=0),
            max_length_mm=material.number("max_length_mm", 50000.0, above=0),
            wire_diameter_mm=material.number("wire_diameter_mm", 0.0, least=0),
            tool_radius_mm=material.number("tool_radius_mm", 0.0, least=0),
            min_straight_mm=material.number("min_straight_mm", 0.0, least=0),
            max_bend_deg=material.number("max_bend_deg", 175.0, above=0, most=175),
            springback_percent=material.number("springback_percent", 0.0, least=0),
            young_modulus_mpa=material.number("young_modulus_mpa", 2300.0, above=0),
            yield_mpa=material.number("yield_mpa", 50.0, above=0),
            shrinkage_percent=shrinkage,
        ),
        printer=_printer(printer),
        views=tuple(_view(v, f"{name}: view {i}") for i, v in enumerate(views)),
        accuracy=Accuracy(
            name=accuracy.word("name", "standard"),
            iou_floor=accuracy.open_number("iou_floor", 0.96, least=0),
            max_outline_error_px=accuracy.open_number("max_outline_error_px", 0.5, above=0) or 0.5,
            accept=accuracy.words("accept", ("unrecognisable",)),
        ),
        mount=_mount(data.get("mount", {}), f"{name}: [mount]"),
        pose=_pose(data.get("pose"), name, 1 - shrinkage / 100),
        plates=_plates(data.get("pose"), name),
        effects=Effects(
            penumbra=effects.word("penumbra", "auto", SWITCH),
            misplacement=effects.word("misplacement", "auto", SWITCH),
            layers=effects.word("layers", "auto", SWITCH),
            wall=effects.word("wall", "auto", SWITCH),
            tolerance_px=search.number("tolerance_px", 0.25, above=0),
        ),
        placing=Placing(
            lamp_mm=placing.number("lamp_mm", 5.0, least=0),
            turn_deg=placing.number("turn_deg", 1.0, least=0, most=10),
            tilt_deg=placing.number("tilt_deg", 0.0, least=0, most=10),
        ),
        lamps=read_lamps(data, name),
        room=read_room(data, name),
    )


def _whole_of(value: object) -> int | None:
    """A count that the scene settles; None where it is left open."""
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _region(table: Table, folder: Path | None) -> Region:
    kind = table.word("kind", "box", ("box", "cylinder", "sphere", "mesh"))
    if ("file" in table.data) != (kind == "mesh"):
        raise BadFile(f"{table.where} file goes with kind mesh, and with no other kind")
    surface = None
    if kind == "mesh" and folder is not None:
        surface = read_region_mesh(folder / table.word("file", ""), f"{table.where} file")
    return Region(
        kind=kind,
        center_mm=table.vector("center_mm", (0.0, 0.0, 0.0)) or (0.0, 0.0, 0.0),
        size_mm=table.vector("size_mm", (240.0, 240.0, 180.0), above=0),
        azimuth_deg=table.number("azimuth_deg", 0.0),
        elevation_deg=table.number("elevation_deg", 0.0, least=-90, most=90),
        surface=surface,
    )


def _printer(table: Table) -> Printer:
    """Of the scene, or the default one; where only another one's name is given, its size is open."""
    name = table.word("name", DEFAULT_PRINTER)
    known = name == DEFAULT_PRINTER
    volume = (
        table.fixed_vector("build_volume_mm", (250.0, 210.0, 220.0))
        if known or "build_volume_mm" in table.data
        else None
    )
    nozzle = table.number("nozzle_mm", 0.4, above=0) if known or "nozzle_mm" in table.data else None
    return Printer(
        name=name,
        build_volume_mm=volume,
        nozzle_mm=nozzle,
        process=table.word("process", "filament", ("filament", "resin", "powder")),
        min_wall_mm=table.open_number("min_wall_mm", None, above=0),
        min_gap_mm=table.open_number("min_gap_mm", None, above=0),
        layer_height_mm=table.number("layer_height_mm", 0.2, above=0),
        supports=table.flag("supports", True),
        max_overhang_deg=table.number("max_overhang_deg", 45.0, least=0, most=90),
        max_bridge_mm=table.number("max_bridge_mm", 10.0, least=0),
        max_support_cm3=table.open_number("max_support_cm3", None, least=0),
    )


def _mount(data: Any, where: str) -> Mount:
    table = Table(data, where)
    pegs = data.get("pegs", []) if isinstance(data, dict) else []
    if not isinstance(pegs, list) or not all(type(n) is int and n > 0 for n in pegs):
        raise BadFile(f"{where} pegs must be whole numbers above 0, got {pegs!r}")
    return Mount(
        kind=table.word("kind", "none", ("none", "wall", "stand", "hang", "auto")).replace(
            "auto", "none"
        ),
        foot=table.word("foot", "auto", ("auto", "plate", "dowel")),
        pegs=tuple(pegs),
        thread_mm=None
        if table.data.get("thread_mm", "none") == "none"
        else table.fixed_vector("thread_mm", (0.0, 0.0, 0.0)),
    )


def _reading(table: Table, where: str) -> Reading:
    """How a view's picture is read."""
    crop = table.data.get("crop_px", "none")
    if crop == "auto":
        raise BadFile(f'{where} crop_px is "auto"; a scene that a build wrote has numbers')
    if crop != "none" and not (
        isinstance(crop, list)
        and len(crop) == 4
        and all(type(n) is int and n >= 0 for n in crop)
        and min(crop[2:]) > 0
    ):
        raise BadFile(f"{where} crop_px must be left, top, width and height, got {short(crop)}")
    mask = table.word("subject_mask", "")
    if table.data.get("subject_px", "none") != "none" and not mask:
        raise BadFile(
            f"{where} subject_px names a rectangle; a scene that a build wrote names a subject_mask"
        )
    ink = table.word("ink", "auto")
    if ink not in INKS and not re.fullmatch(r"#[0-9a-fA-F]{6}", ink):
        raise BadFile(f"{where} ink must be one of {', '.join(INKS)} or #rrggbb, got {short(ink)}")
    return Reading(
        ink=ink,
        threshold=table.number("threshold", 0.5, above=0, most=1.0),
        invert=table.flag("invert", False),
        crop_px=None if crop == "none" else tuple(crop),
        keep_largest=int(table.number("keep_largest", 0, least=0)),
        speck_px=int(table.number("speck_px", 0, least=0)),
        subject_mask=mask,
    )


def _view(data: Any, where: str) -> View:
    table = Table(data, where)
    return View(
        name=table.word("name", "front"),
        kind=table.word("kind", "shadow", ("shadow", "eye")),
        picture=table.word("picture", ""),
        reading=_reading(table, where),
        bend=read_bend(table.data, where),
        thicken_mm=None
        if data.get("thicken_mm", "none") == "none"
        else table.open_number("thicken_mm", None, above=0),
        tone=table.word("tone", "off", ("off", "lines")),
        frame_width_mm=table.open_number("frame_width_mm", None, above=0),
        frame_height_mm=table.open_number("frame_height_mm", None, above=0),
        light_distance_mm=table.number("light_distance_mm", 500.0, above=0),
        light_diameter_mm=table.number("light_diameter_mm", 5.0, least=0),
        light_shape=table.word("light_shape", "disc", LAMPS),
        light_width_mm=table.number("light_width_mm", 0.0, least=0),
        light_height_mm=table.number("light_height_mm", 0.0, least=0),
        light_leds=_leds(table),
        wall_distance_mm=table.number("wall_distance_mm", 100.0, above=0),
        wall_tilt_deg=table.number("wall_tilt_deg", 0.0),
        wall_radius_mm=_wall_radius(table),
        azimuth_deg=table.number("azimuth_deg", 0.0),
        elevation_deg=table.number("elevation_deg", 0.0),
        frame_up_mm=table.number("frame_up_mm", 0.0),
        light_right_mm=table.number("light_right_mm", 0.0),
        light_up_mm=table.number("light_up_mm", 0.0),
        wall=table.word("wall", ""),
        lamp_colour=_lamp_colour(table),
    )


def _lamp_colour(table: Table) -> Vector:
    """Linear red, green and blue; white where the view names none."""
    if "lamp_colour" not in table.data:
        return 1.0, 1.0, 1.0
    red, green, blue = table.numbers("lamp_colour", 3, least=0, most=1)
    if red == green == blue == 0:
        raise BadFile(f"{table.where} lamp_colour is black, which lights nothing")
    return red, green, blue


def _wall_radius(table: Table) -> float | str:
    """Of a wall that is a cylinder, or "flat"."""
    if table.data.get("wall_radius_mm", "flat") == "flat":
        return "flat"
    radius = table.number("wall_radius_mm", 0.0)
    if radius == 0:
        raise BadFile(f"{table.where} wall_radius_mm is 0")
    return radius


def _leds(table: Table) -> tuple[int, int]:
    """Columns and rows of an array of LEDs."""
    value = table.data.get("light_leds", [1, 1])
    whole = isinstance(value, list) and all(type(n) is int and 1 <= n <= MOST_LEDS for n in value)
    if not whole or len(value) != 2:
        raise BadFile(f"{table.where} light_leds must be two numbers from 1 to {MOST_LEDS}")
    if value[0] * value[1] > MOST_IN_ARRAY:
        raise BadFile(
            f"{table.where} light_leds are {value[0] * value[1]} LEDs, more than {MOST_IN_ARRAY}"
        )
    return value[0], value[1]


def _pose(data: Any, name: str, shrinks_to: float) -> Pose | None:
    """The rigid motion in [pose], less what the material shrinks; None without one."""
    if data is None:
        return None
    rows = data.get("matrix") if isinstance(data, dict) else None
    return _motion(rows, f"{name}: [pose] matrix", shrinks_to)


def _plates(data: Any, name: str) -> tuple[tuple[str, tuple[Pose, ...]], ...]:
    """The file of each plate, and the motions of its bodies."""
    tables = data.get("plates", []) if isinstance(data, dict) else []
    where = f"{name}: [pose] plates"
    found = []
    for number, table in enumerate(tables if isinstance(tables, list) else [None], start=1):
        rows = table.get("matrices") if isinstance(table, dict) else None
        if not isinstance(rows, list) or not rows:
            raise BadFile(f"{where} must be tables, each with the matrices of its bodies")
        file = Table(table, where).word("file", "") or f"plate-{number}.3mf"
        if PurePath(file).name != file:
            raise BadFile(f"{where}: {short(file)} is not the name of a file beside the scene")
        found.append((file, tuple(_motion(one, f"{where}: a matrix") for one in rows)))
    return tuple(found)


def _motion(rows: Any, what: str, scale: float = 1.0) -> Pose:
    """The rigid motion in one that scales so much besides, given as 4 rows of 4 numbers."""
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadFile(f"{what} must be 4 rows of 4 numbers") from error
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise BadFile(f"{what} must be 4 rows of 4 numbers")
    if scale != 1.0:
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
    return tuple(tuple(float(x) for x in row) for row in matrix)
