"""The tables of scene.toml that say what is made: tube, region, material, printer, mount, pose."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    Strict,
    StrictStr,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from knotfab_formats.bounds import (
    MOST_MM,
    Amount,
    Angle,
    Auto,
    Coordinate,
    Count,
    Density,
    Extent,
    Length,
    Matrix,
    Modulus,
    Pixels,
    Spread,
    TubeLength,
    Turn,
    Vector,
    Volume,
    Whole,
    Word,
    as_written,
    option,
)


class Table(BaseModel):
    """A table of scene.toml."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_serializer(mode="wrap")
    def _write_words(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write values back as the words that they were read from."""
        keys: dict[str, Any] = write(self)
        own = type(self).model_fields
        return {k: as_written(type(self), k, v) if k in own else v for k, v in keys.items()}

    def but(self, **keys: Any) -> Self:
        """Copy the table with some keys changed; the new values are not validated."""
        return self.model_copy(update=keys)


def _one_line(text: str) -> str:
    """Require a line that a file's metadata can hold."""
    if not text.isprintable():
        raise PydanticCustomError("line", "one line of signs that can be printed")
    return text


Line = Annotated[str, Strict(), Field(max_length=200), AfterValidator(_one_line)]
Color = Annotated[str, Strict(), Field(pattern=r"^#[0-9a-fA-F]{6}$")]
MOST_BEND = 0.3  # share of a picture's height: the largest limit on a point's displacement
Bend = Annotated[float, Strict(), Field(gt=0, le=MOST_BEND)]


class Piece(Table):
    """The tube to make."""

    tube_radius_mm: Length | Auto = option(None, "Piece --tube-radius")
    """The tube's radius in mm, or auto (default): that of the thickest tube that draws the picture
    well."""
    knots: Count | Auto = option(None, "Piece --knots")
    """auto (default): one knot for each piece of the picture; N: its pieces bridged into N
    knots."""
    knots_asked: Annotated[bool, Strict()] = True
    """false: a build chose the number of knots, and nobody asked for the bridges between pieces,
    which count as losses."""
    depth: Length | Auto | Annotated[float, Word("flat", 0.0)] = option(None, "Piece --depth")
    """The piece's extent along the view: mm, auto (default: unreadable from elsewhere), or flat."""
    clearance_mm: Spread = 0.4
    """The least gap between strands."""
    printed: Annotated[bool, Strict()] = False
    """true: posed and checked for the printer, with its mount (--print)."""
    supports: Literal["auto", "none", "slicer"] = option("auto", "Print --supports")
    """none: strands stand on the bed in steep arches, so that the piece prints with supports off;
    slicer: they run as they look best, and the slicer supports them; auto (default): none where
    every check passes."""
    max_hours: Amount | Auto = option(None, "Print --max-hours")
    """The longest that it may print; auto (default): as long as it takes."""
    max_grams: Amount | Auto = option(None, "Print --max-grams")
    """The most filament that it may take, supports included; auto (default): as much as it takes."""
    bend: Bend | Auto | Annotated[float, Word("off", 0.0)] = option(None, "Piece --bend")
    """Bend several pictures until they agree: auto (default), off, or the most that a point may
    move, as a share of the picture's height, such as 0.05."""
    mirror: Literal["auto", "off"] = option("off", "Piece --mirror")
    """auto: mirror pictures, but no text, where that makes them agree and the scene fixes their
    views; off (default)."""
    knot: StrictStr = option("unknot", "Piece --knot")
    """The knot type to tie: unknot (default), trefoil, "left trefoil", figure-eight, any of the
    table up to 8 crossings (5_2, 8_19), or a sum (3_1#4_1)."""

    @property
    def asks_for_bridges(self) -> bool:
        """True if somebody said how many knots the pieces are to be bridged into."""
        return self.knots is not None and self.knots_asked


class Region(Table):
    """The region that must hold the whole tube (scene coordinates).

    It is turned about its middle as a view of the same angles is; with an auto size and one view, these are
    the view's.
    """

    kind: Literal["box", "cylinder", "sphere", "mesh"] = "box"
    """A cylinder's axis is y; "mesh" is a closed STL."""
    file: StrictStr | None = None
    """For kind "mesh": the STL beside the scene, in mm, moved by center_mm; a build writes
    region.stl."""
    center_mm: Vector = (0.0, 0.0, 0.0)
    """The middle of the region, in the scene."""
    size_mm: Extent | Auto = None
    """Box: full extents; cylinder: [diameter, height, diameter]; sphere: three times the diameter;
    mesh: ignored."""
    azimuth_deg: Turn = 0.0
    """The azimuth to which the region is turned about its middle, as for a view; with an auto size
    and a single view, that view's."""
    elevation_deg: Angle = 0.0
    """The elevation to which it is turned, as for azimuth_deg."""


class Material(Table):
    """The tube's material, and how it is shaped; named materials are data files."""

    name: StrictStr = "pla"
    """The name of a data file with the other figures; keys given here override them."""
    process: Literal["filament", "resin", "powder"] = "filament"
    """How the tube is made of it."""
    density_g_cm3: Density = 1.24
    """Density of the material."""
    min_bend_radius_mm: Length | Auto = None
    """The least radius of curvature of the centre line; auto: the tube's radius plus half the
    clearance."""
    max_length_mm: TubeLength = 50000.0
    """The greatest length of all centre lines together."""
    young_modulus_mpa: Modulus = 2300.0
    """Young's modulus, its stiffness."""
    yield_mpa: Modulus = 50.0
    """Yield strength: the stress from which a bend stays."""
    shrinkage_percent: Annotated[float, Strict(), Field(ge=0, lt=20)] = 0.0
    """Shrinkage of every length after printing, for which all files are written larger; 0: the
    slicer or the print service sees to it."""
    color: Color = "#d9d4c7"
    """Colour (sRGB) of the first body in part-colours.3mf."""

    @property
    def shrinks_to(self) -> float:
        """The share of every length that is left after the printed part has shrunk."""
        return 1 - self.shrinkage_percent / 100


class Printer(Table):
    """The printer; named printers are data files."""

    name: StrictStr = "prusa-mk4"
    """The name of a data file with the other figures; keys given here override them. Validators
    know only what the scene gives."""
    process: Literal["filament", "resin", "powder"] = "filament"
    """How it prints; powder carries the part, which needs no supports then."""
    build_volume_mm: Extent = (250.0, 210.0, 220.0)
    """The largest part that fits: width, depth, height."""
    nozzle_mm: Length = 0.4
    """Width of a printed line."""
    min_wall_mm: Length | Auto = None
    """The thinnest wall that may be printed; auto: the nozzle."""
    min_gap_mm: Length | Auto = None
    """The thinnest gap; auto: the nozzle. In powder, the gap out of which powder can be blown;
    clearance_mm is at least this unless it is given."""
    min_tube_radius_mm: Length = 0.8
    """Radius of the thinnest tube that it prints."""
    layer_height_mm: Length = 0.2
    """Height of a layer."""
    supports: Annotated[bool, Strict()] = True
    """Supports are printed where needed; false: the part must print without any."""
    max_overhang_deg: Annotated[float, Strict(), Field(ge=0, le=90)] = 45.0
    """The angle from the vertical (90: a ceiling) beyond which an underside needs support."""
    max_bridge_mm: Spread = 10.0
    """The longest stretch over air without supports; a ledge counts double."""
    max_support_cm3: Volume | Auto = None
    """The largest volume of supports, as solid columns under the overhangs; auto: the whole build
    volume."""

    def stated(self, key: str) -> Any:
        """Return a figure; None if it is open, because the scene names another printer than the
        default."""
        given = key in self.model_fields_set or self.name == type(self).model_fields["name"].default
        return getattr(self, key) if given else None


class Accuracy(Table):
    """The accuracy that the verified part must reach."""

    name: Literal["sketch", "draft", "standard", "fine"] = option("standard", "Search --accuracy")
    """sketch, draft, standard (default) or fine: from the fastest to the most accurate."""
    iou_floor: Annotated[float, Strict(), Field(gt=0, lt=1)] | Auto = None
    """The IoU that the verified shadow must reach; auto: see report.md."""
    max_outline_error_px: Pixels | Auto = None
    """The file's shadow against the exact tube's, at 1024 px on the longer side; auto: 1.5 in
    sketch, 1 in draft, 0.5 in standard and fine."""
    accept: tuple[Literal["unrecognisable"], ...] = option((), "Output --accept")
    """unrecognisable: keep a piece in whose shadow nobody would recognise the picture."""


class Sequence(Table):
    """The way in which the frames of a sequence follow each other."""

    loop: Annotated[bool, Strict()] = True
    """The last frame leads back to the first (false: --no-loop)."""


# plates in which a piece stands by its own valleys
ON_FEET = ("roots", "rounded", "full", "outline")


class Mount(Table):
    """What holds the piece; a build writes `pegs`, `thread_mm`, `second_thread_mm` and `turns`."""

    kind: Literal["auto", "wall", "stand", "hang", "none"] = option("auto", "Print --mount")
    """What holds the piece: wall (pegs in the tube's own shadow, on a plate whose face is the wall,
    or in drilled holes), stand (a base below all pictures), hang (eyelets for threads), none, or
    auto (default: of those that pass every check the one of fewest hours and grams, if the piece is
    printed). Wall, stand and hang imply --print."""
    foot: Literal["auto", "plate", "dowel"] = "auto"
    """What the pegs end in on the wall: a plate, or dowels in drilled holes."""
    plate: Literal["auto", "roots", "rounded", "full", "outline", "pegs", "none"] = option(
        "auto", "Print --plate"
    )
    """What is on the wall. The piece stands by its own valleys in roots (flat strips in its own
    shadow), or in a thin plate: rounded, a rectangle about the picture; full, as large as the
    frame; outline, which shows the picture from every side. pegs hold it off the wall; none: it has
    nothing. auto (default): roots for a piece without supports, rounded where roots would tell the
    picture or its shadow leaves them no way; pegs for any other."""
    plate_thickness_mm: Length | Auto = None
    """Thickness of the plate on the wall; auto: 3 mm with pegs, 1.6 mm where the piece stands in
    it, 1.2 mm if that is rounded."""
    plate_margin_mm: Length = 8.0
    """How far the plate reaches beyond the frame on each side; with plate = "outline", beyond the
    picture."""
    hole_diameter_mm: Length = 4.0
    """Diameter of the plate's two screw holes."""
    dowel_depth_mm: Length = 10.0
    """Depth of the drilled holes."""
    base_thickness_mm: Annotated[float, Strict(), Field(ge=2, le=MOST_MM)] = 4.0
    """Thickness of a stand's base at its back; its top slopes up to the lamp."""
    min_tip_deg: Annotated[float, Strict(), Field(ge=5, le=45)] = 10.0
    """How far a stand can be tipped in any direction and still come back."""
    max_sag_mm: Length | Auto = None
    """The most that a piece may sag under its own weight; auto: too little for its shadow to be
    seen to move, which follows from the tube and from the lamp's place and size."""
    pegs: tuple[Whole, ...] = ()
    """Written by a build: how many pegs (posts and struts) hold each knot; of a piece that stands
    in its plate, how many feet of each knot close a loop, none where it lies there whole."""
    thread_mm: Vector | Annotated[None, Word("none")] = None
    """Written by a build: the point at which the thread carries a hanging piece, in the scene."""
    second_thread_mm: Vector | Annotated[None, Word("none")] = None
    """Written by a build: the same for the second thread, which keeps the piece from turning."""
    turns: Annotated[bool, Strict()] | None = None
    """Written by a build that chose the mount: whether its search assumed that the piece is free to
    turn."""

    @property
    def asked(self) -> bool:
        """True if a mount is required, whatever the pieces."""
        return self.kind in ("wall", "stand", "hang") or self.on_feet

    @property
    def on_feet(self) -> bool:
        """True if the piece stands in its plate by its own valleys."""
        return self.plate in ON_FEET and self.kind in ("auto", "wall")

    @property
    def before_wall_mm(self) -> float:
        """How far the face in which the piece stands lies before the wall: a plate is the wall itself."""
        return self.thickness_mm if self.on_feet and self.plate == "roots" else 0.0

    @property
    def thickness_mm(self) -> float:
        """The thickness of the plate on the wall."""
        usual = 3.0 if not self.on_feet else 1.2 if self.plate == "rounded" else 1.6
        return self.plate_thickness_mm or usual


class About(Table):
    """What part.3mf says about itself; "" leaves it to the build."""

    title: Line = option("", "Output --title")
    """Title of part.3mf, as slicers and print sites show it; the picture's name by default."""
    designer: Line = option("", "Output --designer")
    """Who designed it, for part.3mf; knotfab by default."""
    licence: Line = option("", "Output --licence")
    """The terms under which others may use it, for part.3mf, such as "CC BY 4.0"; none by
    default."""


Ridge = tuple[Coordinate, Coordinate, Coordinate, Coordinate, Length]


class FrameBar(Table):
    """A bar of the frame that holds the lamps, in its own coordinates: along x from 0, its middle at y = 0,
    from z = 0 up; lengths in mm.

    A `tail`, a dovetail, goes on beyond its end; a `socket` takes one at its beginning, and `sockets` in its
    sides: where along x, and 1 in the side of +y or -1 in the other. `holes` go through: x, y, diameter, and
    how high above the bar the wall around them reaches. `ridges` stand on it: from x, to x, from y, to y,
    height. `matrix`: the rigid motion that takes the bar to the scene.
    """

    length_mm: Length
    width_mm: Length
    thickness_mm: Length
    tail: Annotated[bool, Strict()] = False
    socket: Annotated[bool, Strict()] = False
    sockets: Annotated[tuple[tuple[Coordinate, Literal[1, -1]], ...], Field(max_length=100)] = ()
    holes: Annotated[
        tuple[tuple[Coordinate, Coordinate, Length, Spread], ...], Field(max_length=100)
    ] = ()
    ridges: Annotated[tuple[Ridge, ...], Field(max_length=100)] = ()
    matrix: Matrix


class FramePlate(Table):
    """Bars of the frame that are printed at once: their file, by default table-N.3mf in the plates' order.

    `matrices`: the rigid motions that take them, in their order, to the scene.
    """

    file: str = ""
    matrices: Annotated[tuple[Matrix, ...], Field(min_length=1)]
    bars: tuple[FrameBar, ...] = ()


class Pose(Table):
    """The motion from print coordinates to the scene.

    A rigid motion; where the material shrinks, a similarity that shrinks by as much.
    """

    matrix: Matrix
