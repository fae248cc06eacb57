"""A piece that prints without supports: what must be rejected, what must pass, however it lies on the bed."""

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids import (
    BARE,
    LAYER,
    PLA,
    PRINTER,
    Part,
    blocks,
    box,
    box_bar,
    braced,
    bridge,
    chain,
    cone,
    failed,
    inward,
    judge,
    leaning,
    move,
    on_plate,
    prism,
    run,
    table,
    together,
)
from validator_parts import PlainView, trefoil, tube

from knotfab_formats.upright import (
    LEAST_FLANK_DEG,
    LEAST_STIFFNESS_N_MM,
    MOST_REACH_MM,
    longest_free_leg_mm,
)
from knotfab_formats.verdict import GROWN, KNOTS, MESH, PRINTING, UPRIGHT, Check
from knotfab_validators.arrays import Array
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.curves import Bar
from knotfab_validators.geometry.mesh import Mesh, enclosed_volume, part_bars
from knotfab_validators.part_checks import part_checks
from knotfab_validators.printing import bridges as columns_module
from knotfab_validators.printing.bars import check_bars
from knotfab_validators.printing.bridges import _heights, columns
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.slices import Slices, layer_of, measure_pieces, slice_layers
from knotfab_validators.printing.standing import bodies, share_above
from knotfab_validators.shadows.exact_shadow import ShadowCaster, shadow_mask
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.tube.tube_fit import check_cut, check_tube

pytestmark = pytest.mark.slow  # most measure a whole part
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


def runs_of(cut: Slices, layer: int) -> Array:
    own = slice(cut.first[layer * cut.rows], cut.first[(layer + 1) * cut.rows])
    return np.stack([cut.left[own], cut.right[own]])


def test_the_sections_of_some_layers_are_those_of_all() -> None:
    mesh = braced().mesh
    every = slice_layers(mesh, LAYER)
    heights = every.bottom + np.array([0.0, 30.2, 30.25])
    some = slice_layers(mesh, LAYER, heights=[*heights, 1e3, every.bottom - 1.0])
    asked = {layer_of(z, every.bottom, LAYER) for z in heights}
    for layer in range(every.layers):
        known = runs_of(every, layer) if layer in asked else np.empty((2, 0))
        assert np.array_equal(runs_of(some, layer), known)
    assert 0 < len(some.left) < len(every.left)


@pytest.mark.parametrize("wall", [np.inf, 1.05, 0.45, 0.0])
@pytest.mark.parametrize("radius", [0.8, 1.66, 3.0])
def test_a_leg_is_as_stiff_as_the_beam_of_the_books(radius: float, wall: float) -> None:
    left = 1 - (max(radius - wall, 0) / radius) ** 4
    most = longest_free_leg_mm(radius, PLA * left)
    if not left:
        up = box((0, 0, 0), (radius, radius, 2.0))
        assert judge(up, wall)["legs"].status == "fail"
        return
    assert 3 * PLA * left * pi * radius**4 / 4 / most**3 == pytest.approx(LEAST_STIFFNESS_N_MM)
    t = 2 * np.pi * np.arange(60) / 60
    for share, status in ((0.96, "pass"), (1.04, "fail")):
        rod = prism(radius * np.column_stack([np.cos(t), np.sin(t)]), share * most)
        up = move(rod, np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
        legs = judge(up, wall)["legs"]
        assert legs.status == status
        assert legs.measured == pytest.approx(LEAST_STIFFNESS_N_MM / share**3, rel=0.04)


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
    radius = part.curves.radius_mm
    assert radius is not None
    return check_bars(apart.strands, LAYER, apart.bars, part.curves.bars, radius)


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
    # mm; then it is not listed, and its listing not there
    for aside, wrong in ((0.4, 0), (0.6, 2)):
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
                check = check_bars(together(*posts[:count]), LAYER, bar, listed, 0.8)
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


@pytest.mark.parametrize("frame_mm", [40.0, 160.0])
def test_a_bar_that_shows_in_the_shadow_is_rejected_and_one_that_hides_is_not(
    frame_mm: float,
) -> None:
    """Lit from above; a bar within a chain of arches is seen in its ring, however large the frame."""
    part = braced()
    across = box((-6, -0.4, 30), (6, 0.4, 30.4))
    view = view_geometry(
        PlainView(frame_width_mm=frame_mm, frame_height_mm=frame_mm, light_distance_mm=1e4),
        *2 * [int(4 * frame_mm)],
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
            bar_bodies=part_bars(mesh).bars,
            longer=int(8 * frame_mm),
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


# The checks tell whether parts reach the bed, and how far they are from toppling.


def test_a_body_one_layer_up_still_lies_on_the_bed() -> None:
    ground = box((0, 0, 0), (10, 10, 5))
    for height, count in ((0.2, 0), (0.203, 1)):
        found = run(together(ground, box((20, 0, height), (30, 10, 5))), BARE)
        assert (found["floating"].measured, found["islands"].measured) == (count, count)
        assert found["floating"].status == ("fail" if count else "pass")
    assert run(box((0, 0, 3), (5, 5, 5)))["floating"].status == "pass"  # with supports


def test_a_box_stands_by_half_its_width() -> None:
    found = run(box((5, 5, 0), (15, 45, 20)), stands=True)["standing"]
    assert found.measured == pytest.approx(5.0) and found.status == "pass"
    assert "26.6°" in found.detail and found.at[0] == pytest.approx((10, 25, 10))


@pytest.mark.parametrize(("more", "status"), [(0.0, "pass"), (0.001, "fail")])
def test_a_top_that_reaches_out_too_far_topples(more: float, status: str) -> None:
    reach = 2 + np.sqrt(8) + more  # the centre is above the foot's edge
    mesh = blocks([0, 2, reach], [0, 6], [0, 1, 2], [[[1, 1]], [[0, 1]]])
    found = run(mesh, stands=True)["standing"]
    assert (found.status, found.required) == (status, True)
    assert found.measured == pytest.approx(0.0, abs=1e-3)
    assert run(mesh)["standing"].status == "pass"


def test_a_hollow_moves_the_centre() -> None:
    solid, hole = box((0, 0, 0), (20, 20, 20)), box((12, 5, 5), (18, 15, 15))
    found = run(together(solid, inward(hole)), stands=True)
    x = (8000 * 10 - 600 * 15) / 7400
    assert found["standing"].at[0] == pytest.approx((x, 10, 10))
    assert found["standing"].measured == pytest.approx(x)
    assert found["feature"].measured == pytest.approx(2.0)
    assert "of 1;" in found["floating"].detail


def test_the_centre_of_mass_is_that_of_other_libraries() -> None:
    pymeshlab, trimesh = pytest.importorskip("pymeshlab"), pytest.importorskip("trimesh")
    vertices, faces = tube(trefoil(120, 10.0), 2.0, 24)
    (body,) = bodies(Mesh(vertices + [50.0, 60.0, 70.0], faces))
    other = trimesh.Trimesh(vertices + [50.0, 60.0, 70.0], faces, process=False)
    assert body.volume_mm3 == pytest.approx(other.volume, rel=1e-9)
    assert body.center == pytest.approx(other.center_mass, rel=1e-9)
    third = pymeshlab.MeshSet()
    third.add_mesh(pymeshlab.Mesh(vertices, faces))
    measures = third.get_geometric_measures()
    assert body.volume_mm3 == pytest.approx(measures["mesh_volume"], rel=1e-4)
    assert body.center - [50, 60, 70] == pytest.approx(measures["center_of_mass"], abs=1e-3)


def test_each_body_stands_for_itself() -> None:
    pair = together(box((0, 0, 0), (10, 10, 5)), cone((30, 30, 0), 5.0, 8.0))
    found = run(pair, stands=True)["standing"]
    assert found.measured == pytest.approx(0.201 * 5 / 8 * np.cos(np.pi / 48), rel=1e-6)
    assert "2 bodies" in found.detail
    edge = prism([(5, 0), (10, 5), (5, 10), (0, 5)], 8)  # lies on an edge, within the layer 0.4 mm
    assert run(edge, stands=True)["standing"].measured == pytest.approx(0.201)


def test_what_is_printed_lying_stands_as_it_is_turned() -> None:
    """A wide low block, printed on its edge; places are told as it is printed."""
    mesh = box((0, 0, 0), (4, 40, 40))
    up = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # print x is up
    lying = printability_checks(mesh, None, seconds={}, stands=True)
    stood = printability_checks(mesh, None, seconds={}, stands=True, desk=up)
    one, other = ({c.name: c for c in found}["standing"] for found in (lying, stood))
    assert one.measured == pytest.approx(2.0) and other.measured == pytest.approx(20.0)
    assert other.at[0] == pytest.approx((2, 20, 20))
    assert other.status == "pass" and "not as it is printed" in other.detail


# Overhangs and the support under them, of solids whose numbers are known.


@pytest.mark.parametrize("level", [-1.0, 0.0, 0.3, 0.6, 1.1, 2.0, 3.0])
def test_the_share_of_a_triangle_above_a_level(level: float) -> None:
    samples = np.random.default_rng(0).dirichlet([1, 1, 1], 200_000) @ [0.0, 0.6, 2.0]
    share = share_above(np.array([[0.6, 2.0, 0.0]]), level)[0]
    assert share == pytest.approx((samples > level).mean(), abs=0.005)


def test_the_share_of_level_edges_is_exact() -> None:
    z = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    assert share_above(z, 0.5).tolist() == [0.75, 0.25, 1.0]


def test_the_overhang_begins_beyond_the_limit() -> None:
    assert run(leaning(45.0), BARE)["overhang"].measured == 0.0
    assert run(leaning(45.0), BARE)["overhang"].status == "pass"
    found = run(leaning(45.2), BARE)["overhang"]
    # all of the underside but what belongs to the first layer
    area = 20 * (10 - 0.201) / np.cos(np.radians(45.2)) / 100
    assert found.status == "fail" and found.measured == pytest.approx(area, rel=1e-6)
    assert (
        run(leaning(45.2), BARE.model_copy(update={"max_overhang_deg": 45.2}))["overhang"].status
        == "pass"
    )
    assert run(leaning(45.2))["overhang"].required is False


def test_a_table_needs_a_box_of_support() -> None:
    found = run(table())
    assert found["overhang"].measured == pytest.approx(3.84, rel=1e-9)
    assert (found["overhang"].status, found["overhang"].limit) == ("pass", None)
    assert found["support_volume"].measured == pytest.approx(3.84, rel=1e-9)
    fits = PRINTER.model_copy(update={"max_support_cm3": 3.8400001})
    assert run(table(), fits)["support_volume"].status == "pass"
    tight = run(table(), fits.model_copy(update={"max_support_cm3": 3.839}))["support_volume"]
    assert (tight.status, tight.required) == ("fail", True)
    assert (
        run(table(), BARE.model_copy(update={"max_support_cm3": 1.0}))["support_volume"].required
        is False
    )


def test_support_stands_on_the_surface_below() -> None:
    plate = box((-10, -10, 0), (30, 30, 4))
    legless = move(table(), shift=(0, 0, 0))
    found = run(together(plate, move(legless, shift=(0, 0, 5))))["support_volume"]
    # the leg's own underside hangs 1 mm above the plate, the top 11 mm
    assert found.measured == pytest.approx((16 * 1 + 384 * 11) / 1000, rel=0.02)


def test_a_slope_off_the_grid_is_supported_within_its_error() -> None:
    found = run(move(leaning(60.0), Rotation.from_euler("z", 0.3).as_matrix(), (10, 5, 0)))
    shift = 10 * np.tan(np.radians(60))
    assert found["support_volume"].measured == pytest.approx(shift * 10 / 2 * 20 / 1000, rel=0.02)


# Bridges and ledges of known length.


@pytest.mark.parametrize("width", [3.0, 60.0])
def test_a_bridge_is_as_long_as_its_span(width: float) -> None:
    found = run(bridge(10.0, width), BARE)
    assert found["bridge"].measured == pytest.approx(10.0, abs=1e-9)
    assert found["bridge"].status == found["overhang"].status == "pass"
    assert found["islands"].measured == 0
    less = run(bridge(10.0, width), BARE.model_copy(update={"max_bridge_mm": 9.99}))
    assert less["bridge"].status == less["overhang"].status == "fail"
    assert less["overhang"].measured == pytest.approx(10 * width / 100, rel=1e-9)
    x, y, z = less["bridge"].at[0]
    assert 9 < x < 11 and 0 < y < width and z == pytest.approx(10.0)
    assert (
        run(bridge(10.0, width), PRINTER.model_copy(update={"max_bridge_mm": 1.0}))["bridge"].status
        == "pass"
    )


def test_a_ledge_counts_twice_and_is_no_bridge() -> None:
    ledge = blocks([0, 10, 14], [0, 20], [0, 10, 12], [[[1, 1]], [[0, 1]]])
    found = run(ledge, BARE)
    assert found["bridge"].measured == pytest.approx(8.0, abs=1e-9)
    assert found["bridge"].status == "pass" and found["overhang"].status == "fail"
    assert run(ledge, BARE.model_copy(update={"max_bridge_mm": 7.9}))["bridge"].status == "fail"


def test_a_slope_that_holds_itself_is_no_long_ledge() -> None:
    assert run(leaning(45.0), BARE)["bridge"].measured <= 1.0


# Columns through solids, and distances between triangles, against plain references.


def test_columns_fill_the_volume() -> None:
    mesh = Mesh(*tube(trefoil(300, 10.0), 2.5))
    grid = columns(mesh, 0.2)
    corner = mesh.vertices[mesh.faces]
    volume = np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    assert (grid.high - grid.low).sum() * grid.cell**2 == pytest.approx(volume, rel=0.005)
    assert (grid.high > grid.low).all() and (np.diff(grid.column) >= 0).all()


def test_a_hollow_parts_a_column_and_an_overlap_joins_two() -> None:
    block, hole = box((0, 0, 0), (10, 10, 10)), inward(box((2, 2, 4), (8, 8, 6)))
    grid = columns(together(block, hole))
    inside = (grid.low == 6) & (grid.high == 10)
    assert inside.sum() == 12 * 12 and (grid.low == 0).sum() == 20 * 20
    lapped = columns(together(block, box((0, 0, 5), (10, 10, 15))))
    assert set(lapped.low) == {0.0} and set(lapped.high) == {15.0}


def test_an_axis_through_edges_and_corners_is_counted_once() -> None:
    # the grid's axes lie on the spokes of a fan about the middle
    mesh = box((0, 0, 0), (4, 4, 4))
    shifted = move(mesh, shift=(-0.50137 * 0.5, -0.50079 * 0.5, 0))
    grid = columns(together(shifted, move(shifted, shift=(2.0, 2.0, 6.0))))
    assert (grid.high - grid.low == pytest.approx(4.0)) and len(grid.low) == 2 * 64


def test_many_columns_make_wider_cells() -> None:
    assert columns(box((0, 0, 0), (5000, 1, 1))).cell == pytest.approx(5.0)


def test_rows_are_counted_before_they_are_looked_through(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fibres in a row, 40 mm long: many rows of axes a face, few axes."""
    fibres = together(*(box((x, 0, 0), (x + 0.1, 40, 0.1)) for x in np.arange(0, 10, 0.2)))
    counted: list[int] = []
    rows = columns_module._rows

    def look(corner: np.ndarray, start: np.ndarray, cell: float) -> object:
        counted.append(int((np.ptp(corner[:, :, 1], axis=1) / cell).sum()))
        return rows(corner, start, cell)

    monkeypatch.setattr(columns_module, "_rows", look)
    monkeypatch.setattr(columns_module, "MOST_TESTS", 10_000)
    assert columns(fibres).cell > 0.5 and max(counted) <= 10_000


def test_slivers_across_the_part_are_met_as_by_brute_force() -> None:
    """A plate whose faces are a fan of slivers, aslant: every axis tested against every face."""
    n = 48
    turn = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack([10 * np.cos(turn), 10 * np.sin(turn), np.zeros(n)])
    number, ahead = np.arange(n), np.roll(np.arange(n), -1)
    low = np.column_stack([np.full(n, 2 * n), ahead, number])
    high = np.column_stack([np.full(n, 2 * n + 1), number + n, ahead + n])
    sides = [
        np.column_stack([number, ahead, ahead + n]),
        np.column_stack([number, ahead + n, number + n]),
    ]
    far = np.array([[9.5, 1.5, 0.0], [9.5, 1.5, 3.0]])
    vertices = np.concatenate([rim, rim + [0.0, 0.0, 3.0], far])
    vertices[:, 2] += 0.05 * vertices[:, 0]
    mesh = Mesh(vertices, np.concatenate([low, high, *sides]))
    grid = columns(mesh)
    place = grid.across * np.arange(41)[:, None] + np.arange(grid.across)
    face, column = (k.ravel() for k in np.indices((len(mesh.faces), place.size)))
    x, y = (
        grid.origin[k] + grid.cell * at
        for k, at in enumerate((column % grid.across, column // grid.across))
    )
    z, facing = _heights(mesh, face, x, y)
    ends = {k: z[(column == k) & (facing != 0)] for k in np.unique(column[facing != 0])}
    assert list(ends) == grid.column.tolist() and len(ends) > 1000
    assert all(len(met) == 2 for met in ends.values())
    np.testing.assert_allclose(grid.low, [met.min() for met in ends.values()])
    np.testing.assert_allclose(grid.high, [met.max() for met in ends.values()])


# What begins in mid-air, and what only seems to.


def test_what_hangs_down_in_mid_air_is_an_island() -> None:
    filled = np.zeros((5, 1, 3))
    filled[:, :, 2] = filled[0] = filled[4] = 1
    filled[2, :, 1] = 1
    hanging = blocks([0, 5, 9, 11, 15, 20], [0, 10], [0, 6, 10, 12], filled)
    found = run(hanging, BARE)
    assert (found["islands"].measured, found["islands"].status) == (1, "fail")
    assert found["floating"].measured == 0 and found["floating"].status == "pass"
    x, _, z = found["islands"].at[0]
    assert 9 <= x <= 11 and z == pytest.approx(6.0)
    assert run(hanging)["islands"].status == "pass"


def test_a_leg_thinner_than_the_grid_still_holds() -> None:
    filled = np.zeros((5, 5, 4))
    filled[:, :, 0] = filled[:, :, 3] = filled[2, 2] = 1
    filled[[0, -1], :, 1] = filled[:, [0, -1], 1] = 1  # it stands in a tray
    line = [0.0, 2.0, 4.85, 5.15, 8.0, 10.0]  # between the axes at 4.75 and 5.25
    found = run(blocks(line, line, [0.0, 2.0, 3.0, 6.0, 8.0], filled), BARE)
    assert found["islands"].measured == 0


def test_a_cone_on_its_tip() -> None:
    standing = run(cone((20, 20, 0), 8.0, 12.0), BARE)
    assert standing["islands"].measured == standing["floating"].measured == 0
    aloft = run(cone((20.1, 20.2, 5), 8.0, 12.0), BARE)
    assert aloft["islands"].measured == aloft["floating"].measured == 1
    assert aloft["floating"].at[0] == pytest.approx((20.1, 20.2, 5))
    assert aloft["islands"].at[0] == pytest.approx((20.1, 20.2, 5), abs=0.8)
