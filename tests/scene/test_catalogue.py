"""Printers and materials by name, and a scene with their figures filled in."""

import numpy as np
import pytest

from knotfab.base.errors import InputError
from knotfab.design.frames import frame_view
from knotfab.picture.read import Target
from knotfab.scene.catalogue import materials, printers, resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.scene.own_data import find_name, title_of
from knotfab_formats.scene import Material, Printer, Scene


def test_known_names() -> None:
    assert set(printers()) >= {
        "prusa-mk4", "bambu-x1", "bambu-a1", "ender-3", "voron-2.4-350", "form-3", "hp-mjf", "sls",
    }  # fmt: skip
    assert set(materials()) >= {"pla", "petg", "tpu", "resin", "steel-wire-2mm"}
    assert "aluminium-wire-2mm" in materials()


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
    with pytest.raises(InputError, match="Did you mean 'aluminium-wire-2mm' or 'steel-wire-2mm'"):
        resolve(Scene(material=Material(name="wire")))


def test_figures_are_plausible() -> None:
    for printer in printers().values():
        assert min(printer.build_volume_mm) >= 100 and max(printer.build_volume_mm) <= 600
        assert 2 * printer.min_tube_radius_mm >= 2 * printer.nozzle_mm
    for material in materials().values():
        low, high = (2.0, 9.0) if material.process == "wire" else (0.9, 1.5)
        assert low < material.density_g_cm3 < high
        assert 20 <= material.young_modulus_mpa <= 250000 and material.yield_mpa >= 5


def test_a_u_turn_of_each_wire_can_be_bent() -> None:
    for material in materials().values():
        if material.process != "wire":
            assert material.wire_diameter_mm == 0
            continue
        bend = material.tool_radius_mm + material.wire_diameter_mm / 2
        # two bends of 90 degrees have the least straight between them
        assert material.min_bend_radius_mm == bend + material.min_straight_mm / 2


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


@pytest.mark.parametrize(("printer", "material"), [("hp-mjf", "pla"), ("prusa-mk4", "pa12")])
def test_powder_and_filament_do_not_mix(printer: str, material: str) -> None:
    with pytest.raises(InputError, match=f"{material}.*{printer}.*Name another"):
        resolve(parse_scene(f"[printer]\nname = {printer!r}\n[material]\nname = {material!r}"))


def test_unknown_names_are_refused_and_the_known_ones_listed() -> None:
    with pytest.raises(InputError, match=r"'bambu'.*Did you mean .*or 'bambu-x1'\?.*ender-3"):
        resolve(parse_scene("[printer]\nname = 'bambu'"))
    with pytest.raises(InputError, match=r"'steel'.*aluminium-wire-2mm.*petg.*tpu"):
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
    ("keys", "frame"),
    [
        ("", (135.0, 180.0)),
        ("frame_width_mm = 60", (60.0, 80.0)),
        ("frame_height_mm = 60", (45.0, 60.0)),
        ("frame_width_mm = 50\nframe_height_mm = 60", (50.0, 60.0)),
    ],
)
def test_frames_follow_the_picture(keys: str, frame: tuple[float, float]) -> None:
    target = Target("tall", np.ones((400, 300), dtype=bool), b"", 300, 400, ".png")
    view = frame_view(parse_scene(f"[[views]]\n{keys}").views[0], target)
    assert view.frame_mm == pytest.approx(frame)
    assert view.longer_mm == pytest.approx(max(frame))


def test_resolve_without_pictures_leaves_frames_open() -> None:
    assert resolve(Scene()).views[0].frame_width_mm is None
