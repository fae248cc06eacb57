"""Colours that several lamps mix: their light, the shares of right ones, and what it costs to move a lamp."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coloraide import Color
from numpy.typing import NDArray
from PIL import Image
from validator_parts import PlainView, circle, tube

from knotfab_formats.verdict import Colours
from knotfab_formats.views import Room, View
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.shadows.colours import LampShadow, check_colours, measure_colours
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.lamp import Light, colour_error, light_of, share_of_light, to_srgb
from knotfab_validators.shadows.verify_view import verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.validate import validate
from tests.corpus.case import make_part, with_lamps
from tests.corpus.curves import circle as ring
from tests.corpus.files import Part, write

RGB = np.eye(3)
WARM_AND_COLD = np.array([[1.0, 0.8, 0.5], [0.6, 0.8, 1.0]])


def even(colours: NDArray[Any], ambient: float = 0.0, size: tuple[int, int] = (4, 5)) -> Light:
    return Light(colours, np.ones((len(colours), *size)), ambient * colours.sum(axis=0))


@pytest.mark.parametrize("colours", [RGB, WARM_AND_COLD, RGB[:2]])
@pytest.mark.parametrize("ambient", [0.0, 0.2])
def test_light_is_mixed_as_the_format_says(colours: NDArray[Any], ambient: float) -> None:
    rng = np.random.default_rng(0)
    lit = rng.uniform(size=(len(colours), 4, 5))
    seen = even(colours, ambient).mix(lit)
    total = colours.sum(axis=0)
    for c in range(3):
        if total[c] == 0:
            assert (seen[..., c] == 0).all()
            continue
        own = sum(lit[i] * colours[i, c] for i in range(len(colours)))
        assert seen[..., c] == pytest.approx(
            (own + ambient * total[c]) / ((1 + ambient) * total[c])
        )


def test_where_matter_hides_lamps_the_other_colours_are_left() -> None:
    table = to_srgb(even(RGB).flat(np.arange(8)))
    names = ["white", "cyan", "magenta", "blue", "yellow", "lime", "red", "black"]
    for colour, name in zip(table, names, strict=True):
        assert tuple(colour) == tuple(round(255 * x) for x in Color(name).coords())


def test_srgb_and_differences_are_those_of_another_library() -> None:
    rng = np.random.default_rng(1)
    light = rng.uniform(size=(40, 3))
    mine = to_srgb(light)
    theirs = [Color("srgb-linear", list(row)).convert("srgb").coords() for row in light]
    assert np.abs(mine - 255 * np.array(theirs)).max() <= 0.5 + 1e-9
    other = rng.permutation(mine)
    error = colour_error(mine, other)
    for one, two, found in zip(mine, other, error, strict=True):
        apart = Color("srgb", list(one / 255)).delta_e(
            Color("srgb", list(two / 255)), method="2000"
        )
        assert found == pytest.approx(apart, abs=0.02)


@pytest.mark.parametrize("shape", ["disc", "ball"])
def test_light_falls_off_with_the_square_and_the_cosines(shape: str) -> None:
    lamp = view_of(light_shape=shape)
    geometry = view_geometry(PlainView(light_right_mm=70.0, light_up_mm=-30.0), 9, 9)
    found = share_of_light(lamp, geometry).reshape(9, 9)
    for v, u in ((0, 0), (4, 4), (8, 2)):
        x, y = 20.0 * (u - 4), -20.0 * (v - 4)
        ray = np.array([70.0 - x, -30.0 - y, 600.0])
        cosine = 600.0 / np.linalg.norm(ray)
        expected = cosine ** (1 if shape == "ball" else 2) / (ray @ ray)
        assert found[v, u] == pytest.approx(expected)


def test_a_room_throws_back_some_of_each_lamps_colour() -> None:
    geometry = view_geometry(PlainView(), 9, 9)
    lamps: Any = [(view_of(), colour, geometry) for colour in RGB[:2]]
    light = light_of(lamps, Room(area_m2=60.0, reflectance=0.5), (9, 9))
    assert light.other == pytest.approx([np.pi * 600.0**2 / 60e6] * 2 + [0.0])
    assert light.falloff[:, 4, 4] == pytest.approx(1.0)


def view_of(**keys: Any) -> View:
    return parse_scene({"views": [keys]}).views[0]


def test_a_lamp_beside_the_axis_moves_no_wall_or_frame() -> None:
    plain = PlainView(azimuth_deg=25.0, elevation_deg=10.0, wall_tilt_deg=5.0)
    on, off = (
        view_geometry(view, 90, 60)
        for view in (plain, replace(plain, light_right_mm=80.0, light_up_mm=-45.0))
    )
    assert (off.origin == on.origin).all() and (off.du == on.du).all() and (off.dv == on.dv).all()
    moved = off.light - on.light
    assert [moved @ on.right, moved @ on.up, moved @ on.axis] == pytest.approx([80.0, -45.0, 0.0])
    # the shadow of a point on the axis moves the other way, by the ratio of its distances
    one, other = (g.project(np.zeros((1, 3)))[0] for g in (on, off))
    assert np.linalg.norm((other - one) * 2.0) > 0
    assert np.sign((other - one)[0]) == pytest.approx([-1, -1])


@pytest.mark.parametrize(
    ("views", "said"),
    [
        ([{"name": "red"}, {"name": "blue", "wall": "green"}], "green"),
        ([{"name": "red"}, {"name": "blue", "wall": "red", "azimuth_deg": 9.0}], "azimuth_deg"),
        ([{"name": "a"}, {"name": "b", "wall": "a"}, {"name": "c"}], "has a wall of its own"),
        ([{"name": "a", "lamp_colour": [0, 0, 0]}], "lamp_colour"),
        ([{"name": "a", "lamp_colour": [2, 0, 0]}], "lamp_colour"),
    ],
)
def test_scenes_that_contradict_themselves_are_refused(views: list[Any], said: str) -> None:
    if said == "azimuth_deg":
        views[0]["azimuth_deg"] = 4.0
    with pytest.raises(BadFile, match=said):
        parse_scene({"views": views})


def judge(part: Part, folder: Path, pictures: bool = False) -> Any:
    folder.mkdir(exist_ok=True)
    files = write(part, folder)
    return validate(
        files.part,
        files.knots,
        files.scene,
        skip=["shadow-render"],
        only="shadows",
        pictures_dir=folder if pictures else None,
    )


@pytest.fixture(scope="module")
def rings() -> Part:
    return with_lamps(make_part([ring(34.0), ring(20.0)]))


@pytest.mark.slow
def test_two_rings_under_three_lamps(rings: Part, tmp_path: Path) -> None:
    verdict = judge(rings, tmp_path, pictures=True)
    assert verdict.status == "pass"
    json.dumps(verdict.to_dict(), allow_nan=False)
    told = verdict.to_dict()["colours"]
    assert told["share"] > 0.97 and told["share_inside"] > 0.999 > told["share_along"]
    whole = told["along"] * told["share_along"] + (1 - told["along"]) * told["share_inside"]
    assert told["share"] == pytest.approx(whole)
    assert told["picture"]["masks_share"] == 1.0 and told["picture"]["masks_delta_e"] < 0.01
    moved = told["misregistration"]
    assert 0.93 < moved["share"] < moved["unmoved"]
    # the limit is two strands' halves on the wall over the shift for each mm of the lamp's
    assert moved["lamp_mm"] == pytest.approx(3.0 * (560 / 500) / (60 / 500), rel=0.05)
    shown = np.asarray(Image.open(tmp_path / "colours.png"))
    dark = (shown < 40).all(axis=2)
    assert 0.001 < dark.mean() < 0.1  # where all three shadows meet
    for view, lamp in zip(verdict.views, told["lamps"], strict=True):
        assert view.lamp_colour == tuple(lamp["colour"])
        assert lamp["spill_beside"] == 0 and lamp["spill"] < 0.01


def measured(ambient: float = 0.0, flip: int = 0, screen: str = "ends") -> Colours:
    """Two lamps over a ring on 64 pixels, whose shadows are their masks but for so many pixels."""
    frame = working_frame(64, 64, 64)
    geometry = view_geometry(PlainView(frame_width_mm=64.0, frame_height_mm=64.0), 64, 64)
    vertices, faces = tube(circle(60, 12.0), 2.0, 12)
    caster = ShadowCaster(vertices, faces)
    mask = caster.render(geometry.resample(frame))
    hidden = mask.copy()
    rows, columns = np.nonzero(frame.mask & ~mask)
    hidden[rows[:flip], columns[:flip]] = True
    if screen == "open":
        hidden[:3, :5] = True
    views = [
        {"name": "one", "lamp_colour": [1, 0, 0]},
        {"name": "two", "wall": "one", "lamp_colour": [0, 1, 1]},
    ]
    scene = parse_scene({"views": views, "room": {"ambient": ambient}, "lamps": {"screen": screen}})
    lamps = [
        LampShadow(view, geometry, dark.astype(float), mask, 2.4)
        for view, dark in zip(scene.views, (hidden, mask), strict=True)
    ]
    return measure_colours(lamps, scene, Path(), frame, caster, circle(60, 12.0)).found


def test_each_wrong_pixel_is_counted_once() -> None:
    told = measured(flip=37)
    assert told.share == pytest.approx(1 - 37 / 64**2, abs=1e-12)
    assert [lamp.spill for lamp in told.lamps] == [37 / 64**2, 0.0]
    assert measured().share == measured().share_drawn == 1.0


def test_ambient_light_costs_colour_and_no_share() -> None:
    one, other = measured(), measured(ambient=0.3)
    assert other.delta_e > one.delta_e + 1 and other.share == one.share == 1.0
    assert other.misregistration == one.misregistration


def test_what_falls_beside_an_open_screen_is_told_apart() -> None:
    told = measured(screen="open")
    assert told.share == 1.0
    assert [lamp.spill_beside for lamp in told.lamps] == [15 / 64**2, 0.0]


def test_matter_whose_shadow_misses_the_screen_is_nothing() -> None:
    """A ring that reaches beyond the frame: on an open wall it spills, past a card it does not."""
    geometry = view_geometry(PlainView(frame_width_mm=40.0, frame_height_mm=40.0), 64, 64)
    vertices, faces = tube(circle(60, 16.0) + np.array([8.0, 0.0, 0.0]), 2.0, 12)
    target = ShadowCaster(vertices, faces).render(geometry)
    card, wall = (
        verify_view(vertices, faces, target, geometry, longer=64, ends=ends)
        for ends in (True, False)
    )
    assert card.whole.iou == 1.0 > 0.9 > wall.whole.iou
    assert not (card.shadow & ~card.frame.mask).any()


@pytest.mark.slow
@pytest.mark.study
def test_lamps_that_switch_mix_nothing(rings: Part, tmp_path: Path) -> None:
    assert rings.scene is not None
    scene = {**rings.scene, "lamps": {"mode": "switch"}}
    verdict = judge(replace(rings, scene=scene), tmp_path)
    assert verdict.status == "pass" and verdict.colours is None
    assert not {"colours", "lamp_colours"} & {check.name for check in verdict.checks}


def test_shares_may_miss_what_all_lamps_together_may() -> None:
    one = measured()
    told = replace(one, lamps=(one.lamps[0],) * 3, share=0.9, share_drawn=0.88)
    colours, skipped = check_colours(told, 0.96)
    assert colours.status == "pass" and colours.limit == pytest.approx(0.88)
    assert skipped.status == "skipped" and not skipped.required
    assert check_colours(replace(told, share_drawn=0.87), 0.96)[0].status == "fail"
    assert check_colours(replace(told, share_drawn=0.0), None)[0].required is False
