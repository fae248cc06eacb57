"""The table of what compares with the paper: each of its commands is there."""

from importlib.util import find_spec

import pytest

from paper.table import SECTIONS


@pytest.mark.parametrize("name", SECTIONS)
def test_every_section_is_a_module(name: str) -> None:
    assert find_spec(SECTIONS[name].module) is not None
