"""Directions of several pictures, as words or angles, and what is refused of them."""

import numpy as np
import pytest
from PIL import Image

from knotfab.base.progress import Progress
from knotfab.design.agree import agree
from knotfab.design.frames import direct_views, spread_views
from knotfab.picture.read import read_target
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import prepare_build
from knotfab.scene.camera import view_axes
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene, Scene


def scene_of(count: int) -> ResolvedScene:
    return spread_views(resolve(Scene()), [f"{n}.png" for n in range(count)])


@pytest.mark.parametrize(
    ("word", "towards", "up"),
    [
        ("front", (0, 0, 1), (0, 1, 0)), ("side", (1, 0, 0), (0, 1, 0)), ("left", (-1, 0, 0), (0, 1, 0)),
        ("Top", (0, 1, 0), (0, 0, -1)), ("bottom", (0, -1, 0), (0, 0, 1)),
        ("90:45", (0.5**0.5, 0.5**0.5, 0), (-(0.5**0.5), 0.5**0.5, 0)),
    ],
)  # fmt: skip
def test_a_direction_says_where_the_light_stands(
    word: str, towards: tuple[float, ...], up: tuple[float, ...]
) -> None:
    other = "30:20"
    view = direct_views(scene_of(2), f"{other}, {word}").views[1]
    _, across, light = view_axes(view)
    np.testing.assert_allclose(light, towards, atol=1e-12)
    np.testing.assert_allclose(across, up, atol=1e-12)


@pytest.mark.parametrize(
    ("directions", "reason"),
    [
        ("front", "it has 1, and there are 2 pictures"),
        ("front,side,top", "it has 3, and there are 2 pictures"),
        ("front,above", "'above' is no direction"),
        ("front,30", "'30' is no direction"),
        ("front,30:95", "'30:95' is no direction"),
        ("front,nan:0", "'nan:0' is no direction"),
        ("front,back", "front and back look along one line"),
        ("front,181:1", "front and 181:1 look along one line"),
        ("top,77:-90", "top and 77:-90 look along one line"),
    ],
)
def test_a_wrong_direction_is_refused(directions: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        direct_views(scene_of(2), directions)


@pytest.mark.parametrize("more", [{}, {"sequence": True}, {"lamps": "rgb"}])
def test_directions_are_for_several_pictures_of_one_part(more: dict[str, object]) -> None:
    options = BuildOptions(directions="front", quiet=True, **more)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"--directions front"):
        prepare_build(["text:A"], options, "", Progress("quiet"))


@pytest.mark.study
def test_views_of_one_body_need_no_bending_from_where_they_were_taken(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Two slabs, one behind the other: their plan has rows that are empty in no view from the side."""
    z, y, x = np.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
    body = (abs(abs(z) - 0.65) < 0.25) & (abs(x) < 0.9) & (abs(y) < 0.8)
    # seen from the front, the side and above: rows go down, then to the viewer
    masks = [body.any(0)[::-1], body.any(2).T[::-1, ::-1], body.any(1)]
    targets = []
    for n, mask in enumerate(masks):
        Image.fromarray(np.where(np.pad(mask, 4), 0, 255).astype(np.uint8)).save(
            tmp_path / f"{n}.png"
        )
        targets.append(read_target(tmp_path / f"{n}.png"))
    far = {"light_distance_mm": 5000.0}
    scene = scene_of(3)
    scene = scene.but(views=tuple(v.but(**far) for v in scene.views))
    from_there = agree(direct_views(scene, "front,side,top"), targets)
    spread = agree(scene, targets)
    assert not from_there.lines and any("bent" in line for line in spread.lines)
