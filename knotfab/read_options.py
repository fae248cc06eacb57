"""From the words of a call to a scene: numbers with units, times, names of checks."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

from knotfab.errors import InputError
from knotfab.options import BuildOptions
from knotfab.scene.model import Scene
from knotfab.verify.checks import CHECKS

__all__ = ["read_scene", "read_seconds", "read_skips"]

_TIME = re.compile(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)\s*")
_SECONDS = {"": 1.0}
_SECONDS |= dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0)
_SECONDS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0)
_SECONDS |= dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0)


def _millimetres(name: str, text: str, words: tuple[str, ...]) -> Any:
    """A positive length, or one of the words."""
    plain = text.strip().lower()
    if plain in words:
        return plain
    try:
        number = float(plain.removesuffix("mm").strip())
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        remedy = f"Give millimetres, such as {name} 2, or {' or '.join(words)}."
        raise InputError(f"{name} {text}", "it is not a positive number", remedy)
    return number


def read_seconds(text: str, name: str = "--time-budget") -> float:
    """Read a time: `30`, `90s`, `90sec`, `1.5min`, `1m`, `1m30s`, `1h`, in seconds.

    Args:
        name: of the option, for the message.

    Raises:
        InputError: it is no time, or none that is positive.
    """
    plain = text.strip().lower()
    parts = _TIME.findall(plain)
    if "".join(_TIME.sub("", plain).split()) or any(unit not in _SECONDS for _, unit in parts):
        parts = []
    if len(parts) > 1 and any(unit == "" for _, unit in parts):
        parts = []  # "1 30": minutes and seconds, or a slip?
    seconds = sum(float(number) * _SECONDS[unit] for number, unit in parts)
    if not seconds > 0 or not math.isfinite(seconds):
        raise InputError(
            f"{name} {text}",
            "it is not a positive time",
            f"Give seconds or minutes, such as {name} 30, 90s, 1.5min or 1m30s.",
        )
    return seconds


def read_skips(names: Collection[str]) -> frozenset[str]:
    """The checks of `--skip`, each known by name.

    Raises:
        InputError: there is no such check.
    """
    for name in names:
        if name not in CHECKS:
            raise InputError(
                f"--skip {name}", "there is no such check", f"Known: {', '.join(CHECKS)}."
            )
    return frozenset(names)


def read_scene(options: BuildOptions) -> tuple[Scene, Path | None]:
    """The scene of a file (or the default one) with the command line's shorthands over it.

    Returns the scene and the folder that its pictures are relative to.

    Raises:
        InputError: an option or the scene is wrong, or they contradict each other.
    """
    from knotfab.scene.catalogue import material_of, printer_of
    from knotfab.scene.load import check_scene, load_scene

    path = options.scene
    scene = load_scene(path) if path is not None else Scene()
    update: dict[str, Any] = {}
    if piece := _piece_keys(options):
        update["piece"] = scene.piece.model_copy(update=piece)
    own, accuracy = scene.search, scene.accuracy
    if options.accept is not None:
        accuracy = accuracy.model_copy(update={"accept": (options.accept,)})
    if options.accuracy is not None:
        accuracy = accuracy.model_copy(update={"name": options.accuracy})
        if options.accuracy != scene.accuracy.name:
            own = {}  # another preset: the settings of the old one go
    update["accuracy"] = accuracy
    update["search"] = {**own, **_search_keys(options)}
    if options.printer is not None:
        update["printer"] = printer_of(options.printer)
    if options.material is not None:
        update["material"] = material_of(options.material)
    if options.mount is not None:
        update["mount"] = scene.mount.model_copy(update={"kind": options.mount})
    if options.invert:
        update["views"] = tuple(v.model_copy(update={"invert": True}) for v in scene.views)
    scene = scene.model_copy(update=update)
    check_scene(scene, "the command line" if path is None else str(path))
    return scene, None if path is None else path.resolve().parent


def _piece_keys(options: BuildOptions) -> dict[str, Any]:
    """The keys of [piece] that the options give."""
    keys: dict[str, Any] = {}
    if options.tube_radius is not None:
        keys["tube_radius_mm"] = _millimetres("--tube-radius", options.tube_radius, ("auto",))
    if options.depth is not None:
        keys["depth"] = _millimetres("--depth", options.depth, ("auto", "flat"))
    if options.knots is not None:
        if options.knots != "auto" and not (options.knots.isdecimal() and int(options.knots) > 0):
            raise InputError(
                f"--knots {options.knots}",
                "it is neither auto nor a number",
                "Use auto (one knot a piece of the picture), or how many knots its pieces are bridged into.",
            )
        keys["knots"] = "auto" if options.knots == "auto" else int(options.knots)
    if options.knot is not None:
        keys["knot"] = options.knot
    return keys


def _search_keys(options: BuildOptions) -> dict[str, Any]:
    """The keys of [search] that the options give."""
    keys: dict[str, Any] = {}
    if options.seed is not None:
        if options.seed < 0:
            raise InputError(
                f"--seed {options.seed}", "it is negative", "Use a whole number from 0"
            )
        keys["seed"] = options.seed
    if options.search is not None:
        keys["method"] = options.search
    if options.free == "view":
        keys["free_view"] = True
    return keys
