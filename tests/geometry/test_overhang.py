"""Estimates of supports, and the pose chosen by them: exact shapes, invariants, the printer's limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from validator_parts import circle

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry import overhang
from knotfab.geometry.overhang import (
    EDGES,
    ROOF_GAP_MM,
    ROOF_LAYERS,
    SPACING_MM,
    Estimate,
    Rules,
    Strands,
    estimate,
    support_cm3,
)
from knotfab.geometry.tube import sweep
from knotfab.knots import Knot, Knots
from knotfab.part.flatter import estimate_flatter, flatter_depth
from knotfab.part.orient import (
    AXES,
    estimate_minutes,
    estimate_supports_cm3,
    keeps_limits,
    propose_turns,
    rank_turns,
    strands_of,
)
from knotfab.part.pose import PrintPose, choose_pose
from knotfab_formats.report import Flatter
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.columns import columns
from knotfab_validators.printing.overhang import support_volume

pytestmark = pytest.mark.slow

ROOM = (250.0, 210.0, 220.0)
RADIUS = 2.0
FOOT = np.array([[200.0, 0, 0], [200.0, 50, 0]])
BAR = np.array([[0.0, 0, 30], [100.0, 0, 30]])


def wave(n: int = 400, deep: float = 30.0) -> Array:
    """A closed curve without symmetry, 120 mm across and `deep` mm from end to end."""
    t = 2 * np.pi * np.arange(n) / n
    z = np.cos(3 * t) + 0.6 * np.sin(5 * t + 0.4) + 0.4 * np.cos(t)
    flat = 60 * np.column_stack([np.cos(t) + 0.15 * np.cos(2 * t), 0.7 * np.sin(t)])
    return np.column_stack([flat, deep * (z - z.min()) / np.ptp(z)])


def knots_of(*curves: Array) -> Knots:
    return Knots(tuple(Knot(c) for c in curves), RADIUS)


def rods(*lines: Array) -> Strands:
    """Open lines as a few rods."""
    return strands_of(Knots(tuple(Knot(line, closed=False) for line in lines), RADIUS))


def make_pose(
    curves: list[Array], rules: Rules, room: tuple[float, float, float] = ROOM
) -> PrintPose:
    return choose_pose(knots_of(*curves), [sweep(c, RADIUS, 16) for c in curves], room, rules=rules)


def measure(points: Array, turn: Array) -> float:
    """Measure the supports (cm³) by the validators' own columns through the mesh."""
    vertices, faces = sweep(points @ turn.T, RADIUS, 32)
    mesh = Mesh(vertices - vertices.min(axis=0), faces.astype(np.int64))
    return support_volume(mesh, columns(mesh), 45.0, 0.2)[0] / 1000


# --- the estimate ---


def test_a_level_bar_above_a_lower_one() -> None:
    """Columns under a bar are 2 r sin 45° wide and reach from its underside down to the bed."""
    found = estimate(rods(FOOT, BAR), np.eye(3), Rules())
    half = RADIUS * np.sin(np.pi / 4)
    # the underside's mean height above its lowest line, over the width that counts
    x = np.linspace(-half, half, 2001)
    below = (RADIUS - np.sqrt(RADIUS**2 - x**2)).mean()
    exact = 2 * half * 100 * (30 + below) / 1000
    on_bed = 2 * half * 50 * below / 1000  # the foot's volume, above the first layer
    assert found.support_cm3 == pytest.approx(exact + on_bed, rel=0.03)
    assert found.height_mm == pytest.approx(30 + 2 * RADIUS)


def test_the_columns_alone_are_the_estimates_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last digit, and without what only the estimate is asked for."""
    strands, rules = strands_of(knots_of(wave(), circle(240, 20.0))), Rules(40.0)
    turns = Rotation.random(6, random_state=3).as_matrix()
    whole = [estimate(strands, turn, rules).support_cm3 for turn in turns]

    def explode(*_: object) -> None:
        raise AssertionError("more than the columns was worked out")

    for name in ("_tip", "_weigh_supports", "_over_air"):
        monkeypatch.setattr(overhang, name, explode)
    assert [support_cm3(strands, turn, rules) for turn in turns] == whole
    assert min(whole) > 0


def test_the_filament_of_a_wall_under_a_bar() -> None:
    """A line along either edge, lines across, two layers of roof: counted by hand; never of more than
    the pose needs."""
    rules = Rules()
    found = estimate(rods(FOOT, BAR), np.eye(3), rules)
    line, wide = rules.support_line_mm, 2 * RADIUS * np.sin(np.pi / 4)
    edges = EDGES * line * 100 * 30
    across = line / (SPACING_MM + line) * wide * 100 * 30
    roof = ROOF_LAYERS * rules.layer_mm * wide * 100 * line / (line + ROOF_GAP_MM)
    assert found.filament_cm3 == pytest.approx((edges + across + roof) / 1000, rel=0.05)
    pole = estimate(rods(np.array([[0.0, 0, 0], [0, 0, 80.0]])), np.eye(3), rules)
    assert pole.filament_cm3 == 0.0


def test_columns_end_on_the_strand_below() -> None:
    """The same bar with another 10 mm below it: the column is as high as the gap between them."""
    lower = np.array([[0.0, 0, 20], [100.0, 0, 20]])
    foot = np.array([[0.0, 80, 0], [100.0, 80, 0]])

    def volume(*bars: Array) -> float:
        return estimate(rods(*bars), np.eye(3), Rules()).support_cm3

    both, alone = volume(foot, BAR, lower), volume(foot, lower)
    half = RADIUS * np.sin(np.pi / 4)
    assert both - alone == pytest.approx(2 * half * 100 * (10 - 2 * RADIUS) / 1000, rel=0.25)
    assert volume(foot, BAR) > alone  # it is higher


@pytest.mark.parametrize(("lean", "needs"), [(44.0, False), (46.0, True)])
def test_the_limit_of_overhang(lean: float, needs: bool) -> None:
    """A bar that leans by less than the limit from the vertical hangs over nowhere."""
    s, c = np.sin(np.radians(lean)), np.cos(np.radians(lean))
    bar = rods(np.array([[0.0, 0, 0], [60 * s, 0, 60 * c]]))
    assert (estimate(bar, np.eye(3), Rules()).support_cm3 > 0) == needs
    assert estimate(bar, np.eye(3), Rules(max_overhang_deg=47.0)).support_cm3 == 0


@pytest.mark.parametrize("turn", AXES[:3])
def test_it_agrees_with_columns_through_the_mesh(turn: Array) -> None:
    found = estimate(strands_of(knots_of(wave())), turn, Rules()).support_cm3
    exact = measure(wave(), turn)
    assert 0.85 * exact < found < 1.05 * exact


def test_what_stands_and_what_tips() -> None:
    flat = estimate(strands_of(knots_of(circle(240))), np.eye(3), Rules())
    assert flat.tip_deg == pytest.approx(np.degrees(np.arctan2(40.0, RADIUS)), abs=1.5)
    assert flat.contact_mm2 == pytest.approx(
        2 * np.pi * 40 * 2 * np.sqrt(0.2 * (2 * RADIUS - 0.2)), rel=0.01
    )
    pole = estimate(rods(np.array([[0.0, 0, 0], [0, 0, 80.0]])), np.eye(3), Rules())
    assert pole.tip_deg == 0.0


def test_starts_and_bridges_count_where_nothing_is_supported() -> None:
    n = 300
    t = 2 * np.pi * np.arange(n) / n
    arch = np.column_stack([60 * np.cos(t), 60 * np.sin(t), 20 * np.cos(2 * t)])
    alone = Rules(supports=False)
    saddle = estimate(strands_of(knots_of(arch)), np.eye(3), alone)
    assert saddle.starts == 0  # it stands on both its feet
    raised = arch + np.where((t > np.pi)[:, None], [0.0, 0.0, 5.0], 0.0)
    assert estimate(strands_of(knots_of(raised)), np.eye(3), alone).starts >= 1
    # the arch's top lies within one layer of its highest point
    curve = 60**2 + 0.0
    way = 2 * np.sqrt(2 * 0.2 / (4 * 20 / curve))
    assert saddle.bridge_mm == pytest.approx(way, rel=0.35)
    assert estimate(strands_of(knots_of(arch)), np.eye(3), Rules()).bridge_mm == 0.0


# --- the choice ---


def test_a_flat_ring_lies_flat() -> None:
    turn = Rotation.from_euler("xyz", [30, 50, 70], degrees=True).as_matrix()
    pose = make_pose([circle(240) @ turn.T], Rules())
    assert pose.size_mm[2] == pytest.approx(2 * RADIUS, abs=0.1)
    assert pose.account is not None
    assert pose.account.chosen.estimate.support_cm3 < 0.5


def test_an_arch_stands_on_its_feet_or_lies() -> None:
    """Never on its back with both ends in the air: that costs supports and height."""
    t = np.linspace(0, np.pi, 80)
    there = np.column_stack([50 * np.cos(t), 0 * t, 50 * np.sin(t)])
    arch = np.concatenate([there, there[::-1] + [0.0, 12.0, 0.0]])
    turn = Rotation.from_euler("xyz", [20, 10, 60], degrees=True).as_matrix()
    strands = Strands(*_as_rods(arch @ turn.T), (len(arch),), RADIUS)
    best = rank_turns(strands, propose_turns(strands), Rules())[0]
    on_its_back = estimate(strands, turn.T @ np.diag([1.0, -1.0, -1.0]), Rules())
    assert best.minutes < estimate_minutes(on_its_back)
    assert best.estimate.height_mm < 25.0


def _as_rods(points: Array) -> tuple[Array, Array, Array]:
    step = np.roll(points, -1, axis=0) - points
    length = np.linalg.norm(step, axis=1)
    return points + step / 2, step / length[:, None], length


@pytest.mark.parametrize("seed", range(3))
def test_turning_the_piece_before_changes_little(seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    curve = wave(deep=60.0)
    before, after = make_pose([curve], Rules()), make_pose([curve @ turn.T], Rules())
    assert before.account is not None and after.account is not None
    assert after.account.chosen.minutes <= 1.02 * before.account.chosen.minutes + 1.0


def test_the_pose_is_no_dearer_than_the_least_height() -> None:
    for deep in (20.0, 60.0, 110.0):
        pose, again = make_pose([wave(deep=deep)], Rules()), make_pose([wave(deep=deep)], Rules())
        account = pose.account
        assert account is not None
        assert account.chosen.minutes <= account.least_height.minutes
        assert all(account.chosen.minutes <= other.minutes for other in account.runners_up)
        assert (pose.matrix == again.matrix).all()
        assert account.figures().support_cm3_estimate == round(
            account.chosen.estimate.support_cm3, 2
        )


@pytest.mark.parametrize(
    "room", [(250.0, 210.0, 220.0), (140.0, 100.0, 70.0), (75.0, 140.0, 110.0), (100.0, 100.0, 140)]
)
def test_the_build_volume_is_always_kept(room: tuple[float, float, float]) -> None:
    pose = make_pose([wave(deep=60.0)], Rules(margin_mm=2.0), room)
    assert (pose.size_mm <= np.array(room) + 1e-6).all()
    assert min(v.min() for v, _ in pose.tubes) == 0.0
    assert np.linalg.det(pose.matrix[:3, :3]) == pytest.approx(1.0)


def test_room_is_left_for_supports_where_there_is_some() -> None:
    curve = wave(deep=60.0)
    size = make_pose([curve], Rules()).size_mm
    tight = (float(size[0]), float(size[1]), 200.0)
    wide = (float(size[0]) + 10, float(size[1]) + 10, 200.0)
    assert (make_pose([curve], Rules(margin_mm=5.0), tight).size_mm <= np.array(tight) + 1e-6).all()
    assert (
        make_pose([curve], Rules(margin_mm=5.0), wide).size_mm[:2] <= np.array(wide)[:2] - 10
    ).all()


def test_too_large_for_any_pose() -> None:
    with pytest.raises(SceneError, match=r"holds 60\.0 x 60\.0 x 60\.0"):
        make_pose([wave(deep=60.0)], Rules(), (60.0, 60.0, 60.0))


def test_what_keeps_the_limit_comes_first() -> None:
    strands = strands_of(knots_of(wave(deep=80.0)))
    turns = propose_turns(strands)
    free = rank_turns(strands, turns, Rules())
    limit = 1.0001 * min(estimate_supports_cm3(p.estimate) for p in free)
    tight = rank_turns(strands, turns, Rules(max_support_cm3=limit))
    assert estimate_supports_cm3(tight[0].estimate) <= limit
    assert [p.minutes for p in free] == sorted(p.minutes for p in free)
    # where none keeps it, the least supports come first
    none = rank_turns(strands, turns, Rules(max_support_cm3=0.9 * limit))
    volumes = [p.estimate.support_cm3 for p in none]
    assert volumes == sorted(volumes)


def test_limits_are_inclusive() -> None:
    found = Estimate(100.0, 50.0, 5.0, 30.0, 0, 10.0)
    assert keeps_limits(found, Rules(max_support_cm3=estimate_supports_cm3(found)))
    assert not keeps_limits(found, Rules(max_support_cm3=0.99 * estimate_supports_cm3(found)))
    assert keeps_limits(found, Rules())
    assert keeps_limits(found, Rules(supports=False, max_bridge_mm=10.0))
    assert not keeps_limits(found, Rules(supports=False, max_bridge_mm=9.9))
    falling = Estimate(100.0, 50.0, 5.0, 30.0, 1, 0.0)
    assert not keeps_limits(falling, Rules(supports=False))
    assert keeps_limits(falling, Rules())


def test_the_weights_of_a_pose() -> None:
    """9 min a cm³, a layer in 4 s, 30 min for what falls, 5 min for what hardly touches the bed."""
    sound = Estimate(10.0, 20.0, 1e9, 45.0, 0, 0.0)
    assert estimate_minutes(sound) == pytest.approx(20 / 0.2 * 4 / 60, abs=1e-6)
    propped = replace(sound, filament_cm3=2.0)
    assert estimate_minutes(propped) == pytest.approx(18.0 + 20 / 0.2 * 4 / 60, abs=1e-6)
    assert estimate_minutes(Estimate(10.0, 20.0, 1e9, 0.0, 0, 0.0)) == pytest.approx(
        estimate_minutes(sound) + 30
    )
    assert estimate_minutes(Estimate(10.0, 20.0, 0.0, 45.0, 0, 0.0)) == pytest.approx(
        estimate_minutes(sound) + 5
    )
    assert estimate_minutes(Estimate(10.0, 20.0, 1e9, 10.0, 0, 0.0)) == pytest.approx(
        estimate_minutes(sound)
    )


# --- less depth ---


def test_less_depth_takes_less_and_as_much_depth_the_same() -> None:
    knots = knots_of(wave(deep=80.0))
    sliced = Flatter(1.0, 12.0, 100.0, 60.0)
    same, less, flat = estimate_flatter(knots, sliced, Rules(), (1.0, 0.6, 0.0))
    assert (same.hours, same.grams, same.support_grams) == pytest.approx((12.0, 100.0, 60.0))
    assert flat.hours < less.hours < 12.0 and flat.support_grams < less.support_grams < 60.0
    assert 0 < flat.grams < less.grams < 100.0
    none = estimate_flatter(knots, Flatter(1.0, 5.0, 40.0, 0.0), Rules(), (0.6,))[0]
    assert none.support_grams == 0.0


# --- the depth that would do ---


def test_a_flatter_piece_is_proposed_where_no_pose_will_do() -> None:
    knots = knots_of(wave(deep=100.0))

    def least(share: float) -> float:
        curve = wave(deep=100.0) * [1.0, 1.0, share]
        strands = strands_of(knots_of(curve), most=2000)
        turns = propose_turns(strands)
        return min(estimate_supports_cm3(p.estimate) for p in rank_turns(strands, turns, Rules()))

    whole = least(1.0)
    assert flatter_depth(knots, 100.0, Rules()) is None
    assert flatter_depth(knots, 100.0, Rules(max_support_cm3=2 * whole)) is None
    assert flatter_depth(knots, 100.0, Rules(max_support_cm3=0.0)) is None
    assert flatter_depth(knots, 100.0, Rules(supports=False, max_support_cm3=0.5 * whole)) is None
    limit = 0.5 * whole
    depth = flatter_depth(knots, 100.0, Rules(max_support_cm3=limit))
    assert depth is not None and 0 < depth < 100
    assert least(depth / 100) <= limit
    assert least(min(1.0, depth / 100 + 0.15)) > 0.8 * limit


def test_below_a_span_is_the_top_of_what_stands_apart_from_it() -> None:
    """No span is below another with which it overlaps, be it through others between them."""
    rng = np.random.default_rng(4)
    cells, low = rng.integers(0, 6, 60), rng.uniform(0, 10, 60)
    high = low + rng.uniform(0.1, 1.5, 60)
    floor = overhang._floors(cells, low, high)
    for n in range(60):
        here = np.flatnonzero(cells == cells[n])
        reached, before = low[n], np.inf
        while reached < before:  # down to where nothing of what it leans on begins
            before, touching = reached, (low[here] <= reached) & (high[here] >= reached)
            reached = min(reached, low[here][touching].min(initial=reached))
        assert floor[n] == high[here][high[here] < reached].max(initial=0.0)
