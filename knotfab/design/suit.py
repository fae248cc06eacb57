"""Settings that suit what is asked: how smoothly knots run, how fine pictures are, how many steps."""

from __future__ import annotations

from collections.abc import Collection

from knotfab.design.candidates import line_radius
from knotfab.design.question import Question
from knotfab_formats.scene import VERIFIED_PX
from knotfab_formats.search import SearchSettings

__all__ = ["GRACE", "suit"]

# factors of the preset's grace, and what it counts, beside filled areas of one picture
GRACE = {
    "lines": (4.0, "curves"),  # a line shows every wave of its tube
    "wire": (10.0, "bends"),  # every one is to be made by hand
    "several": (2.65, "curves"),  # several pictures pull together, and wrinkle strands more
}
_LINE_PX = 5.0  # px of the fine picture to the width of a line


def suit(settings: SearchSettings, question: Question, given: Collection[str]) -> SearchSettings:
    """The settings for this question; those of the names `given` stay as they are.

    A build's own scene gives all of them: what is resolved once means the same again.
    """
    views = question.problem.views
    asks: str = question.scene.material.process
    suited = settings
    if len(views) > 1:  # each adds wishes that pull against the others'
        asks, suited = "several", settings.scaled(len(views))
    elif views[0].lines:
        asks, suited = "lines", settings.but(**_fine_lines(settings, question))
    factor, kind = GRACE.get(asks, (1.0, settings.grace_of))
    update = {**suited.model_dump(), "grace": factor * settings.grace, "grace_of": kind}
    return settings.but(**{k: v for k, v in update.items() if k not in given})


def _fine_lines(settings: SearchSettings, question: Question) -> dict[str, int]:
    """Pictures fine enough for lines, which are thinner than what the presets were measured on."""
    view = question.views[0]
    pixels = _LINE_PX * view.longer_mm / (2.0 * line_radius(view) * view.magnification)
    return {
        "fine_px": max(settings.fine_px, min(round(pixels), VERIFIED_PX)),
        "coarse_px": max(settings.coarse_px, min(round(0.5 * pixels), VERIFIED_PX)),
    }
