"""Pictures that may be meant the other way round are told; plain ones raise no doubt."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter
from tables import some

from benchmarks.small_pictures import small_pictures
from examples.pictures import pictures
from knotfab.picture.ground import LIFT
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import mask_iou
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import survey_pictures
from knotfab_formats.errors import InputError
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


UNSURE = {
    "a blackboard on a wall": drawn((225, 220, 210, 255), (40, 60, 50, 255), WHITE),
    "an icon with round corners": drawn(WHITE, (30, 90, 200, 255), WHITE, "rounded"),
    "a page on a black scanner": drawn(BLACK, WHITE),
    "a square sticker": drawn(CLEAR, WHITE, outline="rounded"),
    "a round sticker": drawn(CLEAR, WHITE, outline="ellipse"),
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


# Photographs whose shapes fade are no drawings; drawings that are blurred as a whole are.


def photographed(kind: str, seed: int, side: int) -> Image.Image:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-1 : 1 : 1j * side, -1 : 1 : 1j * side]
    turn, at = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1, 2)
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    far = np.hypot(x - at[0], y - at[1]) / rng.uniform(0.45, 0.65)
    grain = sum(
        s * gaussian_filter(rng.normal(size=x.shape), s * side / 400)
        for s in ((3, 8, 20, 50) if kind == "a stone" else (8, 30, 90))
    )
    lit = 0.8 * along + 0.6 * np.sqrt(np.maximum(1 - far**2, 0))
    thing, body = {
        "a ball": (far < 1, 40 + 180 * lit.clip(0, 1)),
        "a stone": (far < 1, 135 + 45 * grain / grain.std()),
        "a leaf": (
            abs(across) < 0.4 * (1 - along**2 / 0.7),
            110 + 55 * np.cos((along - abs(across)) * rng.uniform(7, 10)),
        ),
        "clouds": (far >= 0, 128 + 45 * grain / grain.std()),
        "a gradient": (far >= 0, 128 + 85 * along),
    }[kind]
    seen = np.where(thing, body, rng.choice([25, 235])) + rng.normal(0, 1, x.shape)
    return Image.fromarray(seen.clip(0, 255).astype(np.uint8)).convert("RGB")


@pytest.mark.parametrize("side", some([340, 150], 2))
@pytest.mark.parametrize("seed", some(range(3), 3))
@pytest.mark.parametrize("kind", ["a ball", "a stone", "a leaf", "clouds", "a gradient"])
def test_a_photograph_whose_shapes_fade_is_refused_and_what_it_is_told_works(
    kind: str, seed: int, side: int, tmp_path: Path
) -> None:
    (image := photographed(kind, seed, side)).save(path := tmp_path / "photo.png")
    with pytest.raises(InputError, match="it is a photograph, and no drawing") as caught:
        read_target(path)
    assert caught.value.remedy.startswith(LIFT) and caught.value.exit_code == 2
    for ink in re.findall(r"--ink (\w+)", caught.value.remedy):
        assert read_target(path, Reading(ink=ink)).mask.any()
    image.putalpha(Image.fromarray(np.hypot(*np.indices(image.size[::-1]) - side / 2) < side / 4))
    image.save(path)
    assert 0.15 < read_target(path).mask.mean() < 0.25


@cache
def drawn_pictures() -> dict[str, Image.Image]:
    return pictures() | small_pictures()


@pytest.mark.parametrize(
    ("name", "side", "blur"),
    some(
        [("tree", 200, 0.01), ("badge", 1000, 0.01), ("bicycle", 100, 0.005), ("knight", 4000, 0.01),
         ("whiskers", 200, 0.01), ("cat", 1000, 0.01), ("wheel", 2000, 0.01), ("r", 200, 0.01)], 4
    ),
)  # fmt: skip
def test_a_drawing_that_is_blurred_all_over_is_read(
    name: str, side: int, blur: float, tmp_path: Path
) -> None:
    drawn = drawn_pictures().get(name) or Image.open(f"examples/{name}.png")
    drawn = drawn.convert("L").resize((side, side), Image.Resampling.LANCZOS)
    soft = 40 + 0.7 * gaussian_filter(np.asarray(drawn, dtype=np.float32), blur * side)
    Image.fromarray(soft.astype(np.uint8)).save(tmp_path / "soft.jpg", quality=75)
    drawn.save(tmp_path / "sharp.png")
    soft_one, sharp = (
        read_target(tmp_path / file, Reading(crop_px=False)).mask
        for file in ("soft.jpg", "sharp.png")
    )
    assert mask_iou(soft_one, sharp) > 0.85


@pytest.mark.slow
def test_a_photograph_that_is_refused_is_told_to_be_lifted_out(tmp_path: Path) -> None:
    Image.fromarray(skimage.data.coffee()[::2, ::2]).save(tmp_path / "coffee.png")
    refusal = survey_pictures([str(tmp_path / "coffee.png")], BuildOptions()).refusal
    assert refusal is not None and refusal.why.startswith("it is a photograph, and no drawing")
    assert "PNG with transparency" in refusal.remedy
