"""Several views of one part: frames, the start, the search, and a whole build."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from oracles import state_at
from PIL import Image
from questions import ask_views, draw_mask, see_from, start_and_search
from shapely import MultiPolygon, Point, box

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.hull import HullBound
from knotfab.design.question import _crop_to_hull, ask
from knotfab.limits.terms import Felt
from knotfab.picture.read import Target, read_targets
from knotfab.pipeline.build import run_build
from knotfab.problem import Start
from knotfab.request import Request
from knotfab.scene.camera import camera_of, view_axes
from knotfab.scene.catalogue import resolve
from knotfab.search import search as search_module
from knotfab.search.objective import TENSION, Chamfer, Spill, Term, Weights
from knotfab.search.state import begin_search
from knotfab.start.filling import simple_curves
from knotfab.start.start import make_start
from knotfab.start.views import start_ious
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy, Mount, Piece
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.search import PRESETS
from knotfab_formats.views import View
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types
from knotfab_validators.shadows.view import view_geometry

DISC = MultiPolygon([Point(0, 0).buffer(40.0)])
SQUARE = MultiPolygon([box(-30, -40, 30, 40)])
QUICK = PRESETS["draft"].model_copy(
    update={"coarse_iterations": 60, "fine_iterations": 40, "settle_iterations": 30}
)


FILES_OF_A_VIEW = (("picture", "png"), ("shadow", "png"))


def scene_views() -> tuple[View, View]:
    """Two views at a right angle, as a scene has them."""
    return see_from(0.0, name="v0"), see_from(90.0, name="v1")


def term_at(term: Term, points: Array, weights: Weights | None = None) -> Felt:
    """A term at the vertices (N, 3) of one closed polyline."""
    return term(state_at(points), weights or Weights())


@pytest.mark.parametrize("elevation", [0.0, 35.0, 90.0, -60.0])
@pytest.mark.parametrize("azimuth", [0.0, 70.0])
def test_maker_and_validator_see_raised_and_shifted_frames_alike(
    azimuth: float, elevation: float
) -> None:
    view = ResolvedView(
        frame_width_mm=150.0,
        frame_height_mm=100.0,
        wall_tilt_deg=12.0,
        azimuth_deg=azimuth,
        elevation_deg=elevation,
        frame_up_mm=7.0,
    )
    own, theirs = camera_of(view, 300, 200), view_geometry(view, 300, 200)
    assert own.projection == pytest.approx(theirs.projection, abs=1e-12)
    assert own.receiver == pytest.approx(theirs.receiver, abs=1e-9)


def test_from_above_the_light_is_at_plus_y_and_the_top_is_away() -> None:
    view = ResolvedView(frame_width_mm=100.0, frame_height_mm=100.0, elevation_deg=90.0)
    camera = camera_of(view, 100, 100)
    assert camera.eye == pytest.approx([0, 500, 0], abs=1e-9)
    (u, v), (_, away) = camera.project(np.array([[10.0, 0.0, 0.0], [0.0, 0.0, -10.0]]))
    assert u > 49.5 and v == pytest.approx(49.5) and away < 49.5
    right, up, towards = view_axes(view)
    assert np.cross(right, up) == pytest.approx(towards)


def test_a_shifted_frame_moves_the_picture_up_the_wall() -> None:
    view = ResolvedView(frame_width_mm=100.0, frame_height_mm=100.0, frame_up_mm=6.0)
    at = camera_of(view, 100, 100).project(np.zeros((1, 3)))[0]
    assert at == pytest.approx([49.5, 55.5])


def test_the_pull_on_spill_is_the_distance_outside() -> None:
    target = ask_views([DISC], 30.0).views[0]
    spill = Spill.for_view(target, 2.0)
    right, up, towards = target.axes
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)[:, None]
    inside = 37.0 * (np.cos(angle) * right + np.sin(angle) * up)
    assert term_at(spill, inside)[0] == 0.0
    far = 50.0 / 37.0 * inside
    total, gradient = term_at(spill, far)
    edge = float(np.linalg.norm(np.roll(far, -1, 0) - far, axis=1).mean())
    # 10 mm outside are 5 radii, and a strand of one radius there costs half of that
    assert total / (50 * edge / 2.0) == pytest.approx(2.5, rel=0.06)
    half, _ = term_at(spill, far, Weights(image=0.5))
    assert half == pytest.approx(0.5 * total)
    slope = 0.5 * edge / 2.0 / 2.0
    pull = (gradient * inside / 37.0).sum(1)
    assert pull == pytest.approx(np.full(50, slope), rel=0.35)
    assert np.abs(gradient @ towards).max() < 0.2 * slope
    # the mean edge is held in the slope: take its change out of the differences
    way = np.random.default_rng(1).normal(size=inside.shape)
    per_edge = []
    for sign in (1, -1):
        at = far + sign * 1e-6 * way
        length = np.linalg.norm(np.roll(at, -1, 0) - at, axis=1).mean()
        per_edge.append(edge * term_at(spill, at)[0] / length)
    assert (gradient * way).sum() == pytest.approx((per_edge[0] - per_edge[1]) / 2e-6, rel=1e-4)


@pytest.mark.slow
def test_two_views_end_feasible_certified_and_drawn() -> None:
    problem = ask_views([DISC, SQUARE], 0.0, 90.0)
    start = make_start(problem, 4.0, QUICK)
    found = start_and_search(problem, 4.0, QUICK, start)
    assert found.feasible and found.feasibility.violations == []
    assert found.log.certified
    assert min(found.ious) > 0.965 and found.iou_estimate == min(found.ious)
    assert min(found.ious) > min(start_ious(problem, start, 4.0))
    assert found.views == tuple(v.view for v in problem.views)


@pytest.mark.slow
def test_a_start_for_two_views_holds_the_knot_that_is_asked_for() -> None:
    problem = replace(ask_views([DISC, SQUARE], 0.0, 90.0), knot="trefoil")
    start = make_start(problem, 4.0, QUICK)
    assert start.types == ("right-handed 3_1",) and "right-handed 3_1 of the lattice" in start.why
    assert knot_type_of(start) == "proved"
    plain = make_start(replace(problem, knot="unknot"), 4.0, QUICK)
    assert knot_type_of(replace(plain, types=start.types)) == "refuted"
    assert min(start.ious) > min(plain.ious) - 0.02
    with pytest.raises(SceneError, match="no place for it"):
        make_start(replace(problem, knot="3_1#3_1#3_1#3_1#3_1#3_1"), 9.0, QUICK)


def knot_type_of(start: Start) -> str:
    """What the independent check says of the one type that a start promises."""
    (curve,) = start.curves
    return knot_types(Curves((curve,), start.types, (True,), 2.5)).knots[0].verdict


@pytest.mark.slow
@pytest.mark.parametrize(
    ("begun", "gain"), [("circle", 0.25), pytest.param("filling", 0.01, marks=pytest.mark.study)]
)
def test_the_network_draws_two_views_and_its_way_is_proved(begun: str, gain: float) -> None:
    problem = ask_views([DISC, SQUARE], 0.0, 90.0)
    few = {"network_depth": 6, "network_width": 32, "network_iterations": 60, "fine_px": 96}
    network = QUICK.model_copy(update={"method": "inn", "network_start": begun, **few})
    start = make_start(problem, 6.0, network)
    found = start_and_search(problem, 6.0, network, start, repairs=0)
    assert found.log.certified
    assert "carried along the invertible network" in found.log.template
    assert min(found.ious) > min(start_ious(problem, start, 6.0)) + gain


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        (Scene(piece=Piece(depth="flat")), "--depth"),
        (Scene(mount=Mount(kind="wall")), "stand in the picture of the other"),
    ],
)
def test_what_makes_no_sense_with_several_views_is_refused(scene: Scene, key: str) -> None:
    pictures = [Target(n, draw_mask(DISC, 100.0)) for n in ("a", "b")]
    with pytest.raises(InputError, match=key):
        ask(resolve(scene.model_copy(update={"views": scene_views()})), pictures)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        Scene(piece=Piece(knot="trefoil")),
        Scene(mount=Mount(kind="stand")),
        Scene(search={"method": "inn"}),
    ],
)
def test_what_one_view_may_have_several_may_have_too(scene: Scene) -> None:
    pictures = [Target(n, draw_mask(DISC, 100.0)) for n in ("a", "b")]
    asked = ask(resolve(scene.model_copy(update={"views": scene_views()})), pictures)
    assert [v.view.name for v in asked.problem.views] == ["v0", "v1"]
    assert asked.problem.knot == scene.piece.knot and len(asked.bounds) == 2


@pytest.mark.slow
@pytest.mark.parametrize("printing", [False, True])
def test_a_wall_mount_is_refused_whether_it_is_printed_or_not(
    tmp_path: Path, printing: bool
) -> None:
    Image.fromarray(~draw_mask(DISC, 100.0)).save(tmp_path / "a.png")
    file = str(tmp_path / "a.png")
    scene = resolve(Scene(views=scene_views(), mount=Mount(kind="wall")))
    targets = read_targets((file, file), scene.views)
    with pytest.raises(InputError, match="mount"):
        run_build(Request(scene, targets, tmp_path / "o", printing=printing))


def test_what_others_leave_of_a_silhouette_is_the_hulls_shadow() -> None:
    view = see_from(0.0)
    mask = draw_mask(DISC, 100.0)
    target = Target("disc", mask)
    wanted = mask[::2, ::2]
    upper = np.arange(100)[:, None] < 50
    for covered, area in ((wanted, DISC.area), (wanted & upper, 0.5 * DISC.area)):
        bound = HullBound(covered, wanted, 1.0, np.zeros(3), np.zeros(3))
        left = _crop_to_hull(view, target, bound)
        assert left.area == pytest.approx(area, rel=0.04)
        assert left.difference(DISC.buffer(0.6)).is_empty
    nothing = HullBound(wanted & False, wanted, 0.0, np.zeros(3), np.zeros(3))
    assert _crop_to_hull(view, target, nothing).is_empty


def test_pictures_and_views_must_be_as_many(tmp_path: Path) -> None:
    Image.fromarray(~draw_mask(DISC, 100.0)).save(tmp_path / "a.png")
    with pytest.raises(InputError, match="1 pictures are given for 2 views"):
        read_targets((str(tmp_path / "a.png"),), resolve(Scene(views=scene_views())).views)


@pytest.mark.build
@pytest.mark.study
def test_a_build_of_a_shadow_and_a_glimpse(tmp_path: Path) -> None:
    """One light and one eye, on a stand, verified on the written file, with all files for other tools.

    That a scene of several views gives the same knots again is tested in design.
    """
    for name, polygon in (("a", DISC), ("b", SQUARE)):
        Image.fromarray(~draw_mask(polygon, 100.0)).save(tmp_path / f"{name}.png")
    front, side = scene_views()
    asked = Scene(
        piece=Piece(tube_radius_mm=7.0, bend=0.0),
        views=(front, side.model_copy(update={"kind": "eye"})),
        accuracy=Accuracy(name="draft", max_outline_error_px=1.5),
        mount=Mount(kind="stand"),
        search={
            "coarse_px": 96,
            "fine_px": 128,
            "coarse_iterations": 30,
            "fine_iterations": 15,
            "settle_iterations": 20,
        },
    )
    scene, skip = resolve(asked), frozenset({"shadow-render", "slicer"})
    targets = read_targets(("a.png", "b.png"), scene.views, base=tmp_path)
    request = Request(scene, targets, tmp_path / "out", printing=True, skip=skip)
    outcome = run_build(request)
    report = outcome.report
    assert outcome.exit_code == 0, [c for c in report["checks"] if c["status"] == "fail"]
    assert [v["kind"] for v in report["views"]] == ["shadow", "eye"]
    for view in report["views"]:
        assert 0.93 < view["iou_tube"] <= view["bound"] + 0.02
        assert 0 <= view["intrusion"] < 0.1
        assert view["iou"] <= view["iou_frame"]
    checks = {c["name"]: c["status"] for c in report["checks"]}
    assert checks["standing"] == checks["sag"] == checks["intrusion"] == "pass"
    assert report["print"]["mount"]["posts"] >= 3
    assert len(report["settings"]["start_ious"]) == 2
    there = {path.name for path in (tmp_path / "out").iterdir()}
    assert {f"{kind}-v{n}.{suffix}" for kind, suffix in FILES_OF_A_VIEW for n in (0, 1)} <= there


def test_a_circle_start_is_simple_in_one_view() -> None:
    ring = MultiPolygon([Point(0, 0).buffer(35.0).difference(Point(0, 0).buffer(29.0))])
    slope = MultiPolygon([box(-36, -3, 36, 3)])
    slope = MultiPolygon([shapely.affinity.rotate(slope.geoms[0], 40.0)])
    problem = ask_views([ring, slope], 0.0, 90.0)
    circle = QUICK.model_copy(update={"network_start": "circle"})
    start = make_start(problem, 3.0, circle)
    (curve,) = start.curves
    assert "circle" in start.why and start.far
    assert simple_curves([curve[:, :2]]) or simple_curves([curve[:, [2, 1]]])
    side = curve @ problem.views[1].axes.T
    slopes = np.polyfit(side[:, 1], side[:, 0], 1)[0]
    assert slopes == pytest.approx(1 / np.tan(np.deg2rad(40.0)), rel=0.25)


def test_a_far_start_is_brought_near_alike_by_any_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    walked: list[list[int]] = []
    monkeypatch.setattr(search_module, "resample_state", lambda *_: None)
    monkeypatch.setattr(
        search_module, "run_phase", lambda _, phase: walked[-1].append(phase.walk.iterations)
    )
    problem = ask_views([DISC, SQUARE], 0.0, 90.0)
    circle = QUICK.model_copy(update={"network_start": "circle"})
    start = make_start(problem, 7.0, circle)
    for count in (1, 57, 400):
        walked.append([])
        few = circle.model_copy(update={"coarse_iterations": count})
        search_module._approach(begin_search(problem, start, 7.0, few))
    assert walked[0] and walked[0] == walked[1] == walked[2]


def test_the_chamfer_pull_has_the_slope_that_it_says() -> None:
    problem = ask_views([DISC, SQUARE], 0.0, 90.0)
    t = 2 * np.pi * np.arange(60) / 60
    points = np.column_stack([52 * np.cos(t), 9 * np.sin(t), 50 + 8 * np.cos(2 * t)])
    far = Chamfer.for_views(problem.views, 3.0)
    _, gradient = term_at(far, points)
    way = np.random.default_rng(0).normal(size=points.shape)
    step = 1e-6
    ends = [term_at(far, points + s * step * way)[0] for s in (1, -1)]
    # tension is divided by the mean edge, which is held: take that part by hand
    assert (gradient * way).sum() == pytest.approx(
        (ends[0] - ends[1]) / (2 * step) + held(points, way, step), rel=1e-4
    )


def held(points: Array, way: Array, step: float) -> float:
    """What the mean edge's own change takes from the slope of the tension."""

    def edges(p: Array) -> Array:
        return np.asarray(np.linalg.norm(np.roll(p, -1, 0) - p, axis=1))

    here = edges(points)
    change = (edges(points + step * way).mean() - edges(points - step * way).mean()) / (2 * step)
    return float(TENSION * (here**2).sum() / (here.mean() ** 2 * 3.0) * change)
