"""The commands that make something: a part, a preview of it, many parts, the studio's page."""

from __future__ import annotations

import shlex
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, TextIO

from cyclopts import Parameter

from knotfab.base.disk import at_home
from knotfab.base.errors import MachineError, needs_extra
from knotfab.pipeline.options import (
    ALL_OUT,
    OUTPUT,
    BuildOptions,
    Flag,
    PictureOptions,
    Place,
    Whole,
)
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import recording


@dataclass
class CallClock:
    """`time.perf_counter()` where the call that runs began: its times are those that a person waits."""

    began: float | None = None


call_clock = CallClock()
_DEFAULTS = BuildOptions()
_READ = PictureOptions()


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
    from knotfab.pipeline.verifier import load_early

    with load_early(options.skip), recording():
        return _build(pictures, options, open_, watch, events)


def _build(
    pictures: tuple[str, ...], options: BuildOptions, open_: bool, watch: bool, events: str | None
) -> int:
    from knotfab.base.progress import Progress
    from knotfab.cli.summary import draw_shadow
    from knotfab.pipeline.prepare import prepare_build
    from knotfab_formats.verdict import list_unmet

    quiet = options.quiet or events == "-"
    mode = "quiet" if quiet else options.mode
    command = shlex.join(["knotfab", *sys.argv[1:]])
    with (
        ExitStack() as page,
        open_events(events) as told,
        Progress(mode, events=told, began=call_clock.began, draw=draw_shadow) as progress,
    ):
        request = prepare_build(pictures, options, command, progress)
        if watch:
            events_of_page, _ = page.enter_context(open_page(request.out, progress.say))
            progress.listen(events_of_page)
        from knotfab.pipeline.build import (
            run_build,  # heavy: only once the call is known to be right
        )

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
    """Open the events of a build: nowhere, standard output for "-", or a file.

    Raises:
        InputError: the file cannot be written.
    """
    if name is None or name == "-":
        yield None if name is None else sys.stdout
        return
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open(name, "w", encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"--events {name}", "it cannot be written", "Name a file.") from error
        yield file


@contextmanager
def open_page(
    out: Path, say: Callable[[str], None], grace_s: int | None = None
) -> Iterator[tuple[IO[str], subprocess.Popen[str]]]:
    """Yield a page in the browser that shows a build into `out`: the queue of its events, and its process.

    That stays while a tab is open.

    Args:
        say: told the page's address, from a thread.
        grace_s: after the build's end, in which a page that is loaded anew may come back.

    Raises:
        MachineError: the studio's extra is not installed.
    """
    with needs_extra("--watch", "studio"):
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    command = [sys.executable, "-P", "-m", "knotfab.apps.studio.run", str(at_home(out).absolute())]
    child = subprocess.Popen(
        command if grace_s is None else [*command, str(grace_s)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, encoding="utf-8", start_new_session=True,
    )  # fmt: skip
    assert child.stdin is not None and child.stdout is not None
    told = child.stdout

    def announce() -> None:
        with told:
            address = told.readline().strip()
        if address:
            say(f"Watch it at {address}")

    threading.Thread(target=announce, daemon=True).start()
    try:
        yield child.stdin, child
    finally:
        with suppress(OSError):
            child.stdin.close()


def preview(
    *pictures: str,
    options: Annotated[PictureOptions, Parameter(name="*")] = _READ,
    out: Place = Path("knotfab-preview.png"),
    sequence: Flag = False,
    json: Flag = False,
) -> int:
    """Show what a picture will become: its silhouette, the tube that a build takes, and what that loses.

    Of an unclear picture, such as a photograph, it also tries other ways to read it, and draws them side by
    side, with the options that give each.

    Parameters
    ----------
    pictures
        As for knotfab build.
    out
        The PNG to write: the silhouette and, in red, what the tube loses. Other readings are drawn beside it,
        in NAME-readings.png.
    sequence
        The pictures are frames of one motion.
    json
        Print the figures as JSON.
    """
    from knotfab.base.disk import write_whole
    from knotfab.cli.summary import print_survey
    from knotfab.design.readings import draw_readings
    from knotfab.pipeline.prepare import preview_pictures
    from knotfab.report.pictures import draw_survey

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "a preview is a PNG", "Name a file in .png.")
    asked = BuildOptions(**vars(options), sequence=sequence)
    found, readings = preview_pictures(pictures, asked)
    write_whole(out, draw_survey(found))
    sheet = out.with_name(f"{out.stem}-readings.png")
    if readings:
        write_whole(sheet, draw_readings(readings))
    print_survey(found, out, json, readings, sheet)
    return 0


def batch(
    *pictures: str,
    options: Annotated[BuildOptions, Parameter(name="*")] = _DEFAULTS,
    jobs: Whole | None = None,
    cluster: str | None = None,
) -> int:
    """Build many pictures, each into knotfab-out/NAME, or --out/NAME; skip those that are built already.

    Parameters
    ----------
    pictures
        Picture files, folders of them, or text:…
    jobs
        How many builds run side by side; by default as many as cores and memory allow.
    cluster
        The address of a Dask scheduler, such as tcp://10.0.0.5:8786, whose workers build instead.
    """
    from knotfab.apps.batch.run import batch as run
    from knotfab.pipeline.prepare import check_options, require_same_picture

    check_options(options)
    records = run(pictures, options, jobs, cluster, require_same_picture)
    failed = sum(record["exit_code"] != 0 for record in records)
    if not options.quiet:
        print(
            f"{len(records) - failed} of {len(records)} passed: see {options.out or ALL_OUT}/index.html"
        )
    return 1 if failed else 0


def mcp(*, allow: tuple[Place, ...] = ()) -> int:
    """Serve preview, build, validate and shadow as tools for programs, over standard input and output (MCP).

    Parameters
    ----------
    allow
        A folder that the tools may read and write; may be repeated. The folder one is in by default. Relative
        paths start from the first.
    """
    with needs_extra("knotfab mcp", "mcp"):
        from knotfab.apps.mcp.server import serve
    serve(allow)
    return 0


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
        from knotfab.apps.studio.run import run_studio
    run_studio(port, not no_open, out)
    return 0
