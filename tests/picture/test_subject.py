"""A subject is cut out of a photograph as a hand draws it, and from then on its mask's file counts."""

from __future__ import annotations

import io
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data
from PIL import Image, ImageDraw
from reports import recognition
from scipy.ndimage import label

from knotfab.base.arrays import Mask
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.folder import OutputFolder
from knotfab.cli.commands import app
from knotfab.design.frames import frame_view
from knotfab.design.readings import PICTURE, TriedReading, advise
from knotfab.part.write import _write_scene
from knotfab.picture.lamps import mixtures_of, on_one_canvas, separate, to_oklab
from knotfab.picture.read import Target, read_target
from knotfab.picture.silhouette import fill_holes, holes_of, mask_iou, pieces_of
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import preview_pictures, survey_pictures
from knotfab.pipeline.read_options import read_scene
from knotfab.scene.load import load_scene
from knotfab_formats.errors import InputError, KnotfabError
from knotfab_formats.views import Reading, View
from knotfab_validators.files.picture import PictureError, read_silhouette
from knotfab_validators.files.scene import read_scene as read_built
from knotfab_validators.shadows.compare import edges_drawn
from knotfab_validators.shadows.verdict_rules import judge_cut_out

# a rectangle, discs that belong, discs that do not, and the outline by hand
Stroke = tuple[int, int, int]
PHOTOGRAPHS: dict[str, tuple[tuple[int, ...], tuple[Stroke, ...], tuple[Stroke, ...], str]] = {
    "chelsea": (
        (0, 0, 402, 300), ((350, 262, 20),), ((14, 50, 14),),
        "400,0 398,4 385,18 380,28 372,45 362,62 356,70 356,78 357,90 359,105 362,118 361,130 359,150 "
        "355,168 347,182 338,198 338,205 345,215 355,228 368,237 378,247 383,262 385,300 0,300 0,128 "
        "20,118 32,105 32,85 32,60 36,30 39,10 41,0 "
    ),
    "astronaut": (
        (15, 8, 352, 504), ((268, 450, 8), (200, 220, 40), (168, 490, 14)), (),
        "30,512 27,470 20,440 18,385 22,350 27,330 35,300 42,280 52,255 70,235 95,215 112,207 114,185 "
        "122,175 127,160 140,152 160,148 182,148 181,130 172,127 165,118 155,108 153,85 155,65 165,52 "
        "185,42 190,32 205,22 225,16 245,17 265,22 285,32 295,48 301,80 298,105 290,118 278,128 268,136 "
        "262,145 256,165 256,175 270,185 285,200 297,217 304,235 318,243 335,255 345,268 350,290 356,310 "
        "361,330 363,347 350,350 330,362 312,378 298,400 288,420 281,450 278,480 282,512 "
    ),
    "coffee": (
        (70, 12, 415, 382), (), (),
        "77,215 80,180 92,145 110,115 135,92 160,77 180,70 185,62 200,43 225,28 255,20 285,18 315,21 "
        "345,31 370,45 390,62 397,70 400,69 412,66 421,70 424,79 419,100 430,110 445,128 460,153 471,180 "
        "478,210 479,240 472,265 458,295 440,318 415,343 380,365 340,380 300,387 260,386 220,377 185,362 "
        "150,338 120,308 100,283 87,255 "
    ),
    "rocket": (
        (308, 126, 28, 281), ((322, 140, 8), (322, 195, 12), (322, 235, 12)), (),
        "322,127 326,129 330,136 332,142 333,150 333,178 334,180 334,250 330,252 330,406 308,406 308,350 "
        "310,345 310,180 311,178 311,145 314,137 318,129 "
    ),
}  # fmt: skip
FEATURES = {"chelsea": 5, "astronaut": 4, "coffee": 4, "rocket": 0}  # that a person sees, at least
SIDE = 150
X, Y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
BALL = (X - 80) ** 2 + (Y - 70) ** 2 <= 30**2


def disc(mask: Mask, x: int, y: int, radius: int) -> Mask:
    """The mask within a disc, a pixel from its edge."""
    v, u = np.indices(mask.shape)
    return mask[(u - x) ** 2 + (v - y) ** 2 <= (radius - 1) ** 2]


def photograph(folder: Path) -> Path:
    """A grainy ball and a tile on ground of two grainy colours, at random but always the same."""
    noise = np.random.default_rng(7).normal(0, 12, (SIDE, SIDE, 3))
    ground = np.where((X > 60)[..., None], (60, 120, 70), (90, 90, 150))
    tile = (X >= 2) & (X < 18) & (Y >= 120) & (Y < 148)
    pixels = np.where((BALL | tile)[..., None], (200, 90, 60), ground) + noise
    path = folder / "ball.png"
    Image.fromarray(pixels.clip(0, 255).astype(np.uint8)).save(path)
    return path


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_a_cut_is_what_a_hand_draws(tmp_path: Path, name: str) -> None:
    box, keep, drop, outline = PHOTOGRAPHS[name]
    image = Image.fromarray(getattr(skimage.data, name)())
    image.save(tmp_path / "a.png")
    hand = Image.new("1", image.size)
    points = [tuple(map(int, pair.split(","))) for pair in outline.split()]
    ImageDraw.Draw(hand).polygon(points, fill=1)
    reading = Reading.model_validate({"subject_px": box, "keep_px": keep, "drop_px": drop})
    found = read_target(tmp_path / "a.png", reading)
    whole = fill_holes(found.mask, found.mask.size)
    assert mask_iou(whole, fill_holes(np.asarray(hand), hand.width * hand.height)) >= 0.93
    darkness = 1.0 - np.asarray(image.convert("L")) / 255.0
    before, after = (edges_drawn(darkness, mask) for mask in (whole, found.mask))
    assert before is not None and after is not None and after >= before
    features = len(holes_of(found.mask)[1])
    assert features >= FEATURES[name] and (after > 0.5 or not features)
    assert len(keep) + len(drop) <= 3
    assert all(disc(found.mask, *one).all() for one in keep)
    assert not any(disc(found.mask, *one).any() for one in drop)
    areas = pieces_of(found.mask)[1]
    assert areas.min() >= 0.04 * areas.max()  # no crumbs
    assert read_target(tmp_path / "a.png", reading).subject_png == found.subject_png


@pytest.mark.parametrize(
    ("word", "share", "then"),
    [
        ("faithful", 0.9, "faithful"),
        ("faithful", 0.7, "good"),
        ("faithful", 0.3, "coarse"),
        ("good", 0.3, "coarse"),
        ("coarse", 0.9, "coarse"),
        ("not recognisable", 0.9, "not recognisable"),
    ],
)
def test_no_cut_out_is_better_than_what_it_shows(word: str, share: float, then: str) -> None:
    before = recognition(word=word)
    after = judge_cut_out(before, share)
    assert after.word == then
    assert any("photograph's subject" in reason for reason in after.reasons) == (share < 0.8)


@pytest.mark.parametrize("features", [False, True])
def test_only_what_stands_out_becomes_a_hole(features: bool, tmp_path: Path) -> None:
    pixels = np.array(Image.open(photograph(tmp_path)))
    if features:
        for x, y in ((70, 62), (90, 62), (80, 80)):
            pixels[(X - x) ** 2 + (Y - y) ** 2 <= 5**2] = (60, 20, 10)
    Image.fromarray(pixels).save(tmp_path / "face.png")
    box = (40, 30, 80, 80)
    mask = read_target(tmp_path / "face.png", Reading(subject_px=box)).mask
    assert len(holes_of(mask)[1]) == (3 if features else 0)
    kept = Reading.model_validate({"subject_px": box, "keep_px": [(70, 62, 7)]})
    assert len(holes_of(read_target(tmp_path / "face.png", kept).mask)[1]) == (2 if features else 0)


def test_a_part_of_the_background_is_not_the_subject(tmp_path: Path) -> None:
    path = photograph(tmp_path)
    cut = read_target(path, Reading(subject_px=(40, 30, 80, 80))).mask
    assert mask_iou(cut, BALL) > 0.97
    holed = read_target(path, Reading(subject_px=(40, 30, 80, 80), drop_px=((80, 70, 9),))).mask
    assert (
        not disc(holed, 80, 70, 9).any() and disc(holed, 60, 70, 4).all()
    )  # a hole that is asked for


def test_the_rectangle_is_in_the_upright_uncropped_picture(tmp_path: Path) -> None:
    path, box = photograph(tmp_path), (40, 30, 80, 80)
    upright = read_target(path, Reading(subject_px=box))
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned by 90° clockwise
    Image.open(path).transpose(Image.Transpose.ROTATE_90).save(tmp_path / "turned.png", exif=exif)
    turned = read_target(tmp_path / "turned.png", Reading(subject_px=box))
    np.testing.assert_array_equal(turned.mask, upright.mask)
    cropped = read_target(path, Reading(subject_px=box, crop_px=(30, 20, 100, 90)))
    np.testing.assert_array_equal(cropped.mask, upright.mask[20:110, 30:130])
    assert cropped.subject_png == upright.subject_png
    own = read_target(path, Reading(subject_px=box, crop_px="auto"))
    assert own.mask.size < upright.mask.size and own.mask.sum() == upright.mask.sum()


def test_a_glance_cuts_out_the_same(tmp_path: Path) -> None:
    Image.open(photograph(tmp_path)).resize((900, 900)).save(tmp_path / "large.png")
    reading = Reading.model_validate({"subject_px": (240, 180, 480, 480), "crop_px": "auto"})
    whole, seen = (read_target(tmp_path / "large.png", reading, glance=px) for px in (0, 300))
    assert (whole.shrunk, seen.shrunk) == (1, 3)
    assert 9 * seen.mask.sum() == pytest.approx(whole.mask.sum(), rel=0.05)
    assert seen.crop_px == pytest.approx(whole.crop_px, abs=9)


def write(folder: Path, path: Path, **keys: Any) -> Path:
    """The scene that a build writes of a picture."""
    view = View(**keys)
    target = read_target(path, view)
    scene = read_scene(BuildOptions())[0]
    with OutputFolder(folder) as out:
        _write_scene(
            out, scene.model_copy(update={"views": (frame_view(view, target),)}), [target], ""
        )
        out.commit()
    return folder / "scene.toml"


def test_a_build_goes_by_the_mask_and_so_do_the_validators(tmp_path: Path) -> None:
    path, folder = photograph(tmp_path), tmp_path / "out"
    scene = write(folder, path, subject_px=(40, 30, 80, 80), drop_px=((80, 70, 9),), invert=True)
    first = read_target(
        path, Reading(subject_px=(40, 30, 80, 80), drop_px=((80, 70, 9),), invert=True)
    )
    # painted over by hand: that is what is drawn from now on, though a cut would not give it
    ImageDraw.Draw(mask := Image.open(folder / "subject-front.png").convert("L")).rectangle(
        (0, 0, 9, 9), fill=255
    )
    mask.save(folder / "subject-front.png")
    (view,) = load_scene(scene).views
    found = read_target(view.picture, view, base=folder)
    assert not found.mask[:10, :10].any() and (found.mask[10:] == first.mask[10:]).all()
    (seen,) = read_built(scene).views
    np.testing.assert_array_equal(read_silhouette(folder / seen.picture, seen), found.mask)
    # strokes on the command line make the cut anew
    anew = read_scene(BuildOptions(scene=scene, keep=("5,5,3",)))[0].views[0]
    assert (anew.subject_mask, anew.keep_px, anew.drop_px) == ("", ((5, 5, 3),), ((80, 70, 9),))
    assert anew.subject_px == (40, 30, 80, 80)
    assert anew.crop_px is None  # unless it is said
    cropped = read_scene(BuildOptions(subject="40,30,80,80", crop="none"))[0].views[0]
    assert cropped.crop_px is False


def test_a_mask_of_another_size_is_refused_by_both(tmp_path: Path) -> None:
    path = photograph(tmp_path)
    Image.new("1", (SIDE, SIDE - 1)).save(tmp_path / "mask.png")
    with pytest.raises(
        InputError, match=r"mask mask.png: it has 150 x 149 px, the picture 150 x 150"
    ):
        read_target(path, Reading(subject_mask="mask.png"))
    with pytest.raises(PictureError, match="size"):
        read_silhouette(path, Reading(subject_mask="mask.png"))
    (tmp_path / "mask.png").write_text("no picture")
    with pytest.raises(InputError, match="cannot be read as a picture"):
        read_target(path, Reading(subject_mask="mask.png"))
    with pytest.raises(InputError, match="subject_mask"):
        read_target(path, Reading(subject_mask="none.png"))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("--subject 40,30,120,80", "no rectangle of at least 16 px within its 150 x 150 px"),
        ("--subject 40,30,10,80", "no rectangle of at least"),
        ("--subject 2,120,16,28", "the subject fills it"),
        ("--subject 0,0,150,150", "nothing of the picture lies around it"),
        ("--subject 115,85,30,50", "nothing in it differs"),
        ("--subject 40,30,80", "it is no rectangle"),
        ("--subject 40,30,0,80", "it is no rectangle"),
        ("--subject 40,30,80,80 --keep 80,70", "it is no disc"),
        ("--subject 40,30,80,80 --drop 80,170,9", "outside of the picture's 150 x 150 px"),
        ("--keep 80,70,9", "nothing is"),
        ("--subject 40,30,80,80 --sequence", "not of all frames"),
    ],
)
def test_what_cannot_be_cut_is_told_in_a_sentence(tmp_path: Path, words: str, why: str) -> None:
    path = photograph(tmp_path)
    command = ["preview", str(path), str(path), *words.split()] if "sequence" in words else [
        "preview", str(path), *words.split()
    ]  # fmt: skip
    with pytest.raises(KnotfabError, match=why) as caught:
        app(command, exit_on_error=False)
    assert caught.value.exit_code == 2 and "\n" not in str(caught.value)


def test_a_refused_photograph_is_told_the_cut_that_a_build_would_take(tmp_path: Path) -> None:
    image = Image.new("L", (60, 60), 255)
    image.paste(0, (15, 15, 45, 45))
    image.save(tmp_path / "square.png")
    found = survey_pictures([str(tmp_path / "square.png")], BuildOptions())
    (seen,) = found.views
    refused = replace(found, refusal=SceneError(PICTURE, "it is too fine", "Draw it larger."))
    cut = {"subject_px": (30, 20, 60, 60)}
    with io.BytesIO() as file:
        Image.fromarray(skimage.data.coffee()[::4, ::4]).save(file, "PNG")
        photo = replace(seen, target=replace(seen.target, png_bytes=file.getvalue()))
    for view, refusal, said in (
        (photo, None, "Cut one thing .* such as --subject 30,20,60,60, which a build would take"),
        (photo, "no", r"Cut one thing out of the photograph: .* in px\. Draw it larger\."),
        (seen, None, r"Draw it larger\.$"),
    ):
        told = advise(
            replace(refused, views=(view,)), (TriedReading(cut, seen.target, 0.5, refusal),)
        )
        assert re.search(said, str(told.refusal)), said
        assert ("Cut" in str(told.refusal)) == (view is photo)


@pytest.mark.slow
@pytest.mark.study
def test_a_photograph_that_is_refused_is_told_to_be_cut(tmp_path: Path) -> None:
    path = str(tmp_path / "cup.png")
    Image.fromarray(skimage.data.coffee()[::2, ::2]).save(path)
    refusal = preview_pictures([path], BuildOptions())[0].refusal
    named = re.search(r"such as --subject ([\d,]+), which a build would take", str(refusal))
    assert named and survey_pictures([path], BuildOptions(subject=named[1])).refusal is None
    dust = np.where(np.random.default_rng(1).random((224, 224)) < 0.5, 0, 255).astype(np.uint8)
    Image.fromarray(dust).save(tmp_path / "dust.png")
    drawn = advise(survey_pictures([str(tmp_path / "dust.png")], BuildOptions()), ())
    assert drawn.refusal is not None and "--subject" not in str(drawn.refusal)


def test_without_the_graph_cut_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "maxflow", None)
    with pytest.raises(MachineError, match=r"--subject.*knotfab\[photo\]") as caught:
        read_target(photograph(tmp_path), Reading(subject_px=(40, 30, 80, 80)))
    assert caught.value.exit_code == 3


# Pictures in colours taken apart into lamps' masks: what is drawn by hand comes apart as it was
# drawn.


RGB = np.eye(3)
NAMES = ("red", "green", "blue")


def flags(*colours: str, size: int = 160, blur: int = 4) -> Image.Image:
    """Discs side by side on white, each in a colour over the next, antialiased."""
    big = Image.new("RGB", (size * blur, size * blur), "white")
    draw = ImageDraw.Draw(big)
    for n, colour in enumerate(colours):
        x = size * blur * (0.18 + 0.6 * n / len(colours))
        draw.ellipse([x, 0.2 * size * blur, x + 0.4 * size * blur, 0.8 * size * blur], fill=colour)
    return big.resize((size, size), Image.Resampling.LANCZOS)


def parted(image: Image.Image, **more: object) -> dict[tuple[int, ...], float]:
    return separate(image, NAMES, RGB, "a.png", **more).shares  # type: ignore[arg-type]


def test_three_lamps_mix_the_eight_corners_of_the_cube() -> None:
    shown = mixtures_of(RGB)
    assert shown[0] == pytest.approx([1, 1, 1]) and shown[7] == pytest.approx([0, 0, 0])
    assert shown[1] == pytest.approx([0, 1, 1])  # where the red lamp is hidden
    assert shown[6] == pytest.approx([1, 0, 0])
    lit = mixtures_of(RGB, ambient=0.1)
    assert lit[0] == pytest.approx([1, 1, 1]) and 0 < lit[7].max() < 0.4
    warm = mixtures_of(np.array([[1.0, 0.5, 0.2], [1.0, 1.0, 1.0]]))
    assert (
        warm[0] == pytest.approx([1, 1, 1]) and warm[1][2] > warm[1][0]
    )  # bluish without warm light


def test_each_lamp_is_hidden_where_its_light_is_not_wanted() -> None:
    found = separate(flags("#ff0000", "#ffff00", "#0000ff"), NAMES, RGB, "a.png")
    assert set(found.shares) == {(), (1, 2), (2,), (0, 1)}
    assert found.lines == () and found.error < 0.02
    rows, columns = 80, [40, 80, 110]
    assert [tuple(found.masks[:, rows, c]) for c in columns] == [
        (False, True, True),
        (False, False, True),
        (True, True, False),
    ]


@pytest.mark.parametrize(
    "pair", [("#ffff00", "#0000ff"), ("#00ff00", "#ff00ff"), ("#ff0000", "#00ffff")]
)
def test_no_seam_of_a_third_colour_runs_between_two(pair: tuple[str, str]) -> None:
    image = flags(*pair)
    found = separate(image, NAMES, RGB, "a.png")
    wanted = set(found.shares) - {()}
    assert len(wanted) == 2
    soft = Image.fromarray(np.asarray(image)).resize((320, 320), Image.Resampling.BICUBIC)
    assert set(parted(soft)) == {(), *wanted}  # blurred over more pixels


def test_outlines_stay_though_they_lie_between_colours() -> None:
    image = flags("#ffff00", "#0000ff", size=200)
    draw = ImageDraw.Draw(image)
    draw.line([(0, 100), (200, 100)], fill="black", width=5)
    shares = parted(image)
    assert shares[0, 1, 2] == pytest.approx(5 / 200, abs=0.004)


def test_dark_colours_keep_their_hue_and_greys_stay_grey() -> None:
    shares = parted(flags("#008000", "#800000", "#0000a0"))
    assert {(0, 2), (1, 2), (0, 1)} <= set(shares) and (0, 1, 2) not in shares
    soft = parted(flags("#3cb371", "#ff7f50", "#4169e1"))
    assert {(0, 2), (1, 2), (0, 1)} <= set(soft)
    light = parted(flags("#c8c8c8", "#ff0000", "#0000ff", "#00ff00"))
    assert set(light) == {(), (1, 2), (0, 1), (0, 2)}


def test_what_cannot_be_mixed_is_told_and_few_colours_are_few() -> None:
    image = flags("#ff8800", "#ff0000", "#0000ff", "#00ff00")
    found = separate(image, NAMES, RGB, "a.png")
    assert any("#ff8800" in line for line in found.lines)
    assert len(parted(image, most=3)) <= 3 < len(parted(image))


@pytest.mark.parametrize(
    ("colours", "why"),
    [(("#000000", "#808080"), "it is grey"), (("#ff0000", "#ff0000"), "hides the lamp 'red'")],
)
def test_what_lamps_cannot_show_is_refused(colours: tuple[str, str], why: str) -> None:
    with pytest.raises(InputError, match=why):
        parted(flags(*colours))


def test_oklab_of_known_colours() -> None:
    white, red = to_oklab(np.array([[1.0, 1, 1], [1, 0, 0]]))
    assert white == pytest.approx([1, 0, 0], abs=1e-4)
    assert red == pytest.approx([0.628, 0.2249, 0.1258], abs=1e-3)  # Ottosson's own table


def test_pictures_of_lamps_that_switch_share_a_canvas() -> None:
    wide, high = np.zeros((40, 80), bool), np.zeros((60, 60), bool)
    wide[10:30, 10:70] = high[10:50, 20:40] = True
    targets = tuple(Target("t", m, b"", m.shape[1], m.shape[0]) for m in (wide, high))
    one, two = on_one_canvas(targets)
    assert one.mask.shape == two.mask.shape == (40, 80)
    assert one.mask.mean() == pytest.approx(wide.mean())
    assert two.mask.sum() == pytest.approx(high.sum() * (40 / 60) ** 2, rel=0.1)
    assert on_one_canvas((one, two)) == (one, two)


def test_a_photograph_is_cut_into_areas_that_a_tube_can_draw() -> None:
    noise = np.random.default_rng(0).normal(0, 25, (320, 320, 3))
    grainy = np.clip(
        np.asarray(flags("#c03020", "#2040c0", "#20a040", size=320), float) + noise, 0, 255
    )
    found = separate(Image.fromarray(grainy.astype(np.uint8)), NAMES, RGB, "a.png")
    assert all(label(mask)[1] <= 4 for mask in found.masks)
    assert {(1, 2), (0, 1), (0, 2)} <= set(found.shares)


def test_what_tapers_off_goes_to_what_lies_beside_it_and_thin_lines_stay() -> None:
    image = Image.new("RGB", (400, 400), "white")
    draw = ImageDraw.Draw(image)
    draw.ellipse((60, 60, 260, 260), fill="red")
    draw.ellipse((100, 75, 258, 245), fill="blue")  # leaves a crescent whose horns meet, hair-thin
    draw.line((20, 330, 380, 330), fill="red", width=3)
    found = separate(image, NAMES, RGB, "a.png")
    hidden = found.masks[1] & ~found.masks[0]  # red
    assert hidden[330, 30:370].all()
    assert hidden[160, 62:98].all() and not hidden[155:166, 200:].any()
    assert np.asarray(image)[160, 259].tolist() == [255, 0, 0]  # as it came
