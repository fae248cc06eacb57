"""Validate written files: part, knots and scene are read from disk and measured anew."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from knotfab_formats.checks import FILES, PRINTER, SHADOWS
from knotfab_validators.check import Check, rescale, skip_check
from knotfab_validators.clock import time_stage
from knotfab_validators.conclusion import ask_unit, conclude, size_of
from knotfab_validators.failure_picture import draw_failures
from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.knots import read_knots
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.plates import read_plates
from knotfab_validators.forked import Baton, Forked, may_fork
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.same_surface import check_same_3mf
from knotfab_validators.part_checks import GROUPS, Group, part_checks
from knotfab_validators.shadows.part_shadows import verify_shadows
from knotfab_validators.shadows.shadow_checks import skip_shadow_checks
from knotfab_validators.verdict import Verdict, verdict_of

if TYPE_CHECKING:
    from knotfab_validators.files.scene import Scene

__all__ = ["Half", "Verdict", "validate"]

T = TypeVar("T")
FilePath = str | PathLike[str]
Half = Literal["geometry", "shadows"]

UNASKED = "checked with --print"  # of a piece that its scene says is not printed
AS_PRINTED = {*PRINTER, *FILES}  # checks of the part before it shrinks


def validate(
    part: FilePath | None,
    knots: FilePath | None = None,
    scene: FilePath | None = None,
    skip: Collection[str] = (),
    pictures_dir: FilePath | None = None,
    failures: FilePath | None = None,
    only: Half | None = None,
    processes: int = 1,
    unit: str = "mm",
) -> Verdict:
    """Measure written files; whatever the given ones allow is checked, the rest is said to be not.

    Args:
        part: STL or 3MF in print coordinates. knots: knots.json. scene: scene.toml; its pictures
            lie beside it, and so do the plates that it names; its pose takes part and knots to the
            scene. Where its material shrinks, they are measured as they are then, but for what the
            printer must hold and can print.
        skip: names of checks to leave out; "shadow-render" lets the exact polygons alone decide
            about the shadow. A group that is left out whole is not measured (`part_checks`); of the
            shadows, no view is reported then, unless their pictures are to be written.
        pictures_dir: where to write shadow-NAME.png and compare-NAME.png of each view.
        failures: the PNG to write when a required check fails: the part with the places marked.
        only: one half of the work, "geometry" or "shadows".
        processes: 2: a copy of this one begins with the geometry of a part in a scene while this one measures
            its shadows; whichever is done first goes on with what is left.
        unit: of a part whose file knows none, one of `files.mesh.UNITS_MM`.

    Raises:
        BadFile: a file cannot be read, or the part reaches the light; one sentence says so.
    """
    seconds: dict[str, float] = {}
    with time_stage(seconds, "read"):
        notes: list[str] = []
        mesh = read_mesh(Path(part), unit, notes) if part is not None else None
        curves = read_knots(Path(knots)) if knots is not None else None
        setting = _read_scene(Path(scene)) if scene is not None else None
        laid = read_plates(Path(scene).parent, setting) if scene and setting and mesh else []
    printed, lines, left, asked = mesh, curves, 1.0, skip
    if setting is not None and setting.unprinted:
        skip = {*skip, *PRINTER}
    if setting is not None and setting.material.shrinkage_percent > 0:
        left = setting.material.shrinks_to
        mesh, curves = _shrink(mesh, curves, left)

    def measure(baton: Baton) -> tuple[dict[Group, list[Check]], dict[str, float]]:
        found: dict[Group, list[Check]] = {}
        spent: dict[str, float] = {}
        for group in (groups[k] for k in baton):
            found[group] = part_checks(mesh, curves, setting, spent, laid, skip, printed, [group])
            if group == "surface":
                found[group].append(_check_beside(printed, part, skip, spent))
        return found, spent

    groups = () if only == "shadows" else GROUPS
    apart = processes > 1 and only is None and mesh is not None and setting is not None
    shadows: list[Check] = []
    views: list[dict[str, Any]] = []
    colours: dict[str, Any] | None = None
    with (
        Baton(len(groups)) as baton,
        _measure_apart(partial(measure, baton) if apart and may_fork() else None) as copy,
    ):
        if only != "geometry":
            shadows, views, colours = _check_shadows(
                mesh, curves, setting, scene, skip, pictures_dir, seconds
            )
        found, spent = measure(baton)
        if copy is not None:
            of_copy, spent_there = copy.result()
            found, spent = found | of_copy, spent | spent_there
    seconds |= spent
    checks = [check for group in groups for check in found[group]] + shadows
    checks = [
        _in_file(c, left)
        if c.name not in skip
        else _leave_out(c, UNASKED if c.name not in asked else "")
        for c in checks
    ]
    drawn = False
    if failures is not None:
        with time_stage(seconds, "failures"):
            try:
                drawn = draw_failures(Path(failures), checks, printed, lines)
            except OSError as error:
                raise BadFile(f"{failures}: cannot be written ({error.strerror})") from error
    if mesh is not None and part is not None and (asked_unit := ask_unit(mesh, Path(part).name)):
        notes.append(asked_unit)
    return replace(
        verdict_of(checks, views, seconds, picture=str(failures) if drawn else None),
        conclusion=conclude(checks, printed, curves),
        size_mm=None if printed is None else size_of(printed),
        notes=tuple(notes),
        colours=colours,
    )


def _measure_apart(call: Callable[[], T] | None) -> Forked[T] | nullcontext[None]:
    """A copy of this process that makes a call; nothing where there is none, or no room for a copy."""
    with suppress(OSError):
        if call is not None:
            return Forked(call)
    return nullcontext()


def _check_beside(
    mesh: Mesh | None,
    part: FilePath | None,
    skip: Collection[str],
    seconds: dict[str, float],
) -> Check:
    """Whether the 3MF files beside the part hold its surface."""
    (name,) = FILES
    if mesh is None or part is None:
        return skip_check(name, "not given the part")
    if name in skip:
        return skip_check(name, "left out on request")
    with time_stage(seconds, "3mf"):
        return check_same_3mf(mesh, Path(part))


def _read_scene(path: Path) -> Scene:
    """The scene of a file; what reads it is loaded for it alone."""
    from knotfab_validators.files.scene import read_scene

    return read_scene(path)


def _check_shadows(
    mesh: Mesh | None,
    curves: Curves | None,
    setting: Scene | None,
    scene: FilePath | None,
    skip: Collection[str],
    pictures_dir: FilePath | None,
    seconds: dict[str, float],
) -> tuple[list[Check], list[dict[str, Any]], dict[str, Any] | None]:
    """The checks of the shadows, what is told of each view and of colours, or why there are none."""
    nameless = [v.name for v in setting.views if not v.picture] if setting is not None else []
    if mesh is None or setting is None or scene is None:
        why = f"not given {'the part' if mesh is None else 'the scene'}"
    elif pictures_dir is None and set(SHADOWS) <= set(skip):
        why = "left out on request"
    elif nameless:
        why = f"the scene names no picture for view {nameless[0]}"
    else:
        folder = Path(scene).parent
        return verify_shadows(mesh, curves, setting, folder, skip, pictures_dir, seconds)
    return skip_shadow_checks(why, required=False), [], None


def _shrink(
    mesh: Mesh | None, curves: Curves | None, share: float
) -> tuple[Mesh | None, Curves | None]:
    """Part and centre lines as they are once the material has shrunk to a share of every length."""
    if mesh is not None:
        mesh = Mesh(share * mesh.vertices, mesh.faces)
    return mesh, None if curves is None else curves.scaled(share)


def _in_file(check: Check, left: float) -> Check:
    """A check with its places in the file, of which the material leaves a share of every length."""
    if left == 1.0 or check.name in AS_PRINTED:
        return check
    return rescale(check, 1 / left)


def _leave_out(check: Check, why: str) -> Check:
    return skip_check(check.name, why or "left out on request")
