"""What a build says of effects and limits: a line each, and a warning where a scene's own word hides one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotfab.effects.base import Decision
    from knotfab.problem import SearchResult

__all__ = ["add_warnings", "limits_as_effects", "list_effects", "list_limits"]

Record = dict[str, Any]


def list_effects(result: SearchResult, verdict: Mapping[str, Any]) -> list[Record]:
    """A line an effect: what the design did, and what the validators' `verdict` says that they did."""
    lines = []
    for name, decision in result.effects.items():
        line = decision.to_dict()
        runs = [view[name] for view in verdict["views"] if view.get(name)]
        calls = sum(int(run["samples"]) for run in runs)
        if calls:
            line["calls"] += calls
            line["seconds"] = round(line["seconds"] + float(verdict["seconds"].get(name, 0.0)), 4)
            line["where"].append("verification")
        lines.append(line)
    return lines


def list_limits(result: SearchResult) -> list[Record]:
    """A line a limit: what it is, what was measured at the end, and how often its term was called."""
    return [
        {
            "name": name,
            "limit": limit,
            "measured": measured,
            "unit": "mm",
            "calls": result.guards[name].calls,
            "seconds": round(result.guards[name].seconds, 4),
        }
        for name, (measured, limit) in result.feasibility.figures.items()
    ]


def limits_as_effects(limits: Sequence[Mapping[str, Any]]) -> list[Record]:
    """The limits as lines of `effects`, where earlier readers look for them."""
    return [
        {
            "name": line["name"],
            "simulated": line["calls"] > 0,
            "forced": False,
            "where": ["search"] if line["calls"] else [],
            "magnitude": line["measured"],
            "threshold": line["limit"],
            "unit": line["unit"],
            "calls": line["calls"],
            "seconds": line["seconds"],
            "reason": "a limit is guarded always; its term is called while it can be felt",
        }
        for line in limits
    ]


def add_warnings(report: Record, effects: Mapping[str, Decision]) -> None:
    """Add to the notes which effects are switched off that the scene calls for."""
    found = [decision.warning for decision in effects.values() if decision.warning is not None]
    if found:
        report.setdefault("notes", []).extend(found)
