"""Printers and materials by name, and a scene with their figures filled in."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import knotfab
from hypothesis import given, settings
from hypothesis import strategies as st
from platformdirs.macos import MacOS
from platformdirs.windows import Windows

from knotfab.design.frames import frame_view
from knotfab.picture.read import Target
from knotfab.scene.catalogue import (
    asked_for,
    data_folder,
    find_name,
    known_names,
    load_file,
    materials,
    printers,
    resolve,
    title_of,
)
from knotfab.scene.load import check_scene, dump_scene, load_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy, Material, Piece, Pose, Printer, Region
from knotfab_formats.scene import Scene
from knotfab_formats.views import View


def test_known_names() -> None:
    assert set(printers()) >= {
        "prusa-mk4", "bambu-x1", "bambu-a1", "ender-3", "voron-2.4-350", "form-3", "hp-mjf", "sls",
    }  # fmt: skip
    assert set(materials()) >= {"pla", "petg", "tpu", "resin"}


@pytest.mark.parametrize(
    ("text", "name"),
    [("P1S", "bambu-p1s"), ("Bambu Lab P1S", "bambu-p1s"), ("x1c", "bambu-x1"),
     ("bambu x1 carbon", "bambu-x1"),
     ("A1 mini", "bambu-a1-mini"), ("MK3S+", "prusa-mk3s"), ("mk4s", "prusa-mk4s"), ("Prusa XL", "prusa-xl"),
     ("MINI+", "MINI+"), ("Core One", "prusa-core-one"), ("Ender 3", "ender-3"), ("ENDER-3 v2", "ender-3-v2"),
     ("k1", "creality-k1"), ("Generic 220", "generic-220"), ("carbon", "bambu-x1"), ("nonsense", "nonsense"),
     ("", ""), ("+", "+")],
)  # fmt: skip
def test_a_printer_is_known_by_what_people_call_it(text: str, name: str) -> None:
    assert find_name("printer", text) == name
    if name in printers():
        assert (
            resolve(Scene(printer=Printer(name=text))).printer
            == resolve(Scene(printer=Printer(name=name))).printer
        )
        assert title_of("printer", name) != name


def test_materials_are_known_in_capitals_and_by_their_titles() -> None:
    for text, name in (("PLA", "pla"), ("Pla filament", "pla"), ("PETG", "petg"), ("ASA", "asa")):
        assert resolve(Scene(material=Material(name=text))).material.name == name
    with pytest.raises(InputError, match="Did you mean 'pa12'"):
        resolve(Scene(material=Material(name="pa12 x")))
    with pytest.raises(InputError, match="knotfab 2 does not have it"):
        resolve(Scene(material=Material(name="steel-wire-2mm")))


def test_figures_are_plausible() -> None:
    for printer in printers().values():
        assert min(printer.build_volume_mm) >= 100 and max(printer.build_volume_mm) <= 600
        assert 2 * printer.min_tube_radius_mm >= 2 * printer.nozzle_mm
    for material in materials().values():
        assert 0.9 < material.density_g_cm3 < 1.5
        assert 20 <= material.young_modulus_mpa <= 250000 and material.yield_mpa >= 5


def test_the_defaults_are_those_of_the_files() -> None:
    assert printers()[Printer().name] == Printer()
    assert materials()[Material().name] == Material()


def test_a_name_alone_brings_its_figures() -> None:
    scene = resolve(parse_scene("[printer]\nname = 'ender-3'\n[material]\nname = 'petg'"))
    assert scene.printer.build_volume_mm == (220.0, 220.0, 250.0)
    assert scene.material.density_g_cm3 == 1.27


def test_keys_of_the_scene_win() -> None:
    scene = resolve(parse_scene("[printer]\nname = 'bambu-x1'\nnozzle_mm = 0.6"))
    assert (scene.printer.nozzle_mm, scene.printer.build_volume_mm[2]) == (0.6, 256.0)
    assert scene.piece.clearance_mm == scene.printer.min_gap_mm == 0.6  # else the check gap fails
    text = "[printer]\nname = 'bambu-x1'\nnozzle_mm = 0.6\n[piece]\nclearance_mm = 0.5"
    assert resolve(parse_scene(text)).piece.clearance_mm == 0.5
    # even where the written value is the model's own default
    scene = resolve(parse_scene("[printer]\nname = 'form-3'\nnozzle_mm = 0.4"))
    assert scene.printer.nozzle_mm == 0.4


def test_a_printer_brings_its_material_and_what_powder_needs() -> None:
    for name in ("hp-mjf", "sls"):
        scene = resolve(parse_scene(f"[printer]\nname = {name!r}"))
        assert scene.material.process == scene.printer.process == "powder"
        # powder must come out between strands; a scene that says otherwise is taken at its word
        assert scene.piece.clearance_mm >= scene.printer.min_gap_mm >= 0.5
        own = resolve(parse_scene(f"[piece]\nclearance_mm = 0.3\n[printer]\nname = {name!r}"))
        assert own.piece.clearance_mm == 0.3
    assert resolve(parse_scene("[printer]\nname = 'form-3'")).material.name == "resin"
    usual = resolve(Scene())
    assert (usual.material.name, usual.piece.clearance_mm) == ("pla", 0.4)
    assert usual.printer.min_wall_mm == usual.printer.min_gap_mm == usual.printer.nozzle_mm


@pytest.mark.parametrize(
    ("printer", "material"),
    [("hp-mjf", "pla"), ("prusa-mk4", "pa12"), ("form-3", "pla"), ("sls", "resin")]
    + [("prusa-mk4", "resin")],
)
def test_a_printer_takes_the_materials_of_its_process_alone(printer: str, material: str) -> None:
    with pytest.raises(InputError, match=f"{material}.*{printer}.*Name another"):
        resolve(parse_scene(f"[printer]\nname = {printer!r}\n[material]\nname = {material!r}"))
    own = f"[printer]\nname = {printer!r}\n[material]\ndensity_g_cm3 = 1.5"
    assert resolve(parse_scene(own)).material.process == printers()[printer].process


def test_unknown_names_are_refused_and_the_known_ones_listed() -> None:
    with pytest.raises(InputError, match=r"'bambu'.*Did you mean .*or 'bambu-x1'\?.*ender-3"):
        resolve(parse_scene("[printer]\nname = 'bambu'"))
    with pytest.raises(InputError, match=r"'steel'.*abs.*petg.*tpu"):
        resolve(parse_scene("[material]\nname = 'steel'"))


def test_a_printer_of_ones_own_needs_every_key() -> None:
    text = "[printer]\nname = 'mine'\nbuild_volume_mm = [100, 100, 100]\nnozzle_mm = 0.4\n"
    with pytest.raises(InputError, match="give every key"):
        resolve(parse_scene(text))
    own = resolve(parse_scene(text + "min_tube_radius_mm = 1.5")).printer
    assert (own.name, own.min_tube_radius_mm) == ("mine", 1.5)


def test_a_resolved_scene_is_written_whole_and_stays_resolved() -> None:
    scene = resolve(parse_scene("[printer]\nname = 'ender-3'"))
    again = resolve(parse_scene(dump_scene(scene)))
    assert again == scene == resolve(again)
    assert "build_volume_mm" in dump_scene(scene) and "density_g_cm3" in dump_scene(scene)


@pytest.mark.parametrize(
    ("keys", "shape", "frame"),
    [
        ("", (400, 300), (135.0, 180.0)),
        ("", (60, 600), (180.0, 18.0)),
        ("frame_width_mm = 60", (400, 300), (60.0, 80.0)),
        ("frame_height_mm = 60", (400, 300), (45.0, 60.0)),
        ("frame_width_mm = 50\nframe_height_mm = 60", (400, 300), (50.0, 60.0)),
    ],
)
def test_frames_follow_the_picture(
    keys: str, shape: tuple[int, int], frame: tuple[float, float]
) -> None:
    target = Target("cat", np.ones(shape, dtype=bool))
    view = frame_view(parse_scene(f"[[views]]\n{keys}").views[0], target)
    assert view.frame_mm == pytest.approx(frame)
    assert view.longer_mm == pytest.approx(max(frame))


def test_resolve_without_pictures_leaves_frames_open() -> None:
    assert resolve(Scene()).views[0].frame_width_mm is None


# One's own printers and materials: found by name or file, checked key by key, not needed
# afterwards.


PRINTER = "build_volume_mm = [300, 300, 400]\nnozzle_mm = 0.6\nmin_tube_radius_mm = 1.2\n"
MATERIAL = 'density_g_cm3 = 1.04\nmin_bend_radius_mm = "auto"\nmax_length_mm = 20000\n'


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A person's own data with one printer and one material."""
    for kind, name, text in (("printers", "big", PRINTER), ("materials", "own-asa", MATERIAL)):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / f"{name}.toml").write_text(text)
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path))
    return tmp_path


def test_ones_own_are_known_by_name_beside_the_others(own: Path) -> None:
    assert {"big", "prusa-mk4"} <= set(printers()) and {"own-asa", "pla"} <= set(materials())
    scene = resolve(parse_scene('[printer]\nname = "big"\n[material]\nname = "own-asa"'))
    assert scene.printer.build_volume_mm == (300.0, 300.0, 400.0)
    assert scene.printer.layer_height_mm == Printer().layer_height_mm  # a usual key, left out
    assert (scene.material.density_g_cm3, scene.material.max_length_mm) == (1.04, 20000.0)


def test_ones_own_wins_over_one_of_the_same_name(own: Path) -> None:
    (own / "printers" / "ender-3.toml").write_text(PRINTER)
    assert resolve(parse_scene('[printer]\nname = "ender-3"')).printer.nozzle_mm == 0.6
    text = '[printer]\nname = "ender-3"\nnozzle_mm = 0.8'
    assert resolve(parse_scene(text)).printer.nozzle_mm == 0.8  # and the scene over both


def test_a_written_scene_needs_no_file_any_more(own: Path) -> None:
    scene = resolve(
        Scene(printer=asked_for(Printer, "big"), material=asked_for(Material, "own-asa"))
    )
    text = dump_scene(scene)
    (own / "printers" / "big.toml").write_text("broken = [")
    (own / "materials" / "own-asa.toml").unlink()
    assert resolve(parse_scene(text)) == scene


def test_a_file_may_lie_anywhere(own: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'title = "Mine"\n{PRINTER}layer_height_mm = 0.3\n')
    printer = asked_for(Printer, str(path))
    assert (printer.name, printer.layer_height_mm) == ("mine", 0.3)
    assert resolve(Scene(printer=printer)).printer.nozzle_mm == 0.6
    path.write_text(f"[material]\n{MATERIAL}")  # under the header of a scene
    assert asked_for(Material, str(path)).density_g_cm3 == 1.04
    # named like a known one, it takes nothing from that
    named = tmp_path / "form-3.toml"
    named.write_text(PRINTER)
    assert resolve(Scene(printer=asked_for(Printer, str(named)))).printer.layer_height_mm == 0.2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nozzle_mm = 0.4\n", r"it lacks build_volume_mm, min_tube_radius_mm\. Add .*\[250"),
        (PRINTER.replace("nozzle_mm", "nozle_mm"), r"no key 'nozle_mm'\. Did you mean 'nozzle_mm'"),
        (PRINTER.replace("0.6", '"0.6 mm"'), r"nozzle_mm is \"0\.6 mm\".*Write nozzle_mm = 0\.6"),
        (PRINTER.replace("0.6", "-0.6"), r"nozzle_mm is -0\.6, but must be a number not less than 0"),
        (PRINTER.replace("300, 300, 400", "300, 300"), r"build_volume_mm"),
        (PRINTER + 'name = "x"\n', r"named after its file\. Leave name out"),
        (PRINTER + "density_g_cm3 = 1.2\n", r"no key 'density_g_cm3'\. It belongs in \[material\]"),
        ("nozzle_mm = ", r"not valid TOML.*line 1"),
    ],
)  # fmt: skip
def test_errors_name_file_key_and_remedy(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        load_file(Printer, path)
    assert caught.value.what == str(path) and caught.value.exit_code == 2
    assert "[printer]" not in caught.value.why


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file.*prusa-mk4"):
        asked_for(Printer, "nowhere/mine.toml")
    with pytest.raises(InputError, match="is a directory"):
        load_file(Printer, tmp_path)
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load_file(Material, tmp_path / "mine.toml")


def test_where_ones_own_are_looked_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("KNOTFAB_DATA", raising=False)
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    assert data_folder() == Path("/home/someone/.config/knotfab")
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    assert data_folder() == Path("/home/someone/.config/knotfab")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert data_folder() == tmp_path / "knotfab"
    assert "pla" in known_names("material")  # the folder is not there, and need not be
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path / "own"))
    assert data_folder() == tmp_path / "own"


def test_where_ones_own_are_on_other_systems(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("KNOTFAB_DATA", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("platformdirs.PlatformDirs", MacOS)
    assert data_folder() == tmp_path / "Library" / "Application Support" / "knotfab"
    monkeypatch.setattr("platformdirs.PlatformDirs", Windows)
    monkeypatch.setattr("platformdirs.windows.get_win_folder", lambda _: str(tmp_path / "Local"))
    assert data_folder() == tmp_path / "Local" / "knotfab"
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path / "own"))
    assert data_folder() == tmp_path / "own"


@pytest.mark.slow
def test_the_command_line_takes_names_and_files(own: Path, tmp_path: Path) -> None:
    done = knotfab("printers")
    assert done.code == 0 and "300 × 300 × 400" in done.out and "own-asa" in done.out
    assert str(own) in done.out
    for option in ("--printer", "--material"):
        done = knotfab("build", "text:A", option, tmp_path / "none.toml", "--out", tmp_path / "o")
        assert done.code == 2 and "none.toml: there is no such file" in done.err
        done = knotfab("build", "text:A", option, "nonsense", "--out", tmp_path / "o")
        assert done.code == 2 and f"or give a file ({option} FILE.toml)" in done.err
    (own / "printers" / "big.toml").write_text("nozzle = 0.4")
    done = knotfab("printers")
    assert done.code == 2 and "big.toml" in done.err


def test_the_defaults_of_usual_keys_are_the_models(own: Path) -> None:
    assert (
        resolve(Scene(material=asked_for(Material, "own-asa"))).material.color == Material().color
    )


# Scene files: what they mean, what they refuse and how it is said, and writing without loss.


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
    assert scene.mount.asked and scene.on_wall(1) and scene.mount.thickness_mm == 1.6
    assert parse_scene("[mount]\nkind = 'wall'").mount.thickness_mm == 3.0
    assert resolve(scene).piece.supports == "none"
    kept = parse_scene("[piece]\nsupports = 'slicer'\n[mount]\nplate = 'outline'")
    assert resolve(kept).piece.supports == "slicer"


def test_the_same_lengths_are_fine_where_they_do_not_contradict() -> None:
    parse_scene("[piece]\ndepth = 250\n[[views]]\nkind = 'eye'")
    parse_scene("[region]\nsize_mm = [1000, 10, 10]")
    parse_scene("[region]\nsize_mm = [240, 240, 180]")
    parse_scene("[[views]]\n[[views]]\nname = 'side'\nazimuth_deg = 90")


@pytest.mark.parametrize(
    ("top", "own"),
    [
        ("", "lamp_colour = [0, 0, 1]"),  # for lamps of one colour
        ("[lamps]\nmode = 'switch'", ""),
        ("[lamps]\nmode = 'switch'\nplaces = 'fixed'", "light_right_mm = 300"),  # at one place
        ("[lamps]\nmode = 'switch'\nplaces = 'auto'", ""),
    ],
)
def test_lamps_may_be_as_their_refusals_suggest(top: str, own: str) -> None:
    parse_scene(f"{top}\n[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nwall = 'a'\n{own}")


def test_scenes_that_cannot_be_read(tmp_path: Path) -> None:
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
