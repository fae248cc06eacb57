"""A piece that cannot be held where it is is searched again, where the scene leaves that open."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pieces import PLA, PLATE, VIEW, camera, knots, ring
from reports import REPORT, report_with
from shapely import MultiPolygon, box

import knotfab.pipeline.plan as planning
from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.candidates import line_radius, most_radius, usual_radii
from knotfab.design.design import design_knots
from knotfab.design.frames import frame_view
from knotfab.design.room import depth_extent, resolve_region
from knotfab.design.sentence import OPEN_HOLDER
from knotfab.hold.beams import Stiffness
from knotfab.hold.roots import NoWayError
from knotfab.hold.wall import NotHeldError, plan_wall, sag_on_pegs
from knotfab.knots import Knot, Knots
from knotfab.picture.read import Target, read_target
from knotfab.pipeline.finish import tell_unlike_preview
from knotfab.pipeline.plan import plan_places, plan_supports
from knotfab.pipeline.settle import (
    AIM,
    LEAST_PEG_MM,
    SHARES,
    Place,
    _move_knots,
    propose_place,
    tell_depth,
)
from knotfab.pipeline.workshop import Workshop
from knotfab.plan import Attempts
from knotfab.report.rows import list_rows
from knotfab.request import Promise, Request
from knotfab.scene.camera import camera_of, view_axes
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab_formats.piece import Mount, Piece, Region
from knotfab_formats.scene import ResolvedView, Scene

MESSAGE = "it sags 1.00 mm on its pegs, 0.2 are allowed"


@dataclass
class Maker:
    """Designs and parts of two rings, which nothing holds farther from the wall than `holds_mm`.

    Of the designs, numbered as they are asked for, `unmade` are none, `unbuilt` have no part, and with
    all that may help each sags by its `sags` mm, by default by as much as is allowed.
    """

    target: Target
    holds_mm: float
    sags: tuple[float, ...] = ()
    unmade: tuple[int, ...] = ()
    unbuilt: tuple[int, ...] = ()
    asked: list[Scene] = field(default_factory=list)
    thoroughly: list[bool] = field(default_factory=list)

    def design(self, scene: Scene, *_: Any) -> Any:
        number = len(self.asked)
        self.asked.append(scene)
        if number in self.unmade:
            raise SceneError("the picture", "nothing draws it", "Use another")
        piece = scene.piece
        depth = piece.depth or 90.0
        radius = piece.tube_radius_mm or 0.8
        half = 0.5 * depth - 3.0
        curves = (ring(12.0, half, 40, 3.0), ring(20.0, -half, 60, 3.0))
        view = frame_view(scene.views[0], self.target)
        return Made(
            SimpleNamespace(
                piece=piece,
                views=(view,),
                material=scene.material,
                mount=scene.mount,
                printer=SimpleNamespace(min_tube_radius_mm=0.8, process="resin"),
            ),
            Knots(tuple(Knot(c) for c in curves), radius),
            number,
        )

    def part(self, made: Any, *_: Any, thoroughly: bool) -> Any:
        self.thoroughly.append(thoroughly)
        if made.number in self.unbuilt:
            raise SceneError("the printer", f"it does not hold number {made.number}", "")
        if not thoroughly and made.scene.views[0].wall_distance_mm > self.holds_mm:
            raise NotHeldError("the wall mount", MESSAGE, "")
        sag = self.sags[made.number] if thoroughly and self.sags else 0.2
        limit = SimpleNamespace(mount=SimpleNamespace(max_sag_mm=0.2))
        mounted = SimpleNamespace(wall=SimpleNamespace(sag_mm=sag), scene=limit)
        return SimpleNamespace(pose=SimpleNamespace(weighed=None), mounted=mounted)


@dataclass(frozen=True)
class Made:
    """The attributes of a design that settling asks for."""

    scene: Any
    knots: Knots
    number: int = 0
    radius: str | None = None


@pytest.fixture(scope="module")
def target() -> Target:
    return read_target("text:i")


def run(
    target: Target, scene: str, holds_mm: float, patch: pytest.MonkeyPatch, **keys: Any
) -> tuple[Maker, Any]:
    """What is asked for a scene, and what is said of it."""
    maker = Maker(target, holds_mm)
    made, said = settle(maker, scene, patch, **keys)
    if len({scene.views[0].wall_distance_mm for scene in maker.asked}) == 1:
        assert made.radius == "chosen"  # how it was chosen is told, not that it was then given
    return maker, said


def settle(maker: Maker, scene: str, patch: pytest.MonkeyPatch, **keys: Any) -> tuple[Any, Any]:
    """The design that is kept, and what is said of it."""

    def plan_searches(*asked: Any) -> Any:
        return maker.design(*asked)
        yield

    patch.setattr(planning, "plan_searches", plan_searches)
    patch.setattr(planning, "part_of", maker.part)
    request = Request(resolve(parse_scene(scene)), (), Path("out"), **{"printing": True, **keys})
    first = replace(maker.design(request.scene), radius="chosen")
    attempts = Attempts(Progress("quiet"))
    made, _, said = attempts.carry_out(
        plan_places(request, [maker.target], first, attempts.progress)
    )
    assert len(attempts.made) == len(maker.thoroughly)
    return made, said


def test_a_piece_that_came_out_deeper_than_asked_says_so(target: Target) -> None:
    made = Maker(target, 100.0).design(parse_scene(""))  # its centre lines take some 87 mm
    (said,) = tell_depth(5.0, made)
    assert "5 mm was asked for" in said and "--tube-radius" in said
    assert not tell_depth(85.0, made) and not tell_depth(None, made)


def test_a_piece_that_is_held_is_left_as_it_is(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 100.0, monkeypatch)
    assert (len(maker.asked), maker.thoroughly, said) == (1, [False], None)


def test_what_pegs_do_not_hold_is_searched_nearer_to_its_wall(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 99.0, monkeypatch)
    _, again = maker.asked
    assert maker.thoroughly == [False, False]
    assert again.views[0].wall_distance_mm < 99.0
    assert said.unheld == MESSAGE and said.wall_mm == (100.0, again.views[0].wall_distance_mm)
    assert said.from_mm == pytest.approx(90.0) and said.to_mm <= said.from_mm
    assert again.piece.depth == pytest.approx(said.to_mm, abs=0.1)
    # the piece is larger there: its tube is chosen anew
    assert again.piece.tube_radius_mm is None


def test_it_is_searched_no_oftener_than_that(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 0.0, monkeypatch)
    assert 2 <= len(maker.asked) <= 1 + planning.ROUNDS and said.unheld == MESSAGE
    assert maker.thoroughly[-1] and not any(maker.thoroughly[:-1])


@pytest.mark.parametrize(
    ("how", "kept"),
    [
        ({"unmade": (1,)}, 0),  # the first search anew finds nothing
        ({"unbuilt": (1,)}, 0),  # the flatter piece does not fit the printer
        ({"sags": (0.5, 0.9, 0.9)}, 0),
        ({"sags": (0.9, 0.5, 0.5)}, -1),
        ({"sags": (0.1, 0.2, 0.2)}, -1),  # a piece that holds is not made as if it did not
        ({"unbuilt": (0,), "sags": (0.0, 0.9, 0.9)}, None),
    ],
    ids=["unmade", "unbuilt", "sags more", "sags less", "holds", "none"],
)
def test_the_first_design_is_kept_until_a_better_one_is_known(
    how: dict[str, Any], kept: int | None, target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker = Maker(target, 0.0, **how)
    if kept is None:  # a piece without a part for another reason is not searched again
        with pytest.raises(SceneError, match="number 0"):
            settle(maker, "", monkeypatch)
        assert len(maker.asked) == 1
        return
    made, said = settle(maker, "", monkeypatch)
    assert len(maker.asked) > 1 and maker.thoroughly[-1]
    if kept == 0:
        assert made.number == 0 and made.radius == "chosen" and said is None
    else:
        assert made.number == len(maker.asked) - 1 and said.unheld == MESSAGE


@pytest.mark.parametrize(("unmade", "kept_mm"), [((), 45.0), ((1,), 90.0)])
def test_less_depth_for_supports_is_taken_where_it_is_found(
    unmade: tuple[int, ...], kept_mm: float, target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker = Maker(target, 100.0, unmade=unmade)
    asks = {0: 45.0}  # the supports of the first design alone
    monkeypatch.setattr(planning, "propose_depth", lambda made, _: asks.get(made.number))
    made, said = settle(maker, "", monkeypatch)
    assert [scene.piece.depth for scene in maker.asked] == [None, 45.0]
    assert (said.from_mm, said.to_mm) == pytest.approx((90.0, kept_mm))
    assert said.proposed_mm == asks.get(made.number) and not said.unheld
    assert maker.thoroughly == [False] * (2 - len(unmade))  # a piece that holds is not made twice
    assert {scene.views[0].wall_distance_mm for scene in maker.asked} == {100.0}


@pytest.mark.parametrize(
    ("scene", "soft_mm", "lower"),
    [
        ("[mount]\nplate = 'rounded'", 0.19, []),
        ("[mount]\nplate = 'rounded'", 0.4, [73.7]),
        ("[mount]\nplate = 'rounded'\n[piece]\ndepth = 90.0", 0.4, []),
        ("[mount]\nplate = 'rounded'\n[[views]]\nwall_distance_mm = 60.0", 0.4, []),
    ],
    ids=["firm", "sags", "depth given", "wall given"],
)
@pytest.mark.parametrize("no_way", [False, True])
def test_what_sags_on_its_feet_is_searched_lower(
    scene: str,
    soft_mm: float,
    lower: list[float],
    no_way: bool,
    target: Target,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    maker = Maker(target, np.inf)

    def part(made: Any, *_: Any, thoroughly: bool) -> Any:
        found = Maker.part(maker, made, thoroughly=thoroughly)
        if no_way and made.number == len(lower) and not hasattr(made.scene, "rounded"):
            raise NoWayError("roots", "no shadow leads there", "")
        found.mounted.wall.sag_mm = soft_mm * (np.ptp(made.knots.points[:, 2]) / 90.0) ** 4
        return found

    def round_off(scene: Any) -> Any:
        return SimpleNamespace(**vars(scene), rounded=True)

    maker.part = part  # type: ignore[method-assign]
    monkeypatch.setattr(planning, "on_rounded", round_off)
    made, said = settle(maker, scene, monkeypatch)
    assert [one.piece.depth for one in maker.asked[1:]] == pytest.approx(lower, abs=0.1)
    assert made.number == len(lower) and hasattr(made.scene, "rounded") == no_way
    if lower:
        assert said.unheld.startswith("it sags 0.40 mm on its feet")
        assert (said.from_mm, said.to_mm) == pytest.approx((90.0, lower[-1]), abs=0.1)
    else:
        assert said is None


def test_no_part_at_all_has_the_first_design_s_reason(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker = Maker(target, 0.0, unbuilt=(1, 2))

    def part(made: Any, *_: Any, thoroughly: bool) -> Any:
        if made.number == 0 and thoroughly:
            raise SceneError("the wall mount", "no ray is free", "")
        return Maker.part(maker, made, thoroughly=thoroughly)

    maker.part = part  # type: ignore[method-assign]
    with pytest.raises(SceneError, match="no ray is free"):  # beside whose knots it is written
        settle(maker, "", monkeypatch)


@pytest.mark.parametrize(
    ("scene", "keys"),
    [
        ("[piece]\ndepth = 90.0\n[[views]]\nwall_distance_mm = 100.0", {}),
        ("", {"time_budget_s": 60.0}),
        ("", {"printing": False}),
        ("[search]\nstart = 'knots.json'", {}),
        ("[piece]\ndepth = 90.0\n[search]\nfree_view = true", {}),
    ],
    ids=["given", "time", "not printed", "start", "free view"],
)
def test_what_is_given_is_not_overruled(
    target: Target, scene: str, keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, scene, 0.0, monkeypatch, **keys)
    assert (len(maker.asked), maker.thoroughly, said) == (1, [True], None)


@pytest.mark.parametrize(("depth", "mm"), [("90.07", 90.07), ("'flat'", 0.0)])
def test_a_depth_that_is_given_stays_before_a_nearer_wall(
    depth: str, mm: float, target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, f"[piece]\ndepth = {depth}", 99.0, monkeypatch)
    assert len(maker.asked) == 2 and said.wall_mm[1] < 99.0
    assert {scene.piece.depth for scene in maker.asked} == {mm}


@pytest.mark.slow
def test_a_free_view_moves_its_wall_itself(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    maker, said = run(target, "[search]\nfree_view = true", 0.0, monkeypatch)
    assert all("wall_distance_mm" not in s.views[0].model_fields_set for s in maker.asked)
    assert len(maker.asked) > 1 and said.to_mm < said.from_mm


@pytest.mark.slow
def test_what_was_moved_to_its_wall_repeats_from_its_scene() -> None:
    target = read_target("text:=")
    few = ("coarse_px", "fine_px"), ("coarse_iterations", "fine_iterations", "settle_iterations")
    keys = {**dict.fromkeys(few[0], 48), **dict.fromkeys(few[1], 2), "depth_candidates": 2}
    keys |= {"edge_radii": 0.75, "settle_edge_radii": 0.75, "radius_candidates": 2}
    lines = "".join(f"{key} = {value}\n" for key, value in keys.items())
    scene = parse_scene(
        f"[accuracy]\niou_floor = 0.1\n[search]\n{lines}[[views]]\nframe_width_mm = 60.0"
    )
    request = Request(resolve(scene), (), Path("out"), printing=True)
    far: Any = Maker(target, 0.0).design(scene)
    quiet = Progress("quiet")
    made = Attempts(quiet).carry_out(
        planning.search_again(request, [target], far, Place(20.0, 60.0), quiet, "")
    )
    assert made.scene.views[0].wall_distance_mm == 60.0 and made.scene.piece.depth == 20.0
    again = design_knots(resolve(parse_scene(dump_scene(made.scene))), [target])
    assert again.scene == made.scene
    for one, other in zip(made.knots.knots, again.knots.knots, strict=True):
        assert np.array_equal(one.points, other.points)


@pytest.mark.slow
def test_a_wall_that_is_given_stays_where_it_is(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "[[views]]\nwall_distance_mm = 100.0", 0.0, monkeypatch)
    assert {scene.views[0].wall_distance_mm for scene in maker.asked} == {100.0}
    assert said.to_mm < said.from_mm


KEPT = Promise(2.0, "in roots", 50.0, 5.0, 3000.0)


@pytest.mark.parametrize(
    ("promise", "told"),
    [
        (None, None),
        (KEPT, None),
        (replace(KEPT, radius_mm=1.93, grams=55.0, hours=4.5), None),
        (replace(KEPT, holder=OPEN_HOLDER, hours=None), None),
        (replace(KEPT, radius_mm=0.9), "4.0 mm thick, and not 1.8 mm (--tube-radius 0.90"),
        (replace(KEPT, holder="in a rounded plate"), "it is in roots, and not in a rounded plate"),
        (replace(KEPT, hours=4.2), "it takes 50 g and 5.0 h, and not 50 g and 4.2 h"),
        (replace(KEPT, grams=60.0), "it takes 50 g and 5.0 h, and not 60 g and 5.0 h"),
        (replace(KEPT, told=0.4), None),
        (replace(KEPT, told=0.2), "unlit it tells 0.50 of its picture, and not 0.20"),
    ],
)
def test_the_first_line_says_what_is_not_as_the_preview_told_and_why(
    promise: Promise | None, told: str | None
) -> None:
    printed = {**REPORT["print"], "filament_g": 50.0, "time_s": 18000.0}
    plate = Mount(kind="wall", plate="roots")
    scene = resolve(Scene(mount=plate, piece=Piece(printed=True)))
    from_below = {"share": 0.5, "azimuth": 0.0, "elevation": -30.0}
    views = [{"told": {"worst": from_below, "door": 0.3, "of": "knots"}}]
    longer = tell_unlike_preview(promise, report_with(print=printed, views=views), scene, 2.0)
    again = {
        "what": "search", "seconds": 1.0, "cpu_s": 1.0, "outcome": "", "why_next": "a leg sways",
    }  # fmt: skip
    built = report_with(print=printed, attempts=[again], warnings=longer, views=views)
    swaying = tell_unlike_preview(promise, built, scene, 2.0)
    assert bool(longer) == bool(swaying) == (told is not None)
    light = report_with(print={**printed, "filament_g": 0.6, "time_s": 250.0})
    tiny = replace(KEPT, grams=0.3, hours=0.02)  # both are less than anybody is told
    assert not tell_unlike_preview(tiny, light, scene, 2.0)
    if told is not None:
        assert told in longer[0] == list_rows(built)[0].text.removesuffix(".")
        assert "3912 mm long, where 3000 mm are usual" in longer[0]
        assert told in swaying[0] and swaying[0].endswith("are usual, since a leg sways")


@dataclass(frozen=True)
class Tried:
    """An attempt that comes to its name, or fails."""

    what: str
    why: str = ""
    fails: bool = False

    def make(self) -> str:
        if self.fails:
            raise SceneError(self.what, "it breaks", "Take another")
        return self.what

    def judge(self, made: str) -> str:
        return f"{made} made"


def test_attempts_are_told_in_order_with_what_came_of_each() -> None:
    """What fails is thrown into the plan, which may go on; what follows says why."""

    def plan() -> Any:
        with pytest.raises(SceneError, match="it breaks"):
            yield Tried("a stand", fails=True)
        return (yield Tried("a wall mount", why="a stand breaks")), (yield Tried("a piece"))

    attempts = Attempts(Progress("quiet"))
    assert attempts.carry_out(plan()) == ("a wall mount", "a piece")
    told = [(one.what, one.outcome, one.why_next) for one in attempts.made]
    assert told == [
        ("a stand", "a stand: it breaks", "a stand breaks"),
        ("a wall mount", "a wall mount made", None),
        ("a piece", "a piece made", None),
    ]


@pytest.mark.parametrize("otherwise", [True, False])
def test_the_slicers_supports_are_an_attempt_of_the_same_plan(
    tmp_path: Path, otherwise: bool
) -> None:
    """What was written first is gone when they are tried; without a second way the error is the build's."""
    way = resolve(parse_scene('[piece]\nsupports = "none"'))
    other = resolve(parse_scene('[piece]\nsupports = "slicer"')) if otherwise else None
    request = Request(way, (), tmp_path / "out", otherwise=other)
    attempts, seen, forgotten = Attempts(Progress("quiet")), list[Request](), list[str]()

    def plan(shop: Workshop, asked: Request, why: str) -> Any:
        seen.append(asked)
        assert not list(shop.folder.work.iterdir())
        shop.folder.write("table-1.3mf", "of the first")
        first = asked.scene.piece.supports == "none"
        return (yield Tried(f"a piece with supports {asked.scene.piece.supports}", why, first))

    def forget(name: str) -> Any:
        return SimpleNamespace(forget=lambda: forgotten.append(name))

    with OutputFolder(tmp_path / "out") as folder:
        tools = forget("verifier"), forget("slicer")
        shop = Workshop(folder, *tools, attempts.progress)
        if not otherwise:
            with pytest.raises(SceneError, match="it breaks"):
                attempts.carry_out(plan_supports(shop, request, plan))
            return
        made = attempts.carry_out(plan_supports(shop, request, plan))
    assert made == "a piece with supports slicer" and set(forgotten) == {"verifier", "slicer"}
    first, last = attempts.made
    broke = "a piece with supports none: it breaks"
    assert first.outcome == seen[1].why_supported == broke and seen[1].otherwise is None
    assert first.why_next == f"built again with the slicer's supports, for without them {broke}"
    assert last.why_next is None


# A piece that its pegs do not hold is moved to its wall, and made flatter if that is not enough.


LOOSE = Knots(knots(ring(12.0, 30.0, 40, 3.0), ring(20.0, -30.0, 60, 3.0)).knots, 0.8)
DEPTH = float(np.ptp(LOOSE.points[:, 2]))
SQUARE = MultiPolygon([box(-70, -70, 70, 70)])
SOFT = replace(PLA, young_mpa=400.0)


def propose(
    stiffness: Stiffness,
    *,
    shallower: bool = True,
    nearer: bool = True,
    view: ResolvedView = VIEW,
    pieces: Knots = LOOSE,
    most: float = 0.8,
) -> Place | None:
    asks = {"shallower": shallower, "nearer": nearer}
    return propose_place(pieces, view, 0.4, stiffness, **asks, most_radius_mm=most)


def sag_at(place: Place, share: float, stiffness: Stiffness) -> float:
    moved, there = _move_knots(LOOSE, VIEW, share, place)
    return sag_on_pegs(moved, camera_of(there, 64, 64), 0.4, stiffness)


@pytest.mark.slow
def test_pegs_that_sag_before_a_far_wall_hold_before_a_near_one() -> None:
    with pytest.raises(NotHeldError, match=r"sags by \d\.\d\d mm on its pegs \(0\.2 allowed\)"):
        plan_wall(LOOSE, camera(), 0.4, PLA, PLATE, thoroughly=False)
    place = propose(PLA)
    assert place is not None and place.wall_mm < VIEW.wall_distance_mm
    share = next(s for s in SHARES if abs(s * DEPTH - place.depth_mm) <= 0.1)
    assert sag_at(place, share, replace(PLA, max_sag_mm=AIM * 0.2)) <= AIM * 0.2
    moved, there = _move_knots(LOOSE, VIEW, share, place)
    assert plan_wall(moved, camera_of(there, 90, 90), 0.4, PLA, PLATE).sag_mm <= 0.2


def test_only_a_softer_material_asks_for_less_depth() -> None:
    places = [propose(replace(PLA, young_mpa=e)) for e in (2300.0, 1000.0, 400.0)]
    depths = [place.depth_mm for place in places if place is not None]
    assert len(depths) == 3 and depths == sorted(depths, reverse=True) and depths[-1] < depths[0]
    for place in places:  # and it never touches its wall
        assert place is not None and place.wall_mm >= 0.5 * place.depth_mm + LEAST_PEG_MM


@pytest.mark.slow
def test_what_is_given_stays() -> None:
    assert propose(SOFT, shallower=False, nearer=False) is None
    near, flat = propose(SOFT, shallower=False), propose(PLA, nearer=False)
    assert near is not None and near.depth_mm == pytest.approx(DEPTH, abs=0.1)
    assert flat is not None and flat.wall_mm == VIEW.wall_distance_mm


def test_what_no_place_holds_is_moved_once_and_not_flattened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("knotfab.pipeline.settle.sag_on_pegs", lambda *_: 1.0)
    place = propose(PLA)
    assert place is not None and place.depth_mm == pytest.approx(DEPTH, abs=0.1)
    moved, there = _move_knots(LOOSE, VIEW, 1.0, place)
    for aside in (0.0, 0.5):  # the strands that a search lays there are as deep, about
        view = there.model_copy(update={"wall_distance_mm": there.wall_distance_mm + aside})
        assert propose(PLA, view=view, pieces=moved) is None
    assert propose(PLA, nearer=False) is None


@pytest.mark.parametrize(
    ("frame_mm", "radius", "depth_mm", "keys"),
    [
        (180.0, 4.0, 100.0, {}),
        (300.0, 3.06, 168.0, {"wall_distance_mm": 150.0}),
        (300.0, 5.0, 117.0, {}),
        (420.0, 4.0, 230.0, {"wall_distance_mm": 200.0}),  # the lamp is what is near
        (180.0, 2.0, 110.0, {"thicken_mm": 5.0, "lines": True}),
    ],
)
@pytest.mark.parametrize("share", SHARES[::2])
def test_the_proposed_wall_has_room_for_depth_and_any_tube(
    frame_mm: float,
    radius: float,
    depth_mm: float,
    keys: dict[str, Any],
    share: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    view = VIEW.model_copy(update={"frame_width_mm": frame_mm, "frame_height_mm": frame_mm, **keys})
    half = 0.5 * depth_mm - 3.0
    pieces = Knots(knots(ring(12.0, half, 40, 3.0), ring(20.0, -half, 60, 3.0)).knots, radius)
    most = most_radius(None, view, 0.8)
    sags = iter([1.0] * SHARES.index(share) + [0.0])
    monkeypatch.setattr("knotfab.pipeline.settle.sag_on_pegs", lambda *_: next(sags))
    place = propose(PLA, view=view, pieces=pieces, most=most)
    assert place is not None and place.wall_mm < view.wall_distance_mm
    there = view.model_copy(update={"wall_distance_mm": place.wall_mm})
    chosen = [line_radius(there)] if "lines" in keys else usual_radii([there], 0.8, 16)[0]
    for r in (radius, *chosen):
        region = resolve_region(Region(), [there], [], r)
        extent = depth_extent(place.depth_mm, SQUARE, region, r)
        assert r > most or extent == place.depth_mm
    assert max(chosen) <= most + 1e-6


@pytest.mark.parametrize("keys", [{}, {"azimuth_deg": 40.0, "elevation_deg": 20.0}])
def test_the_shadow_of_what_is_moved_stays(keys: dict[str, float]) -> None:
    view = VIEW.model_copy(update=keys)
    turned = Knots(tuple(Knot(k.points @ view_axes(view)) for k in LOOSE.knots), 0.8)
    place = propose(SOFT, view=view, pieces=turned)
    assert place is not None
    moved, there = _move_knots(turned, view, 0.5, place)
    assert pixels(moved, there) == pytest.approx(pixels(turned, view), abs=0.01)
    assert np.ptp(moved.points @ view_axes(view)[2]) == pytest.approx(0.5 * DEPTH)


def pixels(some: Knots, view: ResolvedView) -> Array:
    """Find where the light sends each vertex on a picture of 90 px."""
    p = camera_of(view, 90, 90).projection
    seen = some.points @ p[:, :3].T + p[:, 3]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def test_a_wall_that_leans_keeps_clear() -> None:
    view = VIEW.model_copy(update={"wall_tilt_deg": 15.0})
    place = propose(PLA, view=view)
    upright = propose(PLA)
    assert place is not None and upright is not None
    leans = place.wall_mm - 0.5 * place.depth_mm
    assert leans > upright.wall_mm - 0.5 * upright.depth_mm + 20.0


@pytest.mark.parametrize(
    ("height_mm", "up_mm"), [(180.0, 0.0), (60.0, 0.0), (180.0, 40.0), (180.0, -40.0)]
)
def test_a_leaning_wall_keeps_clear_of_all_before_the_frame(height_mm: float, up_mm: float) -> None:
    tilted = {"wall_tilt_deg": 10.0, "frame_height_mm": height_mm, "frame_up_mm": up_mm}
    view = VIEW.model_copy(update={"wall_distance_mm": 150.0, **tilted})
    place = propose(PLA, view=view)
    assert place is not None and place.wall_mm < 150.0
    there = camera_of(view.model_copy(update={"wall_distance_mm": place.wall_mm}), 90, 90)
    corners = there.corner + np.outer([0, 89.5], there.dv)
    near = 0.5 * place.depth_mm + LOOSE.radius_mm
    # the gap is that of the frame's nearest edge behind the deepest strand
    gap = -near - corners[:, 2].max()
    assert LEAST_PEG_MM <= gap < LEAST_PEG_MM + 3.0
