"""Judge whether a person knows the picture in its shadow: its losses, and a word by measured rules."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from knotfab_formats.verdict import Check, Loss, Recognition, Status, View
from knotfab_validators.arrays import Mask
from knotfab_validators.check import skip_check
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
    find_changes,
    label_regions,
    list_pieces,
    without_lost,
    without_specks,
)
from knotfab_validators.shadows.view import ViewGeometry


@dataclass(frozen=True)
class Rule:
    """The conditions under which a shadow deserves a word.

    `iou` at least; `outline_radii`, the 95 % quantile of the outline's distance in radii of the tube's
    shadow, at most; `cut`, the tips that are cut off for each piece and hole of the picture, likewise;
    `touching`, whether pieces of the picture may just touch; `lost_tubes`, the width of a lost piece or hole
    in widths of the tube's shadow, less than that (0: none may be lost); `changed`, the changes of topology
    for each piece and hole of the picture, at most, but for `spared` of them, `together`: all bridges across
    one hole count as one; `shape`, the likeness of each piece and hole by itself, at least; `misshapen`,
    those less alike than `SHAPE`, for each piece and hole of the picture, at most; `text`, whether rows of
    small pieces may be lost; `specks` of light that are seen, and `speck_share`, their share of the picture's
    area, at most; `hurt`, the share of the picture's area that is missing or spilled by more than a reach, at
    most: where less is hurt, changes, shapes and a stray outline alone never make it worse than this word;
    `lost_share`, the share of the picture's area in lost pieces and holes wider than `lost_tubes`, at most;
    `astray_radii`, how far the farthest strand or gap leads off, in radii of the tube's shadow, at most.
    """

    iou: float
    outline_radii: float
    cut: float
    touching: bool
    lost_tubes: float
    changed: float
    spared: int
    together: bool
    shape: float
    misshapen: float
    text: bool
    specks: float = inf
    speck_share: float = inf
    hurt: float = 0.0
    lost_share: float = 0.0
    astray_radii: float = inf


# The one table: the first word whose rule a shadow keeps is its word. docs/verdict.md says why.
RULES = {
    "faithful": Rule(
        0.975, 0.6, 0.1, False, 0.0, 0.0, 0, False, 0.9, inf, False, 12, 0.002, astray_radii=4.0
    ),
    "good": Rule(
        0.85, 1.5, inf, True, 0.5, 0.1, 2, False, 0.75, 0.05, False, 150, 0.02,
        lost_share=0.01, astray_radii=4.0,
    ),
    "coarse": Rule(
        0.5, 4.0, inf, True, 0.8, 0.5, 3, True, 0.0, inf, True, hurt=0.22, lost_share=0.1
    ),
}  # fmt: skip
UNKNOWN = "not recognisable"
WORDS = (*RULES, UNKNOWN)  # the best first
ENOUGH_PX = 6  # px of the tube's radius: the scale at which pieces and holes are counted
LOST_FEW = 0.02  # a share of all pieces and holes: one window of fifty
# shares of all pieces and holes, and of the area: more may not be lost together
LOST_PIECES, LOST_SHARE = 0.4, 0.03
TEXT = 0.1  # changes for each piece of a row of text, above which it is no longer read
TIP = 2.0  # radii of the tube's shadow: what reaches farther beyond the shadow is a tip that is cut off
SHAPE = 0.9  # the likeness of a piece or hole by itself, below which it is out of shape
SLIT = 2.0  # reaches: half the width of slits and pinholes that nobody sees
SPECK = 3.0  # reaches: half the width of specks and slits of light that are counted one by one
REACH = 0.25  # radii of the tube's shadow: an outline off by less changes no topology

_COUNTS = {
    "piece": "lost_pieces",
    "hole": "filled_holes",
    "gap": "bridged_gaps",
    "stroke": "broken_strokes",
    "stray": "stray_pieces",
    "leak": "stray_holes",
    "shape": "misshapen",
}
_SAID = {
    "tip": ("tip is cut off", "tips are cut off"),
    "piece": ("piece is lost", "pieces are lost"),
    "hole": ("hole is filled", "holes are filled"),
    "gap": ("gap is bridged", "gaps are bridged"),
    "stroke": ("stroke is broken", "strokes are broken"),
    "stray": ("piece is not in the picture", "pieces are not in the picture"),
    "leak": ("hole is not in the picture", "holes are not in the picture"),
    "shape": ("piece or hole is drawn out of shape", "pieces or holes are drawn out of shape"),
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
    """Find everything that a person would miss of a picture in its shadow.

    Args:
        shadow, target: (H, W), on the padded working frame.
        iou: IoU of the two.
        radius_px: half the width of the tube's shadow, in the masks' pixels.
        frame: frame of the masks. geometry: the view, on the picture's own pixels.
        outlined: (H, W), the shadow whose outline is compared: without the legs on which it stands, which
            bridge and break what they cross, but are no fault of its outline. None: `shadow`.
        blur_px: the width of the lamp's penumbra on the wall.
        bridged: so many gaps, the narrowest, were to be bridged, and are no loss.
    """
    scale = _Scale(frame, geometry, 2 * radius_px)
    found = _compare(shadow, target, radius_px, outlined, bridged)
    rows = _Rows.of(find_rows(found.features, max(frame.width, frame.height), target), found)
    sizes = SPECK * found.reach, found.reach, blur_px / found.step, found.step * scale.mm
    specks = find_specks(found.own, found.wanted, *sizes)
    facts = _gather(found, rows, specks, scale, target, iou)
    word = next((w for w, rule in RULES.items() if not facts.against(rule)), UNKNOWN)
    better = RULES[WORDS[max(WORDS.index(word) - 1, 0)]]
    lost = [scale.record_row(row, inside) for row, inside in rows.hit]
    lost += [scale.record(c) for c in (*found.tips, *rows.outside(rows.hit))]
    if facts.specks_seen(RULES[WORDS[0]]):
        lost.append(scale.record_specks(specks, found.step))
    lost.sort(key=lambda loss: -loss.length_mm)
    reasons = _count_reasons(rows.text, [*found.tips, *rows.outside(rows.text)])
    reasons += facts.against(better) if word != WORDS[0] else []
    counts = Counter[str](c.kind for c in found.changes)
    return Recognition(
        word=word,
        reasons=tuple(dict.fromkeys(reasons)),  # what is counted and against the rule is said once
        **{key: counts[kind] for kind, key in _COUNTS.items()},
        touching=facts.touching,
        cut_tips=facts.tips,
        specks=specks.count,
        outline_p95_mm=facts.outline_radii * facts.radius_mm,
        outline_p95_radii=facts.outline_radii,
        lost=tuple(lost[:40]),  # losses with their places in a report
    )


@dataclass(frozen=True)
class _Compared:
    """A shadow beside its picture, on a grid of which one pixel is `step` of the masks'.

    `own` is the shadow whose outline is compared, and `there` the picture without what is lost or unseen;
    `radius_px` and `reach` are in the grid's pixels. The changes, the picture's pieces and holes
    (`features`) and the tips that are cut off are in the masks' own.
    """

    step: int
    radius_px: float
    reach: float
    own: Mask
    wanted: Mask
    there: Mask
    changes: list[Change]
    features: list[Box]
    tips: list[Change]


def _compare(
    shadow: Mask, target: Mask, radius_px: float, outlined: Mask | None, bridged: int
) -> _Compared:
    """Find the changes, as `recognise` is asked."""
    step = max(1, int(radius_px / ENOUGH_PX))
    radius = radius_px / step
    reach = REACH * radius
    seen, wanted = shadow[::step, ::step], target[::step, ::step]
    own = seen if outlined is None else outlined[::step, ::step]
    if bridged:  # the bridges that were asked for are no fault of the outline
        own = own & (depth_in(~wanted) <= 2 * radius)
    found = _not_asked(find_changes(seen, wanted, reach), bridged)
    misshapen = find_misshapen(own, wanted, reach, SHAPE, found)
    # lost pieces are counted already, and specks and slits that nobody sees are no outlines
    there = close_slits(without_specks(without_lost(wanted, found), reach), SLIT * reach)
    return _Compared(
        step=step,
        radius_px=radius,
        reach=reach,
        own=own,
        wanted=wanted,
        there=there,
        changes=[_enlarged(change, step) for change in (*found, *misshapen)],
        features=[_enlarged_box(box, step) for box in list_pieces(wanted, reach)],
        tips=[_enlarged(tip, step) for tip in _find_tips(there, own, TIP * radius)],
    )


@dataclass(frozen=True)
class _Rows:
    """The rows of small pieces of a picture; `hit` are those with changes inside them."""

    rows: list[Row]
    hit: list[tuple[Row, list[Change]]]
    changes: list[Change]

    @staticmethod
    def of(rows: list[Row], found: _Compared) -> _Rows:
        inside = ((row, [c for c in found.changes if _inside(_middle(c), row.box)]) for row in rows)
        return _Rows(rows, [(row, changes) for row, changes in inside if changes], found.changes)

    @property
    def text(self) -> list[tuple[Row, list[Change]]]:
        """The rows of text that are hit."""
        return [(row, inside) for row, inside in self.hit if row.text]

    def outside(self, rows: Sequence[tuple[Row, list[Change]]]) -> list[Change]:
        """Return the changes that are in none of these rows."""
        inside = {id(c) for _, changes in rows for c in changes}
        return [c for c in self.changes if id(c) not in inside]


def _gather(
    found: _Compared, rows: _Rows, specks: Specks, scale: _Scale, target: Mask, iou: float
) -> _Facts:
    """Measure what the rules ask."""
    own, wanted, there, radius = found.own, found.wanted, found.there, found.radius_px
    area, pixel_mm = max(int(wanted.sum()), 1), found.step * scale.mm
    single = rows.outside(rows.text)
    text = [row.box for row in rows.rows if row.text]
    drawn = sum(not any(_inside(box, row) for row in text) for box in found.features)
    # the text is the drawing where there is nothing else
    torn = [c for c in (single if drawn else found.changes) if not isinstance(c, Shape)]
    shapes = [c.likeness for c in single if isinstance(c, Shape)]
    off = find_wrong_stretch(close_slits(own, SLIT * found.reach), there)
    strays = (*_find_tips(own, there, TIP * radius), *_find_tips(there, own, 0))
    tube_px = 2 * radius * found.step  # the width of the tube's shadow, in the masks' pixels
    return _Facts(
        iou=iou,
        radius_mm=radius * pixel_mm,
        outline_radii=off.quantile_95_px / radius,
        tips=len(found.tips),
        touching=count_touching(wanted, found.reach),
        lost=[
            (c.width_px / tube_px, _area_of(c, target) / (area * found.step**2))
            for c in single
            if _is_lost(c)
        ],
        changes=len(torn),
        apart=len(torn) - count_repeated([c for c in torn if c.kind == "gap"], target),
        features=max(drawn or len(found.features), 1),
        shape=min(shapes, default=1.0),
        misshapen=len(shapes),
        text=sum(len(inside) > TEXT * row.pieces for row, inside in rows.text),
        specks=specks.count,
        speck_share=specks.area_mm2 / (area * pixel_mm**2),
        hurt=_hurt(own, wanted, found.reach) / area,
        astray=max((c.width_px for c in strays), default=0.0) / radius,
        fine=sum(_is_lost(c) and c.width_px < RULES["good"].lost_tubes * tube_px for c in torn),
    )


def worst_verdict(views: Sequence[View]) -> Recognition | None:
    """Return the verdict on a piece from those on its views, of which the worst counts; None without any."""
    judged = [(view.name, view.verdict) for view in views if view.verdict is not None]
    if not judged:
        return None
    # among views with one word the one that is farther off
    name, worst = max(
        judged, key=lambda pair: (WORDS.index(pair[1].word), pair[1].outline_p95_radii)
    )
    several = len(views) > 1
    lost = [replace(loss, view=of) for of, verdict in judged for loss in verdict.lost]
    lost.sort(key=lambda loss: -loss.length_mm)
    told = [(name, worst), *(pair for pair in judged if pair[0] != name)]
    reasons = [
        f"{reason} (view {of})" if several else reason
        for of, verdict in told
        for reason in verdict.reasons
    ]
    return replace(worst, reasons=tuple(reasons), lost=tuple(lost))


def check_recognisable(verdict: Recognition | None, *, accepted: bool) -> Check:
    """Check `recognisable`: whether the piece has a word of `RULES`; not required if it is `accepted`."""
    name = "recognisable"
    if verdict is None:
        return skip_check(name, "not given the knots", required=False)
    status: Status = "fail" if verdict.word == UNKNOWN else "pass"
    detail = (
        "; ".join(verdict.reasons) or "all pieces, holes, gaps and strokes of the picture are there"
    )
    if status == "fail" and not accepted:
        detail += "; --accept unrecognisable keeps it nevertheless"
    least = list(RULES)[-1]
    return Check(name, status, not accepted, verdict.word, least, "", detail)


@dataclass(frozen=True)
class _Facts:
    iou: float
    radius_mm: float  # half the width of the tube's shadow on the wall
    outline_radii: float
    tips: int
    touching: int
    # each lost piece and hole has its width in tubes and its share of the area
    lost: Sequence[tuple[float, float]]
    changes: int
    apart: int  # changes, all bridges across one hole as one
    features: int
    shape: float
    misshapen: int
    text: int
    specks: int = 0
    speck_share: float = 0.0
    hurt: float = 0.0
    astray: float = 0.0
    fine: int = 0  # lost pieces and holes far thinner than the tube, among the changes

    @property
    def widest_lost(self) -> float:
        """The width of the widest lost piece or hole, in widths of the tube."""
        return max((width for width, _ in self.lost), default=0.0)

    def specks_seen(self, rule: Rule) -> bool:
        """Tell whether there are more specks of light than a rule allows."""
        return self.specks > rule.specks or (
            self.specks > 1 and self.speck_share > rule.speck_share
        )

    def against(self, rule: Rule) -> list[str]:
        """Say which parts of a rule are not kept, a sentence each."""
        most = max(rule.changed * self.features, rule.spared)
        changes = self.apart if rule.together else self.changes
        changes -= self.fine if rule.lost_tubes else 0
        wide = [one for one in self.lost if one[0] >= rule.lost_tubes]
        share = sum(area for _, area in wide)
        lost = bool(wide)
        if rule.hurt:  # the share of the picture that they are, and how many of its pieces
            many = len(wide) > LOST_PIECES * self.features
            lost = share > rule.lost_share or (many and share > LOST_SHARE)
        elif rule.lost_share:
            few = len(wide) <= LOST_FEW * self.features and share <= 0.5 * rule.lost_share
            lost = not few or sum(area for _, area in self.lost) > rule.lost_share
        much = self.hurt > rule.hurt or not rule.hurt
        of_it = "one piece" if self.features == 1 else f"{self.features} pieces and holes"

        def in_mm(radii: float) -> str:
            return f"{radii * self.radius_mm:.1f} mm"

        said = {
            f"IoU {self.iou:.3f}, below {rule.iou:g}": self.iou < rule.iou,
            f"the outline is off by {in_mm(self.outline_radii)}, above {in_mm(rule.outline_radii)}": (
                self.outline_radii > rule.outline_radii and much
            ),
            f"a strand or gap leads off by {in_mm(self.astray)}, above {in_mm(rule.astray_radii)}": (
                self.astray > rule.astray_radii
            ),
            _name("tip", self.tips): self.tips > rule.cut * self.features,
            f"{_tell(self.specks, 'speck')} of light within the shadow": self.specks_seen(rule),
            f"pieces just touch at {_tell(self.touching, 'place')}, which no tube draws": (
                self.touching > 0 and not rule.touching
            ),
            f"lost pieces or holes up to {self.widest_lost:.1f} tubes wide": lost,
            f"{_tell(changes, 'change')} to its {of_it}": changes > most and much,
            f"a piece or hole {self.shape:.3f} alike, below {rule.shape:g}": self.shape
            < rule.shape,
            _name("shape", self.misshapen): self.misshapen > rule.misshapen * self.features,
            f"{_tell(self.text, 'row')} of small pieces lost": bool(self.text) and not rule.text,
        }
        return [sentence for sentence, holds in said.items() if holds]


def _tell(number: int, noun: str) -> str:
    """Say how many there are, as a person does."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _not_asked(changes: Sequence[Change], bridged: int) -> list[Change]:
    """Return the changes without so many bridged gaps, the narrowest, which the scene asked for."""
    gaps = sorted((c for c in changes if c.kind == "gap"), key=lambda c: c.width_px)[:bridged]
    return [c for c in changes if not any(c is gap for gap in gaps)]


def _find_tips(there: Mask, own: Mask, least_px: float) -> list[Change]:
    """Find tips that reach more than `least_px` beyond the shadow; the width is how far."""
    away = depth_in(~own)
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


def _hurt(shadow: Mask, target: Mask, reach: float) -> float:
    """Return pixels that are missing or spilled farther than a reach from the outline that they miss."""
    missing = target & (depth_in(~shadow) > reach)
    return float((missing | (shadow & (depth_in(~target) > reach))).sum())


def _area_of(change: Change, target: Mask) -> int:
    """Return pixels of a lost piece or hole in its box, at most."""
    left, top, right, bottom = change.box
    here = target[top:bottom, left:right]
    return int(here.sum() if change.kind == "piece" else (~here).sum())


def _is_lost(change: Change) -> bool:
    return change.kind in ("piece", "hole")


def _length_px(change: Change) -> float:
    """Measure how long a person sees what was changed: a tip's reach, else the longer side of its box."""
    left, top, right, bottom = change.box
    return (
        change.width_px
        if change.kind == "tip"
        else max(right - left, bottom - top, change.width_px)
    )


def _enlarged(change: Change, step: int) -> Change:
    u, v = change.where
    where, box = (u * step, v * step), _enlarged_box(change.box, step)
    return replace(change, where=where, width_px=change.width_px * step, box=box)


def _enlarged_box(box: Box, step: int) -> Box:
    left, top, right, bottom = box
    return left * step, top * step, right * step, bottom * step


def _middle(change: Change) -> Box:
    """Return the place of a change, as a box; of what is lost or out of shape the whole of it."""
    if _is_lost(change) or isinstance(change, Shape):
        return change.box
    u, v = (round(c) for c in change.where)
    return u, v, u, v


def _inside(box: Box, row: Box) -> bool:
    """Tell whether a box lies in a row's, or sticks out by no more than half its height."""
    margin = (row[3] - row[1]) / 2
    sideways = row[0] - margin <= box[0] and box[2] <= row[2] + margin
    return sideways and row[1] - margin <= box[1] and box[3] <= row[3] + margin


def _count_reasons(text: Sequence[tuple[Row, list[Change]]], single: Sequence[Change]) -> list[str]:
    """Count each kind of reason."""
    reasons = []
    for what, rows in (
        ("text", [row for row, _ in text if not row.repeated]),
        ("small shapes", [row for row, _ in text if row.repeated]),
    ):
        if rows:
            plural = f"{len(rows)} rows of {what} are" if len(rows) > 1 else f"a row of {what} is"
            reasons.append(f"{plural} damaged or lost")
    counts = Counter[str](c.kind for c in single)
    return [*reasons, *(_name(kind, counts[kind]) for kind in _SAID if counts[kind])]


def _name(kind: str, number: int) -> str:
    """Name a kind of loss with its number, always in the same words."""
    return f"{number} {_SAID[kind][number != 1]}"


@dataclass(frozen=True)
class _Scale:
    """The scale from the compared grid to the picture's pixels, and to mm on the wall."""

    frame: WorkingFrame
    geometry: ViewGeometry
    tube_px: float

    @property
    def mm(self) -> float:
        """The side of a compared pixel."""
        return float(np.linalg.norm(self.geometry.du)) * self.geometry.width / self.frame.width

    def record(self, change: Change) -> Loss:
        """Return one loss."""
        what = f"a {_SAID[change.kind][0]}"
        if isinstance(change, Shape):
            what = f"a {change.of} is drawn out of shape ({change.likeness:.2f} alike)"
        length = _length_px(change)
        if change.kind == "tip":
            what = f"a tip {length * self.mm:.0f} mm long is cut off"
        elif change.kind == "stray" and length > change.width_px:
            what = f"a strand sticks out by {length * self.mm:.0f} mm"
        return self._place(change.kind, change.where, change.width_px, length, what)

    def record_row(self, row: Row, inside: Sequence[Change]) -> Loss:
        """Return what was lost of a row of text, or of windows, in its place."""
        left, top, right, bottom = row.box
        where = ((left + right) / 2, (top + bottom) / 2)
        counts = Counter[str](c.kind for c in inside)
        what = ", ".join(
            f"{counts[kind]} {one if counts[kind] == 1 else more}"
            for kind, (one, more) in _SAID.items()
            if counts[kind]
        )
        width = float(np.median([c.width_px for c in inside]))
        length = max(_length_px(c) for c in inside)
        kind, said = counts.most_common(1)[0][0], f"of a row of {row.pieces} small shapes {what}"
        if row.text and not row.repeated:
            kind, length = "text", right - left
            said = f"of a row of text of {row.pieces} pieces {what}"
        return self._place(kind, where, width, length, said)

    def record_specks(self, specks: Specks, step: int) -> Loss:
        """Return all specks of light, at the largest."""
        u, v = (c * step for c in specks.at)
        width = specks.largest_mm2**0.5 / self.mm
        said = (
            f"{_tell(specks.count, 'speck')} of light within the shadow, {specks.area_mm2:.0f} mm² together, "
            f"the largest {specks.largest_mm2:.1f} mm²"
        )
        return self._place("specks", (u, v), width, width, said)

    def _place(
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
