"""What a design makes of the presets before it searches: more grace where it is asked for, unless given."""

from types import SimpleNamespace
from typing import cast

import pytest

from knotfab.design.question import Question
from knotfab.design.suit import suit
from knotfab_formats.scene import Material, ResolvedView
from knotfab_formats.search import SearchSettings

PLAIN = SearchSettings()


def ask_of(process: str = "filament", lines: bool = False, views: int = 1) -> Question:
    view = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0, thicken_mm=3.0)
    target = SimpleNamespace(view=view, lines=("a stroke",) if lines else ())
    scene = SimpleNamespace(material=Material.model_construct(process=process))
    problem = SimpleNamespace(views=(target,) * views)
    return cast(Question, SimpleNamespace(scene=scene, problem=problem, views=(view,) * views))


ASKED = {
    "a wire": (ask_of("wire"), 10.0),
    "lines": (ask_of(lines=True), 4.0),
    "lines of wire": (ask_of("wire", lines=True), 4.0),
    "two views": (ask_of(views=2), 2.65),
    "three views of wire": (ask_of("wire", views=3), 2.65),
}


def test_one_picture_of_filament_takes_the_preset_as_it_is() -> None:
    assert suit(PLAIN, ask_of(), {}) == PLAIN


@pytest.mark.parametrize("what", ASKED)
def test_what_asks_for_smoother_strands_gets_them_in_proportion(what: str) -> None:
    question, factor = ASKED[what]
    for grace in (PLAIN.grace, 0.3, 0.0):
        settings = PLAIN.model_copy(update={"grace": grace})
        found = suit(settings, question, {})
        assert found.grace == pytest.approx(factor * grace)
        assert found.grace_of == ("bends" if what == "a wire" else "curves")


@pytest.mark.parametrize("what", ASKED)
def test_what_the_scene_gives_means_the_same_whatever_is_asked(what: str) -> None:
    question, _ = ASKED[what]
    given = {
        "grace": 0.07,
        "grace_of": "curves",
        "fine_px": 100,
        "coarse_px": 50,
        "settle_iterations": 7,
    }
    settings = PLAIN.model_copy(update=given)
    found = suit(settings, question, given)
    assert {key: getattr(found, key) for key in given} == given
    # a build's own scene gives everything, and that is searched again
    assert suit(found, question, found.model_dump()) == found


def test_lines_get_finer_pictures_and_several_views_more_steps() -> None:
    lines = suit(PLAIN, ask_of(lines=True), {})
    wanted = 5 * 180 / 3.0
    assert lines.fine_px >= wanted and lines.coarse_px >= 0.5 * wanted
    assert lines.coarse_iterations == PLAIN.coarse_iterations
    three = suit(PLAIN, ask_of(views=3), {})
    assert (three.fine_px, three.coarse_px) == (PLAIN.fine_px, PLAIN.coarse_px)
    assert three.coarse_iterations == 3 * PLAIN.coarse_iterations
    assert three.settle_iterations == 3 * PLAIN.settle_iterations
