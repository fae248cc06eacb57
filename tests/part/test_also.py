"""Files for other tools, each opened by a reader of another make."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ezdxf
import numpy as np
import pytest
from setups import setup
from shapely.geometry import LinearRing, MultiPoint, Polygon
from svgelements import SVG, Group
from svgelements import Path as SvgPath

from knotfab.errors import InputError
from knotfab.files.folder import OutputFolder
from knotfab.knots import Knot, Knots
from knotfab.options import options_from
from knotfab.part.also import write_also
from knotfab.part.write import make_pose
from knotfab.prepare import check_options
from knotfab.scene.camera import Camera

POSE = np.array([[0.0, 0, 1, -3], [1, 0, 0, 2], [0, 1, 0, 7], [0, 0, 0, 1]])  # part.stl to scene


def made_by_hand(kind: Any, also: set[str], out: Path, **view: float) -> tuple[Knots, Camera]:
    """The files of the ring of `setup`, twice as knots; its knots in the scene and the camera."""
    mounted, scene, camera = setup(kind, **view)
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.stack([50 * np.cos(t), 50 * np.sin(t), 5 * np.sin(2 * t)], axis=1)
    knots = Knots((Knot(ring), Knot(0.4 * ring)), 2.0)
    own = knots.moved(np.linalg.inv(POSE))
    pose = make_pose(POSE)
    part: Any = SimpleNamespace(mounted=mounted, pose=SimpleNamespace(knots=own, matrix=POSE))
    target: Any = SimpleNamespace(width=camera.width, height=camera.height)
    with OutputFolder(out) as folder:
        write_also(folder, part, scene.model_copy(update={"pose": pose}), [target], also)
        folder.commit()
    return knots, camera


def wanted_lines(knots: Knots, camera: Camera) -> list[np.ndarray]:
    """Where the light throws the knots, mm from the lower left corner of the frame, by the camera."""
    pixel = camera.frame_mm[0] / camera.width
    places = [(camera.project(k.points) + 0.5) * pixel for k in knots.knots]
    return [np.column_stack([p[:, 0], camera.frame_mm[1] - p[:, 1]]) for p in places]


def svg_lines(path: Path) -> dict[str, list[np.ndarray]]:
    """By group the closed lines of an SVG, mm from the lower left corner of the page."""
    page = SVG.parse(path, ppi=25.4)  # 1 px is 1 mm
    found: dict[str, list[np.ndarray]] = {}
    for group in page.select(lambda e: isinstance(e, Group) and e.id is not None):
        for sub in (sub for one in group for sub in one.as_subpaths()):
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
    knots, camera = made_by_hand(kind, {"svg", "dxf"}, tmp_path / "out", azimuth_deg=azimuth)
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
    knots, camera = made_by_hand(kind, {"svg"}, tmp_path / "out")
    assert not (tmp_path / "out" / "centre-lines.dxf").exists()
    (lines,) = svg_lines(tmp_path / "out" / "shadow-front.svg").values()
    shadow = Polygon()
    for line in lines:
        shadow = shadow.symmetric_difference(Polygon(line))
    ring = LinearRing(wanted_lines(knots, camera)[0])
    assert shadow.contains(ring)
    grown = 2.0 * camera.magnify(knots.knots[0].points).mean()
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
    with pytest.raises(InputError, match=r"--also \w*: there is no such format.*svg, dxf"):
        check_options(options_from({"also": also}))


@pytest.mark.parametrize("also", ["svg", "SVG, dxf", ("svg", "dxf"), ["dxf"], ()])
def test_formats_by_commas_or_one_by_one(also: Any) -> None:
    check_options(options_from({"also": also}))
