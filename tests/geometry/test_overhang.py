"""Estimates of supports: exact shapes, invariants, and columns through the mesh."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from validator_parts import circle

from knotfab.base.arrays import Array
from knotfab.geometry import overhang
from knotfab.geometry.overhang import (
    EDGES,
    ROOF_GAP_MM,
    ROOF_LAYERS,
    SPACING_MM,
    Rules,
    Strands,
    estimate,
    support_cm3,
)
from knotfab.geometry.tube import sweep
from knotfab.knots import Knot, Knots
from knotfab.part.orient import AXES, strands_of
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.bridges import columns
from knotfab_validators.printing.standing import support_volume

pytestmark = pytest.mark.slow

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


def measure(points: Array, turn: Array) -> float:
    """Measure the supports (cm³) by the validators' own columns through the mesh."""
    vertices, faces = sweep(points @ turn.T, RADIUS, 32)
    mesh = Mesh(vertices - vertices.min(axis=0), faces.astype(np.int64))
    return support_volume(mesh, columns(mesh), 45.0, 0.2)[0] / 1000


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
