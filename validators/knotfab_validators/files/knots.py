"""Read knots.json: centre lines as polygons, checked before anything is measured on them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.files.bad_file import BadFile, read_bytes, short
from knotfab_validators.geometry.curves import Curves, Member, edges_of

__all__ = ["parse_knots", "read_knots"]

UNIT = 1e-6  # how far a unit vector's length may be off
MOST_BYTES = 24_000_000  # 400,000 points; Python holds `[],` in thirty times its bytes


def read_knots(path: Path) -> Curves:
    """Read the curves of a knots.json of schema 1.

    Raises:
        BadFile: the file cannot be read, or is not such a file: the message names the knot and the
            point.
    """
    content = read_bytes(path, MOST_BYTES)
    try:
        data = json.loads(content.decode("utf-8-sig"), object_pairs_hook=_require_once)
    except UnicodeDecodeError as error:
        raise BadFile(f"{path.name}: is not UTF-8 text ({error})") from error
    except _RepeatedKey as error:
        raise BadFile(f"{path.name}: {error}") from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise BadFile(f"{path.name}: is not JSON ({short(error)})") from error
    return parse_knots(data, path.name)


def parse_knots(data: Any, name: str = "knots.json") -> Curves:
    """Return the curves in the parsed content of a knots.json; raises BadFile as `read_knots` does."""
    from pydantic import ValidationError

    from knotfab_formats.knots import KnotsFile, why_no_knots

    try:
        said = KnotsFile.model_validate(data)
    except ValidationError as error:
        raise BadFile(f"{name}: {why_no_knots(error)}") from error
    return Curves(
        polygons=tuple(_polygon(knot, f"{name}: knot {i}") for i, knot in enumerate(said.knots)),
        types=tuple(knot.promise for knot in said.knots),
        closed=tuple(knot.closed for knot in said.knots),
        radius_mm=said.radius_mm,
        members=tuple(
            _member(m, f"{name}: members: number {i}") for i, m in enumerate(said.members)
        ),
    )


class _RepeatedKey(ValueError):
    """A key that is given twice: readers do not agree on which of the two counts."""


def _require_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _RepeatedKey(f"has the key {short(twice)} twice")
    return found


def _polygon(knot: Any, where: str) -> Array:
    points, closed = np.array(knot.points, dtype=np.float64), knot.closed
    least = 3 if closed else 2
    if len(points) < least:
        raise BadFile(f"{where}: needs at least {least} points [x, y, z], got {len(points)}")
    edges = edges_of([points], [closed])
    length = np.linalg.norm(edges.end - edges.start, axis=1)
    if not length.min() > 0:
        i = int(length.argmin())
        why = " (the last point joins the first, it must not be repeated)" if closed else ""
        raise BadFile(f"{where}: points {i} and {(i + 1) % len(points)} coincide{why}")
    return points


def _member(said: Any, where: str) -> Member:
    start, end = np.array(said.start), np.array(said.end)
    foot = None if said.foot is None else np.array(said.foot)
    if foot is not None and abs(float(np.linalg.norm(foot)) - 1) > UNIT:
        raise BadFile(f"{where} foot must be a vector of length 1")
    if not np.linalg.norm(end - start) > 0:
        raise BadFile(f"{where} begins where it ends")
    return Member(start, end, said.radius_mm, foot)
