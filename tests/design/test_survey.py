"""A survey says of known drawings what is lost of them, where, and what would do; its remedies work."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.cli.commands import app
from knotfab.design import radius
from knotfab.design.candidates import guess_print
from knotfab.design.design import choose_tube
from knotfab.design.frames import frame_view, widen_targets
from knotfab.design.question import ask
from knotfab.design.sentence import describe, list_figures
from knotfab.design.survey import Survey, require_drawable, survey
from knotfab.picture.opening import opening_iou
from knotfab.picture.raster import GLANCE
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import trace_polygon
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import prepare_build, survey_pictures
from knotfab.report.pictures import Panel, _with_caption, draw_survey
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy, Piece, Printer
from knotfab_formats.scene import Scene
from knotfab_formats.search import search_settings
from knotfab_formats.views import Reading, View

SIDE = 800


def lines(path: Path, *, width: int, body: bool = False) -> Path:
    """A house of lines, with a solid body beside it or not, 800 px wide."""
    image = Image.new("L", (SIDE, SIDE), 255)
    draw = ImageDraw.Draw(image)
    if body:
        draw.rectangle((60, 60, 360, 740), fill=0)
    draw.line([(440, 700), (440, 400), (580, 250), (720, 400), (720, 700), (440, 700)],
              fill=0, width=width, joint="curve")  # fmt: skip
    image.save(path)
    return path


def look(path: Path, scene: Scene | None = None) -> Survey:
    """The survey of one picture."""
    scene = scene or Scene()
    return survey(resolve(scene), [read_target(path, scene.views[0])])


def said_of(found: Survey) -> str:
    (line,) = [t for t in describe(found) if "A build takes" in t]
    return line


def face(path: Path, eye: float) -> Path:
    """A head with a pale face, in which two eyes of this radius stand, 720 px wide."""
    image = Image.new("L", (720, 720), 255)
    draw = ImageDraw.Draw(image)
    for x, y, r, ink in [
        (360, 360, 280, 0),
        (360, 400, 190, 255),
        (290, 350, eye, 0),
        (430, 350, eye, 0),
        (360, 450, 45, 0),
    ]:
        draw.ellipse((x - r, y - r, x + r, y + r), fill=ink)
    image.save(path)
    return path


@pytest.mark.parametrize(
    ("eye", "taken", "told"),
    [
        (30, False, None),
        (
            10,
            True,
            r"to keep 2 small pieces of eyes \(up to 5\.\d mm\): .* would lose them, search 2",
        ),
        (3, False, r"No printable tube draws 2 small pieces .*; --size [3-5]\d0 keeps them"),
    ],
)
def test_eyes_are_kept_by_a_thinner_tube_or_said_to_be_lost(
    eye: float, taken: bool, told: str | None, tmp_path: Path
) -> None:
    found = look(face(tmp_path / "eyes.png", eye))
    assert (found.small is None) == (told is None)
    assert found.small is None or (found.radius_mm == found.small.keeping_mm) == taken
    lines = [line for line in describe(found) if "small piece" in line]
    assert len(lines) == (told is not None) and all(re.search(str(told), line) for line in lines)


def test_eyes_beside_another_picture_are_kept(tmp_path: Path) -> None:
    block = Image.new("L", (720, 720), 255)
    ImageDraw.Draw(block).rectangle((300, 80, 420, 640), fill=0)
    block.save(tmp_path / "block.png")
    # small and narrow, so that few strands fill the body
    views = tuple(
        View(name=name, azimuth_deg=azimuth, frame_width_mm=120.0)
        for name, azimuth in (("eyes", 0.0), ("block", 90.0))
    )
    scene = resolve(Scene(views=views, accuracy=Accuracy(name="sketch")))
    targets = [read_target(face(tmp_path / "eyes.png", 18)), read_target(tmp_path / "block.png")]
    found = survey(scene, targets)
    assert found.small is not None and found.small.taken
    assert found.radius_mm == found.small.keeping_mm < found.small.usual_mm
    assert 3.0 * found.radius_mm <= 2.0 * 18 / found.views[0].px_per_mm


def test_what_is_thin_is_lost_at_its_place(tmp_path: Path) -> None:
    found = look(lines(tmp_path / "a.png", width=3, body=True))
    (seen,) = found.views
    assert (seen.pieces, seen.holes) == (2, 1)
    lost = seen.losses[found.radius_mm]
    assert lost and max(loss.thickness for loss in lost) == pytest.approx(3, abs=1.5)
    assert all(435 < loss.at[0] < 725 for loss in lost)
    longest = max(lost, key=lambda loss: loss.extent)
    place = f"thick at ({longest.at[0]:.0f}, {longest.at[1]:.0f}) px"
    assert f"({longest.thickness:.0f} px) {place}" in said_of(found)


@pytest.mark.slow
@pytest.mark.parametrize("width", [6, 30])
def test_what_a_build_draws_is_not_marked(tmp_path: Path, width: int) -> None:
    """Lines of two thirds of the tube are drawn by it, wider than they are; a thicker tube loses them."""
    found = look(lines(tmp_path / "a.png", width=width, body=True))
    (seen,) = found.views
    assert seen.px_per_mm == pytest.approx(SIDE / 180 * 1.2)
    assert not seen.losses[found.radius_mm] and seen.losses[max(seen.losses)]
    assert "draws all of it" in said_of(found)
    assert seen.piece_mm == pytest.approx((675 / seen.px_per_mm, 680 / seen.px_per_mm), rel=0.02)


def test_specks_that_nobody_misses_are_not_counted(tmp_path: Path) -> None:
    """Strokes without soft edges leave single pixels out where they meet."""
    ring = Image.new("L", (SIDE // 2, SIDE // 2), 255)
    ImageDraw.Draw(ring).rectangle((60, 60, 300, 300), outline=0, width=40)
    for at, level in (((80, 80), 255), ((280, 90), 255), ((20, 20), 0)):
        ring.putpixel(at, level)
    ring.save(tmp_path / "ring.png")
    (seen,) = look(tmp_path / "ring.png").views
    assert (seen.pieces, seen.holes) == (1, 1)


def test_a_tube_that_fills_the_gaps_is_not_said_to_draw_a_picture(tmp_path: Path) -> None:
    """A coil as of strokes: a tube as thick as stroke and gap leaves nothing out, half as much is spill."""
    turn = np.linspace(0, 8 * np.pi, 2000)
    x, y = SIDE / 2 + (60 + 11 * turn) * np.array([np.cos(turn), np.sin(turn)])
    coil = Image.new("L", (SIDE, SIDE), 255)
    for at in zip(x, y, strict=True):
        ImageDraw.Draw(coil).circle(at, 17, fill=0)
    coil.save(tmp_path / "coil.png")
    found = look(tmp_path / "coil.png")
    (seen,) = found.views
    spilling = [radius for radius, share in seen.spills.items() if share > 0.3]
    assert any(not seen.losses[radius] for radius in spilling)
    assert seen.whole_mm is not None and seen.whole_mm < min(spilling)
    given = said_of(look(tmp_path / "coil.png", Scene(piece=Piece(tube_radius_mm=min(spilling)))))
    assert "% as much beside it" in given


def test_a_plate_moves_the_wall_to_the_piece_and_loses_nothing(tmp_path: Path) -> None:
    path = lines(tmp_path / "a.png", width=60, body=True)
    plate = Scene.model_validate({"piece": {"supports": "none"}, "mount": {"plate": "outline"}})
    pegs, feet = look(path), look(path, plate)
    assert not feet.views[0].losses[feet.radius_mm]
    assert feet.views[0].view.wall_distance_mm < pegs.views[0].view.wall_distance_mm
    assert feet.views[0].piece_mm > pegs.views[0].piece_mm


def test_a_radius_that_is_given_is_the_one_that_is_judged(tmp_path: Path) -> None:
    path = lines(tmp_path / "a.png", width=24, body=True)
    found = look(path, Scene(piece=Piece(tube_radius_mm=6.0)))
    assert list(found.views[0].losses) == [6.0] and found.radius_mm == 6.0
    assert found.views[0].losses[6.0]


def remedies(path: Path, scene: Scene) -> tuple[int, int, float]:
    """Read the px, mm and nozzle that the refusal of a picture of thin lines names."""
    with pytest.raises(SceneError) as caught:
        require_drawable(look(path, scene))
    named = re.search(
        r"at least (\d+) px of 800 .* the picture (\d+) mm wide .* or a ([\d.]+) mm nozzle",
        caught.value.remedy,
    )
    assert named is not None, caught.value.remedy
    return int(named[1]), int(named[2]), float(named[3])


@pytest.mark.slow
@pytest.mark.parametrize("width", [pytest.param(3, marks=pytest.mark.study), 4])
def test_each_remedy_for_thin_lines_works(tmp_path: Path, width: int) -> None:
    scene = Scene()
    path = lines(tmp_path / "thin.png", width=width)
    if width == 4:
        scene = Scene(printer=Printer(name="prusa-mk4", nozzle_mm=0.6, min_tube_radius_mm=1.2))
    px, mm, nozzle = remedies(path, scene)
    printer = scene.printer
    finer = Printer(
        nozzle_mm=nozzle, min_tube_radius_mm=printer.min_tube_radius_mm * nozzle / printer.nozzle_mm
    )
    tried = [
        (lines(tmp_path / "bold.png", width=px), scene),
        (path, scene.model_copy(update={"views": (View(frame_width_mm=float(mm)),)})),
        (path, scene.model_copy(update={"printer": finer})),
    ]  # fmt: skip
    for drawing, changed in tried:
        require_drawable(look(drawing, changed))
        target = read_target(drawing)
        view = frame_view(changed.views[0], target)
        radius = (
            changed.printer.min_tube_radius_mm * view.magnification * SIDE / view.frame_width_mm
        )
        assert opening_iou(trace_polygon(target.mask), radius) > 0.85
    # and no smaller one of the first two would
    for drawing, changed in (
        (lines(tmp_path / "less.png", width=round(0.3 * px)), scene),
        (path, scene.model_copy(update={"views": (View(frame_width_mm=0.3 * mm),)})),
    ):
        with pytest.raises(SceneError):
            require_drawable(look(drawing, changed))


def test_frames_are_surveyed_by_the_hardest(tmp_path: Path) -> None:
    frames = [read_target(lines(tmp_path / f"{w}.png", width=w, body=True)) for w in (60, 20, 40)]
    found = survey(resolve(Scene()), frames, sequence=True)
    assert found.frames == 3 and found.views[0].target is frames[1]


@pytest.mark.slow
def test_several_views_are_surveyed_each(tmp_path: Path) -> None:
    targets = [read_target(lines(tmp_path / f"{w}.png", width=w, body=True)) for w in (60, 20)]
    views = (View(name="a"), View(name="b", azimuth_deg=90.0))
    scene = Scene(views=views, piece=Piece(tube_radius_mm=3.0))
    found = survey(resolve(scene), targets)
    assert [v.target for v in found.views] == targets
    assert all(list(v.losses) == [3.0] == [found.radius_mm] for v in found.views)


def test_red_marks_what_is_lost(tmp_path: Path) -> None:
    found = look(lines(tmp_path / "a.png", width=3, body=True))
    pixels = np.asarray(Image.open(io.BytesIO(draw_survey(found))).convert("RGB")).astype(int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 120)
    panel = pixels.shape[1] // (1 + len(found.views[0].losses))
    assert not red[:, :panel].any()
    first = red[:, panel : 2 * panel]
    assert first[:, panel // 2 :].sum() > 200 and not first[:, : panel // 2].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["مرحبا", "猫, 犬", "Café & Łódź"])
def test_a_name_that_the_captions_font_lacks_is_left_out(name: str) -> None:
    image = Image.new("RGB", (360, 20))
    named, bare = (_with_caption(Panel(text, image)) for text in (f"{name}, 1 piece", "1 piece"))
    assert (named.tobytes() == bare.tobytes()) == (not name.startswith("Caf"))


def test_the_command_writes_a_picture_and_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = lines(tmp_path / "a.png", width=6, body=True), tmp_path / "new" / "seen.png"
    words = ["preview", str(path), "--out", str(out), "--width", "240", "--json"]
    assert app(words, exit_on_error=False, result_action="return_value") == 0
    said = json.loads(capsys.readouterr().out)
    scene = Scene(views=(View(frame_width_mm=240.0),))
    assert {**list_figures(look(path, scene)), "picture": str(out)} == said
    with Image.open(out) as drawn:
        assert drawn.width > 500
    assert list(out.parent.iterdir()) == [out]


def test_what_nobody_would_know_is_said_with_its_reason(tmp_path: Path) -> None:
    scene = Scene(views=(View(lines=False),))
    target = read_target(lines(tmp_path / "thin.png", width=3))
    (line,) = [t for t in describe(survey(resolve(scene), [target])) if "Nobody" in t]
    assert re.search(r"its IoU would be about 0\.[1-4]", line) and "0 of its" not in line


def test_thin_lines_are_drawn_along_their_middle(tmp_path: Path) -> None:
    thin = read_target(lines(tmp_path / "thin.png", width=3))
    asked = resolve(Scene())
    scene, targets = widen_targets(asked, (thin,))
    assert scene.views[0].lines
    assert scene.views[0].thicken_mm == pytest.approx(2 * 0.8 * 1.2)
    found = survey(scene, targets)
    require_drawable(found)
    assert found.radius_mm == pytest.approx(0.8)
    (said,) = [line for line in describe(found) if "along each of its strokes" in line]
    assert "1.6 mm thick (radius 0.80 mm)" in said
    # a thick drawing is filled, and so are several pictures
    bold = read_target(lines(tmp_path / "bold.png", width=30))
    assert widen_targets(asked, (bold,))[0].views[0].lines is False
    two = Scene(views=(View(name="a"), View(name="b", azimuth_deg=90.0)))
    assert [v.lines for v in widen_targets(resolve(two), (thin, thin))[0].views] == [False, False]


@pytest.mark.slow
def test_lines_too_close_together_are_refused(tmp_path: Path) -> None:
    image = Image.new("L", (SIDE // 2, SIDE // 2), 255)
    draw = ImageDraw.Draw(image)
    for k in range(50, 150, 6):
        draw.line((50, k, 150, k), fill=0, width=2)
    image.save(tmp_path / "hatched.png")
    scene, targets = widen_targets(resolve(Scene()), (read_target(tmp_path / "hatched.png"),))
    with pytest.raises(SceneError, match="run together") as caught:
        require_drawable(survey(scene, targets))
    assert "--lines" not in caught.value.remedy
    wide = int(re.search(r"the picture (\d+) mm wide", caught.value.remedy)[1])  # type: ignore[index]
    larger = Scene(views=(View(frame_width_mm=float(wide)),))
    scene, targets = widen_targets(resolve(larger), (read_target(tmp_path / "hatched.png"),))
    require_drawable(survey(scene, targets))


def test_several_pictures_are_not_drawn_along_lines(tmp_path: Path) -> None:
    target = read_target(lines(tmp_path / "thin.png", width=3))
    scene = Scene(views=(View(name="a", lines="on"), View(name="b", azimuth_deg=90.0)))
    with pytest.raises(InputError, match=r"one picture: strands .* side by side"):
        widen_targets(resolve(scene), (target, target))
    with pytest.raises(InputError, match=r"one picture: a sequence .* cut and joined"):
        widen_targets(resolve(Scene(views=scene.views[:1])), (target, target), sequence=True)


@pytest.mark.slow
def test_a_glance_at_a_large_picture_says_the_same(tmp_path: Path) -> None:
    """It is read shrunk, and its px are those of the picture."""
    image = Image.open(lines(tmp_path / "a.png", width=3, body=True))
    image.resize((3 * SIDE, 3 * SIDE)).convert("P").save(tmp_path / "large.png")
    found = [read_target(tmp_path / "large.png", glance=glance) for glance in (0, GLANCE)]
    assert [t.mask.shape[0] * t.shrunk for t in found] == [3 * SIDE] * 2
    assert found[1].shrunk == 2
    whole, glanced = (
        list_figures(survey(resolve(Scene()), [t]))["views"][0]["radii"][0]["lost"][0]
        for t in found
    )
    assert glanced["at_px"] == pytest.approx(whole["at_px"], abs=9)
    for key in ("length_px", "thickness_px"):
        assert glanced[key] == pytest.approx(whole[key], abs=3)
    for key in ("length_mm", "thickness_mm", "needed_radius_mm"):
        assert glanced[key] == pytest.approx(whole[key], abs=0.25)


@pytest.mark.slow
def test_a_glance_tells_places_and_rules_in_the_pictures_own_px(tmp_path: Path) -> None:
    dots = np.zeros((2000, 4000), dtype=bool)
    dots[400:1600, 400:3600] = True
    dots[100:106, 100:106], dots[100:112, 200:212] = True, True  # 36 px, less than asked for; 144
    Image.fromarray(~dots).convert("L").save(tmp_path / "large.png")
    reading = Reading(speck_px=40, smooth_px=3.0)
    whole, glanced = (
        read_target(tmp_path / "large.png", reading, glance=glance) for glance in (0, GLANCE)
    )
    assert glanced.shrunk == 4 and glanced.rule == whole.rule
    assert "less than 40 px" in whole.rule and "smoothed by 3 px" in whole.rule
    assert glanced.original is not None and whole.original is not None
    assert not glanced.original[:60, :40].any() and glanced.original[:60, 40:60].any()
    rows, columns = np.nonzero(glanced.original)
    middle = glanced.to_picture((columns.max(), rows.max()))
    # it is the one in the middle of the last four px across
    assert middle == (3599 - 1.5, 1599 - 1.5) and whole.to_picture((7, 9)) == (7, 9)


def test_a_glance_leaves_thin_strips_as_thick_as_they_are(tmp_path: Path) -> None:
    for height, left in ((16, 16), (500, 250)):
        strip = np.full((height, 8000), 255, dtype=np.uint8)
        strip[height // 4 : height // 2, 400:3000] = 0
        Image.fromarray(strip).save(tmp_path / "strip.png")
        assert len(read_target(tmp_path / "strip.png", glance=True).mask) == left


@pytest.mark.slow
def test_the_guess_counts_the_plate_of_a_wall_mount(tmp_path: Path) -> None:
    image = Image.new("L", (120, 80), 255)
    for left in (12, 72):
        ImageDraw.Draw(image).ellipse([left, 20, left + 36, 56], fill=0)
    image.save(tmp_path / "two.png")
    target = read_target(str(tmp_path / "two.png"))

    def guess(knots: int | None = None, kind: str = "auto", printed: bool = True) -> float:
        piece, mount = {"printed": printed, "knots": knots}, {"kind": kind}
        scene = Scene.model_validate({"views": [{}], "piece": piece, "mount": mount})
        return survey(resolve(scene), [target]).guess.mass_g

    bare, held = guess(printed=False), guess(kind="wall")
    assert guess() == guess(kind="none") == guess(kind="stand") == bare > 0.0
    assert guess(1, "wall") < held
    (view,) = survey(resolve(Scene()), [target]).views
    wide = [side + 2 * Scene().mount.plate_margin_mm for side in view.view.frame_mm]
    plate = wide[0] * wide[1] * Scene().mount.thickness_mm * 1e-3
    assert held - bare == pytest.approx(plate * resolve(Scene()).material.density_g_cm3)


@pytest.mark.parametrize(
    ("width", "said"), [(12.0, "less than 1 g"), (50_000.0, "no printer makes")]
)
def test_no_guess_is_absurd(width: float, said: str) -> None:
    scene = resolve(Scene.model_validate({"views": [{"frame_width_mm": width}]}))
    assert said in describe(survey(scene, [read_target("text:o")]))[-1]


def test_a_plate_of_the_outline_is_guessed_as_such() -> None:
    target, guesses = read_target("text:L"), {}
    for plate in ("full", "outline"):
        mount = {"kind": "wall", "foot": "plate", "plate": plate}
        scene = resolve(Scene.model_validate({"mount": mount, "piece": {"tube_radius_mm": 2.0}}))
        guesses[plate] = survey(scene, [target]).guess
    full, outline = guesses["full"], guesses["outline"]
    assert full.hours and outline.hours and outline.hours < 0.9 * full.hours
    assert 0.3 * full.mass_g < outline.mass_g < 0.8 * full.mass_g


@pytest.mark.slow
def test_the_guess_adds_up_several_pictures_and_says_what_it_leaves_out() -> None:
    stands = Scene.model_validate(
        {"views": [{}, {"azimuth_deg": 90.0}], "mount": {"kind": "stand"}}
    )
    target = read_target("text:o")
    seen = survey(resolve(Scene()), [target]).views[0]
    one, two = (
        guess_print(resolve(scene), seen.view, [seen.area_mm2] * n, seen.piece_mm, 2.0)
        for n, scene in ((1, Scene()), (2, stands))
    )
    assert two.mass_g == pytest.approx(2 * one.mass_g) and two.hours and one.hours
    assert two.without == "its stand" and "--print adds" in one.without
    printed = resolve(Scene(piece=Piece(printed=True)))
    held = guess_print(printed, seen.view, [1.0], seen.piece_mm, 2.0)
    assert held.without == "what holds it"
    assert one.hours < two.hours < 2 * one.hours


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cat", pytest.param("knight", marks=pytest.mark.study)])
def test_the_radius_is_that_of_the_build(name: str) -> None:
    """Here the search's own choice, made without the preview's memory, places of knots included."""
    target = read_target(Path("examples") / f"{name}.png")
    scene = Scene(accuracy=Accuracy(name="sketch"))
    found = survey(resolve(scene), [target])
    radius._KEPT.clear()
    settings = search_settings("sketch", {})
    assert (
        choose_tube(ask(resolve(scene), [target]), settings, Progress("quiet"))[1]
        == found.radius_mm
    )


@pytest.mark.slow
def test_a_build_refuses_what_a_preview_says_and_nothing_else(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 2, (224, 224)).astype(np.uint8) * 255
    Image.fromarray(noise).save(tmp_path / "noise.png")
    lines(tmp_path / "house.png", width=30, body=True)
    for name, refused in (("noise", True), ("house", False)):
        options = BuildOptions(out=tmp_path / "out", skip=())
        path = str(tmp_path / f"{name}.png")
        found = survey_pictures([path], options)
        assert (found.refusal is not None) == refused == ("would refuse" in describe(found)[-1])
        try:
            prepare_build([path], options, "", Progress("quiet"))
        except SceneError as error:
            assert found.refusal is not None and error.why == found.refusal.why
        else:
            assert found.refusal is None
