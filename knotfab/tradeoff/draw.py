"""The trade-off as a figure: what is missing to the picture against seconds, both on log scales."""

from __future__ import annotations

import io
from itertools import product

from knotfab.tradeoff.explore import Explored
from knotfab.tradeoff.points import COMBINED, PRESET

__all__ = ["draw"]

_COLORS = (
    "#1f4e79", "#c55a11", "#548235", "#7f6000", "#7030a0", "#a61c3c",
    "#2e8b8b", "#8c564b", "#d18f00", "#5b6abf", "#b05fa0", "#3f7f3f",
)  # fmt: skip
_MARKERS = ("o", "^", "v")  # the colours' first turn, their second, ...
_SAID = {"cpu": "CPU seconds", "wall": "seconds"}


def draw(explored: Explored, title: str) -> bytes:
    """Draw a PNG of the points, knob by knob, with the frontier as a line and the presets by name.

    Hollow: measured on fewer pictures than the frontier, or bending more, or read more plainly from aside,
    than the frontier's may.
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
        knob, (seconds, error) = m.point.knob, explored.place(m)
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
