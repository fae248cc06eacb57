"""The printer's keys: the maker's model and the validators' reader agree on them."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import knotfab
from knotfab.scene.catalogue import printers, resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Printer
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene as read

SHARED = (
    "name", "build_volume_mm", "nozzle_mm", "layer_height_mm", "supports", "max_overhang_deg",
    "max_bridge_mm",
)  # fmt: skip


@pytest.mark.parametrize("name", sorted(printers()))
def test_a_resolved_printer_reads_the_same_on_both_sides(name: str) -> None:
    text = dump_scene(resolve(parse_scene(f"[printer]\nname = '{name}'")))
    ours, theirs = parse_scene(text).printer, read(tomllib.loads(text)).printer
    assert all(getattr(ours, key) == getattr(theirs, key) for key in SHARED)
    width, depth, height = ours.build_volume_mm
    assert ours.max_support_cm3 == theirs.max_support_cm3 == width * depth * height / 1000


def test_both_sides_have_the_same_defaults() -> None:
    ours, theirs = Printer(), read({}).printer
    assert all(getattr(ours, key) == getattr(theirs, key) for key in SHARED)
    assert ours.max_support_cm3 is theirs.max_support_cm3 is None


def test_each_file_names_the_source_of_its_build_volume() -> None:
    found = list((Path(knotfab.__file__).parent / "scene/data/printers").glob("*.toml"))
    assert len(found) > 20
    for path in found:
        lines = path.read_text("utf-8").splitlines()
        said = " ".join(line.lstrip("# ") for line in lines if line[:1] == "#")
        assert "build volume" in said.lower(), path.name


def test_figures_are_plausible() -> None:
    for printer in printers().values():
        assert printer.layer_height_mm < printer.nozzle_mm <= 2 * printer.min_tube_radius_mm
        if printer.process == "powder":  # walls and gaps are the process's own
            assert printer.nozzle_mm <= printer.min_wall_mm <= 2 * printer.min_tube_radius_mm
            assert printer.nozzle_mm <= printer.min_gap_mm
        else:
            assert printer.supports and 40 <= printer.max_overhang_deg <= 75


def test_a_printer_that_is_only_named_leaves_its_size_open() -> None:
    other = read({"printer": {"name": "form-3"}}).printer
    assert other.stated("nozzle_mm") is None and other.stated("build_volume_mm") is None
    named = read({"printer": {"name": "form-3", "nozzle_mm": 0.1}}).printer
    assert named.stated("nozzle_mm") == 0.1 and named.stated("build_volume_mm") is None
    assert read({}).printer.stated("nozzle_mm") == 0.4


@pytest.mark.parametrize(
    "line",
    [
        "nozzle_mm = 0",
        "layer_height_mm = 0.0",
        "layer_height_mm = 'auto'",
        "supports = 1",
        "supports = 'yes'",
        "max_overhang_deg = 90.1",
        "max_overhang_deg = -1",
        "max_bridge_mm = -0.1",
        "max_bridge_mm = true",
        "max_support_cm3 = -1",
        "max_support_cm3 = 'none'",
    ],
)
def test_impossible_values_are_refused_on_both_sides(line: str) -> None:
    text = f"[printer]\n{line}"
    with pytest.raises(InputError, match=line.split()[0]):
        parse_scene(text)
    with pytest.raises(BadFile, match=line.split()[0]):
        read(tomllib.loads(text))


def test_the_limits_themselves_are_allowed() -> None:
    text = "[printer]\nmax_overhang_deg = 90\nmax_bridge_mm = 0\nmax_support_cm3 = 0"
    theirs = read(tomllib.loads(text)).printer
    assert (theirs.max_overhang_deg, theirs.max_bridge_mm, theirs.max_support_cm3) == (90, 0, 0)
    assert parse_scene(text).printer.max_overhang_deg == 90


@pytest.mark.slow
def test_printability_needs_none_of_the_makers_libraries() -> None:
    code = """
import sys
for name in ("knotfab", "torch", "cadquery", "manifold3d", "trimesh"):
    sys.modules[name] = None
from solids import table
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.files.scene import parse_scene
checks = printability_checks(table(), parse_scene({}).printer, seconds={})
print(len(checks), {c.status for c in checks})
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[1] / "shared",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "8 {'pass'}\n", done.stderr
