"""Check the coloured picture that several lamps cast on one screen: how much of it has the right colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab_formats.verdict import Check, Colours, Lamp, Masks, Misregistration
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_least, at_most, skip_check
from knotfab_validators.files.picture import read_colours, write_image
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.frame import WorkingFrame, padded_mask, working_frame
from knotfab_validators.shadows.lamp import Bytes, Light, colour_error, light_of, to_srgb
from knotfab_validators.shadows.outlines import depth_in
from knotfab_validators.shadows.render import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.views import View
    from knotfab_validators.files.scene import Scene

# px of a frame of 1024: pixels this near to a border of colours count as along an outline
OUTLINE_PX = 2.0
ALIKE = 1.0  # ΔE below which nobody distinguishes colours
MOVED_MM = 2.0  # placement error of a lamp put down with care
# quantisation of each channel when a picture's colours are counted; 255 is a multiple
STEP = 5
EVERY = 8  # px between places at which the unobstructed light is sampled
GAP_PX, PANEL_PX = 16, 512
WRONG = (214, 94, 50)


@dataclass(frozen=True)
class LampShadow:
    """One lamp's verified shadow on the padded working frame.

    `hidden` (H, W) is the share of the lamp that is hidden at each pixel; `mask` (H, W) is its
    picture, where it should be hidden. `geometry` is its view on the picture's own pixels.
    `tube_mm` is half the width of a strand's shadow; None if the knots are unknown.
    """

    view: View
    geometry: ViewGeometry
    hidden: Mask | NDArray[np.float32]
    mask: Mask
    tube_mm: float | None


@dataclass(frozen=True)
class MixedPicture:
    """What several lamps mix, as pictures of the frame (H, W, 3), sRGB."""

    found: Colours
    shown: Bytes
    wanted: Bytes
    picture: Bytes | None
    wrong: Mask


def measure_colours(
    lamps: Sequence[LampShadow],
    scene: Scene,
    folder: Path,
    frame: WorkingFrame,
    caster: ShadowCaster,
    points: Array,
) -> MixedPicture:
    """Mix the light of all lamps, and compare the result with the masks' colours and the picture.

    Args:
        folder: where the picture in colours lies. frame: frame of the lamps' masks. caster: caster of the
            part, scene.
        points: (k, 3) mm, its centre lines.
    """
    names = [lamp.view.name for lamp in lamps]
    hidden = np.stack([lamp.hidden[frame.window] for lamp in lamps]).astype(np.float64)
    masks = np.stack([lamp.mask[frame.window] for lamp in lamps])
    codes = _encode_masks(masks)
    light = _light_on_frame(lamps, scene, frame)
    shown = to_srgb(light.mix(1 - hidden))
    table = to_srgb(replace(light, other=0 * light.other).flat(np.arange(2 ** len(lamps))))
    wanted = table[codes]
    seen = _seen_codes(hidden, light)
    alike = _mark_alike(table)
    right = alike[seen, codes]
    border = np.zeros(codes.shape, dtype=bool)
    for axis in (0, 1):
        near = np.diff(codes, axis=axis) != 0
        border |= np.pad(near, [(0, 1) if k == axis else (0, 0) for k in (0, 1)])
        border |= np.pad(near, [(1, 0) if k == axis else (0, 0) for k in (0, 1)])
    along = depth_in(~border) <= OUTLINE_PX if border.any() else border
    half = _encode_masks(hidden >= 0.5)
    kept = alike[half, codes]
    drawn = (codes > 0) | (half > 0)
    error = colour_error(shown.reshape(-1, 3), wanted.reshape(-1, 3)).reshape(codes.shape)
    picture = judged = None
    if scene.lamps.picture:
        first = lamps[0].geometry
        picture = read_colours(
            folder / scene.lamps.picture, (frame.width, frame.height), (first.width, first.height)
        )
        judged = _judge_masks(scene.lamps.picture, codes, shown, picture, table, names)
    found = Colours(
        lamps=tuple(_tell_lamp(lamp, frame) for lamp in lamps),
        share=float(right.mean()),
        share_inside=_mean_over(right, ~along),
        share_along=_mean_over(right, along),
        along=float(along.mean()),
        share_half_light=float(kept.mean()),
        share_drawn=_mean_over(kept, drawn),
        delta_e=float(error.mean()),
        delta_e_inside=_mean_over(error, ~along),
        delta_e_along=_mean_over(error, along),
        delta_e_lit=float(_lit_error(light).mean()),
        ambient=scene.room.ambient,
        misregistration=_misregistration(lamps, caster, points, frame),
        picture=judged,
    )
    return MixedPicture(found, shown, wanted, picture, ~right)


def check_colours(told: Colours, iou_floor: float | None) -> list[Check]:
    """Check `colours` and `lamp_colours`.

    `colours`: the share of drawn or dark pixels that have the right one of the colours the lamps
    mix. A lamp counts as hidden where half of it is. Each lamp may miss as much as its required IoU
    allows; without a floor nothing is required. `lamp_colours`: the masks are nearer to the picture
    with each lamp's own colour than with two swapped.
    """
    count = len(told.lamps)
    floor = None if iou_floor is None else max(1 - count * (1 - iou_floor), 0.0)
    detail = (
        f"share in the right one of the mixed colours, of what is drawn or dark under any of {count} lamps; "
        f"of the whole picture {told.share:.4f}"
    )
    found = [at_least("colours", told.share_drawn, floor, "", detail, required=floor is not None)]
    judged = told.picture
    if judged is None:
        return [*found, skip_check("lamp_colours", "the scene names no picture in colours")]
    detail = (
        "mean ΔE of picture and masks with the lamps' colours; as little with two of them swapped"
    )
    if judged.swapped:
        detail += f" ({' and '.join(judged.swapped)})"
    least = judged.swapped_delta_e
    return [*found, at_most("lamp_colours", judged.masks_delta_e, least, "ΔE", detail)]


def write_colours(folder: Path, colours: MixedPicture) -> None:
    """Write colours.png, the picture seen on the screen, and compare-colours.png.

    The latter has the masks, what is seen, and what is wrong side by side.
    """
    write_image(folder / "colours.png", Image.fromarray(colours.shown))
    wrong = np.rint(0.35 * colours.shown + 0.65 * 255).astype(np.uint8)
    wrong[colours.wrong] = WRONG
    shown = [colours.picture, colours.wanted, colours.shown, wrong]
    panels = [Image.fromarray(panel) for panel in shown if panel is not None]
    scale = min(1.0, PANEL_PX / max(panels[0].size))
    width, height = (max(1, round(side * scale)) for side in panels[0].size)
    across = len(panels) * (width + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (across, height + 2 * GAP_PX), (128, 128, 128))
    for number, panel in enumerate(panels):
        small = panel.resize((width, height), Image.Resampling.BOX)
        sheet.paste(small, (GAP_PX + number * (width + GAP_PX), GAP_PX))
    write_image(folder / "compare-colours.png", sheet)


def _light_on_frame(lamps: Sequence[LampShadow], scene: Scene, frame: WorkingFrame) -> Light:
    """Compute the lamps' light on the pixels of the frame, without its padding."""
    inside = WorkingFrame(frame.width, frame.height, 0, 0)
    views = [
        (lamp.view, np.array(lamp.view.lamp_colour), lamp.geometry.resample(inside))
        for lamp in lamps
    ]
    return light_of(list(views), scene.room, (frame.height, frame.width))


def _encode_masks(hidden: Mask) -> Ints:
    """Encode n masks (n, H, W) as bits: mask k adds 2^k where it holds, (H, W)."""
    return np.asarray(np.tensordot(2 ** np.arange(len(hidden)), hidden.astype(np.int64), axes=1))


def _seen_codes(hidden: Array, light: Light) -> Ints:
    """Return the set of hidden lamps, as bits (H, W), whose colour is nearest in CIELAB to the one seen.

    Under the same light: in the middle of a penumbra the colour decides, not the share of the lamp.
    """
    codes = _encode_masks(hidden >= 0.5)
    soft = np.asarray(((hidden > 0) & (hidden < 1)).any(axis=0))
    if not soft.any():
        return codes
    shares = 1 - hidden[:, soft]
    seen = light.mix_at(shares, soft)
    least, best = np.full(len(seen), np.inf), np.zeros(len(seen), dtype=np.int64)
    for code in range(2 ** len(hidden)):
        lit = np.repeat([[1.0 - (code >> k & 1)] for k in range(len(hidden))], len(seen), axis=1)
        away = colour_error(to_srgb(seen), to_srgb(light.mix_at(lit, soft)))
        nearer = away < least
        least[nearer], best[nearer] = away[nearer], code
    codes[soft] = best
    return codes


def _mark_alike(table: Bytes) -> Mask:
    """Mark pairs (m, m) of colours (m, 3), sRGB, that nobody distinguishes."""
    count = len(table)
    one, other = np.repeat(table, count, axis=0), np.tile(table, (count, 1))
    return np.asarray(colour_error(one, other).reshape(count, count) < ALIKE)


def _mean_over(values: Array | Mask, where: Mask) -> float:
    """Average values over a mask; over an empty one, marks give 1 and errors 0."""
    if not where.any():
        return 1.0 if values.dtype == bool else 0.0
    return float(values[where].mean())


def _lit_error(light: Light) -> Array:
    """Return ΔE from white (n,) at places all over the screen where no lamp is hidden."""
    some = replace(light, falloff=light.falloff[:, ::EVERY, ::EVERY])
    lit = to_srgb(some.mix(np.ones_like(some.falloff))).reshape(-1, 3)
    return colour_error(lit, np.full_like(lit, 255))


def _tell_lamp(lamp: LampShadow, frame: WorkingFrame) -> Lamp:
    """Report a lamp's colour, and the stray and missing parts of its shadow as shares of the frame."""
    dark, size = lamp.hidden >= 0.5, frame.width * frame.height
    stray, inside = dark & ~lamp.mask, np.count_nonzero((dark & ~lamp.mask)[frame.window])
    x, y, z = lamp.geometry.light.tolist()
    return Lamp(
        name=lamp.view.name,
        colour=lamp.view.lamp_colour,
        light=(x, y, z),
        spill=inside / size,
        spill_beside=(np.count_nonzero(stray) - inside) / size,
        missing=np.count_nonzero(lamp.mask & ~dark) / size,
    )


def _judge_masks(
    file: str, codes: Ints, shown: Bytes, picture: Bytes, table: Bytes, names: Sequence[str]
) -> Masks:
    """Report how well the masks represent the picture, and how well they would with two lamps swapped."""
    binned = np.rint(picture / STEP).astype(np.int64) * STEP
    packed = ((codes * 256 + binned[..., 0]) * 256 + binned[..., 1]) * 256 + binned[..., 2]
    pairs, counts = np.unique(packed, return_counts=True)
    colours = (pairs[:, None] >> np.array([16, 8, 0]) & 255).astype(np.uint8)
    asked = pairs >> 24
    # (pairs, codes): distance of each mixed colour from each colour of the picture
    away = np.stack(
        [colour_error(colours, np.broadcast_to(c, colours.shape)) for c in table], axis=1
    )
    every = np.arange(len(pairs))
    nearest = away[every, asked] <= away.min(axis=1) + ALIKE
    swapped: dict[tuple[str, str], float] = {}
    for one, other in combinations(range(len(names)), 2):
        a, b = asked >> one & 1, asked >> other & 1
        turned = asked + (b - a) * 2**one + (a - b) * 2**other
        error = float(np.average(away[every, turned], weights=counts))
        swapped[names[one], names[other]] = error
    nearer = min(swapped, key=lambda pair: swapped[pair], default=())
    return Masks(
        file=file,
        delta_e=float(colour_error(shown.reshape(-1, 3), picture.reshape(-1, 3)).mean()),
        masks_share=float(np.average(nearest, weights=counts)),
        masks_delta_e=float(np.average(away[every, asked], weights=counts)),
        swapped=nearer,
        swapped_delta_e=min(swapped.values(), default=None),
    )


def _misregistration(
    lamps: Sequence[LampShadow], renderer: Renderer, points: Array, frame: WorkingFrame
) -> Misregistration:
    """Measure the loss if the lamps stand beside their places."""
    coarse = working_frame(frame.width, frame.height, 512)
    codes = _encode_masks(np.stack([_reduce_mask(lamp.mask, frame, coarse) for lamp in lamps]))
    allowed, still, worst = [], [], []
    for lamp in lamps:
        seen = lamp.geometry.resample(coarse)
        here = lamp.geometry.project(points)[0]
        mask = _reduce_mask(lamp.mask, frame, coarse)
        still.append(renderer.render(seen)[coarse.window])
        moved = []
        for way in (seen.right, -seen.right, seen.up, -seen.up):
            off = replace(lamp.geometry, light=lamp.geometry.light + way).project(points)[0] - here
            if lamp.tube_mm is not None:
                per_mm = float(np.linalg.norm(off, axis=1).max()) * lamp.geometry.pixel_mm
                allowed.append(lamp.tube_mm / max(per_mm, 1e-9))
            away = replace(seen, light=seen.light + MOVED_MM * way)
            moved.append(renderer.render(away)[coarse.window])
        worst.append(max(moved, key=lambda shadow: np.count_nonzero(shadow != mask)))
    return Misregistration(
        lamp_mm=min(allowed, default=None),
        moved_mm=MOVED_MM,
        share=float((_encode_masks(np.stack(worst)) == codes).mean()),
        unmoved=float((_encode_masks(np.stack(still)) == codes).mean()),
    )


def _reduce_mask(mask: Mask, frame: WorkingFrame, coarse: WorkingFrame) -> Mask:
    """Reduce a mask to coarser pixels of the frame, without padding."""
    return padded_mask(mask[frame.window], coarse)[coarse.window]
