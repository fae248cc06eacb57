"""Turn a call into a checked request. Whatever can be refused is refused before anything heavy loads."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from knotfab.base.errors import SceneError
from knotfab.base.limited import run_limited
from knotfab.base.progress import Progress
from knotfab.design.budget import require_budget
from knotfab.design.candidates import PICTURE
from knotfab.design.frames import (
    direct_views,
    size_frames,
    size_longer,
    spread_views,
    widen_targets,
)
from knotfab.picture.colours import is_photo
from knotfab.picture.doubt import UNSURE
from knotfab.picture.frames import count_knots, name_sequence, read_frames
from knotfab.picture.ground import LIFT
from knotfab.picture.raster import GLANCE, decode_shrunk, encode_mask
from knotfab.picture.read import Target, name_targets, read_targets
from knotfab.picture.source import DRAWN_SUFFIXES, SECONDS, TEXT_PREFIX, plain_name
from knotfab.pipeline.choose_supports import choose_supports
from knotfab.pipeline.options import ALL_OUT, BuildOptions
from knotfab.pipeline.read_lamps import Call, read_lamps
from knotfab.pipeline.read_options import read_scene, read_skips
from knotfab.pipeline.values import read_seconds
from knotfab.request import Promise, Request
from knotfab.scene.require import (
    require_mount,
    require_sequence,
    require_several,
    require_start,
    require_supports,
    require_tube,
)
from knotfab_formats.errors import InputError, KnotfabError
from knotfab_formats.scene import ResolvedScene

if TYPE_CHECKING:
    from knotfab.design.agree import Agreement
    from knotfab.design.survey import Survey

_SCATTERED = 12  # pieces, crumbs aside, of a photograph of which another reading draws others


def prepare_build(
    pictures: Sequence[str],
    options: BuildOptions,
    command: str,
    progress: Progress,
    when_read: Callable[[], object] = lambda: None,
) -> Request:
    """Check a call, read its pictures and survey them.

    Args:
        pictures: files, SVGs or `text:…`; if none are given, those that the scene names.
        command: the command line, for the report.
        when_read: called before anything heavy is loaded, unless words or files of the call are refused.

    Raises:
        InputError: an option, the scene or a picture is wrong.
    """
    skipped = read_skips(options.skip)
    call = read_call(pictures, options, progress)
    printing = _is_printed(options, call.scene)
    out = options.out or ALL_OUT / call.name
    if options.out is None and not options.force:
        _keep_other_picture(out, call.targets)
    if (out / "batch.json").is_file() and not options.force:
        raise InputError(
            f"--out {out}",
            "it holds the builds of a batch",
            f"Name a folder in it, such as {out / call.name}, or add --force.",
        )
    when_read()
    with progress.stage("preview"):
        # imported only now, so that an unreadable picture is refused without waiting for them
        from knotfab.design.sentence import describe
        from knotfab.design.survey import require_drawable

        # where a promise is made of what is told: from the start, with which the search then begins
        placed = printing and not options.sequence and not call.scene.settings.free_view
        way, found = _survey_first(call, options.sequence, printing, placed)
    require_drawable(found)
    scene, otherwise, why = way
    return Request(
        scene,
        call.targets,
        out,
        printing=printing,
        device=options.device,
        skip=skipped,
        time_budget_s=call.budget_s,
        command=command,
        colours=options.colours,
        sequence=options.sequence,
        preview=tuple(describe(found)),
        promise=_promise(found, scene),
        otherwise=otherwise,
        why_supported=why,
    )


def _promise(found: Survey, scene: ResolvedScene) -> Promise | None:
    """Return what a build makes unless it must build again; None if a search decides it."""
    from knotfab.design.sentence import hold_of
    from knotfab.pipeline.unlit import guess_told

    if len(found.views) > 1 or found.frames or scene.settings.free_view or not found.chosen:
        return None
    guess, holder = found.guess, hold_of(found.scene)
    costs = guess.mass_g, guess.hours, guess.length_mm
    return Promise(found.radius_mm, holder, *costs, guess_told(found))


def require_same_picture(folder: Path, picture: str, options: BuildOptions) -> None:
    """Refuse to replace a folder's build of another picture. A picture that cannot be read replaces nothing.

    Raises:
        InputError: there is such a build.
    """
    if (folder / "report.json").is_file():
        try:
            targets = read_call((picture,), options, Progress(options.mode)).targets
        except KnotfabError:
            return
        _keep_other_picture(folder, targets)


def check_options(options: BuildOptions) -> None:
    """Refuse options with which no picture could be built.

    Raises:
        InputError: naming the option.
    """
    read_skips(options.skip)
    if options.time_budget is not None:
        read_seconds(options.time_budget)
    read_scene(options)


def survey_pictures(
    pictures: Sequence[str], options: BuildOptions, progress: Progress | None = None
) -> Survey:
    """Survey the pictures of a call: what a build of them with `--print` makes.

    Raises:
        InputError: as for `prepare_build`.
    """
    progress = progress or Progress("quiet")
    call = read_call(pictures, options, progress, glance=GLANCE)
    with progress.stage("preview"):
        found = _survey_first(call, options.sequence, True, placed=True)[1]
        # imported only now, as above
        from knotfab.pipeline.unlit import guess_told

        return replace(found, guess=replace(found.guess, told=guess_told(found)))


def read_call(
    pictures: Sequence[str], options: BuildOptions, progress: Progress, glance: int = 0
) -> Call:
    """Read scene and pictures of a call; `glance` as for `read_target`.

    Raises:
        InputError: as for `prepare_build`.
    """
    if options.no_loop and not options.sequence:
        raise InputError(
            "--no-loop", "one piece has no last frame", "Leave it out, or add --sequence."
        )
    budget = None if options.time_budget is None else read_seconds(options.time_budget)
    call = _read_pieces(pictures, options, progress, glance)
    if budget is not None:
        free, frames = call.scene.settings.free_view, len(call.targets) * options.sequence
        require_budget(budget, len(call.scene.views), bool(free), frames)
    return replace(call, budget_s=budget)


def _read_pieces(
    pictures: Sequence[str], options: BuildOptions, progress: Progress, glance: int
) -> Call:
    scene, folder = read_scene(options)
    sources = _list_sources(pictures, scene, options.scene)
    _check_font(options.font, sources)
    base = None if pictures else folder
    if options.lamps is not None or scene.share_wall:
        _refuse_directions(options, "lamps before one screen have places by themselves")
        return read_lamps(scene, sources, options, base, progress, named=not pictures)
    scene, open_ = _place_views(scene, sources, options)
    _require(scene)
    with progress.stage("picture"):
        targets = _read_pictures(scene, sources, options, base, not pictures, glance)
    scene, targets = _size(scene, targets, options)
    agreed: Agreement | None = None
    if len(scene.views) > 1:
        with progress.stage("agree"):
            from knotfab.design.agree import agree, require_agreed

            agreed = agree(scene, targets, azimuths_open=open_)
            require_agreed(agreed, scene)
        scene, targets = agreed.scene, agreed.targets
    names = [name_sequence(sources[0])] if options.sequence else [t.name for t in targets]
    name = plain_name("-".join(dict.fromkeys(names)), "picture")
    told = (*(agreed.lines if agreed else ()), *_tell_knots(scene, targets))
    return Call(scene, targets, name, told, agreed)


def _survey_first(
    call: Call, sequence: bool, printing: bool, placed: bool = False
) -> tuple[tuple[ResolvedScene, ResolvedScene | None, str], Survey]:
    """Survey a call as it is built first: its scene, the one to build after it, and why it has supports."""
    way = choose_supports(call.scene, call.targets, printing)
    found = _survey(replace(call, scene=way[0]), sequence, printing, placed)
    error, otherwise = found.refusal, way[1]
    if error is not None and error.what != PICTURE and otherwise is not None:
        other = _survey(replace(call, scene=otherwise), sequence, printing, placed)
        if other.refusal is None or other.refusal.what != error.what:  # else that costs more still
            way, found = (otherwise, None, error.why), other
    told = (f"it gets the slicer's supports: {way[2]}",) if way[2] else ()
    return way, replace(found, told=(*found.told, *told))


def _refuse_directions(options: BuildOptions, why: str, or_else: str = "") -> None:
    if options.directions is not None:
        raise InputError(f"--directions {options.directions}", why, f"Leave it out{or_else}")


def _place_views(
    scene: ResolvedScene, sources: Sequence[str], options: BuildOptions
) -> tuple[ResolvedScene, bool]:
    """Give each picture its view and direction. Returns also whether an agreement may turn them."""
    open_ = False
    if options.sequence:
        require_sequence(scene)
    elif len(sources) > len(scene.views) == 1:
        scene, open_ = spread_views(scene, sources), options.directions is None
    if options.sequence or len(scene.views) < 2:
        why = "it is for several pictures of one part"
        _refuse_directions(options, why, ", or name a picture for each direction")
        return scene, False
    if options.directions is not None:
        scene = direct_views(scene, options.directions)
    require_several(scene)
    if scene.settings.free_view:
        from knotfab.design.settings import place_directions

        # directions start where an earlier build's did, or else anywhere
        open_ = open_ or not (options.directions or scene.search.get("free_azimuths_deg"))
        scene = place_directions(scene, scene.settings)[0]
    return scene, open_


def _require(scene: ResolvedScene) -> None:
    """Refuse what contradicts itself before a picture is read."""
    require_mount(scene)
    require_supports(scene)
    require_tube(scene)
    require_start(scene)


def _read_pictures(
    scene: ResolvedScene,
    sources: Sequence[str],
    options: BuildOptions,
    base: Path | None,
    named: bool,
    glance: int,
) -> tuple[Target, ...]:
    """Read the pictures of views, or of frames; where the scene `named` them, with its titles."""
    if options.sequence:
        targets = read_frames(sources, scene.views[0], base=base, font=options.font)
        count_knots(targets, scene.piece.knots)  # refuses too many knots
        return targets
    targets = read_targets(sources, scene.views, base=base, font=options.font, glance=glance)
    return name_targets(targets, scene.views) if named else targets


def _size(
    scene: ResolvedScene, targets: tuple[Target, ...], options: BuildOptions
) -> tuple[ResolvedScene, tuple[Target, ...]]:
    """Give the frames their sides, and fit pictures to the tubes that draw them."""
    if options.size is not None:
        scene = size_longer(scene, targets[0], options.size)
    if not options.sequence and (options.size or options.width or options.height):
        scene = size_frames(scene, targets)
    return widen_targets(scene, targets, options.sequence)


def _tell_knots(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[str, ...]:
    """Say that more knots than pieces were asked for."""
    pieces, asked = targets[0].pieces, scene.piece.knots
    if len(targets) > 1 or not isinstance(asked, int) or asked <= pieces:
        return ()
    is_ = "is one piece, and becomes one knot" if pieces == 1 else f"has {pieces} pieces"
    return (f"--knots {asked}: the picture {is_}. A knot more would draw nothing",)


def _survey(call: Call, sequence: bool, printing: bool, placed: bool = False) -> Survey:
    """Survey the pictures of a call, with the tube that a build chooses where no budget decides it."""
    from knotfab.design.survey import survey

    scene = call.scene.but(piece=call.scene.piece.but(printed=printing))
    lost = len(call.targets) == 1 and _is_scattered(call.targets[0], scene)
    held = scene.mount.kind in ("stand", "hang") and not scene.settings.free_view
    strokes = any(view.lines for view in scene.views)
    choose = call.budget_s is None and not lost
    if held or strokes:
        # imported only now, as in prepare_build
        from knotfab.pipeline.held import lay_strands, refuse_holder
    lay = lay_strands if strokes else None
    found = survey(scene, call.targets, sequence, choose, placed or held or strokes, lay)
    if held and found.refusal is None:
        found = replace(found, refusal=refuse_holder(found))
    error = found.refusal
    if lost:
        parts = f"it has {found.views[0].pieces} pieces, and another reading draws others"
        found = replace(found, refusal=_refuse_photograph(parts))
    elif (
        error is not None
        and error.what == PICTURE
        and len(found.views) == 1
        and _is_photograph(found.views[0].target)
    ):
        found = replace(found, refusal=_refuse_photograph(error.why))
    bounds = call.agreed.bounds if call.agreed else ()
    return replace(found, bounds=bounds, told=call.told, parted=call.parted)


def _refuse_photograph(why: str) -> SceneError:
    return SceneError(PICTURE, f"it is a photograph, and no drawing: {why}", LIFT)


def _is_scattered(target: Target, scene: ResolvedScene) -> bool:
    """Return whether a picture is a photograph of which no reading draws one thing."""
    unsure = any(note.startswith(UNSURE) for note in target.notes)
    asked = "unrecognisable" in scene.accuracy.accept
    return unsure and not asked and target.pieces > _SCATTERED and _is_photograph(target)


def _is_photograph(target: Target) -> bool:
    def look() -> bool:
        given = target.given
        return (
            given is not None
            and given.suffix not in DRAWN_SUFFIXES
            and is_photo(decode_shrunk(given.data, target.shown, GLANCE)[0])
        )

    return run_limited(look, target.shown, seconds=SECONDS)


def _is_printed(options: BuildOptions, scene: ResolvedScene) -> bool:
    """Return whether the piece is to be printed, as every mounted one is."""
    return options.print_ or scene.piece.printed or scene.mount.asked


def _list_sources(
    pictures: Sequence[str], scene: ResolvedScene, path: Path | None
) -> tuple[str, ...]:
    for name in pictures:
        if Path(name).suffix.lower() == ".toml" and os.path.isfile(name):
            raise InputError(
                name, "it is a scene, not a picture", f"Give it by its name: --scene {name}"
            )
    named = tuple(pictures) or tuple(view.picture for view in scene.views)
    if not any(named) and scene.lamps.picture:
        return (scene.lamps.picture,)
    if all(named):
        return named
    raise InputError(
        "" if path is None else str(path),
        "no picture is given",
        "Name one, as in: knotfab build cat.png --print",
    )


def _keep_other_picture(folder: Path, targets: Sequence[Target]) -> None:
    """Refuse to replace a folder's build of another picture.

    Raises:
        InputError: there is such a build.
    """
    if not (folder / "report.json").is_file():
        return
    held = {p.read_bytes() for kind in ("picture", "given") for p in folder.glob(f"{kind}-*.*")}
    ours = {t.given.data if t.given is not None else encode_mask(t.asked) for t in targets}
    if held.isdisjoint(ours):
        raise InputError(
            str(folder),
            "it holds what was built from another picture",
            "Name a folder (--out DIR), or replace that with --force.",
        )


def _check_font(font: str | None, sources: Sequence[str]) -> None:
    if font is not None and not any(s.startswith(TEXT_PREFIX) for s in sources):
        raise InputError(
            f"--font {font}",
            "it is for text, and no picture is one",
            "Leave it out, or give a text, as in: knotfab build text:Hello",
        )
