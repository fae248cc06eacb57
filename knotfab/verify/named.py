"""The files that a call names to be validated."""

from __future__ import annotations

import os
from pathlib import Path

from knotfab.base.disk import require_within
from knotfab.base.errors import InputError
from knotfab.verify.verifier import Files

__all__ = ["files_to_validate"]


def files_to_validate(
    part: Path | None, knots: Path | None, scene: Path | None, failures: Path | None = None
) -> Files:
    """Return the files of a call: a folder stands for the part, knots and scene in it.

    Failures are drawn beside what is measured, unless another place is named.

    Raises:
        InputError: nothing is given, or something named is not there.
    """
    if part is not None and part.is_dir():
        folder = part
        part = folder / "part.stl"
        knots = knots or _if_there(folder / "knots.json")
        scene = scene or _if_there(folder / "scene.toml")
        if (folder / "part-01.stl").is_file() and not part.is_file():
            raise InputError(
                str(folder),
                "it holds a sequence, a part for each frame",
                f"Name one: knotfab validate {folder / 'part-01.stl'} --knots "
                f"{folder / 'knots-01.json'} --scene {folder / 'scene-01.toml'}",
            )
        if not part.is_file():
            raise InputError(
                str(folder), "it holds no part.stl", "Name a folder that a build wrote"
            )
    if part is None and knots is None:
        raise InputError(
            "",
            "there is nothing to validate",
            "Name a folder, a part, or --knots knots.json",
        )
    for path in (part, knots, scene):
        if path is not None and not path.is_file():
            raise InputError(str(path), "there is no such file", "Check the path.")
    for path in (part, knots, scene, failures):
        if path is not None:
            require_within(path)
    if failures is None:
        failures = _beside(part or knots)
    elif failures.suffix.lower() != ".png":
        raise InputError(
            f"--failures {failures}", "failures are drawn as PNG", "Name a file in .png."
        )
    return Files(part, knots, scene, failures=failures)


def _beside(measured: Path | None) -> Path | None:
    """Return NAME-failures.png beside a file, where one may write there."""
    if measured is None or not os.access(measured.parent, os.W_OK):
        return None
    return measured.with_name(f"{measured.stem}-failures.png")


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None
