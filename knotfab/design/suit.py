"""Settings that suit what is asked: how smoothly knots run, how fine pictures are, how many steps."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from knotfab.design.candidates import line_radius
from knotfab.design.question import Question
from knotfab.geometry.tube import sides_for
from knotfab_formats.scene import VERIFIED_PX, Accuracy
from knotfab_formats.search import SearchSettings

__all__ = ["GRACE", "fine_enough", "outline_px", "suit"]

# factors of the preset's grace, and what it counts, beside filled areas of one picture
GRACE = {
    "lines": (4.0, "curves"),  # a line shows every wave of its tube
    "wire": (10.0, "bends"),  # every one is to be made by hand
    "several": (2.65, "curves"),  # several pictures pull together, and wrinkle strands more
}
_LINE_PX = 5.0  # px of the fine picture to the width of a line


def suit(settings: SearchSettings, question: Question, given: Collection[str]) -> SearchSettings:
    """Return the settings for this question; those of the names `given` stay as they are.

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
    """Return pictures fine enough for lines, which are thinner than what the presets were measured on."""
    view = question.views[0]
    pixels = _LINE_PX * view.longer_mm / (2.0 * line_radius(view) * view.magnification)
    return {
        "fine_px": max(settings.fine_px, min(round(pixels), VERIFIED_PX)),
        "coarse_px": max(settings.coarse_px, min(round(0.5 * pixels), VERIFIED_PX)),
    }


def fine_enough(
    settings: SearchSettings, radius_mm: float, bend_mm: float, allowed_mm: float
) -> SearchSettings:
    """Return the settings with facets and vertices close enough for the outline to stay within `allowed_mm`.

    A ring of m corners stands out from the round tube by r a² / 12, a = 2 pi / m, and a mitre between
    edges e that turn by the most a bend radius R allows, tan(angle / 2) = e / 2R, by
    r (sqrt(1 + (e / 2R)²) - 1). The first may take a third and the second a half; the rest is for
    edges that are not quite even.
    """
    edge = 2.0 * bend_mm * float(np.sqrt((1.0 + 0.5 * allowed_mm / radius_mm) ** 2 - 1.0))
    return settings.but(
        mesh_sides=max(settings.mesh_sides, sides_for(radius_mm, allowed_mm / 3)),
        settle_edge_radii=min(settings.settle_edge_radii, max(0.1, round(edge / radius_mm, 4))),
    )


def outline_px(accuracy: Accuracy, settings: SearchSettings) -> float:
    """Return how far the file's shadow may be off the exact tube's: the scene's word, or the accuracy's."""
    asked = accuracy.max_outline_error_px
    return settings.outline_px if asked is None else asked
