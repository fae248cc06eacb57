"""Read knots.json: centre lines as closed polygons, checked before anything is measured on them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .read_mesh import BadFile

__all__ = ["Curves", "parse_knots", "read_knots"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curves:
    """Closed polygons with one tube radius.

    `polygons` are (n, 3) float64 mm, the last point joins the first and is not repeated; `types`
    are the knot types that the file promises, such as "unknot" or "3_1"; `radius_mm` is None where
    the file gives none.
    """

    polygons: tuple[Array, ...]
    types: tuple[str, ...]
    closed: tuple[bool, ...]
    radius_mm: float | None

    @property
    def length_mm(self) -> float:
        """Length of all polygons together, closing edges included."""
        return sum(self.lengths_mm)

    @property
    def lengths_mm(self) -> tuple[float, ...]:
        """Length of each polygon, closing edge included."""
        edges = (np.roll(p, -1, axis=0) - p for p in self.polygons)
        return tuple(float(np.linalg.norm(edge, axis=1).sum()) for edge in edges)


def read_knots(path: Path) -> Curves:
    """The curves of a knots.json of schema 1.

    Raises:
        BadFile: the file cannot be read, or is not such a file: the message names the knot and the
            point.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadFile(f"{path.name}: cannot be read ({error})") from error
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadFile(f"{path.name}: is not JSON ({error})") from error
    return parse_knots(data, path.name)


def parse_knots(data: Any, name: str = "knots.json") -> Curves:
    """The curves in the parsed content of a knots.json; raises BadFile as `read_knots` does."""
    if not isinstance(data, dict):
        raise BadFile(f"{name}: must hold an object with the keys schema, radius_mm and knots")
    if data.get("schema") != 1:
        raise BadFile(f"{name}: schema is {data.get('schema')!r}, only 1 is known")
    if data.get("unit", "mm") != "mm":
        raise BadFile(f"{name}: unit is {data['unit']!r}, it must be 'mm'")
    knots = data.get("knots")
    if not isinstance(knots, list) or not knots:
        raise BadFile(f"{name}: knots must be a list of at least one knot")
    return Curves(
        polygons=tuple(_polygon(knot, f"{name}: knot {i}") for i, knot in enumerate(knots)),
        types=tuple(_type(knot, f"{name}: knot {i}") for i, knot in enumerate(knots)),
        closed=(True,) * len(knots),
        radius_mm=_radius(data.get("radius_mm"), name),
    )


def _polygon(knot: Any, where: str) -> Array:
    if not isinstance(knot, dict) or "points" not in knot:
        raise BadFile(f"{where} has no points")
    if knot.get("closed", True) is not True:
        raise BadFile(f"{where} is not closed; only closed curves can be checked")
    try:
        points = np.array(knot["points"], dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadFile(f"{where}: points must be a list of [x, y, z]") from error
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
        raise BadFile(f"{where}: needs at least 3 points [x, y, z], got shape {points.shape}")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise BadFile(f"{where}: point {bad} is not finite")
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if not edges.min() > 0:
        i = int(edges.argmin())
        raise BadFile(
            f"{where}: points {i} and {(i + 1) % len(points)} coincide (the last point joins the "
            "first, it must not be repeated)"
        )
    if not np.isfinite(edges).all():
        raise BadFile(f"{where}: coordinates are too large")
    return points


def _type(knot: Any, where: str) -> str:
    kind = knot.get("type", "unknot")
    if not isinstance(kind, str):
        raise BadFile(f"{where}: type must be a word such as 'unknot' or '3_1'")
    return kind


def _radius(value: Any, name: str) -> float | None:
    if value is None:
        return None
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or value <= 0:
        raise BadFile(f"{name}: radius_mm must be a number above 0, got {value!r}")
    return float(value)
