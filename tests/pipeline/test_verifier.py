"""Verdicts as a build has them."""

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import permutations
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest
from reports import check_of, verdict_of

from knotfab.base.errors import MachineError
from knotfab.base.pool import Crash
from knotfab.pipeline import verifier
from knotfab.pipeline.verifier import Answer, Files, Verifier, list_unread, load_early
from knotfab_formats.errors import plain

# It answers with its own number and the file that it was asked about.
ECHO = """
import os
def answer(request, told):
    seconds = {"all": os.getpid()}
    if request["part"].endswith("killed") and not os.path.exists("killed-once"):
        open("killed-once", "w").close()
        os.kill(os.getpid(), 9)
    told = {"status": "pass", "exit_code": 0, "size_mm": None, "notes": [], "checks": [], "views": []}
    return {**told, "conclusion": request["part"], "colours": None, "picture": None, "seconds": seconds}
"""


HOLD, SURROUNDINGS = verifier._hold, verifier._surroundings


def answer(*names: str) -> Future[dict[str, Any]]:
    """What a process answers that measured these checks."""
    found: Future[dict[str, Any]] = Future()
    found.set_result(plain(verdict_of(checks=[plain(check_of(name)) for name in names])))
    return found


def test_a_report_lists_checks_in_one_order() -> None:
    names = ("shadow", "centre_line", "mesh_closed", "region", "thing of tomorrow")
    (order,) = {
        tuple(check.name for check in Answer(answer(*some)).result().checks)
        for some in permutations(names)
    }
    assert set(order) == set(names) and order[-1] == "thing of tomorrow"


@pytest.fixture
def echo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Validators that measure nothing and are there at once; those of conftest.py are kept anyway."""
    (tmp_path / "echo.py").write_text(ECHO)
    paths = str(tmp_path), os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.setenv("KNOTFAB_JOBS", "1")
    monkeypatch.setattr(verifier, "_MODULE", "echo")
    monkeypatch.setattr(verifier, "_idle", [])
    monkeypatch.setattr(verifier, "_hold", HOLD)
    monkeypatch.setattr(verifier, "_surroundings", SURROUNDINGS)
    yield
    verifier._end_idle()


def ask(part: str = "part.stl", keep: bool = True) -> tuple[int, str]:
    """The process that answers a build, and the file that it is asked about."""
    with load_early(keep=keep), Verifier() as validators:
        answer = validators.submit(Files(Path(part))).result()
    return int(answer.seconds["all"]), answer.conclusion


def is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_validators_stay_for_the_next_build_where_asked(echo: None) -> None:
    kept, _ = ask()
    assert is_there(kept) and [ask()[0], ask(keep=False)[0]] == [kept, kept]
    assert not is_there(kept)  # the last one did not keep them
    assert ask(keep=False)[0] != ask(keep=False)[0]


def test_kept_validators_that_died_are_replaced(echo: None) -> None:
    first, _ = ask()
    (process,) = verifier._idle[0]._workers.processes
    process.kill()
    process.wait()
    second, _ = ask()
    assert second != first and is_there(second)


def test_a_validator_that_is_killed_is_started_again(
    echo: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ask("part.killed")[1].endswith("part.killed")


def test_kept_validators_find_a_file_from_another_folder(
    echo: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask()
    monkeypatch.chdir(tmp_path)
    assert ask("part.stl")[1] == str(tmp_path / "part.stl")


def test_builds_of_two_threads_ask_validators_of_their_own(echo: None) -> None:
    together = Barrier(2)

    def build(name: str) -> list[str]:
        with load_early(keep=True), Verifier() as validators:
            together.wait(20)
            answers = [validators.submit(Files(Path(name))).result() for _ in range(20)]
        return [answer.conclusion for answer in answers]

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(build, ["/a", "/b"], timeout=60))
    assert found == [["/a"] * 20, ["/b"] * 20]
    assert len(verifier._idle) == 1


@pytest.mark.skipif(not hasattr(os, "register_at_fork"), reason="this system does not fork")
def test_a_fork_leaves_its_parents_validators_alone(echo: None) -> None:
    kept, _ = ask()
    code = 1
    if (pid := os.fork()) == 0:
        code = bool(verifier._idle)
        os._exit(code)
    assert os.waitpid(pid, 0)[1] == 0 and ask()[0] == kept


def test_validators_that_did_not_answer_are_not_kept(echo: None) -> None:
    with load_early(keep=True), Verifier() as validators:
        validators.submit(Files(Path("part.stl"))).result()
        held = validators._validators
        held._workers._free.get()  # as one that still answers
    assert not verifier._idle and held._workers.ended.is_set()


def test_a_verification_that_does_not_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifier, "LIMIT_S", 0.01)
    with pytest.raises(MachineError, match=r"did not end in .* minutes.*--skip") as caught:
        Answer(Future()).result()
    assert caught.value.exit_code == 3


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("what():  std::bad_alloc", "the memory: "),
        ("ImportError: a.so: failed to map segment from shared object", "the memory: "),
        ("no display", "If graphics are"),
    ],
)
def test_a_process_that_ended_says_what_it_lacked(said: str, why: str) -> None:
    ended = Future[dict[str, Any]]()
    ended.set_exception(Crash(-6, said))
    with pytest.raises(MachineError, match=why):
        Answer(ended).result()


def test_what_validators_do_not_read_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("[[views]]\npicture = 'picture-front.png'\n")
    for name in (
        "part.stl",
        "part.3mf",
        "knots.json",
        "slicer.ini",
        "picture-front.png",
        ".hidden",
    ):
        (tmp_path / name).write_bytes(b"")
    files = Files(tmp_path / "part.stl", tmp_path / "knots.json", tmp_path / "scene.toml")
    assert list_unread(files) == []
    for name in ("report.html", "part.glb"):
        (tmp_path / name).write_bytes(b"")
    assert list_unread(files) == ["not checked: part.glb, report.html"]
    for number in range(30):
        (tmp_path / f"{number:02}.png").write_bytes(b"")
    assert list_unread(files)[0].endswith("19.png and 12 more")
