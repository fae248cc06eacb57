"""Printers and materials that are known by name, and a scene with their figures filled in."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any, TypeVar

from knotfab.errors import InputError
from knotfab.scene.model import Material, Printer, Scene, View

__all__ = ["LONGER_FRAME_MM", "materials", "printers", "resolve"]

LONGER_FRAME_MM = 180.0  # the picture's longer side on the wall, where the scene does not say

Named = TypeVar("Named", Printer, Material)


@cache
def _data(folder: str) -> dict[str, dict[str, Any]]:
    """Content of each data file by its name; keys such as the title are left out."""
    files = resources.files("knotfab.scene").joinpath("data", folder).iterdir()
    found: dict[str, dict[str, Any]] = {}
    for file in sorted(files, key=lambda f: f.name):
        if file.name.endswith(".toml"):
            table = tomllib.loads(file.read_text(encoding="utf-8"))
            table.pop("title", None)
            found[file.name.removesuffix(".toml")] = table
    return found


def printers() -> dict[str, Printer]:
    """All printers with a data file, by name."""
    return {name: Printer(name=name, **table) for name, table in _data("printers").items()}


def materials() -> dict[str, Material]:
    """All materials with a data file, by name."""
    return {name: Material(name=name, **table) for name, table in _data("materials").items()}


def _filled(own: Named, known: dict[str, Named], kind: str) -> Named:
    """`own` with the data file's figures wherever the scene did not give a key itself."""
    written = {key: getattr(own, key) for key in own.model_fields_set if key != "name"}
    base = known.get(own.name)
    if base is None:
        if set(type(own).model_fields) - {"name"} <= set(written):
            return own  # complete without a data file
        close = difflib.get_close_matches(own.name, known, n=1)
        hint = f"Did you mean {close[0]!r}? " if close else ""
        raise InputError(
            f"{kind} {own.name!r}",
            f"there is no such {kind}",
            f"{hint}Known: {', '.join(known)}; or give every key of [{kind}] in the scene.",
        )
    return type(own)(**{**base.model_dump(), **written})


def _framed(view: View, size: tuple[int, int]) -> View:
    """The view with both sides of its frame, by the picture's aspect ratio where not given."""
    width, height = size
    across, up = view.frame_width_mm, view.frame_height_mm
    if across is None and up is None:
        scale = LONGER_FRAME_MM / max(width, height)
    elif across is not None:
        scale = across / width
    else:
        assert up is not None
        scale = up / height
    return view.model_copy(
        update={
            "frame_width_mm": width * scale if across is None else across,
            "frame_height_mm": height * scale if up is None else up,
        }
    )


def resolve(scene: Scene, sizes: Sequence[tuple[int, int]] | None = None) -> Scene:
    """The scene with printer and material merged from their data files.

    Keys that the scene gives itself in [printer] and [material] win over the data file.

    Args:
        scene: as read.
        sizes: (width, height) in pixels of each view's picture; where given, the frames are
            resolved too (180 mm on the longer side by default).

    Raises:
        InputError: a printer or material that has no data file, naming those that have.
    """
    update: dict[str, Any] = {
        "printer": _filled(scene.printer, printers(), "printer"),
        "material": _filled(scene.material, materials(), "material"),
    }
    if sizes is not None:
        pairs = zip(scene.views, sizes, strict=True)
        update["views"] = tuple(_framed(view, size) for view, size in pairs)
    return scene.model_copy(update=update)
