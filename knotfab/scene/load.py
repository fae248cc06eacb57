"""Read a scene.toml or `--lamps` into a checked Scene, and write a scene back without losing a bit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from math import hypot
from pathlib import Path
from typing import Any, TypeVar

from knotfab.base.disk import at_home, read_text
from knotfab.scene.camera import view_axes
from knotfab_formats.errors import InputError
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.piece import ON_FEET, Region
from knotfab_formats.read import parse_toml, scene_of
from knotfab_formats.scene import ResolvedScene, Scene
from knotfab_formats.views import Reading, View

AView = TypeVar("AView", bound=View)


def pick_view(views: Sequence[AView], name: str | None) -> AView:
    """Return the view of this name; the first without one.

    Raises:
        InputError: there is none.
    """
    for view in views:
        if name in (None, view.name):
            return view
    known = ", ".join(view.name for view in views)
    raise InputError(f"--view {name}", "the scene has no such view", f"It has: {known}.")


def load_scene(path: str | Path) -> Scene:
    """Read a scene file; keys left out take their defaults, and no view at all means one default.

    Raises:
        InputError: the file cannot be read, is not TOML, or `parse_scene` rejects it.
    """
    what, file = str(path), at_home(path)
    return _with_absolute_paths(parse_scene(read_text(file, what, "scene file"), what), file.parent)


def _with_absolute_paths(scene: Scene, folder: Path) -> Scene:
    """Return the scene with absolute paths for all files but pictures, so that it works elsewhere."""
    update: dict[str, Any] = {}
    region, start = scene.region, scene.search.get("start")
    if region.file is not None:
        path = str((folder / region.file).absolute())
        update["region"] = region.but(file=path)
    if isinstance(start, str) and start:
        update["search"] = {**scene.search, "start": str((folder / start).absolute())}
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
    if mount.plate not in ON_FEET:
        return
    asked = f'plate = "{mount.plate}" (--plate {mount.plate})'
    if not mount.on_feet:
        yield (
            f'{asked} is on the wall, and [mount] kind is "{mount.kind}" (--mount {mount.kind})',
            "Use --mount wall, or leave one of the two out.",
        )
    if mount.foot == "dowel":
        yield (
            f'{asked} has no drilled holes, and [mount] foot is "dowel"',
            "Leave one of the two out.",
        )
    if scene.piece.depth == 0:
        yield (
            f"the piece stands in its plate by valleys ({asked}), and a flat one (--depth flat) has none",
            "Leave out --depth, or use --plate pegs.",
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
    # where the tube alone reaches so far, a wall farther away helps no picture of usual size
    less, or_away = "Leave out --tube-radius", ""
    if reach > radius:
        less, or_away = "Leave out --depth", ", or move the wall away (--wall-distance)"
    light, wall = view.light_distance_mm, view.wall_distance_mm
    if reach >= light:
        yield (
            f"the piece reaches {reach:g} mm towards the light, but light_distance_mm is {light:g}",
            f"{less}, or move the lamp away (--lamp-distance).",
        )
    settles = scene.mount.on_feet and "wall_distance_mm" not in view.model_fields_set
    if view.kind == "shadow" and reach >= wall and not settles:
        yield (
            f"the piece reaches {reach:g} mm towards the wall, but wall_distance_mm is {wall:g}",
            f"{less}{or_away}.",
        )
    tilt = math.radians(view.wall_tilt_deg)
    if 0.5 * view.light_size_mm >= light - reach:
        yield (
            f"a lamp of {view.light_size_mm:g} mm reaches the piece, {light - reach:g} mm from its "
            "middle",
            "Use a smaller lamp (--lamp-diameter), or move it away (--lamp-distance).",
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

    Every key is written, except those of [printer] and [material] that nobody set, whose values
    come from the data files that their names stand for (`resolve` sets them all), and those that say how
    a view's picture is read, where they ask for nothing.
    """
    import tomli_w

    tables: dict[str, Any] = _without_none(scene.model_dump(by_alias=True))
    plain = Reading().model_dump()
    tables["views"] = [
        {key: value for key, value in view.items() if plain.get(key, ...) != value}
        for view in tables["views"]
    ]
    tables["printer"] = scene.printer.model_dump(exclude_unset=True)
    tables["material"] = scene.material.model_dump(exclude_unset=True)
    return tomli_w.dumps({key: value for key, value in tables.items() if value != {}})


def _without_none(value: Any) -> Any:
    """Drop keys without a value, since TOML has no null."""
    if isinstance(value, dict):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list | tuple) else value


# Checks of a whole scene, whoever made it.


# light of lamps on the market, linear sRGB, equally bright in their strongest channel
_COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "cyan": (0.0, 1.0, 1.0),
    "magenta": (1.0, 0.0, 1.0),
    "yellow": (1.0, 1.0, 0.0),
    "amber": (1.0, 0.5, 0.0),
    "white": (1.0, 1.0, 1.0),
    "warm": (1.0, 0.57, 0.22),  # about 2700 K beside daylight
    "cold": (0.75, 0.87, 1.0),  # about 8000 K
}
_SETS = {"rgb": "red+green+blue"}
# a file beside the scene: the picture from which the masks were taken
COLOURS_FILE = "picture-colours.png"
SWITCH = "switch"  # the word for lamps that are lit one after the other
MOST_LAMPS = 5  # five lamps mix 32 colours
_APART_MM = 1.0  # lamps nearer to each other cast one and the same shadow
_ALIKE = 0.05  # share of a colour's length by which lamps must differ for their colours to mix


def require_lamps(scene: Scene, what: str) -> None:
    """Refuse lamps before one wall that cannot show a picture together, once their places are fixed.

    Raises:
        InputError: lamps of one colour twice, or at one place.
    """
    if not scene.share_wall:
        return
    for one, other in combinations(scene.views, 2):
        if scene.lamps.mode == "mix" and _alike(one, other):
            raise InputError(
                what,
                f"the lamps {one.name!r} and {other.name!r} have one colour, so their shadows look alike",
                "Give each a colour of its own (lamp_colour), or switch them (--lamps switch).",
            )
        if scene.lamps.places == "fixed" and _apart_mm(one, other) < _APART_MM:
            raise InputError(
                what,
                f"the lamps {one.name!r} and {other.name!r} stand at one place, where they throw one shadow",
                'Move one (light_right_mm, light_up_mm), or let places = "auto" find some.',
            )


def _alike(one: View, other: View) -> bool:
    """Return whether two lamps have the same colour, brightness aside."""
    lengths = [hypot(*view.lamp_colour) or 1.0 for view in (one, other)]
    ways = [[c / n for c in v.lamp_colour] for v, n in zip((one, other), lengths, strict=True)]
    return hypot(*(a - b for a, b in zip(*ways, strict=True))) < _ALIKE


def _apart_mm(one: View, other: View) -> float:
    """Return the distance between two lamps."""
    keys = ("light_right_mm", "light_up_mm", "light_distance_mm")
    return hypot(*(getattr(one, key) - getattr(other, key) for key in keys))


def lamps_named(text: str) -> dict[str, tuple[float, float, float]]:
    """Parse `--lamps` into names and colours: "rgb", or names joined by +.

    Raises:
        InputError: there is no such lamp, or fewer than two.
    """
    plain = text.strip().lower()
    names = [name.strip() for name in _SETS.get(plain, plain).split("+")]
    for name in names:
        if name not in _COLOURS:
            raise InputError(
                f"--lamps {text}",
                f"{name!r} is no lamp",
                f"Use rgb, {SWITCH}, or some of {', '.join(_COLOURS)} with + between them; a scene may give "
                "any lamp_colour.",
            )
        if names.count(name) > 1:
            raise InputError(
                f"--lamps {text}", f"it names {name} twice", "Give each lamp a colour of its own."
            )
    if not 2 <= len(names) <= MOST_LAMPS:
        raise InputError(
            f"--lamps {text}",
            f"it takes two lamps at least and {MOST_LAMPS} at most, and this is {len(names)}",
            "Write rgb, or names with + between them, such as warm+white.",
        )
    return {name: _COLOURS[name] for name in names}


def with_lamps(scene: ResolvedScene, text: str, names: Sequence[str] = ()) -> ResolvedScene:
    """Return the scene with one view for each lamp of `--lamps`, before the wall of its first view.

    Args:
        names: names of the pictures of lamps that are switched, one each.

    Raises:
        InputError: as for `lamps_named`; lamps that are switched without a picture each.
    """
    first, mode = scene.views[0], "mix"
    if text.strip().lower() == SWITCH:
        if len(names) < 2:
            raise InputError(
                f"--lamps {SWITCH}",
                f"each lamp shows a picture of its own, and {len(names) or 'none'} is given",
                "Give two pictures or more, or mix colours (--lamps rgb).",
            )
        mode = SWITCH
        lamps = {name: (1.0, 1.0, 1.0) for name in names}
    else:
        lamps = lamps_named(text)
    wall = next(iter(lamps))
    views = tuple(
        first.but(name=name, picture="", lamp_colour=colour, wall="" if name == wall else wall)
        for name, colour in lamps.items()
    )
    table = scene.lamps.but(mode=mode, picture="", places="auto")
    return scene.but(views=views, lamps=table)


def with_small_lamps(scene: ResolvedScene) -> ResolvedScene:
    """Return the scene with lamps as small as LEDs where no size is set: colours need sharp edges."""
    if any("light_diameter_mm" in view.model_fields_set for view in scene.views):
        return scene
    small = {"light_diameter_mm": 3.0}  # an LED
    views = tuple(view.but(**small) for view in scene.views)
    return scene.but(views=views)
