"""Forged pieces on every holder: each has one fault that a person would not see, and must be rejected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from knotfab_formats.verdict import KNOTS, PRINTING, SHADOWS
from knotfab_validators import validate

from .forged_frames import of_arches, of_frame
from .forged_members import of_dowels, of_eyelet, of_lists, of_member
from .forged_plates import of_base, of_foot_plate, of_wall_plate
from .forging import Forge, Held


@dataclass(frozen=True)
class Forged:
    """One fault on a holder (of `held.HOLDERS`), which some required check must find."""

    holder: str
    name: str
    forge: Forge


def forged() -> list[Forged]:
    """Return all forgeries of solids and of what knots.json and scene.toml say."""
    tables: dict[str, list[Iterator[tuple[str, Forge]]]] = {
        "wall pegs": [of_member(0), of_lists("members"), of_wall_plate()],
        "drilled holes": [of_member(1), of_lists("members", "hulls"), of_dowels()],
        "stand": [of_member(0), of_member(-1), of_lists("members", "hulls"), of_base()],
        "hang": [of_member(0), of_lists("members", "rods"), of_eyelet()],
        "full plate": [of_foot_plate()],
        "outline plate": [of_foot_plate()],
        "lamp frame": [of_frame()],
        "no supports": [of_arches()],
    }
    return [
        Forged(holder, name, forge)
        for holder, parts in tables.items()
        for part in parts
        for name, forge in part
    ]


QUICK = {*SHADOWS, *PRINTING, *KNOTS, "clearance", "region", "build_volume"}


def judge(folder: Path, quick: bool = True) -> tuple[str, ...]:
    """Validate a folder; return the required checks that fail, or the sentence that refuses it.

    Shadows are left out, so that geometry alone decides. `quick`: the dear checks are made only where the
    others find nothing.
    """
    files = folder / "part.stl", folder / "knots.json", folder / "scene.toml"
    try:
        for skip in (QUICK, {*SHADOWS}) if quick else ({*SHADOWS},):
            checks = validate(*files, skip=skip).checks
            failed = tuple(c.name for c in checks if c.required and c.status != "pass")
            failed = tuple(name for name in failed if name not in skip)
            if failed:
                return failed
    except ValueError as error:
        return (str(error),)
    return ()


def judge_forged(case: Forged, held: Held, folder: Path) -> tuple[str, ...]:
    """Forge a copy of a piece, write it to a folder, and judge it."""
    own = held.copy()
    case.forge(own)
    own.write(folder)
    return judge(folder)
