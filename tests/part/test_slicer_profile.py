"""The profile follows the printer and the material; what is no filament is not sliced."""

from __future__ import annotations

from pathlib import Path

import pytest
from slicer_parts import scene_of

from knotfab.part.slicer_profile import PROFILE, line_width, profile, why_not_sliced, write_profile
from knotfab.scene.catalogue import materials, printers


def test_it_follows_the_printer_and_the_material() -> None:
    text = "[printer]\nname = 'ender-3'\nlayer_height_mm = 0.28\nnozzle_mm = 0.6\n"
    found = profile(scene_of(text + "[material]\nname = 'petg'"))
    assert found["bed_shape"] == "0x0,220x0,220x220,0x220" and found["max_print_height"] == "250"
    assert found["layer_height"] == found["first_layer_height"] == "0.28"
    assert found["nozzle_diameter"] == "0.6" and found["extrusion_width"] == "0.675"
    assert (found["filament_density"], found["temperature"]) == ("1.27", "240")
    assert found["filament_type"] == "PETG"
    # relative lengths are what read_gcode adds up, and no script of a 3MF is run
    assert found["use_relative_e_distances"] == "1" and found["post_process"] == ""


@pytest.mark.parametrize(
    ("angle", "threshold"), [(45.0, "45"), (44.9, "46"), (60.0, "30"), (0.0, "90"), (90.0, "1")]
)
def test_supports_start_at_the_printers_overhang(angle: float, threshold: str) -> None:
    """The slicer counts from the level, the printer from the vertical; 0 would mean "choose yourself"."""
    found = profile(scene_of(f"[printer]\nmax_overhang_deg = {angle}"))
    assert (found["support_material"], found["support_material_threshold"]) == ("1", threshold)


@pytest.mark.parametrize(
    ("said", "style"),
    [
        ("PrusaSlicer-2.5.0+UNKNOWN based on Slic3r", "snug"),
        ("[trace] Initializing\nPrusaSlicer-2.6.1 based on Slic3r", "organic"),
        ("PrusaSlicer-2.10.0", "organic"),
        ("no such option", "snug"),
    ],
)
def test_supports_are_branches_where_the_slicer_grows_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, style: str
) -> None:
    """The style is none that the slicer would refuse; without a slicer it is one that all read."""
    program = tmp_path / "prusa-slicer"
    program.write_text(f"#!/bin/sh\ncat <<'EOF'\n{said}\nEOF\n")
    program.chmod(0o755)
    monkeypatch.setattr("knotfab.part.slicer_profile.find_slicer", lambda: str(program))
    write_profile(tmp_path, scene_of())
    assert f"support_material_style = {style}\n" in (tmp_path / PROFILE).read_text()
    assert profile(scene_of())["support_material_style"] == "snug"


def test_a_printer_without_supports() -> None:
    assert profile(scene_of("[printer]\nsupports = false"))["support_material"] == "0"


def test_an_own_material_prints_like_pla_but_for_its_density() -> None:
    text = (
        "[material]\nname = 'mine'\n"
        + "\n".join(
            f"{key} = {value!r}"
            for key, value in materials()["pla"].model_dump().items()
            if key not in ("name", "density_g_cm3")
        )
        + "\ndensity_g_cm3 = 1.5"
    )
    found = profile(scene_of(text))
    assert (found["filament_density"], found["temperature"]) == ("1.5", "215")


def test_only_filament_is_sliced() -> None:
    assert why_not_sliced(scene_of()) is None
    resin = "resin: only its own slicer can say"
    assert why_not_sliced(scene_of("[material]\nname = 'resin'")) == resin
    assert why_not_sliced(scene_of("[printer]\nname = 'form-3'")) == resin
    assert why_not_sliced(scene_of("[printer]\nnozzle_mm = 0.1")) is None
    assert why_not_sliced(scene_of("[printer]\nnozzle_mm = 0.099")) == resin
    wire = why_not_sliced(scene_of("[material]\nname = 'pla'\nprocess = 'wire'"))
    assert wire is not None and wire.startswith("wire")
    # a material says it before the printer does
    wire = why_not_sliced(scene_of("[printer]\nname='form-3'\n[material]\nprocess = 'wire'"))
    assert wire is not None and wire.startswith("wire")


def test_every_printer_has_a_profile_or_a_reason(tmp_path: Path) -> None:
    for name in printers():
        scene = scene_of(f"[printer]\nname = {name!r}")
        (folder := tmp_path / name).mkdir()
        write_profile(folder, scene)
        filament = scene.printer.process == "filament"
        assert (why_not_sliced(scene) is None) == (folder / PROFILE).is_file() == filament
        if filament:
            lines = (folder / PROFILE).read_text().splitlines()
            assert all(line.count(" = ") == 1 for line in lines) and len(lines) > 40
        assert line_width(scene) > scene.printer.nozzle_mm
