"""The broken parts of the corpus: each is a good one with one named fault, and one check must reject it."""

from .broken_files import broken_files, refused_files
from .broken_knots import broken_knots
from .broken_mesh import broken_mesh
from .broken_print import broken_print
from .broken_shadow import broken_shadow
from .case import Broken


def broken_parts() -> list[Broken]:
    """All but the files made by hand, which take seconds to make."""
    return [*broken_mesh(), *broken_knots(), *broken_shadow(), *broken_print(), *broken_files()]


def broken() -> list[Broken]:
    """All broken cases; their names differ."""
    cases = [*broken_parts(), *refused_files()]
    assert len({case.name for case in cases}) == len(cases)
    return cases
