"""List scene.toml's keys: a JSON schema for editors, and docs/scene.toml with every default."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from knotfab_formats.explain import tables_of
from knotfab_formats.key import as_written, sentences_of, values_of, words_of
from knotfab_formats.scene import Scene
from knotfab_formats.search import OF_NO_PRESET, SearchSettings

__all__ = ["dump_schema", "list_keys", "list_tables"]

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_WIDTH = 118
_POSE = """[pose]  # From print coordinates to the scene, written by a build.
matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]

[[pose.plates]]  # Only where the printer does not hold the whole part: what is printed, plate by plate.
file = "plate-1.3mf"  # Beside the scene; left out: plate-1.3mf, plate-2.3mf, … in their order.
# For each body, in the file's order, the rigid motion that takes it from its plate to its place in part.stl:
matrices = [[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]"""


def list_tables() -> dict[str, type[BaseModel]]:
    """List the model of each table of a scene, by its name; that of [[views]] is one view's."""
    return tables_of(Scene) | {"search": SearchSettings}


def dump_schema() -> str:
    """Return the schema as JSON, made from the models that read a scene (JSON Schema, draft 2020-12)."""
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
                del node["default"]  # the preset that [accuracy] names has its own
    return json.dumps({"$schema": _DIALECT, **scene, "title": "scene.toml"}, indent=1) + "\n"


def list_keys() -> str:
    """List every key with its default and its sentence, as TOML."""
    tables = [
        "\n".join(_list_table(name, model))
        for name, model in list_tables().items()
        if name != "pose"
    ]
    return "\n\n".join(["schema = 1", *tables, _POSE]) + "\n"


def _list_table(name: str, model: type[BaseModel]) -> Iterator[str]:
    head = "[[views]]" if name == "views" else f"[{name}]"
    yield f"{head}  # {(model.__doc__ or '').strip().splitlines()[0]}"
    said = sentences_of(model)
    for key, field in model.model_fields.items():
        if name == "search" and key not in OF_NO_PRESET:  # the schema lists them
            continue
        words, told = words_of(model, key), said[key]
        default = as_written(model, key, field.default)
        value = json.dumps(default, ensure_ascii=False)
        shown = f"# {key} = …" if default is None else f"{key} = {value}"
        if len(words) > 1 and not all(word in told for word in words):
            told = f"{' | '.join(map(json.dumps, words))}. {told}"
        yield from textwrap.wrap(
            f"{shown}  # {told}", _WIDTH, subsequent_indent="    # ", break_long_words=False
        )
