"""Hangers: an eyelet straight above the centre of mass holds every knot and touches nothing else."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from pieces import EMPTY, PLA, RADIUS, camera, knots, one, ring
from tables import some

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.measures import segment_distance
from knotfab.geometry.tube import as_manifold, as_mesh, sweep
from knotfab.hold.beams import hold_by_threads, piece_frame, springs_of
from knotfab.hold.eyelet import Bed, Eyelet, has_room, meet_well
from knotfab.hold.hang import (
    LEAST_SPAN_MM,
    MOST_POSTS,
    SPANS,
    TURN_LOSS,
    Hanger,
    HangMount,
    begin_hang,
    hang_bodies,
    hang_fixtures,
    let_swing,
    lost_by_turning,
)
from knotfab.hold.planner import MOST, Planned, _Plan, plan_members
from knotfab.hold.plinth import Masses
from knotfab.hold.shade import MountShadows
from knotfab.hold.space_frame import assemble_frame, round_beams
from knotfab.hold.stand import masses_of
from knotfab.hold.struts import GROUND, Candidates, Obstacles, join_members, no_members, sites_of
from knotfab.knots import Knot, Knots
from knotfab.render.silhouette import cast, frame_of
from knotfab.scene.camera import Camera
from knotfab_fixtures.holders import eyelet
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.standing import check_level

pytestmark = pytest.mark.slow

UP = np.array([0.0, 1.0, 0.0])
ONE = knots(ring(50.0, n=240, wave=15.0))
# a lopsided second knot moves the centre of mass aside
HIGH, LIMP = knots(ring(50.0, n=400, wave=30.0)), replace(PLA, max_sag_mm=5.0)
TWO = knots(*(k.points for k in ONE.knots), ring(12.0, 5.0, 80, 4.0) + [20.0, 0.0, 0.0])


@cache
def plan(two: bool, threads: int) -> HangMount:
    """One view hangs on two threads, several on one."""
    views = [camera(), camera(azimuth_deg=90.0)][: 3 - threads]
    return begin_hang(TWO if two else ONE, views, [EMPTY] * len(views), 0.4, PLA, 0.8).plan_best()


@cache
def part(two: bool, threads: int) -> Mesh:
    tubes = [sweep(k.points, RADIUS, 24) for k in (TWO if two else ONE).knots]
    (body,) = hang_bodies(tubes, plan(two, threads))  # it checks the genus
    return Mesh(*body)


@pytest.mark.parametrize(
    ("two", "threads"), some([(True, 2), (True, 1), (False, 2), (False, 1)], 3)
)
def test_the_part_hangs_level_as_another_library_weighs_it(two: bool, threads: int) -> None:
    mount, mesh = plan(two, threads), part(two, threads)
    assert set(mount.holds) == set(range(2 if two else 1)) and len(mount.holds) == len(
        mount.members
    )
    assert len(mount.threads) == len(mount.eyelets) == threads
    assert threads <= (mount.members.second == GROUND).sum() <= MOST_POSTS * threads
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    off = mount.threads - other.center_mass
    assert (off[:, 1] > 5.0).all()
    mean = off.mean(axis=0)  # the view is from the front: both threads stand at its sides
    assert np.degrees(np.arctan2(np.hypot(mean[0], mean[2]), mean[1])) < 1.0
    if threads == 2:
        right = np.array([1.0, 0.0, 0.0])
        assert np.ptp(mount.threads @ right) >= LEAST_SPAN_MM and np.ptp(mount.threads[:, 2]) < 0.1
    found = check_level(mesh, mount.threads, UP)
    assert found.status == "pass" and found.measured < 1.0


def gaps(some: Candidates, others: Candidates) -> Array:
    """How much air is between any two of them, (n, m) mm."""
    i, j = np.divmod(np.arange(len(some) * len(others)), len(others))
    apart = segment_distance(some.start[i], some.end[i], others.start[j], others.end[j])
    return (apart - some.radius[i] - others.radius[j]).reshape(len(some), -1)


@pytest.mark.parametrize(("two", "threads"), [(True, 2), (True, 1)])
def test_what_meets_at_no_common_end_is_apart(two: bool, threads: int) -> None:
    """An eyelet that was moved above the centre of mass once met a strut."""
    mount = plan(two, threads)
    members = mount.members
    for n, eye in enumerate(mount.eyelets):
        at = eye.outline(96)
        ground = np.full(96, GROUND)
        wire = Candidates(ground, ground, at, np.roll(at, -1, axis=0), np.full(96, eye.wire_mm))
        own = np.linalg.norm(members.end - eye.middle, axis=1) < eye.ring_mm + 0.1
        assert own.any(), n
        assert gaps(members.take(~own), wire).min(initial=np.inf) >= 0.4 - 0.01
    ends = np.stack([members.start, members.end], axis=1)
    between = np.linalg.norm(ends[:, None, :, None] - ends[None, :, None], axis=4)
    apart = between.min(axis=(2, 3)) > 0.1
    assert gaps(members, members)[apart].min(initial=np.inf) >= 0.4 - 1e-6


@pytest.mark.parametrize(
    ("off", "along", "free"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), False),  # through the hole
        ((1.2, 0.0, 0.0), (0.0, 0.0, 1.0), False),
        ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), False),  # across it
        ((0.0, 0.0, 2.1), (1.0, 1.0, 0.0), False),  # before its face
        ((0.0, 0.0, 2.3), (1.0, 1.0, 0.0), True),
        ((4.6, 0.0, 0.0), (0.0, 1.0, 0.0), False),  # beside its rim
        ((4.8, 0.0, 0.0), (0.0, 1.0, 0.0), True),
    ],
)
def test_a_ring_has_room_where_no_member_is_near_it(
    off: tuple[float, ...], along: tuple[float, ...], free: bool
) -> None:
    way, eye = Obstacles(ONE, sites_of(ONE), 0.4), Eyelet(np.zeros(3), np.eye(3)[2], 2.5, 0.9)
    assert has_room(way, eye)[0]
    middle, half = np.array(off), 20.0 * np.array(along)
    way.add(one(middle - half, middle + half, 0.9))
    assert has_room(way, eye)[0] == free


def test_members_are_thickened_no_nearer_to_bodies_that_are_none() -> None:
    """Such bodies, as eyelets are, were once forgotten when the first member was thickened."""
    mount, sites = plan(True, 1), sites_of(TWO)
    given = replace(mount.members, radius=np.full(2, 0.8))  # a strut and a post
    aside = (2 * 0.8 + 0.4 + 0.05) * UP
    beside = given.take([0])
    beside = replace(beside, start=beside.start + aside, end=beside.end + aside)
    for kept in (no_members(), beside):
        way, shadows = Obstacles(TWO, sites, 0.4), MountShadows(TWO, [camera()], [EMPTY])
        way.add(join_members([given, kept]))
        none, firm = np.zeros(0, dtype=bool), replace(PLA, max_sag_mm=1e-4)
        found = plan_members(TWO, sites, way, shadows, no_members(), none, given, firm).members
        assert (found.radius > 0.85).tolist() == [len(kept) == 0, True]
        assert np.array_equal(way.members.radius[2:], kept.radius)


def test_several_views_hang_on_two_threads_where_a_turn_costs_their_pictures() -> None:
    def lost(piece: Knots, views: list[Camera]) -> float:
        return lost_by_turning(piece, views, [shadow_of(piece, view) for view in views])

    views = [camera(), camera(azimuth_deg=90.0)]
    assert lost(ONE, views) > TURN_LOSS > lost(ONE, views[:1]) >= 0  # from its side a ring is a rod
    upright = knots(ring(4.0, n=60) * [1.0, 12.0, 1.0])
    assert lost(upright, views) < TURN_LOSS
    assert lost_by_turning(ONE, views, [EMPTY, EMPTY]) == 0
    shadows = [shadow_of(ONE, view) for view in views]
    assert len(begin_hang(ONE, views, shadows, 0.4, PLA, 0.8).plan_best().eyelets) == 2


@pytest.mark.parametrize(
    ("crossing", "taken"), [((0.004, 0.0), 1), ((0.004, 0.002), 1), ((0.0,), 0)]
)
def test_of_pairs_that_hold_two_pictures_one_is_taken_that_crosses_none(
    crossing: tuple[float, ...], taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or the one that crosses least; pairs after one that crosses none are not planned."""
    views = [camera(), camera(azimuth_deg=90.0)]
    shadows = [shadow_of(ONE, view) for view in views]
    made = plan(False, 1)
    planned: list[HangMount] = []

    def stand_in(_: object, offsets: Array) -> HangMount:
        share = crossing[len(planned)] if len(offsets) == 2 else 0.01
        planned.append(replace(made, sag_mm=0.0, predicted_intrusion=np.array([0.0, share])))
        return planned[-1]

    monkeypatch.setattr(Hanger, "plan", stand_in)
    monkeypatch.setattr(Hanger, "list_pairs", lambda *_: [np.zeros((2, 3))] * len(crossing))
    assert begin_hang(ONE, views, shadows, 0.4, PLA, 0.8).plan_best() is planned[taken]
    assert len(planned) == len(crossing) + 1


@pytest.mark.parametrize(("low", "high"), some([(16.0, 34.0), (30.0, 46.0), (0.0, 0.0)], 2))
def test_a_single_eyelet_goes_where_it_crosses_no_picture(
    low: float, high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a picture leaves no such place, it darkens least, and what it darkens is told."""
    monkeypatch.setattr("knotfab.hold.hang.TURN_LOSS", 2.0)
    views = [camera(), camera(azimuth_deg=90.0)]
    top, foot = views[0].project(np.array([[0.0, high, 0.0], [0.0, low, 0.0]]))[:, 1]
    rows = np.arange(views[0].height)
    band = np.repeat(((rows > top) & (rows < foot))[:, None], views[0].width, axis=1)
    soft = replace(PLA, max_sag_mm=100.0)
    mount = begin_hang(ONE, views, [band, ~EMPTY], 0.4, soft, 0.8).plan_best()
    assert len(mount.eyelets) == 1 and mount.predicted_intrusion[1] < 1e-4
    assert (mount.predicted_intrusion[0] < 1e-4) == (high > low)


def shadow_of(piece: Knots, view: Camera) -> Mask:
    ahead = piece.points[piece.rings.next]
    frame = frame_of(view, np.float32, stretched=True)
    return cast(piece.points, ahead, frame, piece.radius_mm)


@pytest.mark.parametrize("threads", some([2, 1], 2))
def test_a_thread_elsewhere_is_rejected(threads: int) -> None:
    mount, mesh = plan(True, threads), part(True, threads)
    for aside in (5.0 * UP, -3.0 * UP, np.array([8.0, 0.0, 0.0])):
        for k in range(threads):
            moved = mount.threads.copy()
            moved[k] += aside
            found = check_level(mesh, moved, UP)
            assert (found.status, found.required) == ("fail", True)


def test_a_slack_thread_is_told() -> None:
    # far to one side, so that it is all the weight
    heavy, other = sweep(ring(30.0, wave=0.0), 8.0, 24)
    line = sweep(ring(40.0, wave=0.0), RADIUS, 24)
    solid = as_manifold(line) + as_manifold((heavy + [60.0, 0.0, 0.0], other))
    top = np.array([[np.sin(t), np.cos(t), 0.0] for t in (-0.6, 0.6)]) * (40.0 - RADIUS)
    told = check_level(Mesh(*as_mesh(solid)), top, UP)
    assert told.status == "fail" and "of the weight" in told.detail


def test_a_weight_at_one_side_hangs_askew() -> None:
    vertices, faces = sweep(ring(30.0, wave=0.0), RADIUS, 24)  # upright, in the plane of x and y
    top = (30.0 - RADIUS) * UP
    assert check_level(Mesh(vertices, faces), top[None], UP).measured == pytest.approx(
        0.0, abs=0.01
    )
    turn = np.radians(4.0)
    askew = (30.0 - RADIUS) * np.array([np.sin(turn), np.cos(turn), 0.0])
    found = check_level(Mesh(vertices, faces), askew[None], UP)
    assert found.status == "fail" and found.measured == pytest.approx(4.0, abs=0.05)


def test_a_rigid_turn_about_the_threads_is_no_sag() -> None:
    points, down = ONE.points, np.array([0.0, -0.1, 0.0])
    one, two = np.array([[0.0, 60.0, 0.0]]), np.array([[-30.0, 60.0, 0.0], [30.0, 60.0, 0.0]])
    for threads, turn in ((one, [1e-3, 0.0, -2e-3]), (two, [1e-3, 0.0, 0.0])):
        turned = np.cross(turn, points - threads.mean(axis=0))
        assert np.abs(let_swing(points, turned, threads)).max() < 1e-12
        drop = np.tile(down, (len(points), 1))
        assert let_swing(points, drop, threads) == pytest.approx(drop)
    aside = np.tile([0.1, 0.0, 0.0], (len(points), 1))  # two threads keep it from turning so
    assert let_swing(points, aside, two) == pytest.approx(aside)


def test_a_bar_on_two_threads_sags_as_one_on_two_supports_whatever_its_direction() -> None:
    span, radius, n = 100.0, 1.0, 21
    along = np.array([[x, 0.0, 0.0] for x in np.linspace(0.0, span, n)])
    feet = along[[0, -1]] + 5.0 * UP
    for turn in (0.0, 0.4, 1.2):
        way = np.array(
            [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        )
        joints = np.concatenate([along, feet, feet]) @ way.T  # two posts meet at each foot
        ends = [
            *([k, k + 1] for k in range(n - 1)), [0, n], [n - 1, n + 1], [1, n + 2], [n - 2, n + 3],
        ]  # fmt: skip
        thick = np.append(np.full(n - 1, radius), np.full(4, 1e-2 * radius))
        thick[-4:-2] = 5 * radius
        beams = round_beams(joints, np.array(ends), thick)
        feet_at = np.arange(n, n + 4)
        own, held = hold_by_threads(beams, feet_at)
        frame = assemble_frame(own, feet_at, PLA.young_mpa, PLA.density_g_cm3, -UP, held)
        weight = np.pi * radius**2 * PLA.density_g_cm3 * 1e-6 * 9.81
        wanted = 5 / 384 * weight * span**4 / (PLA.young_mpa * np.pi / 4 * radius**4)
        moves = frame.displacements()[:n]
        assert moves[0, 1] - moves[n // 2, 1] == pytest.approx(wanted, rel=0.02)


def test_members_of_a_solved_piece_on_threads_are_those_of_one_solved_anew() -> None:
    mount, sites = plan(True, 2), sites_of(TWO)
    threads = mount.threads
    given = join_members([mount.struts.take([0]), mount.posts])
    held = piece_frame(TWO, sites, given, PLA, hold_by_threads)
    thick = given.thicken(1.3, 0.95 * RADIUS)
    changed = np.flatnonzero(thick.radius > given.radius)
    some, before = thick.take(changed), given.radius[changed]
    assert (some.second == GROUND).sum() >= 2
    held.hold(some, *springs_of(some, before, PLA))
    found = held.displacements()[: len(sites.knot)]
    anew = piece_frame(TWO, sites, thick, PLA, hold_by_threads).frame.displacements()
    anew = anew[: len(sites.knot)]
    assert found == pytest.approx(anew, abs=1e-7 * np.abs(anew).max())
    # it swings as a whole: what members feel stays as it was
    free = let_swing(sites.point, found, threads)
    assert free[:, :3] == pytest.approx(let_swing(sites.point, found[:, :3], threads))
    turn = free[:, 3:] - found[:, 3:]
    assert np.ptp(turn, axis=0) == pytest.approx(0.0, abs=1e-12)
    way = np.cross(turn, sites.point - threads.mean(axis=0))
    assert free[:, :3] - found[:, :3] == pytest.approx(way)


@pytest.mark.parametrize(("most_mm", "rounds"), some([(1e-3, 2), (0.03, 4)], 2))
def test_a_piece_that_no_struts_make_stiff_is_planned_a_few_times_and_told(
    most_mm: float, rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thin long tube: each pair of eyelets was once planned four times, with ever more struts."""
    thin = Knots(tuple(Knot(ring(r, 0.0, 160, 15.0)) for r in (50.0, 38.0)), 0.8)
    begun, changes = list[int](), list[int]()

    def count(*args: Any, **keys: Any) -> Planned:
        changes.append(0)
        begun.append(len(keys["begun"]))
        return plan_members(*args, **keys)

    def change(*args: Any) -> Any:
        changes[-1] += 1
        return find_change(*args)

    find_change = _Plan.find_change
    monkeypatch.setattr("knotfab.hold.hang.plan_members", count)
    monkeypatch.setattr(_Plan, "find_change", change)
    mount = begin_hang(
        thin, [camera()], [EMPTY], 0.4, replace(PLA, max_sag_mm=most_mm), 0.4
    ).plan_best()
    assert mount.sag_mm > most_mm or rounds > 2
    assert 0 < len(changes) <= rounds * (1 + len(SPANS)) and max(changes) <= MOST + 1
    # a plan begun with what an earlier one took has few changes left
    first, again = (
        [c for c, b in zip(changes, begun, strict=True) if (b > 0) == k] for k in (0, 1)
    )
    assert max(again, default=0) < max(first)


def bed(strands: Knots, free_mm: float = 0.0) -> Bed:
    """A bed for strands, at each place of which so much stands free below."""
    places = strands.points
    return Bed(np.eye(3)[2], 2300.0, RADIUS, (), places, np.full(len(places), free_mm))


@cache
def standing() -> HangMount:
    return begin_hang(HIGH, [camera()], [EMPTY], 0.4, LIMP, 0.8, bed=bed(HIGH)).plan_best()


def test_what_prints_without_supports_hangs_by_rings_on_posts_that_rise() -> None:
    mount = standing()
    rise = (mount.members.end - mount.members.start)[:, 2] / mount.members.length_mm
    assert np.abs(rise).min() >= np.sin(np.radians(45.0))  # from the bed
    assert len(mount.posts) and rise[mount.members.second == GROUND].min() > 0
    weighed = sum(np.array(m.volume) @ m.center for m in masses(mount))
    middle = weighed / sum(m.volume.sum() for m in masses(mount))
    for eye in mount.eyelets:
        feet = mount.posts.end[
            np.linalg.norm(mount.posts.end - eye.middle, axis=1) < 2 * eye.ring_mm
        ]
        assert len(feet) and np.allclose(feet, eye.middle - eye.ring_mm * np.eye(3)[2])
        assert eye.middle[2] == pytest.approx(middle[2], abs=0.05)  # over the bed as the mass
        assert abs(eye.through[2]) < 1e-9  # it stands, and its hole is a bridge of 3 mm


def masses(mount: HangMount) -> list[Masses]:
    return [masses_of(HIGH, mount.members), *(eye.masses for eye in mount.eyelets)]


def test_a_ring_flat_on_the_bed_lets_the_piece_tip() -> None:
    """So none is built there. The validators reject it, and pass rings on posts."""
    mount = standing()
    (body,) = hang_bodies([sweep(k.points, RADIUS, 24) for k in HIGH.knots], mount)
    assert check_level(Mesh(*body), mount.threads, UP).status == "pass"
    tube = as_manifold(sweep(HIGH.points, RADIUS, 24))
    at = (
        HIGH.points[HIGH.points[:, 2].argmin()] + 2.0 * UP
    )  # on a foot; below the mass it tips over
    flat = Eyelet(at + [0, 0, 0.5], np.eye(3)[2], 2.5, 1.0)
    (fixture,) = hang_fixtures(replace(mount, members=no_members(), eyelets=(flat,)))
    found = check_level(Mesh(*as_mesh(tube + fixture.solid())), flat.thread[None], UP)
    assert found.status == "fail" and isinstance(found.measured, float) and found.measured > 20.0


@pytest.mark.parametrize(
    ("end", "radius", "ground", "free_mm", "stands"),
    [
        ((0.0, 0.0, 20.0), 1.5, True, 0.0, True),
        ((0.0, 19.0, 20.0), 1.5, True, 0.0, True),
        ((0.0, 21.0, 20.0), 1.5, True, 0.0, False),  # too flat
        ((0.0, 0.0, -20.0), 1.5, True, 0.0, False),  # a post that hangs from its strand
        ((0.0, 0.0, -20.0), 1.5, False, 0.0, True),  # a strut rises from its other end
        ((0.0, 0.0, 20.0), 0.8, True, 0.0, False),  # it would sway while it prints
        ((0.0, 0.0, 20.0), 1.5, True, 60.0, False),  # so would the leg with it
        ((0.0, 0.0, 60.0), 1.5, False, 0.0, False),
    ],
)
def test_members_rise_steeply_and_stand_firm(
    end: tuple[float, ...], radius: float, ground: bool, free_mm: float, stands: bool
) -> None:
    member = one((0.0, 0.0, 0.0), end, radius, ground)
    assert bed(HIGH, free_mm).carries(member).tolist() == [stands]


def test_loose_pieces_that_no_rising_strut_joins_are_told() -> None:
    flat = knots(ring(40.0, wave=0.5), ring(20.0, wave=0.5))
    with pytest.raises(SceneError, match="no strut rises from one knot to the next"):
        begin_hang(flat, [camera()], [EMPTY], 0.4, PLA, 0.8, bed=bed(flat)).plan_best()


def test_a_strand_above_the_centre_leaves_no_way_for_a_thread() -> None:
    arc = np.linspace(-90.0, 90.0, 160)
    roof = np.column_stack([arc, np.full(160, 75.0), np.zeros(160)])
    back = np.column_stack([arc[::-1], np.full(160, 68.0), np.full(160, 1.0)])
    mount = begin_hang(
        knots(ONE.knots[0].points, np.vstack([roof, back])), [camera()], [EMPTY], 0.4, PLA, 0.8
    ).plan_best()
    assert (mount.threads[:, 1] > 75.0).all()
    with pytest.raises(SceneError, match="hanger"):  # nothing is ever so far from all strands
        begin_hang(ONE, [camera()], [EMPTY], 90.0, PLA, 0.8).plan_best()


@pytest.mark.parametrize(
    ("comes_from", "ends_at", "clear"),
    {
        "its middle's far side": ((0.0, -30.0, 0.0), -2.5, True),
        "beside it": ((0.0, -20.0, 20.0), -2.5, True),
        "through its hole": ((0.0, 30.0, 0.0), -2.5, False),
        "along it": ((30.0, -4.0, 0.0), -2.5, True),
        "over its face": ((0.0, 25.0, 8.0), -2.5, False),
        "to its top, from above": ((0.0, 20.0, 20.0), 2.5, True),
        "to its top, past the thread": ((0.0, -6.0, 16.0), 2.5, False),
    }.values(),
)
def test_a_post_in_the_threads_place_or_that_parts_slowly_from_its_ring_is_refused(
    comes_from: tuple[float, ...], ends_at: float, clear: bool
) -> None:
    ring = Eyelet(np.zeros(3), np.array([0.0, 0.0, 1.0]), 2.5, 1.0)
    start, end = np.array([comes_from]), np.array([[0.0, ends_at, 0.0]])
    ground = np.array([GROUND])
    post = Candidates(ground, ground, start, end, np.array([1.0]))
    assert meet_well(post, ring, 0.4).tolist() == [clear]


@pytest.mark.parametrize("sizes", [(2.0, 0.8), (3.5, 1.2)])
def test_an_eyelet_is_a_torus(sizes: tuple[float, float]) -> None:
    vertices, faces = eyelet(*sizes, tolerance_mm=0.005)
    ring_mm, wire_mm = sizes
    solid = trimesh.Trimesh(vertices, faces, process=False)
    assert solid.is_watertight and solid.euler_number == 0
    assert solid.volume == pytest.approx(2 * np.pi**2 * ring_mm * wire_mm**2, rel=0.02)


@pytest.mark.parametrize("sizes", [(0.8, 0.8), (1.0, 2.0), (0.0, 0.5), (np.nan, 0.5)])
def test_a_ring_without_a_hole_is_refused(sizes: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="eyelet"):
        eyelet(*sizes)
