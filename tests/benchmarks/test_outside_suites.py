"""Files of outside suites are found, sorted by what is expected of them, and counted."""

from pathlib import Path

from benchmarks.outside_suites import expected, list_files, run_all, table


def test_files_are_judged_by_what_their_names_expect(tmp_path: Path) -> None:
    codes: dict[str, int | None] = {
        "core/P_MUSTPASS_cube.3mf": 0, "core/P_MUSTPASS_twisted.3mf": 1, "core/P_MUSTPASS_lost.3mf": 2,
        "core/MustFail/a.3mf": 2, "core/MustFail/b.3mf": 0, "lib/hangs.3mf": None, "lib/dies.stl": -11,
        "lib/knots/3_1.json": 0, "heart.png": 0,
    }  # fmt: skip
    for name in (*codes, "core/readme.md", "lib/._cube.3mf"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert len(list(list_files(tmp_path))) == len(codes)
    told: list[str] = []
    found = run_all(
        tmp_path, lambda path: (codes[str(path.relative_to(tmp_path))], "why"), told.append
    )
    assert {str(o.path.relative_to(tmp_path)) for o in found if o.wrong} == {
        "core/P_MUSTPASS_lost.3mf",
        "core/MustFail/b.3mf",
        "lib/hangs.3mf",
        "lib/dies.stl",
    }
    assert len(told) == 4 and all("why" in line for line in told)
    rows = {line.split(" | ")[0].strip("| "): line for line in table(found).splitlines()[2:]}
    assert rows["core"] == "| core | 5 | 2 | 1 | 2 | 0 | 0 | 0 | 2 |"
    assert rows["lib"] == "| lib | 3 | 1 | 0 | 0 | 0 | 1 | 1 | 2 |"


def test_the_innermost_name_decides() -> None:
    assert expected(Path("MUSTFAIL/must pass 1.3mf")) == "pass"
    assert expected(Path("suite/cube.3mf")) == ""
