"""The question: what a scene and its pictures ask of a search."""

from __future__ import annotations

import pytest
from questions import ask_heart

from knotfab.scene.catalogue import asked_for
from knotfab_formats.piece import Material, Printer
from knotfab_formats.scene import Scene


@pytest.mark.slow
@pytest.mark.parametrize(
    ("printer", "material", "overhang_deg"),
    [
        ("prusa-mk4", "pla", 45.0),
        ("hp-mjf", "pa12", None),  # powder carries the piece
        ("prusa-mk4", "steel-wire-2mm", None),  # wire is bent, not printed
    ],
)
def test_supports_are_weighed_only_where_some_are_printed(
    printer: str, material: str, overhang_deg: float | None
) -> None:
    scene = Scene().model_copy(
        update={"printer": asked_for(Printer, printer), "material": asked_for(Material, material)}
    )
    assert scene.printer.max_overhang_deg == 45.0
    assert ask_heart(scene).overhang_deg == overhang_deg
