"""The command line: thin wrappers over library calls, and the exit codes of the contract."""

from __future__ import annotations

import os
import shlex
import signal
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.exceptions import CycloptsError

from knotfab import __version__
from knotfab.errors import InputError, KnotfabError

__all__ = ["app", "main"]

app = App(
    name="knotfab",
    version=__version__,
    help="A picture becomes a knotted tube whose shadow is that picture, proved before it is printed.\n\n"
    "Exit codes: 0 every required check passed; 1 a check failed or the scene cannot be met; "
    "2 wrong input; 3 this machine lacks something; 130 interrupted.",
    suppress_keyboard_interrupt=False,  # main says what became of the work
)

Skip = Annotated[tuple[str, ...], Parameter(negative="")]


@app.command
def build(
    *pictures: str,
    print_: Annotated[bool, Parameter(name="--print", negative="")] = False,
    sequence: Annotated[bool, Parameter(negative="")] = False,
    out: Path = Path("knotfab-out"),
    scene: Path | None = None,
    accuracy: Literal["draft", "standard", "fine"] | None = None,
    time_budget: str | None = None,
    tube_radius: str | None = None,
    depth: str | None = None,
    knots: str | None = None,
    knot: str | None = None,
    search: Literal["flow", "inn", "inn+flow"] | None = None,
    free: Literal["view"] | None = None,
    mount: Literal["wall", "stand", "none"] | None = None,
    printer: str | None = None,
    material: str | None = None,
    seed: int | None = None,
    invert: Annotated[bool, Parameter(negative="")] = False,
    device: Literal["cpu", "cuda"] = "cpu",
    colours: Annotated[bool, Parameter(negative="")] = False,
    skip: Skip = (),
    quiet: Annotated[bool, Parameter(negative="")] = False,
    verbose: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Turn a picture, or several, into a verified part.

    Parameters
    ----------
    pictures
        An image file, an SVG, or text:… (a glyph); may be left out where the scene names it. Several
        are several views of one part, spread about the vertical axis: two at right angles, three at 60°.
    print_
        Check it against the printer too, and pose it for printing.
    sequence
        The pictures are frames of one moving knot: a folder of numbered pictures, an animation (GIF), or
        the pictures in their order. Each frame becomes a part; with --print there is a zoetrope as well.
    out
        The folder to write.
    scene
        A scene.toml; the other options are shorthands for its keys and win over it.
    accuracy
        draft, standard (default) or fine.
    time_budget
        Seconds for the whole build, such as 30 or 30s; sets the iterations.
    tube_radius
        mm, or auto (default): the thickest tube that draws the picture well.
    depth
        Extent along the view in mm, auto (default: unreadable from elsewhere), or flat.
    knots
        auto (default: one a piece of the picture) or 1: all bridged into one.
    knot
        The knot to be tied into it: unknot (default), trefoil, "left trefoil", figure-eight, any of the
        table up to 8 crossings (5_2, 8_19), or a sum (3_1#4_1).
    search
        flow (default: the certified flow), inn (the paper's invertible network), or inn+flow, the
        one after the other.
    free
        view: pose, light and wall distance and the tube's radius are found with the knots, and written
        to scene.toml.
    mount
        What holds the piece, with --print: wall (pegs along light rays, in the tube's own shadow, on a
        plate whose face is the wall, or in drilled holes), stand (a base below the picture), none (default).
    printer
        A printer's name, such as prusa-mk4, or a file such as my-printer.toml; knotfab printers lists
        the names.
    material
        A material's name, such as petg, or a file.
    seed
        Of the random depth profiles.
    invert
        Draw what is light on dark.
    device
        Where the search runs.
    colours
        Write part-colours.3mf as well: the bodies by name, each in a colour, for several filaments.
    skip
        Checks to go on without, such as shadow-render.
    quiet
        Say nothing but errors.
    verbose
        Say how long each stage took.
    """
    from knotfab.cli.options import scene_of, seconds_of, skips_of
    from knotfab.progress import Mode, Progress
    from knotfab.request import Request
    from knotfab.verify.checks import unmet

    chosen, base = scene_of(
        scene,
        accuracy=accuracy,
        tube_radius=tube_radius,
        depth=depth,
        knots=knots,
        knot=knot,
        printer=printer,
        material=material,
        mount=mount,
        seed=seed,
        search=search,
        free_view=free == "view",
        invert=invert,
    )
    sources = _sources(pictures, [view.picture for view in chosen.views], scene)
    if sequence and time_budget is not None:
        raise InputError(
            f"--time-budget {time_budget}",
            "it is for one picture, and a sequence has many",
            "Leave it out, or use --accuracy draft",
        )
    if not sequence and len(sources) > len(chosen.views) == 1:
        from knotfab.design.frames import spread_views

        chosen = spread_views(chosen, len(sources))
    budget = None if time_budget is None else seconds_of(time_budget)
    skipped = skips_of(skip)
    mode: Mode = "quiet" if quiet else "verbose" if verbose else "auto"
    command = shlex.join(["knotfab", *sys.argv[1:]])
    base = base if not pictures else None
    if sequence:
        from knotfab.sequence.build import build_sequence as run
    else:
        from knotfab.pipeline import build as run
    request = Request(chosen, sources, out, base, print_, device, skipped, budget, command, colours)
    with Progress(mode) as progress:
        outcome = run(request, progress)
    failed = [c["name"] for c in unmet(outcome.report["checks"]) if c["status"] == "fail"]
    if quiet and failed:
        print(
            f"knotfab: {', '.join(failed)} failed: see {outcome.folder}/report.html",
            file=sys.stderr,
        )
    if not quiet:
        from knotfab.cli.summary import print_summary

        print_summary(outcome)
    return outcome.exit_code


@app.command
def validate(
    part: Path | None = None,
    *,
    knots: Path | None = None,
    scene: Path | None = None,
    json: Annotated[bool, Parameter(negative="")] = False,
    failures: Path | None = None,
    skip: Skip = (),
) -> int:
    """Measure written files again, with other code than wrote them.

    Parameters
    ----------
    part
        A folder that a build wrote, or an STL, 3MF, OBJ or PLY file in mm.
    knots
        The centre lines, knots.json.
    scene
        The scene, scene.toml.
    json
        Print {"status", "checks", "views", "picture"} as JSON.
    failures
        Where to draw the part with the places of what failed; NAME-failures.png beside it by default.
    skip
        Checks to go on without, such as shadow-render.
    """
    from knotfab.cli.options import files_to_validate, skips_of
    from knotfab.verify.verifier import Verifier

    files, skipped = files_to_validate(part, knots, scene, failures), skips_of(skip)
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


@app.command
def shadow(part: Path, *, scene: Path, out: Path, view: str | None = None) -> int:
    """Render the shadow that a part casts in a scene, as a picture.

    Parameters
    ----------
    part
        An STL or 3MF in print coordinates.
    scene
        scene.toml with its [pose].
    out
        The PNG to write.
    view
        Name of the view; the first by default.
    """
    from knotfab.verify.shadow import render_shadow

    render_shadow(part, scene, out, view)
    return 0


@app.command
def tradeoff(
    picture: str,
    *,
    out: Path = Path("knotfab-tradeoff"),
    scene: Path | None = None,
    accuracy: Literal["draft", "standard", "fine"] | None = None,
    tube_radius: str | None = None,
    repeats: int = 1,
    device: Literal["cpu", "cuda"] = "cpu",
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Measure what accuracy costs in time, for one picture on this machine.

    Parameters
    ----------
    picture
        An image file, an SVG, or text:…
    out
        The folder for tradeoff.json and tradeoff.png.
    scene
        A scene.toml.
    accuracy
        The preset around which one knob at a time is turned; standard by default.
    tube_radius
        mm, or auto (default), the same for all points.
    repeats
        Runs a point; the seconds are medians of them.
    device
        Where the search runs.
    quiet
        Say nothing but errors.
    """
    from knotfab.cli.options import scene_of
    from knotfab.progress import Progress
    from knotfab.tradeoff.run import tradeoff as run

    if repeats < 1:
        raise InputError(f"--repeats {repeats}", "it is not a positive number", "Give 1 or more")
    chosen, _ = scene_of(scene, accuracy=accuracy, tube_radius=tube_radius)
    with Progress("quiet" if quiet else "auto") as progress:
        found = run(chosen, picture, out, None, repeats, device, progress)
    if not quiet:
        from knotfab.cli.summary import print_tradeoff

        print_tradeoff(found)
    return 0


@app.command
def doctor() -> int:
    """Say what this machine has and lacks, with the remedy for each."""
    from knotfab.cli.summary import print_findings
    from knotfab.doctor import examine

    findings = examine()
    print_findings(findings)
    return 3 if any(f.status == "missing" for f in findings) else 0


@app.command
def printers() -> int:
    """List the printers and materials that are known by name, one's own included, with their figures."""
    from knotfab.cli.summary import print_catalogue
    from knotfab.scene.catalogue import materials
    from knotfab.scene.catalogue import printers as known
    from knotfab.scene.own_data import data_folder

    print_catalogue(known(), materials(), data_folder())
    return 0


def _sources(pictures: tuple[str, ...], of_scene: list[str], scene: Path | None) -> tuple[str, ...]:
    """The pictures of the call, or those of the scene's views."""
    if pictures:
        return pictures
    if all(of_scene):
        return tuple(of_scene)
    raise InputError(
        "the call" if scene is None else str(scene),
        "no picture is given",
        "Name one, as in: knotfab build target.png --print",
    )


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit code."""
    # many small products: threads that wait for each other cost more than they bring, and up to
    # ten times on a shared machine; read when numpy is first imported
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # asked to end, tidy up as after Ctrl-C
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except KnotfabError as error:
        print(f"knotfab: {error}", file=sys.stderr)
        code = error.exit_code
    except CycloptsError as error:
        print(f"knotfab: {error} See: knotfab --help", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        print("knotfab: interrupted; nothing was changed", file=sys.stderr)
        code = 130
    sys.exit(code if isinstance(code, int) else 0)
