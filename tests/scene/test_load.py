"""Scene files: what they mean, what they refuse and how it is said, and writing without loss."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotfab.scene.catalogue import resolve
from knotfab.scene.load import check_scene, dump_scene, load_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy, Material, Piece, Pose, Printer, Region
from knotfab_formats.scene import Scene
from knotfab_formats.views import View


def test_an_empty_file_is_the_default_scene(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text("")
    assert load_scene(file) == Scene()
    assert len(load_scene(file).views) == 1


def test_keys_are_read_and_whole_numbers_are_lengths() -> None:
    scene = parse_scene("[[views]]\nlight_distance_mm = 800\n[piece]\nknots = 2\ndepth = 'flat'")
    assert scene.views[0].light_distance_mm == 800.0
    assert isinstance(scene.views[0].light_distance_mm, float)
    assert (scene.piece.knots, scene.piece.depth) == (2, 0.0)


# Each of these must be refused, and the message must hold these words.
REFUSED = {
    "[[views]]\nlight_distance_cm = 50": (
        "[[views]] number 1",
        "'light_distance_cm'",
        "knotfab takes millimetres: light_distance_mm = 500.0",
    ),
    "[[views]]\nlight_distance_m = 0.5": ("light_distance_mm = 500.0",),
    "[[views]]\nlight_distance_inch = 20": ("light_distance_mm = 508.0",),
    "[[views]]\nwall_tilt_rad = 0.5": ("knotfab takes degrees: wall_tilt_deg = 28.6478",),
    "[[views]]\nlight_distance_cm = 'far'": ("knotfab takes millimetres: light_distance_mm.",),
    "[[views]]\nlight_distance = 50": ("Did you mean 'light_distance_mm'?",),
    "[[views]]\nlamp_distance_mm = 50": ("Did you mean 'light_distance_mm'?",),
    "[piece]\nclearence_mm = 1": ("[piece]", "'clearence_mm'", "Did you mean 'clearance_mm'?"),
    "[[views]]\n[[views]]\nname = 'b'\nfoo = 1": ("[[views]] number 2", "'foo'", "Its keys are"),
    "[printers]": ("the top level", "Did you mean 'printer'?"),
    "[[view]]": ("Did you mean 'views'?",),
    "[views]\nname = 'a'": ("Write [[views]], with double brackets",),
    "views = []": ("no view",),
    "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'c'": ("no earlier view", "Known: a."),
    "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'a'\nwall_tilt_deg = 5": (
        "another wall_tilt_deg",
    ),
    "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'a'": ("one colour",),
    "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'a'\nkind = 'eye'": ("is an eye",),
    "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\n[[views]]\nname = 'c'\nwall = 'a'": (
        "a wall of its own",
    ),
    "[lamps]\nplaces = 'fixed'\nmode = 'switch'\n[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'a'": (
        "stand at one place",
    ),
    "views = 3": ("no view",),
    "tube_radius_mm = 3": ("It belongs in [piece]",),
    "[piece]\ntube_radius_mm = '50cm'": ('"50cm"', "Write tube_radius_mm = 500.0"),
    "[piece]\ntube_radius_mm = '5'": ("Write tube_radius_mm = 5.0",),
    "[piece]\ntube_radius_mm = 'thick'": ('a finite number or "auto"',),
    "[piece]\ntube_radius_mm = -2": ("tube_radius_mm is -2", "not less than 0.001"),
    "[piece]\ntube_radius_mm = 0": ("not less than 0.001",),
    "[piece]\ntube_radius_mm = inf": ("finite number",),
    "[piece]\ntube_radius_mm = nan": ("finite number",),
    "[piece]\ntube_radius_mm = true": ("tube_radius_mm is true",),
    "[piece]\nclearance_mm = -0.1": ("not less than 0",),
    "[piece]\nknots = 2.5": ("whole number",),
    "[piece]\nknots = 0": ("not less than 1",),
    "[piece]\ndepth = 'deep'": ('"auto"', '"flat"'),
    "[region]\nsize_mm = [1, 2]": ("size_mm is [1, 2]", "list"),
    "[region]\nsize_mm = [1, 2, -3]": ("not less than 0.001",),
    "[region]\nkind = 'ball'": ('"box", "cylinder", "sphere" or "mesh"',),
    "[effects]\npenumbras = 'on'": ("[effects]", "'penumbras'", "Did you mean 'penumbra'?"),
    "[effects]\npenumbra = true": ("penumbra is true", '"auto", "on" or "off"'),
    "[[views]]\nlight_diameter_mm = 1000": ("number 1", "lamp of 1000 mm reaches the piece"),
    "[piece]\ndepth = 200\n[[views]]\nwall_distance_mm = 150\nlight_diameter_mm = 800": (
        "reaches the piece, 400 mm from its middle",
        "smaller lamp",
    ),
    "[[views]]\nwall_tilt_deg = 70\nlight_diameter_mm = 450": (
        "205.212 mm before the tilted wall is partly behind it",
        "tilt the wall less",
    ),
    "[[views]]\nlight_leds = [21, 20]": ("light_leds is [21, 20]", "at most 400"),
    "[[views]]\nwall_distance_mm = -1": ("wall_distance_mm is -1", "not less than 0.001"),
    "[[views]]\nwall_tilt_deg = 90": ("less than 80",),
    "[placing]\nturn_deg = 11.0": ("not greater than 10",),
    "[[views]]\nname = '../x'": ("letters, digits",),
    "[[views]]\npicture = 3": ("text in quotes",),
    "[[views]]\ninvert = 'yes'": ("true or false",),
    "[accuracy]\nname = 'best'": ('"sketch", "draft", "standard" or "fine"',),
    "[accuracy]\naccept = ['all']": ("accept", '"unrecognisable"'),
    "[search]\nx = nan": ("[search] x",),
    "[search]\nx = [1]": ("[search] x",),
    "[pose]": ("[pose]", "matrix"),
    "[pose]\nmatrix = [[1.0]]": ("[pose] matrix",),
    "schema = 2": ("schema is 2", "reads schema = 1"),
    "schema = '1'": ("schema",),
    "piece = 3": ("a table",),
    "[piece]\n\ntube_radius_mm 3": ("not valid TOML", "line 3"),
    "[piece]\nknots = 1\nknots = 2": ("not valid TOML", "line 3"),
    # lengths that are possible alone, but not together
    "[[views]]\n[[views]]": ("two views are named 'front'",),
    "[piece]\ndepth = 250": ("125 mm towards the wall", "wall_distance_mm is 100"),
    "[piece]\ndepth = 250\n[[views]]\nlight_distance_mm = 125": ("towards the light",),
    "[piece]\ntube_radius_mm = 100": ("towards the wall",),
    "[mount]\nkind = 'stand'\nplate = 'full'": ('kind is "stand"', "--mount wall"),
    "[mount]\nkind = 'none'\nplate = 'outline'": ('kind is "none"',),
    "[mount]\nfoot = 'dowel'\nplate = 'full'": ("no drilled holes",),
    "[piece]\ndepth = 'flat'\n[mount]\nplate = 'full'": ("flat", "--plate pegs"),
    "[mount]\nplate = 'full'\n[[views]]\nwall_tilt_deg = 5": ("leans by 5°", "--plate pegs"),
    "[mount]\nplate = 'full'\n[search]\nfree_view = true": ("a free view",),
    "[mount]\nplate = 'cardboard'": ("[mount] plate", "cardboard"),
    "[piece]\ntube_radius_mm = 30\n[[views]]\nframe_height_mm = 50": ("wider than the frame",),
    "[piece]\ntube_radius_mm = 8\n[region]\nsize_mm = [100, 100, 16]": ("does not fit",),
    "[region]\nsize_mm = [10, 10, 1000]": ("the region reaches 500 mm towards the light",),
    "[region]\nsize_mm = [1000, 10, 10]\n[[views]]\nazimuth_deg = 90": ("towards the light",),
    "[region]\nkind = 'sphere'\nsize_mm = [20, 20, 20]\ncenter_mm = [0, 0, -120]": (
        "behind the wall",
    ),
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused_with_the_reason_and_the_remedy(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_scene(text, "my.toml")
    message = str(caught.value)
    assert message.startswith("my.toml: ")
    assert caught.value.exit_code == 2
    for words in REFUSED[text]:
        assert words in message
    assert "\n" not in message and "pydantic" not in message


def test_a_plate_settles_how_far_the_wall_is_and_asks_for_a_wall_mount() -> None:
    scene = parse_scene("[piece]\ndepth = 250\n[mount]\nplate = 'outline'")
    assert scene.mount.asked and scene.hangs(1) and scene.mount.thickness_mm == 1.6
    assert parse_scene("[mount]\nkind = 'wall'").mount.thickness_mm == 3.0
    assert resolve(scene).piece.supports == "none"
    kept = parse_scene("[piece]\nsupports = 'slicer'\n[mount]\nplate = 'outline'")
    assert resolve(kept).piece.supports == "slicer"


def test_the_same_lengths_are_fine_where_they_do_not_contradict() -> None:
    parse_scene("[piece]\ndepth = 250\n[[views]]\nkind = 'eye'")
    parse_scene("[region]\nsize_mm = [1000, 10, 10]")
    parse_scene("[region]\nsize_mm = [240, 240, 180]")
    parse_scene("[[views]]\n[[views]]\nname = 'side'\nazimuth_deg = 90")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_scene(tmp_path / "missing.toml")
    with pytest.raises(InputError, match="is a directory"):
        load_scene(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        load_scene(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_scene("nul\0l")
    os.mkfifo(tmp_path / "pipe.toml")
    for path in ("/dev/zero", tmp_path / "pipe.toml"):
        with pytest.raises(InputError, match="not a regular file"):
            load_scene(path)
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf[search]\nseed = 3\n")
    assert load_scene(tmp_path / "marked.toml").search["seed"] == 3
    for text in ("[search]\nseed = " + "9" * 5000, "a = " + "[" * 100_000):
        (tmp_path / "odd.toml").write_text(text)
        with pytest.raises(InputError, match=r"too long|too deep"):
            load_scene(tmp_path / "odd.toml")


# --- writing ---------------------------------------------------------------------------------

number = st.floats(-3600, 3600)
positive = st.floats(1e-3, 1e5)
text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
auto = st.just("auto")


def vector(element: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(element, element, element)


view = st.builds(
    View,
    name=st.from_regex(r"[A-Za-z0-9_-]{1,12}", fullmatch=True),
    kind=st.sampled_from(["shadow", "eye"]),
    picture=text,
    invert=st.booleans(),
    frame_width_mm=st.none() | positive,
    frame_height_mm=st.none() | positive,
    light_distance_mm=positive,
    light_diameter_mm=positive,
    wall_distance_mm=positive,
    wall_tilt_deg=st.floats(-79.9, 79.9),
    azimuth_deg=number,
    elevation_deg=st.floats(-90, 90),
    frame_up_mm=number,
)
row = st.tuples(number, number, number, number)
value = st.booleans() | st.integers(-(2**63), 2**63 - 1) | number | text
scenes = st.builds(
    Scene,
    piece=st.builds(
        Piece,
        tube_radius_mm=auto | positive,
        knots=auto | st.integers(1, 99),
        depth=auto | st.just("flat") | positive,
        clearance_mm=positive,
        knot=text,
    ),
    region=st.builds(
        Region,
        kind=st.sampled_from(["box", "cylinder", "sphere"]),
        center_mm=vector(number),
        size_mm=auto | vector(positive),
    ),
    material=st.builds(
        Material, name=text, density_g_cm3=st.floats(1e-3, 25), min_bend_radius_mm=auto
    ),
    printer=st.builds(Printer, name=text, build_volume_mm=vector(positive)),
    views=st.lists(view, min_size=1, max_size=3).map(tuple),
    accuracy=st.builds(
        Accuracy,
        name=st.sampled_from(["sketch", "draft", "standard", "fine"]),
        accept=st.sampled_from([(), ("unrecognisable",)]),
    ),
    search=st.dictionaries(text, value, max_size=4),
    pose=st.none() | st.builds(Pose, matrix=st.tuples(row, row, row, row)),
)


@pytest.mark.slow
@settings(max_examples=60)
@given(scene=scenes)
def test_what_is_written_reads_back_the_same(scene: Scene) -> None:
    import tomllib

    again = Scene.model_validate(tomllib.loads(dump_scene(scene)))
    assert again == scene
    assert dump_scene(again) == dump_scene(scene)
    for own, other in ((scene.printer, again.printer), (scene.material, again.material)):
        assert own.model_fields_set == other.model_fields_set
    for key, entry in scene.search.items():
        assert type(again.search[key]) is type(entry)


def test_check_scene_takes_a_scene_made_by_hand() -> None:
    check_scene(Scene())
    with pytest.raises(InputError, match="two views"):
        check_scene(Scene(views=(View(), View())))


def test_scenes_cannot_be_changed() -> None:
    scene: Any = Scene()
    with pytest.raises(ValueError, match="frozen"):
        scene.pose = None


def test_a_view_that_shines_on_anothers_wall_has_that_wall() -> None:
    lamps = "wall_distance_mm = 60\nframe_width_mm = 90\nlamp_colour = [1, 0, 0]"
    aside = "wall = 'a'\nlight_right_mm = 80\nlamp_colour = [0, 1, 0]"
    scene = parse_scene(f"[[views]]\nname = 'a'\n{lamps}\n[[views]]\nname = 'b'\n{aside}")
    first, second = scene.views
    assert (second.wall_distance_mm, second.frame_width_mm) == (60, 90)
    assert (first.light_right_mm, second.light_right_mm) == (0, 80)
    assert scene.screen_ends and parse_scene(dump_scene(scene)) == scene
