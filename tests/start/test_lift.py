"""Depth where people place carelessly: there is less, and less of the picture is lost, moved for real."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from oracles import cast, turn_about
from questions import ask_views

from knotfab.base.arrays import Array
from knotfab.effects.base import World
from knotfab.effects.misplacement import Steadying
from knotfab.problem import Problem, Start
from knotfab.scene.camera import camera_of
from knotfab.start import depth
from knotfab.start.filling import Template, fill
from knotfab.start.lift import lift_template
from knotfab_formats.piece import Mount
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS
from knotfab_formats.views import Placing, Switch

FEW = PRESETS["draft"].model_copy(update={"depth_candidates": 16})
RADIUS, DEPTH_MM = 3.0, 90.0
FRAME = shapely.box(-50, -50, 50, 50).difference(shapely.box(-38, -38, 38, 38))
BARS = shapely.MultiPolygon([FRAME.union(shapely.box(-50, -6, 50, 6))])


@pytest.fixture(scope="module")
def problem() -> Problem:
    return replace(ask_views([BARS], 0.0), depth_mm=DEPTH_MM, depth_open=True)


@pytest.fixture(scope="module")
def template() -> Template:
    return fill(BARS, RADIUS)


def _place(
    problem: Problem, template: Template, lamp_mm: float, turn_deg: float, word: Switch = None
) -> Start:
    world = World(placing=Placing(lamp_mm=lamp_mm, turn_deg=turn_deg))
    placed = replace(problem, world=world, switches={"misplacement": word})
    return lift_template(placed, template, RADIUS, FEW)


def _extent(start: Start) -> float:
    assert start.depth is not None
    measured = float(np.ptp(np.concatenate(start.curves)[:, 2]))
    assert measured == pytest.approx(start.depth.extent_mm, rel=0.02)
    return start.depth.extent_mm


def _ious(problem: Problem, start: Start, lamp_mm: float, turn_deg: float) -> Array:
    """(6, 2) IoU of the piece's shadow where the lamp is off along an axis or the piece is turned about one.

    With that of the piece as it is: raw, and after the best shift, scale and turn.
    """
    view = problem.views[0].view
    camera, points = camera_of(view, 1, 1), np.concatenate(start.curves)
    ends = np.cumsum([len(c) for c in start.curves])[:-1]
    wide = RADIUS * view.magnification

    def outline(shadow: Array) -> shapely.Geometry:
        rings = [shapely.LinearRing(c) for c in np.split(shadow, ends)]
        return shapely.union_all([ring.buffer(wide, quad_segs=2) for ring in rings])

    was = cast(points, camera.eye, camera)
    moved = [cast(points, camera.eye + lamp_mm * way, camera) for way in np.eye(3)]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for way in np.eye(3):
        turned = middle + (points - middle) @ turn_about(way, np.radians(turn_deg)).T
        moved.append(cast(turned, camera.eye, camera))
    found, truth = [], outline(was)
    for now in moved:
        one, other = ((s - s.mean(axis=0)) @ [1, 1j] for s in (was, now))
        fitted = other * np.vdot(other, one) / np.vdot(other, other)
        back = np.column_stack([fitted.real, fitted.imag]) + was.mean(axis=0)
        shadows = [outline(now), outline(back)]
        found.append([truth.intersection(s).area / truth.union(s).area for s in shadows])
    return np.array(found)


def test_coarser_placing_makes_flatter_pieces_that_lose_less(
    problem: Problem, template: Template
) -> None:
    alike = _place(problem, template, 5.0, 1.0, False)
    usual, coarse = (_place(problem, template, *p) for p in ((5.0, 1.0), (50.0, 5.0)))
    assert _extent(alike) == _extent(usual) == DEPTH_MM  # there it would cost more than it gains
    for one, other in zip(alike.curves, usual.curves, strict=True):
        np.testing.assert_array_equal(one, other)
    assert _extent(coarse) < 0.8 * DEPTH_MM
    deep, flat = (_ious(problem, start, 50.0, 5.0) for start in (alike, coarse))
    # raw: the shadow merely moves; as a person sees it: the worst, and all
    assert flat[:, 0].mean() >= deep[:, 0].mean()
    assert flat[:, 1].min() > deep[:, 1].min() + 0.05
    assert flat[:, 1].mean() > deep[:, 1].mean() + 0.05


def test_what_print_costs_is_weighed_in_the_extent(
    problem: Problem, template: Template, monkeypatch: pytest.MonkeyPatch
) -> None:
    def extent(dearer_by: float, lamp_mm: float, turn_deg: float) -> float:
        """Supports cost so much more at full depth than at none."""

        def supports(judge: depth._Judge, parts: list[Array]) -> Array:
            return np.array([dearer_by * judge.extent_mm / DEPTH_MM])

        monkeypatch.setattr(depth._Judge, "supports", supports)
        return _extent(_place(problem, template, lamp_mm, turn_deg))

    assert extent(0.2, 50.0, 5.0) < extent(0.0, 50.0, 5.0) < extent(-0.2, 50.0, 5.0)
    # by itself that is no reason: what careless placing asks grows from nothing at its threshold
    assert extent(0.2, 5.0, 1.0) == DEPTH_MM


def test_loose_pieces_are_as_deep_with_the_mount_left_open(problem: Problem) -> None:
    loose = fill(
        shapely.MultiPolygon([shapely.box(-50, -40, -8, 40), shapely.box(8, -40, 50, 40)]), RADIUS
    )
    assert len(loose.curves) > 1
    starts = {}
    for kind in ("auto", "wall", "none"):
        placing = Placing(lamp_mm=5.0, turn_deg=10.0)
        world = World.from_scene(Scene(mount=Mount(kind=kind), placing=placing))
        starts[kind] = lift_template(replace(problem, world=world), loose, RADIUS, FEW)
    assert _extent(starts["auto"]) == _extent(starts["wall"]) > _extent(starts["none"])
    for one, other in zip(starts["auto"].curves, starts["wall"].curves, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_depth_that_the_scene_gives_is_kept(problem: Problem, template: Template) -> None:
    given = _place(replace(problem, depth_open=False), template, 50.0, 5.0)
    assert _extent(given) == DEPTH_MM and given.effects["misplacement"].calls == 0
    # a rebuild from the depth that was chosen finds the same piece
    chosen = _place(problem, template, 50.0, 5.0)
    again = replace(problem, depth_mm=_extent(chosen), depth_open=False)
    for one, other in zip(chosen.curves, _place(again, template, 50.0, 5.0).curves, strict=True):
        np.testing.assert_array_equal(one, other)


def test_placing_that_is_not_called_for_runs_no_code(
    problem: Problem, template: Template, monkeypatch: pytest.MonkeyPatch
) -> None:
    def explode(*_: object) -> None:
        raise AssertionError("the lamp was moved")

    called = _place(problem, template, 5.0, 1.0).effects["misplacement"]
    assert called.where == ["depth"] and called.calls > 0
    for name in ("lost", "cost"):
        monkeypatch.setattr(Steadying, name, explode)
    for lamp_mm, word in ((0.0, None), (0.0, True), (60.0, False)):
        off = _place(problem, template, lamp_mm, 0.0, word).effects["misplacement"]
        assert off.calls == 0 and off.where == [] and off.seconds == 0.0
    with pytest.raises(AssertionError, match="moved"):
        _place(problem, template, 60.0, 0.0)
