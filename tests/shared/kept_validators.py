"""Verifying children that outlive their verifier: loading VTK takes longer than most tests do."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from subprocess import Popen
from typing import Any

import pytest

from knotfab.base.pool import Workers
from knotfab.verify import verifier


class _Kept(Workers):
    """Children that wait for the next verifier, where all that they were asked is answered."""

    def __init__(self, command: Sequence[str], jobs: int, spare: list[_Kept]) -> None:
        super().__init__(command, jobs)
        self._spare, self._asked = spare, list[Future[dict[str, Any]]]()

    def ask(self, request: dict[str, Any]) -> Future[dict[str, Any]]:
        self._asked.append(super().ask(request))
        return self._asked[-1]

    def __exit__(self, *_: object) -> None:
        answered = all(f.done() and f.exception() is None for f in self._asked)
        if answered and all(process.poll() is None for process in self._processes):
            self._asked = []
            self._spare.append(self)
        else:
            self.dismiss()

    def dismiss(self) -> None:
        super().__exit__()


@contextmanager
def keep_validators() -> Iterator[None]:
    """Meanwhile, children go from one verifier to the next."""
    spare: defaultdict[tuple[object, ...], list[_Kept]] = defaultdict(list)

    def take(command: Sequence[str], jobs: int = 1, lent: Popen[str] | None = None) -> Workers:
        if lent is not None:
            return Workers(command, jobs, lent=lent)
        told = {k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"}
        waiting = spare[os.getcwd(), jobs, *command, *sorted(told.items())]
        return waiting.pop() if waiting else _Kept(command, jobs, waiting)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verifier, "Workers", take)
        try:
            yield
        finally:
            for children in [c for waiting in spare.values() for c in waiting]:
                children.dismiss()
