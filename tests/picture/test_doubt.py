"""Pictures that may be meant the other way round are told; plain ones raise no doubt."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data
from PIL import Image, ImageDraw

from knotfab.picture.read import read_target
from knotfab.picture.silhouette import mask_iou
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import survey_pictures
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


@pytest.mark.parametrize("kind", UNSURE)
def test_what_may_be_meant_otherwise_names_the_option(kind: str, tmp_path: Path) -> None:
    UNSURE[kind].save(tmp_path / "picture.png")
    taken = read_target(tmp_path / "picture.png")
    (note,) = taken.notes
    option, value = re.findall(r"--(ink|crop) ([\w,]+)", note)[0]
    asked = {"ink": value} if option == "ink" else {"crop_px": tuple(map(int, value.split(",")))}
    other = read_target(tmp_path / "picture.png", Reading(**asked))
    assert not other.notes  # somebody said what is meant
    if taken.mask.shape == other.mask.shape:
        assert mask_iou(taken.mask, other.mask) < 0.55  # the note's own is of a smaller picture


@pytest.mark.parametrize("kind", SURE)
def test_plain_drawings_raise_no_doubt(kind: str, tmp_path: Path) -> None:
    SURE[kind].save(tmp_path / "picture.png")
    assert not read_target(tmp_path / "picture.png").notes


@pytest.mark.slow
def test_a_photograph_that_is_refused_is_told_to_be_lifted_out(tmp_path: Path) -> None:
    Image.fromarray(skimage.data.coffee()[::2, ::2]).save(tmp_path / "coffee.png")
    refusal = survey_pictures([str(tmp_path / "coffee.png")], BuildOptions()).refusal
    assert refusal is not None and refusal.why.startswith("it is a photograph, and no drawing")
    assert "PNG with transparency" in refusal.remedy
