"""Free moves of several views, which change no picture: order, side, angles, heights, and mirror images.

What counts is the hull's bound of the view that the others leave least of. Pictures may be bent
afterwards, so the others are taken to be wider by what a bending reaches with ease.
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

_WORTH = 0.004  # IoU of the worst bound that a free move has to bring
_COARSE_PX, _COARSE_RAYS, _COARSE_STEPS = 96, 56, 72
_TURNS_DEG = (16.0, 8.0)
_APART_DEG = 0.6  # share of an equal part of half a turn that two lines of sight keep
_SHIFTS = (0.03, 0.015)  # shares of the frame's height
_NEAR = 0.03  # share of the height that a bending reaches with ease
_BEST = 24  # arrangements at equal angles that are tried at closer ones
_CLOSER = 0.66  # share of equal angles: narrow pictures stand about the side of a wide one


def reach_of(views: Sequence[ResolvedView]) -> float:
    """Bound how far from the middle matter may stand: clear of every wall and light, mm."""
    return min(
        min(0.97 * v.clear_mm if v.kind == "shadow" else np.inf, 0.5 * v.light_distance_mm)
        for v in views
    )


def worst_of(bounds: Sequence[HullBound]) -> float:
    """Return the bound of the view that the others leave least of."""
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
    """Return the hull's bounds of views.

    Args:
        masks: silhouettes coarser than the targets'. rays_px, steps, wider, extents: as for `hull_bounds`.
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
    """Return the silhouettes with longer sides of so many pixels."""
    size = partial(fit_size, longer=side_px)
    return [sample_mask(t.mask, *size(t.width, t.height)) for t in targets]


def move_views(scene: ResolvedScene, targets: Sequence[Target], bent: bool) -> ResolvedScene:
    """Return the scene with its views if they leave most of each other; the same if that brings too little.

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
        # bending mends a worst bound above this with ease: closer angles are not tried
        return worst_of(near) > 0.97

    first = [v.azimuth_deg for v in scene.views]
    tried = [(value(_placed(scene, places)), places) for places in _arrangements(first)]
    tried.sort(reverse=True)
    if not within_reach(_placed(scene, tried[0][1])):
        # a picture seen from closer directions reaches deeper, and is drawn less well
        closer = [p for _, places in tried[:_BEST] for p in _closer(places)]
        tried += [(value(_placed(scene, places)), places) for places in closer]
    best, most = scene, value(scene) + _WORTH
    if max(tried)[0] > most:
        most, places = max(tried)
        best = _placed(scene, places)
    apart = _APART_DEG * 180.0 / len(targets)
    for turn, shift in zip(_TURNS_DEG, _SHIFTS, strict=True):
        for n in range(len(targets)):
            for trial in _nearby(best, targets, n, turn, shift):
                if least_apart(trial.views) >= apart and (found := value(trial)) > most + _WORTH:
                    best, most = trial, found
    return best


def mirror_views(scene: ResolvedScene, targets: Sequence[Target]) -> ResolvedScene:
    """Give the scene with those pictures mirrored that agree better so; none of text, and the first never."""
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
    """Yield other orders of the views, each from before or from behind; all of few, of many some."""
    count = len(azimuths)
    orders = ((0, *rest) for rest in permutations(range(1, count)))
    sides = list(product((0.0, 180.0), repeat=count))
    for tried, (order, side) in enumerate(product(orders, sides)):
        # arrangements of views that are tried at most
        if side[0] or tried >= 160 * (2 if count < 6 else 1):
            continue
        yield tuple(azimuths[k] + s for k, s in zip(order, side, strict=True))


def _closer(azimuths: Sequence[float]) -> Iterator[tuple[float, ...]]:
    """Yield the views' lines of sight drawn together, away from each gap between two of them in turn."""
    order = sorted(range(len(azimuths)), key=lambda n: azimuths[n] % 180.0)
    for cut in range(len(order)):
        # behind the cut a line of sight is taken half a turn further on
        half = {n: azimuths[n] % 180.0 + (180.0 if k < cut else 0.0) for k, n in enumerate(order)}
        start = half[order[cut]]
        drawn = [a + (_CLOSER - 1.0) * (half[n] - start) for n, a in enumerate(azimuths)]
        yield tuple(azimuths[0] + a - drawn[0] for a in drawn)


def _placed(scene: ResolvedScene, azimuths: Sequence[float]) -> ResolvedScene:
    views = tuple(
        v.but(azimuth_deg=float(a % 360.0)) for v, a in zip(scene.views, azimuths, strict=True)
    )
    return scene.but(views=views)


def _nearby(
    scene: ResolvedScene, targets: Sequence[Target], number: int, turn: float, shift: float
) -> Iterator[ResolvedScene]:
    """Yield the scene with one view turned, or its frame shifted, a little to either side."""
    view = scene.views[number]
    height = framed_views(scene.views, targets)[number].frame_height_mm
    changes = [{"azimuth_deg": (view.azimuth_deg + s * turn) % 360.0} for s in (1, -1) if number]
    changes += [{"frame_up_mm": round(view.frame_up_mm + s * shift * height, 4)} for s in (1, -1)]
    for change in changes:
        views = list(scene.views)
        views[number] = view.but(**change)
        yield scene.but(views=tuple(views))
