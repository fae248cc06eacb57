"""The tables of scene.toml that say what is seen: views, lamps, the room, effects."""

from __future__ import annotations

import re
from math import hypot
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, Strict, StrictStr, field_validator
from pydantic_core import PydanticCustomError

from knotfab_formats.bounds import (
    Angle,
    Auto,
    LampDistance,
    Length,
    Ratio,
    Shift,
    Side,
    Spread,
    Turn,
    Whole,
    Word,
    option,
)
from knotfab_formats.piece import Color, FramePlate, Table


def _few_bytes(name: str) -> str:
    """Require a name that file systems can hold with the affixes of knotfab's files."""
    if len(name.encode()) > 180:
        raise PydanticCustomError("name", "a shorter name, of at most 180 bytes")
    return name


Leds = Annotated[int, Strict(), Field(ge=1, le=100)]
MOST_LEDS = 400  # LEDs in an array: the verification renders a shadow for each
Box = tuple[Whole, Whole, Side, Side]
# A name is part of file names: letters, digits and signs of any script, "_" and "-".
ViewName = Annotated[
    str,
    Strict(),
    Field(pattern=r"^[^\x00-,./:-@\[-\^`{-\xa0\s]+$", max_length=60),
    AfterValidator(_few_bytes),
]
Colour = Annotated[float, Strict(), Field(ge=0, le=1)]
Switch = Auto | Annotated[bool, Word("on", True)] | Annotated[bool, Word("off", False)]
# a PNG's text that says that it is the mask of a silhouette, one bit a pixel, black where the shape is
MASK_MARK = ("knotfab", "silhouette")
_SIGNED = "tEXt{}\0{}".format(*MASK_MARK).encode()
# keys that views on one wall share
OF_WALL = (
    *("azimuth_deg", "elevation_deg", "wall_distance_mm", "wall_tilt_deg"),
    *("frame_up_mm", "frame_width_mm", "frame_height_mm"),
)


class Reading(Table):
    """Keys of reading a picture as a silhouette (docs/silhouette.md); px are the picture's own."""

    ink: Literal["auto", "dark", "light", "alpha", "flood"] | Color = option(
        "auto", "Picture --ink"
    )
    """What is drawn: auto (default: what is opaque, or what differs from the border), dark, light,
    alpha, flood (what the border's colours do not reach, for photographs), or a colour such as red
    or "#d02010"."""
    threshold: Annotated[float, Strict(), Field(gt=0, lt=1)] = option(0.5, "Picture --threshold")
    """Where ink begins, as a share of the largest difference, or of full opacity; 0.5 by
    default."""
    invert: Annotated[bool, Strict()] = option(False, "Picture --invert")
    """Draw everything except what was found."""
    crop_px: (
        Box
        | Annotated[Literal[True], Word("paper", True)]
        | Annotated[Literal[False], Word("none", False)]
        | Auto
    ) = option(True, "Picture --crop")
    """Read only this part of the picture: paper (default: a drawing on paper without its sheet),
    none, auto (any drawing's own box), or LEFT,TOP,WIDTH,HEIGHT in px."""
    keep_largest: Whole = option(0, "Picture --keep-largest")
    """Draw only this many pieces of the picture, the largest; 0: all of them."""
    speck_px: Whole = option(0, "Picture --specks")
    """Leave out pieces, and fill holes, of fewer pixels than this."""
    smooth_px: Annotated[float, Strict(), Field(ge=0, le=100)] = option(0.0, "Picture --smooth")
    """Blur the picture by this many px and threshold it at half before it is drawn; the shadow is
    still compared with the picture itself."""


def is_mask(data: bytes) -> bool:
    """Return whether a file is a silhouette's mask as a build writes it: a marked PNG of one bit a pixel."""
    return data.startswith(b"\x89PNG") and data[24:26] == b"\x01\0" and _SIGNED in data[:1000]


class View(Reading):
    """A light or an eye, the wall it looks at, and the picture that is to be there."""

    name: ViewName = "front"
    """The name of the view; names of files hold it."""
    kind: Literal["shadow", "eye"] = "shadow"
    """A lamp's shadow on a wall, or the piece itself as an eye sees it."""
    picture: StrictStr = ""
    """A file beside the scene, or text: and the characters to draw."""
    title: StrictStr = ""
    """The picture's title; by default the name of its file."""
    frame_width_mm: Length | None = option(None, "Piece --width")
    """The picture's width on the wall, in mm; its height follows."""
    frame_height_mm: Length | None = option(None, "Piece --height")
    """The picture's height on the wall, in mm; its width follows."""
    light_distance_mm: LampDistance = option(500.0, "Piece --lamp-distance")
    """Distance from the lamp to the middle of the piece, in mm; 500 by default."""
    light_right_mm: Shift = 0.0
    """How far the lamp stands to the right of the view's axis; wall and frame stay where they
    are."""
    light_up_mm: Shift = 0.0
    """How far the lamp stands above the view's axis."""
    lamp_colour: tuple[Colour, Colour, Colour] = (1.0, 1.0, 1.0)
    """The lamp's red, green and blue, 0 to 1 in linear light."""
    wall: StrictStr = ""
    """The earlier view whose wall and frame this lamp shines on; "": its own."""
    light_diameter_mm: Spread = option(5.0, "Piece --lamp-diameter")
    """The lamp's diameter in mm; 5 by default, 0: a point source. A wide lamp blurs the shadow."""
    light_shape: Literal["disc", "ball", "rectangle", "leds"] = "disc"
    """The shape of the lamp; each LED of an array casts its own shadow."""
    light_width_mm: Spread = 0.0
    """Width of a rectangle; of an array, from the centre of its first LED to that of its last."""
    light_height_mm: Spread = 0.0
    """Height, measured as light_width_mm is."""
    light_leds: tuple[Leds, Leds] = (1, 1)
    """Columns and rows of an array of LEDs."""
    wall_distance_mm: Length = option(100.0, "Piece --wall-distance")
    """Distance from the middle of the piece to the wall, in mm; 100 by default, less where pegs
    would sag."""
    wall_tilt_deg: Annotated[float, Strict(), Field(gt=-80, lt=80)] = 0.0
    """How far the wall's top edge leans towards the lamp."""
    azimuth_deg: Turn = 0.0
    """Azimuth of the lamp about the vertical axis."""
    elevation_deg: Angle = 0.0
    """Elevation of the lamp above the horizontal (90: straight above)."""
    frame_up_mm: Shift = 0.0
    """Height of the frame's middle above the axis, on the receiver."""
    thicken_mm: Length | Annotated[float, Word("none", 0.0)] | Auto = option(
        0.0, "Picture --thicken"
    )
    """Widen thinner strokes to this many mm on the wall, or auto: to what can be printed."""
    lines: Switch = option(None, "Picture --lines")
    """Lay one tube along the middle of each stroke: on, off, or auto (default: where most strokes
    are thinner than the tube)."""
    mirrored: Annotated[bool, Strict()] | None = None
    """true: the picture is mirrored left to right."""
    bend_points: tuple[StrictStr, ...] | None = None
    """Control points of a bent picture, 15 texts: see Bending."""

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

    def as_written(self) -> Self:
        """Return the view as a build writes it: of its picture, once read, only smoothing is left to do."""
        return self.but(**{**dict(Reading()), "smooth_px": self.smooth_px})

    @property
    def drawn_picture(self) -> str:
        """The file beside the scene that shows what is drawn, if that is not the original
        picture."""
        return f"drawn-{self.name}.png"

    @property
    def light_size_mm(self) -> float:
        """The length of the longest line within the lamp; 0 for a point, and for an eye."""
        if self.kind == "eye":
            return 0.0
        across = hypot(self.light_width_mm, self.light_height_mm)
        if self.light_shape == "rectangle":
            return across
        return self.light_diameter_mm + (across if self.light_shape == "leds" else 0.0)

    @property
    def light_has_sides(self) -> bool:
        """Whether the lamp has width and height, which no torch or bulb stands in for."""
        return self.light_shape in ("rectangle", "leds")

    @property
    def magnification(self) -> float:
        """The size of the shadow over that of a body in the middle of the piece."""
        return (self.light_distance_mm + self.wall_distance_mm) / self.light_distance_mm


class Switches(Table):
    """Effects by name (docs/effects.md): on or off whatever their magnitude; auto lets that decide."""

    penumbra: Switch = None
    """A lamp of some size blurs the shadow."""
    misplacement: Switch = None
    """People put lamp, piece and wall slightly out of place."""
    sag: Switch = None
    """The piece sags on its mount."""
    layers: Switch = None
    """The printer's layers make steps in the outline."""


class Room(Table):
    """Light other than the lamp's own: none by default."""

    ambient: Ratio = 0.0
    """Other light in the middle of the picture on the wall, as a ratio to the lamp's."""
    area_m2: Ratio = 0.0
    """Area of walls, floor and ceiling together; 0: no room."""
    reflectance: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.0
    """The share of light that walls, floor and ceiling reflect."""


class Placing(Table):
    """The error with which people are expected to place lamp (or eye), piece and wall."""

    lamp_mm: Annotated[float, Strict(), Field(ge=0, le=1e4)] = 5.0
    """How far lamp or eye stand from their places."""
    turn_deg: Annotated[float, Strict(), Field(ge=0, le=10)] = 1.0
    """How far the piece is turned."""
    tilt_deg: Annotated[float, Strict(), Field(ge=0, le=10)] = 0.0
    """How far the wall is tilted, in any direction."""


class Lamps(Table):
    """Several lamps in front of one wall (views with `wall`): what they show, where they may stand."""

    mode: Literal["mix", "switch"] = "mix"
    """mix: all are lit at once; switch: one after the other."""
    screen: Literal["ends", "open"] = "ends"
    """ends: the screen ends at the picture's frame, and shadows beside it are not seen; open: it
    goes on."""
    picture: StrictStr = ""
    """A coloured picture beside the scene; the picture of each view is then the mask of its
    lamp."""
    places: Literal["auto", "fixed"] = "auto"
    """auto: a build chooses where the lamps stand, within the bounds; fixed: as the views have
    them."""
    max_right_mm: Spread = 400.0
    """The farthest that a lamp may stand to either side of the axis."""
    max_up_mm: Spread = 400.0
    """The farthest that a lamp may stand above or below the axis."""
    colours: Annotated[int, Strict(), Field(ge=0, le=64)] = 0
    """The most flat colours to which the picture is reduced; 0: all that the lamps mix."""
    table: tuple[FramePlate, ...] = ()
    """The frame that holds screen, piece and lamps, written by a build: the files of its bars,
    their sizes, and the rigid motions that take them to the scene."""
