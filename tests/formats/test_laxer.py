"""A scene that asks for less than the printer, material and accuracy that it names is told."""

import copy
from types import SimpleNamespace
from typing import Any

import pytest

from knotfab.scene.catalogue import known_names, resolve
from knotfab_formats.laxer import tell_laxer
from knotfab_formats.scene import Scene
from knotfab_validators.conclusion import conclude
from knotfab_validators.files.scene import parse_scene

VIEW = {"name": "front", "picture": "a.png", "frame_width_mm": 100.0, "frame_height_mm": 100.0}
KNOTS = SimpleNamespace(members=(), bars=("bar",), plate=None)
MEMBERS = SimpleNamespace(members=("peg",), bars=(), plate=None)
ON_PLATE = SimpleNamespace(members=(), bars=(), plate="plate")
# an edit of scene.toml, what knots.json holds, and what is said
EDITS: dict[str, tuple[str, object, Any, str]] = {
    "printed": ("piece.printed", False, KNOTS, "printed = false"),
    "process": ("printer.process", "powder", None, 'process = "powder"'),
    "another process": ("material.process", "powder", None, 'process = "powder"'),
    "supports": ("piece.supports", "slicer", KNOTS, 'supports = "slicer"'),
    "outline": ("accuracy.max_outline_error_px", 1000.0, None, "max_outline_error_px = 1000"),
    "clearance": ("piece.clearance_mm", 0.0, None, "clearance_mm = 0"),
    "wall": ("printer.min_wall_mm", 0.01, None, "min_wall_mm = 0.01"),
    "gap": ("printer.min_gap_mm", 0.01, None, "min_gap_mm = 0.01"),
    "bridge": ("printer.max_bridge_mm", 1000.0, None, "max_bridge_mm = 1000"),
    "overhang": ("printer.max_overhang_deg", 80.0, None, "max_overhang_deg = 80"),
    "layer": ("printer.layer_height_mm", 0.05, None, "layer_height_mm = 0.05"),
    "modulus": ("material.young_modulus_mpa", 1e5, None, "young_modulus_mpa = 100000"),
    "bend": ("material.min_bend_radius_mm", 0.01, None, "min_bend_radius_mm = 0.01"),
    "sag": ("mount.max_sag_mm", 100.0, None, "max_sag_mm = 100"),
    "pegs": ("mount.pegs", [], MEMBERS, "pegs = []"),
    "lamp": ("views.light_diameter_mm", 400.0, None, "light_diameter_mm = 400"),
    "plate": ("mount.plate", "pegs", ON_PLATE, 'plate = "pegs"'),
}


def scene_of(**asked: Any) -> dict[str, Any]:
    piece = {"tube_radius_mm": 2.5, "printed": True, "supports": "none"}
    mount = {"kind": "wall", "plate": "full", "pegs": [1]}
    whole = {"schema": 1, "views": [VIEW], "piece": piece, "mount": mount, **asked}
    found: dict[str, Any] = resolve(Scene.model_validate(whole)).model_dump(
        by_alias=True, mode="json"
    )
    return found


@pytest.mark.parametrize("case", EDITS)
def test_each_laxer_key_is_told(case: str) -> None:
    dotted, value, knots, said = EDITS[case]
    table, key = dotted.split(".")
    given = scene_of()
    honest = parse_scene(copy.deepcopy(given))
    assert tell_laxer(honest, KNOTS if knots is MEMBERS else knots) == ""
    own = given["views"][0] if table == "views" else given[table]
    own[key] = value
    laxer = parse_scene(given)
    assert (
        tell_laxer(laxer, knots) == f"the scene asks for less than prusa-mk4 in pla needs: {said}"
    )
    if knots is None:
        told = conclude([], None, None, laxer)
        assert (
            "every required check passed, but the scene asks for less than" in told and said in told
        )
    assert "but" not in conclude([], None, None, honest)


@pytest.mark.parametrize("printer", known_names("printer"))
@pytest.mark.parametrize("accuracy", ["sketch", "fine"])
def test_no_printer_is_laxer_than_itself(printer: str, accuracy: str) -> None:
    given = scene_of(printer={"name": printer}, accuracy={"name": accuracy})
    assert tell_laxer(parse_scene(given)) == ""
    given["printer"]["build_volume_mm"] = [1.3 * mm for mm in given["printer"]["build_volume_mm"]]
    assert "build_volume_mm" in tell_laxer(parse_scene(given))


@pytest.mark.parametrize("material", known_names("material"))
def test_no_material_is_laxer_than_itself(material: str) -> None:
    printer = (
        "sls" if material.startswith("pa12") else "form-3" if material == "resin" else "prusa-mk4"
    )
    given = scene_of(
        material={"name": material}, printer={"name": printer}, piece={"printed": True}
    )
    assert tell_laxer(parse_scene(given)) == ""
