"""A process that measures points: `python -m knotfab.tradeoff.worker STUDY`, a line of JSON a point."""

from __future__ import annotations

import json
import os
import pickle
import sys
from pathlib import Path

from knotfab.scene.settings import SearchSettings
from knotfab.tradeoff.measure import Study, run_point


def main() -> None:
    """Answer requests until there are no more."""
    # libraries in C++ write to standard output as they like: the answers have one of their own
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    study: Study = pickle.loads(Path(sys.argv[1]).read_bytes())  # that this program's parent wrote
    for line in sys.stdin:
        asked = json.loads(line)
        run = run_point(study, SearchSettings(**asked["settings"]), asked["judge"])
        print(json.dumps(run), file=answers, flush=True)


if __name__ == "__main__":
    main()
