"""Move several views so that their pictures agree better: order, sides, azimuths, heights, mirror images.

Moves are rated by the lowest bound of the visual hull. Where pictures may be bent afterwards, the hull is
also computed with masks that are wider by what bending mends easily.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import permutations, product

import numpy as np

from knotfab.base.arrays import Mask
from knotfab.design.frames import frame_view
from knotfab.design.hull import HullBound, hull_bounds
from knotfab.picture.read import Target
from knotfab.picture.silhouette import fit_size, sample_mask
from knotfab.scene.camera import cameras_of, least_apart, walls_of
from knotfab_formats.scene import ResolvedScene, ResolvedView
from knotfab_formats.views import View

_WORTH = 0.004  # gain of the lowest bound (IoU) for which a move is made
_COARSE_PX, _COARSE_RAYS, _COARSE_STEPS = 96, 56, 72  # resolution while moves are compared
_TURNS_DEG = (16.0, 8.0)  # turns of one view, in two rounds
_APART_DEG = 0.6  # least angle between lines of sight, as a share of the angle at equal spacing
_SHIFTS = (0.03, 0.015)  # shifts of one frame, as shares of its height, in two rounds
_NEAR = 0.03  # displacement that bending reaches easily, as a share of the height
_BEST = 24  # number of equally spaced arrangements that are also tried at closer angles
_CLOSER = 0.66  # those angles over equal ones: narrow pictures gather around a wide one's side


def reach_of(views: Sequence[ResolvedView]) -> float:
    """Return the radius about the origin that is clear of every wall and light, mm."""
    return min(
        min(0.97 * v.wall_distance_mm if v.kind == "shadow" else np.inf, 0.5 * v.light_distance_mm)
        for v in views
    )


def worst_of(bounds: Sequence[HullBound]) -> float:
    """Return the lowest bound (IoU) of all views."""
    return min(b.iou for b in bounds)


def framed_views(views: Sequence[View], targets: Sequence[Target]) -> list[ResolvedView]:
    """Return the views with both sides of their frames."""
    return [frame_view(v, t) for v, t in zip(views, targets, strict=True)]


def bounds_of(
    views: Sequence[View],
    targets: Sequence[Target],
    masks: Sequence[Mask] | None = None,
    rays_px: int = 192,
    steps: int = 240,
    wider: float = 0.0,
    extents: bool = False,
) -> tuple[HullBound, ...]:
    """Return the visual hull's bound of each view.

    Args:
        masks: silhouettes to take instead of the targets'.
        rays_px, steps, wider, extents: as for `hull_bounds`.
    """
    views = framed_views(views, targets)
    cameras = cameras_of(views, targets)
    if masks is None:
        masks = [t.mask for t in targets]
    small = [c.resized(m.shape[1], m.shape[0]) for c, m in zip(cameras, masks, strict=True)]
    return hull_bounds(
        small,
        masks,
        reach_of(views),
        rays_px,
        steps,
        wider=wider,
        walls=walls_of(views),
        extents=extents,
    )


def coarse_masks(targets: Sequence[Target], side_px: int) -> list[Mask]:
    """Sample the silhouettes so that their longer sides have `side_px` pixels."""
    size = partial(fit_size, longer=side_px)
    return [sample_mask(t.mask, *size(t.width, t.height)) for t in targets]


def move_views(scene: ResolvedScene, targets: Sequence[Target], bent: bool) -> ResolvedScene:
    """Move the views to where the lowest bound is highest; return the same scene if little is gained.

    Args:
        bent: whether pictures may be bent afterwards.
    """
    masks = coarse_masks(targets, _COARSE_PX)
    widths = (0.0, _NEAR) if bent else (0.0,)

    def value(trial: ResolvedScene) -> float:
        found = [
            bounds_of(trial.views, targets, masks, _COARSE_RAYS, _COARSE_STEPS, w) for w in widths
        ]
        worst = float(np.mean([worst_of(bounds) for bounds in found]))
        return worst + 0.1 * float(np.mean([b.iou for bounds in found for b in bounds]))

    def within_reach(trial: ResolvedScene) -> bool:
        near = bounds_of(trial.views, targets, masks, _COARSE_RAYS, _COARSE_STEPS, widths[-1])
        # bending mends a bound above this easily, so closer angles are not tried
        return worst_of(near) > 0.97

    first = [v.azimuth_deg for v in scene.views]
    tried = [(value(_at_azimuths(scene, places)), places) for places in _arrangements(first)]
    tried.sort(reverse=True)
    if not within_reach(_at_azimuths(scene, tried[0][1])):
        # a picture seen from closer directions reaches deeper, and is drawn less well
        closer = [p for _, places in tried[:_BEST] for p in _closer(places)]
        tried += [(value(_at_azimuths(scene, places)), places) for places in closer]
    best, most = scene, value(scene) + _WORTH
    if max(tried)[0] > most:
        most, places = max(tried)
        best = _at_azimuths(scene, places)
    apart = _APART_DEG * 180.0 / len(targets)
    for turn, shift in zip(_TURNS_DEG, _SHIFTS, strict=True):
        for n in range(len(targets)):
            for trial in _nearby(best, targets, n, turn, shift):
                if least_apart(trial.views) >= apart and (found := value(trial)) > most + _WORTH:
                    best, most = trial, found
    return best


def mirror_views(scene: ResolvedScene, targets: Sequence[Target]) -> ResolvedScene:
    """Mirror pictures if that makes all agree better, but neither text nor the first picture."""
    masks = coarse_masks(targets, _COARSE_PX)
    best, most = scene, -1.0
    may = [(False,) if n == 0 or t.is_text else (False, True) for n, t in enumerate(targets)]
    for sides in product(*may):
        turned = [m[:, ::-1] if side else m for m, side in zip(masks, sides, strict=True)]
        found = worst_of(bounds_of(scene.views, targets, turned, _COARSE_RAYS, _COARSE_STEPS))
        if found > most + _WORTH:
            most = found
            views = (
                v.but(mirrored=side or None) for v, side in zip(scene.views, sides, strict=True)
            )
            best = scene.but(views=tuple(views)) if any(sides) else scene
    return best


def _arrangements(azimuths: Sequence[float]) -> Iterator[tuple[float, ...]]:
    """Yield the azimuths in other orders, each from the front or from behind; not all for many views."""
    count = len(azimuths)
    orders = ((0, *rest) for rest in permutations(range(1, count)))
    sides = list(product((0.0, 180.0), repeat=count))
    for tried, (order, side) in enumerate(product(orders, sides)):
        if side[0] or tried >= 160 * (2 if count < 6 else 1):
            continue
        yield tuple(azimuths[k] + s for k, s in zip(order, side, strict=True))


def _closer(azimuths: Sequence[float]) -> Iterator[tuple[float, ...]]:
    """Yield azimuths drawn together, each time around another arc of the views' lines of sight."""
    order = sorted(range(len(azimuths)), key=lambda n: azimuths[n] % 180.0)
    for cut in range(len(order)):
        # lines of sight before the cut continue half a turn further on
        half = {n: azimuths[n] % 180.0 + (180.0 if k < cut else 0.0) for k, n in enumerate(order)}
        start = half[order[cut]]
        drawn = [a + (_CLOSER - 1.0) * (half[n] - start) for n, a in enumerate(azimuths)]
        yield tuple(azimuths[0] + a - drawn[0] for a in drawn)


def _at_azimuths(scene: ResolvedScene, azimuths: Sequence[float]) -> ResolvedScene:
    views = tuple(
        v.but(azimuth_deg=float(a % 360.0)) for v, a in zip(scene.views, azimuths, strict=True)
    )
    return scene.but(views=views)


def _nearby(
    scene: ResolvedScene, targets: Sequence[Target], number: int, turn: float, shift: float
) -> Iterator[ResolvedScene]:
    """Yield the scene with one view turned, or its frame shifted, to either side; view 0 is not turned."""
    view = scene.views[number]
    height = framed_views(scene.views, targets)[number].frame_height_mm
    changes = [{"azimuth_deg": (view.azimuth_deg + s * turn) % 360.0} for s in (1, -1) if number]
    changes += [{"frame_up_mm": round(view.frame_up_mm + s * shift * height, 4)} for s in (1, -1)]
    for change in changes:
        views = list(scene.views)
        views[number] = view.but(**change)
        yield scene.but(views=tuple(views))
