"""Knots tied into a filling template: of the type that was asked for, out of sight, and never by chance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from questions import ask_heart, start_and_search
from shapely import MultiPolygon, Point, box
from tables import some

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.legs import peaks_of
from knotfab.geometry.polylines import sample_evenly
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.read_options import read_scene
from knotfab.problem import Problem, Start
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.start.filling import fill, simple_curves
from knotfab.start.profiles import lift
from knotfab.start.start import tie_knot
from knotfab.start.tie import KnotRoom, Tied, _poses, _sites, _splice, load_knot, tie
from knotfab_formats.errors import InputError
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.piece import Piece
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types
from tests.corpus.curves import circle

LIGHT = 400.0
DISC = MultiPolygon([Point(0, 0).buffer(60, quad_segs=32)])
TWO = MultiPolygon([Point(0, 0).buffer(50, quad_segs=32), box(70, -30, 90, 30)])
QUICK = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 96, "coarse_iterations": 25, "depth_candidates": 4},
        **{"fine_px": 128, "fine_iterations": 25},
    }
)


def room(polygon: MultiPolygon, radius: float = 2.5, deep: float = 80.0) -> KnotRoom:
    def outside(points: Array) -> float:
        return float(np.abs(points[:, 2]).max()) + radius - deep

    return KnotRoom(polygon, LIGHT, radius, radius + 0.2, outside)


def lift_filling(polygon: MultiPolygon, wave: float, radius: float = 2.5) -> tuple[Array, ...]:
    """The filling template with its strands up and down between -20 and 20 mm."""
    parts = []
    for curve in fill(polygon, radius).curves:
        depth = 20.0 * np.sin(np.arange(len(curve)) * wave)
        parts.append(sample_evenly(lift(curve, depth, LIGHT), 0.4 * radius))
    return tuple(parts)


def shadow(points: Array) -> Array:
    return np.asarray(points[:, :2] / (1.0 - points[:, 2:] / LIGHT))


def verdicts(tied: Tied, promise: str) -> list[str]:
    """Judge each curve: one is promised to be the knot, the others unknots."""
    types = ["unknot"] * len(tied.curves)
    types[tied.component] = promise
    curves = Curves(tied.curves, tuple(types), (True,) * len(types), 2.5)
    found = knot_types(curves)
    assert found.linking.state == "apart" or not found.linking.numbers
    return [knot.verdict for knot in found.knots]


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    some(
        ["trefoil", "left trefoil", "5_2", "left 7_4", "4_1", "8_18", "8_19", "square", "3_1#4_1"],
        3,
    ),
)
def test_the_knot_is_what_was_asked_for_and_out_of_sight(asked: str) -> None:
    name = parse_knot_name(asked)
    before = lift_filling(DISC, 0.02)
    tied = tie(before, name.factors, room(DISC))
    assert set(verdicts(tied, name.promise)) <= {"proved", "consistent"}
    assert tied.spill == 0.0
    strands = shadow(tied.curves[0])
    assert not simple_curves([strands])
    # new strands stay a tube's radius within the outline, but for the grid of distances
    rows = {row.tobytes() for row in before[0]}
    new = np.array([row.tobytes() not in rows for row in tied.curves[0]])
    assert 0.1 * len(new) > new.sum() - 60 > 0
    assert shapely.contains_xy(DISC.buffer(-1.9), *strands[new].T).all()


@pytest.mark.parametrize("stands", [False, True])
def test_where_strands_stand_on_the_bed_the_knot_does_too(stands: bool) -> None:
    (curve,) = fill(DISC, 2.5).curves
    before = sample_evenly(lift(curve, 45.0 * np.cos(curve[:, 0] / 12.0), LIGHT), 1.0)
    knot = parse_knot_name("trefoil").factors
    tied = tie((before,), knot, replace(room(DISC), stands=stands))
    assert set(verdicts(tied, "3_1")) <= {"proved", "consistent"}
    rows = {row.tobytes() for row in before}
    new = np.array([row.tobytes() not in rows for row in tied.curves[0]])
    height = tied.curves[0][:, 2]
    valleys = [height[k] for k in peaks_of(-height) if new[k]]
    assert (np.abs(np.array(valleys) - before[:, 2].min()).max() < 2.5) == stands


def test_the_wrong_hand_is_refuted() -> None:
    """The check on which the others rest can fail."""
    tied = tie(lift_filling(DISC, 0.02), parse_knot_name("trefoil").factors, room(DISC))
    assert verdicts(tied, "left-handed 3_1") == ["refuted"]
    assert verdicts(tied, "unknot") == ["refuted"]


def test_without_factors_nothing_is_changed() -> None:
    before = lift_filling(DISC, 0.02)
    assert tie(before, (), room(DISC)).curves == before


def test_the_longest_curve_gets_the_knot_and_the_others_stay() -> None:
    before = lift_filling(TWO, 0.03)
    tied = tie(before, parse_knot_name("5_1").factors, room(TWO))
    longest = int(np.argmax([len(c) for c in before]))
    assert tied.component == longest
    for k, curve in enumerate(before):
        assert (tied.curves[k] is curve) == (k != longest)
    assert set(verdicts(tied, "right-handed 5_1")) == {"proved"}


@pytest.mark.slow
@pytest.mark.parametrize("wave", [0.005, 0.05, 0.11])
def test_any_depth_of_the_strands_will_do(wave: float) -> None:
    tied = tie(lift_filling(DISC, wave), parse_knot_name("6_2").factors, room(DISC))
    assert verdicts(tied, "right-handed 6_2") == ["proved"]


def test_a_knot_too_large_for_the_picture_keeps_its_type() -> None:
    bar = MultiPolygon([box(-60, -5, 60, 5)])
    tied = tie(lift_filling(bar, 0.05), parse_knot_name("7_4").factors, room(bar))
    assert tied.spill > 0
    assert verdicts(tied, "right-handed 7_4") == ["proved"]


def test_where_there_is_no_room_in_depth_the_error_says_so() -> None:
    with pytest.raises(SceneError, match="the knot 5_2: the piece has no place for it") as error:
        tie(lift_filling(DISC, 0.02), parse_knot_name("5_2").factors, room(DISC, deep=25.0))
    assert error.value.exit_code == 1


def test_a_strand_in_the_way_of_every_knot_forbids_it() -> None:
    """Far in front and far behind there is another strand: a knot goes before or behind both, or not."""
    planar = fill(DISC, 2.5).curves[0]
    before = lift_filling(DISC, 0.02)
    hoods = tuple(
        sample_evenly(lift(planar, np.full(len(planar), z), LIGHT), 1.0) for z in (60.0, -60.0)
    )
    # the hoods' shadows lie on the template's own: not simple from the light, so nothing is proved
    with pytest.raises(SceneError, match="no place"):
        tie((before[0], *hoods), parse_knot_name("3_1").factors, room(DISC, deep=200.0))


def test_a_knot_among_the_strands_is_not_taken_for_proved() -> None:
    curve, disc = lift_filling(DISC, 0.02)[0], room(DISC)
    plain = np.ones(len(curve), dtype=bool)
    knot = load_knot("3_1") * disc.unit
    site = next(iter(_sites(curve, [], plain, _poses(knot, disc.unit), disc)))
    assert _splice(curve, [], plain, site, disc) is not None
    sunk = replace(site, points=site.points - [0.0, 0.0, 3.0 * disc.unit * site.side])
    assert _splice(curve, [], plain, sunk, disc) is None
    # nor is one that some other curve passes in front of
    x, y = shadow(site.points).mean(axis=0)
    height = float(site.side * (site.side * site.points[:, 2]).max())
    ring = np.column_stack([circle(5.0, 40)[:, :2] + [x, y], np.full(40, height)])
    assert _splice(curve, [ring], plain, site, disc) is None


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart(Scene(piece=Piece(knot="left trefoil")))


@pytest.mark.slow
def test_the_search_keeps_the_type_and_costs_no_iou(problem: Problem) -> None:
    assert problem.knot == "left trefoil"
    tied = start_and_search(problem, 4.0, QUICK)
    plain = start_and_search(replace(problem, knot="unknot"), 4.0, QUICK)
    assert [k.type for k in tied.knots.knots] == ["left-handed 3_1"]
    assert [k.type for k in plain.knots.knots] == ["unknot"]
    assert tied.feasible and tied.log.certified
    assert "left-handed 3_1 tied into knot 0" in tied.log.template
    assert tied.iou_estimate > plain.iou_estimate - 0.005
    curves = Curves((tied.knots.knots[0].points,), ("left-handed 3_1",), (True,), 4.0)
    assert knot_types(curves).knots[0].verdict == "proved"


@pytest.mark.slow
def test_a_flat_piece_holds_a_knot_too(problem: Problem) -> None:
    short = QUICK.model_copy(update={"coarse_iterations": 10, "fine_iterations": 5})
    flat = start_and_search(replace(problem, depth_mm=None, knot="4_1"), 3.0, short, repairs=0)
    curves = Curves((flat.knots.knots[0].points,), ("4_1",), (True,), 3.0)
    assert knot_types(curves).knots[0].verdict == "proved"


@pytest.mark.slow
def test_a_knot_is_tied_only_where_a_view_sees_the_curve_simple(problem: Problem) -> None:
    ring = Start((circle(20.0, 60),), "simple from a side that is no view's", facing=None)
    with pytest.raises(ValueError, match="sees the curve simple"):
        tie_knot(problem, ring, 2.0)
    assert tie_knot(replace(problem, knot="unknot"), ring, 2.0) is ring


def test_the_scene_names_the_knot(tmp_path: Path) -> None:
    scene = parse_scene('[piece]\nknot = "8_19"\n')
    assert scene.piece.knot == "8_19"
    assert 'knot = "8_19"' in dump_scene(scene)
    assert Scene().piece.knot == "unknot"
    assert read_scene(BuildOptions(knot="left trefoil"))[0].piece.knot == "left trefoil"
    file = tmp_path / "scene.toml"
    file.write_text('[piece]\nknot = "4_1"\n')
    assert read_scene(BuildOptions(scene=file))[0].piece.knot == "4_1"
    assert read_scene(BuildOptions(scene=file, knot="unknot"))[0].piece.knot == "unknot"
    for call in (
        lambda: read_scene(BuildOptions(knot="slip knot")),
        lambda: parse_scene("[piece]\nknot = '9_1'"),
    ):
        with pytest.raises(InputError, match="no such name"):
            call()
    with pytest.raises(InputError, match="text"):
        parse_scene("[piece]\nknot = 3\n")


def test_the_named_knots_are_those_that_are_tied() -> None:
    """The tied part is the named knot itself: at its own scale it is found among the vertices."""
    name = parse_knot_name("8_19")
    tied = tie(lift_filling(DISC, 0.02), name.factors, room(DISC))
    size = np.ptp(load_knot("8_19"), axis=0).max() * 2.7 * 1.03
    away = np.linalg.norm(tied.curves[0] - tied.place, axis=1)
    assert (away < size).sum() > 60.0 / 0.4
