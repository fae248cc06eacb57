"""What a report says of the printed piece: its mount, pose and cost, and the slicer's figures.

Lengths are in mm, times in seconds and shares from 0 to 1, unless a name says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Literal

from knotfab_formats.verdict import Status

Range = tuple[float, float]
Extent = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class MountFigures:
    """The holder of the piece: a wall mount, a stand, eyelets, or nothing."""

    kind: str
    foot: str | None = None
    plate: str | None = None
    feet_of_knots: tuple[int, ...] | None = None
    pegs: int | None = None
    posts: int | None = None
    struts: int | None = None
    knots_joined: tuple[tuple[int, int], ...] | None = None
    peg_length_mm: Range | None = None
    peg_diameter_mm: float | None = None
    thinnest_peg_mm: float | None = None
    members_of_knots: tuple[int, ...] | None = None
    member_diameter_mm: Range | None = None
    base_mm: Extent | None = None
    margin_mm: float | None = None
    tip_deg: float | None = None
    thread_mm: Extent | None = None
    second_thread_mm: Extent | None = None
    hole_mm: float | None = None
    tilt_deg: float | None = None
    max_tilt_deg: float | None = None
    predicted_intrusion: float | None = None
    sag_mm: float | None = None
    max_sag_mm: float | None = None

    @property
    def threads_apart_mm(self) -> float | None:
        """How far apart two threads are, as seen from above; None where there are no two."""
        if self.thread_mm is None or self.second_thread_mm is None:
            return None
        return hypot(*(self.thread_mm[k] - self.second_thread_mm[k] for k in (0, 2)))


@dataclass(frozen=True, kw_only=True)
class RootsFigures:
    """The strips on the wall in which a piece stands, all in the dark of its own shadow.

    `screws` are the middles of their holes, right and up from the frame's middle. `tape` says where tape
    holds them: along them all, or at the pads about the screws.
    """

    width_mm: float
    thickness_mm: float
    screws: tuple[tuple[float, float], ...]
    tape: Literal["along", "pads"]
    area_cm2: float
    mass_g: float


@dataclass(frozen=True, kw_only=True)
class PlateFigures:
    """The plate on the wall in which a piece stands, as it is printed.

    All of its layers lie below all strands: a change of filament at the height `change_at_mm`, before the
    layer `change_layer` (the first is 1), gives a screen and a piece of two colours. `outline` (n, 2), mm
    right and up from the frame's middle.
    """

    thickness_mm: float
    change_at_mm: float
    change_layer: int
    mass_g: float
    outline: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True)
class SetupSteps:
    """The steps of setting a view up, and the lamp to take, in sentences."""

    view: str
    steps: tuple[str, ...]
    lamp: tuple[str, ...]


@dataclass(frozen=True)
class Kept:
    """A length before and after a piece was built again, and the one that is proposed."""

    first: float
    kept: float
    proposed: float | None = None


@dataclass(frozen=True, kw_only=True)
class PoseFigures:
    """How the piece lies on the bed, and what was changed so that it may."""

    height_mm: float
    chosen_by: str
    support_cm3_estimate: float | None = None
    support_filament_cm3_estimate: float | None = None
    box_cm3: float | None = None
    shrinkage_percent: float | None = None
    depth_mm: Kept | None = None
    wall_distance_mm: Kept | None = None


@dataclass(frozen=True, kw_only=True)
class Way:
    """What a piece takes in one way to hold it, and its `price`, in hours.

    `way`: roots, rounded or another plate, none, or slicer, for its supports. Ways that were not taken are
    estimated from pieces that were built both ways, without a search.
    """

    way: str
    hours: float
    grams: float
    support_grams: float
    price: float


@dataclass(frozen=True, kw_only=True)
class SupportFigures:
    """How a piece is held while it prints.

    `asked`: auto, none or slicer; `way`: the one that was taken, none or slicer; `why`, in words. `hours` and
    `grams`, with supports, are the slicer's. `ways`: the one taken, then the others, cheapest first; none
    where there is nothing to tell.
    """

    asked: str
    way: str
    why: str
    hours: float | None
    grams: float | None
    ways: tuple[Way, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BarFigures:
    """The bars to break away from a piece that prints without supports."""

    count: int
    grams: float
    longest_mm: float


@dataclass(frozen=True, kw_only=True)
class FeetFigures:
    """The feet on which a piece without supports stands, as cut; `tip_deg`: it comes back from there."""

    count: int
    area_mm2: float
    least_mm2: float
    tip_deg: float | None


@dataclass(frozen=True)
class Turning:
    """The angle by which a piece is turned for each view, and how far its picture then lies off."""

    angles_deg: Mapping[str, float]
    aside_mm: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Print:
    """The printed piece: its size, its mount, its pose, its cost."""

    volume_mm3: float
    mass_g: float
    bounding_box_mm: Extent | None
    depth_ratio: float | None
    printer: str
    printer_title: str | None = None
    mount: MountFigures | None = None
    time_s: float | None = None
    filament_m: float | None = None
    filament_g: float | None = None
    support_g: float | None = None
    support_share: float | None = None
    drawings: tuple[str, ...] | None = None
    setup: tuple[SetupSteps, ...] | None = None
    turning: Turning | None = None
    pose: PoseFigures | None = None
    plate: PlateFigures | None = None
    roots: RootsFigures | None = None
    supports: SupportFigures | None = None
    bars: BarFigures | None = None
    feet: FeetFigures | None = None
    parts: int | None = None


@dataclass(frozen=True)
class SlicerWarning:
    """One warning: what it says; what it means for this part; whether that settles it.

    `explanation` is empty if there is none. A warning that is not settled fails the part.
    """

    text: str
    explanation: str = ""
    settled: bool = False


@dataclass(frozen=True)
class SlicerCheck:
    """One of knotfab's own checks of how the slicer read the file."""

    name: str
    status: Status
    measured: float | None
    limit: float | None
    unit: str
    detail: str

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return self.status == "pass"


@dataclass(frozen=True, kw_only=True)
class SlicerFigures:
    """The slicer's figures for the files, or the reason that there are none."""

    program: str | None = None
    version: str | None = None
    time_s: float | None = None
    filament_m: float | None = None
    filament_g: float | None = None
    support_m: float | None = None
    layers: int | None = None
    retractions: int | None = None
    starts_per_layer: float | None = None
    objects: int | None = None
    reason: str | None = None
    remedy: str | None = None
    warnings: tuple[SlicerWarning, ...]
    checks: tuple[SlicerCheck, ...]
    command: str | None = None
    profile: Mapping[str, str] | None = None
    seconds: float | None = None
