"""The printer's keys: the maker's model and the validators' reader agree on them."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from knot_curves import judge_type

import knotfab
from examples.api_page import KEYS, list_keys
from knotfab.geometry.measures import bend_radii, strand_gap
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Limits
from knotfab.scene.catalogue import printers, resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.start.tie import load_knot
from knotfab_formats.bounds import option_of, sentences_of, values_of, why_out_of_bounds
from knotfab_formats.errors import InputError
from knotfab_formats.knots import BRAIDS, parse_knot_name
from knotfab_formats.piece import Printer
from knotfab_formats.read import dump_schema, list_tables, parse_toml
from knotfab_formats.scene import Scene, SettledRegion
from knotfab_formats.search import PRESETS, SearchSettings, search_settings
from knotfab_formats.views import View
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_scene as read
from knotfab_validators.knots.names import promised_knot
from paper.curves import closed_braid

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
        "nozzle_mm = 0", "layer_height_mm = 0.0", "layer_height_mm = 'auto'", "supports = 1",
        "supports = 'yes'", "max_overhang_deg = 90.1", "max_overhang_deg = -1", "max_bridge_mm = -0.1",
        "max_bridge_mm = true", "max_support_cm3 = -1", "max_support_cm3 = 'none'",
    ],
)  # fmt: skip
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


# Every number of a scene has bounds, which its schema shows; what lies beyond is one sentence.


def numbers(
    kind: dict[str, Any], whole: dict[str, Any], at: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each place of a schema where a number stands."""
    if "$ref" in kind:
        kind = whole["$defs"][kind["$ref"].rpartition("/")[2]]
    if kind.get("type") in ("number", "integer") and "const" not in kind:
        yield at, kind
    for key, inner in kind.get("properties", {}).items():
        yield from numbers(inner, whole, f"{at}.{key}")
    for inner in (*kind.get("anyOf", ()), *kind.get("prefixItems", ()), kind.get("items")):
        if isinstance(inner, dict):
            yield from numbers(inner, whole, at)


def test_the_schema_shows_the_bounds_of_every_number() -> None:
    schema = json.loads(dump_schema())
    found = list(numbers(schema, schema, "scene"))
    assert len(found) > 100
    for at, kind in found:
        assert {"maximum", "exclusiveMaximum", "enum"} & set(kind), at
        assert {"minimum", "exclusiveMinimum", "enum"} & set(kind), at


ODD = ("1e308", "-1e308", "1e-320", "nan", "inf", "9" * 400, "true", '"7"', "-1")


@pytest.mark.parametrize("value", ODD)
def test_what_is_no_sensible_number_is_refused_by_its_key(value: str) -> None:
    tables: dict[str, list[str]] = {
        "piece": ["tube_radius_mm", "depth", "knots"],
        "material": ["density_g_cm3", "min_bend_radius_mm", "max_length_mm", "young_modulus_mpa"],
        "printer": ["nozzle_mm", "layer_height_mm", "min_tube_radius_mm"],
        "[views]": ["light_distance_mm", "wall_distance_mm", "frame_width_mm"],
        "mount": ["plate_thickness_mm", "max_sag_mm", "base_thickness_mm"],
    }
    for table, keys in tables.items():
        for key in keys:
            with pytest.raises(InputError, match=key) as caught:
                parse_scene(f"[{table}]\n{key} = {value}")
            assert str(caught.value).count("\n") == 0 and len(str(caught.value)) < 400
    for key, field in SearchSettings.model_fields.items():
        if field.annotation in (int, float) and value not in ('"7"',):
            plain = {"true": True, "nan": float("nan"), "inf": float("inf")}
            number = plain.get(value, float(value) if value not in plain else None)
            if value == "1e-320" and any(getattr(m, "ge", 1) == 0 for m in field.metadata):
                continue  # next to nothing is nothing
            with pytest.raises(InputError, match=key):
                search_settings("draft", {key: number})


def test_bounds_are_told_in_words() -> None:
    assert why_out_of_bounds(View, "frame_width_mm", 1e308) == "from 0.001 up to 100000"
    assert why_out_of_bounds(View, "threshold", 1.0) == "above 0 below 1"
    assert why_out_of_bounds(View, "frame_width_mm", 180.0) is None
    for preset in PRESETS.values():  # and each is within its own
        SearchSettings.model_validate(preset.model_dump())


# Knots by name are the knots that they are called, and every name says which knot it means.


UNIT = Limits(1.0, 0.0, 1.0, np.inf, SettledRegion(size_mm=(1e5, 1e5, 1e5)))


@pytest.mark.slow
@pytest.mark.parametrize("name", BRAIDS)
def test_every_named_knot_is_that_knot_and_fits_its_tube(name: str) -> None:
    points = load_knot(name)
    rings = polylines_of_sizes((len(points),))
    assert strand_gap(points, rings, UNIT.separation, 4.0).gap > 2.0
    assert bend_radii(points, rings).min() > 0.95
    sentence, verdict = judge_type(points, promise=parse_knot_name(name).promise)
    assert verdict in ("proved", "consistent"), sentence
    # the braid is of the same knot, by the same check
    assert judge_type(closed_braid(BRAIDS[name])[0], promise=parse_knot_name(name).promise)[
        1
    ] == verdict or (verdict == "consistent" or name in ("8_8", "8_16"))


@pytest.mark.parametrize("name", ["3_1", "5_2", "7_4", "8_19", "8_20"])
def test_a_mirrored_knot_is_left_handed(name: str) -> None:
    points = load_knot(name, mirrored=True)
    assert judge_type(points, promise=f"left-handed {name}")[1] in ("proved", "consistent")
    assert judge_type(points, promise=f"right-handed {name}")[1] == "refuted"


@pytest.mark.parametrize(
    ("asked", "promise"),
    [
        ("unknot", "unknot"),
        ("0_1", "unknot"),
        ("Trefoil", "right-handed 3_1"),
        ("left trefoil", "left-handed 3_1"),
        ("left-handed trefoil knot", "left-handed 3_1"),
        ("m3_1", "left-handed 3_1"),
        ("left figure-eight", "4_1"),
        ("T(3, 4)", "right-handed 8_19"),
        ("granny", "right-handed 3_1#3_1"),
        ("square", "3_1#m3_1"),
        ("4_1#m5_2", "left-handed 4_1#5_2"),
        ("right 6_3", "6_3"),
    ],
)
def test_names(asked: str, promise: str) -> None:
    name = parse_knot_name(asked)
    assert name.promise == promise
    assert promised_knot(name.promise).meant, "the validator understands it"
    assert len(promised_knot(name.promise).meant) == 1, "and it is one knot, of one hand"


@pytest.mark.parametrize(
    "asked", ["3_2", "9_1", "cat", "3_1#", "m", "left", "#", "3_1#" * 7 + "3_1"]
)
def test_unknown_names_say_what_is_known(asked: str) -> None:
    with pytest.raises(InputError) as error:
        parse_knot_name(asked)
    assert error.value.exit_code == 2
    assert "8_19" in str(error.value) or "at most" in str(error.value)


# What is told of a scene's keys: each has a sentence, and docs/scene.toml lists what the models
# declare.


def test_the_keys_are_listed_as_they_are_declared() -> None:
    assert KEYS.read_text("utf-8") == list_keys(), "run python -m examples.api_page"


def test_the_listing_is_a_scene_with_every_default() -> None:
    raw = tomllib.loads(list_keys())
    assert Scene.model_validate({**raw, "pose": None, "search": {}}) == Scene()


@pytest.mark.parametrize("table", [t for t in list_tables() if t not in ("pose", "search")])
def test_a_word_beside_numbers_is_read_as_no_text_and_written_as_that_word(table: str) -> None:
    model = list_tables()[table]
    for key in model.model_fields:
        for word in values_of(model, key):
            read = model.model_validate({key: word})
            assert not isinstance(getattr(read, key), str)
            assert model.model_validate({key: getattr(read, key)}) == read
            assert read.model_dump()[key] == read.model_dump(mode="json")[key] == word


@pytest.mark.parametrize("table", [t for t in list_tables() if t != "pose"])
def test_every_key_has_a_sentence(table: str) -> None:
    model = list_tables()[table]
    assert set(sentences_of(model)) == set(model.model_fields)
    assert all(said[0] != " " and said.endswith(".") for said in sentences_of(model).values())


def test_no_two_keys_have_one_option() -> None:
    options = [option_of(m, key) for m in list_tables().values() for key in m.model_fields]
    given = [one for one in options if one is not None]
    assert len(given) == len(set(given)) > 20


# What a scene by hand gets wrong is told with the line as it should be.


@pytest.mark.parametrize(
    ("line", "mended"),
    [
        ("size_mm = 200,5", "size_mm = 200.5"), ("name = “mk4”", 'name = "mk4"'),
        (r'picture = "C:\Users\a.png"', r"picture = 'C:\Users\a.png'"),
        ("size_mm = 200 mm", "size_mm = 200"), ("lines = True", "lines = true"),
        ("ink = dark", 'ink = "dark"'), ("size_mm = –3", "size_mm = -3"),
    ],
)  # fmt: skip
def test_the_remedy_is_the_line_as_it_should_be(line: str, mended: str) -> None:
    with pytest.raises(InputError, match="not valid TOML") as caught:
        parse_toml(f"[a]\n{line}\nb = 1\n", "scene.toml")
    assert mended in str(caught.value)
