"""Read a scene.toml into a checked Scene, and write one back without losing a bit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from knotfab.base.disk import at_home, read_text, require_within
from knotfab.base.errors import InputError
from knotfab.scene.camera import view_axes
from knotfab.scene.lamps import require_lamps
from knotfab_formats.knot_names import parse_knot_name
from knotfab_formats.read import parse_toml, scene_of
from knotfab_formats.scene import Scene, View

__all__ = ["check_scene", "dump_scene", "load_scene", "parse_scene"]


def load_scene(path: str | Path) -> Scene:
    """Read a scene file; keys left out take their defaults, and no view at all means one default.

    Raises:
        InputError: the file cannot be read, is not TOML, or `parse_scene` rejects it.
    """
    what, file = str(path), at_home(path)
    return _beside(parse_scene(read_text(file, what, "scene file"), what), file.parent)


def _beside(scene: Scene, folder: Path) -> Scene:
    """The scene with all files but pictures named by whole paths: a build may run elsewhere."""
    update: dict[str, Any] = {}
    region, start = scene.region, scene.search.get("start")
    if region.file is not None:
        path = str((folder / region.file).absolute())
        require_within(path, region.file)
        update["region"] = region.but(file=path)
    if isinstance(start, str) and start:
        require_within(folder / start, start)
        update["search"] = {**scene.search, "start": str((folder / start).absolute())}
    if any(view.subject_mask for view in scene.views):
        update["views"] = tuple(
            v.but(subject_mask=str((folder / v.subject_mask).absolute())) if v.subject_mask else v
            for v in scene.views
        )
    return scene.but(**update) if update else scene


def parse_scene(text: str, what: str = "scene.toml") -> Scene:
    """The Scene that a TOML text describes.

    Args:
        text: content of a scene file (docs/conventions.md, schema 1).
        what: how an error names it.

    Raises:
        InputError: not TOML, an unknown key, a wrong type, unit or bound, or lengths that
            contradict each other.
    """
    scene = scene_of(parse_toml(text, what), what, Scene)
    check_scene(scene, what)
    return scene


def _depth_span(scene: Scene, view: View) -> tuple[float, float] | None:
    """Return how far the region reaches towards the light and towards the wall, mm."""
    size = scene.region.size_mm
    if size is None or scene.region.kind == "mesh":
        return None
    ahead = view_axes(view)[2]
    x, y, z = view_axes(scene.region) @ ahead
    if scene.region.kind == "box":
        half = 0.5 * (abs(x) * size[0] + abs(y) * size[1] + abs(z) * size[2])
    elif scene.region.kind == "cylinder":
        half = 0.5 * (math.hypot(x, z) * size[0] + abs(y) * size[1])
    else:
        half = 0.5 * size[0]
    middle = float(ahead @ scene.region.center_mm)
    return middle + half, half - middle


def check_scene(scene: Scene, what: str = "scene.toml") -> None:
    """Reject lengths that are each possible, but not together.

    Raises:
        InputError: two views of one name; lamps before one wall that show nothing together; a region
            about the light or wholly behind the wall; a tube or a depth too large for its
            surroundings; a knot that is not in the table.
    """
    names = [view.name for view in scene.views]
    for name in names:
        if names.count(name) > 1:
            raise InputError(what, f"two views are named {name!r}", "Give each its own name.")
    require_lamps(scene, what)
    parse_knot_name(scene.piece.knot)
    radius = scene.piece.tube_radius_mm or 0.0
    depth = scene.piece.depth or 0.0
    size = scene.region.size_mm
    if scene.region.kind == "mesh" and not scene.region.file:
        raise InputError(
            what, '[region] kind is "mesh", but it names no file', 'Write file = "room.stl".'
        )
    if scene.region.kind != "mesh" and scene.region.file is not None:
        raise InputError(
            what,
            f'[region] file goes with kind = "mesh", not with "{scene.region.kind}"',
            "Leave one of the two out.",
        )
    if scene.region.kind == "mesh" and (scene.region.azimuth_deg or scene.region.elevation_deg):
        raise InputError(
            what,
            "[region] azimuth_deg and elevation_deg turn boxes and cylinders, not a mesh",
            "Turn the mesh in its file, and leave them out.",
        )
    if size is not None and 2.0 * radius >= min(size):
        raise InputError(
            what,
            f"a tube of tube_radius_mm = {radius:g} does not fit into [region] size_mm = "
            f"{list(size)}",
            "Make the region larger or the tube thinner.",
        )
    for number, view in enumerate(scene.views, start=1):
        where = f"[[views]] number {number}"
        if (view.keep_px or view.drop_px) and not view.cut_out:
            raise InputError(
                what,
                f"{where}: keep_px and drop_px correct what is cut out, and nothing is",
                "Draw a rectangle about it: --subject LEFT,TOP,WIDTH,HEIGHT, in px of the picture.",
            )
        reach = max(0.5 * depth, radius)
        if reach >= view.light_distance_mm:
            raise InputError(
                what,
                f"{where}: the piece reaches {reach:g} mm towards the light, but "
                f"light_distance_mm is {view.light_distance_mm:g}",
                "Move the light away, or make the piece flatter or its tube thinner.",
            )
        if view.kind == "shadow" and reach >= view.wall_distance_mm:
            raise InputError(
                what,
                f"{where}: the piece reaches {reach:g} mm towards the wall, but "
                f"wall_distance_mm is {view.wall_distance_mm:g}",
                "Move the wall away, or make the piece flatter or its tube thinner.",
            )
        if scene.room.second_lamp_mm is not None and view.kind == "shadow":
            tilt, axes = math.radians(view.wall_tilt_deg), view_axes(view)
            normal = math.cos(tilt) * axes[2] - math.sin(tilt) * axes[1]
            if normal @ scene.room.second_lamp_mm <= 0:
                raise InputError(
                    what,
                    f"{where}: the second lamp, second_lamp_mm = {list(scene.room.second_lamp_mm)}, stands "
                    "behind the middle of the piece, where it throws no shadow on this wall",
                    "Move it before the piece, or leave it out.",
                )
        room = view.light_distance_mm - reach
        if 0.5 * view.light_size_mm >= room:
            raise InputError(
                what,
                f"{where}: a lamp of {view.light_size_mm:g} mm reaches the piece, {room:g} mm from its "
                "middle",
                "Use a smaller lamp, or move it away.",
            )
        height = math.cos(math.radians(view.wall_tilt_deg)) * (
            view.light_distance_mm + view.wall_distance_mm
        )
        if 0.5 * view.light_size_mm >= height:
            raise InputError(
                what,
                f"{where}: a lamp of {view.light_size_mm:g} mm whose middle is {height:g} mm before the "
                "tilted wall is partly behind it",
                "Use a smaller lamp, move it away, or tilt the wall less.",
            )
        frame = [s for s in (view.frame_width_mm, view.frame_height_mm) if s is not None]
        if frame and 2.0 * radius >= min(frame):
            raise InputError(
                what,
                f"{where}: a tube of tube_radius_mm = {radius:g} is wider than the frame of "
                f"{min(frame):g} mm",
                "Make the frame larger or the tube thinner.",
            )
        span = _depth_span(scene, view)
        if span is None:
            continue
        if span[0] >= view.light_distance_mm:
            raise InputError(
                what,
                f"{where}: the region reaches {span[0]:g} mm towards the light, but "
                f"light_distance_mm is {view.light_distance_mm:g}",
                "Move the light away or make the region smaller.",
            )
        nearest = -span[0]  # the region's side that is furthest from the wall
        if view.kind == "shadow" and nearest >= view.wall_distance_mm:
            raise InputError(
                what,
                f"{where}: the whole region lies behind the wall (wall_distance_mm = "
                f"{view.wall_distance_mm:g})",
                "Move [region] center_mm towards the light.",
            )


def dump_scene(scene: Scene) -> str:
    """The TOML text whose reading gives `scene` again, every float at full precision.

    Every key is written, except those of [printer] and [material] that nobody set: their values
    come from the data files that their names stand for (`resolve` sets them all).
    """
    import tomli_w

    tables: dict[str, Any] = _without_none(scene.model_dump(by_alias=True))
    tables["printer"] = scene.printer.model_dump(exclude_unset=True)
    tables["material"] = scene.material.model_dump(exclude_unset=True)
    return tomli_w.dumps({key: value for key, value in tables.items() if value != {}})


def _without_none(value: Any) -> Any:
    """Leave out keys without a value, which TOML has no word for; what is open is "auto" by now."""
    if isinstance(value, dict):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list | tuple) else value
