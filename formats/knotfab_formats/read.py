"""Read a scene.toml for maker and validators: its TOML, its keys, and what views share."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel

from knotfab_formats.bounds import as_written, sentences_of, values_of
from knotfab_formats.errors import InputError, short
from knotfab_formats.explain import tables_of
from knotfab_formats.scene import Scene
from knotfab_formats.search import SearchSettings
from knotfab_formats.struck import pass_keys
from knotfab_formats.views import OF_WALL, View

_MOST_DOTS = 200  # most dots in a key, and in a file's quoted keys
_QUOTED_KEY = re.compile(r"[\"']\s*\.")

AScene = TypeVar("AScene", bound=Scene)


def scene_of(raw: Mapping[str, Any], what: str, model: type[AScene]) -> AScene:
    """Build the scene from a TOML file's content, as an instance of `model`.

    Raises:
        InputError: an unknown or struck key, a wrong type, unit or bound; or a wall of no earlier view.
    """
    scene = model.model_validate(pass_keys(raw, what), context=what)
    if not any(view.wall for view in scene.views):
        return scene
    views, first = _share_walls(scene.views, what), scene.views[0].name
    for view in views:
        if view.kind == "eye":
            why = f"view {view.name!r} is an eye, which lights no wall"
            raise InputError(what, why, "Leave it out.")
        if view.name != first and view.wall != first:
            raise InputError(
                what,
                f"view {view.name!r} has a wall of its own, and others share one",
                f"Give every view but the first wall = {first!r}, or none.",
            )
    return scene.but(views=views)


def parse_toml(text: str, what: str) -> dict[str, Any]:
    """Parse a TOML text; a leading byte order mark is ignored.

    Raises:
        InputError: it is not TOML; the error gives the number of the line.
    """
    # tomllib's time grows with the square of a dotted key's length, quoted or not
    longest = max(part.count(".") for part in re.split(r"[,\n]", text))
    if longest > _MOST_DOTS or len(_QUOTED_KEY.findall(text)) > _MOST_DOTS:
        raise InputError(what, f"it has a key of more than {_MOST_DOTS} words", "Correct it.")
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        last = f"at line {text.rstrip().count(chr(10)) + 1}, the last"
        reason = str(error).replace("at end of document", last)
        found = re.search(r"at line (\d+)", str(error))
        lines = text.splitlines()
        line = lines[min(int(found[1]), len(lines)) - 1] if found and lines else ""
        remedy = _remedy_of(line)
        raise InputError(what, f"it is not valid TOML: {reason}", remedy) from error
    except RecursionError as error:
        raise InputError(what, "its lists are nested too deep", "Correct it.") from error
    except ValueError as error:
        raise InputError(what, "a whole number in it is too long", "Correct it.") from error


def _remedy_of(line: str) -> str:
    """Say how to mend a line that the parser refuses, in a maker's words."""
    key, _, value = (part.strip() for part in line.partition("="))
    shown_value = short(value)
    if set(line) & set("“”„‘’«»"):
        return f"Write straight quotes: {short(re.sub('[“”„‘’«»]', chr(34), line))}"
    if "\\" in value and value[:1] == '"':
        return (
            f"Write / for each \\ of the path, or single quotes: {key} = '{value.strip(chr(34))}'"
        )
    if re.fullmatch(r"-?\d{1,9},\d{1,9}", value):
        return f"Write the number with a decimal point: {key} = {value.replace(',', '.')}"
    if re.fullmatch(r"-?[\d.]{1,12} ?(?:mm|cm|m|g|px|s|h|deg|°|%)", value):
        return f"Leave the unit out, which the key names: {key} = {value.rstrip('mcgpxshde°% ')}"
    if set(line) & set("–—−"):
        return f"Write a plain hyphen (-): {short(re.sub('[–—−]', '-', line))}"
    if value.lower() in ("true", "false", "yes", "no", "on", "off"):
        word = "true" if value.lower() in ("true", "yes", "on") else "false"
        return f"Write it as TOML does: {key} = {word}"
    if re.fullmatch(r"[^\W\d][\w./: -]{0,80}", value):
        return f'Put quotes about the value: {key} = "{shown_value}"'
    return "Correct that line."


def _share_walls(views: tuple[View, ...], what: str) -> tuple[View, ...]:
    """Copy to each view that shines on another's wall the keys of that wall and frame.

    Raises:
        InputError: the wall belongs to no earlier view, or the view contradicts its keys.
    """
    walls: dict[str, View] = {}
    found = []
    for view in views:
        if not view.wall:
            walls[view.name] = view
            found.append(view)
            continue
        theirs = walls.get(view.wall)
        if theirs is None:
            raise InputError(
                what,
                f"view {view.name!r} has wall = {view.wall!r}, no earlier view with a wall of its own",
                f"Known: {', '.join(walls) or 'none'}.",
            )
        shared = {key: getattr(theirs, key) for key in OF_WALL}
        for key in sorted(set(OF_WALL) & view.model_fields_set):
            if getattr(view, key) != shared[key]:
                raise InputError(
                    what,
                    f"view {view.name!r} shines on the wall of {view.wall!r}, but has another {key}",
                    f"Leave {key} out: it is that wall's.",
                )
        found.append(view.but(**shared))
    return tuple(found)


# The keys of scene.toml as a JSON schema for editors.

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def list_tables() -> dict[str, type[BaseModel]]:
    """List the model of each table of a scene by its name; [[views]] stands for one view."""
    return tables_of(Scene) | {"search": SearchSettings}


def dump_schema() -> str:
    """Write the JSON schema (draft 2020-12) of the models that read a scene."""
    scene: dict[str, Any] = Scene.model_json_schema(by_alias=True)
    scene["properties"]["search"] = SearchSettings.model_json_schema()
    for name, model in list_tables().items():
        table = (
            scene["properties"]["search"] if name == "search" else scene["$defs"][model.__name__]
        )
        for key, said in sentences_of(model).items():
            node = table["properties"][key]
            node["description"] = said
            node.pop("option", None)
            if values_of(model, key):
                node["default"] = as_written(model, key, model.model_fields[key].default)
            if name == "search":
                del node["default"]  # it depends on the preset that [accuracy] names
    return json.dumps({"$schema": _DIALECT, **scene, "title": "scene.toml"}, indent=1) + "\n"
