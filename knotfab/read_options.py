"""From the words of a call to a scene: numbers with units, times, names of checks."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel

from knotfab.base.disk import at_home
from knotfab.base.errors import InputError
from knotfab.base.lengths import read_length
from knotfab.options import BuildOptions
from knotfab.verify.checks import CHECKS
from knotfab_formats.bounds import why_out_of_bounds
from knotfab_formats.scene import MOST_BEND, About, Piece, Scene, Switch, Switches, View
from knotfab_formats.search import OF_NO_PRESET, search_settings

__all__ = ["read_also", "read_scene", "read_seconds", "read_skips"]

Format = Literal["svg", "dxf", "step", "gcode"]
_TIME = re.compile(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)\s*")
_MOST_S = 100 * 86400.0
_SECONDS = {"": 1.0}
_SECONDS |= dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0)
_SECONDS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0)
_SECONDS |= dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0)


def _millimetres(name: str, text: str, words: tuple[str, ...]) -> Any:
    """A positive length, or one of the words."""
    plain = text.strip().lower()
    if plain in words:
        return plain
    remedy = f"Give millimetres, such as {name} 2, or {' or '.join(words)}."
    number = read_length(f"{name} {text}", plain, remedy)
    if number <= 0:
        raise InputError(f"{name} {text}", "it is not above 0", remedy)
    _check_bounds(Piece, "tube_radius_mm", number, f"{name} {text}")  # as all lengths
    return number


def read_seconds(text: str, name: str = "--time-budget") -> float:
    """Read a time: `30`, `90s`, `90sec`, `1.5min`, `1m`, `1m30s`, `1h`, in seconds.

    Args:
        name: of the option, for the message.

    Raises:
        InputError: it is no time, or none that is positive.
    """
    plain = re.sub(r"(?<=\d),(?=\d)", ".", text.strip().lower())
    parts = _TIME.findall(plain)
    if "".join(_TIME.sub("", plain).split()) or any(unit not in _SECONDS for _, unit in parts):
        parts = []
    if len(parts) > 1 and any(unit == "" for _, unit in parts):
        parts = []  # "1 30": minutes and seconds, or a slip?
    seconds = sum(float(number) * _SECONDS[unit] for number, unit in parts)
    if not 0 < seconds <= _MOST_S:
        raise InputError(
            f"{name} {text}",
            "it is longer than 100 days" if seconds > 0 else "it is not a positive time",
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


def read_also(texts: Collection[str]) -> frozenset[str]:
    """The formats of `--also`, commas between them.

    Raises:
        InputError: there is no such format.
    """
    names = frozenset(name.strip().lower() for text in texts for name in text.split(","))
    for name in sorted(names - set(get_args(Format))):
        known = ", ".join(get_args(Format))
        raise InputError(f"--also {name}", "there is no such format", f"Known: {known}.")
    return names


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
            # another preset: the settings of the old one go
            search_settings(scene.accuracy.name, own)  # what is none is told
            own = {key: value for key, value in own.items() if key in OF_NO_PRESET}
    update["accuracy"] = accuracy
    update["search"] = {**own, **_search_keys(options)}
    if options.printer is not None:
        update["printer"] = printer_of(options.printer)
    if options.material is not None:
        update["material"] = material_of(options.material)
    if options.mount is not None:
        update["mount"] = scene.mount.model_copy(update={"kind": options.mount})
    if options.no_loop:
        update["sequence"] = scene.sequence.model_copy(update={"loop": False})
    told = {key: getattr(options, key) for key in ("title", "designer", "licence")}
    if told := {key: text for key, text in told.items() if text is not None}:
        for key, text in told.items():
            if why_out_of_bounds(About, key, text) is not None:
                why, remedy = "it is no line of text", "Give one line of at most 200 signs."
                raise InputError(f"--{key} {text[:40]!r}", why, remedy)
        update["about"] = scene.about.model_copy(update=told)
    if options.effect:
        update["effects"] = scene.effects.model_copy(update=_switches(options.effect))
    if keys := _view_keys(options):
        update["views"] = tuple(v.model_copy(update=keys) for v in scene.views)
    scene = scene.model_copy(update=update)
    check_scene(scene, "the command line" if path is None else str(path))
    return scene, None if path is None else path.resolve().parent


def _switches(texts: Collection[str]) -> dict[str, Any]:
    """The keys of [effects] that `--effect NAME=on|off|auto` gives; of a name twice the last counts."""
    known, keys = list(Switches.model_fields), {}
    for text in texts:
        name, _, word = (part.strip().lower() for part in text.partition("="))
        if name not in known:
            raise InputError(
                f"--effect {text}", "there is no such effect", f"Known: {', '.join(known)}."
            )
        if word not in get_args(Switch):
            remedy = f"Write --effect {name}=on, {name}=off or {name}=auto."
            raise InputError(f"--effect {text}", "it is neither on, off nor auto", remedy)
        keys[name] = word
    return keys


def _view_keys(options: BuildOptions) -> dict[str, Any]:
    """The keys of [[views]] that the options give: how pictures are read, and where they stand."""
    given: dict[str, Any] = {
        "invert": options.invert or None,
        "ink": None if options.ink is None else _ink(options.ink),
        "threshold": options.threshold,
        "crop_px": None if options.crop is None else _crop(options.crop),
        **_subject(options),
        "keep_largest": options.keep_largest,
        "speck_px": options.specks,
        "smooth_px": options.smooth,
        "lines": options.lines,
        "tone": options.tone,
        "light_distance_mm": options.lamp_distance,
        "wall_distance_mm": options.wall_distance,
        "light_diameter_mm": options.lamp_diameter,
    }
    if options.thicken is not None:
        given["thicken_mm"] = _millimetres("--thicken", options.thicken, ("auto",))
    keys = {key: value for key, value in given.items() if value is not None}
    if options.width is not None or options.height is not None:
        # one side alone: the other follows from the picture, whatever the scene had
        keys |= {"frame_width_mm": options.width, "frame_height_mm": options.height}
    for key, value in {**keys, "size": options.size}.items():
        _check_view_key(key, value)
    if options.size is not None:
        if options.width is not None or options.height is not None:
            why = "--width or --height is given too"
            raise InputError(f"--size {options.size:g}", why, "Give one of them.")
        keys |= {"frame_width_mm": None, "frame_height_mm": None}  # read_call knows the longer one
    return keys


_OPTIONS = {
    "speck_px": "--specks",
    "frame_width_mm": "--width",
    "frame_height_mm": "--height",
    "light_distance_mm": "--lamp-distance",
    "wall_distance_mm": "--wall-distance",
    "light_diameter_mm": "--lamp-diameter",
}


def _check_view_key(key: str, value: Any) -> None:
    """Refuse a number out of its bounds, by the name of its option.

    Raises:
        InputError: naming the option and its bounds.
    """
    if value is None or isinstance(value, bool | str | tuple):
        return
    option = _OPTIONS.get(key, "--" + key.removesuffix("_px").replace("_", "-"))
    if key == "keep_largest" and value == 0:  # which the scene writes of all
        raise InputError(f"{option} 0", "it is out of bounds", "Give a whole number from 1.")
    _check_bounds(View, "frame_width_mm" if key == "size" else key, value, f"{option} {value:g}")


def _check_bounds(model: type[BaseModel], key: str, value: Any, what: str) -> None:
    """Refuse a value of an option that the scene's key does not take."""
    bounds = why_out_of_bounds(model, key, value)
    if bounds is not None:
        unit = {"mm": "millimetres", "px": "pixels"}.get(key.rpartition("_")[2], "a number")
        raise InputError(what, "it is out of bounds", f"Give {unit} {bounds}.")


def _ink(text: str) -> str:
    """A word of the scene key `ink`, or a colour as #rrggbb."""
    plain = text.strip().lower()
    if plain in ("auto", "dark", "light", "alpha", "flood"):
        return plain
    from PIL import ImageColor

    try:
        return "#{:02x}{:02x}{:02x}".format(*ImageColor.getrgb(plain)[:3])
    except ValueError as error:
        raise InputError(
            f"--ink {text}",
            "it is no colour",
            "Use auto, dark, light, alpha, flood, or a colour such as red or #d02010.",
        ) from error


def _crop(text: str) -> Any:
    """auto, none, or left, top, width and height in px."""
    plain = text.strip().lower()
    if plain in ("auto", "none"):
        return plain
    if box := _whole_px(plain, 4, 2):
        return box
    raise InputError(
        f"--crop {text}",
        "it is no part of a picture",
        "Use auto, or LEFT,TOP,WIDTH,HEIGHT in whole px, such as --crop 20,40,600,400.",
    )


def _whole_px(text: str, count: int, sizes: int) -> tuple[int, ...]:
    """So many whole px, the last of them sizes above 0; () where the text is not that."""
    parts = [part.strip() for part in text.strip().strip("()[]").split(",")]
    if len(parts) != count or not all(re.fullmatch("[0-9]{1,6}", part) for part in parts):
        return ()
    numbers = tuple(map(int, parts))
    return numbers if min(numbers[-sizes:]) > 0 else ()


def _subject(options: BuildOptions) -> dict[str, Any]:
    """The rectangle about a subject and the discs that correct its cut, made anew; {} without any."""
    found: dict[str, Any] = {"subject_mask": ""}
    if options.subject is not None:
        found |= {"subject_px": _whole_px(options.subject, 4, 2), "keep_px": (), "drop_px": ()}
    for name, discs in (("keep", options.keep), ("drop", options.drop)):
        if discs:
            found[f"{name}_px"] = tuple(_whole_px(disc, 3, 1) for disc in discs)
    if found.get("subject_px") == ():
        raise InputError(
            f"--subject {options.subject}",
            "it is no rectangle",
            "Use LEFT,TOP,WIDTH,HEIGHT in whole px of the picture, such as --subject 20,40,600,400.",
        )
    for name, discs in (("keep", options.keep), ("drop", options.drop)):
        for disc, read in zip(discs, found.get(f"{name}_px", ()), strict=False):
            if not read:
                remedy = f"Use X,Y,RADIUS in whole px of the picture, such as --{name} 320,240,12."
                raise InputError(f"--{name} {disc}", "it is no disc", remedy)
    return found if len(found) > 1 else {}


def _piece_keys(options: BuildOptions) -> dict[str, Any]:
    """The keys of [piece] that the options give."""
    keys: dict[str, Any] = {}
    if options.tube_radius is not None:
        keys["tube_radius_mm"] = _millimetres("--tube-radius", options.tube_radius, ("auto",))
    if options.depth is not None:
        keys["depth"] = _millimetres("--depth", options.depth, ("auto", "flat"))
    if options.knots is not None:
        few = re.fullmatch(r"0*[0-9]{1,9}", options.knots)
        if options.knots != "auto" and not (few and int(options.knots) > 0):
            raise InputError(
                f"--knots {options.knots}",
                "it is neither auto nor a number",
                "Use auto (one knot a piece of the picture), or how many knots its pieces are bridged into.",
            )
        keys["knots"] = "auto" if options.knots == "auto" else int(options.knots)
        _check_bounds(Piece, "knots", keys["knots"], f"--knots {options.knots}")
    if options.bend is not None:
        keys["bend"] = _share(options.bend)
    if options.mirror is not None:
        keys["mirror"] = options.mirror
    if options.bender is not None:
        named = re.fullmatch("[a-z]+", options.bender)
        keys["bender"] = options.bender if named else str(at_home(options.bender).absolute())
    if options.knot is not None:
        keys["knot"] = options.knot
    return keys


def _share(text: str) -> Any:
    """auto, off, or a share of a picture's height."""
    plain = text.strip().lower()
    if plain in ("auto", "off"):
        return plain
    try:
        share = float(plain)
    except ValueError:
        share = math.nan
    if share == 0:
        return "off"
    if not 0 < share <= MOST_BEND:
        raise InputError(
            f"--bend {text}",
            f"it is no share of a picture's height up to {MOST_BEND:g}, beyond which nobody knows it",
            "Use auto, off, or how far a point may move, such as --bend 0.05",
        )
    return share


def _search_keys(options: BuildOptions) -> dict[str, Any]:
    """The keys of [search] that the options give."""
    keys: dict[str, Any] = {}
    if options.seed is not None:
        if options.seed < 0:
            raise InputError(
                f"--seed {options.seed}", "it is negative", "Use a whole number from 0"
            )
        keys["seed"] = options.seed
    if options.start is not None:
        keys["start"] = str(at_home(options.start).absolute())
    if options.search is not None:
        keys["method"] = options.search
    if options.free == "view":
        keys["free_view"] = True
    return keys
