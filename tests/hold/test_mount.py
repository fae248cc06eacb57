"""A piece on its mount: what follows from scene and printer, what is reported and checked."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rings import EMPTY, RADIUS, VIEW, camera, knots, ring

from knotfab.effects.shifts import allow_sag_mm
from knotfab.geometry.tube import sweep
from knotfab.hold.mount import mount_piece
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Mount, Printer
from knotfab_formats.report import MountFigures
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
    bad = replace(mounted, wall=replace(mounted.wall, sag_again_mm=0.914)).check_sag()
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
    assert sag is not None and sag.status == "pass" and sag.measured == stand.sag_again_mm
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
