"""Describe a survey in a few lines, for a preview and before a build."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.design.candidates import PICTURE
from knotfab.design.small import Found
from knotfab.design.survey import SPILL, Survey, ViewSurvey, smaller_size
from knotfab.picture.opening import is_row
from knotfab.picture.read import Target
from knotfab_formats.errors import in_digits
from knotfab_formats.scene import ResolvedScene, ResolvedView

_SMALL = 0.6  # share of a picture's sides below which its drawing is offered alone
_LONG_H = 48.0  # a print that takes longer is offered a smaller size
_PLATES = {"roots": "in roots", "outline": "in a plate of its outline"}
GUESSED_TOLD, READ_TOLD = 0.25, 0.5  # told from which on a picture may be guessed, and is read
OPEN_HOLDER = "on the holder that costs least"
_MOUNTS = {"wall": "on pegs", "stand": "on a stand", "hang": "on threads", "none": "with no holder"}


def describe(found: Survey) -> list[str]:
    """Describe how each picture is read, the tube and what it loses, the piece, and what else is done."""
    lines = []
    if found.frames:
        lines.append(
            f"{found.frames} frames; the hardest to draw is {found.views[0].target.shown}."
        )
    for seen in found.views:
        width, height = seen.view.frame_mm
        rule = re.sub(r" \[[^]]*\]", "", seen.target.rule)
        lines.append(
            f"{seen.target.shown}: {rule}; {with_noun(seen.pieces, 'piece')}, "
            f"{with_noun(seen.holes, 'hole')}; {width:.0f} × {height:.0f} mm on the wall."
        )
        lines += [f"  Note: {note}." for note in seen.target.notes]
    told = [f"  {line[0].upper()}{line[1:]}." for line in found.told]
    if (error := found.refusal) is not None:
        why = error.why if error.what == PICTURE else f"{error.what}: {error.why}"
        return [*lines, *told, f"  A build would refuse this: {why}. {error.remedy}"]
    return [
        *lines,
        _describe_tube(found),
        *_describe_small(found),
        _describe_piece(found),
        *_describe_told(found),
        *_describe_margin(found),
        *_describe_outsized(found),
        *told,
    ]


def _describe_tube(found: Survey) -> str:
    """Describe the tube, and what it loses of each picture."""
    thick = f"{2 * found.radius_mm:.1f} mm thick (radius {found.radius_mm:.2f} mm)"
    if not found.chosen:
        return f"  A tube at least {thick}, as thick as its time asks for."
    said = []
    for seen in found.views:
        of = f" of {seen.target.shown}" if len(found.views) > 1 else ""
        if seen.view.lines:
            along = ", along each stroke"
            said.append(f"{along}; {seen.together:.0%} run together" if seen.together else along)
        elif seen.losses:
            said.append(f" loses {_describe_losses(seen, found)}{of}")
        elif seen.losses is not None:
            said.append(f" draws all{of or ' of it'}")
        if seen.spill >= SPILL:
            said[-1] += f", and {seen.spill:.0%} as much beside it"
    return f"  A tube {thick}{';'.join(said)}."


def _describe_losses(seen: ViewSurvey, found: Survey) -> str:
    """Count what the tube loses, and tell the size and place of the longest, in px of the picture."""
    losses = seen.losses or ()
    longest = max(losses, key=lambda loss: loss.extent)
    x, y = seen.target.to_picture(longest.at)
    letters = seen.target.letters_at(loss.at for loss in losses) if found.small is None else ""
    named = f" ({letters})" if letters and len(seen.target.letters or ()) > 1 else ""
    long, thick = (seen.wall_mm_per_px * one for one in (longest.extent, longest.thickness))
    size = f"up to {long:.1f} × {thick:.1f} mm at ({x:.0f}, {y:.0f}) px"
    return f"{with_noun(len(losses), 'part')}{named}, {size}"


def _describe_small(found: Survey) -> list[str]:
    """Say what keeps the small parts of the pictures, and at what price; no line if the usual tube does."""
    small = found.small
    if small is None:
        return []
    lines, kept = [], small.keeping_mm
    if kept is not None:
        beyond = [one for _, one in small.beyond]
        which = _name_small([s for s in small.lost if s[1] not in beyond], found)
        times = f"{small.slower:.1f} times as"
        if found.radius_mm == kept:
            other = f"--tube-radius {small.usual_mm:.2f} would lose, at a search {times} fast"
            lines.append(f"  It is this thin to keep {which}, which {other}.")
        else:
            other = f"--tube-radius {kept:.2f} keeps, at a search {times} long"
            lines.append(f"  It loses {which}, which {other}.")
    if small.larger is not None:
        side = math.ceil(found.views[small.beyond[0][0]].view.longer_mm * small.larger / 10) * 10
        if side <= 1000:  # larger pictures are not practical advice
            which = _name_small(small.beyond, found)
            lines.append(f"  No printable tube draws {which} at this size, but at --size {side}.")
    return lines


def _name_small(parts: Found, found: Survey) -> str:
    """Name small parts by picture."""
    named = []
    for number, seen in enumerate(found.views):
        own = [one for n, one in parts if n == number]
        pieces = [one.shape for one in own if one.kind == "piece"]
        words = []
        if pieces:
            spelt = seen.target.is_text and any(sign.isalnum() for sign in seen.target.shown)
            noun = "letter" if spelt or is_row(pieces) else "small piece"
            middles = np.array([(piece.centroid.x, piece.centroid.y) for piece in pieces])
            on_wall = seen.view.magnification * middles
            letters = seen.target.letters_at(_to_pixels(seen.view, seen.target, on_wall).tolist())
            shown = f" ({letters})" if letters and (spelt or not seen.target.is_text) else ""
            words.append(with_noun(len(pieces), noun) + shown)
        if holes := len(own) - len(pieces):
            words.append(with_noun(holes, "small hole"))
        if words:
            named.append(f"{' and '.join(words)} of {seen.target.shown}")
    return ", ".join(named)


def _describe_piece(found: Survey) -> str:
    """Describe the piece's size, its holder, and a guess of what it takes to print."""
    wide, high = found.views[0].piece_mm
    held, guess = hold_of(found.scene), found.guess
    size = f"  The piece is some {wide:.0f} × {high:.0f} mm across"
    if guess.hours is not None and max(wide, high) > 2000.0:
        return f"{size}, which no printer makes: is the size meant in mm (--size 50cm)?"
    text = f"{size}{held and ', '}{held}"
    if guess.hours is not None:
        text += ", without supports" if guess.alone else ", with supports"
    if not found.chosen:
        return f"{text}."
    hours = "" if guess.hours is None else f" and {_round(guess.hours, 'h')}"
    without = f", without {guess.without}" if guess.without else ""
    each = " a frame" if found.frames else ""
    return f"{text}: about {_round(guess.mass_g, 'g')}{hours}{without}{each}."


def _describe_told(found: Survey) -> list[str]:
    """Say how well the picture is read from the unlit piece; no line where nobody has looked."""
    told = found.guess.told if found.chosen and found.scene.piece.printed else None
    if told is None:
        return []
    return [f"  Unlit, its picture {word_of_told(told)} from aside (told some {told:.2g})."]


def word_of_told(share: float) -> str:
    """Say what happens to a picture of which a piece tells this share unlit."""
    if share < GUESSED_TOLD:
        return "is not read"
    return "may be guessed" if share < READ_TOLD else "is read"


def _describe_margin(found: Survey) -> list[str]:
    """Say that a drawing is much smaller than its picture, such as a sheet, and how to size it alone."""
    seen = found.views[0]
    drawn, frame = seen.piece_mm, seen.view.frame_mm
    share = max(a * seen.view.magnification / b for a, b in zip(drawn, frame, strict=True))
    if len(found.views) > 1 or found.frames or share >= _SMALL:
        return []
    return [
        f"  It fills {share:.0%} of its picture: with --crop auto it is {max(frame):.0f} mm long itself."
    ]


def _describe_outsized(found: Survey) -> list[str]:
    """Say that a piece is larger than the bed, or prints for over two days, and the size that would do."""
    printer, guess, size = found.scene.printer, found.guess, found.views[0].view.longer_mm
    bed, piece = sorted(printer.build_volume_mm), sorted(found.views[0].piece_mm)
    share = min(room / side for room, side in zip(bed[1:], piece, strict=True))
    slow = guess.hours is not None and guess.hours > _LONG_H
    quicker = smaller_size(size, _LONG_H / guess.hours, 2) if guess.hours and slow else size
    if not found.scene.piece.printed or found.frames or max(piece) > 2000.0:
        return []
    if share < 1:
        room = " × ".join(f"{side:.0f}" for side in printer.build_volume_mm)
        fits = min(smaller_size(size, share, 1), quicker)
        return [
            f"  That is larger than {printer.name} prints ({room} mm): --size {fits:g} would fit, or another "
            "--printer."
        ]
    if slow:
        return [
            f"  That prints for more than two days: --size {quicker} would take about {_LONG_H:.0f} h."
        ]
    return []


def hold_of(scene: ResolvedScene) -> str:
    """Say what the piece stands in or hangs from; "" where it is not printed, and so not held."""
    mount = scene.mount
    if mount.on_feet:
        return _PLATES.get(mount.plate, f"in a {mount.plate} plate")
    if mount.kind != "auto" or not scene.piece.printed:
        return _MOUNTS.get(mount.kind, "")
    alone = scene.piece.supports == "none"
    return _MOUNTS["none"] if alone else OPEN_HOLDER


def with_noun(number: int, noun: str) -> str:
    """Write a count with its noun in the right number: "no holes", "1 piece", "2 losses"."""
    return f"{number or 'no'} {noun}{'' if number == 1 else 'es' if noun[-1] == 's' else 's'}"


def _round(value: float, unit: str) -> str:
    """Round to two digits; a mass below 1 g or a time below 0.1 h is given as that bound."""
    least = {"g": 1.0, "h": 0.1}[unit]
    if value < least:
        return f"less than {least:g} {unit}"
    return f"{in_digits(value)} {unit}"


def list_figures(found: Survey) -> dict[str, Any]:
    """Return the survey as plain data: lengths in mm, places in px of the picture."""
    views = [
        {
            "picture": seen.target.name,
            "silhouette": seen.target.rule,
            "notes": list(seen.target.notes),
            "pieces": seen.pieces,
            "holes": seen.holes,
            "frame_mm": [round(side, 2) for side in seen.view.frame_mm],
            "piece_mm": [round(side, 2) for side in seen.piece_mm],
            "lost": [
                {
                    "at_px": [round(c, 1) for c in seen.target.to_picture(loss.at)],
                    "length_mm": round(loss.extent * seen.wall_mm_per_px, 2),
                    "thickness_mm": round(loss.thickness * seen.wall_mm_per_px, 2),
                }
                for loss in seen.losses or ()
            ],
        }
        for seen in found.views
    ]
    error, guess = found.refusal, found.guess
    return {
        "schema": 2,
        "views": views,
        "tube_radius_mm": found.radius_mm,
        "holder": hold_of(found.scene),
        "supports": not guess.alone,
        "guess": {
            "mass_g": round(guess.mass_g, 1),
            "hours": guess.hours,
            "told": guess.told and round(guess.told, 2),
        },
        "refusal": None if error is None else f"{error.why}. {error.remedy}",
        "lines": describe(found),
    }


def _to_pixels(view: ResolvedView, target: Target, places: Array) -> Array:
    """Map places (n, 2) on the wall, mm right of and above its middle, to pixels."""
    wide, high = view.frame_mm
    across = places[:, 0] * target.width / wide + (target.width - 1) / 2
    down = (view.frame_up_mm - places[:, 1]) * target.height / high + (target.height - 1) / 2
    return np.column_stack([across, down])
