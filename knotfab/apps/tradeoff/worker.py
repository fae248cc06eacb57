"""Answer for `tradeoff`: a run of a point on a picture, of studies that a file holds."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

from knotfab.apps.tradeoff.measure import Study, run_point, warm_up
from knotfab_formats.errors import KnotfabError
from knotfab_formats.search import SearchSettings

_studies: list[Study] = []
_warm: list[bool] = []


def begin(file: str) -> None:
    """Read the studies that the parent wrote."""
    _studies[:] = pickle.loads(Path(file).read_bytes())


def answer(request: dict[str, Any], told: object) -> dict[str, Any]:
    """Measure a point: {"picture": number of the study, "settings", "judge"}."""
    del told
    study, settings = _studies[request["picture"]], SearchSettings(**request["settings"])
    try:
        if not _warm:
            warm_up(study, settings)
            _warm.append(True)
        return run_point(study, settings, request["judge"]).to_dict()
    except KnotfabError as error:
        return {"refused": [type(error).__name__, error.what, error.why, error.remedy]}
