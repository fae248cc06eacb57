"""The commands that measure something: a part, its shadow, a photograph of it, what accuracy costs."""

from __future__ import annotations

import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from knotfab.pipeline.options import Flag, Names, Place, Whole, options_from
from knotfab_formats.errors import InputError


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
    """Measure written files again, with other code than the code that wrote them.

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
        The PNG that shows where checks failed; by default NAME-failures.png beside the part.
    skip
        Leave out these checks, such as shadow-render.
    unit
        Of the numbers in an STL, OBJ or PLY.
    """
    from knotfab.pipeline.verifier import Verifier, load_early

    with load_early(skip):
        from knotfab.pipeline.read_options import read_skips
        from knotfab.pipeline.strangers import plain_arrays
        from knotfab.pipeline.verifier import files_to_validate

        files, skipped = files_to_validate(part, knots, scene, failures), read_skips(skip)
        with Verifier(skipped) as verifier, plain_arrays(files.part) as read:
            verdict = verifier.submit(replace(files, part=read), unit=unit).result()
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


def shadow(part: Path, /, *, scene: Path, out: Place, view: str | None = None) -> int:
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
    from knotfab.pipeline.strangers import render_shadow

    render_shadow(part, scene, out, view)
    which = "" if view is None else f" in the view {view}"
    print(f"{out} shows the shadow of {part}{which}.")
    return 0


def compare(
    photo: Path,
    folder: Path,
    /,
    *,
    corners: Annotated[tuple[str, str, str, str] | None, Parameter(negative="")] = None,
    click: Flag = False,
    view: str | None = None,
    out: Place = Path("knotfab-compare.png"),
    fix: Flag = False,
    build: Flag = False,
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
    fix
        Also write FOLDER/fixed.toml, the scene with the lamp where it stands, and say what moving the lamp
        alone would bring, and what a new part would.
    build
        Build that new part too, into FOLDER-fixed.
    json
        Print the figures as JSON.
    """
    from knotfab.apps.compare.compare import compare_photo, write_comparison
    from knotfab.cli.summary import print_comparison

    if click:
        from knotfab.apps.compare.fix import write_click_page

        page, more = out.with_suffix(".html"), [] if view is None else ["--view", view]
        command = ["knotfab", "compare", str(photo), str(folder), *more, "--out", str(out)]
        write_click_page(photo, command, page)
        print(f"Point at the corners of the frame on {page}: it says how to go on.")
        webbrowser.open(page.resolve().as_uri())
        return 0
    found = compare_photo(photo, folder, corners, view)
    write_comparison(found, out)
    plan = None
    if fix or build:
        from knotfab.apps.compare.fix import plan_fix

        plan = plan_fix(found, folder, view)
    print_comparison(found, out, json, plan)
    if plan is None or not build:
        return 0
    from knotfab.cli.make import build as build_part
    from knotfab.pipeline.options import BuildOptions

    place = folder.resolve()
    options = BuildOptions(scene=plan.scene, out=place.with_name(f"{place.name}-fixed"), quiet=json)
    return build_part(options=options)


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
    from knotfab.base.progress import Progress
    from knotfab.picture.read import read_target
    from knotfab.pipeline.read_options import read_scene, read_seconds

    for name, value, least in (
        ("--repeats", repeats, 1),
        ("--jobs", jobs, 1),
        ("--combinations", combinations, 0),
    ):
        if not least <= value <= 10_000:
            raise InputError(f"{name} {value}", "it is out of bounds", f"Give {least} to 10000.")
    if not pictures:
        raise InputError("tradeoff", "no picture is named", "Name one, or several")
    limit_s = None if time_limit is None else read_seconds(time_limit, "--time-limit")
    asked = {"scene": scene, "accuracy": accuracy, "tube_radius": tube_radius}
    options = options_from(asked)
    chosen, _ = read_scene(options)
    for picture in pictures:
        read_target(picture, chosen.views[0])  # a file that is no picture is told at once
    from knotfab.apps.tradeoff.run import tradeoff as run

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
