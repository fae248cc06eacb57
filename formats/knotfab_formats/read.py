"""Read what a scene.toml holds, for both sides: its TOML, its keys, and what views share."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

from knotfab_formats.errors import InputError
from knotfab_formats.scene import OF_WALL, Scene, View

__all__ = ["parse_toml", "scene_of"]

_MOST_DOTS = 200  # a key has no more, nor have a file's quoted keys
_QUOTED_KEY = re.compile(r"[\"']\s*\.")

AScene = TypeVar("AScene", bound=Scene)


def scene_of(raw: Mapping[str, Any], what: str, model: type[AScene]) -> AScene:
    """Return the scene in the content of a TOML file, as `model` holds it.

    Raises:
        InputError: an unknown key, a wrong type, unit or bound; a wall that is no earlier view's.
    """
    scene = model.model_validate(raw, context=what)
    if not any(view.wall for view in scene.views):
        return scene
    views, first = _share_walls(scene.views, what), scene.views[0].name
    for view in views:
        if view.kind == "eye":
            why = f"view {view.name!r} is an eye, which lights no wall"
            raise InputError(what, why, "Leave it out.")
        if view.name != first and view.wall != first:
            raise InputError(
                what,
                f"view {view.name!r} has a wall of its own, and others share one",
                f"Give every view but the first wall = {first!r}, or none.",
            )
    return scene.but(views=views)


def parse_toml(text: str, what: str) -> dict[str, Any]:
    """Parse a TOML text; a byte order mark before it is passed over.

    Raises:
        InputError: it is none; with the number of the line.
    """
    # tomllib's time grows with the square of a dotted key's length, quoted or not
    longest = max(part.count(".") for part in re.split(r"[,\n]", text))
    if longest > _MOST_DOTS or len(_QUOTED_KEY.findall(text)) > _MOST_DOTS:
        raise InputError(what, f"it has a key of more than {_MOST_DOTS} words", "Correct it.")
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        last = f"at line {text.rstrip().count(chr(10)) + 1}, the last"
        reason = str(error).replace("at end of document", last)
        raise InputError(what, f"it is not valid TOML: {reason}", "Correct that line.") from error
    except RecursionError as error:
        raise InputError(what, "its lists are nested too deep", "Correct it.") from error
    except ValueError as error:
        raise InputError(what, "a whole number in it is too long", "Correct it.") from error


def _share_walls(views: tuple[View, ...], what: str) -> tuple[View, ...]:
    """Return the views, in which each that shines on another's wall has the keys of that wall and frame.

    Raises:
        InputError: the wall is none of an earlier view, or the view says otherwise of it.
    """
    walls: dict[str, View] = {}
    found = []
    for view in views:
        if not view.wall:
            walls[view.name] = view
            found.append(view)
            continue
        theirs = walls.get(view.wall)
        if theirs is None:
            raise InputError(
                what,
                f"view {view.name!r} has wall = {view.wall!r}, no earlier view with a wall of its own",
                f"Known: {', '.join(walls) or 'none'}.",
            )
        shared = {key: getattr(theirs, key) for key in OF_WALL}
        for key in sorted(set(OF_WALL) & view.model_fields_set):
            if getattr(view, key) != shared[key]:
                raise InputError(
                    what,
                    f"view {view.name!r} shines on the wall of {view.wall!r}, but has another {key}",
                    f"Leave {key} out: it is that wall's.",
                )
        found.append(view.but(**shared))
    return tuple(found)
