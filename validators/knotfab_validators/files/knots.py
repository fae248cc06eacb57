"""Read knots.json: centre lines as polygons, checked before anything is measured on them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.files.bad_file import MOST_MM, BadFile, read_bytes, short
from knotfab_validators.geometry.curves import Curves, Member, edges_of

__all__ = ["parse_knots", "read_knots"]

UNIT = 1e-6  # how far a unit vector's length may be off
MOST_BYTES = 24_000_000  # 400,000 points; Python holds `[],` in thirty times its bytes
MOST_KNOTS = 1000
MOST_MEMBERS = 10_000  # members of a mount; a build makes a hundred


def read_knots(path: Path) -> Curves:
    """The curves of a knots.json of schema 1.

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
    """The curves in the parsed content of a knots.json; raises BadFile as `read_knots` does."""
    if not isinstance(data, dict):
        raise BadFile(f"{name}: must hold an object with the keys schema, radius_mm and knots")
    if data.get("schema") != 1:
        raise BadFile(f"{name}: schema is {short(data.get('schema'))}, only 1 is known")
    if data.get("unit", "mm") != "mm":
        raise BadFile(f"{name}: unit is {short(data['unit'])}, it must be 'mm'")
    knots = data.get("knots")
    if not isinstance(knots, list) or not knots:
        raise BadFile(f"{name}: knots must be a list of at least one knot")
    if len(knots) > MOST_KNOTS:
        raise BadFile(f"{name}: has {len(knots)} knots, more than {MOST_KNOTS}")
    return Curves(
        polygons=tuple(_polygon(knot, f"{name}: knot {i}") for i, knot in enumerate(knots)),
        types=tuple(_type(knot, f"{name}: knot {i}") for i, knot in enumerate(knots)),
        closed=tuple(knot.get("closed", True) for knot in knots),
        radius_mm=_radius(data.get("radius_mm"), name),
        members=_members(data.get("members", []), f"{name}: members"),
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
    if not isinstance(knot, dict) or "points" not in knot:
        raise BadFile(f"{where} has no points")
    closed = knot.get("closed", True)
    if not isinstance(closed, bool):
        raise BadFile(f"{where}: closed must be true or false, got {short(closed)}")
    try:
        raw = np.array(knot["points"])
        points = raw.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadFile(f"{where}: points must be a list of [x, y, z]") from error
    # texts and truth values look like numbers to numpy, the latter also among numbers
    if raw.dtype.kind not in "iuf" or (raw.ndim == 2 and _has_booleans(knot["points"])):
        raise BadFile(f"{where}: points must be a list of [x, y, z], of numbers")
    least = 3 if closed else 2
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < least:
        raise BadFile(f"{where}: needs at least {least} points [x, y, z], got shape {points.shape}")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise BadFile(f"{where}: point {bad} is not finite")
    if np.abs(points).max() > MOST_MM:
        raise BadFile(f"{where}: has coordinates beyond {MOST_MM:g} mm")
    edges = edges_of([points], [closed])
    length = np.linalg.norm(edges.end - edges.start, axis=1)
    if not length.min() > 0:
        i = int(length.argmin())
        why = " (the last point joins the first, it must not be repeated)" if closed else ""
        raise BadFile(f"{where}: points {i} and {(i + 1) % len(points)} coincide{why}")
    return points


def _has_booleans(points: list[list[object]]) -> bool:
    return any(value is True or value is False for point in points for value in point)


def _type(knot: Any, where: str) -> str:
    kind = knot.get("type", "unknot" if knot.get("closed", True) else "open")
    if not isinstance(kind, str):
        raise BadFile(f"{where}: type must be a word such as 'unknot' or '3_1'")
    return kind


def _members(data: Any, where: str) -> tuple[Member, ...]:
    """The mount's members, as `knotfab_formats.knots` declares them."""
    if not isinstance(data, list) or len(data) > MOST_MEMBERS:
        raise BadFile(f"{where} must be a list of at most {MOST_MEMBERS}")
    if not data:
        return ()
    from pydantic import ValidationError

    from knotfab_formats.knots import Member as Said

    found = []
    for number, one in enumerate(data):
        try:
            said = Said.model_validate(one)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            key = " ".join(str(step) for step in first["loc"])
            raise BadFile(f"{where}: number {number} {key}: {first['msg'].lower()}") from error
        start, end = np.array(said.start), np.array(said.end)
        foot = None if said.foot is None else np.array(said.foot)
        if foot is not None and abs(float(np.linalg.norm(foot)) - 1) > UNIT:
            raise BadFile(f"{where}: number {number} foot must be a vector of length 1")
        if not np.linalg.norm(end - start) > 0:
            raise BadFile(f"{where}: number {number} begins where it ends")
        found.append(Member(start, end, said.radius_mm, foot))
    return tuple(found)


def _radius(value: Any, name: str) -> float | None:
    if value is None:
        return None
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 < value <= MOST_MM:  # NaN is in no order
        raise BadFile(f"{name}: radius_mm must be a number above 0, got {short(value)}")
    return float(value)
