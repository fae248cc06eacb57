"""The trade-off as a figure: what is missing to the picture against seconds, both on log scales."""

from __future__ import annotations

import io
from collections.abc import Sequence

from knotfab.tradeoff.measure import Measured, frontier

__all__ = ["draw"]

_COLORS = ("#1f4e79", "#c55a11", "#548235", "#7f6000", "#7030a0", "#a61c3c")
_LEAST = 1e-4  # an IoU of 1 has no place on a log scale


def draw(measured: Sequence[Measured], title: str) -> bytes:
    """PNG of the points, knob by knob, with the frontier as a line and the presets by name."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.2), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    knobs = list(dict.fromkeys(m.point.knob for m in measured if m.point.knob != "preset"))
    for color, knob in zip(_COLORS * len(knobs), knobs, strict=False):
        rows = [m for m in measured if m.point.knob == knob]
        axes.scatter(
            [m.seconds for m in rows],
            [max(1 - m.iou, _LEAST) for m in rows],
            s=22,
            color=color,
            label=knob,
            zorder=2,
        )
    best = frontier(measured)
    axes.step(
        [m.seconds for m in best],
        [max(1 - m.iou, _LEAST) for m in best],
        where="post",
        color="#888888",
        linewidth=1.2,
        zorder=1,
        label="frontier",
    )
    for m in measured:
        if m.point.knob != "preset":
            continue
        at = (m.seconds, max(1 - m.iou, _LEAST))
        axes.scatter(*at, s=70, color="black", marker="D", zorder=3)
        axes.annotate(m.point.label, at, xytext=(7, 5), textcoords="offset points", fontsize=9)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("seconds, search and sweep")
    axes.set_ylabel("1 - IoU")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="both", linewidth=0.3, color="#cccccc")
    axes.legend(fontsize=8, frameon=False)
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return written.getvalue()
