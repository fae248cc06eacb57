"""The command line: thin wrappers over library calls, and the exit codes of the contract."""

from __future__ import annotations

import gc
import os
import shlex
import signal
import sys
import time
import webbrowser
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.exceptions import CycloptsError

from knotfab import __version__
from knotfab.errors import InputError, KnotfabError, needs_extra
from knotfab.options import (
    BATCH_EXAMPLES,
    BUILD_EXAMPLES,
    COMPARE_EXAMPLES,
    OUTPUT,
    PREVIEW_EXAMPLES,
    SHADOW_EXAMPLES,
    STUDIO_EXAMPLES,
    TRADEOFF_EXAMPLES,
    VALIDATE_EXAMPLES,
    BuildOptions,
    Flag,
    Names,
    PictureOptions,
    Place,
    Whole,
)

__all__ = ["app", "main"]

app = App(
    name="knotfab",
    version=__version__,
    help="Turns a picture into a knotted tube whose shadow is that picture, proved before you print.\n\n"
    "Exit codes: 0 every required check passed; 1 a check failed or the scene cannot be met; "
    "2 wrong input; 3 this machine lacks something; 130 interrupted.",
    suppress_keyboard_interrupt=False,  # main says what became of the work
)


@dataclass
class _CallClock:
    """`time.perf_counter()` where the call that runs began: its times are those that a person waits."""

    began: float | None = None


_call = _CallClock()
_DEFAULTS = BuildOptions()
_READ = PictureOptions()


@app.command(help_epilogue=BUILD_EXAMPLES)
def build(
    *pictures: str,
    options: Annotated[BuildOptions, Parameter(name="*")] = _DEFAULTS,
    open_: Annotated[Flag, Parameter(name="--open", group=OUTPUT)] = False,
    watch: Annotated[Flag, Parameter(group=OUTPUT)] = False,
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
    watch
        Open a page in the browser that shows knot and shadow as they grow.
    events
        Where a line of JSON is written for each thing that happens: a file, or - for standard output.
    """
    from knotfab.verify.verifier import load_early

    with load_early(options.skip):
        return _build(pictures, options, open_, watch, events)


def _build(
    pictures: tuple[str, ...], options: BuildOptions, open_: bool, watch: bool, events: str | None
) -> int:
    from knotfab.cli.options import open_events, open_page
    from knotfab.cli.terminal_shadow import draw_shadow
    from knotfab.prepare import prepare_build
    from knotfab.progress import Progress
    from knotfab.verify.checks import list_unmet

    quiet = options.quiet or events == "-"
    mode = "quiet" if quiet else options.mode
    command = shlex.join(["knotfab", *sys.argv[1:]])
    with (
        ExitStack() as page,
        open_events(events) as told,
        Progress(mode, events=told, began=_call.began, draw=draw_shadow) as progress,
    ):
        request = prepare_build(pictures, options, command, progress)
        if watch:
            events_of_page, _ = page.enter_context(open_page(request.out, progress.say))
            progress.listen(events_of_page)
        from knotfab.pipeline import run_build  # heavy: only once the call is known to be right

        outcome = run_build(request, progress)
        progress.tell("end", exit_code=outcome.exit_code, folder=str(outcome.folder))
    failed = [c["name"] for c in list_unmet(outcome.report["checks"]) if c["status"] == "fail"]
    if quiet and failed:
        print(
            f"knotfab: {', '.join(failed)} failed: see {outcome.folder}/report.html",
            file=sys.stderr,
        )
    if not quiet:
        from knotfab.cli.summary import print_summary

        print_summary(outcome)
    if open_:
        webbrowser.open((outcome.folder / "report.html").resolve().as_uri())
    return outcome.exit_code


@app.command(help_epilogue=PREVIEW_EXAMPLES)
def preview(
    *pictures: str,
    options: Annotated[PictureOptions, Parameter(name="*")] = _READ,
    out: Place = Path("knotfab-preview.png"),
    sequence: Flag = False,
    json: Flag = False,
) -> int:
    """Show in a second what a picture will become: its silhouette, and what tubes lose of it.

    Parameters
    ----------
    pictures
        As for knotfab build.
    out
        The PNG to write: the silhouette and, in red, what a tube of each radius loses.
    sequence
        The pictures are frames of one motion.
    json
        Print the figures as JSON.
    """
    from knotfab.cli.summary import print_survey
    from knotfab.files.whole import write_whole
    from knotfab.prepare import survey_pictures
    from knotfab.preview.draw import draw_survey

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "a preview is a PNG", "Name a file in .png.")
    found = survey_pictures(pictures, BuildOptions(**vars(options), sequence=sequence))
    write_whole(out, draw_survey(found))
    print_survey(found, out, json)
    return 0


@app.command(help_epilogue=BATCH_EXAMPLES)
def batch(
    *pictures: str,
    options: Annotated[BuildOptions, Parameter(name="*")] = _DEFAULTS,
    jobs: Whole | None = None,
    cluster: str | None = None,
) -> int:
    """Build many pictures, each into a folder of its own in --out; skip those that are built already.

    Parameters
    ----------
    pictures
        Picture files, folders of them, or text:…
    jobs
        How many builds run side by side; by default as many as cores and memory allow.
    cluster
        The address of a Dask scheduler, such as tcp://10.0.0.5:8786, whose workers build instead.
    """
    from knotfab.batch.run import batch as run
    from knotfab.prepare import check_options

    check_options(options)
    records = run(pictures, options, jobs, cluster)
    failed = sum(record["exit_code"] != 0 for record in records)
    if not options.quiet:
        print(f"{len(records) - failed} of {len(records)} passed: see {options.out}/index.html")
    return 1 if failed else 0


@app.command(help_epilogue=STUDIO_EXAMPLES)
def studio(*, port: Whole = 0, no_open: Flag = False, out: Place = Path("knotfab-studio")) -> int:
    """Open a local page: drop a picture on it, set the scene, and watch the knot grow.

    Parameters
    ----------
    port
        The port, which only this machine can reach; 0: any free one.
    no_open
        Print the address, but open no browser.
    out
        The folder for pictures and builds.
    """
    with needs_extra("knotfab studio", "studio"):
        from knotfab.studio.run import run_studio
    run_studio(port, not no_open, out)
    return 0


@app.command(help_epilogue=VALIDATE_EXAMPLES)
def validate(
    part: Path | None = None,
    *,
    knots: Path | None = None,
    scene: Path | None = None,
    json: Flag = False,
    failures: Path | None = None,
    skip: Names = (),
) -> int:
    """Measure written files again, with other code than the code that wrote them.

    Parameters
    ----------
    part
        A folder that a build wrote, or an STL, 3MF, OBJ or PLY file in mm.
    knots
        The file of the centre lines, knots.json.
    scene
        The file of the scene, scene.toml.
    json
        Print {"status", "checks", "views", "picture"} as JSON.
    failures
        The PNG that shows where checks failed; by default NAME-failures.png beside the part.
    skip
        Leave out these checks, such as shadow-render.
    """
    from knotfab.cli.options import files_to_validate
    from knotfab.read_options import read_skips
    from knotfab.verify.verifier import Verifier

    files, skipped = files_to_validate(part, knots, scene, failures), read_skips(skip)
    shadows = files.part is not None and files.scene is not None
    with Verifier(skipped, shadows) as verifier:
        verdict = verifier.submit(files).result()
    if json:
        import json as codec

        print(codec.dumps({k: verdict[k] for k in ("status", "checks", "views", "picture")}))
    else:
        from knotfab.cli.summary import UNABLE, print_checks

        print_checks(verdict["checks"])
        if verdict["picture"] is not None:
            print(f"The places are marked in {verdict['picture']}")
        if verdict["exit_code"] == 3:
            print(UNABLE)
    return int(verdict["exit_code"])


@app.command(help_epilogue=SHADOW_EXAMPLES)
def shadow(part: Path, *, scene: Path, out: Place, view: str | None = None) -> int:
    """Render the shadow that a part casts in a scene, as a picture.

    Parameters
    ----------
    part
        An STL or 3MF in print coordinates.
    scene
        The scene.toml of the part, with its [pose].
    out
        The PNG to write.
    view
        Name of the view; the first by default.
    """
    from knotfab.verify.shadow import render_shadow

    render_shadow(part, scene, out, view)
    which = "" if view is None else f" in the view {view}"
    print(f"{out} shows the shadow of {part}{which}.")
    return 0


@app.command(help_epilogue=COMPARE_EXAMPLES)
def compare(
    photo: Path,
    folder: Path,
    *,
    corners: tuple[str, str, str, str] | None = None,
    click: Flag = False,
    view: str | None = None,
    out: Place = Path("knotfab-compare.png"),
    json: Flag = False,
) -> int:
    """Compare a photograph of the real shadow with the picture, and say which way to move the lamp.

    Parameters
    ----------
    photo
        A photograph that shows the whole frame on the wall, taken from anywhere.
    folder
        The folder that a build wrote.
    corners
        The corners of the frame in the photograph, as x,y in px: top left, top right, bottom right, bottom
        left. By default the four marks of setup.pdf, or the plate of a wall mount, tell them.
    click
        Open a page to click the four corners; it then shows the command with --corners.
    view
        Name of the view; the first by default.
    out
        The PNG that shows where shadow and picture differ.
    json
        Print the figures as JSON.
    """
    from knotfab.cli.summary import print_comparison
    from knotfab.compare.compare import compare_photo, write_comparison

    if click:
        from knotfab.compare.click import write_click_page

        page, more = out.with_suffix(".html"), [] if view is None else ["--view", view]
        command = ["knotfab", "compare", str(photo), str(folder), *more, "--out", str(out)]
        write_click_page(photo, command, page)
        print(f"Point at the corners of the frame on {page}: it says how to go on.")
        webbrowser.open(page.resolve().as_uri())
        return 0
    found = compare_photo(photo, folder, corners, view)
    write_comparison(found, out)
    print_comparison(found, out, json)
    return 0


@app.command(help_epilogue=TRADEOFF_EXAMPLES)
def tradeoff(
    *pictures: str,
    out: Place = Path("knotfab-tradeoff"),
    scene: Path | None = None,
    accuracy: Literal["sketch", "draft", "standard", "fine"] | None = None,
    tube_radius: str | None = None,
    repeats: Whole = 1,
    jobs: Whole = 1,
    combinations: Whole = 16,
    time_limit: str | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    quiet: Flag = False,
) -> int:
    """Measure what accuracy costs in time on this machine: settings one by one, then combinations.

    Parameters
    ----------
    pictures
        Image files, SVGs, or text:…; each makes a piece of its own, and the figures are means over them.
    out
        The folder for tradeoff.json, .png and .html, and for the runs from which a later call goes on.
    scene
        A scene.toml.
    accuracy
        The preset around which one setting at a time is changed; standard by default.
    tube_radius
        In mm, or auto (default): each point finds its own.
    repeats
        Runs of each point; its seconds are their median.
    jobs
        How many runs go side by side. They slow each other down, all alike: leave it at 1 to measure the
        seconds that a build takes.
    combinations
        How many combinations to try after single settings; the better half of all goes on to more pictures.
    time_limit
        End after this time with what is measured: 30 (seconds), 10m or 1h.
    device
        Where the search runs.
    quiet
        Say nothing but errors.
    """
    from knotfab.prepare import check_names
    from knotfab.progress import Progress
    from knotfab.read_options import read_scene, read_seconds
    from knotfab.target.read import read_target

    for name, value, least in (
        ("--repeats", repeats, 1),
        ("--jobs", jobs, 1),
        ("--combinations", combinations, 0),
    ):
        if value < least:
            raise InputError(f"{name} {value}", "it is too few", f"Give {least} or more")
    if not pictures:
        raise InputError("tradeoff", "no picture is named", "Name one, or several")
    limit_s = None if time_limit is None else read_seconds(time_limit, "--time-limit")
    options = BuildOptions(scene=scene, accuracy=accuracy, tube_radius=tube_radius)
    chosen, _ = read_scene(options)
    check_names(chosen)
    for picture in pictures:
        read_target(picture, chosen.views[0])  # what is no picture is told at once
    from knotfab.tradeoff.run import tradeoff as run

    with Progress("quiet" if quiet else "auto") as progress:
        found = run(
            chosen,
            pictures,
            out,
            repeats=repeats,
            device=device,
            progress=progress,
            jobs=jobs,
            limit_s=limit_s,
            combinations=combinations,
        )
    if not quiet:
        from knotfab.cli.summary import print_tradeoff

        print_tradeoff(found)
    return 0


@app.command
def doctor(*, compile_: Annotated[Flag, Parameter(name="--compile")] = False) -> int:
    """Say what this machine has and lacks, with the remedy for each.

    Parameters
    ----------
    compile_
        Only compile the search's loops, so that the first build need not wait for that.
    """
    from knotfab.cli.summary import print_findings
    from knotfab.doctor import compile_loops, examine

    findings = [compile_loops()] if compile_ else examine()
    print_findings(findings)
    return 3 if any(f.status == "missing" for f in findings) else 0


@app.command
def printers() -> int:
    """List the printers and materials that knotfab knows by name, yours included, with their figures."""
    from knotfab.cli.summary import print_catalogue
    from knotfab.scene.catalogue import materials
    from knotfab.scene.catalogue import printers as known
    from knotfab.scene.own_data import data_folder

    print_catalogue(known(), materials(), data_folder())
    return 0


@app.command
def schema() -> int:
    """Print the JSON schema of scene.toml, for editors that check it while you write."""
    from knotfab.scene.json_schema import dump_schema

    print(dump_schema(), end="")
    return 0


app.register_install_completion_command()


def main(arguments: list[str] | None = None, began: float | None = None) -> None:
    """Run the command line and leave with its exit code.

    Args:
        arguments: those of the process by default.
        began: `time.perf_counter()` from which its times count; by default the start of the process.
    """
    if began is None and arguments is None:
        from knotfab.progress import process_age

        began = time.perf_counter() - process_age()
    _call.began = began
    # many small products: threads that wait for each other cost more than they bring, and up to
    # ten times on a shared machine; read when numpy is first imported
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # the libraries make a million things that stay: looked through seldom, they load a tenth faster
    gc.set_threshold(20_000, 20, 20)
    # pydantic's plugins are looked for in every package that is installed, for a tenth of a second
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    asked: list[int] = []

    def interrupt(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # asked to end, tidy up as after Ctrl-C
        number = getattr(signal, name, None)  # Windows hangs up nobody
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except (Exception, KeyboardInterrupt) as error:
        # a compiler drops an interrupt that falls into one of its callbacks, and fails a step later
        if asked or isinstance(error, KeyboardInterrupt):
            stays = str(error) if isinstance(error, KeyboardInterrupt) else ""
            print(f"knotfab: interrupted; {stays or 'nothing was changed'}", file=sys.stderr)
            code = 130
        elif isinstance(error, KnotfabError):
            print(f"knotfab: {error}", file=sys.stderr)
            code = error.exit_code
        elif isinstance(error, CycloptsError):
            print(f"knotfab: {error} See: knotfab --help", file=sys.stderr)
            code = 2
        else:
            raise
    gc.freeze()  # what is left ends with the process: to look through it all would take a second
    sys.exit(code if isinstance(code, int) else 0)
