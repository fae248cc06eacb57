"""The options of `knotfab build`: names, types, defaults, groups and help, for command line and library."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from types import NoneType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from cyclopts import Group, Parameter, Token
from pydantic import BaseModel

from knotfab.base.progress import Mode
from knotfab.pipeline.values import read_value, read_whole
from knotfab_formats.bounds import option_of, sentences_of, values_of
from knotfab_formats.errors import InputError
from knotfab_formats.piece import About, Accuracy, Mount, Piece
from knotfab_formats.search import SearchSettings
from knotfab_formats.struck import pass_given
from knotfab_formats.views import View

Command = TypeVar("Command", bound=Callable[..., int])

_PICTURE = Group.create_ordered("Picture")
_PIECE = Group.create_ordered("Piece")
_PRINT = Group.create_ordered("Print")
_SEARCH = Group.create_ordered("Search")
OUTPUT = Group.create_ordered("Output")


def _read_whole(_: object, tokens: Sequence[Token]) -> int:
    """Read a whole number; cyclopts would round others."""
    value = tokens[0].value
    return read_whole(f"{tokens[0].keyword or ''} {value}".strip(), value)


def _read_place(_: object, tokens: Sequence[Token]) -> Path:
    return _place_of(tokens[0].value)


def _place_of(name: str | Path) -> Path:
    """Return the path to write to. "" is refused: it comes from an unset variable."""
    if not str(name).strip():
        raise ValueError('"" names no place')
    return Path(name)


ALL_OUT = Path("knotfab-out")  # parent of the folders that are named after pictures
Whole = Annotated[int, Parameter(converter=_read_whole)]
Place = Annotated[Path, Parameter(converter=_read_place)]
Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]
_Several = Annotated[tuple[Any, ...], Parameter(negative="", show_default=False)]


KEYS: dict[str, type[BaseModel]] = {
    **{"views": View, "piece": Piece, "mount": Mount, "accuracy": Accuracy, "about": About},
    "search": SearchSettings,
}
"""The tables of a scene whose keys have options, by name."""

GROUPS = {group.name: group for group in (_PICTURE, _PIECE, _PRINT, _SEARCH, OUTPUT)}
OFTEN = frozenset(
    ("--ink", "--crop", "--lamps", "--size", "--print", "--printer", "--material", "--mount", "--plate",
     "--supports", "--accuracy", "--out")
)  # fmt: skip
"""The options that makers use, which `knotfab build --help` shows."""
READERS: dict[str, partial[Any]] = {
    "size": partial(read_value, View, "frame_width_mm", option="--size")
}
"""How the options that set keys are read, from text or Python; the arguments are table and key."""
AClass = TypeVar("AClass", bound=type)


def _with_keys(*tables: str) -> Callable[[AClass], AClass]:
    """Return a decorator that adds to a class the options that set keys of these tables."""

    def add(kind: AClass) -> AClass:
        found = {}
        for model in (KEYS[table] for table in tables):
            said = sentences_of(model)
            for key in model.model_fields:
                group, option = option_of(model, key) or ("", "")
                name = option.removeprefix("--").replace("-", "_")
                if not option or hasattr(kind, name):
                    continue
                read = _type_of(model, key)
                READERS[name] = partial(read_value, model, key)
                how = None if read is Flag else _from_tokens(name, repeated=read is _Several)
                shown = Parameter(group=GROUPS[group], help=said[key], converter=how)
                found[name] = Annotated[read, shown]
                setattr(kind, name, False if read is Flag else () if read is _Several else None)
        kind.__annotations__ = found | kind.__annotations__
        return kind

    return add


def _from_tokens(name: str, repeated: bool = False) -> Callable[[object, Sequence[Token]], Any]:
    """Return a converter of cyclopts that reads an option as everyone else does."""

    def convert(_: object, tokens: Sequence[Token]) -> Any:
        texts = tuple(token.value for token in tokens)
        return READERS[name](texts if repeated else texts[0])

    return convert


def _type_of(model: type[BaseModel], key: str) -> Any:
    """Return the type that help shows for a key's option: any text where it takes words besides numbers."""
    kind: Any = model.model_fields[key].annotation
    words, literal = tuple(values_of(model, key)), cast(Any, Literal)
    if words and len(words) == len(get_args(kind)):
        return literal[words] | None
    if get_origin(kind) is tuple and get_args(kind)[-1] is Ellipsis:
        inner = get_args(kind)[0]
        return inner | None if get_origin(inner) is Literal else _Several
    if kind is bool:
        return Flag
    if get_origin(kind) is Literal:
        return kind | None
    parts = [p for p in get_args(kind) or (kind,) if p is not NoneType]
    plain = get_args(parts[0])[0] if get_origin(parts[0]) is Annotated else parts[0]
    return plain | None if len(parts) == 1 and plain in (int, float) else Any


@dataclass(frozen=True, kw_only=True)
@_with_keys("views", "piece", "mount", "accuracy", "search")
class PlanOptions:
    """The options that say what a build makes, and so what a preview tells; None leaves a value to the scene.

    Options that set keys of the scene are declared with these keys (`knotfab_formats`).
    """

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    lamps: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Several lamps in front of one screen: rgb, or names such as warm+white, mix one picture's
    colours; switch: each lamp shows its own picture, one at a time."""
    directions: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """Where each of several pictures is seen from, in their order: front, back, left, right (or side), top,
    bottom, or AZIMUTH:ELEVATION in degrees, as in front,side,30:45; by default spread about the vertical
    axis."""
    font: Annotated[str | None, Parameter(group=_PICTURE)] = None
    """The font of text:…: a family's name, such as "DejaVu Serif", or a font file."""
    sequence: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """The pictures are frames of one motion: a folder of numbered pictures, or the pictures
    in their order. Each frame becomes a part."""
    no_loop: Annotated[Flag, Parameter(group=_PICTURE)] = False
    """With --sequence: the last frame need not lead back to the first."""

    scene: Annotated[Path | None, Parameter(group=_PIECE)] = None
    """A scene.toml. Other options set keys of the scene, and win over the file."""
    size: Annotated[float | None, Parameter(group=_PIECE, converter=_from_tokens("size"))] = None
    """The picture's longer side on the wall, in mm; 180 by default."""
    free: Annotated[Literal["view"] | None, Parameter(group=_PIECE)] = None
    """view: find the pose, the distances of light and wall, and the tube's radius along with the knots; with
    several pictures the directions of their lamps. scene.toml then has them."""

    print_: Annotated[Flag, Parameter(name="--print", group=_PRINT)] = False
    """Prepare the part for printing: orient it for the printer, and check it against the printer too."""
    printer: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A printer's name, such as prusa-mk4, or a file such as my-printer.toml; knotfab printers lists
    the names."""
    nozzle: Annotated[float | None, Parameter(group=_PRINT)] = None
    """The nozzle's width, such as 0.6, in mm; layer, walls and the thinnest tube follow."""
    material: Annotated[str | None, Parameter(group=_PRINT)] = None
    """A material's name, such as petg, or a file."""

    time_budget: Annotated[str | None, Parameter(group=_SEARCH)] = None
    """Time for the whole build, such as 30 (seconds), 90s, 1.5min or 1m30s; sets the iterations."""
    effect: Annotated[Names, Parameter(group=_SEARCH)] = ()
    """Simulate an effect of light or world: NAME=on, off or auto (default: on where the scene calls for it),
    such as penumbra=off; may be repeated."""
    start: Annotated[Path | None, Parameter(group=_SEARCH)] = None
    """Go on from these knots: the folder of a build, its knots.json, or a start.json."""
    device: Annotated[Literal["cpu", "cuda"], Parameter(group=_SEARCH)] = "cpu"
    """Where the paper's network runs (--search inn or inn+flow)."""


@dataclass(frozen=True, kw_only=True)
class ToldOptions(PlanOptions):
    """Those of a plan, and of how much is told meanwhile."""

    quiet: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Print nothing but errors."""
    verbose: Annotated[Flag, Parameter(name=("--verbose", "-v"), group=OUTPUT)] = False
    """Print how long each stage took."""

    @property
    def mode(self) -> Mode:
        """How progress is shown."""
        return "quiet" if self.quiet else "verbose" if self.verbose else "auto"


@dataclass(frozen=True, kw_only=True)
@_with_keys("about")
class BuildOptions(ToldOptions):
    """All options of `knotfab build`: those of its plan, and of the folder that it writes."""

    out: Annotated[Place | None, Parameter(group=OUTPUT)] = None
    """The folder to write; by default knotfab-out/NAME, after the picture."""
    force: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Replace the result of another picture of that name in the default folder; in a folder that --out names
    a build always does."""
    colours: Annotated[Flag, Parameter(group=OUTPUT)] = False
    """Also write part-colours.3mf: the named bodies, each in a colour, for several filaments."""
    skip: Annotated[Names, Parameter(group=OUTPUT)] = ()
    """Leave out these checks, such as shadow-render."""


def options_from(given: Mapping[str, Any], known: Collection[str] = ()) -> BuildOptions:
    """Make options from Python values by name, for callers of the library.

    Args:
        known: the names that are allowed; by default all.

    Raises:
        InputError: an option is unknown, or has a wrong value.
    """
    from pydantic import TypeAdapter, ValidationError

    hints, values = get_type_hints(BuildOptions), dict[str, Any]()
    types = {name: hints[name] for name in known or hints}
    for name, value in pass_given(given).items():
        key = "print_" if name == "print" else name
        if key not in types:
            close = get_close_matches(name, types, n=1)
            hint = f"Did you mean {close[0]}? " if close else ""
            known = ", ".join(key.rstrip("_") for key in types)
            raise InputError(
                f"the option {name}", "there is none of that name", f"{hint}Known: {known}"
            )
        if value is None:
            continue
        if key in READERS:
            values[key] = READERS[key](value)
            continue
        if types[key] == tuple[str, ...] and isinstance(value, str):
            value = (value,)
        elif types[key] == str | None and not isinstance(value, bool):
            value = str(value)
        try:
            place = _place_of(value) if key == "out" else value
            values[key] = TypeAdapter(types[key]).validate_python(place)
        except ValueError as error:
            told = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            why = told[:1].lower() + told[1:]
            remedy = "Name a folder." if key == "out" else "Correct it, or leave it out."
            raise InputError(f"the option {name}={value!r}", why, remedy) from None
    return BuildOptions(**values)


def list_given(options: ToldOptions) -> dict[str, Any]:
    """List the options that differ from their defaults, as a library's caller names them.

    Those that set keys of [search] are together in "search", by key.
    """
    found, usual = dict[str, Any](), type(options)()
    for name, value in vars(options).items():
        reader = READERS.get(name)
        if value == getattr(usual, name):
            continue
        if reader is not None and reader.args[0] is SearchSettings:
            found.setdefault("search", {})[reader.args[1]] = value
        else:
            found[name] = value
    return found


def with_examples(text: str) -> Callable[[Command], Command]:
    """Return a decorator that adds examples to the end of a command's help."""

    def mark(command: Command) -> Command:
        command.__dict__["examples"] = text
        return command

    return mark
