"""Several lamps before one wall, as a scene names them, and what other light there is in the room."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from knotfab_validators.files.bad_file import BadFile, short
from knotfab_validators.files.table import Table

__all__ = ["WALL_KEYS", "Lamps", "Room", "read_lamps", "read_room", "share_walls"]

WALL_KEYS = (
    *("azimuth_deg", "elevation_deg", "wall_distance_mm", "wall_tilt_deg", "wall_radius_mm"),
    *("frame_up_mm", "frame_width_mm", "frame_height_mm", "kind"),
)
"""Keys of a view that say where its wall and frame are: views that share a wall have them alike."""


@dataclass(frozen=True)
class Lamps:
    """All lamps of a scene, which light one wall.

    `mode` is "mix" where all of them are lit at once, "switch" where one is at a time. `screen` is "ends"
    where nothing is seen of what falls beside the picture's frame, and "open" where the wall goes on.
    `picture` is the picture in colours, beside the scene; "" where there is none.
    """

    mode: str
    screen: str
    picture: str


@dataclass(frozen=True)
class Room:
    """Light besides the lamps' own: `ambient` over all lamps' in the middle of the picture, and walls."""

    ambient: float = 0.0
    area_m2: float = 0.0
    reflectance: float = 0.0


def read_lamps(data: dict[str, Any], name: str) -> Lamps | None:
    """The scene's lamps; None where no view shares another one's wall.

    Raises:
        BadFile: a value is impossible, or not all views share the wall.
    """
    views = [view for view in data.get("views", []) if isinstance(view, dict)]
    if not any(view.get("wall") for view in views):
        return None
    owner = views[0].get("name", "front")
    apart = [v.get("name", "front") for v in views[1:] if v.get("wall") != owner]
    if apart:
        raise BadFile(f"{name}: view {short(apart[0])} does not share the wall of {short(owner)}")
    table = Table(data.get("lamps", {}), f"{name}: [lamps]")
    return Lamps(
        mode=table.word("mode", "mix", ("mix", "switch")),
        screen=table.word("screen", "ends", ("ends", "open")),
        picture=table.word("picture", ""),
    )


def read_room(data: dict[str, Any], name: str) -> Room:
    """The table [room], as far as it lights the picture alike."""
    table = Table(data.get("room", {}), f"{name}: [room]")
    return Room(
        ambient=table.number("ambient", 0.0, least=0),
        area_m2=table.number("area_m2", 0.0, least=0),
        reflectance=table.number("reflectance", 0.0, least=0, most=0.999999),
    )


def share_walls(views: list[Any], name: str) -> list[Any]:
    """The tables of views, each that names a `wall` with the keys of the earlier view whose wall it is.

    Raises:
        BadFile: there is no such view before it, or a key differs from that one's.
    """
    own: dict[str, dict[str, Any]] = {}
    found = []
    for view in views:
        wall = view.get("wall", "") if isinstance(view, dict) else ""
        if not wall:
            if isinstance(view, dict):
                own[str(view.get("name", "front"))] = view
            found.append(view)
            continue
        if wall not in own:
            raise BadFile(f"{name}: wall {short(wall)} is not the name of a view before it")
        shared = {key: own[wall][key] for key in WALL_KEYS if key in own[wall]}
        other = [key for key in WALL_KEYS if key in view and view[key] != shared.get(key)]
        if other:
            raise BadFile(f"{name}: {other[0]} of a view differs from that of the wall it shares")
        found.append({**view, **shared})
    return found
