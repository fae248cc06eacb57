"""Read a scene.toml into a checked Scene, and write one back without losing a bit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from knotfab.base.disk import at_home, read_text, require_within
from knotfab.scene.camera import view_axes
from knotfab.scene.lamps import require_lamps
from knotfab_formats.errors import InputError
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.piece import Region
from knotfab_formats.read import parse_toml, scene_of
from knotfab_formats.scene import Scene
from knotfab_formats.views import View


def load_scene(path: str | Path) -> Scene:
    """Read a scene file; keys left out take their defaults, and no view at all means one default.

    Raises:
        InputError: the file cannot be read, is not TOML, or `parse_scene` rejects it.
    """
    what, file = str(path), at_home(path)
    return _beside(parse_scene(read_text(file, what, "scene file"), what), file.parent)


def _beside(scene: Scene, folder: Path) -> Scene:
    """Return the scene with absolute paths for all files but pictures, so that it works elsewhere."""
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
    """Return the Scene that a TOML text describes.

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


def _reach_mm(region: Region, view: View) -> float | None:
    """Return how far a region reaches from the scene's middle towards a light, mm; None if open."""
    size = region.size_mm
    if size is None or region.kind == "mesh":
        return None
    ahead = view_axes(view)[2]
    x, y, z = view_axes(region) @ ahead
    if region.kind == "box":
        half = 0.5 * (abs(x) * size[0] + abs(y) * size[1] + abs(z) * size[2])
    elif region.kind == "cylinder":
        half = 0.5 * (math.hypot(x, z) * size[0] + abs(y) * size[1])
    else:
        half = 0.5 * size[0]
    return float(ahead @ region.center_mm + half)


def check_scene(scene: Scene, what: str = "scene.toml") -> None:
    """Refuse settings that are possible alone but not together.

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
    for why, remedy in chain(_faults_of_region(scene), _faults_of_plate(scene)):
        raise InputError(what, why, remedy)
    for number, view in enumerate(scene.views, start=1):
        for why, remedy in chain(_faults_of_view(scene, view), _faults_of_place(scene, view)):
            raise InputError(what, f"[[views]] number {number}: {why}", remedy)


def _faults_of_region(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield each fault of a scene's region, with its remedy."""
    region, radius = scene.region, scene.piece.tube_radius_mm or 0.0
    if region.kind == "mesh" and not region.file:
        yield '[region] kind is "mesh", but it names no file', 'Write file = "room.stl".'
    if region.kind != "mesh" and region.file is not None:
        yield (
            f'[region] file goes with kind = "mesh", not with "{region.kind}"',
            "Leave one of the two out.",
        )
    if region.kind == "mesh" and (region.azimuth_deg or region.elevation_deg):
        yield (
            "[region] azimuth_deg and elevation_deg turn boxes and cylinders, not a mesh",
            "Turn the mesh in its file, and leave them out.",
        )
    if region.size_mm is not None and 2.0 * radius >= min(region.size_mm):
        yield (
            f"a tube of tube_radius_mm = {radius:g} does not fit into [region] size_mm = "
            f"{list(region.size_mm)}",
            "Make the region larger or the tube thinner.",
        )


def _faults_of_plate(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield each setting that conflicts with a plate in which the piece stands, with its remedy."""
    mount, view = scene.mount, scene.views[0]
    if mount.plate == "pegs":
        return
    asked = f'plate = "{mount.plate}" (--plate {mount.plate})'
    if not mount.on_feet:
        yield (
            f'{asked} is on the wall, and [mount] kind is "{mount.kind}"',
            "Use --mount wall, or leave one of the two out.",
        )
    if mount.foot == "dowel":
        yield (
            f'{asked} has no drilled holes, and [mount] foot is "dowel"',
            "Leave one of the two out.",
        )
    if scene.piece.depth == 0:
        yield (
            f"the piece stands in its plate by valleys ({asked}), and a flat one (depth) has none",
            "Leave out the depth, or use --plate pegs.",
        )
    if view.wall_tilt_deg:
        yield (
            f"the piece stands in its plate square to it ({asked}), and this wall leans by "
            f"{view.wall_tilt_deg:g}°",
            "Use --plate pegs.",
        )
    if scene.settings.free_view:
        yield (
            f"the plate settles where the wall is ({asked}), and a free view is to find it (--free)",
            "Leave one of the two out.",
        )


def _faults_of_view(scene: Scene, view: View) -> Iterator[tuple[str, str]]:
    """Yield each conflict between a view's picture, piece and lamps, with its remedy."""
    radius = scene.piece.tube_radius_mm or 0.0
    reach = max(0.5 * (scene.piece.depth or 0.0), radius)
    light, wall = view.light_distance_mm, view.wall_distance_mm
    if (view.keep_px or view.drop_px) and not view.cut_out:
        yield (
            "keep_px and drop_px correct what is cut out, and nothing is",
            "Draw a rectangle about it: --subject LEFT,TOP,WIDTH,HEIGHT, in px of the picture.",
        )
    if reach >= light:
        yield (
            f"the piece reaches {reach:g} mm towards the light, but light_distance_mm is {light:g}",
            "Move the light away, or make the piece flatter or its tube thinner.",
        )
    settles = scene.mount.on_feet and "wall_distance_mm" not in view.model_fields_set
    if view.kind == "shadow" and reach >= wall and not settles:
        yield (
            f"the piece reaches {reach:g} mm towards the wall, but wall_distance_mm is {wall:g}",
            "Move the wall away, or make the piece flatter or its tube thinner.",
        )
    tilt, axes, second = (
        math.radians(view.wall_tilt_deg),
        view_axes(view),
        scene.room.second_lamp_mm,
    )
    if second is not None and view.kind == "shadow":
        normal = math.cos(tilt) * axes[2] - math.sin(tilt) * axes[1]
        if normal @ second <= 0:
            yield (
                f"the second lamp, second_lamp_mm = {list(second)}, stands behind the middle of the "
                "piece, where it throws no shadow on this wall",
                "Move it before the piece, or leave it out.",
            )
    if 0.5 * view.light_size_mm >= light - reach:
        yield (
            f"a lamp of {view.light_size_mm:g} mm reaches the piece, {light - reach:g} mm from its "
            "middle",
            "Use a smaller lamp, or move it away.",
        )
    height = math.cos(tilt) * (light + wall)
    if 0.5 * view.light_size_mm >= height:
        yield (
            f"a lamp of {view.light_size_mm:g} mm whose middle is {height:g} mm before the tilted wall "
            "is partly behind it",
            "Use a smaller lamp, move it away, or tilt the wall less.",
        )


def _faults_of_place(scene: Scene, view: View) -> Iterator[tuple[str, str]]:
    """Yield each way in which the tube or region does not fit a view, with its remedy."""
    radius = scene.piece.tube_radius_mm or 0.0
    frame = [s for s in (view.frame_width_mm, view.frame_height_mm) if s is not None]
    if frame and 2.0 * radius >= min(frame):
        yield (
            f"a tube of tube_radius_mm = {radius:g} is wider than the frame of {min(frame):g} mm",
            "Make the frame larger or the tube thinner.",
        )
    reach = _reach_mm(scene.region, view)
    if reach is not None and reach >= view.light_distance_mm:
        yield (
            f"the region reaches {reach:g} mm towards the light, but light_distance_mm is "
            f"{view.light_distance_mm:g}",
            "Move the light away or make the region smaller.",
        )
    if reach is not None and view.kind == "shadow" and -reach >= view.wall_distance_mm:
        yield (
            f"the whole region lies behind the wall (wall_distance_mm = {view.wall_distance_mm:g})",
            "Move [region] center_mm towards the light.",
        )


def dump_scene(scene: Scene) -> str:
    """Return the TOML text whose reading gives `scene` again, every float at full precision.

    Every key is written, except those of [printer] and [material] that nobody set: their values
    come from the data files that their names stand for (`resolve` sets them all).
    """
    import tomli_w

    tables: dict[str, Any] = _without_none(scene.model_dump(by_alias=True))
    tables["printer"] = scene.printer.model_dump(exclude_unset=True)
    tables["material"] = scene.material.model_dump(exclude_unset=True)
    return tomli_w.dumps({key: value for key, value in tables.items() if value != {}})


def _without_none(value: Any) -> Any:
    """Drop keys without a value, since TOML has no null."""
    if isinstance(value, dict):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list | tuple) else value


# Checks of a whole scene, whoever made it.
