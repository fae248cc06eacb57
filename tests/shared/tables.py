"""Tables of cases that are walked whole only where there is time."""

from collections.abc import Iterable
from typing import Any

import pytest


def some(cases: Iterable[Any], every: int) -> list[Any]:
    """The first of every so many cases for `make test`; the others are studies of `make all-tests`.

    A case is the value of one argument, or a tuple of those of several.
    """
    found = []
    for number, case in enumerate(cases):
        values = case if isinstance(case, tuple) else (case,)
        marks = [pytest.mark.study] if number % every else []
        found.append(pytest.param(*values, marks=marks))
    return found
