"""The checks of printability together: turned, without a printer, skipped, and their times."""

from __future__ import annotations

import re
from types import ModuleType

import pytest
from printed_solids import BARE, PRINTER, run
from solids import box, bridge, inward, move, quarter, table, together

from knotfab_formats.piece import Printer
from knotfab_formats.verdict import PRINTING
from knotfab_validators.printing import local_thickness, standing
from knotfab_validators.printing.printability import printability_checks


def test_a_quarter_turn_changes_nothing_beyond_the_grid() -> None:
    mesh = together(bridge(12.0, 7.3), move(table(), shift=(0, 20, 0)))
    one, two = run(mesh, BARE), run(quarter(mesh), BARE)
    for name in PRINTING:
        a, b = one[name].measured, two[name].measured
        assert a == pytest.approx(b, rel=0.02, abs=1e-9), name


def test_no_printer_measures_against_nothing() -> None:
    found = run(box((0, 0, 0), (10, 10, 0.2)), None)
    assert tuple(found) == PRINTING
    assert all(c.status == "pass" and not c.required for c in found.values())
    assert all("no printer was named" in c.detail for n, c in found.items() if n != "standing")
    assert run(box((0, 0, 0), (10, 10, 0.2)), Printer(name="other"))["feature"].limit is None


def test_what_cannot_be_measured_is_skipped_with_the_reason() -> None:
    mesh = box((0, 0, 0), (1, 1, 1))
    checks = printability_checks(mesh, PRINTER, seconds={}, lacking="the mesh is open")
    assert [(c.name, c.status, c.detail) for c in checks] == [
        (name, "skipped", "the mesh is open") for name in PRINTING
    ]
    huge = run(box((0, 0, 0), (1e6, 1, 1)))
    assert {c.status for c in huge.values()} == {"skipped"}


@pytest.mark.parametrize(
    ("module", "limit", "said"),
    [
        (local_thickness, "MOST_PAIRS", "faces beside the narrowest places"),
        (standing, "MOST_BODIES", "bodies"),
        (standing, "MOST_AROUND", "pairs of a hollow and a face"),
    ],
)
def test_a_check_ends_at_its_limit_of_work_in_a_sentence(
    module: ModuleType, limit: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = together(box((0, 0, 0), (20, 20, 3)), box((0, 0, 3.5), (20, 20, 6.5)))
    mesh = together(near, inward(box((1, 1, 1), (19, 19, 2))))
    assert {c.status for c in run(mesh).values()} != {"skipped"}
    monkeypatch.setattr(module, limit, 1)
    found = run(mesh)
    assert tuple(found) == PRINTING
    for check in found.values():  # a printer was named: without them nothing is accepted
        assert check.status == "skipped" and check.required
        assert re.fullmatch(rf"not tested: \d+ {said}, more than 1", check.detail)
    assert not any(check.required for check in run(mesh, None).values())


def test_the_time_of_each_group_is_told() -> None:
    seconds: dict[str, float] = {}
    printability_checks(box((0, 0, 0), (5, 5, 5)), PRINTER, seconds=seconds)
    assert set(seconds) == {"feature", "gap", "overhang", "bridges", "standing"}


POWDER = Printer(name="powder", nozzle_mm=0.5, process="powder", min_wall_mm=1.0, min_gap_mm=0.6)


def test_in_powder_nothing_overhangs_but_walls_and_gaps_count() -> None:
    """A table over air, floating above the bed: powder carries it. Its walls and gaps are the process's."""
    air = move(table(), shift=(0, 0, 40))
    found = run(air, POWDER)
    assert tuple(found) == PRINTING
    asked = {name for name, check in found.items() if check.status != "skipped"}
    assert asked == {"feature", "gap"}
    assert all("powder" in c.detail for n, c in found.items() if n not in asked)
    assert run(air, BARE)["islands"].status == run(air, BARE)["floating"].status == "fail"
    thin = box((0, 0, 0), (20, 20, 0.9))
    assert run(thin, POWDER)["feature"].status == "fail"
    assert run(thin, PRINTER)["feature"].status == "pass"
    near = together(box((0, 0, 0), (20, 20, 3)), box((0, 0, 3.5), (20, 20, 6.5)))
    assert run(near, POWDER)["gap"].status == "fail"
    assert "powder must come out" in run(near, POWDER)["gap"].detail
    assert run(near, PRINTER)["gap"].status == "pass"


def test_a_stand_of_powder_still_has_to_stand() -> None:
    tower = box((0, 0, 0), (5, 5, 20))
    found = run(tower, POWDER, stands=True)
    assert found["standing"].status == "pass" and found["standing"].required
    assert found["overhang"].status == "skipped"
