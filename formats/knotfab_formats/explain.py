"""Turn a scene file's validation error into an InputError of one sentence."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from knotfab_formats.errors import InputError, shown

# Millimetres or degrees per unit that people write instead.
_LENGTHS = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "um": 0.001, "in": 25.4, "inch": 25.4}
_LENGTHS |= {"inches": 25.4, "ft": 304.8, '"': 25.4}
_ANGLES = {"deg": 1.0, "degrees": 1.0, "°": 1.0, "rad": 57.29577951308232}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z°\"]*)\s*")
_NAMES = {"mm": "millimetres", "deg": "degrees"}


def explain(
    error: ValidationError, raw: Mapping[str, Any], what: str, scene: type[BaseModel]
) -> InputError:
    """Return the most telling of the errors that validation found, as an InputError.

    Args:
        error: from the validation of `raw`, what a TOML file held, by the model `scene`.
        what: how the message names the file.
    """
    found: list[Any] = error.errors(include_url=False, include_input=False)
    # An unknown key often explains the rest, so it comes first.
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
    path = _path(first["loc"], raw)
    if first["type"] == "extra_forbidden":
        return _unknown_key(path, raw, what, scene)
    if not path:
        return InputError(what, f"it lacks {first['loc'][0]}", "Add it.")
    same = [e for e in found if _path(e["loc"], raw) == path]
    return _wrong_value(path, same, raw, what)


def _path(loc: tuple[int | str, ...], raw: Any) -> tuple[int | str, ...]:
    """Return the part of an error's location that names keys of the file rather than branches of a type."""
    path: list[int | str] = []
    for step in loc:
        is_key = isinstance(raw, dict) and step in raw
        is_place = isinstance(raw, list | tuple) and isinstance(step, int) and step < len(raw)
        if not (is_key or is_place):
            break
        path.append(step)
        raw = raw[step]
    return tuple(path)


def _look_up(path: tuple[int | str, ...], raw: Any) -> Any:
    for step in path:
        raw = raw[step]
    return raw


def _name_table(path: tuple[int | str, ...]) -> str:
    """Write a table's name as the file does, with the view's number."""
    if not path:
        return "the top level"
    if path[0] == "views":
        return f"[[views]] number {int(path[1]) + 1}" if len(path) > 1 else "[[views]]"
    return f"[{path[0]}]"


def tables_of(scene: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """List the model of each table by its name."""
    tables: dict[str, type[BaseModel]] = {}
    for name, field in scene.model_fields.items():
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                tables[name] = part
    return tables


def _key_names(table: str | None, scene: type[BaseModel]) -> list[str]:
    model = scene if table is None else tables_of(scene).get(table)
    if model is None:
        return []
    return [field.alias or name for name, field in model.model_fields.items()]


def _convert(number: float, unit: str, target: str) -> float | None:
    """Convert `number` from `unit` to mm or deg; None if the units do not fit."""
    table = _LENGTHS if target == "mm" else _ANGLES
    factor = table.get(unit if unit == '"' else unit.lower())
    return None if factor is None else float(f"{number * factor:.12g}")


def _unknown_key(
    path: tuple[int | str, ...], raw: Mapping[str, Any], what: str, scene: type[BaseModel]
) -> InputError:
    key, table = str(path[-1]), path[:-1]
    valid = _key_names(str(table[0]) if table else None, scene)
    stem, _, suffix = key.rpartition("_")
    value = _look_up(path, raw)
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    for unit, name in _NAMES.items():
        wanted = f"{stem}_{unit}"
        converted = None if number is None else _convert(number, suffix, unit)
        known = _LENGTHS if unit == "mm" else _ANGLES
        if wanted in valid and suffix.lower() in known:
            remedy = f"knotfab takes {name}: {wanted}"
            remedy += f" = {converted!r}." if converted is not None else "."
            return InputError(what, f"{_name_table(table)} has no key {key!r}", remedy)
    alike = key.replace("lamp", "light")
    close = [alike] if alike in valid else difflib.get_close_matches(key, valid, n=1, cutoff=0.5)
    close = [v for v in valid if v in (f"{key}_mm", f"{key}_deg")] or close
    homes = [name for name in tables_of(scene) if key in _key_names(name, scene)]
    if homes and (not table or homes != [table[0]]):
        home = "[[views]]" if homes[0] == "views" else f"[{homes[0]}]"
        remedy = f"It belongs in {home}."
    elif close:
        remedy = f"Did you mean {close[0]!r}?"
    else:
        remedy = f"Its keys are: {', '.join(valid)}."
    return InputError(what, f"{_name_table(table)} has no key {key!r}", remedy)


def _describe_expected(error: Mapping[str, Any]) -> str:
    """Describe the values that one branch of a type accepts."""
    context = error.get("ctx", {})
    match error["type"]:
        case "float_type" | "finite_number":
            return "a finite number"
        case "int_type" | "int_from_float":
            return "a whole number"
        case "bool_type":
            return "true or false"
        case "string_type":
            return "a text in quotes"
        case "greater_than":
            return f"a number greater than {context['gt']:g}"
        case "greater_than_equal":
            return f"a number not less than {context['ge']:g}"
        case "less_than":
            return f"a number less than {context['lt']:g}"
        case "less_than_equal":
            return f"a number not greater than {context['le']:g}"
        case "literal_error":
            return str(context["expected"]).replace("'", '"')
        case "string_pattern_mismatch" if context["pattern"].startswith("^#"):
            return 'a colour such as "#d9d4c7"'
        case "string_pattern_mismatch":
            if "#" in str(context["pattern"]):
                return "a colour such as #d02010"
            return "made of letters, digits, _ and - alone"
        case "tuple_type" | "missing" | "too_long" | "too_short":
            return "a list of as many numbers as docs/conventions.md shows"
        case "model_type" | "model_attributes_type" | "dict_type":
            return "a table"
    return str(error["msg"]).lower()


def _wrong_value(
    path: tuple[int | str, ...], errors: list[Any], raw: Mapping[str, Any], what: str
) -> InputError:
    value = _look_up(path, raw)
    if path == ("views",) and errors[0]["type"] == "too_long":
        most = errors[0]["ctx"]["max_length"]
        why = f"it has {len(value)} views, and half a turn leaves something of at most {most} pictures"
        return InputError(what, why, "Leave some [[views]] out.")
    if path in (("views",), ("views", 0)) and not isinstance(value, dict):
        return InputError(
            what, "it has no view in [[views]]", "Write one or more [[views]] tables."
        )
    if path == ("views",):
        return InputError(what, "[views] is one table", "Write [[views]], with double brackets.")
    if path == ("pose",):
        return InputError(what, "[pose] has no key 'matrix'", "Leave the table [pose] out.")
    names = [step for step in path if isinstance(step, str)]
    key = names[-1]
    table = path[: path.index(key)]
    quoted = shown(f'"{value}"' if isinstance(value, str) else value, 60)
    quoted = quoted.lower() if isinstance(value, bool) else quoted
    expected = list(dict.fromkeys(_describe_expected(e) for e in errors))
    if len(errors) > 1 and isinstance(path[-1], int):  # a member of a list: no other branch applies
        expected = expected[:1]
    where = f"{_name_table(table)} {key}" if table else key
    last = " or ".join(expected[-2:])
    why = f"{where} is {quoted}, but must be {', '.join([*expected[:-2], last])}"
    return InputError(what, why, _remedy(key, value))


def _remedy(key: str, value: Any) -> str:
    """Suggest the line to write instead, if a text holds a number."""
    unit = key.rpartition("_")[2]
    if isinstance(value, str) and (match := _QUANTITY.fullmatch(value)):
        number = _convert(float(match[1]), match[2] or unit, unit) if unit in _NAMES else None
        if number is not None:
            return f"Write {key} = {number!r}, in {_NAMES[unit]}, without unit or quotes."
        if not match[2]:
            return f"Write {key} = {value.strip()}, without quotes."
    if key == "schema":
        return "This version of knotfab reads schema = 1."
    return "Correct it, or leave the key out for its default."
