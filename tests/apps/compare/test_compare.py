"""Photographs of shadows, rendered: perspective, noise, uneven light; the lamp in its place or beside it.

The photographed shadow is found ray by ray, as nothing in the maker draws it.
"""

import io
import json
import re
import shlex
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command import knotfab
from pages import open_browser
from PIL import Image, ImageDraw
from scipy import ndimage

from knotfab.apps.compare.compare import advise, compare_photo, write_comparison
from knotfab.apps.compare.rectify import find_lamp, find_marks, homography, map_points
from knotfab.base.arrays import Array, Mask
from knotfab.knots import Knot, Knots
from knotfab.part.write import make_pose
from knotfab.report.drill_template import card_middles, draw_marks_page
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.load import dump_scene, load_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView, Scene

VIEW = ResolvedView(
    name="front", picture="picture-front.png", frame_width_mm=160.0, frame_height_mm=120.0
)
T = np.linspace(0, 2 * np.pi, 120, endpoint=False)
KNOTS = Knots(
    (
        Knot(np.stack([45 * np.cos(T), 30 * np.sin(T), 22 * np.cos(3 * T)], axis=1)),
        Knot(np.stack([14 * np.cos(T) + 8, 11 * np.sin(T) - 3, -18 * np.sin(2 * T)], axis=1)),
    ),
    5.0,
)
CORNERS = 0.45 * np.array([[210.0, 140.0], [1010.0, 190.0], [960.0, 800.0], [260.0, 720.0]])
FARTHER = CORNERS.mean(axis=0) + 0.72 * (CORNERS - CORNERS.mean(axis=0))
SIZE = (540, 405)


@cache
def shaded(moved: tuple[float, float, float]) -> Array:
    """(180, 220) what the piece darkens of the frame and 30 mm about it, a px to a mm, under a small lamp."""
    camera = camera_of(VIEW, 160, 120).padded(30, 30)
    dark = _darken(camera, camera.eye + np.array(moved))
    return np.asarray(ndimage.gaussian_filter(dark.astype(float), 0.8))


def _darken(camera: Camera, eye: Array) -> Mask:
    """(H, W) whether the ray from the lamp to each pixel meets a tube: point by point, finely sampled."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = camera.corner + u[..., None] * camera.du + v[..., None] * camera.dv - eye
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    dark = np.zeros(u.shape, dtype=bool)
    for knot in KNOTS.knots:
        ahead = np.roll(knot.points, -1, axis=0)
        for share in (0.0, 0.5):
            points = knot.points + share * (ahead - knot.points) - eye
            off2 = (points**2).sum(axis=1) - (rays @ points.T) ** 2
            dark |= (off2 < KNOTS.radius_mm**2).any(axis=-1)
    return dark


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a build of a picture writes, whose shadow is the picture."""
    place = tmp_path_factory.mktemp("built")
    grown = ndimage.zoom(
        shaded((0.0, 0.0, 0.0))[30:-30, 30:-30], 2, order=1, grid_mode=True, mode="nearest"
    )
    Image.fromarray(np.where(grown > 0.5, 0, 255).astype(np.uint8)).save(place / VIEW.picture)
    scene = Scene(views=(VIEW,), mount=Mount(kind="wall"), pose=make_pose(np.eye(4)))
    (place / "scene.toml").write_text(dump_scene(scene))
    KNOTS.write(place / "knots.json")
    return place


@pytest.fixture
def unknown(folder: Path, tmp_path: Path) -> Path:
    """The same without its knots: nothing is said of the lamp."""
    place = tmp_path / "unknown"
    shutil.copytree(folder, place, ignore=lambda *_: ["knots.json"])
    return place


def photograph(
    path: Path,
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0),
    cards: float | None = None,
    far: bool = False,
) -> Path:
    """A wall in perspective, lit from one side, with the shadow of the piece for a lamp that is moved.

    Args:
        cards: so many mm about the frame, on paper as white as the wall.
        far: the corners are `FARTHER`.
    """
    path.write_bytes(_photographed(moved, cards, far))
    return path


@cache
def _photographed(moved: tuple[float, float, float], cards: float | None, far: bool) -> bytes:
    """The PNG of a photograph, made once for all tests that ask for it."""
    corners = FARTHER if far else CORNERS
    frame = np.array([[0, 0], [160, 0], [160, 120], [0, 120]]) - 0.5
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    at = map_points(
        homography(corners, frame), np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    )
    shade = ndimage.map_coordinates(shaded(moved), (at[:, ::-1] + 30).T, order=1, cval=0.0).reshape(
        x.shape
    )
    light = 0.85 - 0.35 * x / SIZE[0] - 0.2 * (y / SIZE[1]) ** 2
    colour = np.full((*x.shape, 3), (0.9, 0.88, 0.85))
    if cards is not None:
        for middle in card_middles((160.0, 120.0), cards):
            off = np.linalg.norm(at + 0.5 - middle, axis=1).reshape(x.shape)
            inked = (off < 4) | ((off > 8) & (off < 12))
            colour[ndimage.gaussian_filter(inked.astype(float), 0.6) > 0.5] = 0.07
    photo = colour * (light * (1 - 0.6 * shade))[..., None]
    photo += np.random.default_rng(1).normal(0, 0.03, photo.shape)
    file = io.BytesIO()
    Image.fromarray((255 * photo.clip(0, 1)).astype(np.uint8)).save(file, "PNG", compress_level=1)
    return file.getvalue()


def words(corners: Array = CORNERS) -> list[str]:
    return [f"{x:.0f},{y:.0f}" for x, y in corners]


@pytest.mark.slow
def test_a_lamp_in_its_place(folder: Path, tmp_path: Path) -> None:
    found = compare_photo(photograph(tmp_path / "photo.png"), folder, words())
    assert found.iou > 0.97 and found.missing < 0.02 and found.spilled < 0.02
    assert advise(found) == "The lamp stands where it should."


@pytest.mark.slow
def test_a_lamp_beside_its_place_is_found(folder: Path, tmp_path: Path) -> None:
    moved = (-12.0, -10.0, 90.0)
    found = compare_photo(photograph(tmp_path / "photo.png", moved), folder, words())
    assert found.lamp is not None and found.lamp.iou > 0.96 > found.iou
    fitted = (found.lamp.right_mm, found.lamp.up_mm, found.lamp.away_mm)
    assert np.allclose(fitted[:2], moved[:2], atol=1.5)
    assert fitted[2] == pytest.approx(moved[2], abs=12)
    assert all(f" mm {way}" in advise(found) for way in ("right", "up", "nearer"))


def begun(at: int) -> list[str]:
    """The corners, the first of which is another."""
    return words(np.roll(CORNERS, -at, axis=0))


@pytest.mark.slow
def test_corners_begun_at_the_wrong_one_are_named_in_their_order(
    folder: Path, tmp_path: Path
) -> None:
    photo = photograph(tmp_path / "photo.png", (-12.0, -10.0, 90.0))
    found = compare_photo(photo, folder, begun(1))
    assert found.alike is False and found.instead == (tuple(words()),)
    told = advise(found)
    assert "does not look like" in told and "--corners " + " ".join(words()) in told
    assert "lamp" not in told.lower()
    written = found.to_dict()
    assert written["lamp"] is None and written["corners_instead"] == [words()]
    assert written["corners"] == begun(1)


@pytest.mark.slow
def test_the_shadow_of_another_piece_says_nothing_of_the_lamp(folder: Path, tmp_path: Path) -> None:
    place = shutil.copytree(folder, tmp_path / "other")
    bar = Knot(np.stack([60 * np.cos(T), 6 * np.sin(T) + 30, 20 * np.cos(2 * T)], axis=1))
    Knots((bar,), 5.0).write(place / "knots.json")
    image = np.full((240, 320), 255, dtype=np.uint8)
    image[40:80, 30:290] = 0
    Image.fromarray(image).save(place / VIEW.picture)
    photo, out = photograph(tmp_path / "photo.png"), tmp_path / "out.png"
    done = knotfab("compare", photo, place, "--corners", *words(), "--out", out, "--json")
    told = json.loads(done.out)
    assert done.code == 1 and told["lamp"] is None and told["alike"] is False
    assert not told["corners_instead"] and "does not look like" in told["advice"]
    assert "Move the lamp" not in told["advice"]
    assert {"iou", "missing", "spilled", "advice", "picture"} <= set(told) and out.is_file()


@pytest.mark.parametrize("dark", [(slice(0, 3), slice(0, 3)), (slice(0, 180), slice(0, 220))])
def test_a_lamp_is_looked_for_in_front_of_the_piece_alone(dark: tuple[slice, slice]) -> None:
    """A speck in a corner, or a frame that is dark all over, once led it behind the piece, far away."""
    camera = camera_of(VIEW, 160, 120).padded(30, 30)
    seen = np.zeros((180, 220), dtype=bool)
    seen[dark] = True
    found = find_lamp(KNOTS, camera, seen)
    reach = VIEW.light_distance_mm + VIEW.wall_distance_mm
    assert np.linalg.norm([found.right_mm, found.up_mm, found.away_mm]) <= reach
    assert reach + found.away_mm > VIEW.wall_distance_mm + 22 and np.isfinite(found.iou)


@pytest.mark.slow
def test_without_knots_another_order_is_named_by_the_picture(unknown: Path, tmp_path: Path) -> None:
    photo = photograph(tmp_path / "photo.png")
    found = compare_photo(photo, unknown, begun(2))
    assert found.instead == (tuple(words()),) and "another order" in advise(found)
    assert compare_photo(photo, unknown, words()).alike is None


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wall", "stand"])
@pytest.mark.study
def test_the_frame_is_found_by_four_marks(folder: Path, kind: str, tmp_path: Path) -> None:
    """The marks of a wall mount lie about its plate; a stand has none, and nothing else tells its frame."""
    margin, moved = (8.0 if kind == "wall" else 0.0), (-12.0, -10.0, 90.0)
    place = shutil.copytree(folder, tmp_path / "built")
    scene = (place / "scene.toml").read_text().replace('kind = "wall"', f'kind = "{kind}"')
    (place / "scene.toml").write_text(scene)
    photo = photograph(tmp_path / "photo.png", moved, cards=margin, far=True)
    if kind == "wall":
        (place / "knots.json").unlink()
        named = compare_photo(photo, place, words(FARTHER))
        assert compare_photo(photo, place).iou == pytest.approx(named.iou, abs=0.02)
    else:
        found = compare_photo(photo, place)
        assert found.lamp is not None and found.lamp.iou > 0.95
        assert np.allclose((found.lamp.right_mm, found.lamp.up_mm), moved[:2], atol=1.5)
    marks = find_marks(np.asarray(Image.open(photo).convert("L")) / 255)
    frame = np.array([[0, 0], [160, 0], [160, 120], [0, 120]])
    wanted = map_points(homography(frame, FARTHER), card_middles((160.0, 120.0), margin))
    assert marks is not None and np.linalg.norm(marks - wanted, axis=1).max() < 1.0
    if kind == "stand":
        with pytest.raises(InputError, match="four marks"):
            compare_photo(photograph(tmp_path / "bare.png", moved), place)


def test_marks_are_told_from_what_is_like_them() -> None:
    """Three marks and targets of other rings, and letters, are not four; dimmed and blurred ones are."""
    sheet = Image.new("L", (900, 700), 225)
    pen = ImageDraw.Draw(sheet)

    def target(x: int, y: int, radii: tuple[int, ...]) -> None:
        for k, r in enumerate(radii):
            pen.ellipse((x - r, y - r, x + r, y + r), fill=225 if k % 2 else 20)

    for x, y in ((120, 110), (760, 140), (740, 600)):
        target(x, y, (36, 24, 12))
    target(140, 590, (36, 30, 24))  # thin rings
    target(450, 350, (90, 30))  # one ring
    target(450, 600, (50, 40, 10))  # a small dot
    pen.text((300, 100), "OoO@@ 8888", fill=0, font_size=48)
    assert find_marks(np.asarray(sheet) / 255) is None
    target(140, 590, (39, 37))
    pen.rectangle((100, 550, 180, 630), fill=225)
    target(140, 590, (36, 24, 12))
    y, x = np.mgrid[:700, :900]
    seen = np.asarray(sheet) / 255 * (0.15 + 0.35 * x / 900) * (1 - 0.4 * (y > 300))
    seen = ndimage.gaussian_filter(seen, 2.0)
    seen += np.random.default_rng(3).normal(0, 0.01, seen.shape)
    marks = find_marks(seen)
    assert marks is not None
    wanted = [[120, 110], [760, 140], [740, 600], [140, 590]]
    assert np.abs(marks - wanted).max() < 1.0


@pytest.mark.slow
def test_the_printed_marks_are_those_that_are_looked_for() -> None:
    figure = draw_marks_page(plate=False)
    file = io.BytesIO()
    figure.savefig(file, dpi=100)
    marks = find_marks(np.asarray(Image.open(file).convert("L")) / 255)
    assert marks is not None
    sides = np.linalg.norm(np.roll(marks, -1, axis=0) - marks, axis=1)
    assert sides * 25.4 / 100 == pytest.approx([70.0] * 4, abs=0.2)


@pytest.mark.slow
def test_four_clicks(unknown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page says a command with the corners in order, whatever order they are pointed at in."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    photo, out = photograph(tmp_path / "a photo.png"), tmp_path / "out.png"
    done = knotfab("compare", photo, unknown, "--click", "--out", out)
    assert done.code == 0 and str(tmp_path / "out.html") in done.out, done.err
    assert opened == [(tmp_path / "out.html").as_uri()]
    with open_browser() as browser:
        page = browser.new_page(viewport={"width": 700, "height": 900})
        page.goto(opened[0])
        box = page.locator("#photo").bounding_box()
        assert box is not None
        scale = box["width"] / SIZE[0]
        for k in (2, 1, None, 0, 3, 1):  # the second is taken back
            if k is None:
                page.keyboard.press("Escape")
                continue
            x, y = CORNERS[k] * scale
            page.mouse.click(box["x"] + x, box["y"] + y)
        command = shlex.split(page.inner_text("#command"))
    assert command[:4] == ["knotfab", "compare", str(photo), str(unknown)]
    at = command.index("--corners")
    told = np.array([[float(v) for v in word.split(",")] for word in command[at + 1 : at + 5]])
    assert np.abs(told - CORNERS).max() < 2.0
    assert knotfab(*command[1:]).code == 0 and out.is_file()


@pytest.mark.slow
def test_where_they_differ_is_drawn(unknown: Path, tmp_path: Path) -> None:
    photo, out = photograph(tmp_path / "photo.png", (15.0, 0.0, 0.0)), tmp_path / "out.png"
    done = knotfab("compare", photo, unknown, "--corners", *words(), "--out", out, "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    sheet = np.asarray(Image.open(out)).reshape(-1, 3)
    both, missing, spilled = (
        int((sheet == colour).all(axis=1).sum())
        for colour in ((150, 146, 140), (33, 102, 172), (200, 60, 20))
    )
    assert both / (both + missing + spilled) == pytest.approx(told["iou"], abs=1e-3)
    assert told["iou"] < 0.9 and told["lamp"] is None


@pytest.mark.slow
def test_a_frame_of_a_sequence_is_compared_by_its_name(folder: Path, tmp_path: Path) -> None:
    walk = tmp_path / "walk"
    walk.mkdir()
    (walk / "scene.toml").write_text("")
    for suffix in ("-01", "-02"):
        shutil.copy(folder / VIEW.picture, walk / f"picture-frame{suffix}.png")
        own = {"name": f"frame{suffix}", "picture": f"picture-frame{suffix}.png"}
        text = load_scene(folder / "scene.toml")
        scene = text.model_copy(update={"views": (VIEW.model_copy(update=own),)})
        (walk / f"scene{suffix}.toml").write_text(dump_scene(scene))
        shutil.copy(folder / "knots.json", walk / f"knots{suffix}.json")
    photo = photograph(tmp_path / "photo.png")
    found = compare_photo(photo, walk, words(), "frame-02")
    assert found.iou > 0.9 and found.lamp is not None  # by its own knots
    for name, why in ((None, "it is a sequence"), ("frame-03", "has no such frame")):
        with pytest.raises(InputError, match=f"{why}.*--view frame-01 to frame-02"):
            compare_photo(photo, walk, words(), name)


@pytest.mark.slow
def test_what_a_refusal_suggests_does(folder: Path, tmp_path: Path) -> None:
    """Four corners in the order that it asks for, a view that it names, a file in PNG."""
    photo = photograph(tmp_path / "photo.png")

    def remedy(*asked: str, view: str | None = None) -> str:
        with pytest.raises(InputError) as caught:
            compare_photo(photo, folder, list(asked) or None, view)
        return caught.value.remedy

    orders = [remedy(*words()[::-1]), remedy("1,2", "3,4"), remedy()]
    assert all("x,y" in order for order in orders)
    (known,) = re.findall(r"It has: (\w+)\.", remedy(*words(), view="back"))
    with pytest.raises(InputError) as caught:
        write_comparison(compare_photo(photo, folder, words(), known), tmp_path / "a.jpg")
    (suffix,) = re.findall(r"file in (\.\w+)\.", caught.value.remedy)
    drawn = (tmp_path / "a").with_suffix(suffix)
    write_comparison(compare_photo(photo, folder, words(), known), drawn)
    with Image.open(drawn) as picture:
        assert picture.format == "PNG"


@pytest.mark.slow
def test_what_cannot_be_compared(folder: Path, tmp_path: Path) -> None:
    photo = photograph(tmp_path / "photo.png")
    plain = tmp_path / "plain.png"
    Image.new("RGB", SIZE, (200, 190, 180)).save(plain)
    (tmp_path / "words.png").write_text("no photograph")
    dark, huge, script = tmp_path / "dark.png", tmp_path / "huge.png", tmp_path / "script.eps"
    Image.new("RGB", SIZE).save(dark)
    Image.new("1", (16000, 12000)).save(huge)
    with (tmp_path / "heavy.png").open("wb") as file:
        file.truncate(10 * 12000**2)  # bytes, of which a disk holds none
    Image.new("L", (20, 20)).save(script)
    damaged = [tmp_path / name for name in ("cut", "empty")]
    for place, text in zip(damaged, ('{"knots": [', "{}"), strict=True):
        shutil.copytree(folder, place)
        (place / "knots.json").write_text(text)
    for call, why in (
        ((dark, folder, "--corners", *words()), "no shadow stands out"),
        ((huge, folder), "more than 12000 pixels"),
        ((tmp_path / "heavy.png", folder), "at most 12000 pixels on a side"),
        ((script, folder), "PostScript"),
        *(
            ((photo, place, "--corners", *words()), "knots.json: it is damaged")
            for place in damaged
        ),
        ((photo, folder), "it does not show the four marks. Put"),
        ((plain, folder, "--corners", *words()), "no shadow stands out"),
        ((tmp_path / "words.png", folder), "not a picture that can be read"),
        ((photo, tmp_path), "no such file"),
        ((photo, folder, "--corners", *words()[::-1]), "clockwise"),
        ((photo, folder, "--corners", "1,2", "3,4", "5,6", "x"), "not four points"),
        ((photo, folder, "--view", "back"), "no such view"),
    ):
        done = knotfab("compare", *call)
        assert done.code == 2 and why in done.err, (done.err, why)
        assert done.err.count("\n") == 1
    with pytest.raises(InputError, match="outside its"):
        compare_photo(photo, folder, ["-5,10", "900,10", "900,800", "10,800"])
