"""Knots, the result of a search: one or more polylines with one tube radius."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from knotfab.base.disk import read_text
from knotfab.geometry.polylines import Polylines, polylines_of
from knotfab_formats.disk import write_whole
from knotfab_formats.errors import InputError
from knotfab_formats.knots import KnotsFile, why_no_knots

_FEWEST = 8  # the fewest vertices of a knot from which a search can start
_DIGITS = 6  # significant digits kept of a radius, mm, that was scaled and scaled back
_RIGID = 1e-9  # tolerance for a matrix to count as rigid


@dataclass(frozen=True)
class Knot:
    """A polyline through `points` (n, 3) float64, mm; if it is closed, the last joins the first.

    An open polyline has no knot type: `type` is then "open".
    """

    points: NDArray[np.float64]
    type: str = "unknot"
    closed: bool = True

    @property
    def length_mm(self) -> float:
        """Length of the polyline, the closing edge included where it is closed."""
        edges = np.roll(self.points, -1, axis=0) - self.points
        edges = edges if self.closed else edges[:-1]
        return float(np.linalg.norm(edges, axis=1).sum())


@dataclass(frozen=True)
class Knots:
    """All knots of a piece, which share one tube radius (mm)."""

    knots: tuple[Knot, ...]
    radius_mm: float

    @property
    def points(self) -> NDArray[np.float64]:
        """The vertices of all knots, in order, (n, 3)."""
        return np.concatenate([k.points for k in self.knots])

    @property
    def rings(self) -> Polylines:
        """The closed polylines that `points` form."""
        return polylines_of(k.points for k in self.knots)

    def moved(self, matrix: NDArray[np.float64]) -> Knots:
        """Return the knots moved by a 4x4 `matrix`, a rigid motion or a similarity."""
        turn, shift = matrix[:3, :3], matrix[:3, 3]
        scale = float(np.cbrt(np.linalg.det(turn)))
        return Knots(
            tuple(Knot(k.points @ turn.T + shift, k.type, k.closed) for k in self.knots),
            self.radius_mm if abs(scale - 1) < _RIGID else scale * self.radius_mm,
        )

    def to_file(self, **more: Any) -> KnotsFile:
        """Return the content of knots.json, with further keys."""
        knots = [
            {"closed": k.closed, "type": k.type, "points": k.points.tolist()} for k in self.knots
        ]
        held = {"schema": 1, "unit": "mm", "radius_mm": self.radius_mm, "knots": knots}
        return KnotsFile.model_validate({**held, **more})

    def write(self, path: Path, **more: Any) -> None:
        """Write knots.json, with further keys: members of the mount, bars and feet."""
        write_whole(path, self.to_file(**more).dumps().encode())

    def dump_start(self) -> str:
        """Return the text of a start file, at full precision, from which a search can go on."""
        return self.to_file(coordinates="scene").dumps()


def count_in_words(count: int) -> str:
    """Return "one knot", or the number with "knots"."""
    return "one knot" if count == 1 else f"{count} knots"


def read_knots(path: Path) -> Knots:
    """Read the knots of a knots.json or a start file, in the file's own coordinates.

    Raises:
        OSError, ValueError, RecursionError: it cannot be read, or is neither of these.
    """
    return _knots_from(KnotsFile.model_validate(json.loads(path.read_text(encoding="utf-8"))))


def _knots_from(held: KnotsFile) -> Knots:
    if held.radius_mm is None:
        raise _Unfit("it has no radius_mm")
    points = [np.array(k.points, dtype=np.float64).reshape(-1, 3) for k in held.knots]
    knots = zip(points, held.knots, strict=True)
    return Knots(tuple(Knot(p, k.promise, k.closed) for p, k in knots), held.radius_mm)


class _Unfit(ValueError):
    """The knots cannot serve as a start."""


def read_start(path: Path) -> Knots:
    """Read knots to start from, in scene coordinates: a start file or a finished part.

    Args:
        path: a start.json; a knots.json with its scene.toml beside it; or the folder of these two.

    Raises:
        InputError: it cannot be read, or holds no closed knots whose place in the scene is known.
    """
    remedy = (
        "Name the folder of a build, its knots.json (of a frame knots-NN.json), or a start.json."
    )
    try:
        path = path / "knots.json" if os.path.isdir(path) else path
        text = read_text(path, str(path), "file of knots", remedy)
        held = KnotsFile.model_validate(json.loads(text))
        found = _knots_from(held)
        if not all(k.closed and len(k.points) >= _FEWEST for k in found.knots):
            raise _Unfit("it holds no closed knots")
        if held.coordinates != "scene":  # the knots lie in print pose
            found = found.moved(_read_pose(path))
            # a printer's thinnest tube stays that when it was enlarged and is not any more
            found = Knots(found.knots, round(found.radius_mm, _DIGITS))
        if not (np.isfinite(found.points).all() and 0 < found.radius_mm < np.inf):
            raise _Unfit("a number in it is not finite")
    except (ValueError, RecursionError) as error:
        why = str(error) if isinstance(error, _Unfit) else "it is no file of knots"
        if isinstance(error, ValidationError):
            why += f": {why_no_knots(error)}"
        raise InputError(str(path), why, remedy) from error
    return found


def _read_pose(path: Path) -> NDArray[np.float64]:
    """Read the matrix (4, 4) from print to scene coordinates from the scene.toml beside a knots.json.

    Raises:
        ValueError: there is none, or it has no pose.
    """
    beside = path.with_name(path.name.replace("knots", "scene", 1)).with_suffix(".toml")
    try:
        matrix = np.array(
            tomllib.loads(read_text(beside, str(beside)))["pose"]["matrix"], dtype=np.float64
        )
    except (InputError, ValueError, KeyError, TypeError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise _Unfit(f"its knots lie as they are printed, and no {beside.name} beside it says how")
    return matrix
