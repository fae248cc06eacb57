"""Try several ways to read one picture as a silhouette, for a person to pick from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from knotfab.base.arrays import Mask
from knotfab.base.disk import at_home
from knotfab.base.errors import SceneError
from knotfab.base.limited import run_limited
from knotfab.design.candidates import PICTURE
from knotfab.design.frames import frame_view, widen_targets
from knotfab.design.sentence import describe, with_noun
from knotfab.design.survey import Survey, find_refusal, survey_views
from knotfab.picture import raster
from knotfab.picture.doubt import is_guessed, rate_mask, write_options
from knotfab.picture.raster import encode_image
from knotfab.picture.read import SECONDS, Target, read_bytes, read_target
from knotfab.picture.silhouette import (
    fill_holes,
    fit_size,
    holes_of,
    mask_iou,
    pieces_of,
    sample_mask,
)
from knotfab.picture.subject import middle_boxes
from knotfab_formats.bounds import as_written
from knotfab_formats.errors import InputError, shown
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.views import View

_SIDE = 800  # px of the longer side at which readings are tried
MOST = 6  # number of readings to show
_ALIKE = 0.93  # IoU from which two silhouettes count as one choice
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
    """Return whether a picture may be meant otherwise than it was read.

    That is so if a build refuses it, if it has many pieces and holes, or if the reading was a guess.
    """
    if len(found.views) != 1 or found.frames:
        return False
    (seen,) = found.views
    refused = found.refusal is not None and found.refusal.what == PICTURE
    guessed = is_guessed(seen.target.notes) or seen.target.doubt is not None
    return refused or guessed or seen.pieces + seen.holes >= 24


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
    image, _ = raster.decode(seen.target.png_bytes, seen.target.name)
    if seen.view.tone == "off" and not seen.view.cut_out and _is_photo(image):
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
    piece alone. Of readings that look alike only the best is kept.

    Args:
        source, base, font: as for `read_target`. scene: its one view says how the picture is read so far; its
            crop, threshold and inversion hold for all readings.

    Raises:
        InputError: the picture cannot be read in any of these ways.
    """
    return run_limited(
        lambda: _try_readings(source, scene, base, font),
        shown(source),
        seconds=5 * SECONDS,
        verb="trying readings of it",
    )


def _try_readings(
    source: str | Path, scene: ResolvedScene, base: Path | None, font: str | None
) -> tuple[TriedReading, ...]:
    view = scene.views[0]
    px = _tube_px(source, scene, base, font)
    plain = _try({}, source, scene, base, font)
    doubt = None if plain is None else plain.target.doubt
    other = None if doubt is None else _try(dict(doubt.keys), source, scene, base, font)
    found: list[TriedReading] = []
    for way in _ways(source, base, view):
        tried = []
        # a cut-out needs no cleaning
        for level, cleaning in enumerate(({},) if "subject_px" in way else _cleanings(px)):
            keys = {**way, **cleaning}
            one = _try(keys, source, scene, base, font) if keys else plain
            if one is None:
                break
            # milder cleaning is preferred: each degree costs a tenth of the score
            tried.append((one.refusal is not None, -one.score * 0.9**level, level, one))
        found += [min(tried)[-1]] if tried else []
    if not found:
        raise InputError(str(source), "no reading of it holds a shape", "Draw it as dark on white.")
    found.sort(key=lambda one: (one.refusal is not None, -one.score))
    if plain is not None and other is not None:  # what is unsure comes first
        found = [plain, other, *found]
    kept: list[TriedReading] = []
    for one in found:
        if not any(_alike(one.target.mask, other.target.mask) for other in kept):
            kept.append(one)
    return tuple(kept[:MOST])


def _try(
    keys: dict[str, Any],
    source: str | Path,
    scene: ResolvedScene,
    base: Path | None,
    font: str | None,
) -> TriedReading | None:
    """Return the reading with these keys, None if it holds no shape."""
    changed = scene.but(views=(scene.views[0].but(**keys),))
    try:
        target = read_target(source, changed.views[0], base=base, font=font, glance=_SIDE)
        changed, (target,) = widen_targets(changed, (target,))
        refusal = find_refusal(survey_views(changed, (target,)), changed)
    except InputError:
        return None
    except SceneError as error:
        refusal = error
    score = rate_mask(target.mask, bool(changed.views[0].lines))
    if changed.views[0].cut_out:  # one without features inside it is a blob
        filled = fill_holes(target.mask, target.mask.size)
        features = len(holes_of(target.mask)[1])
        score = rate_mask(filled) * min(1.0, _BLOB + _FEATURE * features)
    return TriedReading(keys, target, score, None if refusal is None else refusal.why)


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
    source: str | Path, scene: ResolvedScene, base: Path | None, font: str | None
) -> float:
    """Return the width of the thinnest tube's shadow, in px of the picture."""
    for ink in ("auto", "dark", "light"):
        reading = scene.views[0].but(ink=ink)
        try:
            target = read_target(source, reading, base=base, font=font, glance=_SIDE)
        except InputError:
            continue
        view = frame_view(scene.views[0], target)
        px_per_mm = view.px_per_mm(target.width) * target.shrunk
        return 2.0 * scene.printer.min_tube_radius_mm * px_per_mm
    return 10.0


def _ways(source: str | Path, base: Path | None, view: View) -> list[dict[str, Any]]:
    """List keys that say what counts as ink: first as the scene has it, then the alternatives."""
    if view.cut_out:
        return [{}]
    path = at_home(source) if base is None else base / source
    try:
        image, _ = raster.decode(read_bytes(path, str(source)), str(source))
    except InputError:  # a vector picture
        image = Image.new("1", (1, 1))
    inks = ["auto", "dark", "light", "flood", *_colours(image)]
    ways: list[dict[str, Any]] = [{}, *({"ink": ink} for ink in inks if ink != view.ink)]
    if not _is_photo(image):
        return ways
    frame = {"crop_px": None} if view.crop_px is False else {}
    return ways + [{"subject_px": box, **frame} for box in middle_boxes(*image.size)]


def _is_photo(image: Image.Image) -> bool:
    """Return whether an opaque picture has as many colours as a photograph."""
    if image.has_transparency_data:
        return False
    small = image.convert("RGB")
    small.thumbnail((96, 96))
    # at four bits a channel
    return len(np.unique(np.asarray(small).reshape(-1, 3) >> 4, axis=0)) >= 100


def _colours(image: Image.Image, most: int = 3) -> list[str]:
    """Return the commonest vivid colours of a pixel picture, as #rrggbb."""
    small = image.convert("RGB")
    small.thumbnail((96, 96))
    few = small.quantize(8, Image.Quantize.MEDIANCUT)
    counts = sorted(few.getcolors() or [], reverse=True)
    palette = few.getpalette() or []
    colours = [tuple(palette[3 * n : 3 * n + 3]) for _, n in counts if isinstance(n, int)]
    vivid = [c for c in colours if max(c) - min(c) >= 60]
    return ["#{:02x}{:02x}{:02x}".format(*c) for c in vivid[:most]]


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
