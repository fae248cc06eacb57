"""Printers and materials that are known by name, and a scene with their figures filled in."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from knotfab.base.errors import InputError
from knotfab.scene.own_data import (
    USUAL,
    Named,
    data_folder,
    find_name,
    is_file_name,
    kind_of,
    known_names,
    load_file,
    load_named,
)
from knotfab_formats.scene import Material, Printer, ResolvedPrinter, ResolvedScene, Scene

__all__ = ["asked_for", "materials", "printers", "resolve"]

_USUAL_MATERIALS = {"filament": "pla", "resin": "resin", "powder": "pa12"}


def printers() -> dict[str, Printer]:
    """Return all printers with a data file, by name.

    Raises:
        InputError: a person's own file is none.
    """
    return {name: load_named(Printer, name) for name in known_names("printer")}


def materials() -> dict[str, Material]:
    """Return all materials with a data file, by name; raises as `printers` does."""
    return {name: load_named(Material, name) for name in known_names("material")}


def asked_for(model: type[Named], text: str) -> Named:
    """Return the printer or material of a name, whose figures `resolve` fills in, or of a file, whole.

    Raises:
        InputError: the file is no such thing.
    """
    return load_file(model, Path(text)) if is_file_name(text) else model(name=text)


def _fill_in(own: Named) -> Named:
    """Return `own` with the data file's figures wherever the scene did not give a key itself."""
    written = {key: getattr(own, key) for key in own.model_fields_set if key != "name"}
    keys = set(type(own).model_fields) - {"name"}
    if keys <= set(written):
        return own  # a build writes it so: no file is needed, and none can change it
    kind = kind_of(type(own))
    name = find_name(kind, own.name)
    if name not in known_names(kind):
        if keys - USUAL <= set(written):
            return own  # complete without a data file
        known, typed = known_names(kind), own.name.strip().lower().replace(" ", "-")
        close = [name for name in known if typed and typed in name.split("-")]
        close = close or difflib.get_close_matches(typed, known, n=1)
        hint = f"Did you mean {' or '.join(map(repr, close))}? " if close else ""
        raise InputError(
            f"{kind} {own.name!r}",
            f"there is no such {kind}",
            f"{hint}Known: {', '.join(known)}; or give a file (--{kind} FILE.toml), put one into "
            f"{data_folder() / f'{kind}s'}, or give every key of [{kind}] in the scene.",
        )
    return type(own)(**{**load_named(type(own), name).model_dump(), **written})


def _fill_in_open(printer: Printer) -> ResolvedPrinter:
    """Fill in the printer's numbers: supports have its room, walls and gaps its nozzle's width."""
    width, depth, height = printer.build_volume_mm
    usual = {
        "max_support_cm3": width * depth * height / 1000,
        "min_wall_mm": printer.nozzle_mm,
        "min_gap_mm": printer.nozzle_mm,
    }
    known = {key: getattr(printer, key) for key in printer.model_fields_set}
    return ResolvedPrinter(**usual | {key: x for key, x in known.items() if x is not None})


def _find_material(own: Material, printer: Printer) -> Material:
    """Find the scene's material with its figures; where it names none, the usual one of the printer.

    Raises:
        InputError: the printer does not print with such a material.
    """
    if not own.model_fields_set:
        own = Material(name=_USUAL_MATERIALS[printer.process])
    found = _fill_in(own)
    if found.process not in ("wire", printer.process) and "powder" in (
        found.process,
        printer.process,
    ):
        raise InputError(
            f"material {found.name!r}",
            f"printer {printer.name!r} prints with {printer.process}, and this is {found.process}",
            f"Name another one, such as {_USUAL_MATERIALS[printer.process]}.",
        )
    return found


def resolve(scene: Scene) -> ResolvedScene:
    """Return the scene as a build takes it: printer and material are merged from their data files.

    Keys that the scene gives itself in [printer] and [material] win over the data file. Unless the scene
    says otherwise, a tube of wire is as thick as the wire, and powder comes out between strands.

    Raises:
        InputError: a printer or material that has no data file, naming those that have; a person's
            own file of that name is wrong; or the one does not go with the other.
    """
    printer = _fill_in_open(_fill_in(scene.printer))
    material = _find_material(scene.material, printer)
    piece: dict[str, Any] = {}
    if material.process == "wire" and scene.piece.tube_radius_mm is None:
        piece["tube_radius_mm"] = 0.5 * material.wire_diameter_mm
    if material.process == "powder" and "clearance_mm" not in scene.piece.model_fields_set:
        piece["clearance_mm"] = max(scene.piece.clearance_mm, printer.min_gap_mm)
    update = {
        "printer": printer,
        "material": material,
        "piece": scene.piece.but(**piece),
    }
    known = {
        key: getattr(scene, key) for key in scene.model_fields_set - update.keys() - {"schema_"}
    }
    kind = type(scene) if isinstance(scene, ResolvedScene) else ResolvedScene
    return kind.model_construct(None, **known | update)
