"""What a survey found, in a few lines: the same before a build and in a preview."""

from __future__ import annotations

import re
from math import floor
from typing import Any

from knotfab.preview.survey import DRAWN_WELL, Survey, ViewSurvey
from knotfab.target.opening import Loss

__all__ = ["count", "describe", "list_figures"]


def describe(found: Survey, exact: bool = False) -> list[str]:
    """A few lines: each picture's silhouette, what the likely tube loses of it, and a guess of the print.

    Args:
        exact: with the figures of the rule by which each picture was read.
    """
    lines = []
    if found.frames:
        lines.append(f"{found.frames} frames; the hardest to draw is {found.views[0].target.name}.")
    for seen in found.views:
        lines.append(_describe_silhouette(seen, exact))
        lines += [f"  Note: {note}." for note in seen.target.notes]
        lines.append(_describe_losses(seen, found))
    lines.append(_describe_piece(found))
    return lines


def _describe_silhouette(seen: ViewSurvey, exact: bool) -> str:
    """What is drawn, pieces, holes, and the size on the wall."""
    width, height = seen.view.frame_mm
    rule = seen.target.rule if exact else re.sub(r" \[[^]]*\]", "", seen.target.rule)
    return (
        f"{seen.target.name}: {rule}; {count(seen.pieces, 'piece')}, "
        f"{count(seen.holes, 'hole')}; {width:.0f} × {height:.0f} mm on the wall."
    )


def _describe_losses(seen: ViewSurvey, found: Survey) -> str:
    """What the tube that is likely loses, and how thick one may be."""
    if seen.view.lines == "on":
        text = f"  One tube of {found.radius_mm:.2f} mm radius runs along each of its strokes"
        return text + (f"; {seen.together:.0%} of them run together." if seen.together else ".")
    if seen.likeness is not None and not seen.recognisable:
        gone = f"its IoU would be about {seen.likeness.iou:.2f}"
        if seen.likeness.changes:
            which = f"{seen.likeness.changes} of its {count(seen.likeness.features, 'piece')}"
            gone = f"{which} and holes would be lost or run together"
        return f"  Nobody would know it in the shadow of any tube that can be printed: {gone}."
    radius = min(seen.losses, key=lambda r: abs(r - found.radius_mm))
    lost = seen.losses[radius]
    text = f"  A tube of {radius:.2f} mm radius loses "
    text += f"{count(len(lost), 'part')} of it" if lost else "no part of it"
    if lost:
        text += f"; the largest is {_describe_loss(lost[0], seen)}"
    return f"{text}. {_describe_radii(seen)}"


def _describe_radii(seen: ViewSurvey) -> str:
    """How thick a tube may be, to draw it well and lose nothing."""
    well, whole = seen.feasible_mm, seen.whole_mm
    if well is None:
        return "None that can be printed draws it well."
    reach = f"an IoU of {DRAWN_WELL:g} is within reach of those of up to {well:.2f} mm."
    if whole is None:
        return f"None that can be printed draws all of it; {reach}"
    told = floor(100 * whole) / 100
    if told < floor(100 * well) / 100:
        return f"Tubes of up to {told:.2f} mm draw all of it; {reach}"
    return f"Tubes of up to {well:.2f} mm draw it well."


def _describe_loss(loss: Loss, seen: ViewSurvey) -> str:
    """Its size, its place, and the tube that it would need."""
    scale, px = seen.wall_mm_per_px, seen.target.shrunk
    x, y = seen.target.to_picture(loss.at)
    need = 0.5 * loss.thickness / seen.px_per_mm
    return (
        f"{loss.extent * scale:.1f} mm ({loss.extent * px:.0f} px) long and "
        f"{loss.thickness * scale:.1f} mm ({loss.thickness * px:.0f} px) thick at "
        f"({x:.0f}, {y:.0f}) px, which needs a radius of {need:.2f} mm"
    )


def _describe_piece(found: Survey) -> str:
    wide, high = found.views[0].piece_mm
    text = f"  The piece is about {wide:.0f} × {high:.0f} mm across"
    guess = found.guess
    each = " a frame" if found.frames else ""
    text += f"; a guess, with a tube of {found.radius_mm:.1f} mm: {_round(guess.mass_g)} g"
    if guess.hours is not None:
        text += f" and {_round(guess.hours)} h with its supports"
    return text + each + "."


def count(number: int, noun: str) -> str:
    """So many of them, as a person says it."""
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _round(value: float) -> str:
    """To the two digits that a guess has."""
    return f"{value:.2g}" if value < 100 else f"{round(value, -1):.0f}"


def list_figures(found: Survey) -> dict[str, Any]:
    """The survey as plain data: lengths in mm, places in px of the picture."""
    views = []
    for seen in found.views:
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
        views.append(
            {
                "picture": seen.target.name,
                "silhouette": seen.target.rule,
                "notes": list(seen.target.notes),
                "pieces": seen.pieces,
                "holes": seen.holes,
                "frame_mm": [round(side, 2) for side in seen.view.frame_mm],
                "piece_mm": [round(side, 2) for side in seen.piece_mm],
                "feasible_radius_mm": seen.feasible_mm,
                "whole_radius_mm": seen.whole_mm,
                "recognisable": seen.recognisable,
                "radii": losses,
            }
        )
    return {
        "schema": 1,
        "views": views,
        "tube_radius_mm": round(found.radius_mm, 3),
        "guess": {"mass_g": round(found.guess.mass_g, 1), "hours": found.guess.hours},
        "lines": describe(found),
    }
