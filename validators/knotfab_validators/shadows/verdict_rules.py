"""The rules for the word that a shadow deserves, and the verdict on a piece from those on its views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

from knotfab_formats.verdict import WORDS, Check, Recognition, Status, View
from knotfab_validators.check import skip_check

if TYPE_CHECKING:
    from knotfab_validators.files.picture import Bent


@dataclass(frozen=True)
class Rule:
    """The conditions under which a shadow deserves a word; all hold together.

    `iou` and `shape` are lower limits, the other numbers upper ones. A feature is a piece or hole of the
    picture; radii and widths are those of the tube's shadow.

    - `outline_radii`: 95 % quantile of the outlines' distance, radii.
    - `cut`: tips cut off, for each feature.
    - `touching`: whether pieces of the picture may just touch.
    - `lost_tubes`: lost pieces and holes must be narrower than this many tubes; at 0 none may be lost.
    - `changed`: changes of topology for each feature, or `spared` of them if that is more; `together`: all
      bridges across one hole count as one.
    - `shape`: least likeness of each feature by itself; `misshapen`: what features less alike than `SHAPE`
      lack of it, summed, for each feature: one flawed part of few weighs as many slightly flawed ones do.
    - `text`: whether rows of small pieces may be lost.
    - `specks` of light that are seen, and `speck_share`, their share of the picture's area.
    - `hurt`: share of the picture's area that is missing or spilled by more than a reach. Below it, changes
      alone do not deny the word; below `outline_hurt`, neither does a stray outline.
    - `lost_share`: share of the picture's area in lost features wider than `lost_tubes`.
    - `patch_tubes`: width of what is missing or filled in one place of a part that keeps its shape: a beak
      between the eyes that it touches.
    - `astray_radii`: how far a strand or gap may lead off, radii, but for strands that cross a hole.
    - `leg_radii`: how far a leg of the mount may lead off, between the picture's top and foot.
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
    outline_hurt: float = 0.0
    lost_share: float = 0.0
    patch_tubes: float = inf
    astray_radii: float = inf
    leg_radii: float = inf


PATCH = 1.25  # tubes: a strand, and a reach beside either edge
# A shadow gets the first word whose rule holds; docs/verdict.md gives the reasons.
RULES = {
    "faithful": Rule(
        0.975, 0.6, 0.1, False, 0.0, 0.0, 0, False, 0.9, inf, False, 12, 0.002, patch_tubes=PATCH,
        astray_radii=4.0, leg_radii=1.0,
    ),
    "good": Rule(
        0.85, 1.5, inf, True, 0.5, 0.1, 2, False, 0.35, 0.3, False, 150, 0.02,
        outline_hurt=0.1, lost_share=0.01, patch_tubes=PATCH, astray_radii=4.0,
    ),
    "coarse": Rule(
        0.5, 4.0, inf, True, 0.8, 0.5, 3, True, 0.0, inf, True, hurt=0.22,
        outline_hurt=0.22, lost_share=0.15,
    ),
}  # fmt: skip
*_, UNKNOWN = WORDS
LOST_FEW = 0.02  # share of all pieces and holes that may be lost: one window of fifty
# shares of all pieces and holes, and of the area, that may not both be exceeded
LOST_PIECES, LOST_SHARE = 0.4, 0.03
# where so few of them are lost, so much of the area may be: a word is known without one letter of four
LOST_ONE, LOST_LARGE = 0.25, 0.33
# the largest rms and maximum displacement (shares of the picture's height) and stretch for each word, as
# judged by a person on pictures bent by 0 to 38 % (docs/verdict.md)
BENT = {"faithful": (0.02, 0.06, 2.0), "good": (0.05, 0.125, 4.0), "coarse": (0.08, 0.2, 10.0)}

LOSSES = {
    "tip": ("tip is cut off", "tips are cut off"),
    "piece": ("piece is lost", "pieces are lost"),
    "hole": ("hole is filled", "holes are filled"),
    "gap": ("gap is bridged", "gaps are bridged"),
    "stroke": ("stroke is broken", "strokes are broken"),
    "stray": ("piece is not in the picture", "pieces are not in the picture"),
    "leak": ("hole is not in the picture", "holes are not in the picture"),
    "shape": ("piece or hole is drawn out of shape", "pieces or holes are drawn out of shape"),
}


@dataclass(frozen=True)
class Facts:
    """What was measured of a shadow, to be held against the rules."""

    iou: float
    radius_mm: float  # half the width of the tube's shadow on the wall
    outline_radii: float
    tips: int
    touching: int
    lost: Sequence[tuple[float, float]]  # lost pieces and holes: width in tubes, share of the area
    changes: int
    apart: int  # changes, counting all bridges across one hole as one
    features: int
    shape: float
    misshapen: float  # what features out of shape lack of their likeness, summed
    text: int
    specks: int = 0
    speck_share: float = 0.0
    hurt: float = 0.0
    patch_tubes: float = 0.0
    astray: float = 0.0
    leg: float = 0.0
    fine: int = 0  # changes that are lost pieces or holes far thinner than the tube

    @property
    def widest_lost(self) -> float:
        """The width of the widest lost piece or hole, in widths of the tube."""
        return max((width for width, _ in self.lost), default=0.0)

    def specks_seen(self, rule: Rule) -> bool:
        """Return whether more specks of light are seen than a rule allows."""
        return self.specks > rule.specks or (
            self.specks > 1 and self.speck_share > rule.speck_share
        )

    def against(self, rule: Rule) -> list[str]:
        """List the conditions of a rule that do not hold, a sentence each."""
        most = max(rule.changed * self.features, rule.spared)
        changes = self.apart if rule.together else self.changes
        changes -= self.fine if rule.lost_tubes else 0
        wide = [one for one in self.lost if one[0] >= rule.lost_tubes]
        share = sum(area for _, area in wide)
        lost = bool(wide)
        if rule.hurt:  # judged by their share of the area, and by how many pieces they are
            many = len(wide) > LOST_PIECES * self.features
            most_share = LOST_LARGE if len(wide) <= LOST_ONE * self.features else rule.lost_share
            lost = share > most_share or (many and share > LOST_SHARE)
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
                self.outline_radii > rule.outline_radii and self.hurt > rule.outline_hurt
            ),
            f"a strand or gap leads off by {in_mm(self.astray)}, above {in_mm(rule.astray_radii)}": (
                self.astray > rule.astray_radii
            ),
            f"a patch {self.patch_tubes:.1f} tubes wide is missing or filled, above {rule.patch_tubes:g}": (
                self.patch_tubes > rule.patch_tubes
            ),
            f"a leg of the mount crosses the picture, up to {in_mm(self.leg)} off what is dark": (
                self.leg > rule.leg_radii
            ),
            name_losses("tip", self.tips): self.tips > rule.cut * self.features,
            f"{say_number(self.specks, 'speck')} of light within the shadow": self.specks_seen(
                rule
            ),
            f"pieces just touch at {say_number(self.touching, 'place')}, which no tube draws": (
                self.touching > 0 and not rule.touching
            ),
            f"lost pieces or holes up to {self.widest_lost:.1f} tubes wide": lost,
            f"{say_number(changes, 'change')} to its {of_it}": changes > most and much,
            f"a piece or hole {self.shape:.3f} alike, below {rule.shape:g}": self.shape
            < rule.shape,
            f"its pieces and holes out of shape by {self.misshapen / self.features:.2f} on average, above "
            f"{rule.misshapen:g}": self.misshapen > rule.misshapen * self.features,
            f"{say_number(self.text, 'row')} of small pieces lost": bool(self.text)
            and not rule.text,
        }
        return [sentence for sentence, holds in said.items() if holds]


def judge_bending(verdict: Recognition, bent: Bent) -> Recognition:
    """Return the verdict on a view, lowered to what its bending allows, with the reason."""
    found = (bent.rms, bent.most, bent.stretch)
    allowed = next(
        (
            word
            for word, most in BENT.items()
            if all(f <= m for f, m in zip(found, most, strict=True))
        ),
        UNKNOWN,
    )
    if allowed == WORDS[0]:
        return verdict
    rms, most, stretch = BENT[WORDS[WORDS.index(allowed) - 1]]
    why = (
        f"picture bent by {bent.rms:.1%} on average, {bent.most:.1%} at most, lengths changed up to "
        f"{bent.stretch:.1f} times: above {rms:.0%}, {most:.0%} or {stretch:g}"
    )
    word = max(verdict.word, allowed, key=WORDS.index)
    return replace(verdict, word=word, reasons=(*verdict.reasons, why))


def worst_verdict(views: Sequence[View]) -> Recognition | None:
    """Return the verdict on a piece: the worst of its views, with the losses of all; None without any."""
    judged = [(view.name, view.verdict) for view in views if view.verdict is not None]
    if not judged:
        return None
    # among views with the same word, the one whose outline is farther off
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
    """Check `recognisable`: a rule of `RULES` holds; not required if any shadow is `accepted`."""
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


def say_number(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def name_losses(kind: str, number: int) -> str:
    """Say how many losses of a kind there are, such as "2 holes are filled"."""
    return f"{number} {LOSSES[kind][number != 1]}"
