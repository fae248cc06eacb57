"""Measure the loss when lamp, eye, piece or wall are not quite where the scene says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Misplacement, Move, WorstMove
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.compare import overlap, turn_view
from knotfab_validators.shadows.renderer import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.scene import Placing, Switches

__all__ = ["Likeness", "fit_likeness", "measure_misplacement", "moves_apart", "parting_px"]


PARTING_TOLERANCES = 4.0  # a shadow whose parts stay together within so many has merely moved


@dataclass(frozen=True)
class Likeness:
    """A shift, scale and turn on the receiver: place + `turn` @ place + `shift`, mm from its pixel (0, 0).

    `left_mm`: the largest distance that it leaves between points fitted by it.
    """

    turn: Array  # (2, 2): of scale and turn, less 1
    shift: Array  # (2,)
    left_mm: float

    def move(self, geometry: ViewGeometry) -> ViewGeometry:
        """Return a view whose pixels lie where the likeness takes those of `geometry`."""
        across = np.stack([geometry.du, geometry.dv])
        long = np.linalg.norm(across, axis=1)
        unit = across / long[:, None]
        return replace(
            geometry,
            origin=geometry.origin + self.shift @ unit,
            du=geometry.du + long[0] * self.turn[:, 0] @ unit,
            dv=geometry.dv + long[1] * self.turn[:, 1] @ unit,
        )


def fit_likeness(points: Array, geometry: ViewGeometry, moved: ViewGeometry) -> Likeness:
    """Fit a likeness (least squares) to the shadows of points (n, 3) when light or piece are `moved`.

    Both views have the same pixels on the receiver as it is seen from the piece.
    """
    size = np.array([np.linalg.norm(geometry.du), np.linalg.norm(geometry.dv)])
    (was, _), (now, _) = geometry.project(points), moved.project(points)
    was, off = was * size, (now - was) * size
    middle, shift = was.mean(axis=0), off.mean(axis=0)
    x, y = was - middle, off - shift
    spread = max(float((x * x).sum()), 1e-12)
    scale = float((x * y).sum()) / spread
    angle = float((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum()) / spread
    turn = np.array([[scale, -angle], [angle, scale]])
    left = np.linalg.norm(y - x @ turn.T, axis=1)
    return Likeness(turn, shift - turn @ middle, float(left.max()))


def _moved_views(
    middle: Array, geometry: ViewGeometry, placing: Placing, turns: bool
) -> Iterator[tuple[str, str, ViewGeometry]]:
    """Yield the thing that is moved, which way, and the view that results (turned about an axis).

    What hangs on the wall (not `turns`) leans with it, which is the light turned the other way.
    """
    axes = {"right": geometry.right, "up": geometry.up, "towards": geometry.axis}
    for way, axis in axes.items() if placing.lamp_mm > 0 else ():
        yield "lamp", way, replace(geometry, light=geometry.light + placing.lamp_mm * axis)
    for way, axis in axes.items() if turns and placing.turn_deg > 0 else ():
        turned = turn_view(geometry, middle, axis, np.radians(placing.turn_deg))
        yield "turn", "axis" if way == "towards" else way, turned
    for way, side in (("right", geometry.du), ("up", geometry.dv)) if placing.tilt_deg > 0 else ():
        axis = side / np.linalg.norm(side)
        turned = turn_view(geometry, geometry.middle, axis, np.radians(placing.tilt_deg))
        one, other = (turned, geometry) if turns else (geometry, turned)
        yield "tilt", way, replace(one, light=other.light)


def parting_px(
    points: Array, middle: Array, geometry: ViewGeometry, placing: Placing, *, turns: bool = True
) -> float:
    """Measure how far shadows of points (n, 3) part from their best likeness in the worst move, pixels."""
    views = _moved_views(middle, geometry, placing, turns)
    left = [fit_likeness(points, geometry, moved).left_mm for _, _, moved in views]
    return max(left, default=0.0) / geometry.pixel_mm


def moves_apart(effects: Switches, parting: float, tolerance_px: float = 0.25) -> bool:
    """Tell whether moves are rendered: the scene says so, or parts of the shadow move apart visibly."""
    if effects.misplacement is not None:
        return effects.misplacement
    return parting > PARTING_TOLERANCES * tolerance_px


def measure_misplacement(
    renderer: Renderer,
    points: Array,
    middle: Array,
    geometry: ViewGeometry,
    target: Mask,
    placing: Placing,
    *,
    parting: float,
    turns: bool = True,
    within: Mask | None = None,
) -> Misplacement:
    """Measure the IoU with lamp (or eye), piece and wall moved for real, each one way; and by its likeness.

    As it is, the picture stays where it is on the wall, so that a shadow which merely moves counts as lost
    too. By its likeness the picture is shifted, scaled and turned as the shadow of `points` was, which is
    how a person sees it; the better one of both counts.

    Args:
        renderer: renderer of the part, in the coordinates of `geometry`. points: (n, 3) mm, the centre lines.
        middle: (3,) mm, what the piece turns about.
        target: (H, W), the picture's silhouette on the grid of `geometry`.
        turns: whether the piece can turn against the wall: not one that is mounted on it.
        within: (H, W) of it, where shadow counts: a stand's shows below the frame. None: everywhere.
        parting: what `parting_px` says.
    """

    def iou(seen: ViewGeometry) -> float:
        shadow = renderer.render(seen)
        return overlap(shadow if within is None else shadow & within, target).iou

    best = iou(geometry)
    ious: dict[str, dict[str, Move]] = {"lamp": {}, "turn": {}, "tilt": {}}
    samples = 1
    for of, way, moved in _moved_views(middle, geometry, placing, turns):
        raw = iou(moved)
        like = fit_likeness(points, geometry, moved).move(moved)
        fitted = max(raw, iou(like))
        ious[of][way] = Move(raw, fitted)
        samples += 2
    each = [
        WorstMove(move.raw, move.fitted, of, way)
        for of, ways in ious.items()
        for way, move in ways.items()
    ]

    def lost(of: str, ways: tuple[str, ...], step: float) -> dict[str, float]:
        found = {way: ious[of][way].raw if way in ious[of] else best for way in ways}
        return {way: max(0.0, best - iou) / max(step, 1e-9) for way, iou in found.items()}

    tilts = bool(ious["tilt"])
    return Misplacement(
        parting_px=parting,
        lamp_mm=placing.lamp_mm,
        turn_deg=placing.turn_deg,
        iou=best,
        lamp_iou=ious["lamp"],
        worst=min(each, key=lambda move: move.fitted, default=None),
        samples=samples,
        lamp_iou_per_mm=lost("lamp", ("right", "up", "towards"), placing.lamp_mm),
        turn_iou=ious["turn"] if turns else None,
        turn_iou_per_deg=lost("turn", ("right", "up", "axis"), placing.turn_deg) if turns else None,
        tilt_deg=placing.tilt_deg if tilts else None,
        tilt_iou=ious["tilt"] if tilts else None,
        tilt_iou_per_deg=lost("tilt", ("right", "up"), placing.tilt_deg) if tilts else None,
    )
