"""Wall mounts: pegs stay in the tube's shadow, touch nothing else, and hold what they must."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from knotfab.errors import SceneError
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.knots import Knot, Knots
from knotfab.mount.choose import choose_pegs
from knotfab.mount.mount import mount_piece
from knotfab.mount.piece_frame import Stiffness, sag_of
from knotfab.mount.rays import Rays, free_rays
from knotfab.mount.wall import Peg, WallSettings, plan_wall, wall_bodies
from knotfab.mount.wall_brace import pegs_on, sites_with
from knotfab.part.clean import clean_body
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Mount, Printer, ResolvedView, Scene

RADIUS = 2.0
PLATE = WallSettings("plate", 3.0, 8.0, 4.0, 10.0)
DOWEL = WallSettings("dowel", 3.0, 8.0, 4.0, 10.0)
PLA = Stiffness(2300.0, 1.24, 0.2)


def ring(radius: float, z: float = 0.0, n: int = 200, wave: float = 8.0) -> np.ndarray:
    """A closed curve that goes round and up and down: no plane holds it."""
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), z + wave * np.sin(3 * t)])


def knots(*curves: np.ndarray) -> Knots:
    return Knots(tuple(Knot(c) for c in curves), RADIUS)


def camera(tilt: float = 0.0, **keys: float) -> Camera:
    view = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0, wall_tilt_deg=tilt, **keys)
    return camera_of(view, 90, 90)


ONE = knots(ring(50.0))
TWO = knots(ring(50.0), ring(25.0, 10.0))


def to_segments(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """(n,) distance of points from a closed polyline, by brute force."""
    start, edge = curve, np.roll(curve, -1, axis=0) - curve
    offset = points[:, None] - start[None]
    t = np.clip((offset * edge).sum(2) / (edge * edge).sum(1), 0, 1)
    return np.linalg.norm(offset - t[..., None] * edge, axis=2).min(axis=1)


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_rays_end_on_the_wall_and_come_from_the_light(tilt: float) -> None:
    view = camera(tilt)
    rays = free_rays(TWO, view.eye, view.receiver, 0.9, 0.4)
    assert rays.free.any()
    height = rays.foot @ view.receiver[:3] + view.receiver[3]
    assert np.abs(height).max() < 1e-9
    one, other = rays.top - view.eye, rays.foot - view.eye
    assert np.linalg.norm(np.cross(one, other), axis=1).max() < 1e-6 * 500 * 600
    assert (rays.length_mm > 0).all()


def test_free_means_that_no_other_strand_is_near_the_peg() -> None:
    """Against brute force: points all along each free peg keep their distance from the other knot."""
    view, share, gap = camera(), 0.9, 0.4
    near, far = ring(50.0, 30.0, wave=0.0), ring(50.5, -20.0, wave=12.0)
    far = far[:, [1, 0, 2]]
    piece = knots(near, far)
    rays = free_rays(piece, view.eye, view.receiver, share, gap)
    assert rays.free[rays.knot == 0].any() and not rays.free[rays.knot == 0].all()
    along = np.linspace(0, 1, 120)[:, None]
    for ray in np.flatnonzero(rays.knot == 0)[::5]:
        line = rays.top[ray] + along * (rays.foot[ray] - rays.top[ray])
        spread = np.linalg.norm(line - view.eye, axis=1) / np.linalg.norm(rays.top[ray] - view.eye)
        clear = to_segments(line, far) - RADIUS - share * RADIUS * spread
        if rays.free[ray]:
            assert clear.min() >= gap - 1e-6
        elif clear.min() > gap + 0.3:  # sampling may cost a little, no more
            sine = np.linalg.norm(
                np.cross(rays.tangent[ray], rays.foot[ray] - rays.top[ray]) / rays.length_mm[ray]
            )
            own = to_segments(line[30:], near) - RADIUS - share * RADIUS * spread[30:]
            assert sine < 0.6 or own.min() < gap + 0.3


@pytest.mark.parametrize(("opening", "free"), [(0.8, True), (0.4, False)])
def test_a_strand_must_leave_its_own_peg_at_once(opening: float, free: bool) -> None:
    """A wheel's strand crept away from its peg within the joint: a gap that the printer would close."""
    view = camera()
    fall = np.array([opening, 0.0, -np.sqrt(1 - opening**2)])
    bend = np.array([1.9 * RADIUS, 0.0, 0.0])  # from here on it runs along with the peg
    corners = [-20 * RADIUS * np.array([1.0, 0, 0]), bend, bend + 6 * RADIUS * fall]
    corners += [
        np.array([40.0, 0.0, 0.0]),
        np.array([40.0, 0.0, 60.0]),
        np.array([-40.0, 0.0, 60.0]),
    ]
    closed = np.array([*corners, corners[0]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.union1d(np.arange(0.0, arc[-1], 0.5), arc[:-1])
    curve = np.column_stack([np.interp(at, arc, closed[:, k]) for k in range(3)])
    rays = free_rays(knots(curve), view.eye, view.receiver, 0.9, 0.4)
    middle = int(np.linalg.norm(rays.top, axis=1).argmin())
    assert np.linalg.norm(rays.top[middle]) < 0.3 and rays.free[middle] == free


def test_a_peg_thicker_than_the_shadow_is_refused() -> None:
    view = camera()
    for share in (0.0, 1.01, float("nan")):
        with pytest.raises(ValueError, match="does not hide"):
            free_rays(ONE, view.eye, view.receiver, share, 0.4)


def sag_on(
    rays: Rays, chosen: np.ndarray, top: float, foot: np.ndarray, stiffness: Stiffness
) -> tuple[float, np.ndarray]:
    """What `ONE` sags on the pegs of some rays."""
    sites = sites_with(ONE, rays, chosen)
    return sag_of(ONE, sites, pegs_on(sites, rays, chosen, top), stiffness, foot[chosen])


def test_pegs_are_added_until_the_sag_is_small_and_none_is_idle() -> None:
    view = camera()
    rays = free_rays(ONE, view.eye, view.receiver, 0.9, 0.4)
    foot = np.full(len(rays.top), 0.9 * RADIUS * 1.2)
    soft = Stiffness(400.0, 1.24, 0.2)
    chosen = choose_pegs(ONE, rays, 0.9 * RADIUS, foot, soft)
    assert chosen.sag_mm <= 0.2 and len(chosen.rays) > 1
    again, _ = sag_on(rays, chosen.rays, 0.9 * RADIUS, foot, soft)
    assert again == pytest.approx(chosen.sag_mm, rel=0.02)  # other joints, same frame
    for peg in chosen.rays[1:]:
        left = chosen.rays[chosen.rays != peg]
        assert sag_on(rays, left, 0.9 * RADIUS, foot, soft)[0] > 0.19
    stiff = choose_pegs(ONE, rays, 0.9 * RADIUS, foot, PLA)
    assert len(stiff.rays) <= len(chosen.rays)


def test_more_pegs_sag_less_and_a_softer_material_more() -> None:
    view = camera()
    rays = free_rays(ONE, view.eye, view.receiver, 0.9, 0.4)
    foot = np.full(len(rays.top), 2.0)
    free = np.flatnonzero(rays.free)
    some = free[:: len(free) // 4][:4]
    sags = [sag_on(rays, some[: n + 1], 1.8, foot, PLA)[0] for n in range(4)]
    assert all(b <= a + 1e-12 for a, b in pairwise(sags))
    soft, _ = sag_on(rays, some, 1.8, foot, Stiffness(1150.0, 1.24, 0.2))
    assert soft == pytest.approx(2 * sags[-1], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.0, 15.0])
@pytest.mark.parametrize("settings", [PLATE, DOWEL], ids=["plate", "dowel"])
def test_the_bodies_are_what_the_pegs_predict(settings: WallSettings, tilt: float) -> None:
    from manifold3d import Manifold, Mesh64

    view = camera(tilt)
    tubes = [sweep(k.points, RADIUS, 16) for k in TWO.knots]
    mount = plan_wall(TWO, view, 0.4, PLA, settings)
    assert {peg.knot for peg in mount.pegs} == {0, 1}
    bodies = wall_bodies(tubes, mount, view)
    assert len(bodies) == (1 if settings is PLATE else 2)
    for vertices, faces in bodies:
        solid = Manifold(Mesh64(np.ascontiguousarray(vertices), faces.astype(np.uint64)))
        assert solid.genus() == (len(mount.pegs) + 2 if settings is PLATE else 1)
        assert mesh_volume(vertices, faces) > sum(mesh_volume(*t) for t in tubes) * 0.3
        height = vertices @ view.receiver[:3] + view.receiver[3]
        deepest = 3.0 if settings is PLATE else 10.0
        assert height.min() == pytest.approx(-deepest, abs=1e-6)


def test_pegs_lie_in_the_shadow_of_their_tube() -> None:
    """Every corner of a mount in front of the wall is on a ray through the tube."""
    view = camera()
    mount = plan_wall(ONE, view, 0.4, PLA, DOWEL)
    vertices = wall_bodies([sweep(ONE.points, RADIUS, 64)], mount, view)[0][0]
    before = vertices[vertices[:, 2] > -100 + 1e-3]
    unit = before - view.eye
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    dense = np.concatenate([ONE.points + s * (np.roll(ONE.points, -1, 0) - ONE.points) for s in
                            np.linspace(0, 1, 12, endpoint=False)])  # fmt: skip
    from_eye = dense - view.eye
    for chunk in np.array_split(unit, 20):
        along = chunk @ from_eye.T
        square = (from_eye**2).sum(1)[None] - along**2
        assert np.sqrt(np.maximum(square, 0)).min(axis=1).max() <= RADIUS * 1.003


def test_a_knot_without_a_free_ray_is_named() -> None:
    """Two knots behind each other, and more room asked for than there is between any of their strands."""
    view = camera()
    t = 2 * np.pi * np.arange(1200) / 1200
    spread = 40.0 + 12 * np.cos(40 * t)
    coil = np.column_stack([spread * np.cos(t), spread * np.sin(t), -30 + 0 * t])
    front = ring(38.0, 20.0, wave=0.0)
    with pytest.raises(SceneError, match=r"no light ray from knot [01]"):
        plan_wall(knots(coil, front), view, 6.0, PLA, PLATE)


def scene(**keys: object) -> Scene:
    mount = Mount(kind="wall", **keys)
    return resolve(
        Scene(views=(ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0),), mount=mount)
    )


def bar_rays() -> Knots:
    """A ring in whose shadow another lies, that leaves few rays to the wall free."""
    t = 2 * np.pi * np.arange(240) / 240
    front = np.column_stack([45 * np.cos(t), 45 * np.sin(t), np.full(240, 10.0)])
    wide = 45 * (520 / 490) * (1 - 0.35 * np.exp(-(((t - np.pi / 2) / 0.35) ** 2)))
    rear = np.column_stack([wide * np.cos(t), wide * np.sin(t), np.full(240, -20.0)])
    return knots(front, rear)


@pytest.mark.slow
def test_where_rays_are_barred_struts_hold_the_piece() -> None:
    """Struts take what pegs cannot, in the shadow of the tubes alone, and touch nothing else."""
    piece, view = bar_rays(), camera()
    firm = Stiffness(2300.0, 1.24, 0.08)
    mount = plan_wall(piece, view, 0.4, firm, PLATE)
    # the model that chose the pegs knows no struts
    assert mount.sag_mm > firm.max_sag_mm >= mount.sag_again_mm
    members = mount.struts
    assert len(members) >= 1 and len(mount.struts_of) == len(members)
    tubes = [sweep(k.points, RADIUS, 24) for k in piece.knots]
    ((vertices, faces),) = wall_bodies(tubes, mount, view)
    assert mesh_volume(vertices, faces) > 0
    strands = np.concatenate([dense(k.points) for k in piece.knots]) - view.eye
    far = np.linalg.norm(strands, axis=1)
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    for a, b, r in zip(members.start, members.end, members.radius, strict=True):
        u = np.linalg.svd((b - a)[None])[2][1:]
        rim = r * (np.cos(turn)[:, None] * u[0] + np.sin(turn)[:, None] * u[1])
        skin = a + np.linspace(0, 1, 9)[:, None, None] * (b - a) + rim - view.eye
        unit = skin.reshape(-1, 3) / np.linalg.norm(skin, axis=2).reshape(-1, 1)
        off = np.arccos(np.clip(unit @ (strands / far[:, None]).T, -1, 1))
        assert (off <= np.arcsin(RADIUS / far)).any(axis=1).all()


def dense(points: np.ndarray) -> np.ndarray:
    """A closed polyline with twenty points an edge."""
    t = np.arange(20)[:, None] / 20
    edges = np.roll(points, -1, axis=0) - points
    return (points[:, None] + t * edges[:, None]).reshape(-1, 3)


def test_more_sag_than_allowed_fails_and_says_what_would_help() -> None:
    scene = resolve(Scene(mount=Mount(kind="wall")))
    mounted = mount_piece(scene, ONE, [sweep(ONE.points, RADIUS, 16)], [camera()])
    good = mounted.check_sag()
    assert good is not None and (good["status"], good["required"]) == ("pass", True)
    assert "max_sag_mm" not in good["detail"] and mounted.wall is not None
    bad = replace(mounted, wall=replace(mounted.wall, sag_again_mm=0.314)).check_sag()
    assert bad is not None and (bad["status"], bad["measured"]) == ("fail", 0.314)
    assert "set mount.max_sag_mm to 0.32" in bad["detail"]


@pytest.mark.slow
def test_the_foot_follows_from_the_printer() -> None:
    tubes = [sweep(ONE.points, RADIUS, 12)]
    mounted = mount_piece(scene(), ONE, tubes, [camera()])
    assert mounted.scene.mount.foot == "plate" and mounted.upright is not None
    assert mounted.scene.mount.pegs == (len(mounted.wall.pegs),)  # type: ignore[union-attr]
    small = scene().model_copy(update={"printer": Printer(build_volume_mm=(195.0, 200.0, 200.0))})
    assert mount_piece(small, ONE, tubes, [camera()]).scene.mount.foot == "dowel"
    exact = scene().model_copy(update={"printer": Printer(build_volume_mm=(196.0, 196.0, 200.0))})
    assert mount_piece(exact, ONE, tubes, [camera()]).scene.mount.foot == "plate"
    report = mounted.report()
    assert report["pegs"] == len(mounted.wall.pegs)  # type: ignore[union-attr]
    sag = mounted.check_sag()
    assert sag is not None and sag["status"] == "pass" and sag["measured"] <= sag["limit"] == 0.2


def test_without_a_mount_nothing_is_added() -> None:
    tubes = [sweep(ONE.points, RADIUS, 12)]
    bare = scene().model_copy(update={"mount": Mount()})
    mounted = mount_piece(bare, ONE, tubes, [camera()])
    assert mounted.bodies is tubes and mounted.upright is None and mounted.check_sag() is None
    assert mounted.report() == {"kind": "none"}


def test_several_loose_knots_get_a_wall_mount_by_themselves() -> None:
    tubes = [sweep(k.points, RADIUS, 12) for k in TWO.knots]
    open_scene = scene().model_copy(update={"mount": Mount()})
    held = mount_piece(open_scene, TWO, tubes, [camera()])
    assert held.wall is not None and held.scene.mount.kind == "wall"
    assert len(held.scene.mount.pegs) == 2
    bare = scene().model_copy(update={"mount": Mount(kind="none")})
    assert mount_piece(bare, TWO, tubes, [camera()]).wall is None


def test_a_united_body_survives_single_precision() -> None:
    from igl import predicates

    view = camera()
    mount = plan_wall(ONE, view, 0.4, PLA, PLATE)
    vertices, faces = wall_bodies([sweep(ONE.points, RADIUS, 24)], mount, view)[0]
    body = clean_body((vertices - vertices.min(axis=0), faces))
    assert (body[0].astype(np.float32).astype(np.float64) == body[0]).all()
    _, pairs, _ = predicates.find_self_intersections(body[0], body[1].astype(np.int64))
    assert len(pairs) == 0
    assert mesh_volume(*body) == pytest.approx(mesh_volume(vertices, faces), rel=1e-4)


def test_a_peg_knows_its_length() -> None:
    peg = Peg(0, np.array([0.0, 3.0, 0.0]), np.array([4.0, 0.0, 0.0]), 1.0, 1.2, 1.3)
    assert peg.length_mm == 5.0
