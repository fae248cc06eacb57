"""Read the values of options, such as lengths with units, times and colours, into a scene."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from knotfab.base.disk import at_home
from knotfab.base.errors import read_length
from knotfab.pipeline.options import KEYS, PictureOptions, options_from
from knotfab.report.summary import CHECKS
from knotfab_formats.bounds import option_of, takes_number, values_of, why_out_of_bounds, words_of
from knotfab_formats.errors import InputError
from knotfab_formats.piece import MOST_BEND, Material, Piece, Printer
from knotfab_formats.scene import ResolvedScene, Scene
from knotfab_formats.search import OF_NO_PRESET, SearchSettings, search_settings
from knotfab_formats.views import Switches, View

_TIME = re.compile(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)\s*")
_MOST_S = 100 * 86400.0  # a hundred days
_SECONDS = {"": 1.0}
_SECONDS |= dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0)
_SECONDS |= dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0)
_SECONDS |= dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0)


def _read_millimetres(
    model: type[BaseModel], key: str, option: str, text: str, words: tuple[str, ...]
) -> Any:
    """Read a positive length in mm, or one of the words."""
    plain = text.strip().lower()
    if plain in words:
        return plain
    remedy = f"Give millimetres, such as {option} 2, or {' or '.join(words)}."
    number = read_length(f"{option} {text}", plain, remedy)
    if number <= 0:
        raise InputError(f"{option} {text}", "it is not above 0", remedy)
    _check_bounds(model, key, number, f"{option} {text}")
    return number


def read_seconds(text: str, name: str = "--time-budget") -> float:
    """Read a time such as `30`, `90s`, `1.5min`, `1m30s` or `1h` in seconds.

    Args:
        name: of the option, for the error message.

    Raises:
        InputError: it is not a positive time.
    """
    plain = re.sub(r"(?<=\d),(?=\d)", ".", text.strip().lower())
    parts = _TIME.findall(plain)
    if "".join(_TIME.sub("", plain).split()) or any(unit not in _SECONDS for _, unit in parts):
        parts = []
    if len(parts) > 1 and any(unit == "" for _, unit in parts):
        parts = []  # "1 30" is ambiguous
    seconds = sum(float(number) * _SECONDS[unit] for number, unit in parts)
    if not 0 < seconds <= _MOST_S:
        raise InputError(
            f"{name} {text}",
            "it is longer than 100 days" if seconds > 0 else "it is not a positive time",
            f"Give seconds or minutes, such as {name} 30, 90s, 1.5min or 1m30s.",
        )
    return seconds


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


def read_scene(options: PictureOptions) -> tuple[ResolvedScene, Path | None]:
    """Read the scene file, or take the default scene, apply the options to it, and resolve it.

    Returns:
        The scene, and the folder that its pictures are relative to.

    Raises:
        InputError: an option or the scene is wrong, they contradict each other, or a printer or material is
            unknown.
    """
    from knotfab.scene.catalogue import asked_for, resolve
    from knotfab.scene.load import check_scene, load_scene

    path = options.scene
    scene = load_scene(path) if path is not None else Scene()
    given = {table: _list_given_keys(options, model) for table, model in KEYS.items()}
    views, search = given.pop("views") | _frame_keys(options), scene.search
    if "subject_px" in views:  # a new subject drops the scene's discs
        views = {"keep_px": (), "drop_px": (), **views}
    if views.keys() & {"subject_px", "keep_px", "drop_px"}:
        # the subject is cut out again, and fills the frame
        views = {"crop_px": None, **views, "subject_mask": ""}
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


def _list_given_keys(options: PictureOptions, model: type[BaseModel]) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    for key in model.model_fields:
        _, option = option_of(model, key) or ("", "")
        value = getattr(options, option[2:].replace("-", "_"), None) if option else None
        if value is not None and value is not False and value != ():
            read = _read_value(model, key, option, value)
            keys[key] = values_of(model, key).get(read, read)
    return keys


def read_option(name: str, given: Any) -> Any:
    """Read one option that sets a key, as the command line does, from text or a Python value.

    Returns:
        The key's value, but a word such as "auto" as it is.

    Raises:
        InputError: it is wrong or out of bounds.
    """
    for model in KEYS.values():
        for key in model.model_fields:
            if (option_of(model, key) or ("", ""))[1] == "--" + name.replace("_", "-"):
                return _read_value(model, key, "", getattr(options_from({name: given}), name))
    raise ValueError(f"no option {name} sets a key")


def _read_value(model: type[BaseModel], key: str, option: str, value: Any) -> Any:
    """Read the value of an option as that of its key.

    Raises:
        InputError: it is wrong or out of bounds.
    """
    if key in _READERS:
        return _READERS[key](option, value)
    words = words_of(model, key)
    if isinstance(value, str) and key not in words and takes_number(model, key):
        return _read_millimetres(model, key, option, value, words)
    if isinstance(value, str):
        if why_out_of_bounds(model, key, value) is not None:
            why, remedy = "it is no line of text", "Give one line of at most 200 signs."
            raise InputError(f"{option} {value[:40]!r}", why, remedy)
    elif not isinstance(value, bool):
        _check_bounds(model, key, value, f"{option} {value:g}")
    return value


def _frame_keys(options: PictureOptions) -> dict[str, Any]:
    """Return the frame's sides; if only one is given, the other follows from the picture."""
    sided = options.width is not None or options.height is not None
    if options.size is not None:
        _check_bounds(View, "frame_width_mm", options.size, f"--size {options.size:g}")
        if sided:
            why = "--width or --height is given too"
            raise InputError(f"--size {options.size:g}", why, "Give one of them.")
    if sided or options.size is not None:  # which side is longer is known only with the picture
        return {"frame_width_mm": options.width, "frame_height_mm": options.height}
    return {}


def _read_switches(texts: Collection[str]) -> dict[str, Any]:
    """Return the keys of [effects] that `--effect NAME=on|off|auto` set; the last one of a name counts."""
    known, keys = list(Switches.model_fields), {}
    for text in texts:
        name, _, word = (part.strip().lower() for part in text.partition("="))
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


def _check_bounds(model: type[BaseModel], key: str, value: Any, what: str) -> None:
    bounds = why_out_of_bounds(model, key, value)
    if bounds is not None:
        unit = {"mm": "millimetres", "px": "pixels"}.get(key.rpartition("_")[2], "a number")
        why = "it is negative" if value < 0 else "it is out of bounds"
        raise InputError(what, why, f"Give {unit} {bounds}.")


def _read_ink(option: str, text: str) -> str:
    """Read one of the words of `ink`, or a colour as #rrggbb."""
    plain = text.strip().lower()
    words = words_of(View, "ink")
    if plain in words:
        return plain
    from PIL import ImageColor

    try:
        return "#{:02x}{:02x}{:02x}".format(*ImageColor.getrgb(plain)[:3])
    except ValueError as error:
        remedy = f"Use {', '.join(words)}, or a colour such as red or #d02010."
        raise InputError(f"{option} {text}", "it is no colour", remedy) from error


def _pixel_reader(
    count: int, what: str, remedy: str, words: tuple[str, ...] = ()
) -> Callable[..., Any]:
    """Return a reader of `count` whole pixels, all but the first two of them above 0, or of words."""

    def read(option: str, text: str) -> Any:
        parts = [part.strip() for part in text.strip().strip("()[]").split(",")]
        if (plain := text.strip().lower()) in words:
            return plain
        if len(parts) == count and all(re.fullmatch("[0-9]{1,6}", part) for part in parts):
            numbers = tuple(map(int, parts))
            if min(numbers[2:]) > 0:
                return numbers
        raise InputError(f"{option} {text}", what, f"Use {remedy.format(option)}.")

    return read


_BOX = "LEFT,TOP,WIDTH,HEIGHT in whole px"
_read_disc = _pixel_reader(
    3, "it is no disc", "X,Y,RADIUS in whole px of the picture, such as {} 320,240,12"
)


def _read_discs(option: str, texts: Collection[str]) -> tuple[Any, ...]:
    return tuple(_read_disc(option, text) for text in texts)


def _read_largest(option: str, count: int) -> int:
    if count == 0:  # which means all of them in a scene
        raise InputError(f"{option} 0", "it is out of bounds", "Give a whole number from 1.")
    _check_bounds(View, "keep_largest", count, f"{option} {count:g}")
    return count


def _read_count(option: str, text: str) -> int | str:
    if text == "auto":
        return text
    if not re.fullmatch(r"0*[0-9]{1,9}", text) or int(text) == 0:
        raise InputError(
            f"{option} {text}",
            "it is neither auto nor a number",
            "Use auto (one knot a piece of the picture), or how many knots its pieces are bridged into.",
        )
    _check_bounds(Piece, "knots", int(text), f"{option} {text}")
    return int(text)


def _read_bend(option: str, text: str) -> float | str:
    """Read "auto", "off", or a share of a picture's height."""
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
            f"{option} {text}",
            f"it is no share of a picture's height up to {MOST_BEND:g}, beyond which nobody knows it",
            "Use auto, off, or how far a point may move, such as --bend 0.05",
        )
    return share


# keys whose options take other words than the keys themselves
_READERS: dict[str, Callable[..., Any]] = {
    "ink": _read_ink,
    "crop_px": _pixel_reader(
        4,
        "it is no part of a picture",
        f"auto, or {_BOX}, such as {{}} 20,40,600,400",
        ("auto", "none"),
    ),
    "subject_px": _pixel_reader(
        4, "it is no rectangle", f"{_BOX} of the picture, such as {{}} 20,40,600,400"
    ),
    "keep_px": _read_discs,
    "drop_px": _read_discs,
    "keep_largest": _read_largest,
    "knots": _read_count,
    "bend": _read_bend,
    "accept": lambda _, word: (word,),
}


def _search_keys(options: PictureOptions) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    if options.start is not None:
        keys["start"] = str(at_home(options.start).absolute())
    if options.free == "view":
        keys["free_view"] = True
    return keys
