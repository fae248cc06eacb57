"""The scene as frozen models: every key of scene.toml, with its default, unit and bounds."""

from __future__ import annotations

import re
from math import cos, hypot, pi
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    Strict,
    StrictInt,
    StrictStr,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from knotfab_formats.bounds import (
    MOST_MM,
    Angle,
    Count,
    Density,
    Extent,
    LampDistance,
    Length,
    Matrix,
    Modulus,
    Number,
    Pixels,
    Ratio,
    Shift,
    Side,
    Spread,
    TubeLength,
    Turn,
    Vector,
    Volume,
    WallRadius,
    Whole,
)
from knotfab_formats.search import SearchSettings, search_settings

__all__ = [
    "LIGHT_SHARE",
    "MOST_BEND",
    "OF_WALL",
    "VERIFIED_PX",
    "WALL_SHARE",
    "About",
    "Accuracy",
    "Lamps",
    "Material",
    "Mount",
    "Piece",
    "Placing",
    "Plate",
    "Pose",
    "Printer",
    "Reading",
    "Region",
    "ResolvedAccuracy",
    "ResolvedMaterial",
    "ResolvedPiece",
    "ResolvedRegion",
    "ResolvedScene",
    "ResolvedView",
    "Room",
    "Scene",
    "Sequence",
    "Switch",
    "Switches",
    "View",
    "known",
]


def _few_bytes(name: str) -> str:
    """A name that file systems hold, with what goes around it."""
    if len(name.encode()) > 180:
        raise PydanticCustomError("name", "a shorter name, of at most 180 bytes")
    return name


Leds = Annotated[int, Strict(), Field(ge=1, le=100)]
MOST_LEDS = 400  # of an array: the verification renders a shadow for each
# of the way to the light, and to the wall, that a piece may reach into where its region is "auto"
LIGHT_SHARE, WALL_SHARE = 0.25, 0.9
MOST_BEND = 0.3  # of a picture's height: the most that a point of it may be allowed to move
# keys of a view that lie with its wall: views that share a wall share them
OF_WALL = (
    *("azimuth_deg", "elevation_deg", "wall_distance_mm", "wall_tilt_deg", "wall_radius_mm"),
    *("frame_up_mm", "frame_width_mm", "frame_height_mm"),
)
VERIFIED_PX = 1024  # on the longer side of a frame: where shadows are verified, magnitudes told
Box = tuple[Whole, Whole, Side, Side]
Disc = tuple[Whole, Whole, Side]  # the middle's x and y, and the radius
# in the names of files: letters, digits and signs of any script, "_" and "-"
ViewName = Annotated[
    str,
    Strict(),
    Field(pattern=r"^[^\x00-,./:-@\[-\^`{-\xa0\s]+$", max_length=60),
    AfterValidator(_few_bytes),
]
Colour = Annotated[float, Strict(), Field(ge=0, le=1)]


def _one_line(text: str) -> str:
    """A line that a file's metadata can hold."""
    if not text.isprintable():
        raise PydanticCustomError("line", "one line of signs that can be printed")
    return text


Line = Annotated[str, Strict(), Field(max_length=200), AfterValidator(_one_line)]
Color = Annotated[str, Strict(), Field(pattern=r"^#[0-9a-fA-F]{6}$")]
Switch = Literal["auto", "on", "off"]


T = TypeVar("T")


def known(value: T | Literal["auto", "none"]) -> T | None:
    """A value that the scene settles; None where it leaves it open, or has none."""
    return None if isinstance(value, str) else value


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Piece(_Table):
    """What is asked of the tube."""

    tube_radius_mm: Length | Literal["auto"] = "auto"
    knots: Count | Literal["auto"] = "auto"
    depth: Length | Literal["auto", "flat"] = "auto"
    clearance_mm: Spread = 0.4
    printed: Annotated[bool, Strict()] = False  # posed and checked for the printer, with its mount
    # of several pictures: the most that a point of one may move, as a share of its height
    bend: Annotated[float, Strict(), Field(gt=0, le=MOST_BEND)] | Literal["auto", "off"] = "auto"
    mirror: Literal["auto", "off"] = "off"  # auto: pictures, none of text, may be mirrored as well
    # of wire: what bends it, by the name of a template or by a file (docs/wire.md)
    bender: Annotated[str, Strict(), Field(min_length=1)] = "lra"
    knot: StrictStr = "unknot"  # tied into the longest curve; checked by knotfab_formats.knot_names


class Region(_Table):
    """What the whole tube must stay inside (scene coordinates).

    Turned about its middle as a view of the same angles is; of an auto size and one view it is that view's.
    """

    kind: Literal["box", "cylinder", "sphere", "mesh"] = "box"
    file: StrictStr | None = None  # of kind "mesh" alone: a closed STL, beside the scene
    center_mm: Vector = (0.0, 0.0, 0.0)
    size_mm: Extent | Literal["auto"] = "auto"
    azimuth_deg: Turn = 0.0
    elevation_deg: Angle = 0.0


class Material(_Table):
    """What the tube is made of, and how it takes its form; named materials are data files."""

    name: StrictStr = "pla"
    process: Literal["filament", "resin", "powder", "wire"] = "filament"
    density_g_cm3: Density = 1.24
    min_bend_radius_mm: Length | Literal["auto"] = "auto"
    max_length_mm: TubeLength = 50000.0
    wire_diameter_mm: Spread = 0.0
    tool_radius_mm: Spread = 0.0
    min_straight_mm: Spread = 0.0
    max_bend_deg: Annotated[float, Strict(), Field(gt=0, le=175)] = 175.0
    springback_percent: Annotated[float, Strict(), Field(ge=0, lt=100)] = 0.0
    young_modulus_mpa: Modulus = 2300.0
    yield_mpa: Modulus = 50.0
    transmittance_per_mm: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.0  # 0: opaque
    # of every length, once it is printed: written larger by that; 0: slicer or service sees to it
    shrinkage_percent: Annotated[float, Strict(), Field(ge=0, lt=20)] = 0.0
    color: Color = "#d9d4c7"

    @property
    def shrinks_to(self) -> float:
        """The share of every length that is left of what is printed."""
        return 1 - self.shrinkage_percent / 100


class Printer(_Table):
    """What prints it, and how; named printers are data files."""

    name: StrictStr = "prusa-mk4"
    process: Literal["filament", "resin", "powder"] = "filament"  # powder needs no supports
    build_volume_mm: Extent = (250.0, 210.0, 220.0)
    nozzle_mm: Length = 0.4
    min_wall_mm: Length | Literal["auto"] = "auto"  # auto: the nozzle
    min_gap_mm: Length | Literal["auto"] = "auto"
    min_tube_radius_mm: Length = 0.8
    layer_height_mm: Length = 0.2
    supports: Annotated[bool, Strict()] = True
    max_overhang_deg: Annotated[float, Strict(), Field(ge=0, le=90)] = 45.0
    max_bridge_mm: Spread = 10.0
    max_support_cm3: Volume | Literal["auto"] = "auto"

    def stated(self, key: str) -> Any:
        """A figure; None where it is open, since the scene only names another printer than the usual one."""
        given = key in self.model_fields_set or self.name == type(self).model_fields["name"].default
        return known(getattr(self, key)) if given else None


class Reading(_Table):
    """How a picture becomes a silhouette (docs/silhouette.md); px are the picture's own."""

    ink: Literal["auto", "dark", "light", "alpha", "flood"] | Color = "auto"
    threshold: Annotated[float, Strict(), Field(gt=0, lt=1)] = 0.5
    invert: Annotated[bool, Strict()] = False
    crop_px: Box | Literal["none", "auto"] = "none"  # left, top, width, height
    keep_largest: Whole = 0  # pieces; 0: all
    speck_px: Whole = 0  # smaller pieces and holes are left out
    smooth_px: Annotated[float, Strict(), Field(ge=0, le=100)] = 0.0  # of what is drawn
    # cut out of a photograph, before it is cropped: a rectangle about it, discs that belong, that do not
    subject_px: Box | Literal["none"] = "none"  # left, top, width, height
    keep_px: tuple[Disc, ...] = ()
    drop_px: tuple[Disc, ...] = ()
    subject_mask: StrictStr = ""  # the file, white where the subject is, in the place of a new cut

    @property
    def cut_out(self) -> bool:
        """Whether a subject is cut out of the picture, and drawn instead of ink."""
        return bool(self.subject_mask) or self.subject_px != "none"


class View(Reading):
    """A light or an eye, the wall it looks at, and the picture that is to be there."""

    name: ViewName = "front"
    kind: Literal["shadow", "eye"] = "shadow"
    picture: StrictStr = ""
    title: StrictStr = ""  # what the picture is called; by default as its file is
    frame_width_mm: Length | None = None
    frame_height_mm: Length | None = None
    light_distance_mm: LampDistance = 500.0
    light_right_mm: Shift = (
        0.0  # the lamp beside the view's axis: wall and frame stay where they are
    )
    light_up_mm: Shift = 0.0
    lamp_colour: tuple[Colour, Colour, Colour] = (1.0, 1.0, 1.0)  # red, green, blue, linear light
    wall: StrictStr = ""  # the name of the view whose wall and frame this lamp shines on; its own
    light_diameter_mm: Spread = 5.0  # of a disc, a ball, or each LED
    light_shape: Literal["disc", "ball", "rectangle", "leds"] = "disc"
    light_width_mm: Spread = 0.0  # of a rectangle; of an array between its outer LEDs
    light_height_mm: Spread = 0.0
    light_leds: tuple[Leds, Leds] = (1, 1)  # columns and rows
    wall_distance_mm: Length = 100.0
    wall_tilt_deg: Annotated[float, Strict(), Field(gt=-80, lt=80)] = 0.0
    wall_radius_mm: WallRadius | Literal["flat"] = "flat"  # of a cylinder along the wall's up
    azimuth_deg: Turn = 0.0
    elevation_deg: Angle = 0.0
    frame_up_mm: Shift = 0.0  # of the frame's middle above the axis, on the receiver
    thicken_mm: Length | Literal["none", "auto"] = (
        "none"  # strokes that are thinner, on the receiver
    )
    lines: Literal["auto", "on", "off"] = (
        "auto"  # on: drawn along its centre lines; auto: where most strokes are as thin as the tube
    )
    mirrored: Annotated[bool, Strict()] | None = None  # the picture, from side to side
    # how it is bent, written by a build: control points "right,down" (docs/conventions.md)
    bend_points: tuple[StrictStr, ...] | None = None
    tone: Literal["off", "lines"] = "off"  # lines: its greys, by lines closer where it is darker

    @field_validator("light_leds")
    @classmethod
    def _few_enough(cls, leds: tuple[int, int]) -> tuple[int, int]:
        if leds[0] * leds[1] > MOST_LEDS:
            raise PydanticCustomError("leds", f"an array of at most {MOST_LEDS} LEDs")
        return leds

    @field_validator("lamp_colour")
    @classmethod
    def _lit(cls, colour: tuple[float, float, float]) -> tuple[float, float, float]:
        if not any(colour):
            raise PydanticCustomError("colour", "a colour that gives light")
        return colour

    @field_validator("bend_points")
    @classmethod
    def _in_rows(cls, rows: tuple[str, ...] | None) -> tuple[str, ...] | None:
        pair = r"-?[0-9]{1,4},-?[0-9]{1,4}"
        if rows and not (
            len(rows) == 15 and all(re.fullmatch(f"{pair}( {pair}){{10}}", r) for r in rows)
        ):
            raise PydanticCustomError(
                "bend_points",
                "15 rows of 11 pairs of whole numbers of up to four digits, as a build writes them",
            )
        return rows or None

    @property
    def lines_picture(self) -> str:
        """The file beside the scene that holds what is drawn of greys (`tone`)."""
        return f"picture-{self.name}-lines.png"

    @property
    def subject_picture(self) -> str:
        """The file beside the scene that holds the mask of what was cut out."""
        return f"subject-{self.name}.png"

    @property
    def drawn_picture(self) -> str:
        """The file beside the scene that shows what is drawn, where that is not the picture as it came."""
        return f"drawn-{self.name}.png"

    @property
    def light_size_mm(self) -> float:
        """The longest line within the lamp; 0 of a point, and of an eye."""
        if self.kind == "eye":
            return 0.0
        across = hypot(self.light_width_mm, self.light_height_mm)
        if self.light_shape == "rectangle":
            return across
        return self.light_diameter_mm + (across if self.light_shape == "leds" else 0.0)

    @property
    def magnification(self) -> float:
        """By how much the shadow is larger than what stands in the middle of the piece."""
        return (self.light_distance_mm + self.wall_distance_mm) / self.light_distance_mm


class Switches(_Table):
    """Effects that are simulated whatever their magnitude (docs/effects.md): each by its name."""

    penumbra: Switch = "auto"
    misplacement: Switch = "auto"
    contrast: Switch = "auto"
    sag: Switch = "auto"
    layers: Switch = "auto"
    wall: Switch = "auto"


class Room(_Table):
    """What light there is beside the lamp's own: none by default."""

    ambient: Ratio = 0.0  # over the lamp's own in the middle of the wall's picture
    area_m2: Ratio = 0.0  # of walls, floor and ceiling together; 0: no room
    reflectance: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.0  # of all of these
    second_lamp_mm: Vector | Literal["none"] = "none"  # in the scene
    second_lamp_share: Ratio = 1.0  # of its light there, over the lamp's own


class Placing(_Table):
    """How far off people are expected to place lamp (or eye), piece and wall."""

    lamp_mm: Annotated[float, Strict(), Field(ge=0, le=1e4)] = 5.0
    turn_deg: Annotated[float, Strict(), Field(ge=0, le=10)] = 1.0
    tilt_deg: Annotated[float, Strict(), Field(ge=0, le=10)] = 0.0  # of the wall, in any direction


class Plate(_Table):
    """What is printed at once: its file beside the scene, by default plate-N.3mf in the plates' order.

    `matrices`: the rigid motions that take its bodies, in their order, to part.stl.
    """

    file: str = ""
    matrices: Annotated[tuple[Matrix, ...], Field(min_length=1)]


class Lamps(_Table):
    """Several lamps before one wall (views with `wall`): what they show there, and where they may stand."""

    mode: Literal["mix", "switch"] = "mix"  # all are lit at once, or one after the other
    # whether the screen ends at the picture's frame, beside which no shadow is seen, or goes on
    screen: Literal["ends", "open"] = "ends"
    picture: StrictStr = ""  # in colours, which the lamps' masks are taken from; beside the scene
    places: Literal["auto", "fixed"] = "auto"  # auto: a build finds them, within the bounds
    max_right_mm: Spread = 400.0  # from the axis to a lamp on either side
    max_up_mm: Spread = 400.0
    colours: Annotated[int, Strict(), Field(ge=0, le=64)] = (
        0  # the most flat colours of the picture; 0: what the lamps mix
    )
    # written by a build: the frame that holds screen, piece and lamps, and where its bodies go in the scene
    table: tuple[Plate, ...] = ()


class Accuracy(_Table):
    """What the verified part must reach."""

    name: Literal["sketch", "draft", "standard", "fine"] = "standard"
    iou_floor: Annotated[float, Strict(), Field(gt=0, lt=1)] | Literal["auto"] = "auto"
    max_outline_error_px: Pixels | Literal["auto"] = "auto"  # auto: the accuracy's `outline_px`
    accept: tuple[Literal["unrecognisable"], ...] = ()  # kept, though it would be rejected


class Sequence(_Table):
    """How the frames of a sequence follow each other."""

    loop: Annotated[bool, Strict()] = True  # the last one leads back to the first


class Mount(_Table):
    """What holds the piece; a build writes `pegs`, how many hold each knot, and `thread_mm`, in the scene."""

    kind: Literal["auto", "none", "wall", "stand", "hang"] = (
        "auto"  # auto: wall for loose pieces of one view
    )
    foot: Literal["auto", "plate", "dowel"] = "auto"
    plate_thickness_mm: Length = 3.0
    plate_margin_mm: Length = 8.0
    hole_diameter_mm: Length = 4.0
    dowel_depth_mm: Length = 10.0
    base_thickness_mm: Annotated[float, Strict(), Field(ge=2, le=MOST_MM)] = (
        4.0  # of a stand, at its back
    )
    min_tip_deg: Annotated[float, Strict(), Field(ge=5, le=45)] = 10.0
    max_sag_mm: Length = 0.2
    pegs: tuple[Count, ...] = ()
    thread_mm: Vector | Literal["none"] = "none"  # where the thread of "hang" carries the piece

    @property
    def asked(self) -> bool:
        """Whether somebody asks for a mount, whatever the pieces."""
        return self.kind in ("wall", "stand", "hang")


class About(_Table):
    """What part.3mf says of itself; "" leaves it to the build (docs/conventions.md)."""

    title: Line = ""
    designer: Line = ""
    licence: Line = ""


class Pose(_Table):
    """From print coordinates to the scene, and what is printed instead of the whole.

    A rigid motion; where the material shrinks, a similarity that shrinks by as much.
    """

    matrix: Matrix
    plates: tuple[Plate, ...] = ()


class Scene(_Table):
    """One scene. `search` is checked by `knotfab_formats.search`."""

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(
        cls, raw: Any, read: ModelWrapValidatorHandler[Self], about: ValidationInfo
    ) -> Self:
        """What is wrong with a scene, in one sentence; the validation's context is the name of the file."""
        try:
            return read(raw)
        except ValidationError as error:
            from knotfab_formats.explain import explain

            raise explain(error, raw, about.context or "the scene", cls) from error

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    piece: Piece = Piece()
    region: Region = Region()
    material: Material = Material()
    printer: Printer = Printer()
    views: Annotated[tuple[View, ...], Field(min_length=1)] = (View(),)
    accuracy: Accuracy = Accuracy()
    placing: Placing = Placing()
    room: Room = Room()
    effects: Switches = Switches()
    lamps: Lamps = Lamps()
    mount: Mount = Mount()
    sequence: Sequence = Sequence()
    about: About = About()
    search: dict[str, Annotated[bool, Strict()] | StrictInt | Number | StrictStr] = {}
    pose: Pose | None = None

    @property
    def settings(self) -> SearchSettings:
        """Every setting of the search: the accuracy's preset with the scene's own keys over it.

        Raises:
            InputError: for a key that is none, or a value out of its bounds.
        """
        return search_settings(self.accuracy.name, self.search)

    @property
    def share_wall(self) -> bool:
        """Whether several lamps shine on one wall."""
        return any(view.wall for view in self.views)

    @property
    def screen_ends(self) -> bool:
        """Whether what falls beside the frame is seen nowhere."""
        return self.share_wall and self.lamps.screen == "ends"

    def count_knots(self, pieces: int) -> int:
        """How many knots so many pieces of a picture become."""
        return pieces if self.piece.knots == "auto" else self.piece.knots

    def hangs(self, knots: int) -> bool:
        """Whether so many knots get a wall mount; if open: several, of one view before a flat wall."""
        if self.mount.kind != "auto":
            return self.mount.kind == "wall"
        one_flat = len(self.views) == 1 and self.views[0].wall_radius_mm == "flat"
        return knots > 1 and one_flat and self.material.process != "wire"


# What a design settles: the same tables, with every size a number.


class ResolvedPiece(Piece):
    """A piece whose tube and number of knots are known; "auto" depth: the pictures decided it."""

    tube_radius_mm: Length
    knots: Count


class ResolvedRegion(Region):
    """A region with its extents."""

    size_mm: Extent


class ResolvedMaterial(Material):
    """A material with its figures, and the bend radius that the tube keeps."""

    min_bend_radius_mm: Length


class ResolvedView(View):
    """A view with both sides of its frame."""

    frame_width_mm: Length
    frame_height_mm: Length

    @property
    def frame_mm(self) -> tuple[float, float]:
        """Width and height of the frame on the receiver."""
        return self.frame_width_mm, self.frame_height_mm

    @property
    def longer_mm(self) -> float:
        """The frame's longer side."""
        return max(self.frame_mm)

    @property
    def pixel_mm(self) -> float:
        """Side of a pixel of the pictures that shadows are verified at, on the receiver."""
        return self.longer_mm / VERIFIED_PX

    @property
    def clear_mm(self) -> float:
        """From the middle of the piece to where its wall comes nearest, beside the frame if it is hollow."""
        radius = self.wall_radius_mm
        if isinstance(radius, str) or radius < 0:
            return self.wall_distance_mm
        return self.wall_distance_mm - radius * (
            1 - cos(min(0.5 * self.frame_width_mm / radius, pi / 2))
        )

    @property
    def reach_mm(self) -> float:
        """How far from its middle a piece may reach to either side, where its region is "auto"."""
        before_lamp = WALL_SHARE * (self.light_distance_mm - 0.5 * self.light_size_mm)
        return min(WALL_SHARE * self.clear_mm, LIGHT_SHARE * self.light_distance_mm, before_lamp)

    def px_per_mm(self, width_px: int) -> float:
        """px of a picture so wide to a mm of a piece in the middle of the scene."""
        return self.magnification * width_px / self.frame_width_mm


class ResolvedAccuracy(Accuracy):
    """What the verified part must reach, as numbers."""

    iou_floor: Annotated[float, Strict(), Field(gt=0, lt=1)]
    max_outline_error_px: Pixels = 0.5


class ResolvedScene(Scene):
    """A scene with nothing left to choose: the same keys, so it is written and read as any scene is."""

    piece: ResolvedPiece
    region: ResolvedRegion
    material: ResolvedMaterial
    views: Annotated[tuple[ResolvedView, ...], Field(min_length=1)]
    accuracy: ResolvedAccuracy
