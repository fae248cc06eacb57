"""Several lamps before one wall: reading `--lamps`, and refusing lamps that cannot work together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import hypot

from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene, Scene
from knotfab_formats.views import View

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
