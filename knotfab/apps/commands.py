"""The commands of the apps, loaded by entry points. Each imports what it needs only when it is called."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from knotfab.base.errors import needs_extra
from knotfab.pipeline.options import (
    ALL_OUT,
    BuildOptions,
    Flag,
    Place,
    PlanOptions,
    ToldOptions,
    Whole,
    list_given,
    with_examples,
)
from knotfab_formats.errors import InputError

if TYPE_CHECKING:
    from knotfab.apps.doctor import Finding

_DEFAULTS = BuildOptions()
_PLAN, _TOLD = PlanOptions(), ToldOptions()


@with_examples("""All options: knotfab preview --help-all

Examples:

```
knotfab preview logo.svg
knotfab preview badge.png --ink red --plate rounded
knotfab preview photo.jpg --ink flood --smooth 3 --out seen.png
```
""")
def preview(
    *pictures: str,
    options: Annotated[PlanOptions, Parameter(name="*")] = _PLAN,
    out: Place = Path("knotfab-preview.png"),
    json: Flag = False,
) -> int:
    """Tell what `knotfab build --print` will make of a picture, and show what the tube loses.

    Parameters
    ----------
    pictures
        As for knotfab build.
    out
        The PNG to write: the silhouette and, in red, what the tube loses.
    json
        Print the figures as JSON.
    """
    from knotfab.base.disk import write_whole
    from knotfab.base.progress import Progress
    from knotfab.pipeline.prepare import survey_pictures

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "a preview is a PNG", "Name a file in .png.")
    asked = BuildOptions(**vars(options))
    with Progress("auto") as progress:
        found = survey_pictures(pictures, asked, progress)
    import json as codec

    from knotfab.design.sentence import describe, list_figures
    from knotfab.report.pictures import draw_survey

    write_whole(out, draw_survey(found))
    if json:
        print(codec.dumps({**list_figures(found), "picture": str(out)}))
    else:
        print("\n".join([*describe(found), f"  {out} shows it, and in red what is lost."]))
    return 0


@with_examples("""All options: knotfab batch --help-all

Examples:

```
knotfab batch logos/ --out built --print
knotfab batch *.png --out built --accuracy draft --jobs 4
knotfab batch logos/ --out built --cluster tcp://10.0.0.5:8786
```
""")
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
    from knotfab_formats.verdict import POOR

    check_options(options)
    records = run(pictures, options, jobs, cluster, require_same_picture)
    failed = sum(record["exit_code"] != 0 for record in records)
    if not options.quiet:
        poor = sum(record["exit_code"] == 0 and record["verdict"] in POOR for record in records)
        but = f", {poor} of them coarse or worse" if poor else ""
        print(
            f"{len(records) - failed} of {len(records)} passed{but}: see {options.out or ALL_OUT}/index.html"
        )
    return 1 if failed else 0


@with_examples("""Examples:

```
knotfab studio
knotfab studio --port 8900 --no-open --out pieces
```
""")
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


@with_examples("""Examples:

```
knotfab compare wall.jpg knotfab-out/cat
knotfab compare wall.jpg knotfab-out/cat --click
knotfab compare wall.jpg knotfab-out/cat --corners 412,300 1630,322 1610,1490 395,1455
```
""")
def compare(
    photo: Path,
    folder: Path,
    /,
    *,
    corners: Annotated[tuple[str, str, str, str] | None, Parameter(negative="")] = None,
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
        left. By default the four marks of setup.pdf tell them.
    click
        Open a page to click the four corners; it then shows the command with --corners.
    view
        Name of the view; the first by default.
    out
        The PNG that shows where shadow and picture differ.
    json
        Print the figures as JSON.
    """
    from knotfab.apps.compare.compare import (
        compare_photo,
        print_comparison,
        write_click_page,
        write_comparison,
    )

    if click:
        page, more = out.with_suffix(".html"), [] if view is None else ["--view", view]
        command = ["knotfab", "compare", str(photo), str(folder), *more, "--out", str(out)]
        write_click_page(photo, command, page)
        print(f"Point at the corners of the frame on {page}: it says how to go on.")
        webbrowser.open(page.resolve().as_uri())
        return 0
    found = compare_photo(photo, folder, corners, view)
    write_comparison(found, out)
    print_comparison(found, out, json)
    return 1 if found.alike is False else 0


@with_examples("""All options: knotfab tradeoff --help-all

Examples:

```
knotfab tradeoff cat.png
knotfab tradeoff cat.png --accuracy draft --out cat-tradeoff
knotfab tradeoff cat.png --size 120 --mount stand
knotfab tradeoff logos/*.png --time-limit 1h         give the same call again to go on
knotfab tradeoff cat.png --print                     hours and grams of each way to print it
```
""")
def tradeoff(
    *pictures: str,
    options: Annotated[ToldOptions, Parameter(name="*")] = _TOLD,
    out: Place = Path("knotfab-tradeoff"),
    time_limit: str | None = None,
) -> int:
    """Measure what accuracy costs in time on this machine: whole builds, with one setting after another.

    With --print it measures what printing costs instead: builds with and without supports, on plates, at
    other depths, radii and accuracies, in PrusaSlicer's hours and grams too.

    Parameters
    ----------
    pictures
        Image files, SVGs, or text:…; each makes a piece of its own, and the figures are means over them.
    out
        The folder for tradeoff.json and .png, and for the builds, from which a later call goes on.
    time_limit
        Stop after this time, and report what was measured until then: 30 (seconds), 10m or 1h.
    """
    from knotfab.base.progress import Progress
    from knotfab.picture.raster import GLANCE
    from knotfab.pipeline.prepare import read_call
    from knotfab.pipeline.values import read_seconds

    if not pictures:
        raise InputError("tradeoff", "no picture is named", "Name one, or several")
    if options.sequence:
        raise InputError("--sequence", "each picture is a piece of its own here", "Leave it out.")
    limit_s = None if time_limit is None else read_seconds(time_limit, "--time-limit")
    asked = BuildOptions(**vars(options))
    # all are read, so that what cannot be built is reported at once
    chosen, *_ = (read_call([one], asked, Progress("quiet"), GLANCE).scene for one in pictures)
    from knotfab.apps.tradeoff.run import print_ways
    from knotfab.apps.tradeoff.run import tradeoff as run

    given = {
        k: v for k, v in list_given(options).items() if k not in ("print_", "quiet", "verbose")
    }
    middle, preset = chosen.settings, chosen.accuracy.name
    with Progress(options.mode) as progress:
        ways = run(pictures, out, given, middle, preset, progress, options.print_, limit_s)
    if not options.quiet:
        print_ways(ways, out)
    return 0


def doctor(*, compile_: Annotated[Flag, Parameter(name="--compile")] = False) -> int:
    """Say what this machine has and lacks, with the remedy for each.

    Parameters
    ----------
    compile_
        Only compile the search's loops, so that the first build need not wait for that.
    """
    from knotfab.apps.doctor import compile_loops, examine

    findings = [compile_loops()] if compile_ else examine()
    _print_findings(findings)
    return 3 if any(f.status == "missing" for f in findings) else 0


_STATES = {"ok": "[green]ok[/]", "missing": "[red]missing[/]", "warning": "[yellow]warning[/]"}


def _print_findings(findings: Sequence[Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False, soft_wrap=True)
    for finding in findings:
        name, detail = escape(finding.name), escape(finding.detail)
        console.print(f"{_STATES[finding.status]:<20} {name}: {detail}")
        if finding.remedy and finding.status != "ok":
            console.print(f"        {escape(finding.remedy)}")
