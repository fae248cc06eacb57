"""Make several pictures agree before the search: by moves that change no picture, then by bending them.

The visual hull bounds how much of each picture any part can draw (`hull`). Where a bound is below `AGREED`,
the views that may move are moved, and the pictures are bent by the least that removes the rest (`bend`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.design.frames import framed_alike
from knotfab.design.hull import HullBound
from knotfab.design.moves import (
    bounds_of,
    coarse_masks,
    framed_views,
    mirror_views,
    move_views,
    reach_of,
    worst_of,
)
from knotfab.picture.bending import (
    Bending,
    bend_mask,
    keeps_shape,
    measure_bending,
    read_points,
    write_points,
)
from knotfab.picture.read import Change, Target
from knotfab.scene.camera import cameras_of, find_aligned, walls_of
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.views import View

AGREED = 0.995  # pictures whose bounds (IoU) reach this agree: nothing is moved or bent
MOST_BENT = 0.12  # default limit on a point's displacement, as a share of the picture's height
_HOPELESS = 0.5  # bound (IoU) below which no search begins
_SCALED = 12  # attempts to scale a bending back until the picture keeps its pieces and holes
# depth of the deepest place without room, over the picture's longer side: there a strand would stand out of
# another picture as a knob, mostly at the first or last rows
_DEEPEST = 0.004
_SLACK = 0.0008  # error (IoU) of a bound that is measured coarsely
_SAID = 0.001  # shortfall of a bound (IoU) that is not worth a message


@dataclass(frozen=True)
class Agreement:
    """The scene and its targets after moving and bending.

    `lines` describe each change. `bounds` is empty where the hull was not computed.
    """

    scene: ResolvedScene
    targets: tuple[Target, ...]
    lines: tuple[str, ...] = ()
    bounds: tuple[HullBound, ...] = ()


def agree(
    scene: ResolvedScene, targets: Sequence[Target], *, azimuths_open: bool = False
) -> Agreement:
    """Move views and bend pictures, as far as the scene allows, until the visual hull draws all pictures.

    Values that an earlier build settled (`views.bend_points`, `views.mirrored`) are applied unchanged.

    Args:
        azimuths_open: whether the views may be moved because nobody gave their azimuths.

    Raises:
        InputError: two views look along one line.
        SceneError: the other pictures leave nothing of one picture.
    """
    targets = tuple(targets)
    if len(targets) < 2:
        return Agreement(scene, targets)
    if scene.share_wall:
        return Agreement(scene, targets)  # masks of one picture must register with one another
    if any(v.bend_points or v.mirrored for v in scene.views):
        return Agreement(scene, _bent(scene, targets))
    framed, drawn = framed_alike(scene, targets), targets
    bounds = bounds_of(framed.views, targets, extents=True)
    if worst_of(bounds) >= AGREED or any(t.bending is not None for t in targets):
        return Agreement(scene, targets, bounds=bounds)
    require_apart(framed.views)
    lines: list[str] = []
    most = MOST_BENT if scene.piece.bend is None else scene.piece.bend
    first = worst_of(bounds)
    if azimuths_open:
        moved = move_views(framed, targets, most > 0)
        if moved is not framed:
            bounds = bounds_of(moved.views, targets, extents=True)
            framed = moved
            places = ", ".join(
                f"{t.shown} {v.azimuth_deg % 360:g}°"
                for v, t in zip(moved.views, targets, strict=True)
            )
            lines.append(
                f"views moved to {places}: the others leave {worst_of(bounds):.3f} of each picture at least "
                f"instead of {first:.3f}, and no picture is changed"
            )
    elif scene.piece.mirror == "auto":
        mirrored = mirror_views(framed, targets)
        if mirrored is not framed:
            framed, drawn = mirrored, _bent(mirrored, targets)
            bounds = bounds_of(framed.views, drawn, extents=True)
            names = [t.shown for v, t in zip(framed.views, targets, strict=True) if v.mirrored]
            lines.append(f"mirrored, which changes the picture: {', '.join(names)}")
    if worst_of(bounds) < AGREED and most > 0:
        bent_scene, bent = _bend(framed, targets, drawn, bounds, most)
        after = bounds_of(bent_scene.views, bent, extents=True)
        if worst_of(after) > worst_of(bounds):
            framed, drawn, bounds = bent_scene, bent, after
            lines.append(tell_bending(drawn, bounds))
    for target, bound in zip(targets, bounds, strict=True):
        if not bound.covered.any():
            raise SceneError(
                f"picture {target.shown}",
                "the other pictures leave nothing of it: whatever draws it spills in their views",
                "Use pictures that fill the same heights, other azimuths, or more bending (--bend)",
            )
    if most > 0:
        lines += _tell_lacking(framed, targets, bounds, most)
    if framed.views == scene.views:
        return Agreement(scene, targets, tuple(lines), bounds)
    return Agreement(framed, drawn, tuple(lines), bounds)


def apply_bending(view: View, target: Target) -> Target:
    """Mirror and bend a picture as its view says; a target that carries a bending is returned unchanged."""
    if target.bending is not None or not (view.mirrored or view.bend_points):
        return target
    points = read_points(view.bend_points) if view.bend_points else None

    def change(mask: Mask) -> Mask:
        turned = mask[:, ::-1] if view.mirrored else mask
        return turned if points is None else bend_mask(turned, points)

    drawn = change(target.mask)
    judged = drawn if target.judged is target.mask else change(target.judged)
    bending = Bending(0.0, 0.0, 1.0) if points is None else measure_bending(judged, points)
    rule = target.rule + ("; mirrored" if view.mirrored else "")
    if points is not None:
        rule += (
            f"; bent by {bending.rms:.1%} of its height on average and {bending.most:.1%} at most"
        )
    return replace(
        target,
        mask=drawn,
        change=Change(target.asked, judged, bending),
        rule=rule,
        letters=() if view.mirrored and target.is_text else target.letters,
    )


def tell_bending(targets: Sequence[Target], bounds: Sequence[HullBound]) -> str:
    """Describe by how much the pictures are bent and whether they agree then."""
    bendings = [t.bending for t in targets if t.bending is not None]
    rms = float(np.sqrt(np.mean([b.rms**2 for b in bendings])))
    words = {2: "both", 3: "all three", 4: "all four"}
    who = words.get(len(targets), f"all {len(targets)}")
    most = max(b.most for b in bendings)
    digits = 0 if most >= 0.02 else 1
    better = "" if worst_of(bounds) >= AGREED - _SAID else " better"
    return (
        f"bent by {100 * rms:.1f} % on average and {100 * most:.{digits}f} % at most, so that {who} "
        f"agree{better}"
    )


def require_agreed(agreement: Agreement, scene: ResolvedScene) -> None:
    """Refuse pictures that contradict each other too much for any part to show them recognisably.

    Raises:
        SceneError: names the picture whose bound is lowest.
    """
    if not agreement.bounds or "unrecognisable" in scene.accuracy.accept:
        return
    worst = min(range(len(agreement.bounds)), key=lambda k: agreement.bounds[k].iou)
    left = agreement.bounds[worst].iou
    if left < _HOPELESS:
        raise SceneError(
            f"picture {agreement.targets[worst].name}",
            f"the other pictures leave {left:.0%} of it: nobody would know it in the shadow of any part",
            "Use fewer pictures, ones whose silhouettes fill the same heights, or more bending (--bend 0.2); "
            "--accept unrecognisable builds it nevertheless",
        )


def require_apart(views: Sequence[View]) -> None:
    """Require lines of sight that differ: along one line a part has one silhouette or its mirror image.

    Raises:
        InputError: two lines of sight are closer than `NEAREST_DEG`.
    """
    if (pair := find_aligned(views)) is not None:
        other, one = (views[n] for n in pair)
        raise InputError(
            f"views {other.name} and {one.name}",
            f"they look along one line ({other.azimuth_deg:g}° and {one.azimuth_deg:g}°), where a "
            "part has one silhouette and its mirror image, and their pictures differ",
            "Give them azimuths (azimuth_deg) that are not equal or opposite",
        )


def _bent(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[Target, ...]:
    return tuple(apply_bending(v, t) for v, t in zip(scene.views, targets, strict=True))


def _bend(
    scene: ResolvedScene,
    targets: tuple[Target, ...],
    drawn: Sequence[Target],
    bounds: Sequence[HullBound],
    most: float,
) -> tuple[ResolvedScene, tuple[Target, ...]]:
    """Return the scene with its bend points, and the bent targets.

    Args:
        drawn, bounds: the pictures before bending, and their bounds.
    """
    from knotfab.design.bend import bend_pictures

    views = framed_views(scene.views, targets)
    masks = coarse_masks(drawn, 384)  # px

    # coarse silhouettes overrate a bound: demand that much more, but no more than 0.003
    added = [
        float(np.clip(coarse.iou - fine.iou, 0.0, 0.003))
        for coarse, fine in zip(bounds_of(scene.views, targets, masks), bounds, strict=True)
    ]

    def grade(points: Array) -> int:
        bent = [bend_mask(m, p) for m, p in zip(masks, points, strict=True)]
        found = bounds_of(scene.views, targets, bent)
        if any(b.iou < AGREED + _SLACK + a for b, a in zip(found, added, strict=True)):
            return 0
        return 2 if max(b.deepest for b in found) <= _DEEPEST else 1

    cameras = cameras_of(views, targets)
    points = bend_pictures(
        cameras, [t.mask for t in drawn], reach_of(views), most, grade, walls_of(views)
    )
    for _ in range(_SCALED):
        bent_views = tuple(
            v.but(bend_points=write_points(p)) for v, p in zip(scene.views, points, strict=True)
        )
        bent_scene = scene.but(views=bent_views)
        bent = _bent(bent_scene, targets)
        kept = [keeps_shape(t.mask, b.mask) for t, b in zip(drawn, bent, strict=True)]
        if all(kept):
            break
        fewer = [1.0 if keeps else 0.8 for keeps in kept]
        points = points * np.array(fewer)[:, None, None, None]
    return bent_scene, bent


def _tell_lacking(
    scene: ResolvedScene, targets: Sequence[Target], bounds: Sequence[HullBound], most: float
) -> list[str]:
    """Describe each picture that still lacks too much after the most bending that is allowed."""
    return [
        f"picture {target.shown}: the others leave no room for {1 - bound.iou:.1%} of it, with no point bent "
        f"by more than {most:g} of the height: allow more (--bend {min(0.3, round(1.6 * most, 2)):g}), or "
        "use another picture"
        for target, bound in zip(targets, bounds, strict=True)
        if bound.iou < AGREED - _SAID
    ]
