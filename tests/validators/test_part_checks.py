"""What is checked follows from the files that are given; limits follow from knots and scene."""

import numpy as np
import pytest
from validator_parts import circle, tube

from knotfab_formats.verdict import KNOTS, PRINTING, Check
from knotfab_formats.verdict import MESH as MESH_CHECKS
from knotfab_validators.files.scene import Scene, parse_scene
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.part_checks import part_checks

CURVE = circle(180, 40.0) + [50.0, 50.0, 10.0]
POSE = [[1, 0, 0, -50], [0, 1, 0, -50], [0, 0, 1, -10], [0, 0, 0, 1]]
MESH = Mesh(*tube(CURVE, 3.0, 48))


def knot(radius: float | None = 3.0) -> Curves:
    return Curves((CURVE,), ("unknot",), (True,), radius)


def scene(**tables: dict[str, object]) -> Scene:
    return parse_scene({"pose": {"matrix": POSE}, **tables})


def run(mesh: Mesh | None, curves: Curves | None, setting: Scene | None) -> dict[str, Check]:
    seconds: dict[str, float] = {}
    checks = part_checks(mesh, curves, setting, seconds)
    assert all(s >= 0 for s in seconds.values())
    assert len({c.name for c in checks}) == len(checks)
    return {c.name: c for c in checks}


def ran(checks: dict[str, Check]) -> set[str]:
    return {name for name, c in checks.items() if c.status != "skipped"}


def test_a_right_part_passes_all() -> None:
    checks = run(MESH, knot(), scene())
    assert {c.name for c in checks.values() if c.required and c.status != "pass"} == set()
    assert {"thickness", "bend", "length", "knot_type", "region", "build_volume"} < set(checks)
    assert checks["thickness"].limit == pytest.approx(3.2)
    assert checks["bend"].limit == pytest.approx(3.2)


def test_knots_alone_must_reach_their_radius() -> None:
    assert ran(run(None, knot(), None)) - {"linking"} == {"thickness", "knot_type"}
    assert run(None, knot(), None)["thickness"].limit == 3.0
    assert run(None, knot(39.0), None)["thickness"].status == "pass"
    assert run(None, knot(41.0), None)["thickness"].status == "fail"
    measured = run(None, knot(None), None)["thickness"]
    assert measured.status == "pass" and measured.limit is None
    assert measured.measured == pytest.approx(40.0, rel=1e-3)


@pytest.mark.slow
def test_limits_come_from_the_scene() -> None:
    tight = scene(piece={"clearance_mm": 80.0}, material={"min_bend_radius_mm": 50.0})
    checks = run(None, knot(), tight)
    assert checks["thickness"].limit == 43.0 and checks["thickness"].status == "fail"
    assert checks["bend"].limit == 50.0 and checks["bend"].status == "fail"
    short = run(None, knot(), scene(material={"max_length_mm": 200.0}))["length"]
    assert short.status == "fail" and short.measured == pytest.approx(2 * np.pi * 40, rel=1e-3)
    small = run(MESH, knot(), scene(region={"size_mm": [80, 90, 20]}))["region"]
    assert small.status == "fail" and small.measured == pytest.approx(3.0)
    low = run(MESH, knot(), scene(printer={"build_volume_mm": [250, 210, 10]}))["build_volume"]
    assert low.status == "fail" and low.measured == pytest.approx(3.0, abs=1e-2)


@pytest.mark.parametrize("asked", ["auto", 1, 2])
def test_as_many_knots_as_the_scene_says(asked: object) -> None:
    own = run(MESH, knot(), scene(piece={"knots": asked}))["knot_type"]
    assert (own.status == "fail", own.required) == (asked == 2, True)
    assert ("piece.knots is 2, and there are 1" in own.detail) == (asked == 2)


def test_a_group_that_is_left_out_whole_is_not_measured() -> None:
    groups = {"mesh": MESH_CHECKS, "knot type": KNOTS, "tube": ("tube", "clearance")}
    for stage, names in groups.items():
        seconds: dict[str, float] = {}
        checks = part_checks(MESH, knot(), scene(), seconds, skip=(*names, *PRINTING))
        assert stage not in seconds and seconds.keys() | {stage} >= groups.keys()
        assert {c.name for c in checks if c.detail == "left out on request"} == {*names, *PRINTING}


SMALL = Mesh(*tube(circle(24, 20.0) + [30.0, 30.0, 4.0], 3.0, 8))
OPEN = Mesh(SMALL.vertices, SMALL.faces[1:])
NO_NUMBER = Mesh(
    np.where(np.arange(len(SMALL.vertices))[:, None] == 7, np.nan, SMALL.vertices), SMALL.faces
)


@pytest.mark.parametrize(
    ("part", "why"),
    [
        (SMALL, None),
        (OPEN, "the surface is broken (mesh_closed"),
        (NO_NUMBER, "the surface is broken (mesh_"),
    ],
)
def test_a_broken_surface_is_never_called_printable(part: Mesh, why: str | None) -> None:
    asked, *others = PRINTING
    skip = (*MESH_CHECKS, *others, "centre_line")
    (check,) = (c for c in part_checks(part, None, scene(), {}, skip) if c.name == asked)
    assert check.status == ("skipped" if why else "pass")
    assert check.detail.startswith(why or check.detail)


@pytest.mark.slow
def test_a_part_alone_is_checked_for_its_surface() -> None:
    checks = run(MESH, None, None)
    assert len({name for name in ran(checks) if name.startswith("mesh_")}) == 9
    assert not ran(checks) & {"tube", "bend", "length", "region"}
    assert ran(checks) > {"centre_line", "thickness", "knot_type", "clearance"}
    assert {checks[name].status for name in ran(checks) if checks[name].required} == {"pass"}
    assert run(MESH, None, scene())["region"].status == "pass"


def test_without_any_radius_the_bend_cannot_be_judged() -> None:
    assert run(None, knot(None), scene())["bend"].status == "skipped"
    known = run(None, knot(None), scene(piece={"tube_radius_mm": 41.0}))
    assert known["thickness"].status == known["bend"].status == "fail"


@pytest.mark.slow
def test_every_check_is_named_whatever_is_given() -> None:
    everything = set(run(MESH, knot(), scene()))
    for given in [(MESH, None, None), (None, knot(), None), (None, None, scene())]:
        checks = run(*given)
        assert set(checks) == everything
        left = [c for c in checks.values() if c.status == "skipped"]
        assert left and not any(c.required for c in left)
        assert {c.name for c in left if "given" not in c.detail} <= {"linking", "clearance"}
