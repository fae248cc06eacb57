"""A piece that prints without supports: what must be rejected, what must pass, however it lies on the bed."""

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from solids import (
    LAYER,
    PLA,
    Part,
    blocks,
    box,
    box_bar,
    braced,
    bridge,
    chain,
    cone,
    failed,
    judge,
    move,
    on_plate,
    prism,
    table,
    together,
)
from validator_parts import PlainView

from knotfab_formats.upright import (
    LEAST_FLANK_DEG,
    LEAST_STIFFNESS_N_MM,
    MOST_REACH_MM,
    longest_free_leg_mm,
)
from knotfab_formats.verdict import GROWN, KNOTS, MESH, PRINTING, UPRIGHT, Check
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.curves import Bar
from knotfab_validators.geometry.mesh import Mesh, enclosed_volume
from knotfab_validators.part_checks import part_checks
from knotfab_validators.printing.bars import check_bars, part_bars
from knotfab_validators.printing.slices import measure_pieces, slice_layers
from knotfab_validators.shadows.exact_shadow import ShadowCaster, shadow_mask
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.tube.tube_fit import check_cut, check_tube

TALL = {"arches": 4, "height": 75.0, "flank_deg": 80.5}
CUT = 0.5 * 1.66
RISEN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y up


def near_feet() -> Mesh:
    """Two chains whose nearest feet are 0.4 mm apart: in one cell of any coarse grid."""
    part = chain()
    low = float(np.ptp(part.mesh.vertices[:, 0]))
    return together(part.mesh, move(part.mesh, shift=(low + 0.4, 0, 0)))


HONEST = {
    "three arches": lambda: chain().mesh,
    "five arches": lambda: chain(5).mesh,
    "a thin tube": lambda: chain(height=9.0, radius=0.8).mesh,
    "bars": lambda: braced().mesh,
    "a plate": lambda: on_plate().mesh,
    "near feet": near_feet,
    "a bridge": lambda: bridge(9.0, 7.3),
    "layers on nodes": lambda: blocks(
        [0, 10, 20], [0, 10], [0, LAYER / 2, LAYER, 1.5 * LAYER, 5.5], np.ones((2, 1, 4))
    ),
}
REJECTED = {
    "a valley 0.3 mm above the bed": (lambda: chain(lift=(CUT + 0.3,)).mesh, {"islands"}),
    "a foot missing": (lambda: chain(lift=(10.0,)).mesh, {"islands", "tipping"}),
    "feet of two heights": (lambda: chain(lift=(CUT + 0.08,)).mesh, {"feet", "feet_level"}),
    "feet that touch in a point": (lambda: chain(cut=0.0).mesh, {"feet"}),
    "a leg too long": (lambda: chain(**TALL).mesh, {"legs"}),
    "a bar left out": (lambda: braced(1).mesh, {"legs"}),
    "a bar that ends in air": (lambda: cut_short(braced()).mesh, {"legs"}),
    "a plate with a void": (lambda: on_plate(void=True).mesh, {"voids"}),
    "a long bridge": (lambda: bridge(10.6, 7.3), {"bridge"}),
    "a ledge": (lambda: table(), {"reach"}),
    "a body in the air": (
        lambda: together(chain().mesh, box((30, 0, 5), (40, 10, 9))),
        {"floating", "islands"},
    ),
    "a slender tower": (lambda: box((0, 0, 0), (5, 5, 40)), {"tipping"}),
}


def cut_short(part: Part) -> Part:
    """The same part, its first bar half a mm too short."""
    apart = part_bars(part.mesh)
    assert apart.bars is not None
    bar = apart.bars.vertices[:8]
    middle = bar.mean(axis=0)
    near = (bar - middle) @ (part.curves.bars[0].end - part.curves.bars[0].start) < 0
    short = apart.bars.vertices.copy()
    short[:8][near] += 0.2 * (middle - bar[near].mean(axis=0))
    return replace(part, mesh=together(apart.strands, Mesh(short, apart.bars.faces)))


def turned(mesh: Mesh, degrees: float, shift: float) -> Mesh:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return move(mesh, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), (shift, -shift, shift))


def written(mesh: Mesh, folder: Path) -> Mesh:
    """The mesh as it comes back from an STL, in single precision."""
    rows = np.zeros(len(mesh.faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = mesh.vertices[mesh.faces]
    path = folder / "part.stl"
    path.write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
    return read_mesh(path, "mm", [])


@pytest.mark.parametrize("name", HONEST)
def test_honest_parts_pass_however_they_lie(name: str, tmp_path: Path) -> None:
    mesh = HONEST[name]()
    assert set(GROWN) < set(judge(mesh))
    for other in (mesh, turned(mesh, 33.0, 0.001), written(turned(mesh, 120.0, 0.0), tmp_path)):
        assert failed(other) == set()


@pytest.mark.parametrize("name", REJECTED)
def test_what_would_not_print_is_rejected_however_it_lies(name: str, tmp_path: Path) -> None:
    make, wanted = REJECTED[name]
    mesh = make()
    for other in (mesh, turned(mesh, 33.0, 0.001), written(turned(mesh, 120.0, 0.0), tmp_path)):
        assert wanted <= failed(other)
        checks = judge(other)
        assert all(checks[k].required and (checks[k].at or k == "overhang") for k in wanted)


def test_what_leaves_no_line_in_the_first_layer_is_not_accepted() -> None:
    for mesh in (box((0, 0, 0), (30, 30, 0.05)), cone((20.1, 20.2, 0), 0.3, 12.0)):
        found = judge(mesh)
        assert set(GROWN) < set(found)
        assert {(c.status, c.required) for c in found.values()} == {("skipped", True)}


def test_the_sections_hold_the_volume_of_the_mesh_and_share_what_bodies_share() -> None:
    mesh = chain().mesh
    area, _ = measure_pieces(slice_layers(mesh, LAYER))
    assert area.sum() * LAYER == pytest.approx(enclosed_volume(mesh), rel=2e-3)
    two = together(box((0, 0, 0), (2, 2, 2)), box((1, 0, 0), (3, 2, 2)))
    cut = slice_layers(two, LAYER)
    assert list(np.bincount(cut.floor)) == [1] * 10
    assert measure_pieces(cut)[0] == pytest.approx(6.0, rel=0.08)


@pytest.mark.parametrize("radius", [0.8, 1.66, 3.0])
def test_a_leg_is_as_stiff_as_the_beam_of_the_books(radius: float) -> None:
    most = longest_free_leg_mm(radius, PLA)
    assert 3 * PLA * pi * radius**4 / 4 / most**3 == pytest.approx(LEAST_STIFFNESS_N_MM)
    t = 2 * np.pi * np.arange(60) / 60
    for share, status in ((0.96, "pass"), (1.04, "fail")):
        rod = prism(radius * np.column_stack([np.cos(t), np.sin(t)]), share * most)
        up = move(rod, np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
        legs = judge(up)["legs"]
        assert legs.status == status
        assert legs.measured == pytest.approx(LEAST_STIFFNESS_N_MM / share**3, rel=0.03)


def lean(length: float, rise_deg: float = 50.0) -> Mesh:
    """A square leg of 3.3 mm from the bed, that leans along x."""
    up = length * np.sin(np.radians(rise_deg))
    shift = up / np.tan(np.radians(rise_deg))
    return prism([(0, 0), (4.3, 0), (4.3 + shift, up), (shift, up)], 3.3)


@pytest.mark.parametrize(
    ("also", "most"),
    [
        ("a foot that lies", 1.42),  # as if the leg began on it, 3.3 mm further up
        ("a foot that lies across", 1.42),
        ("a speck at the tip", 1.02),
        ("a needle at the tip", 0.0),
    ],
)
def test_a_leg_is_as_stiff_whatever_its_foot_and_its_tip_are_like(also: str, most: float) -> None:
    """Where part of a foot ends, its middle moves by mm, and the leg does not go aside for it."""
    leg = lean(30.0)
    tip = leg.vertices[leg.vertices[:, 2] > leg.vertices[:, 2].max() - 1e-9].mean(axis=0)
    more = {
        "a foot that lies": [box((-14, 0, 0), (3, 3.3, 2.5))],
        "a foot that lies across": [box((0, -14, 0), (3, 3, 2.5))],
        "a speck at the tip": [move(box((0.4, -0.05, -0.5), (0.5, 0.05, 0.15)), shift=tip)],
        "a needle at the tip": [move(box((0.0, -0.15, -0.5), (0.4, 0.15, 9)), shift=tip)],
    }[also]
    plain, found = judge(leg)["legs"], judge(together(leg, *more))["legs"]
    assert isinstance(plain.measured, float) and isinstance(found.measured, float)
    if most:
        assert 0.98 < found.measured / plain.measured < most
    else:
        assert found.status == "fail"


@pytest.mark.parametrize(("off_deg", "bad"), [(0.0, False), (-1.0, True), (1.0, False)])
def test_flanks_are_asked_for_their_angle(off_deg: float, bad: bool, tmp_path: Path) -> None:
    shift = 12 / np.tan(np.radians(LEAST_FLANK_DEG + off_deg))
    mesh = prism([(0, 0), (20, 0), (20 + shift, 12), (shift, 12)], 20)
    for other in (mesh, turned(mesh, 17.0, 0.001), written(turned(mesh, 71.0, 0.0), tmp_path)):
        assert ("overhang" in failed(other)) == bad


@pytest.mark.parametrize("out_mm", [0.8, 1.0, 1.3, 2.0])
def test_a_ledge_is_as_long_as_it_is(out_mm: float) -> None:
    ledge = together(box((0, 0, 0), (9, 9, 3)), box((0, 0, 3), (9 + out_mm, 9, 4)))
    for degrees in (0.0, 90.0, 45.0):
        reach = judge(turned(ledge, degrees, 0.0))["reach"]
        assert reach.measured == pytest.approx(out_mm, abs=0.11)
        assert (reach.status == "fail") == (out_mm > MOST_REACH_MM)


@pytest.mark.parametrize("degrees", [0.0, 22.5, 47.4, 67.6])
def test_a_narrow_bar_between_round_legs_is_a_bridge_however_it_lies(degrees: float) -> None:
    """Its sides end farther out on the legs than its middle, and the legs lean aslant."""
    turn = 2 * np.pi * np.arange(24) / 24
    leg = move(prism(np.column_stack([np.cos(turn + 0.8), 0.8 * np.sin(turn)]), 12), RISEN)
    bar = box_bar(np.array([0.0, 0.0, 10.2]), np.array([10.2, 0.0, 10.2]), 0.3)
    checks = judge(turned(together(leg, move(leg, shift=[10.2, 0, 0]), bar), degrees, 0.0))
    assert checks["reach"].status == "pass" and float(checks["bridge"].measured) > 7.0


def check_tied(part: Part) -> Check:
    apart = part_bars(part.mesh)
    layers = slice_layers(apart.strands, LAYER)
    radius = part.curves.radius_mm
    assert radius is not None
    return check_bars(layers, apart.bars, part.curves.bars, radius)


def test_bars_join_what_is_listed_and_nothing_else() -> None:
    part = braced()
    assert check_tied(part).status == "pass"
    assert len(part_bars(part.mesh).strands.faces) == len(part.mesh.faces) - 4 * 12
    assert "is listed and not there" in check_tied(braced(1)).detail
    unlisted = replace(part, curves=replace(part.curves, bars=part.curves.bars[1:]))
    assert "is not listed" in check_tied(unlisted).detail
    thick = tuple(replace(b, width=1.4) for b in part.curves.bars)
    assert check_tied(replace(part, curves=replace(part.curves, bars=thick))).measured == 8
    assert "does not reach a strand with both ends" in check_tied(cut_short(part)).detail
    for aside, wrong in (
        (0.4, 0),
        (0.6, 2),
    ):  # mm; then it is not listed, and its listing not there
        there = part.curves.bars[0]
        moved = replace(there, start=there.start + [0, aside, 0], end=there.end + [0, aside, 0])
        listed = replace(part.curves, bars=(moved, *part.curves.bars[1:]))
        assert check_tied(replace(part, curves=listed)).measured == wrong
    long = box((-40, -0.4, 30), (40, 0.4, 30.4))
    assert check_tied(replace(part, mesh=together(part.mesh, long))).measured == 1


@pytest.mark.parametrize("aslant", [0.0, 0.4, -0.4, 0.8, 1.2])
@pytest.mark.parametrize("gap_mm", [0.35, 0.5, 4.0])
def test_a_bar_may_be_as_short_as_two_rows_of_the_sections(gap_mm: float, aslant: float) -> None:
    """Two posts of aslant sections beside each other, nearly along y, or a third one between them."""
    turn = 2 * np.pi * np.arange(48) / 48
    section = 0.8 * np.column_stack([1.5 * np.cos(turn + aslant), np.sin(turn)])
    post = move(prism(section, 12), RISEN)
    way = np.array([0.15, 0.988, 0.0])
    half = float(np.linalg.norm(section, axis=1)[np.abs(section @ [0.988, 0.15]).argmin()])
    for shift in (0.0, 0.04, 0.08, 0.12):
        start = np.array([0.0, shift, 5.2])
        end = start + (2 * half + gap_mm) * way
        bar, listed = box_bar(start, end, half - 0.4), [Bar(start, end, 0.8, 0.4)]
        posts = [move(post, shift=at * [1, 1, 0]) for at in (start, end, 0.5 * (start + end))]
        for count, status in ((2, "pass"), (3, "fail")):
            if gap_mm > 2.0 or count == 2:
                layers = slice_layers(together(*posts[:count]), LAYER)
                check = check_bars(layers, bar, listed, 0.8)
                assert check.status == status, check.detail


@pytest.mark.parametrize(
    ("z", "high", "status"),
    [(0.2, 0.4, "pass"), (0.3, 0.6, "pass"), (0.6, 1.2, "fail"), (6.2, 0.4, "fail")],
)
def test_only_flat_on_the_bed_a_bar_may_be_wide(z: float, high: float, status: str) -> None:
    part = chain(height=30.0)
    points = part.curves.polygons[0]
    low = np.flatnonzero((points[:, 2] < np.roll(points[:, 2], 1)) & (points[:, 2] < 2.0))
    at = points[np.flatnonzero(np.diff(np.sign(points[:, 2] - z)))] if z > 2 else points[low]
    a, b = at[0] * [1, 1, 0] + [0, 0, z], at[-1] * [1, 1, 0] + [0, 0, z]
    bar = Bar(a, b, 1.6, high)
    mesh = together(part.mesh, box_bar(a, b, 1.0, width=1.6, height=high))
    tied = Part(mesh, replace(part.curves, bars=(bar,)))
    assert check_tied(tied).status == status, check_tied(tied).detail


def test_a_strip_on_the_bed_holds_what_would_topple_alone() -> None:
    """A second ring with a foot missing falls over, and does not where a strip ties it to its neighbour."""
    part = chain()
    posts = [box((x, 0, 0), (x + 4, 4, 40)) for x in (30, 38)]
    alone = together(part.mesh, *posts)
    assert failed(alone) == {"tipping"}
    strips = [box((13.0, -3, 0), (45, 7, 0.4)), box((13.0, -20, 0), (45, -12, 0.4))]
    cross = box((36, -20, 0), (44, 7, 0.4))
    assert "tipping" not in failed(together(alone, *strips, cross))


def test_feet_are_cut_no_higher_than_the_centre_line_and_as_listed() -> None:
    for cut, status in ((0.5, "pass"), (0.9, "pass"), (1.2, "fail")):
        part = chain(cut=cut)
        assert check_cut(part.mesh, part.curves).status == status
        assert check_tube(part.mesh, part.curves, flat=True).status == "pass"
    part = chain()
    told = replace(part.curves, cut_mm=0.0)
    assert "knots.json says 0.00 mm" in check_cut(part.mesh, told).detail
    assert check_tube(part.mesh, part.curves).status == "fail"
    dented = part.mesh.vertices.copy()
    high = np.flatnonzero(dented[:, 2] > 10)[:40]
    dented[high] *= [0.97, 0.97, 1.0]
    assert check_tube(Mesh(dented, part.mesh.faces), part.curves, flat=True).status == "fail"


UPRIGHT_SCENE = parse_scene(
    {"piece": {"supports": "none", "clearance_mm": 0.4}, "pose": {"matrix": np.eye(4).tolist()}}
)


@pytest.mark.parametrize(
    ("make", "bad"),
    [
        (braced, set()),
        (lambda: braced(1), {"bars", "legs"}),
        pytest.param(
            lambda: replace(braced(), curves=chain(**TALL).curves),
            {"bars"},
            marks=pytest.mark.study,
        ),
        (lambda: chain(cut=0.0), {"feet"}),
        (lambda: replace(chain(), curves=chain(4).curves), {"tube"}),
    ],
    ids=["honest", "a bar left out", "unlisted bars", "uncut", "other knots"],
)
def test_a_scene_without_supports_has_the_whole_part_proved(make: Any, bad: set[str]) -> None:
    part = make()
    found = part_checks(part.mesh, part.curves, UPRIGHT_SCENE, {}, skip=KNOTS)
    failing = {c.name for c in found if c.required and c.status != "pass"} - {"build_volume"}
    assert bad <= failing and (bad or not failing), failing
    names = [c.name for c in found]
    assert set(UPRIGHT) < set(names) and len(set(names)) == len(names)


def test_a_usual_scene_has_nothing_of_it_proved() -> None:
    part, usual = braced(), parse_scene({"pose": {"matrix": np.eye(4).tolist()}})
    found = part_checks(part.mesh, part.curves, usual, {}, skip=(*KNOTS, *MESH, *PRINTING))
    assert not set(UPRIGHT) & {c.name for c in found}


def test_a_bar_that_shows_in_the_shadow_is_rejected_and_one_that_hides_is_not() -> None:
    """Lit from above; a bar within a chain of arches is seen in the middle of its ring."""
    part = braced()
    across = box((-6, -0.4, 30), (6, 0.4, 30.4))
    view = view_geometry(
        PlainView(frame_width_mm=40.0, frame_height_mm=40.0, light_distance_mm=1e4), 160, 160
    )
    for mesh, status in ((part.mesh, "pass"), (together(part.mesh, across), "fail")):
        own = part_bars(part.mesh).strands
        target = shadow_mask(ShadowCaster(own.vertices, own.faces).lines(view), view)
        seen = verify_view(
            mesh.vertices,
            mesh.faces,
            target,
            view,
            polygons=part.curves.polygons,
            radius=part.curves.radius_mm,
            mounted=True,
            bars=True,
            longer=320,
        )
        checks = shadow_checks(
            {"front": seen},
            mesh.vertices,
            iou_floor=0.5,
            max_outline_px=0.5,
            no_rendering=None,
            polygons_decide=True,
            bars=True,
        )
        found = {check.name: check for check in checks}
        assert found["intrusion"].status == status and found["intrusion"].required
        assert found["outline"].status == "pass"  # the tube's own
