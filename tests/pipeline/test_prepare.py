"""A call that may begin: where it will be built, and what its pieces are called."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import picture
from PIL import Image, ImageDraw

from knotfab.base.progress import Progress
from knotfab.picture.raster import encode_mask
from knotfab.pipeline.options import ALL_OUT, BuildOptions, options_from
from knotfab.pipeline.prepare import prepare_build, survey_pictures
from knotfab.pipeline.read_lamps import Call, read_lamps
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.scene import Scene
from knotfab_formats.views import Reading, View


def prepare(*pictures: str | Path, **options: Any) -> Request:
    given = options_from({"accuracy": "sketch", "tube_radius": 5, **options})
    return prepare_build([str(p) for p in pictures], given, "", Progress("quiet"))


@pytest.fixture
def square(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that one works in, with a square in cat.png and in walk/1.png and walk/2.png."""
    (tmp_path / "walk").mkdir()
    monkeypatch.chdir(tmp_path)
    block = np.pad(np.ones((60, 60), dtype=bool), 20)
    picture(tmp_path / "walk" / "1.png", block)
    picture(tmp_path / "walk" / "2.png", np.roll(block, 5, axis=1))
    return picture(tmp_path / "cat.png", block)


@pytest.mark.slow
def test_the_default_folder_is_named_after_the_picture(square: Path) -> None:
    assert prepare(square).out == ALL_OUT / "cat"
    assert prepare(square, "text:A").out == ALL_OUT / "cat-A"
    assert prepare(square, square, size=120).out == ALL_OUT / "cat"
    for frames in ("walk/", "walk", "walk/*.png"):
        assert prepare(frames, sequence=True).out == ALL_OUT / "walk"
    assert prepare(square, out="here").out == Path("here")


def test_more_knots_than_pieces_are_no_silent_wish(square: Path) -> None:
    (said,) = prepare(square, knots=3).preview[-1:]
    assert said.startswith("  --knots 3: the picture is one piece, and becomes one knot.")
    assert "--knots" not in prepare(square, knots=1).preview[-1]


def test_what_is_not_there_is_told_with_what_would_be_right(square: Path, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('[[views]]\npicture = "dog.png"\n')
    for given, remedy in (
        ({"pictures": ["nope.png"]}, "or write text:…"),
        ({"pictures": ["https://example.org/cat.png"]}, "Download the picture"),
        ({"scene": tmp_path / "scene.toml"}, "Lay it beside the scene"),
    ):
        with pytest.raises(InputError, match=remedy):
            prepare(*given.pop("pictures", []), **given)
    with pytest.raises(InputError) as told:
        prepare()
    assert str(told.value).startswith("no picture is given. Name one")


# options with which no piece can print without supports, and the physical reason
SUPPORTED: list[tuple[dict[str, Any], str]] = [
    ({"size": 600}, "light's axis up, .* and the printer holds 250 × 210 × 220 mm"),
    ({"size": 425, "plate": "rounded"}, "in its rounded plate with the light's axis up"),
    ({"size": 300, "plate": "full"}, "light's axis up, 250 × 250 mm across"),
    ({"depth": "flat"}, "a flat piece has no depth"),
    ({"mount": "stand"}, "a stand holds it off the bed"),
    ({"mount": "wall"}, "pegs hold it off the bed"),
    ({"lamps": "switch"}, "picture of another light fixes their height"),
]


@pytest.mark.parametrize(("options", "why"), SUPPORTED)
def test_what_cannot_print_without_supports(
    options: dict[str, Any], why: str, square: Path
) -> None:
    """Asked for, it is refused; free to choose, the slicer's way is taken at once, and told."""
    pictures = ["walk/1.png", "walk/2.png"] if "lamps" in options else [square]
    with pytest.raises(InputError, match=f"without supports .*{why}"):
        prepare(*pictures, supports="none", print=True, **options)
    request = prepare(*pictures, supports="auto", print=True, **options)
    assert request.scene.piece.supports == "slicer" and request.otherwise is None
    assert re.search(why, request.why_supported)
    assert request.preview[-1] == f"  It gets the slicer's supports: {request.why_supported}."


@pytest.mark.slow
def test_a_piece_that_may_do_without_supports_is_designed_so_first(square: Path) -> None:
    request = prepare(square, supports="auto", print=True)
    assert request.otherwise is not None and not request.why_supported
    ways = request.scene.piece.supports, request.otherwise.piece.supports
    assert ways == ("none", "slicer")
    for drawn, more, plate in (
        (square, {}, "roots"),
        (square, {"wall_distance": "120"}, "auto"),
        (square, {"mount": "none"}, "auto"),
        (square, {"mount": "hang", "tube_radius": 3}, "auto"),
        ("text:i", {"wall_distance": "120"}, "rounded"),  # two loose knots
    ):
        request = prepare(drawn, print=True, **more)
        assert request.otherwise is not None
        assert (request.scene.mount.plate, request.otherwise.mount.plate) == (plate, "auto")
    for printed, printer in ((False, "prusa-mk4"), (True, "sls"), (True, "form-3")):
        request = prepare(square, supports="auto", print=printed, printer=printer)
        assert request.otherwise is None and not request.why_supported


@pytest.mark.slow
def test_a_hanger_without_a_place_takes_the_slicer_s_supports_at_once(square: Path) -> None:
    request = prepare(square, print=True, mount="hang")
    assert request.scene.piece.supports == "slicer" and request.otherwise is None
    assert request.why_supported.startswith("no eyelet has room")


@pytest.mark.slow
def test_a_scene_that_a_build_wrote_keeps_the_piece_its_name(square: Path, tmp_path: Path) -> None:
    written = tmp_path / "written"
    written.mkdir()
    (written / "picture-front.png").write_bytes(square.read_bytes())
    scene = prepare(square).scene
    view = scene.views[0].model_copy(update={"picture": "picture-front.png", "title": "My cat"})
    (written / "scene.toml").write_text(dump_scene(scene.model_copy(update={"views": (view,)})))
    again = prepare(scene=written / "scene.toml")
    assert [t.name for t in again.targets] == ["My-cat"] and again.out == ALL_OUT / "My-cat"
    assert [t.shown for t in again.targets] == ["My cat"]
    other = prepare("text:A", scene=written / "scene.toml")  # another picture has its own
    assert other.out == ALL_OUT / "A"


# Calls with lamps: what they become, and what is refused in one sentence.


def draw(path: Path, *colours: str, width: int = 120) -> str:
    image = Image.new("RGB", (width, 80), "white")
    for n, colour in enumerate(colours):
        ImageDraw.Draw(image).ellipse((10 + 30 * n, 15, 50 + 30 * n, 65), fill=colour)
    image.save(path)
    return str(path)


def call(scene: Scene, *sources: str, named: bool = False, **options: object) -> Call:
    asked = BuildOptions(**options)  # type: ignore[arg-type]
    return read_lamps(resolve(scene), sources, asked, None, Progress("quiet"), named=named)


def test_one_picture_becomes_a_view_for_each_lamp(tmp_path: Path) -> None:
    picture = draw(tmp_path / "flag.png", "red", "blue", "yellow")
    made = call(Scene(), picture, lamps="rgb")
    assert [v.name for v in made.scene.views] == ["red", "green", "blue"]
    assert [v.wall for v in made.scene.views] == ["", "red", "red"] and made.name == "flag"
    assert made.scene.lamps.places == "fixed" and made.scene.piece.bend == 0
    assert {(v.frame_width_mm, v.light_diameter_mm) for v in made.scene.views} == {(120.0, 3.0)}
    assert made.parted is not None and made.targets[0].given == (made.parted.png, ".png")
    # the written scene holds for a build from it: the masks as pictures, and nothing is moved
    files = [tmp_path / f"picture-{v.name}.png" for v in made.scene.views]
    for file, target in zip(files, made.targets, strict=True):
        file.write_bytes(encode_mask(target.asked))
    (tmp_path / made.scene.lamps.picture).write_bytes(made.parted.png)
    views = [
        v.model_copy(update={"picture": f.name})
        for v, f in zip(made.scene.views, files, strict=True)
    ]
    moved = made.scene.model_copy(update={"views": tuple(views)})
    scene = resolve(parse_scene(dump_scene(moved)))
    names = tuple(v.picture for v in scene.views)
    again = read_lamps(scene, names, BuildOptions(), tmp_path, Progress("quiet"), named=True)
    assert again.scene == scene and again.told == ()
    for one, other in zip(made.targets, again.targets, strict=True):
        assert (one.mask == other.mask).all()
    assert again.targets[0].given == made.targets[0].given


@pytest.mark.parametrize("crop", [(0, 0, 90, 80), "auto"])
def test_a_crop_holds_for_a_picture_in_colours(tmp_path: Path, crop: object) -> None:
    picture = draw(tmp_path / "flag.png", "red", "blue")
    made = call(Scene(views=(View(crop_px=crop),)), picture, lamps="rgb")
    for target in made.targets:
        rows, columns = target.mask.shape
        assert (rows, columns) == (80, 90) if crop != "auto" else rows < 80 and columns < 100
    assert all(view.crop_px is False for view in made.scene.views)  # the masks are cropped already


def test_lamps_that_switch_have_a_picture_each(tmp_path: Path) -> None:
    one, other = draw(tmp_path / "a.png", "black"), draw(tmp_path / "b.png", "black", width=90)
    made = call(Scene(), one, other, lamps="switch")
    assert made.scene.lamps.mode == "switch" and [v.name for v in made.scene.views] == ["a", "b"]
    assert made.targets[0].mask.shape == made.targets[1].mask.shape and made.parted is None


@pytest.mark.parametrize(
    ("lamps", "pictures", "why"),
    [
        ("rgb", ("black",), "it is grey"), ("rgb", ("red", "red"), "2 pictures"),
        ("red+red", ("red",), "names red twice"), ("red+mauve", ("red",), "'mauve' is no lamp"),
        ("red", ("red",), "this is 1"), ("switch", ("red",), "1 is given"),
        ("red+magenta+yellow+white+cyan+amber", ("red",), "5 at most"),
    ],
)  # fmt: skip
def test_what_lamps_cannot_show_is_refused(
    lamps: str, pictures: tuple[str, ...], why: str, tmp_path: Path
) -> None:
    files = [draw(tmp_path / f"{n}.png", c) for n, c in enumerate(pictures)]
    with pytest.raises(InputError, match=why) as refused:
        call(Scene(), *files, lamps=lamps)
    assert refused.value.exit_code == 2 and refused.value.remedy


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"sequence": True}, "frames have one lamp"),
        ({"lamps": "rgb"}, "a free view"),
        ({"invert": True}, r"--invert: lamps that mix show all colours"),
        ({"ink": "dark"}, r"--ink: lamps that mix"),
    ],
)
def test_what_does_not_go_with_lamps_is_refused(options: dict[str, object], why: str) -> None:
    scene = Scene(search={"free_view": True}) if "lamps" in options else Scene()
    reading = {k: options.pop(k) for k in [*options] if k in Reading.model_fields}
    scene = scene.but(views=(View(**reading),)) if reading else scene
    with pytest.raises(InputError, match=why):
        call(scene, "a.png", **{"lamps": "rgb", **options})


_PLA_G_MM3 = 1.24e-3
# strokes 6 px wide of 400, and grams and hours by PrusaSlicer of what was built at draft with no holder
STROKES: dict[str, tuple[Callable[[ImageDraw.ImageDraw], object], float, float]] = {
    "line": (lambda d: d.line((40, 200, 360, 200), 0, 6), 0.62, 0.067),
    "ring": (lambda d: d.ellipse((60, 60, 340, 340), outline=0, width=6), 4.33, 0.67),
    "small ring": (lambda d: d.ellipse((140, 140, 260, 260), outline=0, width=6), 1.74, 0.39),
    "star": (
        lambda d: [
            d.line((200, 200, 200 + 150 * x, 200 + 150 * y), 0, 6)
            for x, y in ((1, 0), (-0.5, 0.87), (-0.5, -0.87))
        ],
        2.0,
        0.41,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["line", "small ring", "star", pytest.param("ring", marks=pytest.mark.study)]
)
def test_strokes_are_promised_as_they_print(name: str, tmp_path: Path) -> None:
    draw, grams, hours = STROKES[name]
    sheet = Image.new("L", (400, 400), 255)
    draw(ImageDraw.Draw(sheet))
    sheet.save(path := tmp_path / "strokes.png")
    options = options_from({"accuracy": "draft", "mount": "none", "out": str(tmp_path / "out")})
    found = survey_pictures([str(path)], options)
    guess, tube = found.guess, np.pi * found.radius_mm**2 * found.guess.length_mm * _PLA_G_MM3
    assert guess.hours is not None
    assert guess.mass_g == pytest.approx(grams, rel=0.25)
    assert guess.hours == pytest.approx(hours, rel=0.25)
    # what is straight lies on the bed, in strands there and back
    assert (guess.mass_g < 1.1 * tube) == (name == "line")
    if name == "line":
        assert guess.length_mm == pytest.approx(2 * found.views[0].piece_mm[0], rel=0.05)
    # a build promises the same
    printed = replace(options, print_=True)
    promise = prepare_build([str(path)], printed, "", Progress("quiet")).promise
    assert promise is not None and promise.grams == pytest.approx(guess.mass_g)
