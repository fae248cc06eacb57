"""How supports are reached: what is open, what is shut in, and windows that only some tools pass."""

import numpy as np
import pytest
from rings import ring
from solids import box, move, together

from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import sweep
from knotfab.part.access import TOOLS_MM, measure_access, tell_access
from knotfab_formats.report import SupportAccess
from knotfab_validators.geometry.mesh import Mesh


def measured(*bodies: Mesh) -> SupportAccess:
    return measure_access([(b.vertices, b.faces.astype(np.int32)) for b in bodies], Rules())


def room(window: float, side: float = 40.0, wall: float = 2.0) -> Mesh:
    """A shut room on the bed; one wall leaves a slit of a height `window` open below the ceiling."""
    s, w = side, wall
    return together(
        box((0, 0, 0), (s, s, w)),
        box((0, 0, s - w), (s, s, s)),
        box((0, 0, w), (w, s, s - w)),
        box((s - w, 0, w), (s, s, s - w)),
        box((w, s - w, w), (s - w, s, s - w)),
        box((w, 0, w), (s - w, w, s - w - window)),
    )


def test_a_ring_in_the_air_is_open_to_all() -> None:
    found = measure_access([sweep(ring(40.0, 30.0, 120, wave=0.0), 2.0, 16)], Rules())
    assert set(found.reached) == set(TOOLS_MM)
    assert all(share == 1.0 for share in found.reached.values())
    assert found.worst_tool == "finger" and "100%" in tell_access(found)
    # a quarter turn to either side sees half of the underside's circumference
    assert found.area_cm2 == pytest.approx(2 * np.pi * 40 * 2.0 * np.pi / 2 / 100, rel=0.1)


@pytest.mark.slow
def test_what_is_shut_in_is_reached_by_nothing() -> None:
    found = measured(room(0.0))
    assert all(share == 0.0 for share in found.reached.values())
    assert found.worst is not None and found.worst_tool is None
    assert "needs a bent tool" in tell_access(found)
    x, y, z = found.worst
    assert 2 < x < 38 and 2 < y < 38 and z == pytest.approx(38.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("window", "largest"), [(5.0, "pliers"), (10.0, "cutter"), (20.0, "finger")]
)
def test_a_window_lets_in_what_passes_through_it(window: float, largest: str) -> None:
    found = measured(room(window))
    for name, diameter in TOOLS_MM.items():
        assert (found.reached[name] > 0) == (diameter <= TOOLS_MM[largest]), name
    shares = [found.reached[name] for name in sorted(TOOLS_MM, key=lambda n: -TOOLS_MM[n])]
    assert shares == sorted(shares)


def test_what_lies_on_the_bed_has_no_supports() -> None:
    found = measured(box((0, 0, 0), (20, 20, 3)))
    assert found.area_cm2 == 0.0 and found.worst is None
    assert all(share == 1.0 for share in found.reached.values())
    aloft = move(box((0, 0, 0), (20, 20, 3)), shift=(0, 0, 30))
    assert measured(aloft).area_cm2 == pytest.approx(4.0, rel=1e-6)
    powder = Rules(supports=False, powder=True)
    assert measure_access([(aloft.vertices, aloft.faces.astype(np.int32))], powder).worst is None
