"""What all tests share."""

import locale
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _same_locale() -> Iterator[None]:
    """lib3mf leaves the process in the locale "C"; tests that call it directly must not pass that on."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)
