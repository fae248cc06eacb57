"""Files that must be refused: a picture and a light that the part cannot have, and those made by hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from .case import READ, Broken, make_part, with_scene
from .curves import circle
from .files import Part
from .hostile import Hostile, handmade


def broken_files() -> Iterator[Broken]:
    """Faults that the readers must name in a sentence."""
    yield Broken(
        "a picture that is none",
        lambda: replace(with_scene(make_part(circle())), raw={"front.png": b"GIF89a and no more"}),
        READ,
        says="front.png",
    )
    yield Broken(
        "a picture that is missing",
        lambda: replace(with_scene(make_part(circle())), pictures={}),
        READ,
    )
    yield Broken(
        "a part behind the light",
        lambda: with_scene(make_part(circle()), view={"light_distance_mm": 1.0}),
        READ,
        says="light",
    )


def refused_files() -> Iterator[Broken]:
    """The files made by hand that must be refused."""
    for file in handmade():
        if file.says is not None:
            yield Broken(file.name, partial(_alone, file), READ, says=file.says)


def _alone(file: Hostile) -> Part:
    """The file by the name that it would have beside others of a part."""
    kind = file.name.rpartition(".")[2]
    return Part(
        None,
        raw={{"json": "knots.json", "toml": "scene.toml"}.get(kind, f"part.{kind}"): file.content},
    )
