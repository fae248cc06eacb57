"""Photographs of shadows, rendered: perspective, noise, uneven light; the lamp in its place or beside it.

The photographed shadow is found ray by ray, as nothing in the maker draws it.
"""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command import knotfab
from PIL import Image
from scipy import ndimage

from knotfab.arrays import Array, Mask
from knotfab.compare.compare import advise, compare_photo
from knotfab.compare.rectify import homography, through
from knotfab.errors import InputError
from knotfab.knots import Knot, Knots
from knotfab.part.write import make_pose
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Mount, ResolvedView, Scene

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
CORNERS = 0.75 * np.array([[210.0, 140.0], [1010.0, 190.0], [960.0, 800.0], [260.0, 720.0]])
SIZE = (900, 675)


@cache
def shaded(moved: tuple[float, float, float]) -> Array:
    """(180, 220) what the piece darkens of the frame and 30 mm about it, a px to a mm, under a small lamp."""
    camera = camera_of(VIEW, 160, 120).padded(30, 30)
    dark = darkened(camera, camera.eye + np.array(moved))
    return np.asarray(ndimage.gaussian_filter(dark.astype(float), 0.8))


def darkened(camera: Camera, eye: Array) -> Mask:
    """(H, W) whether the ray from the lamp to each pixel meets a tube: point by point, finely sampled."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = camera.corner + u[..., None] * camera.du + v[..., None] * camera.dv - eye
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    dark = np.zeros(u.shape, dtype=bool)
    for knot in KNOTS.knots:
        ahead = np.roll(knot.points, -1, axis=0)
        for share in (0.0, 0.5):
            for point in knot.points + share * (ahead - knot.points) - eye:
                off = np.linalg.norm(point - rays * (rays @ point)[..., None], axis=-1)
                dark |= off < KNOTS.radius_mm
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
    plate: bool = False,
) -> Path:
    """A wall in perspective, lit from one side, with the shadow of the piece for a lamp that is moved."""
    frame = np.array([[0, 0], [160, 0], [160, 120], [0, 120]]) - 0.5
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    at = through(homography(CORNERS, frame), np.stack([x.ravel(), y.ravel()], axis=1).astype(float))
    shade = ndimage.map_coordinates(shaded(moved), (at[:, ::-1] + 30).T, order=1, cval=0.0).reshape(
        x.shape
    )
    light = 0.85 - 0.35 * x / SIZE[0] - 0.2 * (y / SIZE[1]) ** 2
    colour = np.full((*x.shape, 3), (0.9, 0.88, 0.85))
    if plate:  # 8 mm about the frame
        inside = ((at > -8.5) & (at < (167.5, 127.5))).all(axis=1).reshape(x.shape)
        colour[~inside] *= (0.62, 0.7, 0.8)
    photo = colour * (light * (1 - 0.6 * shade))[..., None]
    photo += np.random.default_rng(1).normal(0, 0.03, photo.shape)
    Image.fromarray((255 * photo.clip(0, 1)).astype(np.uint8)).save(path)
    return path


def words(corners: Array = CORNERS) -> list[str]:
    return [f"{x:.0f},{y:.0f}" for x, y in corners]


def test_a_lamp_in_its_place(folder: Path, tmp_path: Path) -> None:
    found = compare_photo(photograph(tmp_path / "photo.png"), folder, words())
    assert found.iou > 0.97 and found.missing < 0.02 and found.spilled < 0.02
    assert advise(found) == "The lamp stands where it should."


@pytest.mark.parametrize(
    ("moved", "advice"),
    [
        ((-12.0, -10.0, 90.0), ["right", "up", "nearer"]),
    ],
)
def test_a_lamp_beside_its_place_is_found(
    folder: Path, tmp_path: Path, moved: tuple[float, float, float], advice: list[str]
) -> None:
    found = compare_photo(photograph(tmp_path / "photo.png", moved), folder, words())
    assert found.lamp is not None and found.lamp.iou > 0.96 > found.iou
    fitted = (found.lamp.right_mm, found.lamp.up_mm, found.lamp.away_mm)
    assert np.allclose(fitted[:2], moved[:2], atol=1.5)
    assert fitted[2] == pytest.approx(moved[2], abs=12)
    assert all(f" mm {way}" in advise(found) for way in advice)


def test_the_frame_is_found_by_the_plate(unknown: Path, tmp_path: Path) -> None:
    photo = photograph(tmp_path / "photo.png", plate=True)
    found = compare_photo(photo, unknown)
    assert found.iou > 0.94 and found.lamp is None and advise(found) == ""
    named = compare_photo(photo, unknown, words())
    assert found.iou == pytest.approx(named.iou, abs=0.03)


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


def test_what_cannot_be_compared(folder: Path, tmp_path: Path) -> None:
    photo = photograph(tmp_path / "photo.png")
    plain = tmp_path / "plain.png"
    Image.new("RGB", SIZE, (200, 190, 180)).save(plain)
    (tmp_path / "words.png").write_text("no photograph")
    dark, huge, script = tmp_path / "dark.png", tmp_path / "huge.png", tmp_path / "script.eps"
    Image.new("RGB", SIZE).save(dark)
    Image.new("1", (16000, 12000)).save(huge)
    Image.new("L", (20, 20)).save(script)
    damaged = [tmp_path / name for name in ("cut", "empty")]
    for place, text in zip(damaged, ('{"knots": [', "{}"), strict=True):
        shutil.copytree(folder, place)
        (place / "knots.json").write_text(text)
    for call, why in (
        ((dark, folder, "--corners", *words()), "no shadow stands out"),
        ((huge, folder), "more than 12000 px"),
        ((script, folder), "no photograph"),
        *(
            ((photo, place, "--corners", *words()), "knots.json: it is damaged")
            for place in damaged
        ),
        ((photo, folder), "outline is not found"),
        ((plain, folder, "--corners", *words()), "no shadow stands out"),
        ((tmp_path / "words.png", folder), "no photograph"),
        ((photo, tmp_path), "no such scene file"),
        ((photo, folder, "--corners", *words()[::-1]), "clockwise"),
        ((photo, folder, "--corners", "1,2", "3,4", "5,6", "x"), "not four points"),
        ((photo, folder, "--view", "back"), "no such view"),
    ):
        done = knotfab("compare", *call)
        assert done.code == 2 and why in done.err, (done.err, why)
        assert done.err.count("\n") == 1
    with pytest.raises(InputError, match="outside its"):
        compare_photo(photo, folder, ["-5,10", "900,10", "900,800", "10,800"])
