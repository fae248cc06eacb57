"""Tell where a build's time went, and what the next better setting would buy and cost on this piece."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from knotfab_formats.search import PRESETS

__all__ = ["add_next_step", "tell_stages"]

Record = dict[str, Any]

_MEASURED = Path(__file__).with_name("next_step.json")
_SHARE = 0.07  # a shorter stage, as a share of the whole, is not worth a word
_WORK = (
    *("method", "coarse_px", "fine_px"),
    *("coarse_iterations", "fine_iterations", "settle_iterations"),
)
_IOUS = ("iou_drawn", "iou_frame", "iou")
_LEAST_GAIN = 5e-5  # the least IoU that a sentence can say


def add_next_step(report: Record) -> None:
    """Add `next_step` to a report, where its build took the settings of an accuracy that has a better one.

    It has none with a budget, nor where the search had other iterations or pixels than the accuracy's. An
    estimate: the stages take as many times longer as they did on the pictures that were measured, and the
    error shrinks as theirs did, of several views down to the bound that their visual hull leaves.
    """
    settings, views = report["settings"], report["views"]
    # a stand outside the picture is not what a better search would draw better
    found = [next((view[k] for k in _IOUS if view.get(k) is not None), None) for view in views]
    ious = [iou for iou in found if iou is not None]
    if settings.get("time_budget_s") is not None or not ious or len(ious) < len(views):
        return
    study = _study()
    names = [step["accuracy"] for step in study["steps"]]
    if settings["accuracy"] not in names[:-1]:
        return
    if not _as_preset(settings, 1 if "sequence" in settings else len(views)):
        return
    here = names.index(settings["accuracy"])
    own, better = study["steps"][here], study["steps"][here + 1]
    # no search draws what other views forbid
    bound = views[ious.index(min(ious))].get("bound", 1.0)
    gain = max(bound - min(ious), 0.0) * (1.0 - better["error"] / own["error"])
    more = sum(
        report["timings"].get(stage, 0.0) * (better["seconds"].get(stage, seconds) / seconds - 1.0)
        for stage, seconds in own["seconds"].items()
    )
    bought = f"about {100 * gain:.1g}%" if gain > _LEAST_GAIN else "hardly"
    longer = f"in about {more:.0f} s more" if more >= 0.5 else "in about the same time"
    report["next_step"] = {
        "accuracy": better["accuracy"],
        "iou_gain": gain,
        "seconds_more": more,
        "sentence": f"--accuracy {better['accuracy']} would come {bought} nearer to the picture {longer} "
        f"(an estimate by {study['pictures']} pictures).",
    }


def _as_preset(settings: Record, views: int) -> bool:
    """Tell whether a search had the iterations and pixels of its accuracy's preset, for so many views."""
    preset = PRESETS[settings["accuracy"]]
    preset = preset.scaled(views) if views > 1 else preset
    return all(settings["search"][key] == getattr(preset, key) for key in _WORK)


def tell_stages(timings: Mapping[str, float]) -> str:
    """The seconds in all, and of the stages that took most of them."""
    total = timings["total"]
    most = sorted(((s, name) for name, s in timings.items() if name != "total"), reverse=True)
    stages = ", ".join(f"{name} {s:.1f}" for s, name in most if s > _SHARE * total)
    return f"{total:.1f} s" + (f": {stages}" if stages else "")


@cache
def _study() -> Record:
    """Return what was measured for each accuracy: the mean error, 1 - IoU, and seconds by stage."""
    found: Record = json.loads(_MEASURED.read_text("utf-8"))
    return found
