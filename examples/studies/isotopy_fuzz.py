"""Throw adversarial steps at the certificate: none that it lets pass may carry a strand through another.

    python -m examples.studies.isotopy_fuzz [--steps 100000] [--seed 0]

The steps and their judge: `examples.hard_cases.isotopy`.
"""

from __future__ import annotations

import argparse
import sys

from examples.hard_cases.curves import hard_knots
from examples.hard_cases.isotopy import fuzz
from examples.measurement import Stopwatch


def main(argv: list[str] | None = None) -> int:
    """Print one line a knot; 1 where any accepted step crossed or any type changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000, help="of all knots together")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(argv)
    cases = hard_knots()
    each = -(-asked.steps // len(cases))
    bad = 0
    watch = Stopwatch()
    print(f"{'knot':<12} {'steps':>8} {'accepted':>8} {'crossing':>8} {'faults':>6} {'changed':>7}")
    for case in cases:
        row = fuzz(case, each, asked.seed)
        bad += row.faults + row.changed
        print(
            f"{row.name:<12} {row.steps:>8} {row.accepted:>8} {row.crossing:>8} {row.faults:>6} "
            f"{row.changed:>7}",
            flush=True,
        )
    print(f"{each * len(cases)} steps, {bad} faults, {watch.cpu_s:.0f} CPU s")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
