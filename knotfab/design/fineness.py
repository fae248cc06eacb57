"""Facets and vertices as close together as the check of the outline asks for."""

from __future__ import annotations

import numpy as np

from knotfab.geometry.tube import sides_for
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.search import SearchSettings

__all__ = ["fine_enough", "outline_px"]


def fine_enough(
    settings: SearchSettings, radius_mm: float, bend_mm: float, allowed_mm: float
) -> SearchSettings:
    """The settings with facets and vertices close enough for the outline to stay within `allowed_mm`.

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


def outline_px(scene: ResolvedScene, settings: SearchSettings) -> float:
    """Return how far the file's shadow may be off the exact tube's: the scene's word, or the accuracy's."""
    asked = scene.accuracy.max_outline_error_px
    return settings.outline_px if asked is None else asked
