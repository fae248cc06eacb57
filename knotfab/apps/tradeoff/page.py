"""Draw the measured points: tradeoff.html, one interactive page, and tradeoff.png."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import product
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, Protocol

from markupsafe import Markup

from knotfab.apps.tradeoff.bench import Explored
from knotfab.apps.tradeoff.points import COMBINED, PRESET, Measured, Step, list_changes
from knotfab.base.apps import VERSION
from knotfab.picture.raster import hash_script
from knotfab.report import page as report_html
from knotfab.report.page import encode_for_script, make_environment

_HERE = Path(__file__).parent
_STYLE = Path(report_html.__file__).parent / "style.css.j2"
_WIDTH, _HEIGHT = 760.0, 480.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 70.0, 24.0, 18.0, 52.0
_ROOM = 0.06  # margin beyond the outermost points, as a share of the axis
_COLOURS = 12  # colours for knobs; the next twelve knobs use them again, with triangles


class _Words(Protocol):
    """The texts of the page, which `Tradeoff` has."""

    @property
    def title(self) -> str: ...
    @property
    def pictures(self) -> tuple[str, ...]: ...
    def said_left_out(self) -> str: ...


class _Axis:
    """A logarithmic axis that maps values to pixels of the drawing."""

    def __init__(self, values: Sequence[float], first: float, last: float) -> None:
        low, high = log10(min(values)), log10(max(values))
        room = _ROOM * max(high - low, 0.3)
        self.low, self.high, self.first, self.last = low - room, high + room, first, last

    def __call__(self, value: float) -> float:
        share = (log10(value) - self.low) / (self.high - self.low)
        return round(self.first + share * (self.last - self.first), 1)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """(place, label) at 1, 2 and 5 times the powers of ten, and more of them if the axis is short."""
        decades = range(floor(self.low), ceil(self.high) + 1)
        digits = (1, 2, 5) if self.high - self.low > 0.8 else (1, 1.5, 2, 3, 4, 5, 7)
        values = [digit * 10.0**power for power in decades for digit in digits]
        shown = [v for v in values if self.low <= log10(v) <= self.high]
        return [(self(v), f"{v:g}") for v in shown]


def render_page(explored: Explored, steps: Sequence[Step], told: _Words) -> str:
    """Render tradeoff.html, which loads nothing from elsewhere and escapes every text."""
    front = {m.point.settings for m in explored.front}
    measured = sorted(explored.measured, key=lambda m: explored.cost_of(m)[0])
    places = [explored.cost_of(m) for m in measured]
    x = _Axis([seconds for seconds, _ in places], _LEFT, _WIDTH - _RIGHT)
    y = _Axis([error for _, error in places], _HEIGHT - _BOTTOM, _TOP)
    knobs = [k for k in dict.fromkeys(m.point.knob for m in measured) if k != PRESET]
    order = {knob: number for number, knob in enumerate(k for k in knobs if k != COMBINED)}
    shadows = _count_shadows(measured)
    rows = [
        {
            "knob": m.point.knob,
            "label": m.point.label,
            "kind": order.get(m.point.knob, 99 if m.point.knob == COMBINED else -1),
            "x": x(place[0]),
            "y": y(place[1]),
            "front": m.point.settings in front,
            "hollow": explored.sets_apart(m),
            "figures": _list_figures(m.over(explored.compared)),
            "changed": [
                [key, _format(old), _format(new)]
                for key, (old, new) in list_changes(
                    m.point.settings, explored.middle.point.settings
                ).items()
            ],
            "remark": _remark(m, explored),
            "shadows": [
                [told.pictures[k], f"{run.iou:.4f}", run.shadow]
                for k, run in enumerate(m.runs[:shadows])
            ],
        }
        for m, place in zip(measured, places, strict=True)
    ]
    script = (_HERE / "page.js").read_text("utf-8")
    template = make_environment(_HERE).get_template("page.html.j2")
    page: str = template.render(
        title=told.title,
        said=told.said_left_out(),
        pictures=told.pictures,
        compared=explored.compared,
        clock="CPU seconds" if explored.middle.clock == "cpu" else "seconds",
        rows=rows,
        first=next(i for i, m in enumerate(measured) if m.point == explored.middle.point),
        knobs=[(knob, order.get(knob, 99)) for knob in knobs],
        preset=PRESET,
        colours=_COLOURS,
        steps=steps,
        front=_staircase([(x(m.seconds), y(m.error)) for m in explored.front]),
        ticks_x=x.ticks,
        ticks_y=y.ticks,
        size=(_WIDTH, _HEIGHT),
        frame=(_LEFT, _TOP, _WIDTH - _RIGHT, _HEIGHT - _BOTTOM),
        style=Markup(_STYLE.read_text("utf-8")),
        shown=Markup(encode_for_script({"points": rows})),
        script=Markup(script),
        digest=hash_script(script),
        version=VERSION,
    )
    return page


def _count_shadows(measured: Sequence[Measured]) -> int:
    """Return for how many pictures the page has room to show each point's shadow."""
    for count in range(max(len(m.runs) for m in measured), 1, -1):
        # keeps the page below 2 MB
        if sum(len(run.shadow) for m in measured for run in m.runs[:count]) < 1_300_000:
            return count
    return 1


def _remark(m: Measured, explored: Explored) -> str:
    if not m.feasible:
        return "A limit of the tube is not met: no part."
    if len(m.runs) < explored.compared:
        seen = f"{len(m.runs)} of {explored.compared} pictures"
        return f"Measured on {seen}; placed by how it stands to the middle on those."
    if not m.over(explored.compared).keeps(explored.middle.over(explored.compared)):
        return "It bends more, or is read more plainly from aside, than a point on the front may."
    return ""


def _list_figures(m: Measured) -> list[tuple[str, str]]:
    legible = "–" if m.legible is None else f"{m.legible:.2f}"
    return [
        ("CPU seconds" if m.clock == "cpu" else "seconds", f"{m.seconds:.2f}"),
        ("IoU", f"{m.iou:.4f}"),
        ("least IoU", f"{m.least_iou:.4f}"),
        ("outline, px", f"{m.outline_px:.2f}"),
        ("facets, px", f"{m.facet_px:.2f}"),
        ("curvature × r", f"{m.curvature:.3f}"),
        ("read at 45°", legible),
        ("repairs", str(m.repairs)),
        ("pictures", str(len(m.runs))),
    ]


def _staircase(corners: Sequence[tuple[float, float]]) -> str:
    """Write the points of an SVG polyline: the least error that can be had within a given time."""
    path: list[str] = []
    for number, (x, y) in enumerate(corners):
        if number:
            path.append(f"{x},{corners[number - 1][1]}")
        path.append(f"{x},{y}")
    return " ".join(path)


def _format(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


# tradeoff.png

_COLORS = (
    "#1f4e79", "#c55a11", "#548235", "#7f6000", "#7030a0", "#a61c3c",
    "#2e8b8b", "#8c564b", "#d18f00", "#5b6abf", "#b05fa0", "#3f7f3f",
)  # fmt: skip
_MARKERS = ("o", "^", "v")  # for the first twelve knobs, the second twelve, ...
_SAID = {"cpu": "CPU seconds", "wall": "seconds"}


def draw(explored: Explored, title: str) -> bytes:
    """Draw error against seconds as a PNG: points by knob, presets by name, the frontier as a line.

    Hollow points were measured on fewer pictures than the frontier, or may not stand on it.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    figure = Figure(figsize=(8.6, 5.4), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    middle = explored.middle
    knobs = list(dict.fromkeys(m.point.knob for m in explored.measured))
    single = [k for k in knobs if k not in (PRESET, COMBINED)]
    looks = dict(zip(single, product(_MARKERS, _COLORS), strict=False))
    if COMBINED in knobs:
        looks[COMBINED] = ("s", "#9a9a9a")
    for m in explored.measured:
        knob, (seconds, error) = m.point.knob, explored.cost_of(m)
        if knob == PRESET:
            axes.scatter(seconds, error, s=64, color="black", marker="D", zorder=4)
            axes.annotate(
                m.point.label,
                (seconds, error),
                xytext=(7, 5),
                textcoords="offset points",
                fontsize=9.5,
                zorder=5,
            )
            continue
        marker, color = looks[knob]
        axes.scatter(
            seconds,
            error,
            s=24,
            facecolors="none" if explored.sets_apart(m) else color,
            edgecolors=color,
            linewidths=1.0,
            marker=marker,
            zorder=2,
        )
    for knob, (marker, color) in looks.items():
        axes.scatter([], [], s=24, color=color, marker=marker, label=knob)
    best = explored.front
    axes.step(
        [m.seconds for m in best],
        [m.error for m in best],
        where="post",
        color="#555555",
        linewidth=1.3,
        zorder=1,
        label="frontier",
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
        axis.set_minor_formatter("{x:g}")
        axis.set_tick_params(which="both", labelsize=8)
    axes.set_xlabel(f"{_SAID[middle.clock]} a picture: radius, search and sweep")
    axes.set_ylabel("1 − IoU")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="both", linewidth=0.3, color="#cccccc")
    axes.legend(
        fontsize=7.5,
        frameon=False,
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0),
        title="hollow: fewer pictures,\nor bends more, or is\nplainer from aside",
        title_fontsize=7.5,
        alignment="left",
    )
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return written.getvalue()
