"""From a call to a build that may begin: what can be refused is, before anything heavy is loaded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from knotfab.cli.build_options import BuildOptions
from knotfab.cli.options import scene_of, seconds_of, skips_of
from knotfab.errors import InputError
from knotfab.progress import Progress
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Scene
from knotfab.scene.settings import search_settings
from knotfab.target.read import TEXT_PREFIX, read_targets

if TYPE_CHECKING:
    from knotfab.pipeline import Outcome

__all__ = ["check_names", "prepare_build"]


def prepare_build(
    pictures: Sequence[str], options: BuildOptions, command: str, progress: Progress
) -> Callable[[], Outcome]:
    """Check a call and read its pictures.

    Args:
        pictures: files, SVGs or `text:…`; none: those that the scene names.
        command: the call in words, for the report.

    Returns:
        What builds, once called: torch and the geometry kernels are loaded only then.

    Raises:
        InputError: an option, the scene or a picture is wrong.
    """
    skipped = skips_of(options.skip)
    budget = None if options.time_budget is None else seconds_of(options.time_budget)
    if options.sequence and budget is not None:
        raise InputError(
            f"--time-budget {options.time_budget}",
            "it is for one picture, and a sequence has many",
            "Leave it out, or use --accuracy draft",
        )
    scene, folder = scene_of(options)
    check_names(scene)
    sources = _sources(pictures, scene, options.scene)
    _check_font(options.font, sources)
    base = None if pictures else folder
    if options.sequence:
        return _prepare_sequence(sources, scene, base, options, skipped, command, progress)
    if len(sources) > len(scene.views) == 1:
        from knotfab.design.frames import spread_views

        scene = spread_views(scene, len(sources))
    inverts = [view.invert for view in scene.views]
    with progress.stage("picture"):
        targets = read_targets(sources, inverts, base=base, font=options.font)

    def run() -> Outcome:
        from knotfab.pipeline import Request, build

        request = Request(
            scene,
            sources[0],
            options.out,
            base,
            _prints(options, scene),
            options.device,
            skipped,
            budget,
            command,
            sources[1:],
            targets,
        )
        return build(request, progress)

    return run


def _prepare_sequence(
    sources: tuple[str, ...],
    scene: Scene,
    base: Path | None,
    options: BuildOptions,
    skipped: frozenset[str],
    command: str,
    progress: Progress,
) -> Callable[[], Outcome]:
    """The same for frames of one moving knot."""
    from knotfab.sequence.frames import read_frames
    from knotfab.sequence.require import require_sequence

    require_sequence(scene)
    with progress.stage("pictures"):
        frames = read_frames(sources, invert=scene.views[0].invert, base=base, font=options.font)

    def run() -> Outcome:
        from knotfab.sequence.build import SequenceRequest, build_sequence

        request = SequenceRequest(
            scene,
            sources,
            options.out,
            base,
            _prints(options, scene),
            options.device,
            skipped,
            command,
            frames,
        )
        return build_sequence(request, progress)

    return run


def _prints(options: BuildOptions, scene: Scene) -> bool:
    """Whether the piece is to be printed: a mount is, whoever asked for it."""
    return options.print_ or scene.mount.kind != "none"


def check_names(scene: Scene) -> None:
    """Refuse a printer or material that is not known, and search settings that are none.

    Raises:
        InputError: naming those that there are.
    """
    resolve(scene)
    search_settings(scene.accuracy.name, scene.search)


def _sources(pictures: Sequence[str], scene: Scene, path: Path | None) -> tuple[str, ...]:
    """The pictures of the call, or those of the scene's views."""
    named = tuple(pictures) or tuple(view.picture for view in scene.views)
    if all(named):
        return named
    raise InputError(
        "the call" if path is None else str(path),
        "no picture is given",
        "Name one, as in: knotfab build target.png --print",
    )


def _check_font(font: str | None, sources: Sequence[str]) -> None:
    if font is not None and not any(s.startswith(TEXT_PREFIX) for s in sources):
        raise InputError(
            f"--font {font}",
            "it is for text, and no picture is one",
            "Leave it out, or give a text, as in: knotfab build text:Hello",
        )
