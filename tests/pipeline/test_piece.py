"""Files for other tools, each opened by a reader of another make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import ezdxf
import numpy as np
import pytest
from pieces import SAG, one, setup
from scipy.spatial import cKDTree
from shapely.geometry import LinearRing, MultiPoint, Polygon
from svgelements import SVG, Group
from svgelements import Path as SvgPath

from knotfab.base.folder import OutputFolder
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.hold.eyelet import Eyelet
from knotfab.hold.hang import HangMount
from knotfab.hold.mount import Mounted
from knotfab.hold.struts import join_members
from knotfab.knots import Knot, Knots
from knotfab.part.write import make_pose
from knotfab.pipeline import piece as also_file
from knotfab.pipeline.options import options_from
from knotfab.pipeline.piece import write_also
from knotfab.pipeline.prepare import check_options
from knotfab.scene.camera import Camera
from knotfab_fixtures import step
from knotfab_fixtures.step import write_solids
from knotfab_formats.errors import InputError

# part.stl to scene: what is printed shrinks
POSE = np.array([[0.0, 0, 0.98, -3], [0.98, 0, 0, 2], [0, 0.98, 0, 7], [0, 0, 0, 1]])


class Made(NamedTuple):
    """The knots in the scene, the first view's camera, the mount, and what is told."""

    knots: Knots
    camera: Camera
    mounted: Mounted
    told: tuple[str, ...]


def made_by_hand(kind: str, also: set[str], out: Path, suffix: str = "", **view: float) -> Made:
    """The files of the ring of `setup`, and of a smaller one, on a mount of that kind."""
    mounted, scene, camera = setup("none" if kind == "hang" else kind, **view)  # type: ignore[arg-type]
    bar = one([0, -50, 20], [5, -50, -20], 1.5)
    if mounted.stand is not None:
        post = one([0, -50, 0], [1, -57, 3], 1.5, ground=True)
        stand = replace(mounted.stand, members=join_members([post, bar]))
        mounted = replace(mounted, holder=stand)
    if kind == "hang":
        eyelet = Eyelet(np.array([0.0, 60.0, 3.0]), np.array([0.6, 0.0, 0.8]), 6.0, 1.5)
        none = np.empty(0, dtype=np.int64)
        hang = HangMount(
            members=bar,
            holds=none,
            eyelets=(eyelet,),
            tilt_deg=0.0,
            predicted_intrusion=np.zeros(1),
            **SAG,
        )
        mounted = replace(mounted, holder=hang)
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.stack([50 * np.cos(t), 50 * np.sin(t), 5 * np.sin(2 * t)], axis=1)
    knots = Knots((Knot(ring), Knot(0.4 * ring)), 2.0)
    own = knots.moved(np.linalg.inv(POSE))
    part: Any = SimpleNamespace(mounted=mounted, pose=SimpleNamespace(knots=own, matrix=POSE))
    target: Any = SimpleNamespace(width=camera.width, height=camera.height)
    posed = scene.model_copy(update={"pose": make_pose(POSE)})
    with OutputFolder(out) as folder:
        told = write_also(folder, part, posed, [target], also, suffix)
        folder.commit()
    return Made(knots, camera, mounted, told)


def wanted_lines(knots: Knots, camera: Camera) -> list[np.ndarray]:
    """Find where the light throws the knots, mm from the lower left corner of the frame, by the camera."""
    pixel = camera.frame_mm[0] / camera.width
    places = [(camera.project(k.points) + 0.5) * pixel for k in knots.knots]
    return [np.column_stack([p[:, 0], camera.frame_mm[1] - p[:, 1]]) for p in places]


def svg_lines(path: Path) -> dict[str, list[np.ndarray]]:
    """The closed lines of an SVG by their groups, in mm from the lower left corner of the page."""
    page = SVG.parse(path, ppi=25.4)  # 1 px is 1 mm
    found: dict[str, list[np.ndarray]] = {}
    for group in page.select(lambda e: isinstance(e, Group) and e.id is not None):
        for sub in (sub for path in group for sub in path.as_subpaths()):
            steps = list(SvgPath(sub))
            assert type(steps[0]).__name__ == "Move" and type(steps[-1]).__name__ == "Close"
            line = np.array([(s.end.x, page.height - s.end.y) for s in steps[:-1]])
            found.setdefault(group.id, []).append(line)
    return found


@pytest.mark.parametrize("kind", ["none", "plate", "stand"])
@pytest.mark.parametrize("azimuth", [0.0, 35.0])
def test_centre_lines_lie_where_the_light_throws_them(
    tmp_path: Path, kind: str, azimuth: float
) -> None:
    knots, camera, _, _ = made_by_hand(kind, {"svg", "dxf"}, tmp_path / "out", azimuth_deg=azimuth)
    wanted = wanted_lines(knots, camera)
    drawing = ezdxf.readfile(tmp_path / "out" / "centre-lines.dxf")
    assert not drawing.audit().has_errors and drawing.units == ezdxf.units.MM
    lines = list(drawing.modelspace())
    assert [line.dxf.layer for line in lines] == ["knot-1", "knot-2"]
    assert {"knot-1", "knot-2"} <= {layer.dxf.name for layer in drawing.layers}
    drawn = svg_lines(tmp_path / "out" / "centre-lines.svg")
    for number, (line, own) in enumerate(zip(lines, wanted, strict=True), start=1):
        assert line.is_closed
        points = np.array([v.dxf.location for v in line.vertices])
        assert points == pytest.approx(np.column_stack([own, np.zeros(len(own))]), abs=1e-3)
        assert drawn[f"knot-{number}"] == [pytest.approx(own, abs=1e-3)]


@pytest.mark.parametrize("kind", ["none", "plate", "stand"])
def test_the_outline_of_the_shadow(tmp_path: Path, kind: str) -> None:
    """It holds the centre line and a tube's shadow about it; a plate, whose face is the wall, throws none."""
    knots, camera, _, _ = made_by_hand(kind, {"svg"}, tmp_path / "out")
    assert not (tmp_path / "out" / "centre-lines.dxf").exists()
    (lines,) = svg_lines(tmp_path / "out" / "shadow-front.svg").values()
    shadow = Polygon()
    for line in lines:
        shadow = shadow.symmetric_difference(Polygon(line))
    ring = LinearRing(wanted_lines(knots, camera)[0])
    assert shadow.contains(ring)
    points = knots.knots[0].points
    ways = [np.linalg.norm(p - camera.eye, axis=1) for p in (points, camera.cast(points))]
    grown = 2.0 * (ways[1] / ways[0]).mean()
    assert not shadow.contains(MultiPoint(ring.parallel_offset(1.1 * grown).coords))
    if kind != "stand":  # pegs are in the tube's own shadow
        assert shadow.area == pytest.approx(2 * grown * ring.length, rel=0.05)
        assert len(lines) == 2 and shadow.covers(ring.buffer(0.9 * grown))


def test_the_same_files_each_time(tmp_path: Path) -> None:
    for name in ("a", "b"):
        made_by_hand("plate", {"svg", "dxf"}, tmp_path / name)
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert files == ["centre-lines.dxf", "centre-lines.svg", "shadow-front.svg"]
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.mark.parametrize("also", ["pdf", "svg,", "svg,stl", ("dxf", "SVGZ")])
def test_an_unknown_format_is_refused(also: Any) -> None:
    with pytest.raises(
        InputError, match=r"--also \w*: there is no such format.*svg, dxf, step, gcode"
    ):
        check_options(options_from({"also": also}))


@pytest.mark.parametrize("also", ["svg", "SVG, dxf,step", ("svg", "dxf"), ["dxf"], ()])
def test_formats_by_commas_or_one_by_one(also: Any) -> None:
    check_options(options_from({"also": also}))


def opened(path: Path) -> dict[str, Any]:
    """The solids or edges of a STEP file, by name."""
    import cadquery as cq  # loading it takes seconds, for which other workers need not wait

    whole = cq.Assembly.importStep(str(path))
    return {child.name: child.toCompound() for child in whole.children}


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [pytest.param("none", marks=pytest.mark.study), "plate", "dowel", "stand", "hang"]
)
def test_tubes_and_mounts_are_true_solids(tmp_path: Path, kind: str) -> None:
    """Those of tubes have Pappus's volume, those of mounts are where and what the facets of part.stl are."""
    knots, camera, mounted, _ = made_by_hand(kind, {"step"}, tmp_path)
    solids = opened(tmp_path / "part.step")
    scale = np.cbrt(np.linalg.det(POSE[:3, :3]))
    own = mounted.fixtures(camera)
    kinds = {"none": [], "plate": ["peg"] * 3 + ["plate"], "dowel": ["peg", "dowel"] * 3}
    kinds |= {"stand": ["post", "strut", "base"], "hang": ["strut", "eyelet"]}
    assert [fixture.kind for fixture in own] == kinds[kind]
    assert [name.rstrip("0123456789 ") for name in solids] == ["knot", "knot", *kinds[kind]]
    assert all(len(s.Solids()) == 1 and s.isValid() for s in solids.values())
    for name, knot in zip(("knot 1", "knot 2"), knots.knots, strict=True):
        pappus = np.pi * knots.radius_mm**2 * knot.length_mm / scale**3
        assert solids[name].Volume() == pytest.approx(pappus, rel=2e-3)
    onto = np.linalg.inv(POSE)[:3]
    for name, fixture in zip(list(solids)[2:], own, strict=True):
        facets = fixture.solid().transform(onto)
        assert solids[name].Volume() == pytest.approx(facets.volume(), rel=0.02)
        box = solids[name].BoundingBox()
        corners = [box.xmin, box.ymin, box.zmin, box.xmax, box.ymax, box.zmax]
        assert corners == pytest.approx(np.array(facets.bounding_box()).tolist(), abs=0.05)


@pytest.mark.slow
def test_centre_lines_are_closed_splines_through_the_vertices(tmp_path: Path) -> None:
    import cadquery as cq

    knots, *_ = made_by_hand("none", {"step"}, tmp_path / "a")
    made_by_hand("none", {"step"}, tmp_path / "b", suffix="-01")  # as of a frame
    for name in ("centre-lines", "part"):
        one, other = tmp_path / "a" / f"{name}.step", tmp_path / "b" / f"{name}-01.step"
        assert one.read_bytes() == other.read_bytes()
    lines = opened(tmp_path / "a" / "centre-lines.step")
    assert list(lines) == ["knot 1", "knot 2"]
    for line, knot in zip(lines.values(), knots.moved(np.linalg.inv(POSE)).knots, strict=True):
        (edge,) = line.Edges()
        assert edge.IsClosed() and edge.geomType() == "BSPLINE"
        assert knot.length_mm <= edge.Length() <= 1.001 * knot.length_mm
        apart = [edge.distance(cq.Vertex.makeVertex(*p)) for p in knot.points[::17]]
        assert max(apart) < 1e-5


@pytest.mark.slow
def test_a_tube_that_folds_is_told_and_made_of_facets(tmp_path: Path) -> None:
    """The spline through the vertices bends more tightly than the tube is thick."""
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    tight = np.column_stack([30 * np.cos(t), 2.02 * np.sin(t), 0 * t])
    path = str(tmp_path / "part.step")
    tube = {"points": tight.tolist(), "radius_mm": 2.0}
    still = np.eye(4).tolist()
    assert write_solids(path, {"knot 1": tube}, {}, still) == ["knot 1"]
    assert not Path(path).exists()
    vertices, faces = sweep(tight * [1.0, 8.0, 1.0], 2.0, 12)
    facets = {"vertices": vertices.tolist(), "faces": faces.tolist()}
    assert write_solids(path, {"knot 1": facets}, {}, still) == []
    solid = opened(tmp_path / "part.step")["knot 1"]
    assert solid.isValid() and len(solid.Faces()) == len(faces)
    assert solid.Volume() == pytest.approx(mesh_volume(vertices, faces), rel=1e-6)


@pytest.mark.parametrize("most", [60_000, 100])
def test_a_piece_with_such_a_tube_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """A tube of more facets than can be written is left out."""
    asked: list[Any] = []

    def refuse_first(function: Any, path: str, *rest: Any) -> list[str]:
        if function is write_solids:
            asked.append(dict(rest[0]))
        return ["knot 2"] if len(asked) == 1 else []

    monkeypatch.setattr(also_file, "call_fixture", refuse_first)
    monkeypatch.setattr(also_file, "_MOST_FACETS", most)
    (said,) = made_by_hand("none", {"step"}, tmp_path).told
    if most == 100:
        assert said.startswith("part.step lacks the tube of knot 2") and "part.stl" in said
        assert list(asked[1]) == ["knot 1"]
    else:
        assert said.startswith("part.step holds the tube of knot 2 as a solid of facets")
        assert set(asked[1]["knot 1"]) == {"points", "radius_mm"}
        assert len(asked[1]["knot 2"]["faces"]) == 2 * 12 * 200


def test_facets_are_as_many_as_can_be_written_soon() -> None:
    """Even numbers about the tube; a tube of very many vertices has none, and a sentence says so."""
    sides = [also_file._count_sides(n) for n in (200, 1000, 1500, 2500, 5000, 5001)]
    assert sides == [12, 12, 8, 6, 6, 0]


@pytest.mark.slow
def test_a_tube_is_cut_only_on_the_inner_side_of_bends_where_it_would_fold() -> None:
    """An oval whose ends bend to 2.13 mm."""
    t = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    oval = np.column_stack([30 * np.cos(t), 8.0 * np.sin(t), 0 * t])
    fine = step._spline(oval)(np.linspace(*step._spline(oval).t[[3, -4]], 20_000))
    for radius in (1.9, 2.25):
        solid = step._sweep(oval, radius)
        assert solid is not None and solid.isValid()
        points = np.array([v.toTuple() for v in solid.tessellate(0.01, 0.1)[0]])
        away = cKDTree(fine).query(points)[0]
        cut = away < 0.995 * radius
        assert away.max() < 1.02 * radius and away.min() > 0.85 * radius
        assert (0 < cut.mean() < 0.1) == (radius > 2.13)
        assert (np.abs(points[cut, 0]) > 25).all() and (np.abs(points[cut, 0]) < 30).all()
    assert step._sweep(oval, 4.0) is None
