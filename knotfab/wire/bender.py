"""Bending plans in a bender's own words: a template that is filled in with the rows of bends.csv."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib.resources import files
from itertools import accumulate
from math import radians
from pathlib import Path
from typing import Any

from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.sandbox import SandboxedEnvironment

from knotfab import __version__
from knotfab.base.disk import at_home
from knotfab.base.errors import InputError
from knotfab.wire.bends import Bend
from knotfab_formats.scene import Material, ResolvedScene

__all__ = ["BENDERS", "file_of_bender", "fill_template", "require_bender"]

BENDERS = {"lra": "lra.csv", "grbl": "grbl.gcode"}  # files in the folder benders, by name
_MOST_BYTES = 100_000
_WRONG = (TemplateError, TypeError, ValueError, ArithmeticError, LookupError, RuntimeError)
# the values that a template must write for each bend: their name, and the keys that change with it
_NEEDED = {
    "length": ("feed_mm", "{{ bend.feed_mm }} (or distance_mm)"),
    "rotation": ("rotation_deg", "{{ bend.rotation_deg }} (or turned_deg)"),
    "angle": ("bend_deg", "{{ bend.tool_angle_deg }} (or bend_deg)"),
}
_SAMPLE = (
    Bend(10.0, 10.0, 0.0, 30.0, 35.0, 6.0),
    Bend(33.0, 20.0, 40.0, 50.0, 55.0, 6.0),
    Bend(44.0, 5.0, 0.0, 0.0, 0.0, 0.0, "joint"),
)


def require_bender(scene: ResolvedScene) -> None:
    """Refuse a bender that is not known, or whose template would not tell it how to bend.

    Raises:
        InputError: naming the template, and what is wrong with it.
    """
    name = scene.piece.bender
    plain = fill_template(name, _SAMPLE, "bends", scene.material)
    for what, (key, remedy) in _NEEDED.items():
        changed = [_change(bend, key) for bend in _SAMPLE]
        if fill_template(name, changed, "bends", scene.material) == plain:
            raise InputError(
                f"the bender {name}",
                f"its template has no place for the {what} of a bend",
                f"Write {remedy} into it, between {{% for bend in bends %}} and {{% endfor %}}.",
            )


def _change(bend: Bend, key: str) -> Bend:
    """Return the bend with another length, rotation or angle, in all the words for it."""
    if key == "feed_mm":
        return replace(bend, feed_mm=bend.feed_mm + 1.0, distance_mm=bend.distance_mm + 1.0)
    if key == "rotation_deg":
        return replace(bend, rotation_deg=bend.rotation_deg + 1.0)
    more = bool(bend.bend_deg)
    return replace(bend, bend_deg=bend.bend_deg + more, tool_angle_deg=bend.tool_angle_deg + more)


def file_of_bender(name: str, plan: str) -> str:
    """Give the name of the file for a bender, beside the plan of that name: bends-1.csv → bends-1-lra.csv."""
    own = Path(BENDERS.get(name, name))
    stem = "".join(c if c.isalnum() and c.isascii() else "-" for c in own.stem)
    return f"{Path(plan).stem}-{stem}{own.suffix.lower() or '.txt'}"


def fill_template(
    name: str, bends: tuple[Bend, ...] | list[Bend], plan: str, wire: Material
) -> str:
    """Return a bender's template filled in with the bends.

    Args:
        plan: what it calls the plan. wire: the material.

    Raises:
        InputError: the template cannot be read, or names an unknown placeholder.
    """
    environment = SandboxedEnvironment(
        undefined=StrictUndefined,
        finalize=lambda x: f"{round(x, 3) + 0.0:.3f}" if isinstance(x, float) else x,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    text = _read(name)
    try:
        return environment.from_string(text).render(_told(bends, plan, wire))
    except TemplateSyntaxError as error:
        why = f"line {error.lineno} of its template cannot be read: {error.message}"
    except _WRONG as error:
        why = f"its template cannot be filled in: {' '.join(str(error).split())}"
    keys = ", ".join(_told(_SAMPLE, "", wire)["bends"][0])
    raise InputError(
        f"the bender {name}", why.rstrip("."), f"A bend has {keys}; docs/wire.md lists all."
    )


def _told(bends: tuple[Bend, ...] | list[Bend], plan: str, wire: Material) -> Mapping[str, Any]:
    """List the placeholders of a template with their values."""
    turned = accumulate(bend.rotation_deg for bend in bends)
    rows = [
        {"index": k, **asdict(b), "arc_mm": b.radius_mm * radians(b.bend_deg), "turned_deg": t}
        for k, (b, t) in enumerate(zip(bends, turned, strict=True), start=1)
    ]
    return {
        "bends": rows,
        "plan": plan,
        "wire": wire.name,
        "wire_diameter_mm": wire.wire_diameter_mm,
        "length_mm": bends[-1].distance_mm,
        "program": f"knotfab {__version__}",
    }


def _read(name: str) -> str:
    """Read the template's text.

    Raises:
        InputError: there is none of that name, or it is no text.
    """
    if name in BENDERS:
        return (files("knotfab.wire") / "benders" / BENDERS[name]).read_text(encoding="utf-8")
    path = at_home(name)
    known = f"Name a file, or one of {', '.join(BENDERS)}."
    try:
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError(f"the bender {name}", "its template is too large", known)
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        why = "its template is no text in UTF-8"
    except OSError as error:
        why = f"its template cannot be read ({error.strerror})"
    raise InputError(f"the bender {name}", why, known)
