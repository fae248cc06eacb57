"""Work with limits: what it gives and raises comes back, and nothing that it does ends this process."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable

import pytest

from knotfab.base import limited
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.limited import end_copies, run_limited
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="only Linux makes copies"),
    pytest.mark.usefixtures("copies"),
]


def spin() -> None:
    while True:
        pass


def rest() -> None:
    time.sleep(60)


def refuse() -> None:
    raise SceneError("the thing", "it is wrong", "Mend it.")


def hold() -> None:
    error = SceneError("the thing", "it is wrong", "Mend it.")
    error.lock = threading.Lock()  # type: ignore[attr-defined]
    raise error


def test_what_is_given_and_raised_comes_back() -> None:
    here = os.getpid()
    assert run_limited(lambda: (os.getpid() != here, b"x" * 3_000_000), "it", seconds=5) == (
        True,
        b"x" * 3_000_000,
    )
    with pytest.raises(SceneError, match=r"the thing: it is wrong\. Mend it\.") as caught:
        run_limited(refuse, "it", seconds=5)
    assert caught.value.why == "it is wrong" and caught.value.exit_code == 1
    with pytest.raises(FileNotFoundError) as missing:
        run_limited(lambda: os.stat("/no/such/file"), "it", seconds=5)
    assert missing.value.errno == 2
    # pydantic's errors cannot be made again from their arguments, nor can what holds a lock be sent
    for work, kind in ((lambda: Reading(threshold=2.0), "ValidationError"), (hold, "SceneError")):
        with pytest.raises(MachineError, match=f"a mistake of knotfab's own: {kind} "):
            run_limited(work, "it", seconds=5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("work", "said"),
    [
        (spin, "it: reading it takes more than 1 s"),
        (rest, "it: reading it takes more than 1 s"),
        (lambda: bytearray(2 * 2**30), "it: reading it takes more than 1 GB"),
        (os.abort, "it: reading it crashes"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "it: reading it crashes"),
        (lambda: os._exit(0), "it: reading it crashes"),
    ],
)
def test_work_that_takes_too_much_is_one_sentence(
    work: Callable[[], object], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if work is rest:  # the clock ends it, after ten times the processor time that is allowed
        monkeypatch.setattr(limited, "_SLOWER", 0.1)
    with pytest.raises(InputError, match=said):
        run_limited(work, "it", seconds=1, gigabytes=1)


def test_an_interrupt_ends_it() -> None:
    def interrupt() -> None:
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        run_limited(spin, "it", seconds=60)
    assert not limited._living


def test_it_ends_with_all_copies() -> None:
    threading.Timer(0.5, end_copies).start()
    with pytest.raises(InputError, match="crashes"):
        run_limited(spin, "it", seconds=60)
