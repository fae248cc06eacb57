"""The report of a build: report.json, schema 1 (docs/contract.md), built once from what was measured.

Lengths are in mm, times in seconds and shares and IoU from 0 to 1, unless a name says otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotfab_formats.errors import read_as
from knotfab_formats.print_figures import (
    BarFigures,
    FeetFigures,
    MountFigures,
    PoseFigures,
    Print,
    SlicerFigures,
)
from knotfab_formats.search import SearchSettings
from knotfab_formats.verdict import Check, Colours, Recognition, View


@dataclass(frozen=True, kw_only=True)
class Row:
    """One thing to know or to do, in a sentence without its subject's name.

    `status` is "fail", "warn", "do" or "info"; `where` names a view; `remedy` is the one option that helps.
    """

    name: str
    value: float | str | None = None
    unit: str = ""
    limit: float | str | None = None
    status: str = "info"
    where: str = ""
    remedy: str = ""
    text: str


@dataclass(frozen=True, kw_only=True)
class EffectLine:
    """One effect of light or world: how it was judged, and the stages that ran it."""

    name: str
    simulated: bool
    forced: bool
    where: tuple[str, ...]
    magnitude: float | None
    threshold: float | None
    unit: str
    calls: int
    seconds: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class LimitLine:
    """One limit, its measure at the end, and how often its term was called."""

    name: str
    limit: float
    measured: float
    unit: str
    calls: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class KnotFigures:
    """One knot as it will have shrunk; curvatures are multiplied by the tube's radius, turns are of 360°."""

    type: str
    vertices: int
    length_mm: float
    thickness_mm: float
    min_bend_radius_mm: float
    mean_curvature_radii: float
    curvature_90_radii: float
    turns: float


@dataclass(frozen=True, kw_only=True)
class Price:
    """One limit that binds (or several together), and the IoU with it and without it.

    `needed` is what the knots have that were found without it, in mm: their tightest bend, closest
    centre lines less two radii, extents with the tube, or length. `frame` is that of a sequence.
    """

    limits: tuple[str, ...]
    keys: tuple[str, ...]
    asked: tuple[Any, ...]
    needed: tuple[Any, ...]
    iou: float
    iou_without: float
    met_without: bool
    sentence: str
    frame: int | None = None


@dataclass(frozen=True, kw_only=True)
class NextStep:
    """An estimate of what the next better accuracy would bring and cost."""

    accuracy: str
    iou_gain: float
    seconds_more: float
    sentence: str


@dataclass(frozen=True, kw_only=True)
class RadiusTrial:
    """One radius that was tried, with the IoU of its template and of its start."""

    radius_mm: float
    template_iou: float
    start_iou: float | None


@dataclass(frozen=True, kw_only=True)
class RadiusChoice:
    """The reason for the tube's radius, and what other radii would give."""

    chosen_by: str
    trials: tuple[RadiusTrial, ...]


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """The certificates of a search: that each of its steps keeps the knot type."""

    template: str
    types: tuple[str, ...]
    accepted: int
    shortened: int
    refused: int
    resamplings: int
    resamplings_refused: int
    least_margin_mm: float | None
    repairs: int
    certified: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The motion of vertices from one frame to the next, and its bound."""

    largest_mm: float
    outline_mm: float
    limit_mm: float
    held: bool


@dataclass(frozen=True, kw_only=True)
class SequenceFigures:
    """A sequence as a whole."""

    frames: int
    closing: Motion
    loop: bool


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything needed to repeat the run; `parts`: what each library did, `versions`: theirs."""

    accuracy: str
    seed: int
    command: str
    preview: tuple[str, ...]
    tube_radius_mm: float
    tube_radius: RadiusChoice
    search: SearchSettings
    time_budget_s: float | None
    device: str
    mount: str
    opening_iou: float | None
    start_ious: tuple[float, ...] | None = None
    thickness_mm: float
    certificate: Certificate | None = None
    versions: Mapping[str, str]
    parts: Mapping[str, str]
    sequence: SequenceFigures | None = None


@dataclass(frozen=True, kw_only=True)
class FrameView(View):
    """The view of one frame of a sequence, with what its own part comes to."""

    frame: int
    pieces: int
    knots: int
    part: str
    status: str
    motion: Motion | None
    began_as: int | None
    certificate: Certificate
    mount: MountFigures
    pose: PoseFigures | None = None
    bars: BarFigures | None = None
    feet: FeetFigures | None = None
    time_s: float | None = None
    filament_m: float | None = None
    filament_g: float | None = None
    support_g: float | None = None
    notes: tuple[str, ...]
    failed: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class AttemptFigures:
    """One attempt of a build: a search, a part, or a piece that is written and verified.

    `cpu_s` are those of all its processes. `ended` tells how a search came to its end; what else is made is
    made once. `why_next` is why another attempt followed.
    """

    what: str
    seconds: float
    cpu_s: float
    outcome: str
    ended: str | None = None
    why_next: str | None = None


@dataclass(frozen=True, kw_only=True)
class Report:
    """All that a build measured.

    `status` follows from the checks, `verdict` is that of the worst view; the limits stand among `effects`
    too; `timings` are seconds by stage, and their `total`, `cpu` those of all processes; `notes` are
    sentences that a reader must not miss, `warnings` those without which the verdict would deceive; `rows`
    are what a reader is told of all this, the most pressing first.
    """

    schema: int = 1
    title: str = ""
    status: str
    verdict: Recognition | None
    views: tuple[FrameView | View, ...]
    checks: tuple[Check, ...]
    effects: tuple[EffectLine, ...]
    limits: tuple[LimitLine, ...]
    timings: Mapping[str, float] = field(default_factory=dict)
    cpu: Mapping[str, float] | None = None
    knots: tuple[KnotFigures, ...]
    print: Print
    settings: Settings
    colours: Colours | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] | None = None
    attempts: tuple[AttemptFigures, ...] = ()
    rows: tuple[Row, ...] | None = None
    binding: tuple[Price, ...] | None = None
    slicer: SlicerFigures | None = None
    next_step: NextStep | None = None


def read_report(path: Path) -> Report:
    """Read a report.json.

    Raises:
        OSError, ValueError, TypeError: it cannot be read, or is no report of this version.
    """
    return read_as(Report, json.loads(path.read_text("utf-8")))
