"""Choose before a search whether a piece is designed to print without supports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array
from knotfab.design.frames import frame_view
from knotfab.picture.read import Target
from knotfab.scene.require import name_standing, stand_alone, why_supported
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene


def choose_supports(
    scene: ResolvedScene, targets: Sequence[Target], printing: bool
) -> tuple[ResolvedScene, ResolvedScene | None, str]:
    """Choose the scene to build first, the one to build where that fails, and why there is no choice.

    Raises:
        InputError: `supports = "none"` on a bed too small for it.
    """
    asked = scene.piece.supports
    filament = scene.printer.process == scene.material.process == "filament"
    if asked == "slicer" or not printing or (asked == "auto" and not filament):
        return scene, None, ""
    supported = scene.but(piece=scene.piece.but(supports="slicer"))
    refusal = why_supported(scene) or why_too_large(scene, targets)
    if refusal is None:
        alone = stand_alone(scene, scene.count_knots(targets[0].pieces))
        if alone.mount.plate == "roots" != scene.mount.plate and not _suit_roots(scene, targets):
            alone = alone.but(mount=alone.mount.but(plate="rounded"))
        return alone, supported if asked == "auto" else None, ""
    if asked == "none":
        raise InputError(name_standing(scene), *refusal)
    return supported, None, refusal[0]


def _suit_roots(scene: ResolvedScene, targets: Sequence[Target]) -> bool:
    """Return whether roots suit all of the pictures, as far as these tell."""
    # imported only now, so that what is refused loads nothing heavy
    from knotfab.hold.roots import suits_roots

    view = scene.views[0]
    return all(suits_roots(t.mask, 1 / frame_view(view, t).px_per_mm(t.width)) for t in targets)


def why_too_large(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[str, str] | None:
    """Say why the bed is too small for a piece that stands with the light's axis up, and the remedy.

    None if the pictures, taken at the middle of the piece, fit the bed, with all of their frame for a full
    plate, and with the ears of another for its screws; the strands' feet may reach farther.
    """
    # imported only now, so that most builds begin without waiting for it
    from knotfab.part.pose import fits_upright

    room, height = scene.printer.build_volume_mm, scene.piece.depth or 0.0
    full = scene.mount.on_feet and scene.mount.plate == "full"
    beside = _beside_mm(scene)
    for target in targets:
        corners = np.array([[x, y] for x in (0.0, target.width) for y in (0.0, target.height)])
        outline = corners if full else _trace_rows(target)
        view = frame_view(scene.views[0], target)
        outline = outline / view.px_per_mm(target.width)
        if any(beside):
            low, high = outline.min(axis=0) - beside, outline.max(axis=0) + beside
            outline = np.array([low, [low[0], high[1]], high, [high[0], low[1]]])
        if not fits_upright(outline, height, room):
            from knotfab.design.survey import smaller_size

            across, down = np.ptp(outline, axis=0)
            fixed = 2 * max(beside)
            share = min(
                (a - fixed) / (b - fixed)  # a plate's rim does not shrink with the picture
                for a, b in zip(sorted(room[:2]), sorted((across, down)), strict=True)
            )
            holder = f" in its {scene.mount.plate} plate" if any(beside) else ""
            return (
                f"it stands on the bed{holder} with the light's axis up, {across:.0f} × {down:.0f} mm "
                f"across, and the printer holds {' × '.join(f'{side:g}' for side in room)} mm",
                f"Use --size {smaller_size(view.longer_mm, share, 1)}, or --supports slicer",
            )
    return None


def _beside_mm(scene: ResolvedScene) -> tuple[float, float]:
    """Return how far a plate that follows the picture reaches beyond it, across and down."""
    if not scene.mount.on_feet or scene.mount.plate not in ("rounded", "outline"):
        return 0.0, 0.0
    # imported only now, so that most builds begin without waiting for it
    from knotfab.hold.foot_plate import NEUTRAL_MM, ears_mm

    margin = NEUTRAL_MM if scene.mount.plate == "rounded" else scene.mount.plate_margin_mm
    return margin + ears_mm(scene.mount) / 2, margin


def _trace_rows(target: Target) -> Array:
    """Return the ends (n, 2), px, of each row of a silhouette: column and row."""
    rows = np.flatnonzero(target.mask.any(axis=1))
    mask = target.mask[rows]
    left, right = mask.argmax(axis=1), mask.shape[1] - mask[:, ::-1].argmax(axis=1)
    return np.column_stack([np.concatenate([left, right]), np.tile(rows, 2)]).astype(np.float64)
