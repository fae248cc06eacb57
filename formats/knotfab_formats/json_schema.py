"""The JSON schema of scene.toml, for editors that check and complete TOML."""

from __future__ import annotations

import json
from typing import Any

from knotfab_formats.scene import Scene
from knotfab_formats.search import SearchSettings

__all__ = ["dump_schema"]

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def dump_schema() -> str:
    """The schema as JSON, made from the models that read a scene (JSON Schema, draft 2020-12)."""
    scene: dict[str, Any] = Scene.model_json_schema(by_alias=True)
    search = SearchSettings.model_json_schema()
    for key in search["properties"].values():
        del key["default"]  # the preset that [accuracy] names has its own
    scene["properties"]["search"] = search
    return json.dumps({"$schema": _DIALECT, **scene, "title": "scene.toml"}, indent=1) + "\n"
