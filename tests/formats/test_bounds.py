"""Every number of a scene has bounds, which its schema shows; what lies beyond is one sentence."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from knotfab.scene.load import parse_scene
from knotfab_formats.bounds import why_out_of_bounds
from knotfab_formats.errors import InputError
from knotfab_formats.read import dump_schema
from knotfab_formats.search import PRESETS, SearchSettings, search_settings
from knotfab_formats.views import View


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
        assert {"maximum", "exclusiveMaximum"} & set(kind), at
        assert {"minimum", "exclusiveMinimum"} & set(kind), at


ODD = ("1e308", "-1e308", "1e-320", "nan", "inf", "9" * 400, "true", '"7"', "-1")


@pytest.mark.parametrize("value", ODD)
def test_what_is_no_sensible_number_is_refused_by_its_key(value: str) -> None:
    tables: dict[str, list[str]] = {
        "piece": ["tube_radius_mm", "depth", "knots"],
        "material": ["density_g_cm3", "min_bend_radius_mm", "max_length_mm", "young_modulus_mpa"],
        "printer": ["nozzle_mm", "layer_height_mm", "min_tube_radius_mm"],
        "[views]": ["light_distance_mm", "wall_distance_mm", "frame_width_mm", "wall_radius_mm"],
        "mount": ["plate_thickness_mm", "max_sag_mm", "base_thickness_mm"],
    }
    for table, keys in tables.items():
        for key in keys:
            if (key, value) == ("wall_radius_mm", "-1"):
                continue  # a column's radius
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
