"""The commands of the core, and those that the apps add by entry points."""

from __future__ import annotations

import shlex
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TextIO

from cyclopts import App, Parameter

from knotfab.base.apps import VERSION, list_commands
from knotfab.base.disk import open_stream
from knotfab.base.errors import MachineError
from knotfab.pipeline.options import GROUPS, OFTEN, OUTPUT, BuildOptions, Flag, Names, Place
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import recording

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

app = App(
    name="knotfab",
    version=VERSION,
    help="Turns a picture into a knotted tube whose shadow is that picture, proved before you print.\n\n"
    "Exit codes: 0 every required check passed; 1 a check failed or the scene cannot be met; "
    "2 wrong input; 3 this machine lacks something, or knotfab made a mistake; 130 interrupted.",
    suppress_keyboard_interrupt=False,  # `main` handles it
)


@dataclass
class CallClock:
    """When the running call began, by `time.perf_counter()`, so that its times include loading."""

    began: float | None = None


@dataclass
class BuildHelp:
    """Prints the help of a command: of a build's options those that makers use, or all."""

    every_option: bool = False

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print one panel."""
        from cyclopts.help import DefaultFormatter

        if not self.every_option and panel.title in GROUPS:
            panel = panel.copy(entries=[e for e in panel.entries if OFTEN & {*e.positive_names}])
        if panel.entries:
            DefaultFormatter()(console, options, panel)


build_help = BuildHelp()
call_clock = CallClock()
_DEFAULTS = BuildOptions()


@app.command(
    help_formatter=build_help,
    help_epilogue="""All options: knotfab build --help-all

Examples:

```
knotfab build cat.png --print              checked against the printer
knotfab build cat.png --size 240           larger
knotfab build cat.png --mount wall         ready to hang
knotfab build cat.png --time-budget 1.5min
knotfab build logo.svg --depth flat --tube-radius 2
knotfab build text:Hello --font "DejaVu Serif" --knots 1
knotfab build heart.png teapot.png         one part, two pictures
knotfab build parrot.png --lamps rgb       in colours, by the shadows of three lamps
knotfab build --sequence walk/ --print     one part for each frame
knotfab build --scene out/scene.toml       the same part again
```
""",
)
def build(
    *pictures: str,
    options: Annotated[BuildOptions, Parameter(name="*")] = _DEFAULTS,
    open_: Annotated[Flag, Parameter(name="--open", group=OUTPUT)] = False,
    events: Annotated[str | None, Parameter(show=False)] = None,
) -> int:
    """Turn a picture, or several, into a verified part.

    Parameters
    ----------
    pictures
        An image file, an SVG, or text:… (a glyph or a word); not needed where the scene names it. Several
        pictures are several views of one part, spread about the vertical axis: two at right angles, three
        at 60°.
    open_
        Open the report in the browser when it is done.
    events
        Where a line of JSON is written for each thing that happens: a file, or - for standard output.
    """
    from knotfab.base.progress import Progress
    from knotfab.cli.summary import draw_shadow
    from knotfab.pipeline.prepare import prepare_build
    from knotfab.pipeline.verifier import copy_early
    from knotfab_formats.verdict import list_unmet

    quiet = options.quiet or events == "-"
    mode = "quiet" if quiet else options.mode
    command = shlex.join(["knotfab", *sys.argv[1:]])
    with (
        ExitStack() as validators,
        recording(),
        open_events(events) as told,
        Progress(mode, events=told, began=call_clock.began, draw=draw_shadow) as progress,
    ):
        early = copy_early(options.skip)
        request = prepare_build(
            pictures, options, command, progress, lambda: validators.enter_context(early)
        )
        from knotfab.pipeline.build import run_build  # heavy, so only after the call was checked

        outcome = run_build(request, progress)
        progress.tell("end", exit_code=outcome.exit_code, folder=str(outcome.folder))
    failed = [c.name for c in list_unmet(outcome.found.checks) if c.status == "fail"]
    if quiet and failed:
        print(
            f"knotfab: {', '.join(failed)} failed: see {outcome.folder}/report.html",
            file=sys.stderr,
        )
    if not quiet:
        from knotfab.cli.summary import print_summary

        print_summary(outcome, options.verbose)
    if open_:
        webbrowser.open((outcome.folder / "report.html").resolve().as_uri())
    if not (outcome.folder / "report.json").is_file():
        raise MachineError(str(outcome.folder), "it was removed as the build ended", "Build again.")
    return outcome.exit_code


@contextmanager
def open_events(name: str | None) -> Iterator[TextIO | None]:
    """Open the stream for a build's events: standard output for "-", or a file; None without a name.

    Raises:
        InputError: the file cannot be written.
    """
    if name is None or name == "-":
        yield None if name is None else sys.stdout
        return
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open_stream(name, "w"))
        except (OSError, ValueError) as error:
            raise InputError(f"--events {name}", "it cannot be written", "Name a file.") from error
        yield file


@app.command(
    help_epilogue="""Examples:

```
knotfab validate knotfab-out/cat           everything that a build wrote
knotfab validate tube.obj                  any tube, in mm
knotfab validate part.stl --knots knots.json --scene scene.toml --json
```
"""
)
def validate(
    part: Path | None = None,
    /,
    *,
    knots: Path | None = None,
    scene: Path | None = None,
    json: Flag = False,
    failures: Path | None = None,
    skip: Names = (),
    unit: Literal["mm", "cm", "m", "in"] = "mm",
) -> int:
    """Measure written files again, by code that shares nothing with the code that wrote them.

    Parameters
    ----------
    part
        A folder that a build wrote, or an STL, 3MF, OBJ or PLY file.
    knots
        The file of the centre lines, knots.json.
    scene
        The file of the scene, scene.toml.
    json
        Print {"status", "conclusion", "size_mm", "notes", "checks", "views", "picture"} as JSON.
    failures
        The PNG to draw the part in, with the places marked where checks failed.
    skip
        Leave out these checks, such as shadow-render.
    unit
        The unit of the numbers in an STL, OBJ or PLY.
    """
    from knotfab.pipeline.verifier import files_to_validate, list_unread, load_early

    with load_early(skip):
        from knotfab.pipeline.read_options import read_skips
        from knotfab.pipeline.strangers import validate_files

        files = files_to_validate(part, knots, scene, failures)
        verdict = validate_files(files, read_skips(skip), unit)
    if part is not None and part.is_dir():
        verdict = replace(verdict, notes=(*verdict.notes, *list_unread(files)))
    if json:
        import json as codec

        print(codec.dumps(verdict.to_dict()))
    else:
        from knotfab.cli.summary import UNABLE, print_checks

        print(verdict.conclusion)
        for note in verdict.notes:
            print(f"note: {note}")
        print_checks(verdict.checks)
        if verdict.picture is not None:
            print(f"The places are marked in {verdict.picture}")
        if verdict.exit_code == 3:
            print(UNABLE)
    return verdict.exit_code


@app.command(
    help_epilogue="""Examples:

```
knotfab shadow cat/part.stl --scene cat/scene.toml --out shadow.png
```
"""
)
def shadow(part: Path, /, *, scene: Path | None = None, out: Place, view: str | None = None) -> int:
    """Render the shadow that a part casts in a scene, as a picture.

    Parameters
    ----------
    part
        An STL or 3MF in print coordinates, or the folder of a build.
    scene
        The scene.toml of the part, with its [pose]; by default that of the folder.
    out
        The PNG to write.
    view
        Name of the view; the first by default.
    """
    from knotfab.pipeline.strangers import render_shadow

    render_shadow(part, scene, out, view)
    which = "" if view is None else f" in the view {view}"
    print(f"{out} shows the shadow of {part}{which}.")
    return 0


@app.command
def report(folder: Path, /) -> int:
    """Write report.html again, from report.json and the folder's other files.

    Parameters
    ----------
    folder
        A folder that a build wrote.
    """
    from knotfab.report.folder_page import write_page

    print(f"{write_page(folder)} is written.")
    return 0


@app.command
def printers() -> int:
    """List the printers and materials that knotfab knows by name, yours included, with their figures."""
    from knotfab.cli.summary import print_catalogue
    from knotfab.scene.catalogue import data_folder, materials
    from knotfab.scene.catalogue import printers as known

    print_catalogue(known(), materials(), data_folder())
    return 0


@app.command
def schema() -> int:
    """Print the JSON schema of scene.toml, for editors that check it while you write."""
    from knotfab_formats.read import dump_schema

    print(dump_schema(), end="")
    return 0


for _command in list_commands():
    app.command(
        _command, help_epilogue=_command.__dict__.get("examples"), help_formatter=build_help
    )

app.register_install_completion_command()
