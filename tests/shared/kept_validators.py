"""Verifying children that outlive their verifier: loading VTK takes longer than most tests do."""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import pytest

from knotfab.verify import verifier
from knotfab.verify.verifier import _Child


class _Kept(_Child):
    """A child that waits for the next verifier, where all that it was asked is answered."""

    def __init__(self, arguments: list[str], spare: list[_Kept]) -> None:
        super().__init__(arguments)
        self._spare, self._asked = spare, list[Future[dict[str, Any]]]()

    def ask(self, request: dict[str, Any]) -> Future[dict[str, Any]]:
        self._asked.append(super().ask(request))
        return self._asked[-1]

    def end(self) -> None:
        answered = all(f.done() and f.exception() is None for f in self._asked)
        if answered and self._process.poll() is None:
            self._asked = []
            self._spare.append(self)
        else:
            super().end()

    def dismiss(self) -> None:
        super().end()


@contextmanager
def keep_validators() -> Iterator[None]:
    """Meanwhile, children go from one verifier to the next."""
    spare: defaultdict[tuple[object, ...], list[_Kept]] = defaultdict(list)

    def take(arguments: list[str]) -> _Kept:
        told = {k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"}
        waiting = spare[sys.executable, *arguments, *sorted(told.items())]
        return waiting.pop() if waiting else _Kept(arguments, waiting)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verifier, "_Child", take)
        try:
            yield
        finally:
            for child in [c for waiting in spare.values() for c in waiting]:
                child.dismiss()
