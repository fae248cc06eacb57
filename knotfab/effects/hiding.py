"""Hiding: a piece near its wall stands before its own shadow for those who look from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.effects.base import Effect, EffectContext, Shadows
from knotfab_formats.verdict import Hiding

if TYPE_CHECKING:
    from shapely import Geometry

ASIDE_DEG = (30, 45)  # where far viewers stand, to the left and right of the wall's middle
_STEP_MM = 2.0  # along the shadow's edge
_WITHIN_MM = 0.1  # by how much a strand that is drawn with fewer vertices may be off
NOTICED = (
    0.1  # share of the edge hidden from 30° from which on it is told; pegs leave about as much
)
_GAPS_MM = (10.0, 20.0, 40.0, 60.0, 80.0, 120.0, 160.0, 240.0)  # tried, as a person sets them


def magnitude(context: EffectContext) -> float:
    """Return the largest share of a shadow's width that the piece can hide from viewers 30° to the side."""
    return max(
        (
            _bound(seen, context.radius)
            for seen in context.shadows
            if seen.view.kind != "eye" and len(seen.places)
        ),
        default=0.0,
    )


def _bound(seen: Shadows, radius: float) -> float:
    """Bound the hidden share in one view, the mean of both sides, as if the piece filled its own width."""
    wall, places = seen.wall, seen.places
    rim = radius * wall.lamp[2] / (wall.lamp[2] - places[:, 2].max())
    shadow = wall.cast(places)[:, 0]
    left, right = shadow.min() - rim, shadow.max() + rim
    aside, covered = np.tan(np.deg2rad(ASIDE_DEG[0])), 0.0
    thick = radius / np.cos(np.deg2rad(ASIDE_DEG[0]))
    for way in (aside, -aside):
        at = places[:, 0] + way * places[:, 2]
        covered += max(0.0, min(right, at.max() + thick) - max(left, at.min() - thick))
    return float(0.5 * covered / (right - left))


def hide_edge(seen: Shadows, lines: Sequence[Array], radius: float) -> Hiding:
    """Measure the share of the shadow's edge that strands hide from far viewers at either side.

    If it exceeds a tenth from 30°, the least of a few gaps is found that, added to the piece's distance from
    the wall, brings it down to that.

    Args:
        seen: the view. lines: closed centre lines [(n, 3) mm], in the axes of its wall.
    """
    first = ASIDE_DEG[:1]

    def stays_noticed(gap_mm: float) -> bool:
        moved = [line + [0.0, 0.0, gap_mm] for line in lines]
        return _hidden(seen, moved, radius, first)[0] > NOTICED

    hidden = _hidden(seen, lines, radius, ASIDE_DEG)
    tried = _GAPS_MM if hidden[0] > NOTICED else ()
    gap = next((gap for gap in tried if not stays_noticed(gap)), None)
    shares = zip(ASIDE_DEG, hidden, strict=True)
    return Hiding({str(angle): round(share, 3) for angle, share in shares}, gap)


def _hidden(
    seen: Shadows, lines: Sequence[Array], radius: float, angles_deg: Sequence[float]
) -> list[float]:
    """Return the hidden share from each angle, the mean of both sides.

    Seen from the side the wall looks narrower, and each strand appears displaced by its height times
    the tangent of the angle.
    """
    import shapely

    wall = seen.wall
    middle = float(np.mean(np.concatenate(lines)[:, 2]))
    wide = radius * wall.lamp[2] / (wall.lamp[2] - middle)
    shadow = draw_strands([wall.cast(line) for line in lines], wide)
    edge = shapely.segmentize(shadow.boundary, _STEP_MM)
    parts = [np.array(part.coords) for part in shapely.get_parts(edge)]
    middles = np.concatenate([(part[1:] + part[:-1]) / 2 for part in parts])
    long = np.concatenate([np.linalg.norm(np.diff(part, axis=0), axis=1) for part in parts])

    def hide(angle: float) -> float:
        sight = np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0]])
        over = draw_strands([line @ sight.T for line in lines], radius)
        shapely.prepare(over)
        places = middles @ sight[:, :2].T
        return float(long[shapely.contains_xy(over, *places.T)].sum() / long.sum())

    return [0.5 * (hide(angle) + hide(-angle)) for angle in np.deg2rad(angles_deg).tolist()]


def draw_strands(lines: Sequence[Array], wide: float) -> Geometry:
    """Return the union of closed lines (n, 2) widened by `wide` on either side."""
    import shapely

    rings = [shapely.LineString(np.append(line, line[:1], axis=0)) for line in lines]
    return shapely.union_all([ring.simplify(_WITHIN_MM).buffer(wide) for ring in rings])


HIDING = Effect(
    "hiding",
    "of 1",
    magnitude,
    0.4,  # a tenth of the shadow's width, at standard accuracy
    "the piece stands so near the wall that it hides its shadow from viewers aside",
)
