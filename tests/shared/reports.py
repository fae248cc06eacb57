"""Reports for tests: complete records, in which a test changes what it is about."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from knotfab_formats.errors import read_as
from knotfab_formats.report import Report
from knotfab_formats.search import PRESETS
from knotfab_formats.verdict import Check, Recognition, Verdict, View, exit_code
from knotfab_validators.shadows.verdict_rules import worst_verdict

VIEW: dict[str, Any] = {
    "name": "front", "kind": "shadow", "picture": "front.png", "width": 512, "height": 512,
    "projection": np.eye(3, 4), "receiver": np.array([0.0, 0.0, 1.0, 100.0]),
    "iou": 0.98765, "iou_frame": 0.98765, "iou_tube": np.float64(0.98801), "precision": 0.995,
    "recall": 0.9926, "outline_error_px": 0.0831, "outline_error_mm": 0.0147, "intrusion": None,
    "depth_ratio": 0.614,
}  # fmt: skip
CHECK: dict[str, Any] = {
    "status": "pass", "required": True, "measured": 2.2041, "limit": 2.2, "unit": "mm", "detail": "",
}  # fmt: skip
LOSS: dict[str, Any] = {
    "what": "piece", "at_px": [12.0, 40.0], "at_mm": [4.2, 14.1], "size_mm": 1.2, "length_mm": 2.0,
    "size_px": 3.4, "needed_mm": 4.4, "sentence": "a piece is lost <here>",
}  # fmt: skip
VERDICT: dict[str, Any] = {
    "word": "coarse", "reasons": ["2 pieces are lost"], "lost_pieces": 2, "filled_holes": 0,
    "bridged_gaps": 0, "broken_strokes": 0, "stray_pieces": 0, "stray_holes": 0, "misshapen": 0,
    "touching": 0, "cut_tips": 0, "specks": 0, "outline_p95_mm": 0.4, "outline_p95_radii": 0.2,
    "lost": [LOSS],
}  # fmt: skip
KNOT: dict[str, Any] = {
    "type": "unknot", "vertices": 1480, "length_mm": 3912.4, "thickness_mm": 2.2041,
    "min_bend_radius_mm": 2.31, "mean_curvature_radii": 0.2, "curvature_90_radii": 0.5, "turns": 40.0,
}  # fmt: skip
REPORT: dict[str, Any] = {
    "status": "pass", "verdict": None, "views": [VIEW], "checks": [],
    "effects": [
        {"name": "penumbra", "simulated": False, "magnitude": 0.31, "threshold": 0.5, "unit": "px",
         "seconds": 0.0, "calls": 0, "forced": False, "where": [], "reason": "below the threshold"},
    ],
    "limits": [
        {"name": "clearance", "limit": 4.4, "measured": 4.41, "unit": "mm", "calls": 160,
         "seconds": 1.25},
    ],
    "timings": {"target": 0.21, "template": 0.92, "search": 8.4, "verify": 3.1, "total": 12.63},
    "knots": [KNOT],
    "print": {
        "volume_mm3": 49123.0, "mass_g": 60.9, "bounding_box_mm": [178.2, 171.9, 109.4],
        "depth_ratio": 0.614, "printer": "prusa-mk4",
    },
    "settings": {
        "accuracy": "standard", "seed": 0, "tube_radius_mm": 2.0, "preview": [], "device": "cpu",
        "tube_radius": {"chosen_by": "the scene", "trials": []}, "mount": "none", "opening_iou": 1.0,
        "search": PRESETS["standard"].model_dump(), "time_budget_s": None, "thickness_mm": 2.2041,
        "versions": {"knotfab": "0.1.0", "numpy": np.__version__},
        "parts": {"torch": "moved the knots"},
        "command": "knotfab build knight.png --print --out knight",
    },
}  # fmt: skip


def check_of(name: str, status: str = "pass", required: bool = True, **changes: Any) -> Check:
    """A check that was measured."""
    told = {**CHECK, "name": name, "status": status, "required": required, **changes}
    return read_as(Check, told)


def view_of_report(**changes: Any) -> View:
    """A verified view."""
    return read_as(View, {**VIEW, **changes})


def recognition(**changes: Any) -> Recognition:
    """What a person would miss of a picture."""
    return read_as(Recognition, {**VERDICT, **changes})


def verdict_of(views: Sequence[Mapping[str, Any]] = (), **changes: Any) -> Verdict:
    """What validators answer."""
    told = {"status": "pass", "exit_code": 0, "conclusion": "", "size_mm": None, "notes": []}
    told |= {"checks": [], "colours": None, "picture": None, "seconds": {}}
    return read_as(Verdict, {**told, "views": [{**VIEW, **view} for view in views], **changes})


def report_with(**sections: Any) -> Report:
    """A report whose sections are changed: tables and records by their keys, all else as a whole."""
    told = {**REPORT, **sections}
    for name in ("print", "settings"):
        told[name] = {**REPORT[name], **sections.get(name, {})}
    for name, record in (("views", VIEW), ("checks", CHECK), ("knots", KNOT)):
        told[name] = [{**record, **one} for one in told[name]]
    found = read_as(Report, told)
    return replace(
        found,
        status="fail" if exit_code(found.checks) else "pass",
        verdict=found.verdict or worst_verdict(found.views),
    )
