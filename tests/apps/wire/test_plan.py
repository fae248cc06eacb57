"""The bending plan of a piece: files, what is measured of them, templates at full size."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import POINT, page_contents, page_sizes, segments
from PIL import Image

from knotfab.apps.wire.arcs import list_bends, round_corners
from knotfab.apps.wire.files import WireDrawing, read_bends, write_templates
from knotfab.apps.wire.judge import Judge, cast_shadows, check_type, check_wire
from knotfab.apps.wire.plan import ENOUGH_IOU, WirePlan, measure_frame, write_bending_plan
from knotfab.base.errors import SceneError
from knotfab.design.question import ask
from knotfab.design.settings import start_pose
from knotfab.knots import Knot, Knots
from knotfab.picture.read import read_target
from knotfab.render.pages import PAPERS
from knotfab.report.report import tell_plan
from knotfab.scene.catalogue import materials, resolve
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material, Piece
from knotfab_formats.report import BentWire
from knotfab_formats.scene import ResolvedView, Scene, SettledAccuracy, SettledScene
from knotfab_formats.views import Switches
from knotfab_validators.shadows.tube_field import tube_field
from knotfab_validators.shadows.view import view_geometry

pytestmark = pytest.mark.slow

STEEL = materials()["steel-wire-2mm"]


def ring_scene(folder: Path, count: int) -> tuple[Knots, SettledScene, Path]:
    """Polylines of 2 mm wire before a far light, and their own shadow as the picture."""
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ring = np.column_stack([22 * np.cos(t), 22 * np.sin(t), 3 * np.cos(2 * t)])
    view = ResolvedView(
        frame_width_mm=60.0 * count, frame_height_mm=60.0, light_distance_mm=5000.0,
        wall_distance_mm=10.0, picture="p.png",
    )  # fmt: skip
    scene = SettledScene.model_construct(
        piece=Piece(), material=STEEL, views=(view,), accuracy=SettledAccuracy(iou_floor=0.62)
    )
    shifts = 60.0 * (np.arange(count) - (count - 1) / 2)
    knots = Knots(tuple(Knot(ring + [s, 0, 0]) for s in shifts), 1.0)
    y, x = np.mgrid[0:300, 0 : 300 * count]
    far = np.hypot(((x + 0.5) % 300) / 5 - 30, (y + 0.5) / 5 - 30)
    Image.fromarray(np.where(np.abs(far - 22) < 1, 0, 255).astype(np.uint8)).save(folder / "p.png")
    return knots, scene, folder / "p.png"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, WirePlan]:
    folder = tmp_path_factory.mktemp("wire")
    knots, scene, picture = ring_scene(folder, 2)
    return folder, write_bending_plan(folder, knots, scene, [picture])


def test_the_plan_of_two_rings(made: tuple[Path, WirePlan]) -> None:
    folder, plan = made
    assert plan.figures.files[:2] == ("bends-1.csv", "bends-2.csv")
    assert plan.figures.files[2:4] == ("bends-1-lra.csv", "bends-2-lra.csv")
    assert all((folder / name).is_file() for name in plan.figures.files)
    assert plan.figures.status == "pass"
    for knot in plan.figures.knots:
        # the ring is 140.8 mm long: 22.4 mm of radius, with its rise and fall
        assert knot.length_mm == pytest.approx(2 * np.pi * 22.4, rel=0.04)
        assert 8 <= knot.bends <= 30 and knot.closing_error_mm < 0.05
        # by default a little more than the wire's radius: the fit draws the picture within it
        assert knot.deviation_across_mm <= plan.figures.tolerance_mm == 1.1
        assert knot.shortest_straight_mm >= 1.99
    assert plan.figures.length_mm == pytest.approx(sum(k.length_mm for k in plan.figures.knots))
    assert plan.figures.mass_g == pytest.approx(plan.figures.length_mm * np.pi * 7.85e-3)
    assert plan.figures.bends == sum(k.bends for k in plan.figures.knots)


def two_view_scene(folder: Path) -> tuple[Knots, SettledScene, list[Path]]:
    """A bent ring of 2 mm wire in two views at right angles, the second from above by 20 degrees.

    Each picture is the ring's own shadow, so that a wire which follows it is right in both.
    """
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.column_stack([11 * np.cos(t), 7 * np.sin(t), 9 * np.sin(t + 0.4)])
    knots = Knots((Knot(ring),), 1.0)
    common = dict(frame_width_mm=30.0, frame_height_mm=30.0, light_distance_mm=900.0,
                  wall_distance_mm=40.0)  # fmt: skip
    views = (
        ResolvedView(name="front", **common),
        ResolvedView(name="side", azimuth_deg=90.0, elevation_deg=20.0, **common),
    )
    pictures = []
    for view in views:
        geometry = view_geometry(view, 300, 300)
        shadow = tube_field([ring], 1.0, geometry).mask
        pictures.append(folder / f"{view.name}.png")
        Image.fromarray(np.where(shadow, 0, 255).astype(np.uint8)).save(pictures[-1])
    scene = SettledScene.model_construct(
        piece=Piece(), material=STEEL, views=views, accuracy=SettledAccuracy(iou_floor=0.8)
    )
    return knots, scene, pictures


def test_a_wire_for_two_views_is_right_in_both(tmp_path: Path) -> None:
    knots, scene, pictures = two_view_scene(tmp_path)
    plan = write_bending_plan(tmp_path, knots, scene, pictures)
    assert plan.figures.status == "pass" and set(plan.figures.iou_of_views) == {"front", "side"}
    assert plan.figures.iou == min(plan.figures.iou_of_views.values()) > 0.8
    # no direction is free: the wire stays within the tolerance in all of them
    assert plan.figures.knots[0].deviation_mm <= 1.1
    assert "1.1 mm in any direction" in (tmp_path / "bends.csv").read_text()
    # a picture that is wrong is noticed in whichever view it is
    rows = read_bends(tmp_path / "bends.csv")
    for wrong, view in enumerate(scene.views):
        swapped = list(pictures)
        swapped[wrong] = tmp_path / "wrong.png"
        Image.open(pictures[wrong]).rotate(90).save(swapped[wrong])
        shadows = cast_shadows(scene, swapped, knots)
        judge = Judge([k.points for k in knots.knots], shadows, STEEL, 1.0, 0.78, ("unknot",))
        checks = judge.bend_again([rows], ["bends.csv"], [False]).checks
        failed = [c for c in checks if c.status == "fail"]
        assert [c.name for c in failed] == ["wire_shadow"]
        assert f"view {view.name}" in failed[0].detail


def test_the_plan_of_a_raised_view_is_drawn_from_its_light(tmp_path: Path) -> None:
    knots, scene, pictures = two_view_scene(tmp_path)
    shadows = cast_shadows(scene, pictures, knots)
    for shadow in shadows:
        toward = np.cross(shadow.geometry.right, shadow.geometry.up)
        assert shadow.geometry.light == pytest.approx(900.0 * toward)
    assert shadows[1].geometry.light[1] == pytest.approx(900.0 * np.sin(np.deg2rad(20.0)))


def test_the_shadow_falls_on_the_wall_that_is_taken(tmp_path: Path) -> None:
    knots, scene, picture = ring_scene(tmp_path, 1)
    bent = scene.views[0].model_copy(update={"wall_radius_mm": -60.0})
    for word in (None, False):
        told = scene.model_copy(update={"views": (bent,), "effects": Switches(wall=word)})
        (shadow,) = cast_shadows(told, [picture], knots)
        # the picture is that of the flat wall
        assert (shadow.geometry.cylinder is None) == (word is False)
        assert (shadow.iou([k.points for k in knots.knots]) > 0.9) == (word is False)


def test_what_is_no_wire_or_of_another_thickness_is_refused(tmp_path: Path) -> None:
    knots, scene, picture = ring_scene(tmp_path, 1)
    printed = scene.model_copy(update={"material": materials()["pla"]})
    with pytest.raises(InputError, match="no wire"):
        write_bending_plan(tmp_path, knots, printed, [picture])
    with pytest.raises(InputError, match="tube_radius_mm = 1"):
        write_bending_plan(tmp_path, replace(knots, radius_mm=1.01), scene, [picture])


KNOT = BentWire(
    file="b.csv", length_mm=100.0, bends=9, deviation_mm=1.0, deviation_mean_mm=0.2,
    deviation_across_mm=0.5, closing_error_mm=0.5, shortest_straight_mm=1.99, largest_bend_deg=160.0,
    joint_straight_mm=9.0, joint_hidden=True, end_moves_mm_per_deg=1.0,
    end_moves_mm_for_1_deg_everywhere=2.0,
)  # fmt: skip


def verdicts(knot: BentWire, iou: float = 0.9, least: float = 1.99) -> dict[str, str]:
    found = check_wire((knot,), STEEL, 0.5, {"near": 0.95, "far": iou}, 0.9, least)
    return {c.name: c.status for c in found}


def test_each_check_passes_at_its_limit_and_fails_beyond() -> None:
    assert set(verdicts(KNOT).values()) == {"pass"}

    def off(largest: float, across: float) -> BentWire:
        return replace(KNOT, deviation_mm=largest, deviation_across_mm=across)

    failed = {
        "wire_shadow": verdicts(KNOT, iou=0.8999),
        "wire_contact": verdicts(KNOT, least=1.9899),
        "wire_deviation": verdicts(off(1.0, 0.5001)),
        "wire_depth": verdicts(off(1.0001, 0.5)),
        "wire_straight": verdicts(replace(KNOT, shortest_straight_mm=1.9899)),
        "wire_bend": verdicts(replace(KNOT, largest_bend_deg=160.001)),
        "wire_closing": verdicts(replace(KNOT, closing_error_mm=0.5001)),
    }
    for name, found in failed.items():
        assert [k for k, v in found.items() if v == "fail"] == [name]


def test_a_plan_out_of_time_says_so_and_one_that_cannot_be_bent_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("knotfab.apps.wire.plan._FIT_SHARES", (0.97,))  # each takes seconds
    knots, scene, picture = ring_scene(tmp_path, 1)
    plan = write_bending_plan(tmp_path, knots, scene, [picture], ends=0.0)
    assert plan.cut == "--time-budget" and any(plan.cut in note for note in tell_plan(plan))
    for straight, bend, said in ((30.0, 90.0, False), (2.0, 90.0, True), (30.0, 142.0, True)):
        wire = replace(KNOT, shortest_straight_mm=straight, largest_bend_deg=bend)
        told = tell_plan(replace(plan, figures=replace(plan.figures, knots=(wire,))))
        assert any("hardly a hand" in note for note in told) == said
    wide = scene.model_copy(update={"material": STEEL.model_copy(update={"tool_radius_mm": 40.0})})
    with pytest.raises(SceneError, match=r"bends overlap.*tool_radius_mm"):
        write_bending_plan(tmp_path, knots, wide, [picture])
    with pytest.raises(SceneError, match=r"--time-budget: two bends overlap.*--size"):
        write_bending_plan(tmp_path, knots, wide, [picture], ends=0.0)


def test_a_wire_that_is_another_knot_is_refused() -> None:
    t = 2 * np.pi * np.arange(30) / 30
    radius = 26 + 9 * np.cos(3 * t)
    trefoil = np.column_stack([radius * np.cos(2 * t), radius * np.sin(2 * t), 8 * np.sin(3 * t)])
    # the same picture from the light, but each strand passes over all that come after it
    falling = trefoil * [1.0, 1.0, 0.0] - [0.0, 0.0, 8.0] * t[:, None]
    rows, other = (list_bends(round_corners(c, 1.0), 0, 4.0) for c in (trefoil, falling))
    for plan, is_one, is_not in ((rows, "3_1", "unknot"), (other, "unknot", "3_1")):
        assert check_type([plan], [is_one]).status == "pass"
        assert check_type([plan], [is_not]).status == "fail"
    ring = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
    through = ring[:, [2, 0, 1]] + [20, 20, -20]
    rings = [list_bends(round_corners(c, 2.0), 0, 4.0) for c in (ring, through)]
    assert check_type(rings, ["unknot"] * 2).status == "fail"  # one goes through the other


# --- templates ---------------------------------------------------------------------------------


def drawing(size: float = 60.0) -> WireDrawing:
    line = np.array([[0, 0], [size, 0], [size, size], [0, size], [0, 0]], dtype=float)
    return WireDrawing("test", line, line[1:4], ("1", "2", "3"), 2.0)


def test_ruler_and_wire_are_at_full_size(tmp_path: Path) -> None:
    path = tmp_path / "t.pdf"
    pages = write_templates(path, PAPERS["a4"], [drawing(60.0)], ["a fact"])
    assert pages == len(page_sizes(path)) == 2
    texts = page_contents(path)
    long = [np.abs(lines[:, 2] - lines[:, 0]) for lines in map(segments, texts)]
    assert sum((np.abs(one - 100) < 1e-3).any() for one in long) == 2  # a ruler on both pages
    # the square's side of 60 mm is drawn as a polyline
    runs = [re.findall(r"([-\d.]+) ([-\d.]+) [ml]\n", text) for text in texts]
    points = [np.array(run, dtype=float).reshape(-1, 2) / POINT for run in runs]
    side = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in points]
    assert sum((np.abs(s - 60) < 1e-3).sum() for s in side) >= 4


def test_the_same_plan_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_templates(tmp_path / name, PAPERS["a4"], [drawing()], ["x"])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def bars(thin: int) -> np.ndarray:
    """Two bars of equal area, 100 px and `thin` px wide."""
    mask = np.zeros((1000, 1000), dtype=bool)
    mask[100 : 100 + 8 * thin, 100:200] = True
    mask[100:900, 500 : 500 + thin] = True
    return mask


def view(width: float, wall: float = 0.001) -> ResolvedView:
    return ResolvedView(
        frame_width_mm=width, frame_height_mm=width, light_distance_mm=500.0, wall_distance_mm=wall
    )


def test_what_is_thinner_than_the_wire_is_lost() -> None:
    """A bar of 20 px takes a wire of 2 mm from 100 mm on; the other is as wide as it is high, or wider."""
    small, large = (measure_frame(bars(20), view(w), STEEL) for w in (80.0, 130.0))
    assert small.most_iou == pytest.approx(0.5, abs=0.02)
    assert large.most_iou > ENOUGH_IOU
    assert small.enough_mm == pytest.approx(large.enough_mm, rel=1e-3)
    assert small.enough_mm == pytest.approx(100.0, rel=0.05)
    check = small.check(STEEL)
    assert (check.status, check.required) == ("fail", False)
    assert f"{small.enough_mm:.0f} mm and more would do" in check.detail
    assert large.check(STEEL).status == "pass" and "small" not in large.check(STEEL).detail


def test_a_wall_far_behind_makes_the_wires_shadow_wider() -> None:
    near, far = (measure_frame(bars(20), view(130.0, w), STEEL) for w in (0.001, 250.0))
    assert near.enough_mm is not None and far.enough_mm is not None
    assert far.enough_mm == pytest.approx(1.5 * near.enough_mm, rel=1e-3)


def test_dust_needs_a_frame_that_is_not_sought() -> None:
    mask = np.zeros((1000, 1000), dtype=bool)
    mask[100:900:40, 100:103] = True
    tiny = measure_frame(mask, view(5.0), STEEL)
    assert tiny.enough_mm is None and "would do" not in tiny.check(STEEL).detail


def test_a_wires_tube_is_as_thick_as_the_wire() -> None:
    wire = resolve(Scene(material=Material(name="aluminium-wire-2mm")))
    assert wire.piece.tube_radius_mm == 1.0
    asked = Scene(material=Material(name="aluminium-wire-2mm"), piece=Piece(tube_radius_mm=1.5))
    assert resolve(asked).piece.tube_radius_mm == 1.5
    assert resolve(Scene()).piece.tube_radius_mm is None


@pytest.mark.slow
@pytest.mark.parametrize(("material", "free"), [("steel-wire-2mm", False), ("pla", True)])
def test_a_free_view_leaves_the_wire_as_thick_as_it_is(material: str, free: bool) -> None:
    scene = resolve(Scene(material=Material(name=material), search={"free_view": True}))
    problem = ask(scene, [read_target("text:♥")]).problem
    settings = scene.settings
    pose, settings = start_pose(scene, problem, 1.0, settings, "cpu")
    assert ("radius" in pose.bounds.free) == free
    assert (settings.free_radius_mm > 0) == free
