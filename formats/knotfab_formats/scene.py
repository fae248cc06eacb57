"""The scene as frozen models: as written, and with every value chosen."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    Strict,
    StrictInt,
    StrictStr,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from knotfab_formats.bounds import Count, Extent, Length, Number, Pixels, Volume
from knotfab_formats.piece import (
    About,
    Accuracy,
    Material,
    Mount,
    Piece,
    Pose,
    Printer,
    Region,
    Sequence,
    Table,
)
from knotfab_formats.search import SearchSettings, search_settings
from knotfab_formats.views import Lamps, Placing, Room, Switches, View

# shares of the way to the light and to the wall that a piece may occupy if its region is "auto"
LIGHT_SHARE, WALL_SHARE = 0.25, 0.9
# px on the longer side of a frame at which shadows are verified and magnitudes reported
VERIFIED_PX = 1024
MOST_VIEWS = 12  # half a turn leaves nothing of the pictures of a part that has more


class Scene(Table):
    """One scene. `search` is checked by `knotfab_formats.search`."""

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(
        cls, raw: Any, read: ModelWrapValidatorHandler[Self], about: ValidationInfo
    ) -> Self:
        """Turn a validation error into one sentence; the validation's context is the file's name."""
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
    views: Annotated[tuple[View, ...], Field(min_length=1, max_length=MOST_VIEWS)] = (View(),)
    accuracy: Accuracy = Accuracy()
    placing: Placing = Placing()
    room: Room = Room()
    effects: Switches = Switches()
    lamps: Lamps = Lamps()
    mount: Mount = Mount()
    sequence: Sequence = Sequence()
    about: About = About()
    search: dict[str, Annotated[bool, Strict()] | StrictInt | Number | StrictStr] = Field({})
    pose: Pose | None = None

    @property
    def settings(self) -> SearchSettings:
        """Every setting of the search: the accuracy's preset, overridden by the scene's own keys.

        Raises:
            InputError: an unknown key, or a value out of its bounds.
        """
        return search_settings(self.accuracy.name, self.search)

    @property
    def share_wall(self) -> bool:
        """True if several lamps shine on one wall."""
        return any(view.wall for view in self.views)

    @property
    def screen_ends(self) -> bool:
        """Whether shadows that fall beside the frame are invisible."""
        return self.share_wall and self.lamps.screen == "ends"

    def count_knots(self, pieces: int) -> int:
        """Return how many knots a picture of `pieces` pieces becomes."""
        return self.piece.knots or pieces

    @property
    def is_one_shadow(self) -> bool:
        """Whether there is one view, a shadow."""
        first, *others = self.views
        return not others and first.kind == "shadow"

    def on_wall(self, knots: int) -> bool:
        """Return whether a wall mount holds the piece; where that is open, only several knots get one."""
        if self.mount.kind != "auto" or self.mount.on_feet:
            return self.mount.kind == "wall" or self.mount.on_feet
        return knots > 1 and len(self.views) == 1


class ResolvedPrinter(Printer):
    """A printer with all of its figures."""

    min_wall_mm: Length
    min_gap_mm: Length
    max_support_cm3: Volume


class ResolvedScene(Scene):
    """A scene as a build takes it: printer and material have figures; the design chooses what is None."""

    printer: ResolvedPrinter

    @property
    def thinnest_mm(self) -> float:
        """The tube's radius; if it is open, that of the thinnest tube that the printer makes."""
        return self.piece.tube_radius_mm or self.printer.min_tube_radius_mm


# Settled by a design: the same tables, with every size a number.


class SettledPiece(Piece):
    """A piece whose tube and number of knots are known; its depth is None if the pictures decided it."""

    tube_radius_mm: Length
    knots: Count


class SettledRegion(Region):
    """A region with its extents."""

    size_mm: Extent


class SettledMaterial(Material):
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
        """The side of a pixel of the pictures at which shadows are verified, on the receiver."""
        return self.longer_mm / VERIFIED_PX

    @property
    def reach_mm(self) -> float:
        """Return how far from its middle a piece may reach to either side, if its region is "auto"."""
        before_lamp = WALL_SHARE * (self.light_distance_mm - 0.5 * self.light_size_mm)
        return min(
            WALL_SHARE * self.wall_distance_mm, LIGHT_SHARE * self.light_distance_mm, before_lamp
        )

    def px_per_mm(self, width_px: int) -> float:
        """Return how many px of a picture `width_px` wide make 1 mm of a piece in the scene's middle."""
        return self.magnification * width_px / self.frame_width_mm


class SettledAccuracy(Accuracy):
    """The accuracy that the verified part must reach, as numbers."""

    iou_floor: Annotated[float, Strict(), Field(gt=0, lt=1)]
    max_outline_error_px: Pixels = 0.5


class SettledScene(ResolvedScene):
    """A scene with nothing left to choose; it has the same keys, and is written and read as any other."""

    piece: SettledPiece
    region: SettledRegion
    material: SettledMaterial
    views: Annotated[tuple[ResolvedView, ...], Field(min_length=1)]
    accuracy: SettledAccuracy
