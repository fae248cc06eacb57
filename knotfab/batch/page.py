"""index.html of a batch: every shadow beside its picture, its figures, and a link to its report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from knotfab.batch.worker import Record
from knotfab.files.folder import REJECTED
from knotfab.report.report_html import make_environment

__all__ = ["render_index"]


def render_index(records: Sequence[Record], folder: Path) -> str:
    """The page, which lies in `folder` and shows what lies in the folders beside it."""
    cards = [_card(record, folder) for record in records]
    passed = sum(record["exit_code"] == 0 for record in records)
    template = make_environment(Path(__file__).parent).get_template("index.html.j2")
    page: str = template.render(cards=cards, passed=passed)
    return page


def _card(record: Record, folder: Path) -> dict[str, Any]:
    place = folder / record["name"]
    if record["exit_code"] == 1:
        place = place / REJECTED
    built = record["exit_code"] in (0, 1) and record.get("reported", True)
    shown = sorted(place.glob("compare-*.png"))[:3] if built else []
    report = place / "report.html"
    return {
        **record,
        "pictures": [quote(path.relative_to(folder).as_posix()) for path in shown],
        "report": quote(report.relative_to(folder).as_posix())
        if built and report.is_file()
        else None,
    }
