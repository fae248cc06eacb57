"""Make knotfab/scene/data/knots.toml anew: every knot of the table up to 8 crossings, drawn tight.

`python -m paper.named_knots [NAME ...]`; all of them take some five minutes on one core.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import knotfab.scene
from benchmarks.measurement import Stopwatch
from knotfab.geometry.carry import resample
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab_formats.knots import BRAIDS
from paper.curves import closed_braid
from paper.tighten import tighten

TABLE = Path(knotfab.scene.__path__[0]) / "data" / "knots.toml"
HEAD = """# The prime knots of up to 8 crossings, each the mirror image that is called right-handed, drawn
# tight: points of a closed curve, in tube radii, joined by a periodic cubic spline over the chord length.
# Made by paper/named_knots.py from the braid words in knot_names.py.

[knots]
"""
SPACING = 0.8  # tube radii between the points that are written


def row(name: str) -> list[list[float]]:
    """Return the points to write of one knot, turned to its principal axes without mirroring."""
    tight = tighten(closed_braid(BRAIDS[name])[0])
    points, _, verdict = resample(tight.points, polylines_of_sizes((len(tight.points),)), SPACING)
    if not verdict.valid:
        raise SystemExit(f"{name}: the samples are too coarse")
    points -= points.mean(axis=0)
    axes: NDArray[np.float64] = np.linalg.svd(points, full_matrices=False)[2]
    points = points @ (axes * np.linalg.det(axes)).T
    # a little looser than tight: what rounding takes must not matter
    return [[round(float(c) * 1.02, 2) for c in p] for p in points]


def main(names: list[str]) -> None:
    """Write the table, keeping the rows of the knots that are not named."""
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["knots"] if TABLE.exists() else {}
    for name in names or list(BRAIDS):
        watch = Stopwatch()
        rows[name] = row(name)
        print(f"{name}: {len(rows[name])} points, {watch.cpu_s:.1f} s CPU")
        lines = (
            f'"{n}" = [{", ".join(f"[{x:g}, {y:g}, {z:g}]" for x, y, z in rows[n])}]'
            for n in BRAIDS
            if n in rows
        )
        TABLE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
