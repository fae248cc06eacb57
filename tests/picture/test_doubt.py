"""Pictures that may be meant the other way round are told; plain ones raise no doubt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw
from tables import some

from knotfab.design.readings import is_unclear, try_readings
from knotfab.design.sentence import describe
from knotfab.picture.doubt import Doubt
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import mask_iou
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import survey_pictures
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene
from knotfab_formats.views import Reading

SIDE = 360
KITE = [(180, 70), (270, 170), (180, 290), (110, 170)]
CLEAR, BLACK, WHITE = (0, 0, 0, 0), (0, 0, 0, 255), (255, 255, 255, 255)


def drawn(
    ground: Any,
    sheet: Any = None,
    ink: Any = BLACK,
    outline: str = "rectangle",
    alone: bool = False,
) -> Image.Image:
    """A kite with a dot beside it (`alone`: without) on a sheet of this outline, on a ground."""
    image = Image.new("RGBA", (SIDE, SIDE), ground)
    pen = ImageDraw.Draw(image)
    box = (30, 30, SIDE - 30, SIDE - 30)
    if sheet is not None:
        kinds = {"rectangle": pen.rectangle, "ellipse": pen.ellipse}
        kinds[outline](box, fill=sheet) if outline in kinds else pen.rounded_rectangle(
            box, 60, fill=sheet
        )
    pen.polygon(KITE, fill=ink)
    if not alone:
        pen.ellipse((272, 90, 300, 120), fill=ink)
    return image if ground[3] == 0 else image.convert("RGB")


def on_gradient(ink: Any) -> Image.Image:
    levels = np.linspace(40, 230, SIDE)[None, :, None].repeat(SIDE, 0).repeat(3, 2)
    image = Image.fromarray(levels.astype(np.uint8))
    ImageDraw.Draw(image).polygon(KITE, fill=ink)
    return image


UNSURE = {
    "a blackboard on a wall": drawn((225, 220, 210, 255), (40, 60, 50, 255), WHITE),
    "an icon with round corners": drawn(WHITE, (30, 90, 200, 255), WHITE, "rounded"),
    "a note on a grey table": drawn((90, 90, 95, 255), (255, 230, 90, 255)),
    "a page on a black scanner": drawn(BLACK, WHITE),
    "a square sticker": drawn(CLEAR, WHITE, outline="rounded"),
    "a round sticker": drawn(CLEAR, WHITE, outline="ellipse"),
    "a light kite on light that fades": on_gradient("white"),
}
SURE = {
    "a kite": drawn(WHITE),
    "a light kite on black": drawn(BLACK, ink=WHITE),
    "a kite cut out": drawn(CLEAR),
    "a badge": drawn(WHITE, (200, 0, 0, 255), WHITE, "ellipse"),
    "a kite on grey": drawn((190, 190, 190, 255)),
    "a kite that fills the frame": drawn(WHITE, BLACK, BLACK, alone=True),
}


def doubt_of(image: Image.Image, folder: Path) -> tuple[Doubt | None, str]:
    path = folder / "picture.png"
    image.save(path)
    return read_target(path).doubt, str(path)


@pytest.mark.parametrize("kind", UNSURE)
def test_what_may_be_meant_otherwise_names_the_option(kind: str, tmp_path: Path) -> None:
    doubt, path = doubt_of(UNSURE[kind], tmp_path)
    assert doubt is not None
    taken, other = read_target(path), read_target(path, Reading(**doubt.keys))
    assert other.doubt is None  # somebody said what is meant
    if taken.mask.shape == other.mask.shape:
        assert mask_iou(taken.mask, other.mask) < 0.55  # the doubt's own is of a smaller picture


@pytest.mark.parametrize("kind", some(UNSURE, 3))
def test_the_sentence_and_the_readings_offer_what_the_doubt_names(
    kind: str, tmp_path: Path
) -> None:
    doubt, path = doubt_of(UNSURE[kind], tmp_path)
    assert doubt is not None
    first, *_ = describe(survey_pictures([path], BuildOptions()))
    assert first.startswith("picture: what is meant is unsure") and first.endswith("takes it.")
    shown = try_readings(path, resolve(Scene()))[:2]
    assert [one.keys for one in shown] == [{}, dict(doubt.keys)]
    assert shown[1].options in first


@pytest.mark.parametrize("kind", SURE)
def test_plain_drawings_raise_no_doubt(kind: str, tmp_path: Path) -> None:
    doubt, path = doubt_of(SURE[kind], tmp_path)
    assert doubt is None
    assert not is_unclear(survey_pictures([path], BuildOptions()))
