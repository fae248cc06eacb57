"""Independent checks, which read the written files from disk and measure them again.

    from knotfab_validators import validate
    verdict = validate("part.stl", "knots.json", "scene.toml")

The package shares no code with what made the files, and can be used on a part from elsewhere.
Importing it loads nothing: numpy, VTK and the rest come with the first name that needs them.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotfab_formats.verdict import Check, Verdict
    from knotfab_validators.validate import validate

__all__ = ["Check", "Verdict", "validate"]

_HOME = dict.fromkeys(("Check", "Verdict"), "knotfab_formats.verdict")
_HOME["validate"] = f"{__name__}.validate"


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first asked for (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


class _Package(ModuleType):
    """A package whose `validate` remains the function when the module of that name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "validate" and isinstance(value, ModuleType):
            value = value.validate
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
