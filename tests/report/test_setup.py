"""The drawings of a mount: page sizes, figures that are there, holes at full size, the same bytes again."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pdf_pages import POINT, page_contents, page_sizes
from setups import OFF, Kind, setup

from knotfab.hold.placement import placement_of
from knotfab.hold.wall import DRILLS_MM, PLAY_MM
from knotfab.render.pages import length
from knotfab.report.drill_template import write_drill_template
from knotfab.report.setup import draw_sheets, shadow_outlines, write_setup
from knotfab.report.setup_words import steps_of

pytestmark = pytest.mark.slow

KINDS: tuple[Kind, ...] = ("none", "plate", "dowel", "stand")


def texts(path: Path) -> list[str]:
    """The texts of an SVG of matplotlib's, which draws them as paths and notes what they say."""
    return [t.strip() for t in re.findall(r"<!--(.*?)-->", path.read_text(encoding="utf-8"))]


def drawn(kind: Kind, folder: Path, **view: float) -> list[str]:
    mounted, scene, camera = setup(kind, **view)
    assert write_setup(folder, draw_sheets(mounted, scene, [camera]), [OFF]) == [
        "setup.pdf",
        "setup.svg",
    ]
    return texts(folder / "setup.svg")


@pytest.mark.parametrize("kind", KINDS)
def test_pages_of_a4_and_the_same_bytes_again(kind: Kind, tmp_path: Path) -> None:
    found = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        drawn(kind, tmp_path / name)
        found.append([(tmp_path / name / f).read_bytes() for f in ("setup.pdf", "setup.svg")])
    assert found[0] == found[1]
    pdf, svg = found[0]
    sizes = page_sizes(tmp_path / "a" / "setup.pdf")  # the last has the marks for a photograph
    assert sizes == pytest.approx(np.array([[210, 297]] * 2), abs=0.005)
    head = re.search(rb'width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    assert head is not None
    assert np.array(head.groups(), dtype=float) / POINT == pytest.approx([210, 297], abs=0.005)
    assert b"CreationDate" not in pdf and b"<dc:date>" not in svg


@pytest.mark.parametrize("kind", KINDS)
def test_figures_are_on_the_page(kind: Kind, tmp_path: Path) -> None:
    said = drawn(kind, tmp_path, light_distance_mm=480.0, wall_distance_mm=90.0)
    assert {"480", "90", "570", "frame 160", "frame 120", "Setting up"} <= set(said)
    assert any("0.14 IoU" in line for line in said)
    if kind == "plate":
        assert {"plate 176", "plate 136", "screw holes 166", "88", "68"} <= set(said)
    else:
        assert {"80", "60"} <= set(said)  # the lamp's foot, from the frame's edges
    if kind == "dowel":
        assert {"1", "2", "3"} <= set(said)
    if kind == "stand":
        # the lengths lead from the wall to the base, from the base to the lamp, and from the desk to the lamp
        assert {"70", "455", "75", "desk"} <= set(said)


@pytest.mark.parametrize("kind", KINDS)
def test_a_leaning_wall_and_a_far_lamp_stay_on_the_page(kind: Kind, tmp_path: Path) -> None:
    said = drawn(kind, tmp_path, wall_tilt_deg=20.0, light_distance_mm=3000.0)
    assert any("3100" in line for line in said)
    assert any(
        f"{length(3100 * np.cos(np.radians(20)))} square to the wall" in line for line in said
    )
    page = max(page_contents(tmp_path / "setup.pdf"), key=len)
    at = np.array(re.findall(r"([-\d.]+) ([-\d.]+) [ml]\n", page), dtype=float) / POINT
    paper = ((np.abs(at) < 0.01) | (np.abs(at - [210, 297]) < 0.01)).all(axis=1)
    at = at[~paper]  # the sheet itself
    assert at.min() > 5 and (at.max(axis=0) < [205, 292]).all()


def test_nothing_measured_is_said(tmp_path: Path) -> None:
    mounted, scene, camera = setup("none")
    write_setup(tmp_path, draw_sheets(mounted, scene, [camera]), [None])
    assert "Not measured: too little to see, or nothing rendered." in texts(tmp_path / "setup.svg")


def test_the_shadow_is_drawn_where_it_falls(tmp_path: Path) -> None:
    mounted, _, camera = setup("none")
    points = np.concatenate(shadow_outlines(mounted, placement_of(mounted, camera)))
    vertices = mounted.bodies[0][0]
    pixels = camera.project(vertices)
    right = (pixels[:, 0] + 0.5 - 40) * 2.0
    up = (30 - pixels[:, 1] - 0.5) * 2.0
    assert points.max(axis=0) == pytest.approx([right.max(), up.max()], abs=0.1)
    assert points.min(axis=0) == pytest.approx([right.min(), up.min()], abs=0.1)


def curves(text: str) -> list[tuple[np.ndarray, float]]:
    """Middles (2,) and diameters of the circles of a page, in mm: closed paths of Bézier arcs."""
    found = []
    for path in re.findall(r"((?:[-\d.]+ [-\d.]+ m\n)(?:(?:[-\d.]+ ){6}c\n){8})", text):
        numbers = [float(x) for x in re.findall(r"[-\d.]+", path)]
        ends = np.array([numbers[2 + 6 * k + 4 : 2 + 6 * k + 6] for k in range(8)]) / POINT
        found.append((ends.mean(axis=0), float(np.ptp(ends[:, 0]))))
    return found


def test_holes_are_at_full_size_where_the_pegs_enter(tmp_path: Path) -> None:
    mounted, _, camera = setup("dowel")
    assert mounted.wall is not None
    names = write_drill_template(tmp_path, mounted, camera)
    assert names == ["drill-template-a4.pdf", "drill-template-letter.pdf"]
    place = placement_of(mounted, camera)
    for name in names:
        pages = page_contents(tmp_path / name)
        circles = [c for page in pages for c in curves(page) if c[1] < 10]  # not of letters
        assert len(circles) == 3
        wide = [peg.drill_mm for peg in mounted.wall.pegs]
        assert set(wide) <= set(DRILLS_MM)
        for peg in mounted.wall.pegs:  # a shoulder stays, and no more of it than a drill's step
            assert 0 <= peg.foot_radius_mm - peg.dowel_radius_mm < 0.25
            assert peg.drill_mm == pytest.approx(2 * peg.dowel_radius_mm + PLAY_MM)
        assert [d for _, d in circles] == pytest.approx(wide, abs=1e-3)
        middles = np.stack([m for m, _ in circles])
        assert middles - middles[0] == pytest.approx(place.holes - place.holes[0], abs=1e-3)
        assert len(page_sizes(tmp_path / name)) == 2  # words, and a frame that fits one page
    before = (tmp_path / names[0]).read_bytes()
    write_drill_template(tmp_path, mounted, camera)
    assert (tmp_path / names[0]).read_bytes() == before


def test_a_large_frame_is_tiled(tmp_path: Path) -> None:
    mounted, _, camera = setup("dowel", frame_width_mm=400.0, frame_height_mm=300.0)
    write_drill_template(tmp_path, mounted, camera)
    assert len(page_sizes(tmp_path / "drill-template-a4.pdf")) == 1 + 3 * 2


@pytest.mark.parametrize("kind", ["none", "plate", "stand"])
def test_only_dowels_are_drilled_for(kind: Kind, tmp_path: Path) -> None:
    mounted, _, camera = setup(kind)
    assert write_drill_template(tmp_path, mounted, camera) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("radius", [-90.0, 400.0])
def test_a_round_wall_is_measured_from_its_own_corners(radius: float, tmp_path: Path) -> None:
    said = " ".join(drawn("none", tmp_path, wall_radius_mm=radius))  # the SVG is the first page
    assert "From above" in said and "pictures" not in said
    mounted, scene, camera = setup("none", wall_radius_mm=radius)
    place = placement_of(mounted, camera, scene.views[0])
    wide, high = place.frame_mm
    turn = 0.5 * wide / radius
    off = place.off_wall_mm - radius * (1 - np.cos(turn))
    corner = np.linalg.norm([radius * np.sin(turn), 0.5 * high - place.up_mm, off])
    far = [m.lamp_mm for m in place.marks if m.name.startswith("upper right")]
    assert far == [pytest.approx(float(corner))]
    steps = " ".join(steps_of(mounted, place, scene.views[0]))
    assert (f"a radius of {abs(radius):g} mm" in steps and "hollow" in steps) or radius < 0
