"""What a scene and its pictures ask of a search, and frames of several pictures."""

import re
from contextlib import nullcontext

import numpy as np
import pytest
from questions import ask_heart, ask_views
from shapely import MultiPolygon, box

from knotfab.base.arrays import Mask
from knotfab.base.errors import SceneError
from knotfab.design.frames import frame_view, framed_alike, size_frames, spread_views, widen_targets
from knotfab.design.question import _require_lamps
from knotfab.design.room import plate_depth_mm
from knotfab.picture.read import Target
from knotfab.picture.silhouette import drop_specks
from knotfab.scene.catalogue import asked_for, resolve
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material, Mount, Printer
from knotfab_formats.scene import Scene


@pytest.mark.slow
@pytest.mark.parametrize(
    ("printer", "material", "overhang_deg"),
    [
        ("prusa-mk4", "pla", 45.0),
        ("hp-mjf", "pa12", None),  # powder carries the piece
    ],
)
def test_supports_are_weighed_only_where_some_are_printed(
    printer: str, material: str, overhang_deg: float | None
) -> None:
    scene = Scene().model_copy(
        update={"printer": asked_for(Printer, printer), "material": asked_for(Material, material)}
    )
    assert scene.printer.max_overhang_deg == 45.0
    assert ask_heart(scene).overhang_deg == overhang_deg


# Frames of several pictures: equally high silhouettes, at the size that is asked for.


def target(width: int, height: int, top: int, bottom: int) -> Target:
    """A bar in a picture."""
    mask = np.zeros((height, width), dtype=bool)
    mask[top:bottom, width // 4 : width // 2] = True
    return Target("bar", mask)


TARGETS = [target(100, 200, 20, 180), target(300, 100, 10, 60)]


@pytest.mark.parametrize("key", ["frame_width_mm", "frame_height_mm"])
def test_one_size_for_all_is_that_of_the_first(key: str) -> None:
    scene = spread_views(Scene(), "ab")
    sized = scene.model_copy(
        update={"views": tuple(v.model_copy(update={key: 240.0}) for v in scene.views)}
    )
    alike = framed_alike(scene, TARGETS).views
    views = size_frames(sized, TARGETS).views
    assert getattr(frame_view(views[0], TARGETS[0]), key) == pytest.approx(240.0)
    scale = getattr(frame_view(views[0], TARGETS[0]), key) / getattr(alike[0], key)
    for view, before, picture in zip(views, alike, TARGETS, strict=True):
        assert view.frame_up_mm == pytest.approx(scale * before.frame_up_mm)
        assert view.frame_width_mm == pytest.approx(scale * (before.frame_width_mm or 0))
        assert view.frame_width_mm / picture.width == pytest.approx(
            (view.frame_height_mm or 0) / picture.height
        )
    tall = [
        (v.frame_height_mm or 0) * t.mask.any(1).sum() / t.height
        for v, t in zip(views, TARGETS, strict=True)
    ]
    assert tall[0] == pytest.approx(tall[1])


def test_sizes_of_their_own_stay() -> None:
    scene = spread_views(Scene(), "ab")
    own = tuple(
        v.model_copy(update={"frame_width_mm": mm})
        for v, mm in zip(scene.views, (100.0, 150.0), strict=True)
    )
    scene = scene.model_copy(update={"views": own})
    assert size_frames(scene, TARGETS) is scene


def test_strokes_wider_than_a_quarter_of_the_picture_are_refused() -> None:
    mask = np.zeros((80, 160), dtype=bool)
    mask[38:42, 10:150] = True
    target = Target("line", mask)

    def scene(width: float) -> Scene:
        return Scene(views=({"frame_width_mm": 160.0, "thicken_mm": width},))  # type: ignore[arg-type]

    (widened,) = widen_targets(resolve(scene(18.0)), [target])[1]
    assert mask.sum() < widened.mask.sum() < 0.3 * mask.size
    with pytest.raises(InputError, match=r"30 mm wide .*from --size 240, or leave out --thicken"):
        widen_targets(resolve(scene(30.0)), [target])


@pytest.mark.parametrize("tall", [40, 160])
def test_the_size_that_is_advised_is_enough_and_no_other_remedy_is_named(tall: int) -> None:
    """Nobody gave --thicken: a picture too small for one tube along its lines is told its size alone."""
    mask = np.zeros((tall, 160), dtype=bool)
    mask[tall // 2 - 2 : tall // 2 + 2, 10:150] = True
    target = Target("line", mask)

    def draw(size: float) -> tuple[Target, ...]:
        views = ({"frame_width_mm": size, "lines": True},)
        return widen_targets(resolve(Scene(views=views)), [target])[1]  # type: ignore[arg-type]

    with pytest.raises(InputError, match=r"as a tube draws them.*from --size \d+\.?$") as caught:
        draw(4.0)
    (size,) = re.findall(r"from --size (\d+)", str(caught.value))
    assert draw(float(size))[0].mask.any()
    with pytest.raises(InputError):
        draw(float(size) - 1.0)


def speckled(count: int, side: int, every: int) -> Mask:
    """A bar with square specks about it and holes in it, so far apart."""
    mask = np.zeros((600, 600), dtype=bool)
    mask[200:400, 50:550] = True
    for n in range(count):
        x, y = 60 + every * n % 480, (100, 300, 500)[n % 3] + 3 * (every * n // 480)
        mask[y : y + side, x : x + side] ^= True
    return mask


@pytest.mark.parametrize(
    ("mask", "keys", "left"),
    [
        (speckled(40, 3, 37), {}, 0),
        (speckled(7, 4, 61), {}, 0),
        (speckled(40, 3, 37), {"speck_px": 1}, 40),
        (speckled(40, 3, 37), {"keep_largest": 41}, 40),
        (speckled(3, 3, 61), {}, 3),  # two eyes and a dot are meant
        (speckled(40, 9, 37), {}, 40),  # as large as a tube
        (speckled(120, 5, 12), {}, 120),  # close together, as letters are
    ],
    ids=["scan", "few", "kept", "largest", "three", "large", "written"],
)
def test_dust_is_left_out_and_told(mask: Mask, keys: dict[str, int], left: int) -> None:
    scene = resolve(Scene())
    scene = scene.model_copy(update={"views": (scene.views[0].model_copy(update=keys),)})
    picture = Target("scan", mask)
    (cleaned,) = widen_targets(scene, (picture,))[1]
    specks = int((cleaned.mask ^ speckled(0, 1, 1)).sum() > 0)
    assert specks == (left > 0) and bool(cleaned.notes) == (not left)
    if not left:
        least, _ = map(int, re.findall(r"--specks (\d+)", cleaned.notes[0]))
        assert (drop_specks(mask, least) == cleaned.mask).all()


@pytest.mark.parametrize(("turned", "beyond"), [(90.0, True), (30.0, False), (180.0, False)])
def test_what_reaches_far_beyond_anothers_lamp_is_refused(turned: float, beyond: bool) -> None:
    """A picture's half width counts by its share towards the other's lamp; none at 180 degrees."""
    near = ask_views([MultiPolygon([box(-50, -50, 50, 50)])] * 2, 0.0, turned).views
    light = near[0].view.light_distance_mm
    wide = 2.1 * light
    views = ask_views([MultiPolygon([box(-wide, -50, wide, 50)])] * 2, 0.0, turned).views
    _require_lamps(near)
    with pytest.raises(InputError, match="--lamp-distance") if beyond else nullcontext():
        _require_lamps(views)


def test_a_plate_too_thin_for_feet_is_refused_with_a_thickness_that_holds_them() -> None:
    view = frame_view(resolve(Scene()).views[0], TARGETS[0])
    thin = Mount(plate="rounded", plate_thickness_mm=0.4)
    with pytest.raises(SceneError, match=r"below its feet") as refused:
        plate_depth_mm(thin, view, 2.0)
    least = float(re.findall(r"at least ([\d.]+)", refused.value.remedy)[0])
    assert plate_depth_mm(thin.but(plate_thickness_mm=least), view, 2.0) > 8 * 2.0
