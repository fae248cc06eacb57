"""One piece, several views, one stand: it hides in every picture at once, and stands in none."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pieces import EMPTY, RADIUS, VIEW, camera, one, setup

from knotfab.base.errors import SceneError
from knotfab.geometry.tube import sweep
from knotfab.hold.mount import BASE_DOWN, mount_piece
from knotfab.hold.placement import placement_of
from knotfab.hold.plinth import slope_below
from knotfab.hold.shade import MountShadows
from knotfab.hold.solids import stand_bodies, strut
from knotfab.hold.stand import StandMount, plan_stand
from knotfab.hold.struts import join_members
from knotfab.part.assemble import _choose_pose
from knotfab.report.setup import write_setup
from knotfab.report.setup_words import steps_of
from knotfab.scene.camera import Camera
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Mount, Printer
from knotfab_formats.scene import Scene
from knotfab_formats.views import View
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry
from tests.hold.test_stand import ASKED, ONE, PLA
from tests.report.test_setup import texts

AZIMUTHS = (0.0, 90.0)
VIEWS = tuple(
    VIEW.model_copy(update={"name": f"v{n}", "azimuth_deg": a}) for n, a in enumerate(AZIMUTHS)
)
CAMERAS = [camera(azimuth_deg=a) for a in AZIMUTHS]
MIDDLE = (np.arange(90) - 44.5) * 2.0  # mm on the wall, of the pixels
DISC = MIDDLE[:, None] ** 2 + MIDDLE[None] ** 2 < 64.0**2
BAND = (np.abs(MIDDLE)[:, None] < 64) & (np.abs(MIDDLE)[None] < 21)
TARGETS = [DISC, BAND]  # the ring's silhouette is filled: its hull is a lens


@cache
def plan() -> StandMount:
    return plan_stand(ONE, CAMERAS, TARGETS, 0.4, PLA, ASKED)


@cache
def part() -> tuple[np.ndarray, np.ndarray]:
    (body,) = stand_bodies([sweep(ONE.points, RADIUS, 24)], plan())
    return body


def verify(vertices: np.ndarray, faces: np.ndarray, number: int) -> VerifiedView:
    return verify_view(
        vertices,
        faces.astype(np.int64),
        TARGETS[number],
        view_geometry(VIEWS[number], 90, 90),  # type: ignore[arg-type]
        polygons=[ONE.points],
        radius=RADIUS,
        mounted=True,
        stand=True,
    )


@cache
def verified(number: int) -> VerifiedView:
    return verify(*part(), number)


@pytest.mark.slow
def test_a_stand_holds_and_darkens_as_predicted_in_every_view() -> None:
    mount = plan()
    assert set(mount.holds) == {0} and len(mount.posts) >= 3
    assert 0 < mount.sag_mm <= PLA.max_sag_mm and mount.base.tip_deg >= 10.0 - 1e-2
    assert mount.predicted_intrusion.shape == (2,)
    for number, predicted in enumerate(mount.predicted_intrusion):
        measured = verified(number).intrusion
        assert measured is not None and measured == pytest.approx(predicted, rel=0.15, abs=2e-4)
        assert predicted < 0.05


@pytest.mark.slow
def test_the_base_lies_below_every_frame_and_before_every_wall() -> None:
    vertices, _ = part()
    base = plan().base
    low = vertices[base.slope.above(vertices) <= 1e-6]
    assert len(low)
    for view in CAMERAS:
        assert (view.project(low)[:, 1] > view.height - 0.5).all()
        assert (vertices @ view.receiver[:3] + view.receiver[3] > 0).all()


@pytest.mark.slow
def test_an_eye_is_as_a_lamp() -> None:
    scene = resolve(Scene(views=VIEWS, mount=Mount(kind="stand")))
    looking = tuple(v.model_copy(update={"kind": "eye"}) for v in scene.views)
    tubes = [sweep(ONE.points, RADIUS, 16)]
    lit, seen = (
        mount_piece(s, ONE, tubes, CAMERAS, TARGETS)
        for s in (scene, scene.model_copy(update={"views": looking}))
    )
    assert lit.stand is not None and seen.stand is not None
    assert np.array_equal(lit.stand.members.end, seen.stand.members.end)
    report = lit.figures
    assert report.predicted_intrusion == max(lit.stand.predicted_intrusion)
    # too tall for the printer: it lies down, as one body
    low = scene.model_copy(update={"printer": Printer(build_volume_mm=(250.0, 250.0, 100.0))})
    for asked, upright in ((scene, BASE_DOWN), (low, None)):
        made = SimpleNamespace(scene=asked, knots=ONE)
        mounted, pose = _choose_pose(made, lit, True)  # type: ignore[arg-type]
        assert mounted.upright is upright
        assert (pose.size_mm <= asked.printer.build_volume_mm).all()


@pytest.mark.slow
def test_what_one_view_hides_is_rejected_where_another_shows_it() -> None:
    """A bar across the ring, in the first picture's disc, that stands out of the second's band."""
    shadows = MountShadows(ONE, CAMERAS, TARGETS)
    inside, out_of_it = (one([0, -20, z], [0, 20, z], 1.5) for z in (0.0, 40.0))
    assert shadows.hidden(inside)[0] and not shadows.hidden(out_of_it)[0]
    assert [v.hidden(out_of_it)[0] for v in shadows.views] == [True, False]
    assert shadows.cost(inside)[0] == 0 < shadows.cost(out_of_it)[0]
    dark = shadows.darken(out_of_it)
    assert dark[0] == 0 < dark[1]
    shadows.add(out_of_it)
    assert shadows.cost(out_of_it)[0] < 0.05 * dark[1] * shadows.pixels


@pytest.mark.slow
def test_a_post_through_a_picture_is_measured_in_that_view() -> None:
    """The validators, on a part with one bar more than its stand has."""
    mount = plan()
    bar = one([0, -30, 35], [0, 45, 35], 1.5, ground=True)
    stray = replace(mount, members=join_members([mount.members, bar]))
    with pytest.raises(SceneError, match="bodies"):  # the bar touches nothing
        stand_bodies([sweep(ONE.points, RADIUS, 24)], stray)
    solid = strut(bar.start[0], bar.end[0], 1.5).solid().to_mesh64()
    vertices, faces = part()
    both = (
        np.concatenate([vertices, solid.vert_properties[:, :3]]),
        np.concatenate([faces, solid.tri_verts.astype(np.int32) + len(vertices)]),
    )
    views = {v.name: verify(*both, n) for n, v in enumerate(VIEWS)}
    alone = [verified(n).intrusion for n in range(2)]
    found = [v.intrusion for v in views.values()]
    assert None not in (*alone, *found)
    area = 2 * 1.5 * 75 * 1.2**2 / 180**2
    assert found[0] == pytest.approx(alone[0], abs=2e-4)  # the disc covers it
    assert found[1] - alone[1] > 0.5 * area  # type: ignore[operator]
    checks = shadow_checks(
        views, both[0], iou_floor=0.5, max_outline_px=99.0, no_rendering="no need",
        polygons_decide=True, mount="wall",
    )  # fmt: skip
    (intrusion,) = [c for c in checks if c.name == "intrusion"]
    assert intrusion.status == "fail" and "view v1" in intrusion.detail


def test_a_light_from_above_and_a_wall_mount_are_refused() -> None:
    with pytest.raises(SceneError, match=r"looks down.*elevation_deg"):
        slope_below([CAMERAS[0], camera(elevation_deg=89.0)])
    scene = resolve(Scene(views=VIEWS, mount=Mount(kind="wall")))
    with pytest.raises(InputError, match=r"2 views: pegs .* rays .*--mount stand"):
        mount_piece(scene, ONE, [], CAMERAS, TARGETS)
    stand = scene.model_copy(update={"mount": Mount(kind="stand")})
    with pytest.raises(ValueError, match="all views"):
        mount_piece(stand, ONE, [], CAMERAS, [EMPTY])


def draw(folder: Path, *azimuths: float) -> tuple[list[str], list[str]]:
    """What a set-up of a stand says on its first page, and in its last view's steps."""
    mounted, scene, camera = setup("stand")
    pieces = [setup("stand", azimuth_deg=a) for a in azimuths]
    cameras: list[Camera] = [camera, *(c for _, _, c in pieces)]
    named: list[View] = [
        s.views[0].model_copy(update={"name": f"view-{n + 1}"})
        for n, s in enumerate([scene, *(s for _, s, _ in pieces)])
    ]
    whole = scene.model_copy(update={"views": tuple(named)})
    names = write_setup(folder, mounted, whole, cameras)
    assert names == ["setup.pdf", "setup.svg"]
    pages = (folder / "setup.pdf").read_bytes().count(b"/MediaBox")
    assert pages == 2 + len(cameras)
    last = steps_of(mounted, placement_of(mounted, cameras[-1]), named[-1])
    return texts(folder / "setup.svg"), last


@pytest.mark.slow
def test_the_drawing_shows_all_lamps_and_walls_from_above(tmp_path: Path) -> None:
    said, steps = draw(tmp_path, 90.0)
    assert {"wall: view-1", "wall: view-2", "lamp, 5 mm: view-1", "lamp, 5 mm: view-2"} <= set(said)
    assert said.count("500") == 2 and said.count("100") == 2
    # the base reaches from x = -30 to 32 and from z = -20 to 25; the second lamp is at x = 500
    first, second = steps[:2]
    assert "wall of view-2 70 mm from the left edge of the base" in first
    assert "75 mm above the desk and 468 mm in front of the base's right edge" in second
    assert "2.5 mm to the right" in second


@pytest.mark.slow
def test_a_view_oblique_to_the_base_is_placed_by_its_corner(tmp_path: Path) -> None:
    _, steps = draw(tmp_path, 60.0, 120.0)
    assert "nearest corner" in steps[0] and "120.0° anticlockwise" in steps[0]
    corners = np.array([[x, z] for x in (-30.0, 32.0) for z in (-20.0, 25.0)])
    way = np.array([np.sin(np.deg2rad(120.0)), np.cos(np.deg2rad(120.0))])
    assert f"{100 + (corners @ way).min():.1f} mm behind" in steps[0]
    assert f"{500 - (corners @ way).max():.1f} mm in front" in steps[1]
