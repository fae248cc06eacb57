"""Several pictures are made to agree before a search: what moves, bends, is refused, and is kept."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from knotfab.base.errors import SceneError
from knotfab.design import bend
from knotfab.design.agree import AGREED, agree, apply_bending, require_agreed
from knotfab.design.bend import Tension
from knotfab.design.frames import frame_view, framed_alike, spread_views
from knotfab.design.hull import HullBound
from knotfab.picture.bending import (
    COLUMNS,
    ROWS,
    bend_mask,
    displace,
    keeps_shape,
    measure_bending,
    read_points,
    stretch_of,
    write_points,
)
from knotfab.picture.read import Target
from knotfab.pipeline.options import options_from
from knotfab.pipeline.read_options import read_scene
from knotfab.report.pictures import draw_agreement
from knotfab.scene.camera import cameras_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.scene.require import require_several
from knotfab_formats.errors import InputError
from knotfab_formats.scene import MOST_VIEWS, Scene
from knotfab_formats.views import View
from knotfab_validators.files.picture import bend_of, bend_silhouette

SIDE = 160


def picture(name: str, *shapes: tuple[float, float, float, float]) -> Target:
    """A silhouette of ellipses (x, y, half width, half height), in shares of the side."""
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    for u, v, a, b in shapes:
        mask |= ((x - u) / a) ** 2 + ((y - v) / b) ** 2 <= 1
    return Target(name, mask)


EGG = picture("egg", (0.5, 0.5, 0.3, 0.42))
# two bodies above each other: at the height of the neck an egg is wide
HOURGLASS = picture("hourglass", (0.5, 0.28, 0.3, 0.22), (0.5, 0.72, 0.3, 0.24))
# nothing at all where the others are widest
PARTED = picture("parted", (0.5, 0.2, 0.3, 0.12), (0.5, 0.77, 0.3, 0.15))


# leans to one side
LEANING = picture("leaning", (0.36, 0.25, 0.2, 0.19), (0.5, 0.5, 0.2, 0.2), (0.64, 0.74, 0.2, 0.2))


def field(seed: int = 0, size: float = 0.02) -> np.ndarray:
    return read_points(
        write_points(np.random.default_rng(seed).normal(0, size, (ROWS, COLUMNS, 2)))
    )


def test_no_bending_is_none_and_a_shift_is_a_shift() -> None:
    still = bend_mask(EGG.mask, np.zeros((ROWS, COLUMNS, 2)))
    assert (still == EGG.mask).all()
    aside = np.zeros((ROWS, COLUMNS, 2))
    aside[..., 0] = 10 / SIDE  # looks 10 px further to the right: the picture moves to the left
    moved = bend_mask(EGG.mask, aside)
    assert (moved[:, :-10] == EGG.mask[:, 10:]).all()
    found = measure_bending(moved, aside)
    assert found.rms == pytest.approx(10 / SIDE) == found.most
    assert found.stretch == pytest.approx(1.0)


def test_control_points_bound_the_field_and_its_slopes() -> None:
    points = field()
    away = displace(points, 90, 120) / 90
    assert np.linalg.norm(away, axis=2).max() <= np.linalg.norm(points, axis=2).max()
    # slopes of the field are means of the steps between control points
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max() * (ROWS - 3)
    assert np.linalg.norm(np.gradient(90 * away, axis=0), axis=2).max() <= steps + 1e-9


def test_maker_and_validators_bend_alike_to_the_pixel() -> None:
    mask = np.random.default_rng(1).random((97, 131)) > 0.4
    points = field(2)
    for mirrored in (False, True):
        bend = bend_of(View(bend_points=write_points(points), mirrored=mirrored))
        assert bend is not None
        theirs = bend_silhouette(mask, bend)
        ours = mask[:, ::-1] if mirrored else mask
        assert (theirs.mask != bend_mask(ours, points)).sum() == 0
        own = measure_bending(bend_mask(ours, points), points)
        assert (theirs.rms, theirs.most) == pytest.approx((own.rms, own.most), abs=1e-9)
        assert theirs.stretch == pytest.approx(own.stretch, rel=0.03)


def test_a_fold_is_seen_by_both() -> None:
    points = field(3, 0.2)
    assert stretch_of(points, 1.0)[1] < 0
    assert measure_bending(EGG.mask, points).stretch == np.inf
    bend = bend_of(View(bend_points=write_points(points)))
    assert bend is not None
    assert bend_silhouette(EGG.mask, bend).stretch == np.inf


def test_the_gradient_is_that_of_finite_differences() -> None:
    targets = [EGG, HOURGLASS, PARTED]
    scene = framed_alike(spread_views(Scene(), "abcdefghijklmn"[:3]), targets)
    views = [frame_view(v, t) for v, t in zip(scene.views, targets, strict=True)]
    tension = Tension(cameras_of(views, targets), [t.mask for t in targets], 90.0)
    random = np.random.default_rng(4)
    points = random.normal(0, 0.01, (3, ROWS, COLUMNS, 2))
    way = random.normal(0, 1, points.shape)
    for energy in (
        lambda p: tension.contradiction(p, 3.0),
        lambda p: tension.strain(4 * p, 0.1, 0.5),  # with slopes that are held back
    ):
        value, gradient = energy(points)
        assert value > 0
        scale = 4.0 if energy(points)[0] == tension.strain(4 * points, 0.1, 0.5)[0] else 1.0
        step = 1e-7
        ahead, behind = (energy(points + s * step * way)[0] for s in (1, -1))
        assert (ahead - behind) / (2 * step) == pytest.approx(
            scale * float((gradient * way).sum()), rel=2e-3
        )


def test_pictures_that_agree_stay_as_they_are() -> None:
    scene = spread_views(Scene(), "abcdefghijklmn"[:2])
    done = agree(scene, (EGG, EGG), azimuths_open=True)
    assert done.scene is scene
    assert done.targets == (EGG, EGG)
    assert done.lines == ()


@pytest.mark.slow
def test_bending_brings_every_bound_up_and_keeps_pieces() -> None:
    targets = (EGG, HOURGLASS, LEANING)
    done = agree(spread_views(Scene(), "abcdefghijklmn"[:3]), targets)
    assert min(b.iou for b in done.bounds) > AGREED - 0.01
    assert max(b.deepest for b in done.bounds) < 0.01  # no end of a picture is left without room
    assert any("bent by" in line for line in done.lines)
    for before, after in zip(targets, done.targets, strict=True):
        assert after.bending is not None
        assert after.bending.most <= 0.12
        assert after.bending.stretch < 5
        assert keeps_shape(before.mask, after.mask)
        assert (after.asked == before.mask).all()
        assert (after.judged == after.mask).all()
    # the written scene repeats it, and asks for nothing more
    again = agree(parse_scene(dump_scene(done.scene)), targets)
    for one, other in zip(done.targets, again.targets, strict=True):
        assert (one.mask == other.mask).all()
    assert again.scene.views == done.scene.views
    assert apply_bending(done.scene.views[0], done.targets[0]) is done.targets[0]


def test_what_bending_cannot_mend_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bend, "_ROUNDS", 3)  # no more of them would help
    done = agree(spread_views(Scene(), "abcdefghijklmn"[:2]), (EGG, PARTED))
    lacking = [
        line for line in done.lines if line.startswith("picture egg: the others leave no room")
    ]
    assert len(lacking) == 1
    assert "--bend 0.19" in lacking[0]


def test_without_bending_the_hopeless_is_refused() -> None:
    off = Scene().model_copy(update={"piece": Scene().piece.model_copy(update={"bend": 0.0})})
    low = picture("low", (0.3, 0.8, 0.1, 0.1), (0.7, 0.2, 0.1, 0.1))
    done = agree(spread_views(off, "abcdefghijklmn"[:2]), (EGG, low))
    assert all(t.bending is None for t in done.targets)
    with pytest.raises(SceneError, match=r"picture egg: the other pictures leave \d+% of it"):
        require_agreed(done, off)
    kept = off.model_copy(
        update={"accuracy": off.accuracy.model_copy(update={"accept": ("unrecognisable",)})}
    )
    require_agreed(done, kept)


def test_an_empty_hull_is_refused() -> None:
    above, below = picture("above", (0.5, 0.2, 0.3, 0.1)), picture("below", (0.5, 0.8, 0.3, 0.1))
    scene = spread_views(Scene(), "ab")
    framed = scene.model_copy(
        update={"views": tuple(v.model_copy(update={"frame_width_mm": 150.0}) for v in scene.views)}
    )
    off = framed.model_copy(update={"piece": scene.piece.model_copy(update={"bend": 0.0})})
    with pytest.raises(SceneError, match="picture above: the other pictures leave nothing of it"):
        agree(off, (above, below))


def test_one_picture_is_left_alone() -> None:
    scene = Scene()
    done = agree(scene, (EGG,))
    assert done.scene is scene
    assert done.targets[0] is EGG


def test_views_along_one_line_and_too_many_are_refused() -> None:
    scene = spread_views(Scene(), "abcdefghijklmn"[:2])
    first, second = scene.views
    for azimuth in (0.0, 180.0, 361.0):
        alike = scene.model_copy(
            update={"views": (first, second.model_copy(update={"azimuth_deg": azimuth}))}
        )
        with pytest.raises(InputError, match="look along one line"):
            agree(alike, (EGG, PARTED))
    with pytest.raises(InputError, match="14 pictures"):
        require_several(resolve(spread_views(Scene(), "abcdefghijklmn"[:14])))
    require_several(resolve(spread_views(Scene(), "abcdefghijklmn"[:MOST_VIEWS])))


def test_a_mirrored_picture_is_said_and_is_never_text() -> None:
    # a part to the left in the first two views is in the middle of the third
    left = picture("left", (0.3, 0.3, 0.1, 0.2), (0.5, 0.7, 0.1, 0.22))
    middle = picture("middle", (0.5, 0.3, 0.1, 0.2), (0.5, 0.7, 0.1, 0.22))
    right = replace(left, name="right", mask=left.mask[:, ::-1].copy())
    scene = spread_views(Scene(), "abcdefghijklmn"[:3])
    piece = scene.piece.model_copy(update={"mirror": "auto", "bend": 0.0})
    scene = scene.model_copy(update={"piece": piece})
    done = agree(scene, (left, right, middle))
    assert [t.bending is not None for t in done.targets] == [False, True, False]
    assert (done.targets[1].mask == left.mask).all()
    assert (done.targets[1].asked == right.mask).all()
    assert any(line == "mirrored, which changes the picture: right" for line in done.lines)
    text = agree(scene, [replace(t, letters=()) for t in (left, right, middle)])
    assert all(t.bending is None for t in text.targets)


def test_a_picture_shows_what_came_what_is_bent_and_what_is_left() -> None:
    shift = np.full((ROWS, COLUMNS, 2), 0.01)
    view = (
        spread_views(Scene(), "ab").views[0].model_copy(update={"bend_points": write_points(shift)})
    )
    bent = apply_bending(view, EGG)
    bound = HullBound(bent.mask & ~PARTED.mask, bent.mask, 0.5, np.zeros(3), np.zeros(3))
    widths = []
    for target in (EGG, bent):
        sheet = Image.open(BytesIO(draw_agreement(target, bound)))
        widths.append(sheet.width)
        red = np.asarray(sheet).astype(int)
        # the part that the others leave no room for
        assert ((red[..., 0] > 180) & (red[..., 1] < 60)).any()
    assert widths[1] > 1.3 * widths[0]  # a panel more


@pytest.mark.parametrize("text", ["2", "0.31", "-0.1", "nan", "inf", "much"])
def test_no_share_of_a_height_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--bend .* is no share of a picture's height up to 0.3"):
        read_scene(options_from({"bend": text}))


@pytest.mark.parametrize(
    ("text", "key"), [("auto", None), ("off", 0.0), ("0", 0.0), ("0.05", 0.05)]
)
def test_a_share_of_a_height_is_a_key(text: str, key: float | None) -> None:
    assert read_scene(options_from({"bend": text}))[0].piece.bend == key


@pytest.mark.slow
def test_views_leave_equal_angles_where_that_leaves_more() -> None:
    """Two narrow pictures at equal angles on both sides of a wide one leave nothing of its ends."""
    wide = picture("wide", (0.5, 0.5, 0.49, 0.3))
    narrow = [picture(name, (0.5, 0.5, 0.2, 0.42)) for name in "abc"]
    targets = [wide, *narrow]
    scene = spread_views(Scene(), [t.name for t in targets])
    off = scene.model_copy(update={"piece": scene.piece.model_copy(update={"bend": 0.0})})
    moved = agree(off, targets, azimuths_open=True)
    equal = agree(off, targets)
    assert min(b.iou for b in moved.bounds) > min(b.iou for b in equal.bounds) + 0.1
