"""From the words of the command line to a scene and the files it names."""

from __future__ import annotations

import math
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

from knotfab.errors import InputError
from knotfab.scene.model import Scene
from knotfab.verify.checks import CHECKS
from knotfab.verify.verifier import Files

__all__ = ["CHECKS", "files_to_validate", "scene_of", "seconds_of", "skips_of"]

_UNITS = {"mm": "millimetres", "s": "seconds"}


def _number(name: str, text: str, unit: str, words: tuple[str, ...]) -> Any:
    """A positive number, or one of the words."""
    plain = text.strip().lower()
    if plain in words:
        return plain
    value = plain.removesuffix(unit).strip()
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise InputError(
            f"{name} {text}",
            "it is not a positive number",
            f"Give {_UNITS[unit]}, such as {name} 2, or {' or '.join(words)}."
            if words
            else f"Give {_UNITS[unit]}, such as {name} 30.",
        )
    return number


def seconds_of(text: str) -> float:
    """`30`, `30s` -> 30.0."""
    return float(_number("--time-budget", text, "s", ()))


def skips_of(names: Collection[str]) -> frozenset[str]:
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


def scene_of(
    path: Path | None,
    *,
    accuracy: str | None = None,
    tube_radius: str | None = None,
    depth: str | None = None,
    knots: str | None = None,
    knot: str | None = None,
    printer: str | None = None,
    material: str | None = None,
    mount: str | None = None,
    seed: int | None = None,
    search: str | None = None,
    free_view: bool = False,
    invert: bool = False,
) -> tuple[Scene, Path | None]:
    """The scene of a file (or the default one) with the command line's shorthands over it.

    Returns the scene and the folder that its pictures are relative to.
    """
    from knotfab.scene.catalogue import material_of, printer_of
    from knotfab.scene.load import check_scene, load_scene

    scene = load_scene(path) if path is not None else Scene()
    piece: dict[str, Any] = {}
    if tube_radius is not None:
        piece["tube_radius_mm"] = _number("--tube-radius", tube_radius, "mm", ("auto",))
    if depth is not None:
        piece["depth"] = _number("--depth", depth, "mm", ("auto", "flat"))
    if knots is not None:
        if knots != "auto" and not (knots.isdecimal() and int(knots) > 0):
            raise InputError(
                f"--knots {knots}",
                "it is neither auto nor a number",
                "Use auto (one knot a piece of the picture), or how many knots its pieces are bridged into.",
            )
        piece["knots"] = knots if knots == "auto" else int(knots)
    if knot is not None:
        piece["knot"] = knot
    update: dict[str, Any] = {}
    if piece:
        update["piece"] = scene.piece.model_copy(update=piece)
    if accuracy is not None:
        update["accuracy"] = scene.accuracy.model_copy(update={"name": accuracy})
        if accuracy != scene.accuracy.name:
            update["search"] = {}  # another preset: the settings of the old one go
    if printer is not None:
        update["printer"] = printer_of(printer)
    if material is not None:
        update["material"] = material_of(material)
    if mount is not None:
        update["mount"] = scene.mount.model_copy(update={"kind": mount})
    if seed is not None:
        if seed < 0:
            raise InputError(f"--seed {seed}", "it is negative", "Use a whole number from 0")
        update["search"] = {**update.get("search", scene.search), "seed": seed}
    if search is not None:
        update["search"] = {**update.get("search", scene.search), "method": search}
    if free_view:
        update["search"] = {**update.get("search", scene.search), "free_view": True}
    if invert:
        update["views"] = tuple(v.model_copy(update={"invert": True}) for v in scene.views)
    scene = scene.model_copy(update=update)
    check_scene(scene, "the command line" if path is None else str(path))
    return scene, None if path is None else path.resolve().parent


def files_to_validate(
    part: Path | None, knots: Path | None, scene: Path | None, failures: Path | None = None
) -> Files:
    """The files of a call: a folder stands for the part, knots and scene in it.

    Failures are drawn beside what is measured, unless another place is named.

    Raises:
        InputError: nothing is given, or something named is not there.
    """
    if part is not None and part.is_dir():
        folder = part
        part = folder / "part.stl"
        knots = knots or _if_there(folder / "knots.json")
        scene = scene or _if_there(folder / "scene.toml")
        if (folder / "part-01.stl").is_file() and not part.is_file():
            raise InputError(
                str(folder),
                "it holds a sequence, a part for each frame",
                f"Name one: knotfab validate {folder / 'part-01.stl'} --knots "
                f"{folder / 'knots-01.json'} --scene {folder / 'scene-01.toml'}",
            )
        if not part.is_file():
            raise InputError(
                str(folder), "it holds no part.stl", "Name a folder that a build wrote"
            )
    if part is None and knots is None:
        raise InputError(
            "the call",
            "there is nothing to validate",
            "Name a folder, a part, or --knots knots.json",
        )
    for path in (part, knots, scene):
        if path is not None and not path.is_file():
            raise InputError(str(path), "there is no such file", "Check the path")
    if failures is None:
        failures = _beside(part or knots)
    elif failures.suffix.lower() != ".png":
        raise InputError(
            f"--failures {failures}", "failures are drawn as PNG", "Name a file in .png."
        )
    return Files(part, knots, scene, failures=failures)


def _beside(measured: Path | None) -> Path | None:
    """NAME-failures.png beside a file, where one may write there."""
    if measured is None or not os.access(measured.parent, os.W_OK):
        return None
    return measured.with_name(f"{measured.stem}-failures.png")


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None
