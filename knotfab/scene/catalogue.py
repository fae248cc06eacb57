"""Printers and materials that are known by name, and a scene with their figures filled in."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar

from knotfab.errors import InputError
from knotfab.scene.model import Material, Printer, Scene
from knotfab.scene.own_data import (
    USUAL,
    Kind,
    data_folder,
    is_file_name,
    known_names,
    load_file,
    load_named,
)

__all__ = [
    "material_of",
    "materials",
    "printer_of",
    "printers",
    "resolve",
]

Named = TypeVar("Named", Printer, Material)


def printers() -> dict[str, Printer]:
    """All printers with a data file, by name.

    Raises:
        InputError: a person's own file is none.
    """
    found = {name: load_named("printer", name) for name in known_names("printer")}
    return {name: one for name, one in found.items() if isinstance(one, Printer)}


def materials() -> dict[str, Material]:
    """All materials with a data file, by name.

    Raises:
        InputError: a person's own file is none.
    """
    found = {name: load_named("material", name) for name in known_names("material")}
    return {name: one for name, one in found.items() if isinstance(one, Material)}


def printer_of(text: str) -> Printer:
    """The printer of a name, whose figures `resolve` fills in, or of a file, whole.

    Raises:
        InputError: the file is no printer.
    """
    if not is_file_name(text):
        return Printer(name=text)
    printer = load_file("printer", Path(text))
    assert isinstance(printer, Printer)
    return printer


def material_of(text: str) -> Material:
    """The material of a name, whose figures `resolve` fills in, or of a file, whole.

    Raises:
        InputError: the file is no material.
    """
    if not is_file_name(text):
        return Material(name=text)
    material = load_file("material", Path(text))
    assert isinstance(material, Material)
    return material


def _fill_in(own: Named, kind: Kind) -> Named:
    """`own` with the data file's figures wherever the scene did not give a key itself."""
    written = {key: getattr(own, key) for key in own.model_fields_set if key != "name"}
    keys = set(type(own).model_fields) - {"name"}
    if keys <= set(written):
        return own  # as a build writes it: no file is needed, and none can change it
    base = load_named(kind, own.name)
    if base is None:
        if keys - USUAL <= set(written):
            return own  # complete without a data file
        known = known_names(kind)
        close = difflib.get_close_matches(own.name, known, n=1)
        hint = f"Did you mean {close[0]!r}? " if close else ""
        raise InputError(
            f"{kind} {own.name!r}",
            f"there is no such {kind}",
            f"{hint}Known: {', '.join(known)}; or give a file (--{kind} FILE.toml), put one into "
            f"{data_folder() / f'{kind}s'}, or give every key of [{kind}] in the scene.",
        )
    return type(own)(**{**base.model_dump(), **written})


def _limit_supports(printer: Printer) -> Printer:
    """The printer with its limit for supports as a number: there is no more room than it has."""
    if printer.max_support_cm3 != "auto":
        return printer
    width, depth, height = printer.build_volume_mm
    return printer.model_copy(update={"max_support_cm3": width * depth * height / 1000})


def resolve(scene: Scene) -> Scene:
    """The scene with printer and material merged from their data files.

    Keys that the scene gives itself in [printer] and [material] win over the data file. A tube of wire
    is as thick as the wire, unless the scene says otherwise.

    Raises:
        InputError: a printer or material that has no data file, naming those that have; or a person's
            own file of that name is wrong.
    """
    update: dict[str, Any] = {
        "printer": _limit_supports(_fill_in(scene.printer, "printer")),
        "material": _fill_in(scene.material, "material"),
    }
    wire = update["material"]
    if wire.process == "wire" and scene.piece.tube_radius_mm == "auto":
        radius = {"tube_radius_mm": 0.5 * wire.wire_diameter_mm}
        update["piece"] = scene.piece.model_copy(update=radius)
    return scene.model_copy(update=update)
