"""Describe a survey in a few lines, for a preview and before a build."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from typing import Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.design.candidates import PICTURE
from knotfab.design.small import Found
from knotfab.design.survey import SPILL, Survey, ViewSurvey
from knotfab.picture.opening import Loss, is_row
from knotfab.picture.read import Target
from knotfab_formats.scene import ResolvedView


def describe(found: Survey, exact: bool = False) -> list[str]:
    """Describe each silhouette, what the likely tube loses of it, and a guess of the print.

    Args:
        exact: whether to include the figures of the rule by which each picture was read.
    """
    lines = []
    if found.frames:
        lines.append(
            f"{found.frames} frames; the hardest to draw is {found.views[0].target.shown}."
        )
    for seen in found.views:
        lines.append(_describe_silhouette(seen, exact))
        lines += [f"  Note: {note}." for note in seen.target.notes]
        lines.append(_describe_losses(seen, found))
    lines += [f"  {line[0].upper()}{line[1:]}." for line in found.agreed]
    if found.refusal is None:
        return [*lines, *_describe_small(found), _describe_piece(found)]
    error = found.refusal
    why = error.why if error.what == PICTURE else f"{error.what}: {error.why}"
    return [*lines, f"  A build would refuse this: {why}. {error.remedy}"]


def _describe_silhouette(seen: ViewSurvey, exact: bool) -> str:
    """Describe pieces, holes, and the size on the wall."""
    width, height = seen.view.frame_mm
    rule = seen.target.rule if exact else re.sub(r" \[[^]]*\]", "", seen.target.rule)
    return (
        f"{seen.target.shown}: {rule}; {with_noun(seen.pieces, 'piece')}, "
        f"{with_noun(seen.holes, 'hole')}; {width:.0f} × {height:.0f} mm on the wall."
    )


def _describe_losses(seen: ViewSurvey, found: Survey) -> str:
    """Describe the tube that a build takes and what it loses, or say that no tube shows the picture."""
    thick = f"{2 * found.radius_mm:.1f} mm thick (radius {found.radius_mm:.2f} mm)"
    if seen.view.lines:
        text = f"  A build lays one tube {thick} along each of its strokes"
        return text + (f"; {seen.together:.0%} of them run together." if seen.together else ".")
    if not seen.recognisable and seen.likeness is not None:
        gone = f"its IoU would be about {seen.likeness.iou:.2f}"
        if seen.likeness.changes:
            which = f"{seen.likeness.changes} of its {seen.likeness.features} pieces and holes"
            gone = f"{which} would be lost or run together"
        return f"  Nobody would know it in the shadow of any tube that can be printed: {gone}."
    if not found.chosen:
        return f"  A build takes a tube at least {thick}, as thick as its time asks for."
    if found.radius_mm not in seen.losses:
        return f"  A build takes a tube {thick}."
    lost = sorted(seen.losses[found.radius_mm], key=lambda loss: -loss.extent)
    text = f"  A build takes a tube {thick}, which "
    spill = seen.spills.get(found.radius_mm, 0.0)
    beside = f", and {spill:.0%} as much beside it" if spill >= SPILL else ""
    if not lost:
        return f"{text}draws all of it{beside}."
    letters = seen.target.letters_at(loss.at for loss in lost)
    whose = f"it ({letters})" if letters and len(seen.target.letters) > 1 else "it"
    text += f"loses {with_noun(len(lost), 'part')} of {whose}; "
    text += f"the longest is {_describe_loss(lost[0], seen)}."
    if seen.whole_mm is not None and seen.whole_mm < found.radius_mm:
        radius = seen.whole_mm
        text += f" One {2 * radius:.1f} mm thick draws all of it (--tube-radius {radius:.2f})."
    return text


def _describe_loss(loss: Loss, seen: ViewSurvey) -> str:
    """Describe a loss's size and place in the picture."""
    scale, px = seen.wall_mm_per_px, seen.target.shrunk
    x, y = seen.target.to_picture(loss.at)
    return (
        f"{loss.extent * scale:.1f} mm ({loss.extent * px:.0f} px) long and "
        f"{loss.thickness * scale:.1f} mm ({loss.thickness * px:.0f} px) thick at ({x:.0f}, {y:.0f}) px"
    )


def _describe_small(found: Survey) -> list[str]:
    """Say what keeps the small parts of the pictures, and at what price; no line if the usual tube does."""
    small = found.small
    if small is None:
        return []
    lines, kept, usual = [], small.keeping_mm, small.usual_mm
    if kept is not None:
        beyond = [one for _, one in small.beyond]
        which, them = _name_small([s for s in small.lost if s[1] not in beyond], found)
        hours = _hours_more(found)
        if found.radius_mm == kept:
            printed = f", and print {hours} faster" if hours else ""
            lines.append(
                f"  It is this thin to keep {which}: one {2 * usual:.1f} mm thick (--tube-radius "
                f"{usual:.2f}) would lose {them}, search {small.slower:.1f} times as fast{printed}."
            )
        else:
            printed = f", and prints {hours} longer" if hours else ""
            lines.append(
                f"  It loses {which}: one {2 * kept:.1f} mm thick (--tube-radius {kept:.2f}) keeps {them}, "
                f"searches {small.slower:.1f} times as long{printed}."
            )
    if small.larger is not None:
        which, them = _name_small(small.beyond, found)
        side = math.ceil(found.views[small.beyond[0][0]].view.longer_mm * small.larger / 10) * 10
        if side <= 1000:  # larger pictures are not practical advice
            lines.append(
                f"  No printable tube draws {which} at this size; --size {side} keeps {them}."
            )
    return lines


def _name_small(parts: Found, found: Survey) -> tuple[str, str]:
    """Name small parts by picture; also return the pronoun for them."""
    named = []
    for number, seen in enumerate(found.views):
        own = [one for n, one in parts if n == number]
        pieces = [one.shape for one in own if one.kind == "piece"]
        holes = [one.shape for one in own if one.kind == "hole"]
        words = []
        if pieces:
            spelt = seen.target.is_text and any(sign.isalnum() for sign in seen.target.shown)
            noun = "letter" if spelt or is_row(pieces) else "small piece"
            words.append(with_noun(len(pieces), noun))
            middles = [(piece.centroid.x, piece.centroid.y) for piece in pieces]
            on_wall = seen.view.magnification * np.array(middles)
            letters = seen.target.letters_at(_to_pixels(seen.view, seen.target, on_wall).tolist())
            words[-1] += f" ({letters})" if letters and (spelt or not seen.target.is_text) else ""
        if holes:
            words.append(with_noun(len(holes), "small hole"))
        if words:
            wide = max(one.extent for one in own) * seen.view.magnification
            named.append(f"{' and '.join(words)} of {seen.target.shown} (up to {wide:.1f} mm)")
    return ", ".join(named), "it" if len(parts) == 1 else "them"


def _hours_more(found: Survey) -> str:
    """Say how many more hours the thinner tube takes to print; "" if the guesses are equal."""
    first, second = found.guess, found.otherwise
    if second is None or not first.hours or not second.hours:
        return ""
    more = first.hours - second.hours
    if found.small is not None and found.radius_mm != found.small.keeping_mm:
        more = -more
    return _round(more, "h") if more >= 0.05 * first.hours else ""


def _describe_piece(found: Survey) -> str:
    wide, high = found.views[0].piece_mm
    text = f"  The piece is about {wide:.0f} × {high:.0f} mm across"
    guess = found.guess
    if guess.hours is not None and max(wide, high) > 2000.0:
        return f"{text}, which no printer makes: is the size meant in mm (--size 50cm)?"
    if not found.chosen:
        return text + "."
    each = " a frame" if found.frames else ""
    text += f"; a guess: {_round(guess.mass_g, 'g')}"
    if guess.hours is not None:
        held = "without supports" if guess.alone else "with its supports"
        text += f" and {_round(guess.hours, 'h')} {held}"
    if guess.without:
        text += f"{',' if guess.hours is not None else ''} without {guess.without}"
    return text + each + "."


def with_noun(number: int, noun: str) -> str:
    """Write a count with its noun in the right number: "no holes", "1 piece", "2 losses"."""
    return f"{number or 'no'} {noun}{'' if number == 1 else 'es' if noun[-1] == 's' else 's'}"


def _round(value: float, unit: str) -> str:
    """Round to two digits; a mass below 1 g or a time below 0.1 h is given as that bound."""
    least = {"g": 1.0, "h": 0.1}[unit]
    if value < least:
        return f"less than {least:g} {unit}"
    return f"{value:.2g} {unit}" if value < 100 else f"{round(value, -1):.0f} {unit}"


def list_figures(found: Survey) -> dict[str, Any]:
    """Return the survey as plain data: lengths in mm, places in px of the picture."""
    views = []
    bounds = found.bounds or (None,) * len(found.views)
    for seen, bound in zip(found.views, bounds, strict=True):
        losses = [
            {
                "tube_radius_mm": radius,
                "lost": [
                    {
                        "at_px": [round(c, 1) for c in seen.target.to_picture(loss.at)],
                        "length_px": round(loss.extent * seen.target.shrunk, 1),
                        "thickness_px": round(loss.thickness * seen.target.shrunk, 1),
                        "length_mm": round(loss.extent * seen.wall_mm_per_px, 2),
                        "thickness_mm": round(loss.thickness * seen.wall_mm_per_px, 2),
                        "needed_radius_mm": round(0.5 * loss.thickness / seen.px_per_mm, 3),
                    }
                    for loss in lost
                ],
            }
            for radius, lost in seen.losses.items()
        ]
        bent = seen.target.bending
        views.append(
            {
                **({} if bound is None else {"bound": round(bound.iou, 4)}),
                **({} if bent is None else {"bending": asdict(bent)}),
                "picture": seen.target.name,
                "silhouette": seen.target.rule,
                "notes": list(seen.target.notes),
                "pieces": seen.pieces,
                "holes": seen.holes,
                "frame_mm": [round(side, 2) for side in seen.view.frame_mm],
                "piece_mm": [round(side, 2) for side in seen.piece_mm],
                "whole_radius_mm": seen.whole_mm,
                "recognisable": seen.recognisable,
                "radii": losses,
            }
        )
    return {
        "schema": 1,
        "views": views,
        "tube_radius_mm": found.radius_mm,
        "refusal": None
        if found.refusal is None
        else f"{found.refusal.why}. {found.refusal.remedy}",
        "guess": {"mass_g": round(found.guess.mass_g, 1), "hours": found.guess.hours},
        "lines": describe(found),
    }


def _to_pixels(view: ResolvedView, target: Target, places: Array) -> Array:
    """Map places (n, 2) on the wall, mm right of and above its middle, to pixels."""
    wide, high = view.frame_mm
    across = places[:, 0] * target.width / wide + (target.width - 1) / 2
    down = (view.frame_up_mm - places[:, 1]) * target.height / high + (target.height - 1) / 2
    return np.column_stack([across, down])
