"""The keys of report.json, schema 1, that a script may rely on; a record may have more (docs/contract.md)."""

from __future__ import annotations

__all__ = ["RECORDS", "SCHEMA"]

SCHEMA = 1
RECORDS: dict[str, tuple[str, ...]] = {
    "views": (
        *(
            "name",
            "kind",
            "picture",
            "width",
            "height",
            "projection",
            "receiver",
            "iou",
            "iou_tube",
        ),
        *("precision", "recall", "outline_error_px", "outline_error_mm", "legibility"),
    ),
    "checks": ("name", "status", "required", "measured", "limit", "unit", "detail"),
    "effects": (
        *("name", "simulated", "forced", "where", "magnitude", "threshold", "unit", "calls"),
        *("seconds", "reason"),
    ),
    "limits": ("name", "limit", "measured", "unit", "calls", "seconds"),
    "knots": ("type", "vertices", "length_mm", "thickness_mm", "min_bend_radius_mm"),
    "print": ("volume_mm3", "mass_g", "bounding_box_mm", "depth_ratio", "printer"),
    "settings": ("accuracy", "seed", "versions", "command", "tube_radius_mm"),
}
"""Of each section the keys that each of its records has."""
