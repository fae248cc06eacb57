"""The options of `knotfab build` as one value: their names, defaults, groups and help."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from cyclopts import Group, Parameter, Token

from knotfab.base.errors import InputError
from knotfab.base.lengths import read_length, read_number
from knotfab.base.progress import Mode

__all__ = [
    "ALL_OUT",
    "BATCH_EXAMPLES",
    "BUILD_EXAMPLES",
    "COMPARE_EXAMPLES",
    "MCP_EXAMPLES",
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
    "Place",
    "Whole",
    "options_from",
]

_PICTURE = Group.create_ordered("Picture")
_PIECE = Group.create_ordered("Piece")
_PRINT = Group.create_ordered("Print")
_SEARCH = Group.create_ordered("Search")
OUTPUT = Group.create_ordered("Output")


def _read_whole(_: object, tokens: Sequence[Token]) -> int:
    """A whole number, which cyclopts by itself would round others to."""
    value, remedy = tokens[0].value, "Give one such as 3."
    try:
        number = int(value)
    except ValueError:
        digits = value.strip().lstrip("+-").isdecimal()  # more of them than Python reads
        why = "it is too large" if digits else "it is no whole number"
        raise InputError(_words_of(tokens), why, remedy) from None
    if abs(number) >= 2**63:
        raise InputError(_words_of(tokens), "it is too large", remedy)
    return number


def _read_mm(_: object, tokens: Sequence[Token]) -> float:
    return read_length(_words_of(tokens), tokens[0].value)


def _read_decimal(_: object, tokens: Sequence[Token]) -> float:
    return read_number(_words_of(tokens), tokens[0].value)


def _words_of(tokens: Sequence[Token]) -> str:
    """An option with its value, as it was typed."""
    return f"{tokens[0].keyword or ''} {tokens[0].value}".strip()


def _read_place(_: object, tokens: Sequence[Token]) -> Path:
    """Where to write; of "" a path would be the folder one happens to be in: a variable was not set."""
    return _place_of(tokens[0].value)


def _place_of(name: str | Path) -> Path:
    if not str(name).strip():
        raise ValueError('"" names no place')
    return Path(name)


ALL_OUT = Path("knotfab-out")  # the folder of those that a build, or a batch, names after pictures
Whole = Annotated[int, Parameter(converter=_read_whole)]
Length = Annotated[float, Parameter(converter=_read_mm)]
Decimal = Annotated[float, Parameter(converter=_read_decimal)]
Place = Annotated[Path, Parameter(converter=_read_place)]
Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]

BUILD_EXAMPLES = """Examples:

```
knotfab build cat.png --print              checked against the printer
knotfab build cat.png --size 240 --watch   larger; a page shows how it grows
knotfab build cat.png --mount wall         ready to hang
knotfab build cat.png --time-budget 1.5min
knotfab build logo.svg --depth flat --tube-radius 2
knotfab build text:Hello --font "DejaVu Serif" --knots 1
knotfab build heart.png teapot.png         one part, two pictures
knotfab build parrot.png --lamps rgb       in colours, by the shadows of three lamps
knotfab build --sequence walk/ --print     one part for each frame
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
knotfab compare wall.jpg knotfab-out/cat
knotfab compare wall.jpg knotfab-out/cat --click
knotfab compare wall.jpg knotfab-out/cat --corners 412,300 1630,322 1610,1490 395,1455
```
"""

VALIDATE_EXAMPLES = """Examples:

```
knotfab validate knotfab-out/cat           everything that a build wrote
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

MCP_EXAMPLES = """Examples:

```
knotfab mcp --allow ~/pictures --allow ~/pieces
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
knotfab tradeoff logos/*.png --time-limit 1h         give the same call again to go on
```
"""

PREVIEW_EXAMPLES = """Examples:

```
knotfab preview logo.svg
knotfab preview badge.png --ink red --width 240
knotfab preview photo.jpg --ink flood --smooth 3 --out seen.png
knotfab preview cat.jpg --subject 150,80,700,900 --drop 300,950,60
```
"""


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """What decides how a picture is read, and what a tube can make of it; None leaves it to the scene."""

    invert: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """Draw everything except what was found."""
    ink: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """What is drawn: auto (default: what is opaque, or what differs from the border), dark, light, alpha,
    flood (what the border's colours do not reach, for photographs), or a colour such as red or "#d02010"."""
    threshold: Annotated[Decimal | None, Parameter(group=_PICTURE)] = None
    """Where ink begins, as a share of the largest difference, or of full opacity; 0.5 by default."""
    crop: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Read only this part of the picture: auto (the drawing's own box), or LEFT,TOP,WIDTH,HEIGHT in px."""
    subject: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Of a photograph: draw what can be cut out of a rectangle about it, LEFT,TOP,WIDTH,HEIGHT in px."""
    keep: Annotated[Names, Parameter(group=_PICTURE)] = ()
    """With --subject: a disc that belongs to it, X,Y,RADIUS in px; may be repeated."""
    drop: Annotated[Names, Parameter(group=_PICTURE)] = ()
    """With --subject: a disc that does not belong to it, X,Y,RADIUS in px; may be repeated."""
    keep_largest: Annotated[Whole | None, Parameter(group=_PICTURE)] = None
    """Draw only so many pieces of the picture, the largest."""
    specks: Annotated[Whole | None, Parameter(group=_PICTURE)] = None
    """Leave out pieces, and fill holes, of fewer pixels than this."""
    smooth: Annotated[Decimal | None, Parameter(group=_PICTURE)] = None
    """Blur the picture by so many px and cut it at half before it is drawn; the shadow is compared with the
    picture itself."""
    thicken: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Widen strokes that are thinner to so many mm on the wall, or auto: to what can be printed."""
    lines: Annotated[Literal["auto", "on", "off"] | None, Parameter(group=_PICTURE)] = None
    """Lay one tube along the middle of each stroke: on, off, or auto (default: where most strokes are thinner
    than the tube)."""
    tone: Annotated[Literal["lines", "off"] | None, Parameter(group=_PICTURE)] = None
    """lines: draw the picture's greys, with strands closer together where it is darker; off (default): draw
    its silhouette."""
    lamps: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Several lamps before one screen: rgb, or names such as warm+white, mix one picture's colours; switch:
    each lamp shows its own picture, one at a time."""
    font: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """The font of text:…: a family's name, such as "DejaVu Serif", or a font file."""

    scene: Annotated[Path | None, Parameter(group=_PIECE)] = None
    """A scene.toml. Other options set keys of the scene, and win over the file."""
    size: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """The picture's longer side on the wall, in mm; 180 by default."""
    width: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """The picture's width on the wall, in mm; its height follows."""
    height: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """The picture's height on the wall, in mm; its width follows."""
    lamp_distance: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """From the lamp to the middle of the piece, in mm; 500 by default."""
    wall_distance: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """From the middle of the piece to the wall, in mm; 100 by default."""
    lamp_diameter: Annotated[Length | None, Parameter(group=_PIECE)] = None
    """In mm; 5 by default. A wide lamp blurs the shadow."""
    tube_radius: Annotated[str | None, Parameter(group=_PIECE)] = None
    """In mm, or auto (default): the thickest tube that draws the picture well."""

    printer: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A printer's name, such as prusa-mk4, or a file such as my-printer.toml; knotfab printers lists
    the names."""
    material: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A material's name, such as petg, or a file."""


@dataclass(frozen=True, kw_only=True)
class BuildOptions(PictureOptions):
    """What `knotfab build` is asked besides its pictures; None leaves it to the scene."""

    sequence: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """The pictures are frames of one motion: a folder of numbered pictures, an animation (GIF), or
    the pictures in their order. Each frame becomes a part; with --print there is a zoetrope as well."""
    no_loop: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """With --sequence: the last frame need not lead back to the first."""

    depth: Annotated[str | None, Parameter(group=_PIECE)] = None
    """The piece's extent along the view: mm, auto (default: unreadable from elsewhere), or flat."""
    knots: Annotated[str | None, Parameter(group=_PIECE)] = None
    """auto (default): one knot for each piece of the picture; N: its pieces bridged into so many."""
    bend: Annotated[str | None, Parameter(group=_PIECE)] = None
    """Bend several pictures until they agree: auto (default), off, or the most that a point may move, as a
    share of the picture's height, such as 0.05."""
    mirror: Annotated[Literal["auto", "off"] | None, Parameter(group=_PIECE)] = None
    """auto: mirror pictures where that makes them agree and the scene fixes their views; off (default)."""
    knot: Annotated[str | None, Parameter(group=_PIECE)] = None
    """The knot type to tie: unknot (default), trefoil, "left trefoil", figure-eight, any of the table up to
    8 crossings (5_2, 8_19), or a sum (3_1#4_1)."""
    free: Annotated[Literal["view"] | None, Parameter(group=_PIECE)] = None
    """view: find the pose, the distances of light and wall, and the tube's radius along with the knots; with
    several pictures the directions of their lamps. scene.toml then has them."""

    print_: Annotated[Flag, Parameter(name="--print", group=_PRINT)] = False
    """Make it for printing: pose the part for that, and check it against the printer too."""
    mount: Annotated[
        Literal["auto", "wall", "stand", "hang", "none"] | None, Parameter(group=_PRINT)
    ] = None
    """What holds the piece: wall (pegs in the tube's own shadow, on a plate whose face is the wall, or in
    drilled holes), stand (a base below all pictures), hang (an eyelet for a thread), none, or auto (default:
    wall for several loose pieces that are printed, else none). Wall, stand and hang imply --print."""

    bender: Annotated[str | None, Parameter(group=_PRINT)] = None
    """What bends a wire: lra (default, a table of length, rotation, angle), grbl, or a template's file."""

    accuracy: Annotated[
        Literal["sketch", "draft", "standard", "fine"] | None, Parameter(group=_SEARCH)
    ] = None
    """sketch, draft, standard (default) or fine: from the fastest to the most accurate."""
    time_budget: Annotated[str | None, Parameter(group=_SEARCH)] = None
    """Time for the whole build, such as 30 (seconds), 90s, 1.5min or 1m30s; sets the iterations."""
    search: Annotated[Literal["flow", "inn", "inn+flow"] | None, Parameter(group=_SEARCH)] = None
    """flow (default: the certified flow), inn (an invertible network), or inn+flow, one after the other."""
    effect: Annotated[Names, Parameter(group=_SEARCH)] = ()
    """Simulate an effect of light or world: NAME=on, off or auto (default: on where the scene calls for it),
    such as penumbra=off; may be repeated."""
    start: Annotated[Path | None, Parameter(group=_SEARCH)] = None
    """Go on from these knots: the folder of a build, its knots.json, or a start.json."""
    seed: Annotated[Whole | None, Parameter(group=_SEARCH)] = None
    """Seed of the random depth profiles: another one gives another piece."""
    device: Annotated[Literal["cpu", "cuda"], Parameter(group=_SEARCH)] = "cpu"
    """Where the search runs."""

    out: Annotated[Place | None, Parameter(group=OUTPUT)] = None
    """The folder to write; by default knotfab-out/NAME, after the picture."""
    force: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Replace the result of another picture of that name in the default folder; in a folder that --out names
    a build always does."""
    colours: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Also write part-colours.3mf: the named bodies, each in a colour, for several filaments."""
    title: Annotated[str | None, Parameter(group=OUTPUT)] = None
    """What part.3mf is called in slicers and on print sites; the picture's name by default."""
    designer: Annotated[str | None, Parameter(group=OUTPUT)] = None
    """Who designed it, for part.3mf; knotfab by default."""
    licence: Annotated[str | None, Parameter(group=OUTPUT)] = None
    """The terms under which others may use it, for part.3mf, such as "CC BY 4.0"; none by default."""
    also: Annotated[Names, Parameter(group=OUTPUT)] = ()
    """Also write files for other tools: svg, dxf, step, gcode, or several (svg,step). Centre lines for
    cutters, plotters and CAD; with svg the outlines of shadows, with step tubes and mount as solids. gcode
    keeps what PrusaSlicer makes of the part, with pictures for the printer's screen."""
    accept: Annotated[Literal["unrecognisable"] | None, Parameter(group=OUTPUT)] = None
    """unrecognisable: keep a piece in whose shadow nobody would know the picture."""
    skip: Annotated[Names, Parameter(group=OUTPUT)] = ()
    """Leave out these checks, such as shadow-render."""
    quiet: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Say nothing but errors."""
    verbose: Annotated[Flag, Parameter(name=("--verbose", "-v"), group=OUTPUT)] = False
    """Say how long each stage took."""

    @property
    def mode(self) -> Mode:
        """What progress is shown."""
        return "quiet" if self.quiet else "verbose" if self.verbose else "auto"


def options_from(given: Mapping[str, Any], known: Collection[str] = ()) -> BuildOptions:
    """The options by their names, as a library's caller gives them: numbers and paths in their own types.

    Args:
        known: those that there are; by default all.

    Raises:
        InputError: there is no such option, it cannot be that, or the folder to write has no name.
    """
    from pydantic import TypeAdapter, ValidationError

    hints, values = get_type_hints(BuildOptions), dict[str, Any]()
    types = {name: hints[name] for name in known or hints}
    for name, value in given.items():
        key = "print_" if name == "print" else name
        if key not in types:
            close = get_close_matches(name, types, n=1)
            hint = f"Did you mean {close[0]}? " if close else ""
            known = ", ".join(key.rstrip("_") for key in types)
            raise InputError(
                f"the option {name}", "there is none of that name", f"{hint}Known: {known}"
            )
        if key in ("also", "skip", "effect", "keep", "drop") and isinstance(value, str):
            value = (value,)
        elif types[key] == str | None and value is not None and not isinstance(value, bool):
            value = str(value)
        elif types[key] == float | None and isinstance(value, str):
            read = read_number if key in ("threshold", "smooth") else read_length
            value = read(f"the option {name}={value!r}", value)
        elif hasattr(value, "item"):  # a number of numpy's
            value = value.item()
        try:
            if key == "out" and value is not None:
                value = _place_of(value)
            checked = TypeAdapter(types[key]).validate_python(value)
        except ValueError as error:
            told = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            why = told[:1].lower() + told[1:]
            remedy = "Name a folder." if key == "out" else "Correct it, or leave it out."
            raise InputError(f"the option {name}={value!r}", why, remedy) from None
        # 700 is a number as it is, and is written so
        values[key] = value if type(value) is int and isinstance(checked, float) else checked
    return BuildOptions(**values)
