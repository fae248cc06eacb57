"""The validators' findings on written files: checks, views, colours; a build's report extends them.

Places and lengths are in mm unless a name says otherwise, shares and IoU from 0 to 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from knotfab_formats.errors import plain

# 24 characters of DejaVu Sans, stretched to squares in a column: what a picture that is read stands out from
FOREIGN_SIGNS = Path(__file__).with_name("foreign.png")

Place = tuple[float, float, float]  # in the coordinates of the measured file, mm
Status = Literal["pass", "fail", "skipped"]


@dataclass(frozen=True)
class Check:
    """The outcome of one check; if it is `required`, a failure rejects the part.

    `measured` and `limit` are in `unit`, or words if not numbers; `detail` is a sentence for a person.
    `at` are the places that decided, worst first: where to look when it fails.
    """

    name: str
    status: Status
    required: bool
    measured: float | str | None
    limit: float | str | None
    unit: str
    detail: str
    at: tuple[Place, ...] = ()


def exit_code(checks: Iterable[Check]) -> int:
    """Return 1 if a required check failed, else 3 if one could not run, else 0; others decide nothing."""
    required = {check.status for check in checks if check.required}
    return 1 if "fail" in required else 3 if "skipped" in required else 0


def list_unmet(checks: Iterable[Check]) -> list[Check]:
    """List the required checks that did not pass; skipped ones count, since they prove nothing."""
    return [check for check in checks if check.required and check.status != "pass"]


COMMON_NAMES = {"3_1": "trefoil", "4_1": "figure-eight knot"}


def knot_in_words(name: str, form: str = "{0}") -> str:
    """Put the common name of a knot beside its symbol: "left-handed 3_1" becomes "left-handed trefoil".

    Args:
        form: form of the word, and of the name: "{1} ({0})" puts one beside the other.
    """
    return re.sub(
        r"(?<![\w#])(3_1|4_1)(?![\w#])", lambda own: form.format(COMMON_NAMES[own[0]], own[0]), name
    )


@dataclass(frozen=True, kw_only=True)
class Loss:
    """One thing that the shadow lost of its picture, with its place on the picture and on the wall.

    `needed_mm` is the width of the tube's shadow. A report names the `view`.
    """

    view: str | None = None
    what: str
    at_px: tuple[float, float]
    at_mm: tuple[float, float]
    size_mm: float
    length_mm: float
    size_px: float
    needed_mm: float
    sentence: str


# the words that a shadow may deserve, best first
WORDS = ("faithful", "good", "coarse", "not recognisable")
POOR = WORDS[2:]  # those that no green "passed" may hide


@dataclass(frozen=True, kw_only=True)
class Recognition:
    """The verdict on a picture's shadow: a word, the reasons why it is no better one, and the losses.

    Losses come worst first. `touching` counts places where pieces of the picture just touch, `cut_tips` tips
    that are cut off; the others count changes, those in text too.
    """

    word: str
    reasons: tuple[str, ...]
    lost_pieces: int
    filled_holes: int
    bridged_gaps: int
    broken_strokes: int
    stray_pieces: int
    stray_holes: int
    misshapen: int
    touching: int
    cut_tips: int
    specks: int
    outline_p95_mm: float
    outline_p95_radii: float
    lost: tuple[Loss, ...]


@dataclass(frozen=True, kw_only=True)
class Penumbra:
    """The effect of the lamp's size on the shadow.

    `widest_px` is the widest blur; `iou` compares the picture with where at least half of the lamp is hidden.
    `brightness_error` is the difference in brightness (lit 1, dark 0) between wall and picture, summed within
    the padded frame, per area of the picture; `hard_error` is that of a point lamp's shadow.
    """

    widest_px: float
    iou: float
    brightness_error: float
    hard_error: float
    samples: int


@dataclass(frozen=True)
class Move:
    """The IoU after a move: `raw` as it is, and `fitted` once the shadow's similarity is undone."""

    raw: float
    fitted: float


@dataclass(frozen=True)
class WorstMove(Move):
    """The most costly move: `of` lamp, turn or tilt, in its direction `way`."""

    of: str
    way: str


@dataclass(frozen=True, kw_only=True)
class Misplacement:
    """The cost of lamp (or eye), piece and wall each being misplaced, one way at a time.

    `iou` is that of the unmoved scene on the same grid; `samples` counts the shadows. Turns (by axis) are
    left out if nothing can turn, tilts if the scene expects none.
    """

    parting_px: float
    lamp_mm: float
    turn_deg: float
    iou: float
    lamp_iou: dict[str, Move]
    worst: WorstMove | None
    samples: int
    turn_iou: dict[str, Move] | None = None
    tilt_deg: float | None = None
    tilt_iou: dict[str, Move] | None = None


@dataclass(frozen=True, kw_only=True)
class Layers:
    """The effect of a printed part's layers on its shadow.

    `shift_px` is the most that half a layer shifts a shadow; `iou` is that of the slices' shadow and the
    picture, `iou_smooth` that of the mesh itself; `samples` counts the slices.
    """

    layer_mm: float
    shift_px: float
    iou: float
    iou_smooth: float
    samples: int


@dataclass(frozen=True, kw_only=True)
class Bending:
    """How far the pixels of a bent picture moved, in shares of its height.

    `stretch` is the largest change of a length, as a factor; None where the picture folds.
    """

    rms: float
    most: float
    stretch: float | None
    mirrored: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Sag:
    """The IoU of the knots' own shadow as designed and as they sag, and the largest shift of a strand's."""

    widest_px: float
    iou: float
    iou_designed: float


@dataclass(frozen=True)
class Named:
    """The picture's rank among foreign signs: `z` deviations above their mean, `first` if best."""

    z: float
    first: bool


@dataclass(frozen=True)
class ToldFrom:
    """How much of the picture is told to whoever looks from there: 0 nothing, 1 as plain as the picture."""

    share: float
    azimuth: float
    elevation: float


@dataclass(frozen=True, kw_only=True)
class Told:
    """How much of its picture the unlit piece tells: from the `worst` side, and from the `door`.

    `of` says what tells most: the knots, the holder, or the whole.
    """

    worst: ToldFrom
    door: float
    of: str


@dataclass(frozen=True, kw_only=True)
class View:
    """One view of a part; `projection` and `receiver` are in the coordinates of the part's file.

    A build adds what it knows of the picture and the effects that it measures itself, from `silhouette` on.
    """

    name: str
    kind: str
    picture: str
    width: int
    height: int
    projection: tuple[tuple[float, float, float, float], ...]
    receiver: tuple[float, float, float, float]
    iou: float
    iou_frame: float
    iou_tube: float | None
    precision: float
    recall: float
    outline_error_px: float | None
    outline_error_mm: float | None
    intrusion: float | None
    depth_ratio: float | None
    told: Told | None = None
    recognition: dict[str, Named] | None = None  # what 1.x told; it goes with the next release
    lamp_colour: tuple[float, float, float] | None = None
    iou_drawn: float | None = None
    bending: Bending | None = None
    verdict: Recognition | None = None
    misplacement: Misplacement | None = None
    penumbra: Penumbra | None = None
    layers: Layers | None = None
    silhouette: str | None = None
    picture_notes: tuple[str, ...] | None = None
    bound: float | None = None
    drawn: str | None = None
    sag: Sag | None = None


@dataclass(frozen=True, kw_only=True)
class Lamp:
    """One of several lamps on a screen, and the stray and missing shares of its shadow in the frame."""

    name: str
    colour: tuple[float, float, float]
    light: Place
    spill: float
    spill_beside: float
    missing: float


@dataclass(frozen=True, kw_only=True)
class Masks:
    """How well the masks give a coloured picture, which no shadow can better; errors are mean ΔE.

    `masks_share` is the share of pixels where the masks ask for the mixed colour nearest to the picture's.
    `swapped_delta_e` is the least error with the colours of two lamps swapped (`swapped`).
    """

    file: str
    delta_e: float
    masks_share: float
    masks_delta_e: float
    swapped: tuple[str, ...]
    swapped_delta_e: float | None


@dataclass(frozen=True, kw_only=True)
class Misregistration:
    """The cost of lamps that stand beside their places.

    `lamp_mm` is how far one lamp may be off, in the worst direction, until its shadow is off by half a
    strand's width anywhere; None where the knots are not known. `share` is the share of right colours once
    every lamp is moved by `moved_mm`, each in the direction that costs most by itself; `unmoved` is that with
    no lamp moved. Both are computed on the same coarser pixels, for point lights.
    """

    lamp_mm: float | None
    moved_mm: float
    share: float
    unmoved: float


@dataclass(frozen=True, kw_only=True)
class Colours:
    """What several lamps mix on one screen: shares of pixels in the right colour, mean errors ΔE."""

    lamps: tuple[Lamp, ...]
    share: float
    share_inside: float
    share_along: float
    along: float
    share_half_light: float
    share_drawn: float
    delta_e: float
    delta_e_inside: float
    delta_e_along: float
    delta_e_lit: float
    ambient: float
    misregistration: Misregistration
    picture: Masks | None = None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The result of `validate`; `conclusion` is one line for a person.

    `status` is "pass" or "fail"; for `exit_code` see the function. `seconds` says what each stage cost;
    `picture` is the file in which failures were drawn, `size_mm` the part's extents, `notes` what its reader
    passed over or asks. `colours` is None where no lamps mix.
    """

    status: str
    exit_code: int
    conclusion: str
    size_mm: tuple[float, float, float] | None
    notes: tuple[str, ...]
    checks: tuple[Check, ...]
    views: tuple[View, ...]
    colours: Colours | None
    picture: str | None
    seconds: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return its fields, except exit code and seconds, as values that JSON can hold (no infinities)."""
        told: dict[str, Any] = plain(self)
        return {key: told[key] for key in told if key not in ("exit_code", "seconds")}


# The names of all checks: those that a report lists, and that may be left out by name.

MESH = (
    *("mesh_closed", "mesh_winding", "mesh_degenerate", "mesh_duplicate", "mesh_manifold"),
    *("mesh_bodies", "mesh_genus", "mesh_volume", "mesh_self_intersection"),
)
FILES = ("same_3mf", "slicer_ini")  # what is printed is what was verified, as the scene says
TUBE = ("centre_line", "tube", "mount", "clearance", "region", "build_volume")  # the part as a tube
# measured together: their work is saved only where all of them are left out
KNOTS = ("thickness", "bend", "length", "knot_type", "linking")
OVERHANGING = ("overhang", "support_volume", "bridge", "floating", "islands")
PRINTING = ("feature", "gap", *OVERHANGING, "standing")
GROWN = ("reach", "legs", "feet", "feet_level", "tipping", "voids")  # where no supports are
UPRIGHT = ("cut", "bars", *GROWN)
HELD = ("level",)  # a part that hangs on a thread
TABLE = ("table_mesh", "table_bars", "table", "table_shadow")  # the frame that holds several lamps
PRINTER = ("build_volume", *PRINTING, *UPRIGHT, *TABLE)  # left out of a piece that is not printed
SHADOWS = (
    *("shadow", "shadow_exact", "outline", "wrong_outline", "recognisable"),
    *("half_light", "intrusion"),  # for a wide lamp, a mount
    *("colours", "lamp_colours"),  # several lamps on one screen
)
