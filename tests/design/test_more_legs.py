"""Arches that are halved where a leg has nothing to brace it, or added where it is too flat."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shapely import MultiPolygon, Point

from knotfab.base.arrays import Array
from knotfab.design.design import _BRACINGS, _SHORTER, _brace_end, _brace_start
from knotfab.design.retries import _FLATTEST_DEG, _find_stretch, start_on_more_legs
from knotfab.geometry.legs import find_legs, plan_bars
from knotfab.geometry.polylines import Polylines, polylines_of
from knotfab.knots import Knot, Knots
from knotfab.plan import Search
from knotfab.problem import Start, TargetView, brace
from knotfab.start.profiles import lower
from knotfab.start.tie import KnotRoom, tie
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.piece import Material
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import PRESETS

RADIUS, LIGHT, PLA = 1.66, 600.0, 2300.0


def ring(arches: int, height: float, around: float = 30.0) -> Array:
    """A circle of arches, seen from the light as a circle."""
    s = np.linspace(0.0, arches, 200 * arches, endpoint=False)
    z = height * (1.0 - np.abs(2.0 * (s % 1.0) - 1.0)) - 40.0
    flat = around * np.column_stack(
        [np.cos(s * 2 * np.pi / arches), np.sin(s * 2 * np.pi / arches)]
    )
    return np.column_stack([flat * (1.0 - z / LIGHT)[:, None], z])


def problem(arched: bool = True) -> Any:
    view = ResolvedView(frame_width_mm=400.0, frame_height_mm=400.0, light_distance_mm=LIGHT)
    mask = np.ones((400, 400), dtype=bool)
    target = TargetView(view, mask, MultiPolygon())
    world = SimpleNamespace(leg_modulus_mpa=lambda radius: PLA, material=Material())
    return SimpleNamespace(arched=arched, views=(target,), world=world)


def found(*curves: Array, radius: float = RADIUS, **more: Any) -> Any:
    """What a search made of its start: a result, as far as legs go."""
    knots, asked = Knots(tuple(map(Knot, curves)), radius), problem()
    braced = brace(knots, asked.views[0], asked.world)
    return SimpleNamespace(knots=knots, braced=braced, add_work=lambda _: None, **more)


def ask(
    curve: Array,
    *,
    radius: float = RADIUS,
    begun: Array | None = None,
    arched: bool = True,
    types: tuple[str, ...] = ("unknot",),
    **how: bool,
) -> Start | None:
    start = Start((curve if begun is None else begun,), "a circle", types)
    return start_on_more_legs(problem(arched), start, found(curve, radius=radius), **how)


def test_halved_arches_keep_the_shadow_the_slopes_and_the_floor() -> None:
    before = ring(3, 80.0)
    start = ask(before)
    assert start is not None
    after = start.curves[0]
    np.testing.assert_allclose(lower(after, LIGHT), lower(before, LIGHT), atol=1e-9)
    assert after[:, 2].min() == pytest.approx(before[:, 2].min())
    assert after[:, 2].max() == pytest.approx(0.0, abs=1.0)  # half of 80 mm above a floor at -40
    assert len(find_legs([after])) == 2 * len(find_legs([before]))
    slope = [np.abs(np.diff(c[:, 2])).max() for c in (before, after)]
    assert slope[1] == pytest.approx(slope[0], rel=0.02)


def test_the_arch_that_sways_is_halved_however_the_search_lengthened_others() -> None:
    begun = ring(4, 80.0)
    low = np.r_[0:400, 600:800]  # the third arch alone is tall
    flat = lower(begun, LIGHT)
    begun[low, 2] = -40.0 + 0.25 * (begun[low, 2] + 40.0)
    begun[:, :2] = flat * (1.0 - begun[:, 2:] / LIGHT)
    found = begun.copy()
    found[220:380, 2] += 10.0 * np.abs(np.sin(np.arange(160) * np.pi / 4))  # wound up and down
    start = ask(found, begun=begun)
    assert start is not None
    after = start.curves[0]
    np.testing.assert_allclose(lower(after, LIGHT), flat, atol=1e-9)
    assert after[400:600, 2].max() == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize(
    ("radius", "height", "knot"),
    [(RADIUS, 80.0, "unknot"), (0.5, 140.0, "unknot")]
    + [(RADIUS, 80.0, knot) for knot in ("3_1", "4_1", "5_1")],
)
def test_halving_goes_on_until_no_leg_lacks_a_neighbour(
    radius: float, height: float, knot: str
) -> None:
    """A knot is tied into a low arch, with legs along the light's rays: they hold nothing else back."""
    curve = ring(4, height, height)  # the thinner the tube, the lower must arches be
    flat = lower(curve, LIGHT)
    if knot != "unknot":
        curve[:200, 2] = 0.25 * curve[:200, 2] - 30.0
        curve[:, :2] = flat * (1.0 - curve[:, 2:] / LIGHT)
    there = MultiPolygon([Point(flat[100]).buffer(20.0)])
    room = KnotRoom(there, LIGHT, radius, radius + 0.2, lambda _: 0.0, stands=True)
    (curve,) = tie((curve,), parse_knot_name(knot).factors, room).curves
    for _ in range(_BRACINGS):
        start = ask(curve, radius=radius)
        if start is None:
            break
        curve = start.curves[0]
    assert start is None and not len(plan_bars(find_legs([curve]), radius, PLA)[1])


@pytest.mark.parametrize("height", [30.0, 80.0])
def test_coarse_searches_come_first_until_every_leg_stands(height: float) -> None:
    begun = Start((ring(3, height),), "a circle")
    first = Search("search", problem(), begun, RADIUS, PRESETS["draft"], "thick", {"device": "cpu"})
    steps, states, starts = _brace_start(first), list[object](), list[Start]()
    with pytest.raises(StopIteration) as done:
        coarse: Any = next(steps)
        while True:
            asked = coarse.settings
            assert asked.coarse_iterations and not asked.fine_iterations + asked.settle_iterations
            states.append(object())
            starts.append(coarse.start)
            coarse = steps.send(found(*coarse.start.curves, state=states[-1]))
    going: Search = done.value.value
    assert len(starts) == (1 if height < 80.0 else 2) and starts[0] is begun
    assert going.start is starts[-1] and going.more["begun"] is states[-1]
    assert going.settings == first.settings.but(coarse_iterations=0)
    assert not len(plan_bars(find_legs(list(going.start.curves)), RADIUS, PLA)[1])


@dataclass
class Ended:
    """The state of a search that has ended, as far as legs go."""

    points: Array
    rings: Polylines


def ended(curve: Array, feasible: bool = True, iou: float = 0.99) -> Any:
    state = Ended(curve, polylines_of([curve]))
    return found(curve, state=state, feasible=feasible, iou_estimate=iou)


def test_legs_that_a_search_leaves_amiss_are_changed_where_they_stand() -> None:
    first = Search("search", problem(), Start((ring(3, 30.0),), "begun"), RADIUS, PRESETS["draft"])
    made = ended(ring(3, 80.0))
    steps = _brace_end(first, first.start, made)
    short = next(steps)
    assert isinstance(short, Search) and short.start is first.start
    assert not short.settings.coarse_iterations
    assert short.settings.fine_iterations == round(_SHORTER * first.settings.fine_iterations)
    state = short.more["begun"]
    assert state.rings is made.state.rings and not np.allclose(state.points, made.state.points)
    np.testing.assert_allclose(lower(state.points, LIGHT), lower(ring(3, 80.0), LIGHT), atol=1e-9)
    with pytest.raises(StopIteration) as done:
        steps.send(fitted := ended(state.points))
    assert done.value.value == (first.start, fitted)
    # a valley left in mid-air would print on nothing: the search begins again, as where strands draw worse
    aloft = ring(3, 30.0)
    aloft[100:300, 2] = np.maximum(aloft[100:300, 2], -30.0)
    for poor in ended(aloft), ended(state.points, iou=0.98):
        steps = _brace_end(first, first.start, made)
        next(steps)
        again = steps.send(poor)
        assert isinstance(again, Search) and again.settings == first.settings
        with pytest.raises(StopIteration) as done:
            steps.send(fitted)
        assert done.value.value == (again.start, fitted) and again.start is not first.start
    # what breaks a limit replaces nothing that keeps all
    steps = _brace_end(first, first.start, made)
    next(steps)
    with pytest.raises(StopIteration) as done:
        steps.send(ended(state.points, feasible=False))
    assert done.value.value == (first.start, made)


@pytest.mark.parametrize("arches", [2, 3])
@pytest.mark.parametrize("flank_deg", [25.0, 32.0, 37.0])
def test_a_flat_leg_gets_an_arch_so_that_all_are_steep(arches: int, flank_deg: float) -> None:
    height = np.pi * 9.0 * np.tan(np.radians(flank_deg))
    before = ring(arches, height, 9.0 * arches)
    start = ask(before)
    assert start is not None
    after = start.curves[0]
    np.testing.assert_allclose(lower(after, LIGHT), lower(before, LIGHT), atol=1e-9)
    assert [after[:, 2].min(), after[:, 2].max()] == pytest.approx(
        [before[:, 2].min(), before[:, 2].max()], abs=0.5
    )
    assert len(find_legs([after])) == 3 * len(find_legs([before]))
    for leg in find_legs([after]):
        away = np.linalg.norm(np.diff(leg.points[:, :2], axis=0), axis=1).sum()
        # 46 less what peaks round
        assert np.degrees(np.arctan2(np.ptp(leg.points[:, 2]), away)) > 44.0


@pytest.mark.parametrize(
    ("mean_deg", "bend_deg", "more"),
    [(40.0, 9.0, True), (40.0, 2.0, False), (46.0, 14.0, True), (46.0, 9.0, False)],
)
def test_a_leg_that_is_flat_above_gets_an_arch_though_it_is_steep_on_the_whole(
    mean_deg: float, bend_deg: float, more: bool
) -> None:
    before, count = ring(2, 26.0, 19.8), 200
    u = 1.0 - np.abs(np.linspace(-1.0, 1.0, count, endpoint=False))
    low, high = (np.tan(np.radians(mean_deg + way * bend_deg)) for way in (1, -1))
    height = 31.1 * np.where(u < 0.5, low * u, 0.5 * low + high * (u - 0.5))
    before[:, 2] = np.tile(height, 2) - 40.0
    before[:, :2] = lower(ring(2, 26.0, 19.8), LIGHT) * (1.0 - before[:, 2:] / LIGHT)
    legs = find_legs([before])
    rise = np.array([np.ptp(leg.points[:, 2]) for leg in legs])
    away = [np.linalg.norm(np.diff(leg.points[:, :2], axis=0), axis=1).sum() for leg in legs]
    assert (np.degrees(np.arctan2(rise, away)) > _FLATTEST_DEG).all()
    assert (ask(before) is not None) == more


@pytest.mark.parametrize(("flank_deg", "flat"), [(42.0, False), (35.0, True)])
def test_what_lies_on_the_bed_makes_no_leg_flat_once_a_search_has_ended(
    flank_deg: float, flat: bool
) -> None:
    before, u = ring(3, 26.0), 1.0 - np.abs(np.linspace(-1.0, 1.0, 200, endpoint=False))
    plan, lying = lower(before, LIGHT), np.minimum(u / 0.3, 1.0)
    flank = 0.7 * 10.0 * np.pi  # over the bed, of the sixth of a circle that a leg goes
    rise = flank * np.tan(np.radians(flank_deg)) * np.maximum(u - 0.3, 0.0) / 0.7
    before[:, 2] = np.tile(0.3 * RADIUS * lying + rise, 3) - 40.0
    before[:, :2] = plan * (1.0 - before[:, 2:] / LIGHT)
    assert ask(before) is not None and (ask(before, ended=True) is not None) == flat


def test_strands_that_cross_stay_apart_there() -> None:
    before = ring(5, 80.0)
    turn = 0.003 + np.linspace(0.0, 2 * np.pi, len(before), endpoint=False)
    # an eight, whose last edge crosses that in the middle
    flat = 60.0 * np.column_stack([np.sin(turn), np.sin(2 * turn)])
    before[:, :2] = flat * (1.0 - before[:, 2:] / LIGHT)
    start = ask(before, types=("3_1",))
    assert start is not None
    after = start.curves[0]
    np.testing.assert_allclose(lower(after, LIGHT), flat, atol=1e-9)
    moved = np.abs(after[:, 2] - before[:, 2])
    np.testing.assert_allclose(moved[[499, 500]], 0.0, atol=1e-9)
    # those below may move, but not by a tube's width
    assert (moved[[-1, 0]] < 0.01).all() and before[499, 2] - before[-1, 2] > 2 * RADIUS
    assert ask(before, every=True) is None and ask(ring(3, 80.0), every=True) is not None
    higher = moved.reshape(5, -1).max(axis=1) > 1.0
    assert higher[[1, 2, 3]].tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("height", "more"), [(30.0, {}), (80.0, {"arched": False})], ids=["short legs", "no arches"]
)
def test_other_starts_stay_as_they_are(height: float, more: dict[str, Any]) -> None:
    assert ask(ring(3, height), **more) is None


# A hairpin, its sides 4 mm apart: arches 24 mm wide on the way out, 40 mm on the way back.
OUT, APART = np.arange(0.0, 120.0), 4.0
HAIRPIN = np.concatenate(
    [np.column_stack([x, np.full(120, y)]) for x, y in ((OUT, 0.0), (OUT[::-1], APART))]
)
ARCHES = np.concatenate([w / 2 - np.abs(OUT % w - w / 2) for w in (24.0, 40.0)])


@pytest.mark.parametrize("turn", [0, 77, 200])
@pytest.mark.parametrize("aside_mm", [0.0, 0.6 * APART])
def test_a_leg_whose_top_has_come_nearer_to_the_strand_beside_it_is_found(
    aside_mm: float, turn: int
) -> None:
    plan, height = (np.roll(ring, turn, axis=0) for ring in (HAIRPIN, ARCHES))
    for valley, way, steps in ((24, 1, 12), (48, -1, 12), (160, 1, 20), (200, -1, 20)):
        leg = (turn + valley + way * np.arange(steps + 1)) % 240
        seen = plan[leg].copy()
        towards = 1.0 if valley < 120 else -1.0
        seen[steps // 2 :, 1] += towards * aside_mm
        assert _find_stretch(height, plan, seen).tolist() == leg.tolist()
    assert not len(_find_stretch(np.zeros(240), plan, plan[:10]))
