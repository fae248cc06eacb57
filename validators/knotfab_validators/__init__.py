"""Independent checks: written files are read from disk and measured anew.

    from knotfab_validators import validate
    verdict = validate("part.stl", "knots.json", "scene.toml")

The package shares no code with what made the files, and can be used on a part from elsewhere.
Importing it loads nothing: numpy, VTK and the rest come with the first name that needs them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .check import Check
    from .validate import validate
    from .verdict import Verdict

__all__ = ["Check", "Verdict", "validate"]


def __getattr__(name: str) -> Any:
    """The public names, from their modules (PEP 562)."""
    if name == "Check":
        from .check import Check

        return Check
    if name == "Verdict":
        from .verdict import Verdict

        return Verdict
    if name == "validate":
        # The module and its function share a name: importing the module sets the attribute to the
        # module, and from then on this function is not asked any more.
        from .validate import validate

        globals()["validate"] = validate
        return validate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
