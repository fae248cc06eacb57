"""Printers and materials by name, and a scene completed with their figures."""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, TypeVar

from platformdirs import user_config_path

from knotfab.base.disk import at_home, own_folder, read_text
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material, Printer
from knotfab_formats.read import parse_toml
from knotfab_formats.scene import ResolvedPrinter, ResolvedScene, Scene
from knotfab_formats.struck import refuse_value

_USUAL_MATERIALS = {"filament": "pla", "resin": "resin", "powder": "pa12"}
_USUAL_PRINTERS = {"filament": "prusa-mk4", "resin": "form-3", "powder": "hp-mjf"}


def printers() -> dict[str, Printer]:
    """Return all printers with a data file, by name.

    Raises:
        InputError: a user's own file does not describe one.
    """
    return {name: load_named(Printer, name) for name in known_names("printer")}


def materials() -> dict[str, Material]:
    """Return all materials with a data file, by name; raises as `printers` does."""
    return {name: load_named(Material, name) for name in known_names("material")}


def asked_for(model: type[Named], text: str) -> Named:
    """Return the printer or material of a name, which `resolve` completes later, or of a file.

    Raises:
        InputError: the file does not describe one.
    """
    return load_file(model, Path(text)) if is_file_name(text) else model(name=text)


def _fill_in(own: Named) -> Named:
    """Complete `own` with the data file's figures for keys that the scene does not set."""
    written = {key: getattr(own, key) for key in own.model_fields_set if key != "name"}
    keys = set(type(own).model_fields) - {"name"}
    if keys <= set(written):
        return own  # a build writes scenes so: complete, so that no data file can change them
    kind = kind_of(type(own))
    refuse_value(kind, "name", own.name, f"{kind} {own.name!r}")
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


NOZZLES_MM = 0.1, 1.2  # that filament is printed with


def with_nozzle(printer: Printer, nozzle_mm: float) -> Printer:
    """Return a printer with another nozzle, to which its layer, walls and thinnest tube are in proportion.

    Raises:
        InputError: the printer has no nozzle, or there is none of that width.
    """
    known = _fill_in(printer)
    if known.process != "filament":
        why = f"{known.name} prints {known.process} and has no nozzle"
        raise InputError(f"--nozzle {nozzle_mm:g}", why, "Leave it out")
    if not NOZZLES_MM[0] <= nozzle_mm <= NOZZLES_MM[1]:
        why = "there is no such nozzle"
        raise InputError(f"--nozzle {nozzle_mm:g}", why, "Give one such as 0.25, 0.4, 0.6 or 0.8")
    share = nozzle_mm / known.nozzle_mm
    keys = "layer_height_mm", "min_tube_radius_mm", "min_wall_mm", "min_gap_mm"
    scaled = {key: getattr(known, key) for key in keys}
    told = {key: round(share * mm, 4) for key, mm in scaled.items() if mm is not None}
    return printer.but(nozzle_mm=nozzle_mm, **told)


def _fill_in_open(printer: Printer) -> ResolvedPrinter:
    """Derive figures that the printer leaves open: most support volume, least wall and gap."""
    width, depth, height = printer.build_volume_mm
    usual = {
        "max_support_cm3": width * depth * height / 1000,
        "min_wall_mm": printer.nozzle_mm,
        "min_gap_mm": printer.nozzle_mm,
    }
    known = {key: getattr(printer, key) for key in printer.model_fields_set}
    return ResolvedPrinter(**usual | {key: x for key, x in known.items() if x is not None})


def _find_material(own: Material, printer: Printer) -> Material:
    """Return the scene's material with its figures, or else the printer's usual one.

    Raises:
        InputError: the printer does not print with such a material.
    """
    if "name" not in own.model_fields_set:
        own = own.but(name=_USUAL_MATERIALS[printer.process])
    found = _fill_in(own)
    if found.process != printer.process:
        raise InputError(
            f"material {found.name!r}",
            f"printer {printer.name!r} prints with {printer.process}, and this is {found.process}",
            f"Name another one (--material {_USUAL_MATERIALS[printer.process]}), or a printer of "
            f"{found.process} (--printer {_USUAL_PRINTERS[found.process]})",
        )
    return found


def resolve(scene: Scene) -> ResolvedScene:
    """Complete the scene for a build: printer and material are merged with their data files.

    Keys that the scene gives itself in [printer] and [material] win over the data file. Unless the scene
    says otherwise, the printer prints the gaps between strands (powder comes out of them), and a piece that
    stands in a plate needs no supports.

    Raises:
        InputError: a printer or material that has no data file, naming those that have; a user's own
            file of that name is wrong; or the printer does not print with the material.
    """
    printer = _fill_in_open(_fill_in(scene.printer))
    material = _find_material(scene.material, printer)
    piece: dict[str, Any] = {}
    if "clearance_mm" not in scene.piece.model_fields_set:
        piece["clearance_mm"] = max(scene.piece.clearance_mm, printer.min_gap_mm)
    if scene.mount.on_feet and "supports" not in scene.piece.model_fields_set:
        piece["supports"] = "none"  # arches stand in the plate
    update = {"printer": printer, "material": material, "piece": scene.piece.but(**piece)}
    known = {
        key: getattr(scene, key) for key in scene.model_fields_set - update.keys() - {"schema_"}
    }
    kind = type(scene) if isinstance(scene, ResolvedScene) else ResolvedScene
    return kind.model_construct(None, **known | update)


# Printers and materials as TOML files, bundled or a person's own, checked key by key.

Kind = Literal["printer", "material"]
Named = TypeVar("Named", Printer, Material)

# Usual values for most printers and materials, which a person's own file may leave out.
USUAL = {"layer_height_mm", "supports", "max_overhang_deg", "max_bridge_mm", "max_support_cm3"}
USUAL |= {"process", "color", "min_wall_mm", "min_gap_mm"}
USUAL |= {"young_modulus_mpa", "yield_mpa"}
USUAL |= {"shrinkage_percent"}


_FOR_PEOPLE = ("title", "aliases")  # keys of a data file that the model does not have


def data_folder() -> Path:
    """Return the folder of the user's own data: $KNOTFAB_DATA, else the system's settings folder."""
    return own_folder("KNOTFAB_DATA", user_config_path, "$KNOTFAB_DATA")


def kind_of(model: type[Printer] | type[Material]) -> Kind:
    """Return the name of the model's table in a scene."""
    return "printer" if model is Printer else "material"


def is_file_name(text: str) -> bool:
    """Return whether a printer or material is given as a file, not by its name."""
    return text.endswith(".toml") or "/" in text or os.sep in text


@cache
def _list_supplied(kind: Kind) -> dict[str, dict[str, Any]]:
    """Return the content of each bundled data file by name, without its title."""
    files = resources.files("knotfab.scene").joinpath("data", f"{kind}s").iterdir()
    found: dict[str, dict[str, Any]] = {}
    for file in sorted(files, key=lambda f: f.name):
        if file.name.endswith(".toml"):
            found[file.name.removesuffix(".toml")] = tomllib.loads(file.read_text(encoding="utf-8"))
    return found


def title_of(kind: Kind, name: str) -> str:
    """Return the usual name of the printer or material of this name: "Bambu Lab P1S" for bambu-p1s."""
    return str(_list_supplied(kind).get(name, {}).get("title", name))


def find_name(kind: Kind, text: str) -> str:
    """Match `text` to a known name; return `text` itself where no name or several match.

    Case, spaces, hyphens and a maker's name before it do not matter: "Bambu P1S", "P1S", "pla".
    """
    names = known_names(kind)
    if text in names:
        return text
    meant = _squeeze(text)
    ways: dict[str, set[str]] = {}
    for name in names:
        table = _list_supplied(kind).get(name, {})
        for way in (name, table.get("title", name), *table.get("aliases", ())):
            words = re.split(r"[\s_-]+", way)
            for start in range(len(words)):  # with and without the maker's name
                ways.setdefault(_squeeze("".join(words[start:])), set()).add(name)
    exact = [name for name in names if _squeeze(name) == meant]
    found = exact or list(ways.get(meant, ()))
    return found[0] if len(found) == 1 else text


def _squeeze(text: str) -> str:
    """Return the letters and digits of a text, in lower case."""
    return "".join(c for c in text.lower() if c.isalnum())


def _own_files(kind: Kind) -> dict[str, Path]:
    """Return the user's own files by name; empty if their folder does not exist."""
    folder = data_folder() / f"{kind}s"
    try:
        return {path.stem: path for path in sorted(folder.glob("*.toml"))}
    except OSError:
        return {}


def known_names(kind: Kind) -> list[str]:
    """Return the names of all printers or materials that have a file."""
    return sorted({*_list_supplied(kind), *_own_files(kind)})


def load_named(model: type[Named], name: str) -> Named:
    """Load a printer or material by name, the user's own before a bundled one.

    Raises:
        InputError: the user's file does not describe one.
    """
    own = _own_files(kind_of(model)).get(name)
    if own is not None:
        return load_file(model, own)
    table = _list_supplied(kind_of(model))[name]
    return model(name=name, **{k: v for k, v in table.items() if k not in _FOR_PEOPLE})


def load_file(model: type[Named], path: Path) -> Named:
    """Load a complete printer or material from a file; its name is the file's.

    Its keys are those of [printer] or [material] in a scene; they may stand below such a header.
    Those of `USUAL` may be left out for the model's defaults.

    Raises:
        InputError: the file cannot be read, is not TOML, or a key is missing, unknown or impossible.
    """
    what, kind = str(path), kind_of(model)
    missing = f"Check the path, or name one of: {', '.join(known_names(kind))}."
    raw = parse_toml(read_text(at_home(path), what, missing=missing), what)
    for key in _FOR_PEOPLE:
        raw.pop(key, None)
    table = raw[kind] if set(raw) == {kind} and isinstance(raw[kind], dict) else raw
    if "name" in table:
        raise InputError(
            what, f"it gives a name, but a {kind} is named after its file", "Leave name out."
        )
    try:
        checked = getattr(Scene.model_validate({kind: table}, context=what), kind)
    except InputError as error:
        why = error.why.replace(f"[{kind}] has", f"a {kind} has").replace(f"[{kind}] ", "")
        raise InputError(what, why, error.remedy) from error
    lacking = [k for k in model.model_fields if k not in table and k not in USUAL | {"name"}]
    if lacking:
        example = _list_supplied(kind)["prusa-mk4" if kind == "printer" else "pla"]
        shown_as = {k: f'"{v}"' if isinstance(v, str) else str(v) for k, v in example.items()}
        lines = ", ".join(f"{key} = {shown_as[key]}" for key in lacking)
        raise InputError(
            what, f"it lacks {', '.join(lacking)}", f"Add what it lacks, such as {lines}."
        )
    return model(**{**checked.model_dump(), "name": path.stem})
