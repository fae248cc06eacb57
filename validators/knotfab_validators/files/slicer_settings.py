"""Slicers' words on the bodies in a 3MF: which are printed, and which only steer a slicer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from knotfab_validators.files.bad_file import BadFile, short
from knotfab_validators.files.threemf_model import WHOLE, parse_xml

__all__ = ["SETTINGS", "Steering", "read_steering"]

SETTINGS = (  # those of PrusaSlicer (SuperSlicer), and of Bambu Studio and OrcaSlicer
    "metadata/slic3r_pe_model.config",
    "metadata/superslicer_model.config",
    "metadata/model_settings.config",
)
PRINTED = {"modelpart", "normal_part"}
NEGATIVE = {"negativevolume", "negative_part"}


@dataclass
class Steering:
    """Bodies that are not printed: triangles of an object from first to last, or some of its components."""

    triangles: dict[int, list[tuple[int, int]]] = field(default_factory=dict)
    components: set[tuple[int, int]] = field(default_factory=set)
    kinds: list[str] = field(default_factory=list)


def read_steering(blocks: Iterable[bytes], name: str) -> Steering:
    """Read bodies that one of the `SETTINGS` says only steer: modifiers, places for or without supports.

    Raises:
        BadFile: a body is negative, so that a slicer prints another shape than the file holds.
    """
    found = Steering()
    at: dict[str, str] = {}  # attributes of the object, volume or part that is open

    def take(kind: str, owner: str, first: str, last: str | None) -> None:
        kind = kind.strip().lower()
        if kind in PRINTED or not all(WHOLE.fullmatch(n) for n in (owner, first, last or "0")):
            return
        if kind in NEGATIVE:
            raise BadFile(
                f"{name}: has a negative volume, which its slicer cuts out of the part: cut it there, and "
                "export the part as it is printed"
            )
        found.kinds.append(short(kind))
        if last is None:
            found.components.add((int(owner), int(first)))
        else:
            found.triangles.setdefault(int(owner), []).append((int(first), int(last)))

    def start(tag: str, given: dict[str, str]) -> None:
        if tag == "object":
            at["object"] = given.get("id", "")
        elif tag == "volume":
            at["first"], at["last"] = given.get("firstid", ""), given.get("lastid", "")
        elif tag == "part":
            take(
                given.get("subtype", "normal_part"), at.get("object", ""), given.get("id", ""), None
            )
        elif (
            tag == "metadata" and given.get("key") in ("volume_type", "modifier") and "first" in at
        ):
            kind = given.get("value", "")
            if given["key"] == "modifier":  # older files have this key
                kind = "ModelPart" if kind == "0" else "ParameterModifier"
            take(kind, at.get("object", ""), at["first"], at["last"])

    def end(tag: str) -> None:
        if tag == "volume":
            at.pop("first", None)

    parse_xml(blocks, name, start, end, lambda prefix, uri: None)
    return found
