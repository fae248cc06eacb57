"""Put a call's options into its scene."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from knotfab.base.disk import at_home
from knotfab.pipeline.options import KEYS, READERS, PlanOptions
from knotfab.report.summary import CHECKS
from knotfab_formats.bounds import values_of
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material, Printer
from knotfab_formats.scene import ResolvedScene, Scene
from knotfab_formats.search import OF_NO_PRESET, SearchSettings, search_settings
from knotfab_formats.struck import pass_keys
from knotfab_formats.views import Switches


def read_skips(names: Collection[str]) -> frozenset[str]:
    """Check the names given to `--skip`.

    Raises:
        InputError: there is no such check.
    """
    for name in names:
        if name not in CHECKS:
            raise InputError(
                f"--skip {name}", "there is no such check", f"Known: {', '.join(CHECKS)}."
            )
    return frozenset(names)


def read_scene(options: PlanOptions) -> tuple[ResolvedScene, Path | None]:
    """Read the scene file, or take the default scene, apply the options to it, and resolve it.

    Returns:
        The scene, and the folder that its pictures are relative to.

    Raises:
        InputError: an option or the scene is wrong, they contradict each other, or a printer or material is
            unknown.
    """
    from knotfab.scene.catalogue import asked_for, resolve, with_nozzle
    from knotfab.scene.load import check_scene, load_scene

    path = options.scene
    scene = load_scene(path) if path is not None else Scene()
    given = {table: _list_given_keys(options, model) for table, model in KEYS.items()}
    views, search = given.pop("views") | _frame_keys(options), scene.search
    if "knots" in given["piece"]:
        given["piece"]["knots_asked"] = True
    update: dict[str, Any] = {
        table: getattr(scene, table).but(**keys)
        for table, keys in given.items()
        if keys and table != "search"
    }
    if given["accuracy"].get("name", scene.accuracy.name) != scene.accuracy.name:
        # another accuracy replaces all settings that a build wrote, but not a user's few
        search_settings(scene.accuracy.name, search)  # refuses unknown keys
        if search.keys() >= SearchSettings.model_fields.keys():
            search = {key: value for key, value in search.items() if key in OF_NO_PRESET}
    update["search"] = {**search, **given["search"], **_search_keys(options)}
    if options.printer is not None:
        update["printer"] = asked_for(Printer, options.printer)
    if options.nozzle is not None:
        update["printer"] = with_nozzle(update.get("printer", scene.printer), options.nozzle)
    if options.material is not None:
        update["material"] = asked_for(Material, options.material)
    if options.no_loop:
        update["sequence"] = scene.sequence.but(loop=False)
    if options.effect:
        update["effects"] = scene.effects.but(**_read_switches(options.effect))
    if views:
        update["views"] = tuple(v.but(**views) for v in scene.views)
    scene = scene.but(**update)
    check_scene(scene, "the command line" if path is None else str(path))
    _ = scene.settings  # refuses wrong search settings
    return resolve(scene), None if path is None else path.resolve().parent


def _list_given_keys(options: PlanOptions, model: type[BaseModel]) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    for name, reader in READERS.items():
        table, key = reader.args
        value = getattr(options, name, None)
        if table is model and value is not None and value is not False and value != ():
            keys[key] = values_of(model, key).get(value, value)
    return keys


def _frame_keys(options: PlanOptions) -> dict[str, Any]:
    """Return the frame's sides; if only one is given, the other follows from the picture."""
    sided = options.width is not None or options.height is not None
    if options.size is not None and sided:
        other = "--height" if options.width is None else "--width"
        raise InputError(f"--size {options.size:g}", f"{other} is given too", "Give one of them.")
    if sided or options.size is not None:  # which side is longer is known only with the picture
        return {"frame_width_mm": options.width, "frame_height_mm": options.height}
    return {}


def _read_switches(texts: Collection[str]) -> dict[str, Any]:
    """Return the keys of [effects] that `--effect NAME=on|off|auto` set; the last one of a name counts."""
    known, keys = list(Switches.model_fields), {}
    for text in texts:
        name, _, word = (part.strip().lower() for part in text.partition("="))
        if not pass_keys({"effects": {name: word}}, f"--effect {text}")["effects"]:
            continue  # struck, and it asks for nothing
        if name not in known:
            raise InputError(
                f"--effect {text}", "there is no such effect", f"Known: {', '.join(known)}."
            )
        words = values_of(Switches, name)
        if word not in words:
            remedy = f"Write --effect {name}=on, {name}=off or {name}=auto."
            raise InputError(f"--effect {text}", "it is neither on, off nor auto", remedy)
        keys[name] = words[word]
    return keys


def _search_keys(options: PlanOptions) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    if options.start is not None:
        keys["start"] = str(at_home(options.start).absolute())
    if options.free == "view":
        keys["free_view"] = True
    return keys
