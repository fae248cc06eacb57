"""An open curve as a part: a conical spiral with round ends, written and then checked by the validators.

`python -m examples.paper.open_curve [--flat] [--out DIR]` writes part.stl and knots.json (`"closed": false`)
and prints what `knotfab validate` says of them; it ends with the validators' exit code.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from examples.paper.curves import spiral
from examples.paper.open_tube import Cap, sweep_open
from knotfab.cli.app import validate
from knotfab.files.stl import write_stl
from knotfab.geometry.tube import sides_for
from knotfab.knots import Knot, Knots

RADIUS_MM = 2.0
RISE_MM = 60.0  # of the outer end above the inner one


def main(arguments: list[str] | None = None) -> int:
    """Write the part and check it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--flat", action="store_true", help="end the tube where the line ends")
    parser.add_argument("--out", type=Path, default=Path("open-curve"))
    given = parser.parse_args(arguments)
    line = spiral(6.0, 5.0, 5.0, 0.8)
    line[:, 2] = RISE_MM * np.linspace(0.0, 1.0, len(line))
    line -= line.min(axis=0) - 2.0 * RADIUS_MM  # on the bed's positive octant
    cap: Cap = "flat" if given.flat else "round"
    vertices, faces = sweep_open(line, RADIUS_MM, sides_for(RADIUS_MM, 0.01), cap)
    given.out.mkdir(parents=True, exist_ok=True)
    Knots((Knot(line, "open", closed=False),), RADIUS_MM).write(given.out / "knots.json")
    write_stl(given.out / "part.stl", [(vertices, faces)])
    return validate(given.out / "part.stl", knots=given.out / "knots.json")


if __name__ == "__main__":
    sys.exit(main())
