"""Validate written files: part, knots and scene are read from disk and measured again."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import inf
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from knotfab_formats.errors import short
from knotfab_formats.verdict import (
    FILES,
    PRINTER,
    SHADOWS,
    TABLE,
    Check,
    Colours,
    Verdict,
    View,
    exit_code,
)
from knotfab_validators.check import BadFile, rescale, skip_check, time_stage
from knotfab_validators.conclusion import ask_unit, conclude, draw_failures, size_of
from knotfab_validators.files.mesh import Plate, read_mesh, read_table
from knotfab_validators.files.scene import read_knots
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.same_surface import check_same_3mf, is_own

if TYPE_CHECKING:
    from knotfab_validators.files.scene import Scene

FilePath = str | PathLike[str]
Half = Literal["geometry", "shadows"]

UNASKED = "checked with --print"  # the reason for a piece that its scene says is not printed
AS_PRINTED = {*PRINTER, *FILES}  # checks of the part before it shrinks


@dataclass(frozen=True)
class Piece:
    """The files of a piece as read; None for a file that is not given.

    `printed` and `lines` are as in the files. `mesh` and `curves`, which are measured, are as they
    will be once the material has shrunk to `left` of every length.
    """

    part: Path | None
    scene: Path | None
    printed: Mesh | None
    lines: Curves | None
    setting: Scene | None
    table: Sequence[Plate]  # bars of the frame that holds the lamps
    mesh: Mesh | None
    curves: Curves | None
    left: float
    notes: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class Found:
    """What was found on a piece: checks with their places in the file, views, seconds by stage, colours."""

    checks: Sequence[Check]
    views: Sequence[View]
    seconds: dict[str, float]
    colours: Colours | None = None


def validate(
    part: FilePath | None,
    knots: FilePath | None = None,
    scene: FilePath | None = None,
    skip: Collection[str] = (),
    pictures_dir: FilePath | None = None,
    failures: FilePath | None = None,
    only: Half | None = None,
    unit: str = "mm",
) -> Verdict:
    """Validate written files: measure all that the given ones allow, and skip the other checks.

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
        unit: unit of a part whose file knows none, one of `files.mesh.UNITS_MM`.

    Raises:
        BadFile: a file cannot be read, or the part reaches the light; one sentence says so.
    """
    piece = read_piece(part, knots, scene, unit)
    return conclude_piece(piece, [measure_piece(piece, skip, pictures_dir, only)], failures)


def read_piece(
    part: FilePath | None,
    knots: FilePath | None = None,
    scene: FilePath | None = None,
    unit: str = "mm",
) -> Piece:
    """Read the files of a piece (see `validate`)."""
    seconds: dict[str, float] = {}
    notes: list[str] = []
    part_path = None if part is None else Path(part)
    scene_path = None if scene is None else Path(scene)
    with time_stage(seconds, "read"):
        printed = read_mesh(part_path, unit, notes) if part_path else None
        lines = read_knots(Path(knots)) if knots is not None else None
        setting = None
        if scene_path:
            from knotfab_validators.files.scene import read_scene  # needed for this alone

            setting = read_scene(scene_path)
        table: list[Plate] = []
        if scene_path and setting and printed:
            table = read_table(scene_path.parent, setting)
    mesh, curves, left = printed, lines, 1.0
    if setting is not None and setting.material.shrinkage_percent > 0:
        left = setting.material.shrinks_to
        mesh, curves = _shrink(mesh, curves, left)
    told = (left, tuple(notes), seconds["read"])
    return Piece(part_path, scene_path, printed, lines, setting, table, mesh, curves, *told)


def measure_piece(
    piece: Piece,
    skip: Collection[str] = (),
    pictures_dir: FilePath | None = None,
    only: Half | None = None,
) -> Found:
    """Measure a piece that was read, or a half of it (see `validate`)."""
    seconds = {"read": piece.seconds}
    checks: list[Check] = []
    views: list[View] = []
    colours: Colours | None = None
    asked, mesh, setting = skip, piece.mesh, piece.setting
    if setting is not None and setting.unprinted:
        skip = {*skip, *PRINTER}
    # halves may be measured in processes of their own, which load no more than that
    if only != "shadows":
        from knotfab_validators.part_checks import part_checks

        measured = mesh, piece.curves, setting, seconds, skip, piece.printed
        checks += part_checks(*measured, _read_wall(piece))
        checks += _check_beside(piece, skip, seconds)
        checks += _check_table(piece, skip, seconds)
    if only != "geometry":
        shadows, views, colours = _check_shadows(piece, skip, pictures_dir, seconds)
        checks += shadows
    for k, check in enumerate(checks):
        if check.name in skip:
            checks[k] = _leave_out(check, UNASKED if check.name not in asked else "")
        elif piece.left != 1.0 and check.name not in AS_PRINTED:
            checks[k] = rescale(check, 1 / piece.left)  # places in the file
    return Found(checks, views, seconds, colours)


def conclude_piece(
    piece: Piece, halves: Sequence[Found], failures: FilePath | None = None
) -> Verdict:
    """Draw the verdict from what was measured, whole or in halves; `failures` is as for `validate`."""
    checks = [check for half in halves for check in half.checks]
    seconds = {stage: spent for half in halves for stage, spent in half.seconds.items()}
    drawn = False
    if failures is not None:
        with time_stage(seconds, "failures"):
            try:
                drawn = draw_failures(Path(failures), checks, piece.printed, piece.lines)
            except OSError as error:
                raise BadFile(f"{failures}: cannot be written ({error.strerror})") from error
    notes, printed = list(piece.notes), piece.printed
    if piece.mesh is not None and piece.part is not None:
        asked = ask_unit(piece.mesh, piece.part.name)
        notes += [] if asked is None else [asked]
    views = tuple(view for half in halves for view in half.views)
    if views and piece.setting is not None:
        pictures = " and ".join(short(view.picture) for view in piece.setting.views)
        notes.append(f"compared with {pictures} as it was read")
    code = exit_code(checks)
    return Verdict(
        status="fail" if code else "pass",
        exit_code=code,
        conclusion=conclude(checks, printed, piece.curves, piece.setting),
        size_mm=None if printed is None else size_of(printed),
        notes=tuple(notes),
        checks=tuple(checks),
        views=views,
        colours=next((half.colours for half in halves if half.colours is not None), None),
        picture=str(failures) if drawn else None,
        seconds=seconds,
    )


def _check_beside(piece: Piece, skip: Collection[str], seconds: dict[str, float]) -> list[Check]:
    """Check that the 3MF files beside the part hold its surface, and that the profile is the scene's."""
    mesh, part, scene = piece.printed, piece.part, piece.setting
    if mesh is None or part is None:
        return [skip_check(name, "not given the part") for name in FILES]
    found = [skip_check(name, "left out on request") for name in FILES]
    if FILES[0] not in skip:
        with time_stage(seconds, "3mf"):
            found[0] = check_same_3mf(mesh, part)
    if FILES[1] not in skip:
        found[1] = skip_check(FILES[1], "not given the scene")
        if scene is not None:
            from knotfab_validators.printing.slicer_ini import check_slicer_ini

            found[1] = check_slicer_ini(scene, part.parent, is_own(part))
    return found


def _read_wall(piece: Piece) -> float:
    """Return how thick a tube's wall prints; inf where nothing says so."""
    if piece.setting is None or piece.part is None:
        return inf
    from knotfab_validators.printing.slicer_ini import read_wall_mm

    return read_wall_mm(piece.setting, piece.part.parent, is_own(piece.part))


def _check_table(piece: Piece, skip: Collection[str], seconds: dict[str, float]) -> list[Check]:
    """Check the frame that holds the lamps, if the scene names one."""
    if not piece.table or piece.setting is None or set(TABLE) <= set(skip):
        return []
    from knotfab_validators.shadows.table import check_table

    with time_stage(seconds, "table"):
        return check_table(piece.table, piece.setting)


def _check_shadows(
    piece: Piece, skip: Collection[str], pictures_dir: FilePath | None, seconds: dict[str, float]
) -> tuple[list[Check], list[View], Colours | None]:
    """Check the shadows, and report on each view and the colours; or skip, and say why."""
    from knotfab_validators.shadows.part_shadows import skip_shadow_checks, verify_shadows

    mesh, setting, scene = piece.mesh, piece.setting, piece.scene
    nameless = [v.name for v in setting.views if not v.picture] if setting is not None else []
    if mesh is None or setting is None or scene is None:
        why = f"not given {'the part' if mesh is None else 'the scene'}"
    elif pictures_dir is None and set(SHADOWS) <= set(skip):
        why = "left out on request"
    elif nameless:
        why = f"the scene names no picture for view {nameless[0]}"
    else:
        folder = scene.parent
        return verify_shadows(mesh, piece.curves, setting, folder, skip, pictures_dir, seconds)
    return skip_shadow_checks(why, required=False), [], None


def _shrink(
    mesh: Mesh | None, curves: Curves | None, share: float
) -> tuple[Mesh | None, Curves | None]:
    """Scale part and centre lines to `share`, as shrinkage of the material does."""
    if mesh is not None:
        mesh = Mesh(share * mesh.vertices, mesh.faces)
    return mesh, None if curves is None else curves.scaled(share)


def _leave_out(check: Check, why: str) -> Check:
    return skip_check(check.name, why or "left out on request")
