"""A piece on its mount: what follows from scene and printer, what is reported and checked."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from pieces import EMPTY, RADIUS, VIEW, camera, knots, ring, setup

from knotfab.base.errors import SceneError
from knotfab.effects.shifts import allow_sag_mm
from knotfab.geometry.tube import sweep
from knotfab.hold.mount import mount_piece
from knotfab.hold.placement import placement_of
from knotfab.hold.plinth import Masses, Slope, base_for, slope_below
from knotfab.hold.wall import WallMount, mark_depth_mm, wall_fixtures
from knotfab.report.setup_words import level_wall, steps_of
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab_fixtures.solids import ARROW_MARKS
from knotfab_formats.piece import Mount, Printer
from knotfab_formats.print_figures import MountFigures
from knotfab_formats.scene import ResolvedView, Scene

ONE = knots(ring(50.0))
TWO = knots(ring(50.0), ring(25.0, 10.0))


def scene(**keys: object) -> Scene:
    mount = Mount(kind="wall", **keys)
    return resolve(
        Scene(views=(ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0),), mount=mount)
    )


@pytest.mark.slow
def test_more_sag_than_allowed_fails_and_says_what_would_help() -> None:
    scene = resolve(Scene(views=(VIEW,), mount=Mount(kind="wall")))
    mounted = mount_piece(scene, ONE, [sweep(ONE.points, RADIUS, 16)], [camera()])
    good = mounted.check_sag()
    assert good is not None and (good.status, good.required) == ("pass", True)
    assert "max_sag_mm" not in good.detail and mounted.wall is not None
    most = mounted.scene.mount.max_sag_mm
    assert most == good.limit == pytest.approx(allow_sag_mm(scene.views, ONE.points, RADIUS))
    bad = replace(mounted, holder=replace(mounted.wall, sag_mm=0.914)).check_sag()
    assert bad is not None and (bad.status, bad.measured) == ("fail", 0.914)
    assert "set mount.max_sag_mm to 0.92" in bad.detail
    told = resolve(Scene(views=(VIEW,), mount=Mount(kind="wall", max_sag_mm=0.3)))
    own = mount_piece(told, ONE, [sweep(ONE.points, RADIUS, 16)], [camera()]).check_sag()
    assert own is not None and own.limit == 0.3


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
    report = mounted.figures
    assert report.pegs == len(mounted.wall.pegs)  # type: ignore[union-attr]
    sag = mounted.check_sag()
    assert sag is not None and sag.status == "pass" and sag.measured <= sag.limit < 1


def test_without_a_mount_nothing_is_added() -> None:
    tubes = [sweep(ONE.points, RADIUS, 12)]
    bare = scene().model_copy(update={"mount": Mount()})
    mounted = mount_piece(bare, ONE, tubes, [camera()])
    assert mounted.bodies is tubes and mounted.upright is None and mounted.check_sag() is None
    assert mounted.figures == MountFigures(kind="none")


@pytest.mark.slow
def test_the_piece_on_its_stand() -> None:
    scene = resolve(Scene(views=(VIEW,), mount=Mount(kind="stand")))
    tubes = [sweep(k.points, RADIUS, 24) for k in ONE.knots]
    mounted = mount_piece(scene, ONE, tubes, [camera()], [EMPTY])
    stand = mounted.stand
    assert stand is not None and mounted.upright is not None and len(mounted.bodies) == 1
    assert mounted.scene.mount.pegs == (len(stand.members),)
    report, sag = mounted.figures, mounted.check_sag()
    assert report.kind == "stand" and (report.posts or 0) + (report.struts or 0) == len(
        stand.members
    )
    assert sag is not None and sag.status == "pass" and sag.measured == stand.sag_mm
    with pytest.raises(ValueError, match="silhouettes"):
        mount_piece(scene, ONE, tubes, [camera()])


@pytest.mark.slow
def test_several_loose_knots_get_a_wall_mount_by_themselves() -> None:
    tubes = [sweep(k.points, RADIUS, 12) for k in TWO.knots]
    open_scene = scene().model_copy(update={"mount": Mount()})
    held = mount_piece(open_scene, TWO, tubes, [camera()])
    assert held.wall is not None and held.scene.mount.kind == "wall"
    assert len(held.scene.mount.pegs) == 2
    bare = scene().model_copy(update={"mount": Mount(kind="none")})
    assert mount_piece(bare, TWO, tubes, [camera()]).wall is None


# The lamp's place has exact figures, whichever way the wall leans, and words that carry them.


@pytest.mark.parametrize("azimuth", [0.0, 40.0])
@pytest.mark.parametrize("tilt", [0.0, 25.0, -10.0])
def test_the_lamps_foot_on_a_leaning_wall(tilt: float, azimuth: float) -> None:
    mounted, _, camera = setup("none", wall_tilt_deg=tilt, azimuth_deg=azimuth)
    place = placement_of(mounted, camera)
    slope = np.radians(tilt)
    assert place.off_wall_mm == pytest.approx(600 * np.cos(slope))
    assert (place.right_mm, place.up_mm) == pytest.approx((0.0, 600 * np.sin(slope)), abs=1e-9)
    assert place.frame_mm == pytest.approx((160.0, 120.0))
    # the frame's middle lies where the lamp's axis meets the wall
    assert np.linalg.norm(place.lamp - place.middle) == pytest.approx(600.0)
    again = place.middle + place.right_mm * place.wall[0] + place.up_mm * place.wall[1]
    assert again + place.off_wall_mm * place.wall[2] == pytest.approx(place.lamp)
    # the law of cosines: the corners are half a frame away, the upper ones along the slope
    by_name = {mark.name: mark.lamp_mm for mark in place.marks}
    corner = np.sqrt(80**2 + (60 - place.up_mm) ** 2 + place.off_wall_mm**2)
    assert by_name["upper left corner of the frame"] == pytest.approx(corner)
    assert by_name["upper right corner of the frame"] == pytest.approx(corner)


def test_the_distances_place_the_lamp() -> None:
    """Four distances from the marks leave only one place for the lamp, on its side of the wall."""
    for kind in ("plate", "dowel", "stand"):
        mounted, _, camera = setup(kind, wall_tilt_deg=8.0)
        place = placement_of(mounted, camera)
        at = np.stack([mark.at for mark in place.marks])
        square = np.array([mark.lamp_mm for mark in place.marks]) ** 2
        left = 2 * (at[1:] - at[0])
        right = (at[1:] ** 2).sum(1) - (at[0] ** 2).sum() - square[1:] + square[0]
        within, _, rank, _ = np.linalg.lstsq(left, right, rcond=None)
        assert rank == 2
        normal = np.cross(at[1] - at[0], at[2] - at[0])
        normal *= np.sign(normal @ (place.lamp - at[0])) / np.linalg.norm(normal)
        in_plane = within - (within - at[0]) @ normal * normal
        high = np.sqrt(square[0] - ((in_plane - at[0]) ** 2).sum())
        assert in_plane + high * normal == pytest.approx(place.lamp, abs=1e-6)


def test_marks_lie_on_the_plates_edges() -> None:
    mounted, _, camera = setup("plate")
    place = placement_of(mounted, camera)
    assert place.plate_mm == pytest.approx((176.0, 136.0))
    marks = {m.name.split()[0]: place.on_wall(m.at) for m in place.marks}
    assert marks["upper"] == pytest.approx([0, 68]) and marks["left"] == pytest.approx([-88, 0])
    assert all(m.at @ camera.receiver[:3] + camera.receiver[3] < 1e-9 for m in place.marks)
    # the holes are where the plate has them
    assert place.holes == pytest.approx(np.array([[-83.0, 0.0], [83.0, 0.0]]))


def test_dowel_holes_are_the_pegs_feet() -> None:
    mounted, _, camera = setup("dowel", wall_tilt_deg=12.0)
    place = placement_of(mounted, camera)
    assert mounted.wall is not None
    for (right, up), peg in zip(place.holes, mounted.wall.pegs, strict=True):
        assert place.middle + right * place.wall[0] + up * place.wall[1] == pytest.approx(peg.foot)


def test_a_leaning_wall_is_told_in_words() -> None:
    mounted, scene, camera = setup("plate", wall_tilt_deg=20.0)
    place = placement_of(mounted, camera)
    said = " ".join(steps_of(mounted, place, scene.views[0]))
    assert "563.8 mm off" in said and "opposite 205.2 mm above the middle of the frame" in said
    assert level_wall(place, 0.0) == pytest.approx(-100.0)
    # 40 mm higher a wall that leans towards the lamp is nearer to it
    assert level_wall(place, 40.0) == pytest.approx(-100 + 40 * np.tan(np.radians(20)))


@pytest.mark.parametrize(
    ("margin", "hole", "mark"),
    [
        (8.0, 4.0, 1.5),  # as deep as they come
        (6.0, 1.0, 1.2),  # a fifth of the margin
        (6.0, 5.0, 0.875),  # half of what is left beside a screw hole
        (2.5, 1.0, 0.5),  # the least
        (2.49, 1.0, 0.0),
        (2.4, 4.0, 0.0),
    ],
)
def test_notches_stay_in_the_margin_and_off_the_holes(
    margin: float, hole: float, mark: float
) -> None:
    deep = mark_depth_mm(Mount(plate_margin_mm=margin, hole_diameter_mm=hole))
    assert deep == pytest.approx(mark)
    assert ARROW_MARKS * deep < margin


@pytest.mark.parametrize("margin", [3.0, 6.0, 8.0])
@pytest.mark.parametrize("frame", [(3.0, 3.0), (7.0, 60.0), (60.0, 3.0)])
def test_the_plate_of_the_smallest_picture_has_room_for_its_marks(
    margin: float, frame: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    view = camera_of(VIEW.but(frame_width_mm=frame[0], frame_height_mm=frame[1]), 90, 90)
    settings = Mount(foot="plate", plate_margin_mm=margin, hole_diameter_mm=2.0)
    mount = WallMount(pegs=(), settings=settings, sag_mm=0.0, sag_at=np.zeros(3))
    ((plate,),) = wall_fixtures(mount, view, 0)
    assert plate.sizes[:2] == pytest.approx(np.add(frame, 2 * margin))
    monkeypatch.setitem(sys.modules, "cadquery", None)
    with pytest.raises(ImportError):  # and no ValueError: the sizes make a plate
        plate.of(*plate.sizes, **plate.named)


# The base of a stand: the highest plane below all frames, and no base in a picture.


AZIMUTHS = (0.0, 90.0)


CAMERAS = [camera(azimuth_deg=a) for a in AZIMUTHS]


@pytest.mark.parametrize("seed", range(6))
def test_the_top_is_the_highest_plane_below_all_frames(seed: int) -> None:
    random = np.random.default_rng(seed)
    cameras = [
        camera(
            azimuth_deg=float(random.uniform(-180, 180)),
            elevation_deg=float(random.uniform(-20, 30)),
            frame_up_mm=float(random.uniform(-10, 10)),
        )
        for _ in range(1 + seed % 3)
    ]
    rectangle = (-40.0, 55.0, -30.0, 45.0)
    top = slope_below(cameras, rectangle)
    right, up, out = top.axes
    x, z = (np.linspace(*ends, 20) for ends in (rectangle[:2], rectangle[2:]))
    on = np.array([u * right + v * out for u in x for v in z])
    on = on - top.above(on)[:, None] * up
    edges = np.stack([slope_below([c]).above(on) for c in cameras])
    assert edges.max() <= 1e-9
    # it touches at both ends: no plane that is level across is higher
    for end in rectangle[2:]:
        there = np.isclose(on @ out, end)
        assert edges[:, there].max() == pytest.approx(0.0, abs=1e-9)
    again = slope_below([cameras[0], *cameras], rectangle)
    assert (again.height_mm, again.rise) == pytest.approx((top.height_mm, top.rise))


def test_a_base_in_a_picture_is_refused() -> None:
    """A top that the first light alone allows stands in the second's frame."""
    cameras = [CAMERAS[0], camera(azimuth_deg=90.0, frame_up_mm=-20.0)]
    feet = np.array([[-30.0, 0.0, -30.0], [30.0, 0.0, -30.0], [0.0, 0.0, 30.0]])
    weights = Masses(np.array([5000.0]), np.zeros((1, 3)))

    def base(slope: Slope) -> None:
        base_for(slope, feet, 2.0, weights, cameras, 4.0, 10.0)

    base(slope_below(cameras, (-60.0, 60.0, -60.0, 60.0)))
    with pytest.raises(SceneError, match="in a picture"):
        base(slope_below(cameras[:1]))


def test_a_top_before_a_low_light_is_level_and_below_it() -> None:
    low, high = (slope_below([camera(light_up_mm=up)]) for up in (-400.0, 100.0))
    assert low.rise < 0 < high.rise and high.no_fall(60.0) is high
    level = low.no_fall(60.0)
    right, _, out = low.axes
    on = np.array([x * right + z * out for x in (-30.0, 30.0) for z in (-50.0, 0.0, 60.0)])
    assert level.rise == 0 and (level.above(on) >= low.above(on) - 1e-9).all()
    assert level.above(on)[2] == pytest.approx(low.above(on)[2])  # at its front
