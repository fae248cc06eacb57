"""How results show in a notebook: `_repr_html_`, and a `repr` that stays short."""

from __future__ import annotations

import os
from dataclasses import fields
from typing import Any

from knotfab.base.apps import load_app
from knotfab.base.errors import MachineError

_LONGEST = 80  # characters of a value


class InNotebook:
    """Base of the dataclasses (`repr=False`) that the public functions return."""

    def _repr_html_(self) -> str | None:
        try:
            shown: str | None = load_app("notebook").show(self)
        except MachineError:  # an installation without apps: the `repr` is shown
            return None
        return shown

    def __repr__(self) -> str:
        told = [f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if f.repr]  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(told)})"


def _short(value: Any) -> str:
    """Return a short `repr`: plain values are cut, arrays give their shape, collections their length."""
    if hasattr(value, "shape"):
        return f"<{'×'.join(map(str, value.shape))} {value.dtype}>"
    if value is None or isinstance(value, str | int | float | os.PathLike):
        text = repr(os.fspath(value) if isinstance(value, os.PathLike) else value)
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
    name = type(value).__name__
    return f"<{name} of {len(value)}>" if hasattr(value, "__len__") else f"<{name}>"
