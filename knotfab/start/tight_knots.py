"""Tight centre lines of the knots of the table, made from their braid words by `paper/named_knots.py`."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import InputError
from knotfab.geometry.sampling import arc_lengths
from knotfab_formats.knot_names import BRAIDS, NO_SUCH_KNOT

__all__ = ["load_knot"]


@cache
def _table() -> dict[str, Any]:
    text = (
        resources.files("knotfab.scene").joinpath("data", "knots.toml").read_text(encoding="utf-8")
    )
    return tomllib.loads(text)["knots"]  # type: ignore[no-any-return]


def load_knot(name: str, mirrored: bool = False, step: float = 0.4) -> Array:
    """The tight centre line of a knot of the table, (n, 3) in tube radii, about its middle.

    Vertices are about `step` apart. Strands keep 2 between them and bends a radius of 1.

    Raises:
        InputError: no such knot is known.
    """
    if name not in BRAIDS:
        raise InputError(f"the knot {name!r}", "there is no such name in the table", NO_SUCH_KNOT)
    from scipy.interpolate import CubicSpline

    points = np.asarray(_table()[name], dtype=np.float64)
    arc = arc_lengths(points)
    spline = CubicSpline(arc, np.concatenate([points, points[:1]]), bc_type="periodic")
    fine = spline(np.linspace(0.0, arc[-1], 8 * len(points) + 1))
    run = arc_lengths(fine[:-1])
    count = max(12, round(run[-1] / step))
    at = np.interp(np.arange(count) * run[-1] / count, run, np.linspace(0.0, arc[-1], len(fine)))
    result = np.asarray(spline(at), dtype=np.float64)
    result -= result.mean(axis=0)
    return result * [1.0, 1.0, -1.0] if mirrored else result
