"""Judge whether a person knows the picture in its shadow: find its losses, and apply the rules."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_formats.verdict import WORDS, Loss, Recognition
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.frame import WorkingFrame
from knotfab_validators.shadows.outlines import depth_in, find_wrong_stretch
from knotfab_validators.shadows.shapes import (
    Row,
    Shape,
    Specks,
    find_misshapen,
    find_rows,
    find_specks,
)
from knotfab_validators.shadows.topology import (
    Box,
    Change,
    close_slits,
    count_repeated,
    count_touching,
    enlarge_box,
    find_changes,
    find_widest,
    holes_at,
    label_regions,
    list_pieces,
    without_lost,
    without_specks,
)
from knotfab_validators.shadows.verdict_rules import (
    LOSSES,
    RULES,
    UNKNOWN,
    Facts,
    name_losses,
    say_number,
)
from knotfab_validators.shadows.view import ViewGeometry

ENOUGH_PX = 6  # px of the tube's radius on the grid where pieces and holes are counted
TEXT = 0.1  # changes per piece above which a row of text is no longer readable
TIP = 2.0  # radii of the tube's shadow: what reaches farther beyond the shadow is a tip cut off
SHAPE = 0.9  # likeness of a piece or hole by itself, below which it is out of shape
SLIT = 2.0  # reaches: half the width of slits and pinholes that go unseen
SPECK = 3.0  # reaches: half the width of specks and slits of light that are counted singly
REACH = 0.25  # radii of the tube's shadow: a smaller error of an outline changes no topology

_COUNTS = {
    "piece": "lost_pieces",
    "hole": "filled_holes",
    "gap": "bridged_gaps",
    "stroke": "broken_strokes",
    "stray": "stray_pieces",
    "leak": "stray_holes",
    "shape": "misshapen",
}


def recognise(
    shadow: Mask,
    target: Mask,
    iou: float,
    radius_px: float,
    frame: WorkingFrame,
    geometry: ViewGeometry,
    outlined: Mask | None = None,
    blur_px: float = 0.0,
    bridged: int = 0,
) -> Recognition:
    """Judge whether a person knows the picture in its shadow, and list its losses.

    Args:
        shadow, target: (H, W), on the padded working frame.
        iou: IoU of the two.
        radius_px: half the width of the tube's shadow, in the masks' pixels.
        frame: frame of the masks. geometry: the view, on the picture's own pixels.
        outlined: (H, W), the shadow whose outline is compared, without the legs on which the piece stands or
            hangs: these may break the topology or cross the picture, but are no fault of the outline. None:
            `shadow`.
        blur_px: the width of the lamp's penumbra on the wall.
        bridged: how many gaps, the narrowest ones, had to be bridged and are no loss.
    """
    scale = _Scale(frame, geometry, 2 * radius_px)
    found = _compare_on_grid(shadow, target, radius_px, outlined, bridged)
    rows = _Rows.from_changes(
        find_rows(found.features, max(frame.width, frame.height), target), found
    )
    sizes = SPECK * found.reach, found.reach, blur_px / found.step, found.step * scale.mm
    specks = find_specks(found.own, found.wanted, *sizes)
    facts = _measure_facts(found, rows, specks, scale, target, iou / (1.0 - found.spared))
    word = next((w for w, rule in RULES.items() if not facts.against(rule)), UNKNOWN)
    better = RULES[WORDS[max(WORDS.index(word) - 1, 0)]]
    lost = [scale.record_row(row, inside) for row, inside in rows.hit]
    lost += [scale.record(c) for c in (*found.tips, *rows.changes_outside(rows.hit))]
    if facts.specks_seen(RULES[WORDS[0]]):
        lost.append(scale.record_specks(specks, found.step))
    lost.sort(key=lambda loss: -loss.length_mm)
    reasons = _count_reasons(rows.text, [*found.tips, *rows.changes_outside(rows.text)])
    reasons += facts.against(better) if word != WORDS[0] else []
    counts = Counter[str](c.kind for c in found.changes)
    return Recognition(
        word=word,
        reasons=tuple(
            dict.fromkeys(reasons)
        ),  # a reason may be counted and break a rule: say it once
        **{key: counts[kind] for kind, key in _COUNTS.items()},
        touching=facts.touching,
        cut_tips=facts.tips,
        specks=specks.count,
        outline_p95_mm=facts.outline_radii * facts.radius_mm,
        outline_p95_radii=facts.outline_radii,
        lost=tuple(lost[:40]),  # the most that a report lists
    )


@dataclass(frozen=True)
class _Compared:
    """A shadow beside its picture, on a grid whose pixels are `step` pixels of the masks wide.

    `own` is the shadow whose outline is compared, `there` the picture without what is lost or unseen, and
    `legs` what legs darken beside both, between the picture's top and foot; `off_own` and `off_wanted` how
    far pixels lie outside of these two.
    `radius_px` and `reach` are in the grid's pixels; the changes, the picture's pieces and holes (`features`)
    and the tips that are cut off are in the masks'. `spared` is the share of the union of both that bridges
    spill which the scene requested; `patch_tubes` as in `Facts`.
    """

    step: int
    radius_px: float
    reach: float
    own: Mask
    legs: Mask
    wanted: Mask
    there: Mask
    off_own: Array
    off_wanted: Array
    changes: list[Change]
    features: list[Box]
    tips: list[Change]
    spared: float
    patch_tubes: float


def _compare_on_grid(
    shadow: Mask, target: Mask, radius_px: float, outlined: Mask | None, bridged: int
) -> _Compared:
    """Compare shadow and picture on a grid that is coarse where the tube is wide."""
    step = max(1, int(radius_px / ENOUGH_PX))
    radius = radius_px / step
    reach = REACH * radius
    seen, wanted = shadow[::step, ::step], target[::step, ::step]
    own = seen if outlined is None else outlined[::step, ::step]
    legs = seen & ~own & _between_rows(wanted)
    off_wanted = depth_in(~wanted)
    if bridged:  # requested bridges are no fault of the outline
        own = own & (off_wanted <= 2 * radius)
    off_own = depth_in(~own)
    changes = find_changes(seen, wanted, reach)
    asked = sorted((c for c in changes if c.kind == "gap"), key=lambda c: c.width_px)[:bridged]
    found = [c for c in changes if not any(c is gap for gap in asked)]
    spill = np.zeros_like(seen)
    for gap in asked:  # the narrowest ones
        left, top, right, bottom = gap.box
        spill[top:bottom, left:right] = (seen & ~wanted)[top:bottom, left:right]
    misshapen = find_misshapen(own, wanted, reach, SHAPE, found)
    # lost pieces are counted already, and specks and slits that go unseen have no outline
    there = close_slits(without_specks(without_lost(wanted, found), reach), SLIT * reach)
    missing, spilled = there & ~own, own & ~there & (not bridged)
    for shape in misshapen:  # that says already what is wrong about it
        left, top, right, bottom = (
            max(0, round(at + way * TIP * radius))
            for at, way in zip(shape.box, (-1, -1, 1, 1), strict=True)
        )
        missing[top:bottom, left:right] = spilled[top:bottom, left:right] = False
    return _Compared(
        step=step,
        radius_px=radius,
        reach=reach,
        own=own,
        legs=legs,
        wanted=wanted,
        there=there,
        off_own=off_own,
        off_wanted=off_wanted,
        changes=[change.enlarged(step) for change in (*found, *misshapen)],
        features=[enlarge_box(box, step) for box in list_pieces(wanted, reach)],
        tips=[tip.enlarged(step) for tip in _find_tips(there, off_own, TIP * radius)],
        spared=float(spill.sum() / (seen | wanted).sum()),
        patch_tubes=max(find_widest(one)[1] for one in (missing, spilled)) / (2 * radius),
    )


@dataclass(frozen=True)
class _Rows:
    """The rows of small pieces in a picture; `hit` lists those with changes inside them."""

    rows: list[Row]
    hit: list[tuple[Row, list[Change]]]
    changes: list[Change]

    @staticmethod
    def from_changes(rows: list[Row], found: _Compared) -> _Rows:
        inside = (
            (row, [c for c in found.changes if _lies_in(_extent(c), row.box)]) for row in rows
        )
        return _Rows(rows, [(row, changes) for row, changes in inside if changes], found.changes)

    @property
    def text(self) -> list[tuple[Row, list[Change]]]:
        """The rows of text that have changes inside them, with these."""
        return [(row, inside) for row, inside in self.hit if row.text]

    def changes_outside(self, rows: Sequence[tuple[Row, list[Change]]]) -> list[Change]:
        """Return the changes that lie in none of these rows."""
        inside = {id(c) for _, changes in rows for c in changes}
        return [c for c in self.changes if id(c) not in inside]


def _measure_facts(
    found: _Compared, rows: _Rows, specks: Specks, scale: _Scale, target: Mask, iou: float
) -> Facts:
    """Measure the quantities that the rules limit."""
    own, wanted, there, radius = found.own, found.wanted, found.there, found.radius_px
    area, pixel_mm = max(int(wanted.sum()), 1), found.step * scale.mm
    single = rows.changes_outside(rows.text)
    text = [row.box for row in rows.rows if row.text]
    drawn = sum(not any(_lies_in(box, row) for row in text) for box in found.features)
    # a picture of nothing but text is judged by its text
    torn = [c for c in (single if drawn else found.changes) if not isinstance(c, Shape)]
    shapes = [c.likeness for c in single if isinstance(c, Shape)]
    off = find_wrong_stretch(close_slits(own, SLIT * found.reach), there)
    gaps = [c for c in torn if c.kind == "gap"]
    beyond = _find_tips(own, depth_in(~there), TIP * radius)
    # a strand that crosses a hole leads off nowhere: it is a gap that is bridged
    crossed = set(holes_at(gaps, target)) - {0}
    holes = holes_at([tip.enlarged(found.step) for tip in beyond], target)
    off_by = [c.width_px for c, hole in zip(beyond, holes, strict=True) if hole not in crossed]
    off_by += [c.width_px for c in _find_tips(there, found.off_own, 0)]
    tube_px = 2 * radius * found.step  # the width of the tube's shadow, in the masks' pixels
    return Facts(
        iou=iou,
        radius_mm=radius * pixel_mm,
        outline_radii=off.quantile_95_px / radius,
        tips=len(found.tips),
        touching=count_touching(wanted, found.reach),
        lost=[
            (c.width_px / tube_px, _bound_area(c, target) / (area * found.step**2))
            for c in single
            if _is_lost(c)
        ],
        changes=len(torn),
        apart=len(torn) - count_repeated(gaps, target),
        features=max(drawn or len(found.features), 1),
        shape=min(shapes, default=1.0),
        misshapen=sum(1.0 - likeness for likeness in shapes),
        text=sum(len(inside) > TEXT * row.pieces for row, inside in rows.text),
        specks=specks.count,
        speck_share=specks.area_mm2 / (area * pixel_mm**2),
        hurt=_count_hurt(found) / area,
        astray=max(off_by, default=0.0) / radius,
        patch_tubes=found.patch_tubes,
        leg=float(found.off_wanted[found.legs].max(initial=0.0)) / radius,
        fine=sum(_is_lost(c) and c.width_px < RULES["good"].lost_tubes * tube_px for c in torn),
    )


def _between_rows(mask: Mask) -> Mask:
    """Return the rows (H, 1) from the first to the last that a mask darkens."""
    rows = np.flatnonzero(mask.any(axis=1))
    between = np.zeros((len(mask), 1), dtype=np.bool_)
    if len(rows):
        between[rows[0] : rows[-1] + 1] = True
    return between


def _find_tips(there: Mask, away: Array, least_px: float) -> list[Change]:
    """Find tips that reach more than `least_px` out of a shadow `away` by so much; that is their width."""
    labels, found = label_regions("piece", there & (away > least_px), 0.0)
    tips = []
    for number, (left, top, right, bottom) in found:
        inside = np.where(
            labels[top:bottom, left:right] == number, away[top:bottom, left:right], 0.0
        )
        v, u = np.unravel_index(int(inside.argmax()), inside.shape)
        box = (left, top, right, bottom)
        tips.append(Change("tip", (float(u + left), float(v + top)), float(inside.max()), box))
    return tips


def _count_hurt(found: _Compared) -> float:
    """Count missing or spilled pixels farther than `reach` from the outline."""
    missing = found.wanted & (found.off_own > found.reach)
    return float((missing | (found.own & (found.off_wanted > found.reach))).sum())


def _bound_area(change: Change, target: Mask) -> int:
    """Bound the number of pixels of a lost piece or hole by those in its box."""
    left, top, right, bottom = change.box
    here = target[top:bottom, left:right]
    return int(here.sum() if change.kind == "piece" else (~here).sum())


def _is_lost(change: Change) -> bool:
    return change.kind in ("piece", "hole")


def _length_px(change: Change) -> float:
    """Return the apparent length of a change: a tip's reach, else the longer side of its box."""
    if change.kind == "tip":
        return change.width_px
    left, top, right, bottom = change.box
    return max(right - left, bottom - top, change.width_px)


def _extent(change: Change) -> Box:
    """Return the box that locates a change: all of a lost or misshapen piece, else a single point."""
    if _is_lost(change) or isinstance(change, Shape):
        return change.box
    u, v = (round(c) for c in change.where)
    return u, v, u, v


def _lies_in(box: Box, row: Box) -> bool:
    """Return whether a box lies in a row's, or sticks out by at most half the row's height."""
    margin = (row[3] - row[1]) / 2
    sideways = row[0] - margin <= box[0] and box[2] <= row[2] + margin
    return sideways and row[1] - margin <= box[1] and box[3] <= row[3] + margin


def _count_reasons(text: Sequence[tuple[Row, list[Change]]], single: Sequence[Change]) -> list[str]:
    """Say how many losses of each kind there are, and how many rows are damaged."""
    reasons = []
    for what, rows in (
        ("text", [row for row, _ in text if not row.repeated]),
        ("small shapes", [row for row, _ in text if row.repeated]),
    ):
        if rows:
            plural = f"{len(rows)} rows of {what} are" if len(rows) > 1 else f"a row of {what} is"
            reasons.append(f"{plural} damaged or lost")
    counts = Counter[str](c.kind for c in single)
    return [*reasons, *(name_losses(kind, counts[kind]) for kind in LOSSES if counts[kind])]


@dataclass(frozen=True)
class _Scale:
    """Converts pixels of the masks to the picture's pixels and to mm on the wall."""

    frame: WorkingFrame
    geometry: ViewGeometry
    tube_px: float

    @property
    def mm(self) -> float:
        """The side of a pixel of the masks on the wall, mm."""
        return float(np.linalg.norm(self.geometry.du)) * self.geometry.width / self.frame.width

    def record(self, change: Change) -> Loss:
        """Describe a change as a loss."""
        what = f"a {LOSSES[change.kind][0]}"
        if isinstance(change, Shape):
            what = f"a {change.of} is drawn out of shape ({change.likeness:.2f} alike)"
        length = _length_px(change)
        if change.kind == "tip":
            what = f"a tip {length * self.mm:.0f} mm long is cut off"
        elif change.kind == "stray" and length > change.width_px:
            what = f"a strand sticks out by {length * self.mm:.0f} mm"
        return self._loss(change.kind, change.where, change.width_px, length, what)

    def record_row(self, row: Row, inside: Sequence[Change]) -> Loss:
        """Describe all changes in a row of text, or of windows, as one loss."""
        left, top, right, bottom = row.box
        where = ((left + right) / 2, (top + bottom) / 2)
        counts = Counter[str](c.kind for c in inside)
        what = ", ".join(
            f"{counts[kind]} {one if counts[kind] == 1 else more}"
            for kind, (one, more) in LOSSES.items()
            if counts[kind]
        )
        width = float(np.median([c.width_px for c in inside]))
        length = max(_length_px(c) for c in inside)
        kind, said = counts.most_common(1)[0][0], f"of a row of {row.pieces} small shapes {what}"
        if row.text and not row.repeated:
            kind, length = "text", right - left
            said = f"of a row of text of {row.pieces} pieces {what}"
        return self._loss(kind, where, width, length, said)

    def record_specks(self, specks: Specks, step: int) -> Loss:
        """Describe all specks of light as one loss, placed at the largest."""
        u, v = (c * step for c in specks.at)
        width = specks.largest_mm2**0.5 / self.mm
        said = (
            f"{say_number(specks.count, 'speck')} of light within the shadow, "
            f"{specks.area_mm2:.0f} mm² together, the largest {specks.largest_mm2:.1f} mm²"
        )
        return self._loss("specks", (u, v), width, width, said)

    def _loss(
        self, what: str, where: tuple[float, float], width: float, length: float, said: str
    ) -> Loss:
        u, v = where[0] - self.frame.pad_x, where[1] - self.frame.pad_y
        g, f = self.geometry, self.frame
        at_px = (
            round((u + 0.5) * g.width / f.width - 0.5, 1),
            round((v + 0.5) * g.height / f.height - 0.5, 1),
        )
        down = float(np.linalg.norm(g.dv)) * g.height / f.height
        at_mm = (round((u + 0.5) * self.mm, 1), round((v + 0.5) * down, 1))
        size, needed = width * self.mm, self.tube_px * self.mm
        return Loss(
            what=what,
            at_px=at_px,
            at_mm=at_mm,
            size_mm=round(size, 2),
            length_mm=round(length * self.mm, 2),
            size_px=round(width * g.width / f.width, 1),
            needed_mm=round(needed, 2),
            sentence=f"{said}, {at_mm[0]:.0f} mm from the left and {at_mm[1]:.0f} mm from the top "
            f"(pixel {at_px[0]:.0f}, {at_px[1]:.0f}): {size:.1f} mm wide on the wall, and the tube's "
            f"shadow is {needed:.1f} mm",
        )
