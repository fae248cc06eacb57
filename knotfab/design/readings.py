"""Try several ways to read one picture as a silhouette, for a person to pick from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from knotfab.base.arrays import Mask
from knotfab.base.errors import SceneError
from knotfab.base.limited import run_limited
from knotfab.design.candidates import PICTURE
from knotfab.design.frames import frame_view, widen_targets
from knotfab.design.sentence import describe, with_noun
from knotfab.design.survey import Survey, ViewSurvey, find_refusal, find_unlike, survey_views
from knotfab.picture.colours import common_colours, is_grainy, is_photo
from knotfab.picture.doubt import is_guessed, rate_mask, write_options
from knotfab.picture.raster import encode_image
from knotfab.picture.read import Target, read_target
from knotfab.picture.silhouette import (
    fill_holes,
    fit_size,
    holes_of,
    mask_iou,
    pieces_of,
    sample_mask,
)
from knotfab.picture.source import SECONDS, Glimpse, glimpse, look_at
from knotfab.picture.subject import middle_boxes
from knotfab_formats.bounds import as_written
from knotfab_formats.errors import InputError, shown
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.views import View

# px of the longer side at which readings are tried; the grain of a large photograph tells nothing
_SIDE, _PHOTO_SIDE = 800, 400
MOST = 6  # number of readings to show
_ALIKE = 0.93  # IoU from which two silhouettes count as one choice
_GRAINS = 200  # pieces and holes of a photograph above which a reading is passed over
# the score of a cut-out without features, as a share of its whole score, and what each adds to it
_BLOB, _FEATURE = 0.4, 0.1
_PANEL, _TEXT, _GAP, _COLUMNS = 300, 68, 14, 3  # layout of the sheet: three in px, and the columns
_PAPER, _INK, _RED = (250, 248, 244), (60, 58, 56), (190, 30, 30)


@dataclass(frozen=True)
class TriedReading:
    """One way to read a picture.

    `keys` are keys of a scene's view (`ink`, `speck_px`, …). `score`, from 0 to 1, rates how compact the
    silhouette is. `refusal` is the reason why a build would refuse it, None if it would not.
    """

    keys: dict[str, Any]
    target: Target
    score: float
    refusal: str | None

    @property
    def options(self) -> str:
        """The options of `knotfab build` for this reading, quoted for a shell; "" if none are needed."""
        return write_options(self.keys)

    def thumbnail(self, longest_px: int = _PANEL) -> bytes:
        """Draw the silhouette, dark on light, as a PNG of at most `longest_px` on a side."""
        return encode_image(_paint(self.target.mask, longest_px))

    def to_dict(self) -> dict[str, Any]:
        """Return the reading as plain data, without its picture."""
        return {
            "options": self.options,
            "keys": {key: as_written(View, key, value) for key, value in self.keys.items()},
            "score": round(self.score, 3),
            "refusal": self.refusal,
            "rule": self.target.rule,
        }


def is_unclear(found: Survey) -> bool:
    """Return whether the picture may have been misread.

    That is so if a build refuses it, if it has many pieces and holes, if white is drawn beside other
    colours, or if the reading was a guess.
    """
    if len(found.views) != 1 or found.frames:
        return False
    (seen,) = found.views
    refused = found.refusal is not None and found.refusal.what == PICTURE
    guessed = is_guessed(seen.target.notes) or seen.target.doubt is not None
    return refused or guessed or seen.target.draws_white or seen.pieces + seen.holes >= 24


def advise(found: Survey, readings: Sequence[TriedReading]) -> Survey:
    """Add remedies to the refusal of a survey: another reading, or a subject cut out of a photograph."""
    error, seen = found.refusal, found.views[0]
    if error is None or len(found.views) > 1 or found.frames or error.what != PICTURE:
        return found
    taken = [r for r in readings if not r.refusal and r.options]
    better = [r.options for r in taken if "subject_px" not in r.keys]
    cut = [r.options for r in taken if "subject_px" in r.keys]
    remedy = error.remedy
    if better:
        shown = f"knotfab preview shows {with_noun(len(readings), 'reading')}"
        remedy = f"Read it otherwise ({better[0]}; {shown}). {remedy}"
    image = glimpse(seen.target.png_bytes, seen.target.name).image
    if not seen.view.cut_out and is_photo(image):
        example = f", such as {cut[0]}, which a build would take" if cut else ""
        remedy = (
            "Cut one thing out of the photograph: --subject LEFT,TOP,WIDTH,HEIGHT, a rectangle about it "
            f"in px{example}. {remedy}"
        )
    return replace(found, refusal=SceneError(error.what, error.why, remedy))


def try_readings(
    source: str | Path, scene: ResolvedScene, *, base: Path | None = None, font: str | None = None
) -> tuple[TriedReading, ...]:
    """Return at most `MOST` readings of one picture, best first, those that a build would take before others.

    As ink they take what stands out, what is dark, what is light, what the border's colours do not reach, or
    one of the commonest colours; from a photograph also what can be cut out of its middle. Each is cleaned by
    the degree that leaves the most compact drawing: not at all, without specks, smoothed, or the largest
    piece alone. Only the best of readings that look alike is kept.

    Args:
        source, base, font: as for `read_target`. scene: its one view says how the picture is read so far; its
            crop, threshold and inversion hold for all readings.

    Raises:
        InputError: the picture cannot be read in any of these ways.
    """
    look_at(source, base)
    return run_limited(
        lambda: _try_readings(source, scene, base, font),
        shown(source),
        seconds=5 * SECONDS,
        verb="trying readings of it",
    )


def _try_readings(
    source: str | Path, scene: ResolvedScene, base: Path | None, font: str | None
) -> tuple[TriedReading, ...]:
    view, seen = scene.views[0], look_at(source, base)
    grainy = seen is not None and seen.shrunk > 1 and is_grainy(seen.image)
    side = _PHOTO_SIDE if grainy else _SIDE

    def attempt(keys: dict[str, Any]) -> _Attempt | None:
        """Read the picture with these keys; None if that holds no shape."""
        changed = scene.but(views=(scene.views[0].but(**keys),))
        try:
            target = read_target(source, changed.views[0], base=base, font=font, glance=side)
            return _Attempt(keys, *widen_targets(changed, (target,)), None, grainy)
        except SceneError as error:
            return _Attempt(keys, changed, (target,), error)
        except InputError:
            return None

    px = _tube_px(source, scene, base, font, side)
    plain = attempt({})
    doubt = None if plain is None else plain.target.doubt
    other = None if doubt is None else attempt(dict(doubt.keys))
    found: list[_Attempt] = []
    for way in _ways(seen, view):
        tried: list[tuple[float, int, _Attempt]] = []
        # a cut-out needs no cleaning
        for level, cleaning in enumerate(({},) if "subject_px" in way else _cleanings(px)):
            keys = {**way, **cleaning}
            one = attempt(keys) if keys else plain
            if one is None:
                break
            # milder cleaning is preferred: each degree costs a tenth of the score
            tried.append((-one.score * 0.9**level, level, one))
        tried.sort()
        found += [one for *_, one in tried if not one.refused][:1] or [one for *_, one in tried[:1]]
    if not found:
        raise InputError(str(source), "no reading of it holds a shape", "Draw it as dark on white.")
    found.sort(key=lambda one: (one.refused, -one.score))
    if plain is not None and other is not None:  # what is unsure comes first
        found = [plain, other, *found]
    kept: list[_Attempt] = []
    for one in found:
        if not any(_alike(one.target.mask, other.target.mask) for other in kept):
            kept.append(one)
    return tuple(one.told() for one in kept[:MOST])


@dataclass(frozen=True)
class _Attempt:
    """A reading that is tried. Whether a build refuses it, and why, takes long, and is found where needed."""

    keys: dict[str, Any]
    scene: ResolvedScene
    targets: tuple[Target, ...]
    error: SceneError | None = None
    grainy: bool = False

    @property
    def target(self) -> Target:
        return self.targets[0]

    @cached_property
    def score(self) -> float:
        mask, view = self.target.mask, self.scene.views[0]
        if not view.cut_out:
            return rate_mask(mask, bool(view.lines))
        features = len(holes_of(mask)[1])  # a cut-out without any is a blob
        return rate_mask(fill_holes(mask, mask.size)) * min(1.0, _BLOB + _FEATURE * features)

    @cached_property
    def _views(self) -> tuple[ViewSurvey, ...]:
        return survey_views(self.scene, self.targets)

    @cached_property
    def _grains(self) -> int:
        mask = self.target.mask
        count = len(pieces_of(mask)[1]) + len(holes_of(mask)[1]) if self.grainy else 0
        return count if count > _GRAINS else 0

    @cached_property
    def refused(self) -> bool:
        if self._grains or self.error or find_unlike(self._views, self.scene):
            return True
        return find_refusal(self._views, self.scene) is not None

    def told(self) -> TriedReading:
        why = None
        if self._grains:
            why = f"it has {self._grains} pieces and holes, most of them the grain of a photograph"
        elif error := self.error or find_refusal(self._views, self.scene):
            why = error.why
        return TriedReading(self.keys, self.target, self.score, why)


def _cleanings(tube_px: float) -> Iterator[dict[str, Any]]:
    """Yield keys that clean a silhouette, mildest first; `tube_px` is the width of the thinnest shadow."""
    specks = _round_up(tube_px**2)
    yield {}
    yield {"speck_px": specks}
    yield {"speck_px": 4 * specks, "smooth_px": round(max(1.0, 0.25 * tube_px), 1)}
    yield {"speck_px": 16 * specks, "smooth_px": round(max(1.0, 0.5 * tube_px), 1)}
    yield {
        "speck_px": 16 * specks,
        "smooth_px": round(max(1.0, 0.5 * tube_px), 1),
        "keep_largest": 1,
    }


def _round_up(value: float) -> int:
    """Round up to a number with one significant digit, or two if the second is a 5."""
    ten = 10 ** int(np.log10(max(value, 1.0)))
    step = 5 * ten if value > 2 * ten else ten
    return int(step * np.ceil(value / step))


def _tube_px(
    source: str | Path, scene: ResolvedScene, base: Path | None, font: str | None, side: int
) -> float:
    """Return the width of the thinnest tube's shadow, in px of the picture."""
    for ink in ("auto", "dark", "light"):
        reading = scene.views[0].but(ink=ink)
        try:
            target = read_target(source, reading, base=base, font=font, glance=side)
        except InputError:
            continue
        view = frame_view(scene.views[0], target)
        px_per_mm = view.px_per_mm(target.width) * target.shrunk
        return 2.0 * scene.printer.min_tube_radius_mm * px_per_mm
    return 10.0


def _ways(seen: Glimpse | None, view: View) -> list[dict[str, Any]]:
    """List keys that say what counts as ink: first as the scene has it, then the alternatives."""
    if view.cut_out:
        return [{}]
    image = Image.new("1", (1, 1)) if seen is None else seen.image  # of a vector picture nothing
    inks = ["auto", "dark", "light", "flood", *common_colours(image)]
    ways: list[dict[str, Any]] = [{}, *({"ink": ink} for ink in inks if ink != view.ink)]
    if not is_photo(image):
        return ways
    frame = {"crop_px": None} if view.crop_px is False else {}
    return ways + [
        {"subject_px": box, **frame} for box in middle_boxes(*(seen.size if seen else image.size))
    ]


def _alike(one: Mask, other: Mask) -> bool:
    """Return whether two masks of one picture look the same at a glance."""
    if one.shape != other.shape:
        return False
    size = fit_size(one.shape[1], one.shape[0], 128)  # px
    return mask_iou(*(sample_mask(mask, *size) for mask in (one, other))) >= _ALIKE


def _paint(mask: Mask, longest_px: int) -> Image.Image:
    size = fit_size(mask.shape[1], mask.shape[0], longest_px)
    share = Image.fromarray(np.where(mask, 0, 255).astype(np.uint8)).resize(
        size, Image.Resampling.BOX
    )
    return Image.composite(Image.new("RGB", size, _PAPER), Image.new("RGB", size, _INK), share)


def draw_readings(readings: Sequence[TriedReading]) -> bytes:
    """Draw a PNG that shows each reading's silhouette, numbered, with the options that give it."""
    rows = -(-len(readings) // _COLUMNS)
    painted = [_paint(one.target.mask, _PANEL) for one in readings]
    high = max(picture.height for picture in painted) + _TEXT + _GAP
    columns = min(_COLUMNS, len(readings))
    sheet = Image.new("RGB", (_GAP + columns * (_PANEL + _GAP), _GAP + rows * high), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for n, (one, picture) in enumerate(zip(readings, painted, strict=True)):
        left, top = _GAP + n % _COLUMNS * (_PANEL + _GAP), _GAP + n // _COLUMNS * high
        lines = wrap(f"{n + 1}: {one.options or 'as it is read'}", 42)
        pen.text((left, top), "\n".join(lines), fill=_INK, font=font, spacing=2)
        said, colour = ("a build would refuse it", _RED) if one.refusal else (_parts(one), _INK)
        pen.text((left, top + 38), said, fill=colour, font=font)
        sheet.paste(picture, (left, top + _TEXT - 8))
    return encode_image(sheet, compress_level=6)


def _parts(one: TriedReading) -> str:
    pieces, holes = (len(found(one.target.mask)[1]) for found in (pieces_of, holes_of))
    return f"{with_noun(pieces, 'piece')}, {with_noun(holes, 'hole')}"


def describe_readings(readings: Sequence[TriedReading], sheet: str) -> list[str]:
    """List the readings and their options, one a line; `sheet` names the picture that shows them."""
    if not readings:
        return []
    lines = [
        f"  It may be meant otherwise: {sheet} shows {with_noun(len(readings), 'reading')}. Options for each:"
    ]
    for number, one in enumerate(readings, start=1):
        refused = "  (a build would refuse it)" if one.refusal else ""
        lines.append(f"    {number}: {one.options or 'none, as it is read'}{refused}")
    return lines


def list_figures(found: Survey, readings: Sequence[TriedReading] = ()) -> dict[str, Any]:
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
        **({"readings": [one.to_dict() for one in readings]} if readings else {}),
    }
