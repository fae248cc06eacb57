"""New hard cases for half an hour: capsules, noisy pictures, adversarial steps, tubes, losses, networks.

    python -m benchmarks.nightly_fuzz [--minutes 30] [--seed 0]

Every round draws one case of each kind from the next seed. A NaN, an error above its bound, two
renderers that differ, a strand that passed another, or an exception that is not the product's own
is a fault: its seed is printed, and the command ends with 1.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from benchmarks.hard.random_cases import KINDS
from benchmarks.measurement import run_study
from knotfab.base.errors import KnotfabError


def one_round(seed: int) -> dict[str, str]:
    """What is wrong with the cases of this seed, by kind: "", "refused", or the fault."""
    found = {}
    for k, (kind, examine) in enumerate(KINDS.items()):
        try:
            found[kind] = examine(np.random.default_rng([seed, k]))
        except KnotfabError:
            found[kind] = "refused"
        except Exception as error:
            found[kind] = f"{type(error).__name__}: {error}"
    return found


def main(*, minutes: float = 30.0, seed: int = 0) -> int:
    """Print every fault with its seed, and the counts; 1 where there was any."""
    end = time.monotonic() + 60 * minutes
    counts: Counter[str] = Counter()
    faults, first = 0, seed
    while time.monotonic() < end:
        for kind, said in one_round(seed).items():
            counts[f"{kind} {said}" if said == "refused" else kind] += 1
            if said not in ("", "refused"):
                faults += 1
                print(f"seed {seed}, {kind}: {said}", flush=True)
        seed += 1
    print(f"{seed - first} rounds, {faults} faults, {time.process_time():.0f} CPU s")
    print(dict(counts))
    return int(faults > 0)


if __name__ == "__main__":
    run_study(main)
