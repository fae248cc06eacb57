"""The pose in which a part is printed: the supports it takes, the printer's limits, and a flatter piece."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from validator_parts import circle

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.overhang import Estimate, Rules, Strands, estimate
from knotfab.geometry.tube import sweep
from knotfab.part.orient import (
    AXES,
    estimate_minutes,
    estimate_supports_cm3,
    flatter_depth,
    keeps_limits,
    propose_turns,
    rank_turns,
    strands_of,
)
from knotfab.part.pose import PrintPose, choose_pose
from tests.geometry.test_overhang import RADIUS, knots_of, wave

pytestmark = pytest.mark.slow

ROOM = (250.0, 210.0, 220.0)


def make_pose(
    curves: list[Array], rules: Rules, room: tuple[float, float, float] = ROOM
) -> PrintPose:
    return choose_pose(
        knots_of(*curves), [sweep(c, RADIUS, 16) for c in curves], room, (100.0, 100.0), rules=rules
    )


def test_a_flat_ring_lies_flat() -> None:
    turn = Rotation.from_euler("xyz", [30, 50, 70], degrees=True).as_matrix()
    pose = make_pose([circle(240) @ turn.T], Rules())
    assert pose.size_mm[2] == pytest.approx(2 * RADIUS, abs=0.1)
    assert pose.weighed is not None and pose.weighed.estimate.support_cm3 < 0.5


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
    assert before.weighed is not None and after.weighed is not None
    assert after.weighed.minutes <= 1.02 * before.weighed.minutes + 1.0


def test_the_pose_is_no_dearer_than_any_upright_one() -> None:
    for deep in (20.0, 60.0, 110.0):
        pose, again = make_pose([wave(deep=deep)], Rules()), make_pose([wave(deep=deep)], Rules())
        assert pose.weighed is not None
        upright = rank_turns(strands_of(knots_of(wave(deep=deep))), AXES, Rules())
        assert pose.weighed.minutes <= min(other.minutes for other in upright)
        assert (pose.matrix == again.matrix).all()


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
