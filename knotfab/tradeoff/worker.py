"""A process that measures points: `python -m knotfab.tradeoff.worker STUDIES`, a line of JSON a run."""

from __future__ import annotations

import json
import os
import pickle
import sys
from pathlib import Path

from knotfab.base.errors import KnotfabError
from knotfab.tradeoff.measure import Study, run_point, warm_up
from knotfab_formats.search import SearchSettings


def main() -> None:
    """Answer requests until there are no more."""
    # libraries in C++ write to standard output as they like: the answers have one of their own
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    studies: list[Study] = pickle.loads(Path(sys.argv[1]).read_bytes())  # that the parent wrote
    warm = False
    for line in sys.stdin:
        asked = json.loads(line)
        study, settings = studies[asked["picture"]], SearchSettings(**asked["settings"])
        try:
            if not warm:
                warm_up(study, settings)
                warm = True
            answer = run_point(study, settings, asked["judge"]).to_dict()
        except KnotfabError as error:
            told = error.what, error.why, error.remedy
            answer = {"refused": [type(error).__name__, *told]}
        print(json.dumps({**answer, "asked": asked["asked"]}), file=answers, flush=True)


if __name__ == "__main__":
    main()
