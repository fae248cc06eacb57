"""What a report says of supports, feet and bars, and of the way that was not taken."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reports import report_with, view_of_report
from solids import chain

from knotfab.geometry.legs import Bar
from knotfab.part.assemble import Standing
from knotfab.report.report import check_price
from knotfab.report.supports import list_ways, report_supports, sum_supports
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import parse_scene
from knotfab_formats.print_figures import Print, RootsFigures
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import Check, Told, ToldFrom

ACROSS = (106.0, 138.0)
# knight and heart, built and sliced both ways: the box; grams and hours in arches; grams, hours and grams of
# supports with the slicer's
BOTH = [
    ((108.5, 139.6, 90.2), (34.0, 4.77), (69.3, 8.85, 40.6)),
    ((134.8, 142.2, 91.4), (51.4, 5.70), (82.7, 10.02, 42.5)),
]


def scene(supports: str, more: str = "mount.kind = 'none'") -> ResolvedScene:
    return resolve(parse_scene(f"piece.supports = '{supports}'\n{more}"))


def sliced(grams: float, hours: float, supports: float = 0.0) -> Print:
    found = {"time_s": 3600 * hours, "filament_g": grams, "support_g": supports}
    return replace(report_with().print, bounding_box_mm=(*ACROSS, 90.0), **found)


@pytest.mark.parametrize(("box", "alone", "supported"), BOTH)
def test_the_other_way_is_guessed_within_a_tenth(box: Any, alone: Any, supported: Any) -> None:
    none, slicer = scene("none"), scene("slicer")
    taken, other = list_ways(replace(sliced(*alone), bounding_box_mm=box), none, none)
    assert (taken.grams, taken.hours, taken.way, other.way) == (*alone, "none", "slicer")
    grams, hours, held = supported
    assert (other.grams, other.hours) == pytest.approx((grams, hours), rel=0.1)
    assert other.support_grams == pytest.approx(held, rel=0.1)
    _, other = list_ways(sliced(grams, hours, held), slicer, slicer)
    assert (other.way, other.support_grams) == ("none", 0)
    assert (other.grams, other.hours) == pytest.approx(alone, rel=0.1)


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        ("max_hours = 8", "pass"),
        ("max_hours = 7", "fail"),
        ("max_grams = 80", "pass"),
        ("max_grams = 70", "fail"),
    ],
)
def test_what_the_slicer_says_is_held_against_the_limits(asked: str, status: str) -> None:
    limited = scene("none", f"piece.{asked}").piece
    (check,) = check_price(sliced(75.0, 7.5), limited)
    assert (check.status, check.required) == (status, True)
    assert ("--max-" in check.detail) == (status == "fail")
    (unsliced,) = check_price(report_with().print, limited)
    assert (unsliced.status, unsliced.required) == ("skipped", False)
    assert check_price(sliced(75.0, 7.5), scene("none").piece) == []


@pytest.mark.parametrize(
    ("more", "ways"),
    [
        ("mount.kind = 'none'\npiece.depth = 'flat'", 1),
        ("mount.kind = 'wall'", 0),
        ("mount.kind = 'hang'", 2),
    ],
)
def test_another_way_is_told_where_there_is_one(more: str, ways: int) -> None:
    slicer = scene("slicer", more)
    assert len(list_ways(sliced(50.0, 5.0, 20.0), slicer, slicer)) == ways


def test_supports_fill_no_more_room_for_a_wide_holder() -> None:
    framed = "views = [{frame_width_mm = 127.2, frame_height_mm = 165.6}]\n"
    none, wide = scene("none", framed + "mount.kind = 'none'"), (140.0, 200.0, 90.0)
    (_, one), (_, two) = (
        list_ways(replace(sliced(54.1, 7.47), bounding_box_mm=box), none, none)
        for box in ((*ACROSS, 90.0), wide)
    )
    assert one == two


def test_roots_are_cheaper_than_a_plate_and_what_tells_is_dearer() -> None:
    roots = scene("none", "mount.kind = 'wall'\nmount.plate = 'roots'")
    strips = RootsFigures(
        width_mm=7.0, thickness_mm=1.6, screws=(), tape="along", area_cm2=39.0, mass_g=7.8
    )
    made = replace(sliced(70.9, 9.5), roots=strips)
    taken, *others = list_ways(made, roots, roots)
    prices = [way.price for way in others]
    assert taken.way == "roots" and {way.way for way in others} == {"rounded", "slicer"}
    assert prices == sorted(prices) and taken.price == pytest.approx(9.5 + 70.9 / 20, abs=0.1)
    rounded = next(way for way in others if way.way == "rounded")
    # a plate of 112 x 144 mm, 1.2 mm thick, for roots of 7.8 g
    assert rounded.grams == pytest.approx(70.9 + 112 * 144 * 1.2 * 1.24e-3 - 7.8, abs=0.2)
    told = view_of_report(told=Told(worst=ToldFrom(0.5, 0.0, 30.0), door=0.3, of="knots"))
    assert list_ways(made, roots, roots, [told])[0].price == pytest.approx(taken.price + 5.0)
    assert list_ways(made, roots, roots, (), "coarse")[0].price > taken.price + 10


def standing_part(bars: int) -> Any:
    mesh = chain(arches=4).mesh
    along = np.array([1.0, 0.0, 0.0])
    made = tuple(Bar(k * along, (k + 2.0) * along, 2.0) for k in range(bars))
    bodies = [(mesh.vertices, mesh.faces), *(bar.make_body() for bar in made)]
    mounted = SimpleNamespace(scene=scene("none"))
    standing = Standing(0.8, made)
    return SimpleNamespace(bodies=bodies, mounted=mounted, standing=standing)


def request(asked: ResolvedScene, **more: Any) -> Request:
    return Request(asked, (), Path("out"), printing=True, **more)


def test_feet_and_bars_are_measured() -> None:
    tipping = Check("tipping", "pass", True, 42.0, 15.0, "deg", "")
    print_ = report_supports(
        sliced(57.0, 7.98), request(scene("none")), standing_part(3), [tipping]
    )
    feet, bars = print_.feet, print_.bars
    assert feet is not None and bars is not None
    assert (feet.count, feet.tip_deg) == (4, 42.0)
    assert feet.area_mm2 == pytest.approx(4 * feet.least_mm2, rel=0.05)
    assert (bars.count, bars.longest_mm) == (3, 2.0)
    # each is as long as its gap and what is sunk into the strands
    assert 3 * 2.0 * 0.8 * 0.4 < bars.grams * 1e3 / 1.24 < 3 * 4.0 * 0.8 * 0.4
    bare = report_supports(print_, request(scene("none")), standing_part(0), [])
    assert bare.bars is None and bare.feet is not None and bare.feet.tip_deg is None


def test_why_the_slicer_holds_it() -> None:
    slicer, free = scene("slicer"), {"bodies": [], "standing": None}
    part: Any = SimpleNamespace(**free, mounted=SimpleNamespace(scene=slicer))
    print_ = sliced(78.4, 9.83, 40.5)
    why = "legs failed: too slender"
    told = report_supports(print_, request(slicer, why_supported=why), part, [])
    assert told.supports is not None and told.supports.why == why
    assert (told.supports.asked, told.supports.way, told.supports.ways) == ("auto", "slicer", ())
    told = report_supports(print_, request(slicer), part, [])
    assert told.supports is not None and told.supports.why == "asked for"
    assert [(way.way, round(way.grams)) for way in told.supports.ways] == [
        ("slicer", 78),
        ("none", 45),
    ]
    # frames add up
    both = sum_supports([told.supports, told.supports])
    assert both is not None and both.grams == 2 * 78.4 and both.ways == ()
    resin: Any = SimpleNamespace(
        **free, mounted=SimpleNamespace(scene=resolve(parse_scene("[printer]\nname = 'form-3'")))
    )
    assert report_supports(print_, request(slicer), resin, []) == print_
