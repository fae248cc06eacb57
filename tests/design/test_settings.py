"""What a design makes of the presets before it searches: more grace where it is asked for, unless given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from knotfab.base.arrays import Array
from knotfab.design.question import Question
from knotfab.design.settings import fine_enough, outline_px, suit
from knotfab.geometry.tube import sweep
from knotfab_formats.piece import Accuracy, Material
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import PRESETS, SearchSettings, search_settings

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


COARSE = SearchSettings(mesh_sides=8, settle_edge_radii=0.79)


def stand_out(points: Array, radius: float, sides: int) -> float:
    """The most by which the mesh swept along a closed polyline leaves the round tube about its edges, mm."""
    vertices, _ = sweep(points, radius, sides)
    start, edge = points, np.roll(points, -1, axis=0) - points
    share = np.einsum("vkj,kj->vk", vertices[:, None] - start, edge) / (edge * edge).sum(axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * edge
    return float(np.linalg.norm(vertices[:, None] - nearest, axis=2).min(axis=1).max()) - radius


@pytest.mark.parametrize("allowed_mm", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("radius_mm", [0.8, 1.5, 4.0])
def test_the_mesh_stands_out_no_further_at_the_sharpest_bend(
    radius_mm: float, allowed_mm: float
) -> None:
    bend_mm = 1.15 * radius_mm
    fine = fine_enough(COARSE, radius_mm, bend_mm, allowed_mm)
    # a circle on which `bend_radii` is the limit: its edges touch one of that radius from outside
    count = int(np.ceil(np.pi / np.arctan(0.5 * fine.settle_edge_radii * radius_mm / bend_mm)))
    turn = 2.0 * np.pi * np.arange(count) / count
    around = bend_mm / np.cos(np.pi / count)
    ring = around * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    found = stand_out(ring, radius_mm, fine.mesh_sides)
    assert found <= 0.9 * allowed_mm  # some is kept for edges that are not quite even
    assert found >= 0.3 * allowed_mm or fine.settle_edge_radii == COARSE.settle_edge_radii


def test_what_is_fine_enough_stays() -> None:
    fine = SearchSettings(mesh_sides=64, settle_edge_radii=0.2)
    assert fine_enough(fine, 1.5, 1.8, 0.2) == fine


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_corners_of_presets_stay_within_the_clearance_check(name: str) -> None:
    """Corners of 14 sides took .02 mm of a gap of .4 mm on either side: a knight in 5 s was rejected."""
    thick = fine_enough(PRESETS[name], 3.0, 3.5, 10.0)
    straight = np.zeros((400, 3))
    turn = 2.0 * np.pi * np.arange(400) / 400
    straight[:, :2] = 1000.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    assert stand_out(straight, 3.0, thick.mesh_sides) <= 0.0105 * 3.0


def test_the_accuracy_sets_the_outline_limit_of_a_scene() -> None:
    """A limit that the scene gives is kept; the resolved scene holds the number in either case."""
    for given, name, expected in (
        ({}, "sketch", 1.5),
        ({}, "standard", 0.5),
        ({"max_outline_error_px": 0.3}, "sketch", 0.3),
    ):
        accuracy = Accuracy(name=name, **given)
        assert outline_px(accuracy, search_settings(name, {})) == expected
