"""What all tests share: the locale, and how they are dealt out to several workers."""

import copy
import gc
import locale
import os
import pickle
import pkgutil
import signal
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import cyclopts
import pytest
from hypothesis import settings
from PIL import Image

from knotfab.base import limited
from knotfab.base.pool import Workers
from knotfab.hold import modeller
from knotfab.pipeline import verifier
from knotfab_validators.shadows.told import DOOR

# the same examples in every run, and none fails by the clock; `make worst-cases` searches for others
settings.load_profile("ci")
# compiled code is kept: workers and the many children would compile all sources anew
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.fixture(scope="session", autouse=True)
def _keep_validators() -> Iterator[None]:
    """Validators go from one test to the next, whatever is skipped: loading VTK takes longer than most tests.

    Those of another environment, or that crash, come and go beside them.
    """
    hold, usual = verifier._hold, _validators_asked(1)

    @contextmanager
    def kept(skip: Collection[str], jobs: int, keep: bool = True) -> Iterator[Any]:
        keep, aside = _validators_asked(jobs) == usual, verifier._idle[:]
        if not keep:
            verifier._idle.clear()
        try:
            with hold({*skip} - {"shadow-render"}, jobs, keep) as held:
                yield held
        finally:
            if not keep:
                verifier._idle[:] = aside

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verifier, "_hold", kept)
        patch.setattr(verifier, "_surroundings", dict)
        yield
        verifier._end_idle()


@pytest.fixture(scope="session", autouse=True)
def _keep_modeller() -> Iterator[None]:
    """One modeller serves all builds of this process, which load OpenCascade once."""
    with Workers(modeller._MODULE, early=False) as kept, pytest.MonkeyPatch.context() as patch:

        @contextmanager
        def keep(early: bool) -> Iterator[None]:
            before = modeller._kept.set(kept)
            try:
                yield
            finally:
                modeller._kept.reset(before)

        patch.setattr("knotfab.pipeline.build.keep_modeller", keep)
        patch.setattr("knotfab.pipeline.workshop.rest_modeller", lambda: None)
        yield


def _validators_asked(jobs: int) -> tuple[object, ...]:
    return jobs, verifier._MODULE, sys.executable, os.environ.get("KNOTFAB_NO_RENDERING")


@pytest.fixture(scope="session", autouse=True)
def _draw_small() -> Iterator[None]:
    """Text and SVG files are drawn 512 px wide, not 2048: a sixteenth of the work to read and to verify.

    So are the pictures of the piece with its shadow, which a build draws last. Processes of their own draw
    all as large as ever, and tests/picture asks for that where it matters.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module in ("text", "svg.render"):
            patch.setattr(f"knotfab.picture.{module}.LONGER_SIDE", 512)
        for name, pixels in {"WIDE_PX": 480, "HIGH_PX": 360, "_DAY_PX": (240, 180)}.items():
            patch.setattr(f"knotfab.render.hung_picture.{name}", pixels)
        yield


@pytest.fixture(scope="session", autouse=True)
def _look_from_the_door() -> Iterator[None]:
    """Ask from two sides what a piece tells, not from twelve: a third of a shadow's seconds, and no check.

    Processes of their own ask from all, and so does test_told.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("knotfab_validators.shadows.told.SIDES", DOOR)
        yield


@pytest.fixture(scope="session", autouse=True)
def _read_here() -> Iterator[None]:
    """Pictures are read in this process: a copy of one so large takes longer than to read most of them.

    Tests of strangers' files, and of limits, ask for `copies`.
    """
    Image.init()  # else each copy would load all of Pillow's readers
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limited, "_is_copy", True)
        yield


@pytest.fixture
def copies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read strangers' files in limited copies of this process, as a build does."""
    monkeypatch.setattr(limited, "_is_copy", False)


@pytest.fixture(scope="session", autouse=True)
def _list_arguments_once() -> Iterator[None]:
    """A command's arguments are listed once and copied for each call: listing takes a tenth of a second."""
    assemble, kept = cyclopts.App.assemble_argument_collection, {}

    def copied(app: cyclopts.App, **given: Any) -> Any:
        key = id(app), app.default_command, *given.items()
        if key not in kept:
            kept[key] = app, assemble(app, **given)
        listed = kept[key][1]
        fresh = {id(argument): copy.copy(argument) for argument in listed}
        for argument in fresh.values():
            argument.tokens = []
            argument.children = type(listed)(fresh[id(child)] for child in argument.children)
        return type(listed)(fresh.values())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cyclopts.App, "assemble_argument_collection", copied)
        yield


@pytest.fixture(scope="session", autouse=True)
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What is kept in a user's folder of states is kept in one of the tests' own."""
    os.environ["KNOTFAB_STATE"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(scope="session", autouse=True)
def _heed_interrupts() -> None:
    """A command begun in the background of a shell ignores Ctrl-C, and so would all that it starts."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _same_locale() -> Iterator[None]:
    """lib3mf leaves the process in the locale "C"; tests that call it directly must not pass that on."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whole builds first, then what is slow, so that no worker is left with a long test at the end.

    For `--dist loadgroup`: the tests of a file go to one worker, since they share modules, caches and
    fixtures. Builds and slow tests that share nothing are dealt out one by one.
    """
    ranks: dict[str, int] = {}
    groups = []
    for item in items:
        rank = (
            0 if item.get_closest_marker("build") else 1 if item.get_closest_marker("slow") else 2
        )
        file = item.nodeid.partition("::")[0]
        alone = rank < 2 and not _shares(item)
        group = item.nodeid if alone else file
        if not alone:
            item.add_marker(pytest.mark.xdist_group(group))
        ranks[group] = min(rank, ranks.get(group, rank))
        groups.append(group)
    order = sorted(range(len(items)), key=lambda k: ranks[groups[k]])
    items[:] = [items[k] for k in order]


def pytest_collection_finish() -> None:
    """The garbage collector passes over what was collected, which stays: a twentieth of the tests' time."""
    gc.freeze()


def _shares(item: pytest.Item) -> bool:
    """Tell whether a test's file makes something once for several tests: a fixture, or a cached function."""
    module = item.module  # type: ignore[attr-defined]
    own = [f for f in vars(module).values() if getattr(f, "__module__", "") == module.__name__]
    info = getattr(item, "_fixtureinfo", None)
    defined = info.name2fixturedefs if info is not None else {}
    scopes = {found[-1].scope for found in defined.values()}
    cached = any(hasattr(f, "cache_info") for f in own) or "thrifty" in defined
    return cached or not scopes.isdisjoint(("class", "module"))


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """End the search for a diagram of fewer crossings early; it is long enough for those of these tests."""
    monkeypatch.setattr("knotfab_validators.knots.rerouting.WORK", 10_000)


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw text and SVG as large as in a build, which `_draw_small` spares other tests."""
    for module in ("text", "svg.render"):
        monkeypatch.setattr(f"knotfab.picture.{module}.LONGER_SIDE", 2048)


_KEPT: dict[tuple[str, bytes], Any] = {}


@pytest.fixture
def thrifty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read a picture, and fill it with curves, once for all tests that ask for this."""

    def once(name: str, function: Any) -> Any:
        def look_up(*given: Any, **named: Any) -> Any:
            key = name, pickle.dumps((given, named))
            if key not in _KEPT:
                _KEPT[key] = function(*given, **named)
            return _KEPT[key]

        return look_up

    for name in (
        *("picture.read._take_target", "picture.lamps.separate", "design.frames.count_dust"),
        *("start.lift.assign_lanes", "start.start.fill"),
    ):
        monkeypatch.setattr(f"knotfab.{name}", once(name, pkgutil.resolve_name(f"knotfab.{name}")))
