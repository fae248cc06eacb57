"""The frame model against beams of known deflection, against itself turned, and against PyNite's."""

from dataclasses import replace

import numpy as np
import pytest
from pieces import RADIUS, knots, one, ring

from knotfab.hold.beams import DOWN, PIECES, Stiffness, piece_beams, sag_moves, worst_of
from knotfab.hold.foot_plate import lean_on_wall
from knotfab.hold.pegs import choose_pegs, pegs_on, sites_with
from knotfab.hold.shade import free_rays
from knotfab.hold.space_frame import GRAVITY_M_S2, POISSON, Beams, assemble_frame, round_beams
from knotfab.hold.struts import (
    GROUND,
    ROOT_SHARE,
    Candidates,
    Obstacles,
    join_members,
    list_struts,
    no_members,
    sites_of,
)
from knotfab.knots import Knot, Knots
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView

E, RHO, R = 3000.0, 1.24, 1.5
W = np.pi * R**2 * RHO * 1e-6 * GRAVITY_M_S2  # N/mm
I = np.pi / 4 * R**4  # noqa: E741


def deflect(beams: Beams, fixed: np.ndarray, down: np.ndarray = DOWN) -> np.ndarray:
    """(n, 3) displacement of the joints, mm, under the beams' own weight."""
    return assemble_frame(beams, fixed, E, RHO, down).displacements()[:, :3]


def line(length: float, pieces: int, direction: tuple[float, float, float] = (1, 0, 0)):
    joints = np.linspace(0, length, pieces + 1)[:, None] * np.array(direction, dtype=float)
    ends = np.column_stack([np.arange(pieces), np.arange(1, pieces + 1)])
    return round_beams(joints, ends, np.full(pieces, R))


@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_a_cantilever_under_its_weight(pieces: int) -> None:
    beams = line(100.0, pieces)
    moved = deflect(beams, np.array([0]))
    assert moved[-1] == pytest.approx([0, -W * 100.0**4 / (8 * E * I), 0], rel=1e-9, abs=1e-15)


def test_a_beam_held_at_both_ends() -> None:
    moved = deflect(line(200.0, 4), np.array([0, 4]))
    assert -moved[2, 1] == pytest.approx(W * 200.0**4 / (384 * E * I), rel=1e-9)


def test_a_rod_that_hangs_is_stretched() -> None:
    moved = deflect(line(80.0, 3, (0, -1, 0)), np.array([0]))
    assert -moved[-1, 1] == pytest.approx(W * 80.0**2 / (2 * E * np.pi * R**2), rel=1e-9)


def test_an_arm_twists_the_beam_that_holds_it() -> None:
    """Both legs of an L in the horizontal plane bend, and the second twists the first."""
    a, b = 60.0, 40.0
    joints = np.array([[0, 0, 0], [a, 0, 0], [a, 0, b]], dtype=float)
    beams = round_beams(joints, np.array([[0, 1], [1, 2]]), np.full(2, R))
    moved = deflect(beams, np.array([0]))
    shear, j = E / (2 * 1.35), np.pi / 2 * R**4
    tip = W * b * a**3 / (3 * E * I) + W * a**4 / (8 * E * I)
    tip += W * b * (b / 2) * a / (shear * j) * b + W * b**4 / (8 * E * I)
    assert -moved[2, 1] == pytest.approx(tip, rel=1e-9)


def test_turning_the_world_turns_the_answer() -> None:
    rng = np.random.default_rng(1)
    joints = rng.normal(size=(12, 3)) * 30
    ends = np.column_stack([np.arange(12), np.roll(np.arange(12), -1)])
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    one = deflect(round_beams(joints, ends, np.full(12, R)), np.array([0, 5]))
    other = deflect(round_beams(joints @ q.T, ends, np.full(12, R)), np.array([0, 5]), q @ DOWN)
    assert np.allclose(one @ q.T, other, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 90.0])
def test_a_strip_is_stiffer_edgewise_than_flat(tilt_deg: float) -> None:
    """A cantilever along x of 7 x 1.6 mm, turned about its axis under its own weight."""
    wide, thick, length = 7.0, 1.6, 60.0
    out = np.array([0.0, np.sin(np.radians(tilt_deg)), np.cos(np.radians(tilt_deg))])
    area, flat, edgewise = np.array([[wide * thick, wide * thick**3 / 12, wide**3 * thick / 12]]).T
    strip = Beams(
        np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]]),
        np.array([[0, 1]]),
        area,
        flat,
        4 * flat,
        out,
        edgewise,
    )
    moved = assemble_frame(strip, np.array([0]), 2000.0, 1.24, DOWN).displacements()[1, :3]
    load = 1.24e-6 * GRAVITY_M_S2 * area[0] * length**4 / (8 * 2000.0)
    up = np.cross(out, [1.0, 0.0, 0.0])  # within the strip's plane, across it
    assert moved @ out == pytest.approx(load * (DOWN @ out) / flat[0], abs=1e-9)
    assert moved @ up == pytest.approx(load * (DOWN @ up) / edgewise[0], abs=1e-9)


@pytest.mark.parametrize(("at", "pressed"), [(-60.0, True), (60.0, False)])
def test_a_strip_leans_on_the_wall_below_its_screw_and_lifts_off_above_it(
    at: float, pressed: bool
) -> None:
    """A heavy arm stands out from the strip's free end, over the wall z = 0."""
    joints = np.array([[0.0, 0.0, 0.0], [0.0, at, 0.0], [0.0, at, 60.0]])
    ends, out = np.array([[0, 1], [1, 2]]), np.array([0.0, 0.0, 1.0])
    beams = round_beams(joints, ends, np.array([1.5, 4.0]))
    pla, free = Stiffness(2000.0, 1.24, 0.5), np.zeros(18, dtype=bool)
    free[:6] = True
    held = lean_on_wall(beams, free, np.array([0, 1]), out, pla)
    assert held[8] == pressed and (np.delete(held, 8) == np.delete(free, 8)).all()
    moved = [
        assemble_frame(beams, np.array([]), 2000.0, 1.24, DOWN, some).displacements()
        for some in (free, held)
    ]
    assert (moved[0][1, 2] < 0) == pressed and moved[1][1, 2] >= 0.0
    assert (abs(moved[1][2, 1]) < 0.9 * abs(moved[0][2, 1])) == pressed
    aslant = np.array([0.0, 0.6, 0.8])  # a wall that leans holds nothing
    assert (lean_on_wall(beams, free, np.array([0, 1]), aslant, pla) == free).all()


def test_no_joint_of_a_long_strip_is_within_the_wall_and_the_wall_only_presses() -> None:
    """Arms of several lengths stand out from it, so that it would wave into the wall between screws."""
    n = 40
    along = np.column_stack([np.zeros(n), 5.0 * np.arange(n), np.zeros(n)])
    arms = np.arange(3, n, 5)
    far = along[arms] + np.array([0.0, 0.0, 1.0]) * (20.0 + 37.0 * (arms % 4))[:, None]
    ends = np.concatenate(
        [
            np.column_stack([np.arange(n - 1), np.arange(1, n)]),
            np.column_stack([arms, n + np.arange(len(arms))]),
        ]
    )
    beams = round_beams(np.concatenate([along, far]), ends, np.full(len(ends), 1.5))
    screws = np.zeros((len(beams.joints), 6), dtype=bool)
    screws[[0, 13, 26, n - 1]] = True
    pla, out = Stiffness(2000.0, 1.24, 0.5), np.array([0.0, 0.0, 1.0])
    held = lean_on_wall(beams, screws.ravel(), np.arange(n), out, pla)
    how = np.array([]), pla.young_mpa, pla.density_g_cm3, DOWN
    alone = assemble_frame(beams, *how, screws.ravel())
    free = alone.displacements()[:n, 2]
    moved = assemble_frame(beams, *how, held).displacements()[:n, 2]
    leaning = np.flatnonzero(held & ~screws.ravel())
    assert len(leaning) > 3 and (leaning % 6 == 2).all()
    assert free.min() < -1e-3 and moved.min() > -1e-8
    pushes = np.linalg.solve(alone.moves_under(leaning)[leaning], -free[leaning // 6])
    assert (pushes > 0).all()


def test_what_nothing_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="held"):
        deflect(line(10.0, 2), np.array([], dtype=int))
    with pytest.raises(ValueError, match="no length"):
        deflect(line(0.0, 2), np.array([0]))


AGREE = 1e-6  # a share of the largest displacement


def by_pynite(beams: Beams, fixed: np.ndarray, down: np.ndarray) -> np.ndarray:
    """(n, 3) displacement of every joint, mm (N, mm and MPa throughout)."""
    from Pynite import FEModel3D  # loading it takes seconds, for which other workers need not wait

    model = FEModel3D()
    model.add_material("plastic", E, E / (2 * (1 + POISSON)), POISSON, 0.0)
    for number, (x, y, z) in enumerate(beams.joints):
        model.add_node(f"J{number}", x, y, z)
    for number, (a, b) in enumerate(beams.ends):
        inertia = beams.inertia[number]
        model.add_section(f"S{number}", beams.area[number], inertia, inertia, beams.twist[number])
        model.add_member(f"B{number}", f"J{a}", f"J{b}", "plastic", f"S{number}")
        weight = beams.area[number] * RHO * 1e-6 * GRAVITY_M_S2
        for axis, share in zip("XYZ", down, strict=True):
            model.add_member_dist_load(f"B{number}", f"F{axis}", weight * share, weight * share)
    for number in fixed:
        model.def_support(f"J{number}", True, True, True, True, True, True)
    model.analyze_linear(check_stability=False)
    name = next(iter(model.load_combos))
    nodes = [model.nodes[f"J{n}"] for n in range(len(beams.joints))]
    return np.array([[n.DX[name], n.DY[name], n.DZ[name]] for n in nodes])


def compare(beams: Beams, fixed: np.ndarray, down: np.ndarray = DOWN) -> np.ndarray:
    """The displacements, the same by both."""
    own = deflect(beams, fixed, down)
    other = by_pynite(beams, fixed, down)
    assert np.abs(own - other).max() < AGREE * np.linalg.norm(other, axis=1).max()
    return own


@pytest.mark.parametrize("down", [(0.0, -1.0, 0.0), (0.6, 0.0, -0.8)])
def test_a_leaning_cantilever_of_changing_section(down: tuple[float, float, float]) -> None:
    joints = np.linspace(0, 1, 6)[:, None] * np.array([60.0, 25.0, -40.0])
    ends = np.column_stack([np.arange(5), np.arange(1, 6)])
    beams = round_beams(joints, ends, np.linspace(2.5, 1.0, 5))
    assert np.linalg.norm(compare(beams, np.array([0]), np.array(down))[-1]) > 0.002


def test_a_portal_frame_that_leans_out_of_its_plane() -> None:
    joints = np.array([[0, 0, 0], [0, 80, 10], [60, 80, 10], [60, 0, 0], [30, 80, 45]], dtype=float)
    ends = np.array([[0, 1], [1, 2], [2, 3], [1, 4], [4, 2]])
    beams = round_beams(joints, ends, np.array([1.5, 1.2, 1.5, 0.8, 0.8]))
    moved = compare(beams, np.array([0, 3]))
    # the arm leans out to +z: the frame goes that way, and down
    assert moved[4, 1] < 0 < moved[4, 2]


@pytest.mark.slow
def test_two_knots_on_their_pegs_with_a_strut_and_a_leaning_peg() -> None:
    """The whole frame of a wall mount, as `sag_moves` solves it, and what it says of the sag."""
    t = 2 * np.pi * np.arange(160) / 160
    flower = np.column_stack([45 * np.cos(t), 45 * np.sin(t), 10 * np.sin(3 * t)])
    inner = np.column_stack([22 * np.cos(t), 22 * np.sin(t), 8 * np.cos(2 * t)])
    knots = Knots((Knot(flower), Knot(inner)), 2.0)
    camera = camera_of(ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0), 90, 90)
    rays = free_rays(knots, camera, 0.95, 0.4)
    thick = np.full(len(rays.top), 1.9)
    foot = thick * np.linalg.norm(rays.foot - camera.eye, axis=1)
    foot = foot / np.linalg.norm(rays.top - camera.eye, axis=1)
    stiffness = Stiffness(E, RHO, 0.2)
    pegs = choose_pegs(knots, rays, thick, foot, stiffness).rays
    sites = sites_with(knots, rays, pegs)
    pairs = np.array([[int(np.flatnonzero(sites.knot == 1)[0]), 0]])
    strut = list_struts(sites, pairs, 2.0, 1.5)
    top, ground = sites.point[[5]], np.array([GROUND])
    leaning = Candidates(
        np.array([5]), ground, top, top + [10.0, 40.0, -100.0 - top[0, 2]], np.array([1.5])
    )
    members = join_members([pegs_on(sites, rays, pegs, thick, foot), strut, leaning])
    assert len(members) == len(pegs) + 2
    beams, fixed = piece_beams(knots.radius_mm, sites, members, PIECES)
    assert len(fixed) == len(pegs) + 1
    size = np.linalg.norm(compare(beams, fixed)[: len(sites.knot)], axis=1)
    # the frame that is built anew has other joints along the tubes; its model is the same
    moves = sag_moves(knots, sites, members, stiffness)
    sag, at = worst_of(moves, knots.points)
    assert sag == pytest.approx(size.max(), rel=0.02)
    assert np.linalg.norm(at - beams.joints[size.argmax()]) < 10.0
    moves = sag_moves(knots, sites, members, stiffness, step_radii=1.5)
    again, there = worst_of(moves, knots.points)
    assert again == pytest.approx(size.max(), rel=1e-9)
    assert (there == beams.joints[size.argmax()]).all()
    assert sag < 0.2


def test_the_comparison_sees_a_wrong_section() -> None:
    joints = np.array([[0.0, 0, 0], [50, 0, 0], [50, 0, 30]])
    ends = np.array([[0, 1], [1, 2]])
    beams = round_beams(joints, ends, np.array([1.5, 1.5]))
    wrong = Beams(joints, ends, beams.area, beams.inertia, beams.twist * 1.001)
    own = deflect(beams, np.array([0]))
    other = by_pynite(wrong, np.array([0]), DOWN)
    assert np.abs(own - other).max() > 10 * AGREE * np.linalg.norm(other, axis=1).max()


# Members: how they meet their tubes, and what is in their way.


def test_clear_by_exactly_the_clearance() -> None:
    straight = np.column_stack([np.linspace(-60, 60, 121), np.zeros(121), np.zeros(121)])
    back = straight[::-1] + [0.0, 60.0, 0.0]
    own = knots(np.concatenate([straight, back]), ring(8.0, 400.0))
    obstacles = Obstacles(own, sites_of(own), 0.4)
    far = replace(one([-5, 0, 0], [5, 0, 0], 1.0), first=np.array([len(obstacles.sites.knot) - 1]))
    far = replace(far, second=far.first)
    gap = RADIUS + 1.0 + 0.4 + obstacles.slack
    for off, free in ((gap * 1.001, True), (gap * 0.999, False)):
        shift = np.array([[0.0, 0.0, off]])
        moved = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(moved)[0] == free
    # a post's foot is wider
    root = RADIUS + ROOT_SHARE * 1.0 + 0.4 + obstacles.slack
    for off, free in ((root * 1.001, True), (root * 0.999, False)):
        post = one([0.2, -30, off], [0.2, -off, 0], 1.0, ground=True)  # a sample's x
        post = replace(post, first=far.first)
        assert obstacles.clear(post)[0] == free
    # and members keep clear of each other, but for one that is named
    obstacles.add(replace(far, start=far.start + [0, 0, 50], end=far.end + [0, 0, 50]))
    for off, free in ((2.4 * 1.001, True), (2.4 * 0.999, False)):
        shift = np.array([[0.0, 0.0, 50 + off]])
        beside = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(beside)[0] == free
        assert obstacles.clear(beside, but=0)[0]


def test_long_members_meet_few_points_beside_those_that_they_come_near() -> None:
    rng = np.random.default_rng(3)
    curves = [ring(r, z, 40 * int(r)) for z in (-20.0, 20.0) for r in (20.0, 45.0, 70.0)]
    thin = Knots(tuple(map(Knot, curves)), 0.8)
    obstacles = Obstacles(thin, sites_of(thin), 0.4)
    start, end = rng.uniform(-80.0, 80.0, (2, 60, 3))
    end[::10] = start[::10] + [0.0, 1e4, 0.0]  # threads
    none = np.full(60, GROUND)
    some, reach = Candidates(none, none, start, end, np.ones(60)), rng.uniform(1.0, 4.0, 60)
    i, j = obstacles._near(some, reach)
    every = np.repeat(np.arange(60), len(obstacles.points)), np.tile(obstacles.points, (60, 1))
    unit = (end - start) / some.length_mm[:, None]
    to = every[1] - start[every[0]]
    along = np.clip((to * unit[every[0]]).sum(1), 0.0, some.length_mm[every[0]])
    apart = np.linalg.norm(to - along[:, None] * unit[every[0]], axis=1).reshape(60, -1)
    met = np.zeros_like(apart, dtype=bool)
    met[i, j] = True
    assert met[apart <= reach[:, None]].all()
    assert (apart[met] <= 2 * np.repeat(reach, met.sum(1))).all()
    assert len(i) < 3 * met.sum()


def test_a_strand_that_runs_along_its_own_strut_is_in_the_way() -> None:
    """A strand with 0.2 mm of air where 0.4 are wanted once passed as a part of the joint."""

    def arc(x: float, y: float, start: float, end: float) -> np.ndarray:
        t = np.linspace(start, end, 20)[1:]
        return np.column_stack([x + 2.2 * np.cos(t), y + 2.2 * np.sin(t)])

    right = np.pi / 2
    beside = np.concatenate([arc(1.0, 2.2, -right, 0.0), arc(5.4, 2.7, 2 * right, right)])
    for way, free in ((beside, False), (np.array([[20.0, 0.0], [60.0, 0.0]]), True)):
        corners = np.concatenate([[[-60.0, 0.0], [0.0, 0.0]], way, [[80.0, 4.9], [80.0, -60.0]]])
        corners = np.concatenate([corners, [[-60.0, -60.0]]])
        steps = np.linalg.norm(np.diff(corners, axis=0, append=corners[:1]), axis=1)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        closed = np.concatenate([corners, corners[:1]])
        even = np.arange(0.0, at[-1], 0.25)
        line = np.column_stack([np.interp(even, at, closed[:, k]) for k in (0, 1)])
        own = knots(np.column_stack([line, np.zeros(len(line))]), ring(8.0, 400.0))
        sites = sites_of(own, also={0: np.array([240])})
        joint = int(np.flatnonzero((sites.knot == 0) & (sites.vertex == 240))[0])
        far = len(sites.knot) - 1
        assert sites.point[joint] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        strut = replace(
            one([0, 0, 0], [0, 40, 0], 1.0), first=np.array([joint]), second=np.array([far])
        )
        assert Obstacles(own, sites, 0.4).clear(strut)[0] == free
        assert len(Obstacles(own, sites, 0.4).clear(strut.take([]))) == 0


def test_struts_meet_their_tubes_squarely() -> None:
    own = knots(ring(50.0, wave=0.0), ring(30.0, wave=0.0))
    sites = sites_of(own)
    n = len(sites.knot)
    pairs = np.column_stack([np.repeat(np.arange(n), n), np.tile(np.arange(n), n)])
    found = list_struts(sites, pairs, RADIUS, 1.5)
    along = (found.end - found.start) / found.length_mm[:, None]
    for end in (found.first, found.second):
        cosine = np.abs((along * sites.tangent[end]).sum(axis=1))
        assert len(cosine) and cosine.max() <= np.sqrt(1 - 0.65**2) + 1e-12
    assert found.length_mm.min() >= 2.5 * RADIUS and (found.radius == 1.5).all()


def test_members_can_be_thickened_and_joined() -> None:
    two = join_members(
        [no_members(), one([0, 0, 0], [3, 4, 0], 1.0), one([0, 0, 0], [0, 0, 2], 1.9)]
    )
    assert two.length_mm == pytest.approx([5.0, 2.0])
    assert two.thicken(1.2, 1.95).radius == pytest.approx([1.2, 1.95])
    assert two.thicken(1.2, 1.5).radius == pytest.approx([1.2, 1.9])  # never thinner
    assert two.with_radius(0, 1.7).radius == pytest.approx([1.7, 1.9])
