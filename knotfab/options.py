"""The options of `knotfab build` as one value: their names, defaults, groups and help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from knotfab.errors import InputError
from knotfab.progress import Mode

__all__ = [
    "BATCH_EXAMPLES",
    "BUILD_EXAMPLES",
    "COMPARE_EXAMPLES",
    "OUTPUT",
    "PREVIEW_EXAMPLES",
    "SHADOW_EXAMPLES",
    "STUDIO_EXAMPLES",
    "TRADEOFF_EXAMPLES",
    "VALIDATE_EXAMPLES",
    "BuildOptions",
    "Flag",
    "Names",
    "PictureOptions",
    "options_from",
]

_PICTURE = Group.create_ordered("Picture")
_PIECE = Group.create_ordered("Piece")
_PRINT = Group.create_ordered("Print")
_SEARCH = Group.create_ordered("Search")
OUTPUT = Group.create_ordered("Output")

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]

BUILD_EXAMPLES = """Examples:

```
knotfab build cat.png --print              checked against the printer
knotfab build cat.png --size 240 --watch   larger; a page shows how it comes about
knotfab build cat.png --mount wall         ready to hang
knotfab build cat.png --time-budget 1.5min
knotfab build logo.svg --depth flat --tube-radius 2
knotfab build text:Hello --font "DejaVu Serif" --knots 1
knotfab build heart.png teapot.png         one part, two pictures
knotfab build --sequence walk/ --print     a part a frame
knotfab build --scene out/scene.toml       the same part again
```
"""


BATCH_EXAMPLES = """Examples:

```
knotfab batch logos/ --out built --print
knotfab batch *.png --out built --accuracy draft --jobs 4
knotfab batch logos/ --out built --cluster tcp://10.0.0.5:8786
```
"""

COMPARE_EXAMPLES = """Examples:

```
knotfab compare wall.jpg knotfab-out
knotfab compare wall.jpg knotfab-out --click
knotfab compare wall.jpg knotfab-out --corners 412,300 1630,322 1610,1490 395,1455
```
"""

VALIDATE_EXAMPLES = """Examples:

```
knotfab validate knotfab-out               all that a build wrote
knotfab validate tube.obj                  any tube, in mm
knotfab validate part.stl --knots knots.json --scene scene.toml --json
```
"""

STUDIO_EXAMPLES = """Examples:

```
knotfab studio
knotfab studio --port 8900 --no-open --out pieces
```
"""

SHADOW_EXAMPLES = """Examples:

```
knotfab shadow cat/part.stl --scene cat/scene.toml --out shadow.png
```
"""

TRADEOFF_EXAMPLES = """Examples:

```
knotfab tradeoff cat.png
knotfab tradeoff cat.png --accuracy draft --repeats 3 --out cat-tradeoff
knotfab tradeoff logos/*.png --time-limit 1h         the same call again goes on from there
```
"""

PREVIEW_EXAMPLES = """Examples:

```
knotfab preview logo.svg
knotfab preview badge.png --ink red --width 240
knotfab preview photo.jpg --ink flood --smooth 3 --out seen.png
```
"""


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """What decides how a picture is read, and what a tube can make of it; None leaves it to the scene."""

    invert: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """Draw all but what was found."""
    ink: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """What is drawn: auto (default: what is opaque, or what differs from the border), dark, light, alpha,
    flood (what the border's colours do not reach, for photographs), or a colour such as red or "#d02010"."""
    threshold: Annotated[float | None, Parameter(group=_PICTURE)] = None
    """Share of the largest difference, or of full opacity, where ink begins; 0.5 by default."""
    crop: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """auto (to the drawing's own box), or LEFT,TOP,WIDTH,HEIGHT in px of the picture."""
    keep_largest: Annotated[int | None, Parameter(group=_PICTURE)] = None
    """Draw so many of its pieces."""
    specks: Annotated[int | None, Parameter(group=_PICTURE)] = None
    """Leave out pieces, and fill holes, of fewer pixels."""
    smooth: Annotated[float | None, Parameter(group=_PICTURE)] = None
    """Draw it blurred by so many px and cut at half; its shadow is compared with the picture itself."""
    thicken: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Widen thinner strokes to so many mm on the wall, or auto: to what can be printed."""
    lines: Annotated[Literal["auto", "on", "off"] | None, Parameter(group=_PICTURE)] = None
    """One tube along the middle of each stroke, as wide as the tube: on, off, or auto (where most strokes
    are thinner than the tube)."""
    tone: Annotated[Literal["lines", "off"] | None, Parameter(group=_PICTURE)] = None
    """lines: draw the picture's greys, by strands that lie closer together where it is darker; off (default):
    its silhouette."""
    font: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Of text:…, a family's name, such as "DejaVu Serif", or a font file."""

    scene: Annotated[Path | None, Parameter(group=_PIECE)] = None
    """A scene.toml; the other options are shorthands for its keys and win over it."""
    size: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm of the picture's longer side on the wall; 180 by default."""
    width: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm of the picture on the wall; its height follows."""
    height: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm of the picture on the wall; its width follows."""
    lamp_distance: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm from the lamp to the middle of the piece; 500 by default."""
    wall_distance: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm from the middle of the piece to the wall; 100 by default."""
    lamp_diameter: Annotated[float | None, Parameter(group=_PIECE)] = None
    """mm; a wide lamp blurs the shadow. 5 by default."""
    tube_radius: Annotated[str | None, Parameter(group=_PIECE)] = None
    """mm, or auto (default): the thickest tube that draws the picture well."""

    printer: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A printer's name, such as prusa-mk4, or a file such as my-printer.toml; knotfab printers lists
    the names."""
    material: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A material's name, such as petg, or a file."""


@dataclass(frozen=True, kw_only=True)
class BuildOptions(PictureOptions):
    """What `knotfab build` is asked besides its pictures; None leaves it to the scene."""

    sequence: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """The pictures are frames of one moving knot: a folder of numbered pictures, an animation (GIF), or
    the pictures in their order. Each frame becomes a part; with --print there is a zoetrope as well."""
    no_loop: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """With --sequence: the last frame need not lead back to the first."""

    depth: Annotated[str | None, Parameter(group=_PIECE)] = None
    """Extent along the view in mm, auto (default: unreadable from elsewhere), or flat."""
    knots: Annotated[str | None, Parameter(group=_PIECE)] = None
    """auto (default: one a piece of the picture) or 1: all bridged into one."""
    knot: Annotated[str | None, Parameter(group=_PIECE)] = None
    """The knot to be tied into it: unknot (default), trefoil, "left trefoil", figure-eight, any of the
    table up to 8 crossings (5_2, 8_19), or a sum (3_1#4_1)."""
    free: Annotated[Literal["view"] | None, Parameter(group=_PIECE)] = None
    """view: pose, light and wall distance and the tube's radius are found with the knots, and written
    to scene.toml."""

    print_: Annotated[Flag, Parameter(name="--print", group=_PRINT)] = False
    """Check it against the printer too, and pose it for printing."""
    mount: Annotated[Literal["auto", "wall", "stand", "none"] | None, Parameter(group=_PRINT)] = (
        None
    )
    """What holds the piece: wall (pegs along light rays, in the tube's own shadow, on a plate whose face
    is the wall, or in drilled holes), stand (a base below all pictures), none, or auto (default: wall for
    several loose pieces that are printed, else none). Wall and stand imply --print."""

    accuracy: Annotated[
        Literal["sketch", "draft", "standard", "fine"] | None, Parameter(group=_SEARCH)
    ] = None
    """sketch, draft, standard (default) or fine."""
    time_budget: Annotated[str | None, Parameter(group=_SEARCH)] = None
    """Time for the whole build, such as 30, 90s, 1.5min or 1m30s; sets the iterations."""
    search: Annotated[Literal["flow", "inn", "inn+flow"] | None, Parameter(group=_SEARCH)] = None
    """flow (default: the certified flow), inn (the paper's invertible network), or inn+flow, the
    one after the other."""
    effect: Annotated[Names, Parameter(group=_SEARCH)] = ()
    """NAME=on, off or auto (default: on where the scene calls for it), such as penumbra=off; may be
    repeated."""
    start: Annotated[Path | None, Parameter(group=_SEARCH)] = None
    """Go on from the knots in this file, start.json of a build that went on from one, or of the studio."""
    seed: Annotated[int | None, Parameter(group=_SEARCH)] = None
    """Of the random depth profiles."""
    device: Annotated[Literal["cpu", "cuda"], Parameter(group=_SEARCH)] = "cpu"
    """Where the search runs."""

    out: Annotated[Path, Parameter(group=OUTPUT)] = Path("knotfab-out")
    """The folder to write."""
    force: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Replace what another picture was built to, in the default folder; a named one is replaced anyway."""
    colours: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Write part-colours.3mf as well: the bodies by name, each in a colour, for several filaments."""
    accept: Annotated[Literal["unrecognisable"] | None, Parameter(group=OUTPUT)] = None
    """unrecognisable: keep a piece in whose shadow nobody would know the picture."""
    skip: Annotated[Names, Parameter(group=OUTPUT)] = ()
    """Checks to go on without, such as shadow-render."""
    quiet: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Say nothing but errors."""
    verbose: Annotated[Flag, Parameter(name=("--verbose", "-v"), group=OUTPUT)] = False
    """Say how long each stage took."""

    @property
    def mode(self) -> Mode:
        """What progress is shown."""
        return "quiet" if self.quiet else "verbose" if self.verbose else "auto"


def options_from(given: Mapping[str, Any]) -> BuildOptions:
    """The options by their names, as a library's caller gives them: numbers and paths in their own types.

    Raises:
        InputError: there is no such option.
    """
    known = {field.name: str(field.type) for field in fields(BuildOptions)}
    values: dict[str, Any] = {}
    for name, value in given.items():
        key = "print_" if name == "print" else name
        if key not in known:
            raise InputError(
                f"the option {name}", "there is none of that name", f"Known: {', '.join(known)}"
            )
        if value is not None and "[str | None" in known[key]:
            value = str(value)
        elif value is not None and "Path" in known[key]:
            value = Path(value)
        elif key in ("skip", "effect"):
            value = (value,) if isinstance(value, str) else tuple(value)
        values[key] = value
    return BuildOptions(**values)
