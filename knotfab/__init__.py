"""knotfab: a picture becomes a knotted tube whose shadow is that picture, proved before printing.

    import knotfab

    result = knotfab.build("cat.png", "out", mount="wall")
    print(result.exit_code, result.folder, result.report["views"][0]["iou"])

Each stage is a function from data to data. `__all__` lists the public names, which are loaded on first use
and described in docs/api.md.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from knotfab.base import apps

if TYPE_CHECKING:
    from knotfab.api import (
        assemble_part,
        build,
        choose_tube,
        design_knots,
        pose_question,
        read_picture,
        search_knots,
        settle_design,
        sweep_tube,
        validate_part,
        write_files,
    )
    from knotfab.base.errors import MachineError, SceneError
    from knotfab.base.progress import Event
    from knotfab.design.design import Design
    from knotfab.design.question import Question
    from knotfab.knots import Knot, Knots
    from knotfab.part.assemble import Part
    from knotfab.picture.read import Target
    from knotfab.problem import Problem, Start
    from knotfab.request import Outcome
    from knotfab.search.state import SearchResult
    from knotfab.search.term import TorchTerm
    from knotfab_formats.errors import InputError, KnotfabError
    from knotfab_formats.scene import ResolvedScene, Scene, SettledScene

__version__ = apps.VERSION

_MODULES = {
    "knotfab.api": (
        "assemble_part", "build", "choose_tube", "design_knots", "pose_question", "read_picture",
        "search_knots", "settle_design", "sweep_tube", "validate_part", "write_files",
    ),
    "knotfab.design.design": ("Design",),
    "knotfab.design.question": ("Question",),
    "knotfab.base.errors": ("InputError", "KnotfabError", "MachineError", "SceneError"),
    "knotfab.knots": ("Knot", "Knots"),
    "knotfab.part.assemble": ("Part",),
    "knotfab.problem": ("Problem", "Start"),
    "knotfab.base.progress": ("Event",),
    "knotfab.request": ("Outcome",),
    "knotfab_formats.scene": ("ResolvedScene", "Scene", "SettledScene"),
    "knotfab.picture.read": ("Target",),
    "knotfab.search.state": ("SearchResult",),
    "knotfab.search.term": ("TorchTerm",),
}  # fmt: skip
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Design", "Event", "InputError", "Knot", "KnotfabError", "Knots", "MachineError", "Outcome",
    "Part", "Problem", "Question", "ResolvedScene", "Scene", "SceneError", "SearchResult",
    "SettledScene", "Start", "Target", "TorchTerm", "assemble_part", "build", "choose_tube",
    "design_knots", "pose_question", "read_picture", "search_knots", "settle_design",
    "sweep_tube", "validate_part", "write_files",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load a public name on first use (PEP 562), so that importing knotfab stays light."""
    if name not in _HOME:
        raise AttributeError(f"module 'knotfab' has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_HOME[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
