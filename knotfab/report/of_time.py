"""Tell where a build's time went, and what the next better setting would buy and cost on this piece."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from knotfab_formats.report import NextStep, Report, Settings
from knotfab_formats.search import PRESETS

__all__ = ["plan_next_step", "tell_stages"]

_MEASURED = Path(__file__).with_name("next_step.json")
_SHARE = 0.07  # a shorter stage, as a share of the whole, is not worth a word
_WORK = (
    *("method", "coarse_px", "fine_px"),
    *("coarse_iterations", "fine_iterations", "settle_iterations"),
)


def plan_next_step(report: Report, timings: Mapping[str, float]) -> NextStep | None:
    """Give what a better accuracy would bring, where a build took the settings of one that has a better one.

    There is none with a budget, nor where the search had other iterations or pixels than the accuracy's. An
    estimate: the stages take as many times longer as they did on the pictures that were measured, and the
    error shrinks as theirs did, of several views down to the bound that their visual hull leaves.
    """
    settings, views = report.settings, report.views
    # a stand outside the picture is not what a better search would draw better
    ious = [view.iou_drawn if view.iou_drawn is not None else view.iou_frame for view in views]
    if settings.time_budget_s is not None or not ious:
        return None
    study = _study()
    names = [step["accuracy"] for step in study["steps"]]
    if settings.accuracy not in names[:-1]:
        return None
    if not _as_preset(settings, len(views) if settings.sequence is None else 1):
        return None
    here = names.index(settings.accuracy)
    own, better = study["steps"][here], study["steps"][here + 1]
    # no search draws what other views forbid
    bound = views[ious.index(min(ious))].bound
    gain = max((1.0 if bound is None else bound) - min(ious), 0.0) * (
        1.0 - better["error"] / own["error"]
    )
    more = sum(
        timings.get(stage, 0.0) * (better["seconds"].get(stage, seconds) / seconds - 1.0)
        for stage, seconds in own["seconds"].items()
    )
    # the least IoU that a sentence can say
    bought = f"about {100 * gain:.1g}%" if gain > 5e-5 else "hardly"
    longer = f"in about {more:.0f} s more" if more >= 0.5 else "in about the same time"
    return NextStep(
        accuracy=better["accuracy"],
        iou_gain=gain,
        seconds_more=more,
        sentence=f"--accuracy {better['accuracy']} would come {bought} nearer to the picture {longer} "
        f"(an estimate by {study['pictures']} pictures).",
    )


def _as_preset(settings: Settings, views: int) -> bool:
    """Tell whether a search had the iterations and pixels of its accuracy's preset, for so many views."""
    preset = PRESETS[settings.accuracy]
    preset = preset.scaled(views) if views > 1 else preset
    return all(getattr(settings.search, key) == getattr(preset, key) for key in _WORK)


def tell_stages(timings: Mapping[str, float]) -> str:
    """Return the seconds in all, and of the stages that took most of them."""
    total = timings["total"]
    most = sorted(((s, name) for name, s in timings.items() if name != "total"), reverse=True)
    stages = ", ".join(f"{name} {s:.1f}" for s, name in most if s > _SHARE * total)
    return f"{total:.1f} s" + (f": {stages}" if stages else "")


@cache
def _study() -> dict[str, Any]:
    """Return what was measured for each accuracy: the mean error, 1 - IoU, and seconds by stage."""
    found: dict[str, Any] = json.loads(_MEASURED.read_text("utf-8"))
    return found
