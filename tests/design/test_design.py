"""What a design makes of the presets before it searches."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from knotfab.design.design import _for_wire
from knotfab.design.question import Question
from knotfab.scene.model import Material, Scene
from knotfab.scene.settings import SearchSettings


def ask_of(process: str, lines: bool) -> Question:
    material = Material.model_construct(process=process)
    views = (SimpleNamespace(view=None, lines=lines),)
    found = SimpleNamespace(
        scene=SimpleNamespace(material=material), problem=SimpleNamespace(views=views)
    )
    return cast(Question, found)


def test_a_wire_runs_more_smoothly_unless_the_scene_says_how_smoothly() -> None:
    settings = SearchSettings()
    assert _for_wire(ask_of("filament", False), settings, Scene()) == settings
    wire = ask_of("wire", False)
    smoother = _for_wire(wire, settings, Scene())
    assert smoother.grace == pytest.approx(3.0 * settings.grace)
    assert smoother.model_copy(update={"grace": settings.grace}) == settings
    # a build's own scene gives the same again, and so do lines, which are smooth already
    assert _for_wire(wire, smoother, Scene(search={"grace": smoother.grace})) == smoother
    assert _for_wire(ask_of("wire", True), settings, Scene()) == settings
