"""The job of each tool: a command of the command line, answered by words, figures and pictures."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from knotfab.base.disk import at_home, require_within
from knotfab.base.progress import Event
from knotfab_formats.errors import InputError, plain
from knotfab_formats.verdict import list_unmet

Given = dict[str, Any]  # arguments by their names, as a program gave them
Hear = Callable[[Event], object]
_UNITS = ("mm", "cm", "m", "in")


@dataclass(frozen=True)
class Answer:
    """A tool's answer: `figures` are plain data, `pictures` PNGs; `failed` if the result was not reached."""

    words: str
    figures: dict[str, Any]
    pictures: tuple[bytes, ...] = ()
    failed: bool = False


def preview(given: Given, hear: Hear, known: Collection[str]) -> Answer:
    """Do what `knotfab preview` does, but write a file only if `out` names one.

    Args:
        known: the names of the options.
    """
    from knotfab.base.disk import write_whole
    from knotfab.design.readings import describe_readings, draw_readings, list_figures
    from knotfab.design.sentence import describe
    from knotfab.pipeline.options import options_from
    from knotfab.pipeline.prepare import preview_pictures
    from knotfab.report.pictures import draw_survey

    pictures, out = _pictures(given), _png(given)
    found, readings = preview_pictures(pictures, options_from(given, known))
    drawn = (draw_survey(found), *((draw_readings(readings),) if readings else ()))
    if out is not None:
        write_whole(out, drawn[0])
    words = [*describe(found), *describe_readings(readings, "the second picture")]
    return Answer("\n".join(words), list_figures(found, readings), drawn)


def build(given: Given, hear: Hear, known: Collection[str]) -> Answer:
    """Do what `knotfab build` does, in an allowed folder."""
    from knotfab.api import build as run
    from knotfab.pipeline.options import options_from
    from knotfab.report.summary import conclude, last_line

    pictures = _pictures(given)
    options_from(given, known)  # refuses unknown options
    done = run(pictures, progress=hear, **given)
    report, found, folder = done.report, done.found, done.folder.resolve()
    files = sorted(path.name for path in folder.iterdir() if path.is_file())
    first = f"{report['status']}: {last_line(found)}{folder}"
    words = [first, *conclude(found, verbose=True), ", ".join(files)]
    figures = {
        "exit_code": done.exit_code,
        "folder": str(folder),
        "files": files,
        "verdict": report["verdict"],
        "views": [{key: view[key] for key in ("name", "iou")} for view in report["views"]],
        "failed": plain(list_unmet(found.checks)),
        "print": report["print"],
        "notes": report["notes"],
    }
    seen = sorted(folder.glob("compare-*.png"))[:1]
    pictures_ = tuple(path.read_bytes() for path in seen)
    return Answer("\n".join(words), figures, pictures_, done.exit_code != 0)


def validate(given: Given, hear: Hear, known: Collection[str]) -> Answer:
    """Do what `knotfab validate` does."""
    from knotfab.pipeline.read_options import read_skips
    from knotfab.pipeline.strangers import validate_files
    from knotfab.pipeline.verifier import files_to_validate
    from knotfab.report.summary import tell_unmet
    from knotfab.scene.load import load_scene

    skip, unit = given.pop("skip", []), given.pop("unit", "mm")
    part, knots, scene = (_take_path(given, name) for name in ("part", "knots", "scene"))
    _refuse_others(given, known)
    if unit not in _UNITS:
        raise InputError(f"unit {unit}", "it is none", f"Use {', '.join(_UNITS)}.")
    if not isinstance(skip, list) or not all(isinstance(name, str) for name in skip):
        raise InputError("skip", "it is no list of texts", 'Give one such as ["shadow-render"].')
    files, skipped = files_to_validate(part, knots, scene), read_skips(skip)
    for path in filter(None, (files.part, files.knots, files.scene)):  # links in a folder
        require_within(path)
    if files.scene is not None:  # whose pictures the validators read
        for view in load_scene(files.scene).views:
            for name in filter(None, (view.picture, view.subject_mask)):
                require_within(files.scene.parent / name, name)
    verdict = validate_files(files, skipped, unit, keep=True)
    figures = {**verdict.to_dict(), "exit_code": verdict.exit_code}
    drawn = () if verdict.picture is None else (Path(verdict.picture).read_bytes(),)
    words = [verdict.conclusion, *verdict.notes, *tell_unmet(verdict.checks)]
    return Answer("\n".join(words), figures, drawn)


def shadow(given: Given, hear: Hear, known: Collection[str]) -> Answer:
    """Do what `knotfab shadow` does, but write a file only if `out` names one."""
    from knotfab.pipeline.strangers import render_shadow

    out, view = _png(given), given.pop("view", None)
    part, scene = _take_path(given, "part"), _take_path(given, "scene")
    _refuse_others(given, known)
    if part is None:
        raise InputError("shadow", "part is missing", "Name a part and its scene, or their folder.")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "shadow.png"
        render_shadow(part, scene, path, view)
        drawn = path.read_bytes()
    if out is not None:
        from knotfab.base.disk import write_whole

        write_whole(out, drawn)
    which = "" if view is None else f" in the view {view}"
    where = {} if out is None else {"picture": str(out)}
    return Answer(f"The shadow of {part}{which}.", {"part": str(part), **where}, (drawn,))


def _pictures(given: Given) -> list[str]:
    """Take the pictures out of a call; files must be in an allowed folder."""
    found = given.pop("pictures", [])
    named = [found] if isinstance(found, str) else found
    if not isinstance(named, list) or not all(isinstance(name, str) for name in named):
        raise InputError("pictures", "they are no list of texts", 'Give one such as ["cat.png"].')
    for name in named:
        if not name.startswith("text:"):
            require_within(name)
    return named


def _take_path(given: Given, name: str) -> Path | None:
    """Take a path out of a call; None if it is not given."""
    value = given.pop(name, None)
    if value is None:
        return None
    if not isinstance(value, str) or not value.strip():
        raise InputError(name, "it names no place", "Name a file or folder.")
    require_within(value)
    return at_home(value)


def _png(given: Given) -> Path | None:
    out = _take_path(given, "out")
    if out is not None and out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "a preview is a PNG", "Name a file in .png.")
    return out


def _refuse_others(given: Given, known: Collection[str]) -> None:
    for name in given:
        raise InputError(
            f"the option {name}", "there is none of that name", f"Known: {', '.join(known)}"
        )
