"""Read a call with several lamps before one screen: a mask for each lamp, and their places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knotfab.base.progress import Progress
from knotfab.design.frames import name_views, size_longer, widen_targets
from knotfab.picture.read import Given, Target, name_targets, read_targets
from knotfab.picture.source import name_picture, plain_name, read_bytes
from knotfab.pipeline.options import BuildOptions
from knotfab.scene.load import COLOURS_FILE, require_lamps, with_lamps, with_small_lamps
from knotfab.scene.require import require_several, require_start, require_tube
from knotfab_formats.bounds import option_of
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.views import Reading

if TYPE_CHECKING:
    from knotfab.design.agree import Agreement
    from knotfab.picture.lamps import Separation


@dataclass(frozen=True)
class Call:
    """A call whose scene and pictures have been read."""

    scene: ResolvedScene
    targets: tuple[Target, ...]  # one for each view, lamp or frame
    name: str  # of the piece
    told: tuple[str, ...] = ()  # what a preview adds, a sentence each
    agreed: Agreement | None = None  # of several pictures
    parted: Separation | None = None  # how a picture in colours was separated for its lamps
    budget_s: float | None = None  # for the whole build


def read_lamps(
    scene: ResolvedScene,
    sources: tuple[str, ...],
    options: BuildOptions,
    base: Path | None,
    progress: Progress,
    *,
    named: bool,
) -> Call:
    """Read the pictures of a call with lamps, separate one in colours into masks, and place the lamps.

    Args:
        sources: one picture in colours, or one picture per lamp.
        base: the folder that relative paths start from.
        named: whether the scene names the pictures, so that its titles are theirs.

    Raises:
        InputError: lamps cannot show these pictures.
    """
    from knotfab.design.lamps import LAMPS_FRAME_MM, place_lamps
    from knotfab.picture.lamps import on_one_canvas, read_masks

    if options.sequence:
        raise InputError("--lamps", "frames have one lamp", "Leave it out.")
    if scene.settings.free_view:
        why = "lamps before one screen have places by themselves; a view that is found moves the screen"
        raise InputError(
            "a free view (--free view)", why, "Leave it out; [lamps] bounds their places."
        )
    if options.lamps is not None:
        scene = with_lamps(scene, options.lamps, name_views(sources))
    parted: Separation | None = None
    mixing = scene.lamps.mode == "mix"
    if mixing and len(sources) not in (1, len(scene.views)):
        raise InputError(
            f"{len(sources)} pictures",
            "lamps that mix show one picture in colours",
            "Give one picture, or let lamps switch (--lamps switch).",
        )
    if mixing and len(sources) == 1 < len(scene.views):
        _require_colours(scene)
        with progress.stage("picture"):
            targets, parted = read_masks(sources[0], scene, base)
        read = targets
        name = plain_name(name_picture(sources[0]), "picture")
        update: dict[str, Any] = {"lamps": scene.lamps.but(picture=COLOURS_FILE)}
    else:
        with progress.stage("picture"):
            targets = read_targets(sources, scene.views, base=base, font=options.font)
        if mixing and scene.lamps.picture:
            colours = read_bytes((base or Path()) / scene.lamps.picture, scene.lamps.picture)
            given = (Given(colours, ".png"), *[None] * len(targets))
            targets = tuple(replace(t, given=one) for t, one in zip(targets, given, strict=False))
        if named:
            targets = name_targets(targets, scene.views)
        name = plain_name("-".join(dict.fromkeys(t.name for t in targets)), "picture")
        update, read = {}, targets
        targets = on_one_canvas(targets)
    # masks must register with one another
    update |= {"piece": scene.piece.but(bend=0.0)}
    if update.get("lamps") or targets is not read:  # masks that are read and smoothed already
        update["views"] = tuple(view.but(**dict(Reading(crop_px=False))) for view in scene.views)
    scene = scene.but(**update)
    require_several(scene)
    require_tube(scene)
    require_start(scene)
    scene = with_small_lamps(scene)
    first = scene.views[0]
    if options.size is not None or (first.frame_width_mm or first.frame_height_mm) is None:
        scene = size_longer(scene, targets[0], options.size or LAMPS_FRAME_MM)
    scene, targets = widen_targets(scene, targets)
    with progress.stage("agree"):
        scene, told = place_lamps(scene, targets)
    require_lamps(scene, "the scene's lamps")
    told = (*(() if parted is None else parted.lines), *told)
    return Call(scene, targets, name, told, parted=parted)


def _require_colours(scene: ResolvedScene) -> None:
    """Refuse options that read a silhouette, except those of detail: lamps that mix show all colours.

    Raises:
        InputError: naming the option.
    """
    for key, usual in Reading():
        if key not in ("crop_px", "smooth_px", "speck_px") and any(
            getattr(view, key) != usual for view in scene.views
        ):
            _, name = option_of(Reading, key)  # type: ignore[misc]
            why = "lamps that mix show all colours of their picture, each as it is"
            raise InputError(name, why, "Change the picture beforehand, or leave it out.")
