"""One line that concludes: what the part is, whether it passed, and how large it is."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from knotfab_validators.check import Check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["ask_unit", "conclude", "knot_in_words", "size_of"]

SMALL_MM, LARGE_MM = 2.0, 2000.0  # a part of less or more is asked for its unit
WORDS = {"3_1": "trefoil", "4_1": "figure-eight knot"}  # names by which everybody knows them
NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def size_of(mesh: Mesh) -> tuple[float, float, float]:
    """Return the extents along x, y and z, mm."""
    x, y, z = (float(side) for side in np.ptp(mesh.vertices, axis=0))
    return x, y, z


def ask_unit(mesh: Mesh, name: str) -> str | None:
    """Return a question about a part that is smaller or larger than parts are, in mm; None about others."""
    longest = max(size_of(mesh))
    if not np.isfinite(longest) or SMALL_MM <= longest <= LARGE_MM:
        return None
    asked = (
        "in metres (--unit m), cm or inches (in)"
        if longest < SMALL_MM
        else "in another unit than mm"
    )
    return f"{name}: is {longest:.3g} mm long: is the file {asked}?"


def knot_in_words(name: str, form: str = "{0}") -> str:
    """Return a knot's name with the word that people know it by: "left-handed 3_1" is "left-handed trefoil".

    Args:
        form: form of the word, and of the name: "{1} ({0})" puts one beside the other.
    """
    return re.sub(
        r"(?<![\w#])(3_1|4_1)(?![\w#])", lambda own: form.format(WORDS[own[0]], own[0]), name
    )


def conclude(checks: Sequence[Check], mesh: Mesh | None, curves: Curves | None) -> str:
    """Conclude: "One closed tube, 4 mm radius, an unknot; every required check passed. 9 × 8 × 3 mm."

    Args:
        mesh, curves: what was measured; None where there is none.
    """
    named = {check.name: check for check in checks}
    said = [_tell_what(named, mesh, curves)]
    kind = named.get("knot_type")
    if kind is not None and kind.status != "skipped" and isinstance(kind.measured, str):
        found = knot_in_words(re.sub(r", (proved|consistent)", "", kind.measured))
        several = curves is not None and len(curves.polygons) > 1
        article = "" if "," in found else "an " if found[0] in "aeiou" else "a "
        said.append(f"{'each ' if several and article else ''}{article}{found}")
    unmet = [c for c in checks if c.required and c.status != "pass"]
    failed = [c.name for c in unmet if c.status == "fail"]
    missing = [c.name for c in unmet if c.status == "skipped"]
    told = []
    if failed:
        told.append(f"{_count(len(failed), 'required check')} failed: {', '.join(failed)}")
    if missing:
        told.append(f"{_count(len(missing), 'required check')} could not run: {', '.join(missing)}")
    if not told:
        told = ["every required check passed"]
    size = (
        "" if mesh is None else " " + " × ".join(f"{side:.3g}" for side in size_of(mesh)) + " mm."
    )
    return f"{', '.join(said)}; {'; '.join(told)}.{size}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _tell_what(named: dict[str, Check], mesh: Mesh | None, curves: Curves | None) -> str:
    lines = named.get("centre_line")
    if curves is not None:
        what = "curve" if mesh is None else "tube"
        closed = (
            "closed"
            if all(curves.closed)
            else "open"
            if not any(curves.closed)
            else "closed and open"
        )
        number, radius = len(curves.polygons), curves.radius_mm
        size = "" if radius is None else f", {radius:.3g} mm radius"
        return f"{_in_letters(number)} {closed} {what}{'' if number == 1 else 's'}{size}"
    found = re.search(r"mesh: (.+?), radi(?:us|i) (.+?) mm,", lines.detail) if lines else None
    if lines is not None and lines.status == "pass" and found is not None:
        what, size = found.groups()
        size = size if " to " in size else f"{float(size):.3g}"
        return f"{what[0].upper()}{what[1:]}, {size} mm radius"
    bodies = named.get("mesh_bodies")
    count = None if bodies is None else bodies.measured
    if not isinstance(count, float | int):
        return "No closed tube"
    return f"{_in_letters(int(count))} {'body' if count == 1 else 'bodies'}, no closed tube"


def _in_letters(number: int) -> str:
    return NUMBERS[number] if number < len(NUMBERS) else str(number)
