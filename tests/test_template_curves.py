"""Templates from formulas and by name are the knots and links that they are called."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from examples.paper.curves import (
    arc,
    circle,
    closed_braid,
    figure_eight,
    helix,
    hopf_link,
    spiral,
    torus_knot,
    torus_link,
)
from examples.paper.open_tube import Cap, open_volume, sweep_open
from examples.paper.tighten import tighten
from knotfab.effects.base import Limits
from knotfab.errors import InputError, SceneError
from knotfab.files.stl import write_stl
from knotfab.geometry.measures import bend_radii, strand_gap
from knotfab.geometry.polylines import rings_of_sizes
from knotfab.geometry.tube import mesh_volume, tube_manifold
from knotfab.knots import Knot, Knots
from knotfab.scene.knot_names import BRAIDS, load_knot, parse_knot_name
from knotfab.scene.model import Region
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types
from knotfab_validators.knots.names import promised_knot
from knotfab_validators.validate import validate

Array = NDArray[np.float64]
UNIT = Limits(1.0, 0.0, 1.0, np.inf, Region())


def found(*curves: Array, promise: str = "") -> tuple[str, str]:
    """What the independent check says of the first curve alone or in its link: sentence, verdict."""
    types = knot_types(Curves(curves, (promise,) * len(curves), (True,) * len(curves), 1.0))
    return types.knots[0].sentence, types.knots[0].verdict


def linking(*curves: Array) -> list[int]:
    types = knot_types(Curves(curves, ("",) * len(curves), (True,) * len(curves), 1.0))
    return [n for _, _, n in types.linking.numbers]


@pytest.mark.parametrize(
    ("p", "q", "name"),
    [
        (2, 3, "right-handed 3_1"),
        (2, -3, "left-handed 3_1"),
        (3, 2, "right-handed 3_1"),
        (2, 7, "right-handed 7_1"),
        (3, 4, "right-handed 8_19"),
        (5, 1, "unknot"),
    ],
)
def test_torus_knots(p: int, q: int, name: str) -> None:
    assert found(torus_knot(p, q))[0] == f"{name}, proved"


def test_circle_and_figure_eight() -> None:
    ring = circle(7.0, 50)
    assert np.linalg.norm(ring, axis=1) == pytest.approx(np.full(50, 7.0))
    assert found(ring)[0] == "unknot, proved"
    assert found(figure_eight(2.0))[0] == "4_1, proved"


def test_links() -> None:
    assert [abs(n) for n in linking(*hopf_link(3.0))] == [1]
    # every two of the components of T(n, n) are linked once, right-handedly with p, q > 0
    assert linking(*torus_link(3, 3)) == [1, 1, 1]
    assert linking(*torus_link(2, -4)) == [-2]
    assert len(closed_braid([1, 1])) == 2
    assert linking(*closed_braid([1, 1])) == [1]


@pytest.mark.parametrize("call", [(0, 3), (2, 4), (3, 0)])
def test_torus_knots_that_are_none(call: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="torus"):
        torus_knot(*call)


def test_a_torus_about_its_own_axis_and_empty_braids_are_refused() -> None:
    with pytest.raises(InputError, match="meets its own axis"):
        torus_knot(2, 3, major=1.0, minor=2.0)
    for word in ([], [1, 0]):
        with pytest.raises(InputError, match="must not be 0"):
            closed_braid(word)
    with pytest.raises(InputError, match="samples"):
        circle(1.0, 2)


@pytest.mark.parametrize("name", BRAIDS)
def test_every_named_knot_is_that_knot_and_fits_its_tube(name: str) -> None:
    points = load_knot(name)
    rings = rings_of_sizes((len(points),))
    assert strand_gap(points, rings, UNIT.separation, 4.0).gap > 2.0
    assert bend_radii(points, rings).min() > 0.95
    sentence, verdict = found(points, promise=parse_knot_name(name).promise)
    assert verdict in ("proved", "consistent"), sentence
    # the braid is of the same knot, by the same check
    assert found(closed_braid(BRAIDS[name])[0], promise=parse_knot_name(name).promise)[
        1
    ] == verdict or (verdict == "consistent" or name in ("8_8", "8_16"))


@pytest.mark.parametrize("name", ["3_1", "5_2", "7_4", "8_19", "8_20"])
def test_a_mirrored_knot_is_left_handed(name: str) -> None:
    points = load_knot(name, mirrored=True)
    assert found(points, promise=f"left-handed {name}")[1] in ("proved", "consistent")
    assert found(points, promise=f"right-handed {name}")[1] == "refuted"


@pytest.mark.parametrize(
    ("asked", "promise"),
    [
        ("unknot", "unknot"),
        ("0_1", "unknot"),
        ("Trefoil", "right-handed 3_1"),
        ("left trefoil", "left-handed 3_1"),
        ("left-handed trefoil knot", "left-handed 3_1"),
        ("m3_1", "left-handed 3_1"),
        ("left figure-eight", "4_1"),
        ("T(3, 4)", "right-handed 8_19"),
        ("granny", "right-handed 3_1#3_1"),
        ("square", "3_1#m3_1"),
        ("4_1#m5_2", "left-handed 4_1#5_2"),
        ("right 6_3", "6_3"),
    ],
)
def test_names(asked: str, promise: str) -> None:
    name = parse_knot_name(asked)
    assert name.promise == promise
    assert promised_knot(name.promise).meant, "the validator understands it"
    assert len(promised_knot(name.promise).meant) == 1, "and it is one knot, of one hand"


@pytest.mark.parametrize(
    "asked", ["3_2", "9_1", "cat", "3_1#", "m", "left", "#", "3_1#" * 7 + "3_1"]
)
def test_unknown_names_say_what_is_known(asked: str) -> None:
    with pytest.raises(InputError) as error:
        parse_knot_name(asked)
    assert error.value.exit_code == 2
    assert "8_19" in str(error.value) or "at most" in str(error.value)


def test_tightening_a_braid_gives_a_short_knot_of_its_type() -> None:
    tight = tighten(closed_braid(BRAIDS["3_1"])[0])
    # the ropelength of the trefoil is 32.74 (radius 1): the polygon comes near from above
    assert 32.7 < tight.length < 34.0
    assert tight.gap >= 2.0 and tight.bend >= 1.0
    assert found(tight.points)[0] == "right-handed 3_1, proved"


OPEN = {
    "arc": arc(20.0, 250.0, 120),
    "helix": helix(10.0, 12.0, 2.5, 200),
    "spiral": spiral(6.0, 5.0, 2.5, 0.8),
    "straight": np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 9.0]]),
}


@pytest.mark.parametrize("cap", ["round", "flat"])
@pytest.mark.parametrize("sides", [3, 7, 24])
@pytest.mark.parametrize("name", OPEN)
def test_an_open_tube_is_a_ball_with_the_exact_volume(name: str, sides: int, cap: Cap) -> None:
    vertices, faces = sweep_open(OPEN[name], 1.5, sides, cap)
    wanted = open_volume(OPEN[name], 1.5, cap)
    assert mesh_volume(vertices, faces) == pytest.approx(wanted, rel=1e-9)
    assert tube_manifold(vertices, faces, wanted, genus=0).genus() == 0
    with pytest.raises(SceneError, match="genus"):
        tube_manifold(vertices, faces, wanted)


def test_the_caps_end_where_they_must() -> None:
    line = OPEN["straight"]
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    length = float(np.linalg.norm(line[1] - line[0]))
    ends: dict[Cap, float] = {"flat": 0.0, "round": 1.5}
    for cap, end in ends.items():
        vertices, _ = sweep_open(line, 1.5, 48, cap)
        height = (vertices - line[0]) @ along
        assert (height.min(), height.max()) == pytest.approx((-end, length + end), abs=0.02)


def test_open_lines_that_no_tube_fits_are_refused() -> None:
    with pytest.raises(SceneError, match="bends to a radius"):
        sweep_open(arc(1.0, 250.0, 100), 1.5, 12)
    with pytest.raises(SceneError, match="coincide"):
        sweep_open(np.zeros((2, 3)), 1.5, 12)
    with pytest.raises(ValueError, match="points must be"):
        sweep_open(np.zeros((1, 3)), 1.5, 12)
    hairpin = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [60.0, 8.0, 0.0], [30.0, 16.0, 0.0]])
    with pytest.raises(SceneError, match="vertex 2"):
        sweep_open(hairpin, 5.0, 12)


def test_an_open_tube_passes_the_independent_checks(tmp_path: Path) -> None:
    """A spiral's files: its length leaves the closing edge out, and the surface is its tube."""
    points = OPEN["spiral"] + [30.0, 30.0, 5.0]
    knot = Knot(points, "open", closed=False)
    assert knot.length_mm == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    knots = Knots((knot,), 1.5)
    knots.write(tmp_path / "knots.json")
    assert json.loads((tmp_path / "knots.json").read_text())["knots"][0]["closed"] is False
    vertices, faces = sweep_open(points, 1.5, 48)
    write_stl(tmp_path / "part.stl", [(vertices, faces)])
    verdict = validate(tmp_path / "part.stl", tmp_path / "knots.json")
    status = {check.name: check.status for check in verdict.checks}
    for name in ("mesh_closed", "mesh_genus", "mesh_volume", "mesh_self_intersection", "tube"):
        assert status[name] == "pass", name
    assert status["thickness"] == "pass"
    assert not [name for name, found in status.items() if found == "fail"]
