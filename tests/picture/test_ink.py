"""Which pixels are ink: expected masks of drawings, by every rule."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageColor, ImageDraw, ImageFilter

from knotfab.base.arrays import Mask
from knotfab.picture.ink import _word_of
from knotfab.picture.raster import encode_mask, own_box
from knotfab.picture.read import Target, read_target
from knotfab.picture.silhouette import drop_specks, holes_of, keep_largest, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading
from knotfab_validators.files.picture import read_mask

SIDE = 120
RED, WHITE, BLACK, YELLOW = (214, 30, 40), (255, 255, 255), (0, 0, 0), (255, 214, 0)
CLEAR = (0, 0, 0, 0)


def disc(x: float, y: float, radius: float) -> Mask:
    """The pixels of a disc."""
    v, u = np.mgrid[:SIDE, :SIDE]
    return np.asarray((u - x) ** 2 + (v - y) ** 2 <= radius**2)


BADGE = disc(60, 60, 48)
TICK = np.zeros((SIDE, SIDE), dtype=bool)
TICK[50:76, 40:50] = TICK[66:76, 40:84] = True
EYES = disc(45, 50, 7) | disc(75, 50, 7)


def painted(paper: Any, *layers: tuple[Mask, Any]) -> Image.Image:
    """Colours over a paper, RGBA or RGB as the paper's is."""
    pixels = np.tile(np.array(paper, dtype=np.uint8), (SIDE, SIDE, 1))
    for mask, colour in layers:
        pixels[mask] = [*colour, 255][: len(paper)]
    return Image.fromarray(pixels)


def read(folder: Path, image: Image.Image, **keys: Any) -> Target:
    """The picture's target; what a build writes of it gives the same silhouette again, to validators too."""
    image.save(folder / "a.png")
    target = read_target(folder / "a.png", Reading(**keys))
    (folder / "picture-a.png").write_bytes(encode_mask(target.asked))
    (folder / "given-a.png").write_bytes((folder / "a.png").read_bytes())
    again = read_target(folder / "picture-a.png")
    for found in (again.mask, read_mask(folder / "picture-a.png")):
        np.testing.assert_array_equal(found, target.asked)
    assert again.settled and not again.notes and again.given == target.given
    return target


ALPHA = {
    "a red badge with a white tick": ([(BADGE, RED), (TICK, WHITE)], BADGE & ~TICK),
    "a yellow face with black eyes": ([(BADGE, YELLOW), (EYES, BLACK)], BADGE & ~EYES),
    "a white logo": ([(TICK, WHITE)], TICK),
    "a black logo": ([(TICK, BLACK)], TICK),
    "two colours side by side": ([(BADGE, RED), (BADGE & (np.indices((SIDE, SIDE))[1] > 70), WHITE)], BADGE),
    "an outline about a face": ([(disc(60, 60, 52), BLACK), (BADGE, YELLOW), (EYES, BLACK)],
                                disc(60, 60, 52) & ~EYES),
}  # fmt: skip


@pytest.mark.parametrize("name", ALPHA)
def test_what_the_largest_colour_encloses_is_a_hole(tmp_path: Path, name: str) -> None:
    layers, expected = ALPHA[name]
    target = read(tmp_path, painted(CLEAR, *layers))
    np.testing.assert_array_equal(target.mask, expected)
    assert "opaque" in target.rule
    assert ("encloses" in target.rule) == (expected.sum() < painted_area(layers))


def painted_area(layers: list[tuple[Mask, Any]]) -> int:
    """Pixels that any layer covers."""
    return int(np.logical_or.reduce([mask for mask, _ in layers]).sum())


def test_soft_edges_move_nothing_by_a_pixel(tmp_path: Path) -> None:
    layers, expected = ALPHA["a red badge with a white tick"]
    large = painted(CLEAR, *layers).resize((4 * SIDE, 4 * SIDE), Image.Resampling.NEAREST)
    soft = large.resize((SIDE, SIDE), Image.Resampling.BICUBIC)
    target = read(tmp_path, soft)
    assert len(holes_of(target.mask)[1]) == 1
    assert (target.mask ^ expected).sum() < 0.02 * expected.sum()


def test_one_colour_with_soft_edges_has_no_holes(tmp_path: Path) -> None:
    soft = painted(CLEAR, (BADGE, RED)).filter(ImageFilter.GaussianBlur(3))
    target = read(tmp_path, soft)
    np.testing.assert_array_equal(target.mask, np.asarray(soft)[..., 3] >= 128)


def test_a_shade_that_fades_is_no_part(tmp_path: Path) -> None:
    v, u = np.mgrid[:SIDE, :SIDE]
    fade = np.clip(1 - np.hypot(u - 60, v - 60) / 48, 0, 1)[..., None]
    pixels = np.dstack([(255 * (1 - 0.8 * fade) * [1.0, 0.9, 0.2]).astype(np.uint8), 255 * BADGE])
    target = read(tmp_path, Image.fromarray(pixels.astype(np.uint8)))
    np.testing.assert_array_equal(target.mask, BADGE)


def test_alpha_alone_takes_all_that_is_opaque(tmp_path: Path) -> None:
    layers, _ = ALPHA["a red badge with a white tick"]
    target = read(tmp_path, painted(CLEAR, *layers), ink="alpha")
    np.testing.assert_array_equal(target.mask, BADGE)
    with pytest.raises(InputError, match="transparency"):
        read(tmp_path, painted(WHITE, *layers), ink="alpha")


OPAQUE = {
    "black on white": (WHITE, [(TICK, BLACK)], {}, TICK),
    "white on black": (BLACK, [(TICK, WHITE)], {}, TICK),
    "black on white, dark": (WHITE, [(TICK, BLACK)], {"ink": "dark"}, TICK),
    "black on white, light": (WHITE, [(TICK, BLACK)], {"ink": "light"}, ~TICK),
    "white on black, dark": (BLACK, [(TICK, WHITE)], {"ink": "dark"}, ~TICK),
    "a badge on white": (WHITE, [(BADGE, RED), (TICK, WHITE)], {}, BADGE & ~TICK),
    "a face on white": (WHITE, [(BADGE, YELLOW), (EYES, BLACK)], {}, BADGE),
    "its yellow": (WHITE, [(BADGE, YELLOW), (EYES, BLACK)], {"ink": "#ffd600"}, BADGE & ~EYES),
    "its eyes": (WHITE, [(BADGE, YELLOW), (EYES, BLACK)], {"ink": "dark"}, EYES),
    "all but it": (WHITE, [(TICK, BLACK)], {"invert": True}, ~TICK),
    "a faint drawing": (WHITE, [(BADGE, (225, 225, 225)), (TICK, BLACK)], {"threshold": 0.1}, BADGE),
    "less than that": (WHITE, [(BADGE, (225, 225, 225)), (TICK, BLACK)], {}, TICK),
}  # fmt: skip


@pytest.mark.parametrize("name", OPAQUE)
def test_pictures_without_transparency(tmp_path: Path, name: str) -> None:
    paper, layers, keys, expected = OPAQUE[name]
    np.testing.assert_array_equal(read(tmp_path, painted(paper, *layers), **keys).mask, expected)


def test_ink_of_several_colours_is_told(tmp_path: Path) -> None:
    face = read(tmp_path, painted(WHITE, (BADGE, YELLOW), (EYES, BLACK)))
    assert "--ink" in face.rule and "#000000" in face.rule
    assert "--ink" not in read(tmp_path, painted(WHITE, (BADGE, YELLOW))).rule
    soft = painted(WHITE, (BADGE, BLACK)).filter(ImageFilter.GaussianBlur(0.8))
    assert "--ink" not in read(tmp_path, soft).rule  # greys of its edge


def test_a_colour_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing in it is near #0000ff"):
        read(tmp_path, painted(WHITE, (BADGE, YELLOW)), ink="#0000ff")


@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_what_is_taken_is_named_as_it_looks_and_greys_are_colours_too(
    mode: str, tmp_path: Path
) -> None:
    picture = painted(WHITE, (BADGE, BLACK)).convert(mode)
    near = read(tmp_path, picture, ink="#000080")  # nearer to it than the paper is
    assert near.rule.startswith("what is black [what differs from #000080")
    np.testing.assert_array_equal(near.mask, BADGE)
    with pytest.raises(InputError, match="nothing in it is near #0000ff"):
        read(tmp_path, picture, ink="#0000ff")


def test_dark_and_light_ink_where_the_rest_is_clear(tmp_path: Path) -> None:
    for ink, colour in (("dark", BLACK), ("light", WHITE)):
        np.testing.assert_array_equal(
            read(tmp_path, painted(CLEAR, (TICK, colour)), ink=ink).mask, TICK
        )
    both = painted(CLEAR, (BADGE, WHITE), (EYES, BLACK))
    np.testing.assert_array_equal(read(tmp_path, both, ink="dark").mask, EYES)
    np.testing.assert_array_equal(read(tmp_path, both, ink="light").mask, BADGE & ~EYES)


def test_a_flood_takes_a_background_that_changes(tmp_path: Path) -> None:
    v, _ = np.mgrid[:SIDE, :SIDE]
    sky = np.stack([90 + v, 120 + v, 200 + 0 * v], axis=-1).astype(np.uint8)
    sky[BADGE] = RED
    sky[TICK] = (150, 180, 200)  # the tick has the sky's colours, but the flood does not come there
    np.testing.assert_array_equal(read(tmp_path, Image.fromarray(sky), ink="flood").mask, BADGE)


def test_sixteen_bits_and_grey(tmp_path: Path) -> None:
    deep = Image.fromarray(np.where(TICK, 1000, 60000).astype(np.uint16))
    for keys in ({}, {"ink": "dark"}, {"ink": "#000000"}, {"ink": "flood"}):
        np.testing.assert_array_equal(read(tmp_path, deep, **keys).mask, TICK)
    grey = Image.fromarray(np.where(TICK, 10, 200).astype(np.uint8))
    for keys in ({"ink": "dark"}, {"ink": "#0a0a0a"}, {"ink": "flood"}):
        np.testing.assert_array_equal(read(tmp_path, grey, **keys).mask, TICK)


def test_specks_and_largest_pieces(tmp_path: Path) -> None:
    dots = np.zeros((SIDE, SIDE), dtype=bool)
    dots[5, 5] = dots[100:103, 100:103] = True
    holed = BADGE & ~disc(60, 60, 1)
    image = painted(WHITE, (holed | dots | TICK, BLACK))
    np.testing.assert_array_equal(read(tmp_path, image, speck_px=9).mask[:90], BADGE[:90])
    np.testing.assert_array_equal(read(tmp_path, image, keep_largest=1).mask, holed | TICK)
    two = read(tmp_path, image, keep_largest=2).mask
    np.testing.assert_array_equal(two, holed | TICK | (dots & (np.arange(SIDE) > 50)))


@pytest.mark.parametrize("ink", ["auto", "dark", "alpha"])
def test_crop_to_the_drawing(tmp_path: Path, ink: str) -> None:
    image = painted(CLEAR if ink == "alpha" else WHITE, (TICK, BLACK))
    found = read(tmp_path, image, crop_px="auto", ink=ink)
    box = left, top, width, height = own_box(TICK)
    assert found.mask.shape == (height, width) == (found.height, found.width)
    assert found.mask.sum() == TICK.sum()
    np.testing.assert_array_equal(found.mask, TICK[top : top + height, left : left + width])
    again = read(tmp_path, image, crop_px=box, ink=ink)
    np.testing.assert_array_equal(again.mask, found.mask)
    with pytest.raises(InputError, match="beyond"):
        read(tmp_path, image, crop_px=(60, 60, 70, 20))


@pytest.mark.parametrize("side", [1, 2, 5, 15, 16, 40, SIDE])
def test_the_box_of_a_drawing_of_any_size_is_one_that_a_scene_holds(side: int) -> None:
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    mask[:side, SIDE - side :] = True
    left, top, width, height = box = own_box(mask)
    assert mask[top : top + height, left : left + width].sum() == side**2
    assert Reading(crop_px=box).crop_px == box  # Python's integers, which numpy's are not


def test_smoothing_changes_what_is_drawn_alone(tmp_path: Path) -> None:
    ragged = BADGE ^ (np.random.default_rng(0).random((SIDE, SIDE)) < 0.02)
    smooth = read(tmp_path, painted(WHITE, (ragged, BLACK)), smooth_px=2.0)
    np.testing.assert_array_equal(smooth.asked, ragged)
    assert (smooth.mask ^ BADGE).sum() < 0.03 * BADGE.sum() < (ragged ^ BADGE).sum()


def test_blank_pictures_are_refused_by_every_rule(tmp_path: Path) -> None:
    for ink in ("auto", "dark", "light", "flood"):
        with pytest.raises(InputError, match="one colour"):
            read(tmp_path, painted(WHITE), ink=ink)


@given(st.integers(0, 10**6), st.integers(1, 40), st.integers(1, 4))
@settings(max_examples=30)
def test_pieces_and_holes_on_noise(seed: int, least: int, count: int) -> None:
    noise = Image.fromarray((np.random.default_rng(seed).random((40, 50)) * 255).astype(np.uint8))
    mask = np.asarray(noise.filter(ImageFilter.GaussianBlur(1.5))) > 127
    cleaned = drop_specks(mask, least)
    assert (pieces_of(cleaned)[1] >= least).all() and (holes_of(cleaned)[1] >= least).all()
    np.testing.assert_array_equal(drop_specks(cleaned, least), cleaned)
    kept, areas = keep_largest(mask, count), np.sort(pieces_of(mask)[1])[::-1]
    assert kept.sum() == areas[:count].sum() and not (kept & ~mask).any()


@pytest.mark.parametrize("ink", ["auto", "dark", "light", "alpha", "flood", "#804020"])
def test_both_readers_agree_on_anything(tmp_path: Path, ink: str) -> None:
    rng = np.random.default_rng(3)
    for k in range(6):
        image = Image.fromarray(rng.integers(0, 256, (40, 50, 4), dtype=np.uint8))
        image = image.filter(ImageFilter.GaussianBlur(k / 2))
        if k % 3 == 0:
            image.putalpha(Image.fromarray(rng.integers(200, 256, (40, 50), dtype=np.uint8)))
        ImageDraw.Draw(image).ellipse((10, 8, 40, 36), fill=(*rng.integers(0, 256, 3), 255))
        keys = {"threshold": (0.3, 0.5, 0.7)[k % 3], "speck_px": 3 * k, "keep_largest": k // 2}
        try:
            read(tmp_path, image, ink=ink, invert=k % 2 == 1, **keys)
        except InputError as error:
            known = ("shape", "covers", "nothing in it is near")
            assert any(w in error.why for w in known) or ink == "alpha"


@pytest.mark.parametrize("shape", [(200, 200), (200, 200, 3)])
def test_blank_paper_is_refused_though_a_camera_saw_noise_in_it(
    tmp_path: Path, shape: tuple[int, ...]
) -> None:
    noise = np.random.default_rng(3).integers(0, 4, shape).astype(np.uint8)
    Image.fromarray(255 - noise).save(tmp_path / "paper.jpg")
    with pytest.raises(InputError, match="nearly all one colour"):
        read_target(tmp_path / "paper.jpg")
    assert read_target(tmp_path / "paper.jpg", Reading(ink="dark")).mask.any()


def test_what_is_opaque_and_of_several_colours_is_said_to_be(tmp_path: Path) -> None:
    """A face that fades from yellow to red, eyes and all: no one colour encloses what is in it."""
    x, y = np.meshgrid(np.arange(200) - 100.0, np.arange(200) - 100.0)
    out = np.clip(np.hypot(x, y) / 90, 0, 1)
    face = np.stack([255 - 50 * out, 230 * (1 - out), 0 * out, 255.0 * (out < 1)], axis=-1)
    face[(np.abs(np.abs(x) - 35) < 12) & (np.abs(y + 20) < 12), :3] = 0
    Image.fromarray(face.astype(np.uint8)).save(tmp_path / "face.png")
    target = read_target(tmp_path / "face.png")
    rule = target.rule
    assert '; its colours are orange (#e46400, 54%) and red (#cc0000, 46%): --ink "#e46400"' in rule
    assert "draws the orange alone" in rule and "white" not in rule


@pytest.mark.parametrize(
    ("colour", "word"),
    [("#8c4414", "brown"), ("#ffac00", "yellow"), ("#ffa500", "orange"), ("#e46400", "orange")],
)
def test_a_colour_is_called_as_people_call_it(colour: str, word: str) -> None:
    assert _word_of(np.array(ImageColor.getrgb(colour), dtype=float)) == word


def test_white_in_a_drawing_without_a_ground_is_said_to_be_drawn(tmp_path: Path) -> None:
    """A white bolt that comes out of its cloud: no colour encloses it, and on white paper nobody sees it."""
    cloudy = disc(45, 50, 25)
    cloud = painted(CLEAR, (cloudy, (*RED, 255)), (TICK, (*WHITE, 255)))
    target = read(tmp_path, cloud)
    assert (target.mask == (cloudy | TICK)).all()
    assert ", and the white is drawn as dark as the rest: --ink " in target.rule
    bare = read(tmp_path, cloud, ink="#d61e28")
    assert not (bare.mask & TICK).any() and "white" not in bare.rule


STRAY = {"a pixel": (slice(0, 1), slice(0, 1)), "a row": (slice(-1, None), slice(None))}


@pytest.mark.parametrize("alpha", [254, 128, 0])
@pytest.mark.parametrize("place", STRAY)
def test_a_few_clear_pixels_are_no_background(tmp_path: Path, place: str, alpha: int) -> None:
    image = painted((*WHITE, 255), (TICK, BLACK))
    pixels = np.array(image)
    pixels[*STRAY[place], 3] = alpha
    if not alpha:
        pixels[*STRAY[place], :3] = 0
    target = read(tmp_path, Image.fromarray(pixels))
    np.testing.assert_array_equal(target.mask, TICK)


def test_a_veil_is_no_background_but_a_hole_in_one_colour_is(tmp_path: Path) -> None:
    veiled = painted((*WHITE, 255), (TICK, BLACK))
    veiled.putalpha(200)
    np.testing.assert_array_equal(read(tmp_path, veiled).mask, TICK)
    plate = np.full((SIDE, SIDE, 4), 255, dtype=np.uint8)
    plate[50:60, 50:60, 3] = 0  # 0.7 % of it
    assert read(tmp_path, Image.fromarray(plate)).mask.sum() == SIDE**2 - 100


@pytest.mark.parametrize("thick", [1, 2])
def test_a_thin_frame_is_cropped_off_and_told(tmp_path: Path, thick: int) -> None:
    image = painted(WHITE, (TICK, BLACK))
    ImageDraw.Draw(image).rectangle((0, 0, SIDE - 1, SIDE - 1), outline=(40, 40, 200), width=thick)
    target = read(tmp_path, image)
    inside = slice(thick, SIDE - thick)
    np.testing.assert_array_equal(target.mask, TICK[inside, inside])
    assert "--crop 0,0,120,120 keeps it" in target.notes[0]
    kept = read(tmp_path, image, crop_px=(0, 0, SIDE, SIDE))
    assert not kept.notes and kept.mask.sum() > 0.8 * SIDE**2


def test_what_only_looks_like_a_frame_stays(tmp_path: Path) -> None:
    image = painted(WHITE)
    ImageDraw.Draw(image).rectangle((0, 0, SIDE - 1, SIDE - 1), outline=BLACK, width=2)
    assert not read(tmp_path, image).notes  # the frame alone is the picture
    wide = painted(WHITE, (TICK, BLACK))
    ImageDraw.Draw(wide).rectangle((0, 0, SIDE - 1, SIDE - 1), outline=BLACK, width=4)
    wide.save(tmp_path / "wide.png")
    framed = read_target(tmp_path / "wide.png")  # paper within a wider frame is paper
    assert "sheet of paper" in framed.notes[0] and framed.mask.sum() == TICK.sum()
    tree = painted(WHITE, (np.indices((SIDE, SIDE))[0] > 80, BLACK))  # its ground touches the edge
    target = read(tmp_path, tree)
    assert "--ink light" in target.notes[0] and target.mask.sum() == 39 * SIDE


def test_what_neither_border_colour_reaches_is_drawn(tmp_path: Path) -> None:
    lower = np.indices((SIDE, SIDE))[0] >= SIDE // 2
    target = read(tmp_path, painted((150, 200, 255), (lower, (20, 60, 120)), (TICK, WHITE)))
    np.testing.assert_array_equal(target.mask, TICK)
    assert "--ink flood" in target.notes[0]


@pytest.mark.parametrize("colours", [(BLACK, WHITE), (RED, WHITE), (YELLOW, (0, 80, 220))])
def test_halves_are_refused_by_the_colours_that_they_have(tmp_path: Path, colours: Any) -> None:
    one, other = colours
    halves = painted(one, (np.indices((SIDE, SIDE))[1] >= SIDE // 2, other))
    halves.save(tmp_path / "halves.png")
    with pytest.raises(InputError, match=r"none of these is its background.*--ink") as caught:
        read_target(tmp_path / "halves.png")
    advised = caught.value.remedy.split('"')[1]
    assert advised in str(caught.value) and read(tmp_path, halves, ink=advised).mask.mean() == 0.5


def test_the_seam_of_two_colours_that_mix_is_no_dust(tmp_path: Path) -> None:
    face, mouth = (255, 204, 51), disc(60, 70, 30) & (np.indices((SIDE, SIDE))[0] > 60)
    large = painted(CLEAR, (BADGE, face), (mouth, (102, 69, 0)))
    teeth = mouth & (np.indices((SIDE, SIDE))[0] < 74)
    pixels = np.array(large)
    pixels[teeth] = (*WHITE, 255)
    # nearer to the face than to either
    pixels[teeth & (np.indices((SIDE, SIDE))[0] == 73)] = (200, 170, 90, 255)
    target = read(tmp_path, Image.fromarray(pixels))
    np.testing.assert_array_equal(target.mask, BADGE & ~mouth)
    whisker = np.array(large)
    whisker[75, 50:70] = (*face, 255)  # a line of the face's own within one colour
    assert read(tmp_path, Image.fromarray(whisker)).mask[75, 55]
