"""The frames of a sequence: one search after another, and what the first finds holds for all."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from command import knotfab, picture, refuse, square
from numpy.typing import NDArray
from oracles import assert_slope, state_at
from PIL import Image, ImageDraw
from questions import ask_views
from shapely import MultiPolygon, Point, affinity

from knotfab.base.arrays import Array
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design import film as chain
from knotfab.design.film import (
    Anchor,
    Chain,
    SequenceFrame,
    Tautness,
    Tie,
    Way,
    displace,
    frame_search,
    is_far,
    list_ties,
    list_ways,
    measure_motion,
    pick_first,
    pick_start,
    transport,
)
from knotfab.design.motion import find_leap, outline_motion, pair_pieces
from knotfab.design.question import Question, ask
from knotfab.design.radius import RadiusChoice
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.knots import Knots
from knotfab.limits.terms import Felt
from knotfab.picture.frames import read_frames
from knotfab.picture.read import Target
from knotfab.plan import Attempts
from knotfab.problem import Problem
from knotfab.scene.catalogue import resolve
from knotfab.search.objective import Term, Weights
from knotfab.search.search import search
from knotfab.search.state import SearchResult
from knotfab.start.start import make_start
from knotfab_formats.piece import Material, Piece, Sequence
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS, SearchSettings

# searched in a second, on small pictures
QUICK = {
    "coarse_px": 64, "fine_px": 64, "coarse_iterations": 12, "fine_iterations": 8, "settle_iterations": 8,
    "depth_candidates": 2,
}  # fmt: skip


def discs(folder: Path, sizes: Iterable[int]) -> tuple[Target, ...]:
    """A disc in the middle, of so many pixels' radius in each frame."""
    names = []
    for number, size in enumerate(sizes):
        image = Image.new("L", (128, 128), 255)
        ImageDraw.Draw(image).ellipse((64 - size, 64 - size, 64 + size, 64 + size), fill=0)
        names.append(str(folder / f"{number}.png"))
        image.save(names[-1])
    return read_frames(names)


def in_order(frames: Chain) -> list[SequenceFrame]:
    attempts = Attempts(Progress("quiet"))
    found = [attempts.carry_out(frames.plan(number)) for number in frames.order]
    return sorted(found, key=lambda frame: frame.number)


def test_the_frame_with_the_most_ink_is_searched_first(tmp_path: Path) -> None:
    """What one silhouette hides has no strands to come out with."""
    assert pick_first(discs(tmp_path, (20, 30, 40, 25))) == 2
    assert pick_first(discs(tmp_path, (40, 20, 40))) == 0
    # all but as much is as good, and the frames come in their order
    assert pick_first(discs(tmp_path, (50, 50, 51, 50))) == 2
    assert pick_first(discs(tmp_path, (60, 60, 60))) == 0


def test_a_frame_is_tied_to_what_is_known_on_either_side() -> None:
    """Frames come from frame 2 onwards, then back; the tie need not hold around the end of the sequence."""
    # so far the outlines of five frames move, the last back to the first
    outlines = [1.0, 10.0, 100.0, 1000.0, 10000.0]
    assert set(list_ties(3, {2}, outlines)) == {Tie(2, 100.0), Tie(2, 11011.0, loop=True)}
    assert set(list_ties(4, {2, 3}, outlines)) == {Tie(3, 1000.0), Tie(2, 10011.0, loop=True)}
    assert set(list_ties(1, {2, 3, 4}, outlines)) == {Tie(2, 10.0), Tie(4, 10001.0, loop=True)}
    # all are known, and one is to be searched again between its neighbours
    assert set(list_ties(2, set(range(5)), outlines)) == {Tie(1, 10.0), Tie(3, 100.0)}
    assert set(list_ties(0, set(range(5)), outlines)) == {Tie(1, 1.0), Tie(4, 10000.0, loop=True)}
    assert set(list_ties(1, {0}, [3.0, 5.0])) == {Tie(0, 3.0), Tie(0, 5.0, loop=True)}


def test_the_scene_says_whether_the_frames_are_bound_to_close(tmp_path: Path) -> None:
    targets = discs(tmp_path, (40, 36))
    for loop in (True, False):
        assert Chain(resolve(Scene(sequence=Sequence(loop=loop))), targets)._closing is loop


@pytest.mark.parametrize(("search", "given"), [({}, 0.004), ({"radius_give": 0.02}, 0.02)])
def test_frames_get_no_thicker_tube_than_draws_them_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, search: dict[str, float], given: float
) -> None:
    """What one frame could spare another may need: letters that turn into each other lost theirs."""
    seen: list[float] = []

    def choose(question: Question, settings: SearchSettings, knots: int) -> RadiusChoice:
        seen.append(settings.radius_give)
        return RadiusChoice(2.0, ())

    monkeypatch.setattr(chain, "choose_radius", choose)
    question = ask(resolve(Scene(search=search)), discs(tmp_path, (40, 36))[:1])
    settings = PRESETS["draft"].model_copy(update=search)
    assert chain.radius_for_all(question, (), settings)[0] == 2.0 and seen == [given]


@pytest.mark.slow
def test_the_view_is_found_with_the_first_frame_and_stays(tmp_path: Path) -> None:
    """Lamp and wall stand still while the frames change; and what was found can be repeated."""
    targets = discs(tmp_path, (40, 42))
    asked = Scene(piece=Piece(tube_radius_mm=12.0), search={**QUICK, "free_view": True})
    first, second = (frame.made for frame in in_order(Chain(resolve(asked), targets)))
    views = [made.scene.views[0] for made in (first, second)]
    found = {(v.light_distance_mm, v.wall_distance_mm) for v in views}
    assert len(found) == 1 and found != {(500.0, 100.0)}
    assert [v.name for v in views] == ["frame-01", "frame-02"]
    assert first.result.log.certified and second.result.log.certified
    assert min(made.result.iou_estimate for made in (first, second)) > 0.7
    # frame 2 has more ink, and is searched first
    frames = Chain(second.scene, targets)
    again = Attempts(Progress("quiet")).carry_out(frames.plan(frames.order[0]))
    assert again.number == 1
    assert np.array_equal(again.made.knots.points, second.knots.points)
    assert again.made.scene.views == second.scene.views


@pytest.mark.slow
def test_each_frame_has_its_own_floor_and_prices(tmp_path: Path) -> None:
    """The large disc alone lacks length: the limit has a price there, and none for the small disc."""
    targets = discs(tmp_path, (24, 40))
    material = Material(max_length_mm=250.0)
    asked = Scene(piece=Piece(tube_radius_mm=12.0), material=material, search=QUICK)
    first, second = (frame.made for frame in in_order(Chain(resolve(asked), targets)))
    assert first.binding == ()
    assert [price.limits for price in second.binding] == [("length",)]
    assert second.binding[0].needed[0] > 250.0 > second.knots.knots[0].length_mm
    floors = {made.scene.accuracy.iou_floor for made in (first, second)}
    assert len(floors) == 2  # the floor of each picture's own opening


@pytest.mark.slow
@pytest.mark.study
def test_pieces_apart_in_all_frames_are_knots_of_their_own(tmp_path: Path) -> None:
    names = []
    for number, at in enumerate((30, 50, 70)):
        image = Image.new("L", (128, 128), 255)
        pen = ImageDraw.Draw(image)
        pen.rectangle((4, 100, 124, 124), fill=0)
        pen.ellipse((40, at - 24, 88, at + 24), fill=0)
        names.append(str(tmp_path / f"{number}.png"))
        image.save(names[-1])
    asked = Scene(piece=Piece(tube_radius_mm=8.0), search=QUICK)
    frames = in_order(Chain(resolve(asked), read_frames(names)))
    sizes = {tuple(len(knot.points) for knot in frame.made.knots.knots) for frame in frames}
    assert len(sizes) == 1 and len(sizes.pop()) == 2
    for frame in frames:
        assert frame.made.result.log.certified and frame.made.result.feasible
        assert frame.made.result.iou_estimate > 0.85
    # the floor's knot stays where it is; the ball's goes 28 mm a frame
    middles = [[k.points[:, 1].mean() for k in frame.made.knots.knots] for frame in frames]
    ways = np.ptp(np.array(middles), axis=0)
    assert min(ways) < 5.0 < 35.0 < max(ways)


RADIUS = 5.0
SHORT = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 64,
        "fine_px": 96,
        "coarse_iterations": 20,
        "fine_iterations": 20,
        "settle_iterations": 20,
        "depth_candidates": 2,
    }
)
DISC = MultiPolygon([Point(-4, 0).buffer(30.0)])
MOVED = affinity.translate(DISC, 8.0, 3.0)


def ask_one(polygon: MultiPolygon) -> Problem:
    return replace(ask_views([polygon], 0.0), depth_mm=30.0)


@pytest.fixture(scope="module")
def first() -> SearchResult:
    """The first frame, from a template."""
    return search(ask_one(DISC), make_start(ask_one(DISC), RADIUS, SHORT), RADIUS, SHORT)


def rings_of(points: Array) -> Polylines:
    return polylines_of_sizes((len(points),))


def test_a_frame_follows_the_picture_within_its_bound(first: SearchResult) -> None:
    trefoil = replace(first.knots.knots[0], type="trefoil")
    before, rings = first.knots.points, rings_of(first.knots.points)
    assert first.feasible
    anchor = Anchor(before, outline_motion(DISC, MOVED) + RADIUS, RADIUS)
    problems = ask_one(DISC), ask_one(MOVED)
    terms = anchor, Tautness(1.1 * first.knots.knots[0].length_mm, RADIUS)
    start = Knots((trefoil,), RADIUS)  # the type goes along, whatever it is
    found = frame_search(start, "a known one", problems, SHORT, terms).make()
    assert found.feasible and anchor.kept(found.knots.points)
    assert found.knots.points.shape == before.shape  # the same vertices, in their order
    assert found.knots.knots[0].type == "trefoil"
    assert found.log.certified and found.log.resamplings == 0
    # a frame that had stayed would draw little of the new picture
    stayed = problems[1].views[0].image_at(RADIUS, 96).iou(before, rings, RADIUS)
    assert found.iou_estimate > max(0.93, stayed + 0.1)


def test_a_shift_takes_what_lies_near_the_wall_all_the_way(
    first: SearchResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There it goes farther than the picture at the middle of the piece, by which strands were cut short."""
    ways = []

    def carry(points: Array, rings: Polylines, *asked: Any) -> None:
        moved, light = transport(points, rings, *asked), asked[2]
        ways.append(((moved.points - points) * light / (light - points[:, 2:]), moved.reached))
        raise InterruptedError

    monkeypatch.setattr(chain, "transport", carry)
    knots = first.knots.knots[0]
    behind = Knots((replace(knots, points=knots.points - (0, 0, 60)),), RADIUS)
    problems = ask_one(DISC), ask_one(affinity.translate(DISC, 60))
    with pytest.raises(InterruptedError):
        frame_search(behind, "a known one", problems, SHORT, ()).make()
    ((way, share),) = ways
    assert share == 1 and np.allclose(way, (60, 0, 0), atol=1e-6)


def test_strands_that_the_picture_does_not_reach_are_far(first: SearchResult) -> None:
    points, light = first.knots.points, 500.0
    assert not is_far(points, rings_of(points), DISC, light, RADIUS)
    # a limb that is hidden behind the body in the new picture, and one that comes out
    limb = DISC.union(Point(45, 0).buffer(8.0))
    assert is_far(points, rings_of(points), MultiPolygon(limb.geoms), light, RADIUS)
    assert is_far(points + [25.0, 0.0, 0.0], rings_of(points), DISC, light, RADIUS)


def _legs(apart: int) -> NDArray[np.bool_]:
    """A body with two legs, so many pixels to either side."""
    mask = np.zeros((80, 80), dtype=bool)
    mask[5:40, 30:50] = True
    for foot in (-apart, apart):
        mask[40:75, 36 + foot : 44 + foot] = True
    return mask


def test_a_frame_begins_as_the_one_before_or_as_one_much_more_like_it() -> None:
    masks = [_legs(n) for n in (20, 14, 8, 2)]
    assert [pick_start(masks, k, k - 1, range(k)) for k in (1, 2, 3)] == [0, 1, 2]
    # going backwards it is as the one behind
    assert [pick_start(masks, k, k + 1, range(k + 1, 4)) for k in (2, 1, 0)] == [3, 2, 1]
    # legs that part again begin where they were apart
    masks = [_legs(n) for n in (20, 10, 0, 10, 20)]
    assert pick_start(masks, 3, 2, range(3)) == 1 and pick_start(masks, 4, 3, range(4)) == 0


BOUND, FREE, MORE = Way(0), Way(0, False), Way(0, False, 2.0)


def test_ways_lead_from_the_frame_most_alike_and_give_up_the_loop_before_the_picture() -> None:
    assert list_ways(0, 0, closes=True) == [BOUND, FREE, MORE]
    assert list_ways(0, 0, closes=False) == [FREE, MORE]
    assert list_ways(1, 2, closes=True) == [
        Way(1), Way(2), Way(1, False), Way(2, False), Way(2, False, 2.0)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ious", "unsound", "kept", "tried"),
    [
        ([0.98], (), BOUND, 1),
        ([0.8, 0.98], (), FREE, 2),
        ([0.7, 0.9, 0.8], (), FREE, 3),
        ([0.99, 0.8, 0.99], (0, 2), FREE, 3),  # limits come before the picture
        ([0.99, 0.8, 0.7], (0, 1, 2), BOUND, 3),
    ],
)
def test_the_first_way_that_serves_is_taken_else_the_best(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ious: list[float],
    unsound: tuple[int, ...],
    kept: Way,
    tried: int,
) -> None:
    frames = Chain(resolve(Scene(piece=Piece(tube_radius_mm=12.0))), discs(tmp_path, (40, 42)))
    asked: list[str] = []

    def pretend(*_: Any) -> Any:
        knots = SimpleNamespace(points=np.zeros((3, 3)))
        number = len(asked)
        asked.append(_[-1])
        found: Any = SimpleNamespace(
            iou_estimate=ious[number], feasible=number not in unsound, knots=knots
        )
        return SimpleNamespace(
            what="", why=_[-1], make=lambda: found, judge=lambda made: "", settings=None
        )

    def priced(made: Any, *_: Any) -> Any:
        yield from ()
        return made

    made: Any = SimpleNamespace(
        result=SimpleNamespace(iou_estimate=1.0, feasible=True),
        knots=SimpleNamespace(points=np.zeros((3, 3))),
    )
    monkeypatch.setattr(chain, "frame_search", pretend)
    monkeypatch.setattr(chain, "settle_design", lambda q, r, s: SimpleNamespace(result=r))
    monkeypatch.setattr(chain, "price_design", priced)
    monkeypatch.setattr(chain, "opening_iou", lambda *_: 0.96 + chain.POOR)
    question: Any = SimpleNamespace(problem=SimpleNamespace(polygons=[None]))
    vars(frames).update(
        _frames={0: SequenceFrame(0, made)}, _questions=[question, question],
        outlines_mm=[1.0, 1.0], _radius=12.0, _why="", _longest=[1.0, 1.0],
        _settings=PRESETS["sketch"],
    )  # fmt: skip
    found = Attempts(Progress("quiet")).carry_out(frames._plan(1, 0))
    assert (found.way, len(asked), found.quality[0]) == (kept, tried, len(unsound) < 3)
    assert asked[0] == "" and all(asked[1:])  # each further one says why


def _square(x: float, y: float, side: float) -> MultiPolygon:
    return MultiPolygon([shapely.box(x, y, x + side, y + side)])


def test_outline_motion_of_a_shifted_square() -> None:
    assert outline_motion(_square(0, 0, 10), _square(3, 0, 10)) == pytest.approx(3.0)
    # the corner that sticks out is a diagonal away from the other's corner
    assert outline_motion(_square(0, 0, 10), _square(3, 4, 10)) == pytest.approx(5.0)


def test_a_piece_goes_its_own_way_whatever_else_it_comes_near() -> None:
    """A ball that rises from a floor to a ceiling: either is nearer to it than where it was."""
    still = shapely.box(-50, -5, 50, 0), shapely.box(-50, 60, 50, 66)
    low, high = (MultiPolygon([*still, shapely.Point(0, y).buffer(10)]) for y in (10.1, 49.9))
    pairs = pair_pieces(low, high, 3)
    assert [one.equals(other) for one, other in pairs] == [True, True, False]
    assert outline_motion(low, high, 3) == pytest.approx(39.8, abs=0.1)
    assert outline_motion(low, high) < 25.0
    # where a piece is missing, all is one
    floor = MultiPolygon(still[:1])
    assert pair_pieces(low, floor, 3) == [(low, floor)]


def test_outline_motion_is_symmetric_and_sees_what_is_new() -> None:
    limb = shapely.box(9, 4, 30, 6)
    body, grown = _square(0, 0, 10), MultiPolygon([shapely.box(0, 0, 10, 10).union(limb)])
    assert outline_motion(body, grown) == pytest.approx(np.hypot(20, 0))
    assert outline_motion(grown, body) == outline_motion(body, grown)


def test_outline_motion_counts_holes() -> None:
    whole = shapely.box(0, 0, 20, 20)
    pierced = MultiPolygon([whole.difference(shapely.box(9, 9, 11, 11))])
    # the middle of a hole's side is 9 from the square's own outline
    assert outline_motion(MultiPolygon([whole]), pierced) == pytest.approx(9.0)


def test_the_widest_leap_is_what_no_shift_or_stretch_does() -> None:
    body, arm = shapely.box(0, 0, 10, 40), shapely.box(-30, 30, 10, 36)
    still, raised = MultiPolygon([body]), MultiPolygon([body.union(arm)])
    moved = affinity.scale(affinity.translate(raised, 90, 5), 1.2, 1.2)
    # the arm's end comes out of the body between the second frame and the third
    assert find_leap([still, still, raised, moved], 1) == (2, pytest.approx(30.0))
    assert find_leap([raised, moved], 1)[1] == pytest.approx(0.0, abs=1e-6)
    # each of two pieces goes its own way
    apart, pieces = _square(0, 60, 10), [[*still.geoms], [*affinity.translate(still, 50, 0).geoms]]
    frames = [MultiPolygon([*one, *apart.geoms]) for one in pieces]
    assert find_leap(frames, 2)[1] == pytest.approx(0.0, abs=1e-6)
    assert find_leap(frames, 1)[1] > 30.0


def test_outline_motion_of_circles() -> None:
    large, small = (MultiPolygon([shapely.Point(0, 0).buffer(r, 256)]) for r in (10, 7))
    assert outline_motion(large, small) == pytest.approx(3.0, abs=1e-3)
    assert outline_motion(large, large) == 0.0


def test_measure_holds_and_refuses() -> None:
    old = np.zeros((4, 3))
    new = old.copy()
    new[2] = (3.0, 0.0, 4.0)
    assert measure_motion(old, new, 3.5, 1.5).held
    found = measure_motion(old, new, 3.4, 1.5)
    assert not found.held
    assert (found.largest_mm, found.limit_mm) == (5.0, 4.9)


def _pull(term: Term, points: Array) -> Felt:
    """A term at the vertices (N, 3) of one closed polyline."""
    return term(state_at(points, 5.0), Weights())


def test_anchor_is_silent_within_its_bound() -> None:
    anchor = Anchor(np.zeros((5, 3)), 2.0, 1.5)
    loss, slope = _pull(anchor, np.full((5, 3), 1.0))
    assert loss == 0.0
    assert not slope.any()
    assert anchor.excess(np.full((5, 3), 1.0)) == pytest.approx(np.sqrt(3) - 2)
    assert anchor.kept(np.full((5, 3), 1.1)) and not anchor.kept(np.full((5, 3), 1.2))


def test_anchor_pulls_back_with_its_true_slope() -> None:
    rng = np.random.default_rng(3)
    anchor = Anchor(rng.normal(size=(6, 3)), 0.7, 1.3)
    assert_slope(lambda x: _pull(anchor, x), rng.normal(size=(6, 3)) * 2)
    _, slope = _pull(anchor, anchor.points)
    assert np.isfinite(slope).all()


def test_an_anchor_pulls_by_the_squared_radii_beyond_it() -> None:
    anchor = Anchor(np.zeros((4, 3)), 2.0, 1.3)
    at = np.zeros((4, 3))
    at[1] = (3.0, 0.0, 4.0)
    weights = Weights()
    expected = weights.hold * ((5.0 - 0.97 * 2.0) / 1.3) ** 2
    assert _pull(anchor, at)[0] == pytest.approx(expected)


def test_a_knot_is_drawn_taut_only_beyond_its_length() -> None:
    t = 2 * np.pi * np.arange(50) / 50
    ring = 10.0 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    length = float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())
    assert _pull(Tautness(length + 0.1, 1.5), ring)[0] == 0.0
    once, twice = (_pull(Tautness(length - d, 1.5), ring)[0] for d in (3.0, 6.0))
    assert 0 < once == pytest.approx(twice / 4)
    assert_slope(lambda x: _pull(Tautness(length - 3.0, 1.5), x), ring)
    _, slope = _pull(Tautness(length - 3.0, 1.5), ring)
    assert ((slope * ring).sum(axis=1) > 0).all()  # inwards is downhill


BODY = MultiPolygon([shapely.box(-30, -8, 30, 8).union(shapely.Point(0, 0).buffer(18))])


def _ring(radius: float, n: int = 120) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([radius * np.cos(t), radius * np.sin(t), 20 * np.sin(t)], axis=1)


def _iou(a: MultiPolygon, b: MultiPolygon) -> float:
    return float(a.intersection(b).area / a.union(b).area)


@pytest.mark.parametrize("kind", ["stay", "shift", "turn", "grow"])
@pytest.mark.slow
def test_a_displacement_takes_one_picture_to_the_other(kind: str) -> None:
    new = {
        "stay": BODY,
        "shift": affinity.translate(BODY, 9.0, 4.0),
        "turn": affinity.rotate(BODY, 20.0, origin=(0, 0)),
        "grow": affinity.scale(BODY, 1.2, 0.85, origin=(0, 0)),
    }[kind]
    body = BODY.segmentize(0.5)
    moved = shapely.transform(body, lambda p: p + displace(p, BODY, new, 12.0)).buffer(0)
    assert _iou(moved, new) > 0.97


def test_what_has_left_its_place_is_shifted_and_stretched() -> None:
    """A ball that falls and is squashed on the ground: every point goes where its own shape says."""
    ball = MultiPolygon([shapely.Point(0, 30).buffer(12.0)])
    squashed = affinity.translate(affinity.scale(ball, 1.35, 1 / 1.35), 0.0, -45.0)
    assert ball.disjoint(squashed)
    inside = np.array([[0.0, 30.0], [-8.0, 30.0], [3.0, 37.0], [11.9, 30.0], [0.0, 18.1]])
    away = inside - [0.0, 30.0]
    wanted = [0.0, -45.0] + away * [0.35, 1 / 1.35 - 1.0]
    np.testing.assert_allclose(displace(inside, ball, squashed, 8.0), wanted, atol=0.1)


def test_a_knot_goes_along_and_keeps_its_depth() -> None:
    old, new = BODY, affinity.translate(BODY, 8.0, 0.0)
    points, light = _ring(17.0), 500.0
    found = transport(points, polylines_of_sizes((120,)), old, new, light, 2.0, 20.0)
    assert found.reached == 1.0
    assert found.least_margin > 0
    np.testing.assert_allclose(found.points[:, 2], points[:, 2], atol=1e-9)
    # seen from the light, what was on the outline has gone along with it
    seen = found.points[:, :2] / (1 - found.points[:, 2:] / light)
    edge = new.buffer(2.5).difference(new.buffer(-3.5))
    assert shapely.contains_xy(edge, *seen.T).mean() > 0.8


def test_no_vertex_goes_further_than_allowed() -> None:
    points = _ring(17.0)
    new = affinity.translate(BODY, 12.0, 0.0)
    found = transport(points, polylines_of_sizes((120,)), BODY, new, 500.0, 2.0, 3.0)
    assert np.linalg.norm(found.points - points, axis=1).max() <= 3.0 + 1e-9


def test_strands_that_would_cross_stop_the_transport(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sides of a long loop pushed through each other: the way ends before they meet."""

    monkeypatch.setattr(chain, "displace", lambda at, *_: at * [0.0, -2.0])
    t = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    loop = np.stack([30 * np.cos(t), 3 * np.sin(t), np.zeros(160)], axis=1)
    found = transport(loop, polylines_of_sizes((160,)), BODY, BODY, 500.0, 1.0, 50.0)
    assert 0 < found.reached < 0.5
    assert found.refused > 0
    assert found.least_margin > 0
    # the upper side is still above
    assert (np.sign(found.points[1:80, 1]) == 1).all()


def test_each_of_two_knots_goes_with_its_own_piece() -> None:
    """One stays, one falls past where a smooth displacement of the whole would take both."""
    floor = shapely.box(-60, -8, 60, 8)
    old, new = (MultiPolygon([shapely.Point(0, y).buffer(20), floor]) for y in (90.0, 40.0))
    lying, ball = _ring(7.0, 60) * [6.0, 1.0, 0.2], _ring(17.0, 60) * [1.0, 1.0, 0.2] + [0, 90, 0]
    rings = polylines_of_sizes((60, 60))
    found = transport(np.concatenate([lying, ball]), rings, old, new, 500.0, 2.0, 60.0)
    assert found.reached == 1.0
    at_floor, fallen = rings.split(found.points)
    np.testing.assert_allclose(at_floor, lying, atol=0.3)
    np.testing.assert_allclose(fallen[:, :2].mean(0), [0.0, 40.0], atol=0.5)


# `knotfab build --sequence`: what it refuses, and that a new result leaves nothing of an older
# one.


CALL = ("build", "--sequence")
TWO_VIEWS = "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nazimuth_deg = 90.0\n"


def _frames(folder: Path, count: int = 2, size: int = 64) -> Path:
    """A folder of squares, each a pixel further to the right."""
    folder.mkdir()
    for number in range(1, count + 1):
        picture(folder / f"{number}.png", np.roll(square(size), number, axis=1))
    return folder


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--knots", "2"], "frame 1 has another number of pieces (1)"),
        (["--depth", "9999"], "towards the light"),
    ],
)
def test_what_makes_no_sense_with_a_sequence(tmp_path: Path, options: list[str], why: str) -> None:
    frames = _frames(tmp_path / "frames")
    assert why in refuse(2, *CALL, frames, "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_one_piece_has_no_loop_to_leave_open(tmp_path: Path) -> None:
    drawn = picture(tmp_path / "square.png", square())
    done = knotfab("build", drawn, "--no-loop", "--out", tmp_path / "out")
    assert done.code == 2 and "--no-loop" in done.err and "--sequence" in done.err
    assert not (tmp_path / "out").exists()


def test_a_scene_of_two_views_is_no_sequence(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TWO_VIEWS)
    frames = _frames(tmp_path / "frames")
    said = refuse(2, *CALL, frames, "--scene", scene, "--out", tmp_path / "out")
    assert "2 views" in said


def test_a_shorter_sequence_leaves_no_frames_of_the_one_before(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    old = ["part-01.stl", "part-02.3mf", "knots-02.json", "scene-02.toml", "zoetrope.stl"]
    old += ["plate-02-1.3mf", "setup-02.pdf", "bends-02.csv", "bends-02-1.csv"]
    old += ["bending-templates-a4-02.pdf", "drill-template-letter-02.pdf"]
    for name in [*old, "sequence.gif", "picture-frame-02.png", "report.json", "my-part-1.stl"]:
        (out / name).write_text("old")
    with OutputFolder(out) as folder:
        folder.write("part-01.stl", "new")
        folder.write("report.json", "new")
        folder.commit()
    assert {p.name for p in out.iterdir()} == {"part-01.stl", "report.json", "my-part-1.stl"}


def test_validate_names_the_frames_of_a_sequence(tmp_path: Path) -> None:
    (tmp_path / "part-01.stl").write_text("")
    done = knotfab("validate", tmp_path)
    assert done.code == 2
    assert "it holds a sequence" in done.err and "scene-01.toml" in done.err
