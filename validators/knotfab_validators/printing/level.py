"""Check that a part that hangs by its eyelet on a thread hangs level."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.check import Check, at_most
from knotfab_validators.geometry.inside import winding_numbers
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.standing import bodies

__all__ = ["check_level"]

MOST_TILT_DEG = 1.0
PROBE_MM = 0.4  # above and below the thread's place: matter there, and a hole here


def check_level(mesh: Mesh, thread: Array, up: Array) -> Check:
    """Check `level`: how far askew the part hangs, of one material throughout, by its centre of mass.

    Args:
        thread: (3,) where the thread carries the part; up: the unit vector (3,) that is to be upright,
            both in the part's coordinates.
    """
    parts = bodies(mesh)
    if len(parts) != 1:
        why = f"{len(parts)} bodies do not hang on one thread"
        return Check("level", "fail", True, float("nan"), MOST_TILT_DEG, "deg", why)
    above, below = winding_numbers(thread + PROBE_MM * np.outer([1.0, -1.0], up), mesh)
    if above < 0.5 or below > 0.5:
        missing = "no matter above" if above < 0.5 else "no hole below"
        why = f"there is {missing} the place of the thread: no eyelet carries the part"
        return Check("level", "fail", True, float("nan"), MOST_TILT_DEG, "deg", why)
    off = thread - parts[0].center
    high = float(off @ up)
    aside = float(np.linalg.norm(off - high * up))
    tilt = float(np.degrees(np.arctan2(aside, high)))
    detail = (
        f"the centre of mass hangs {high:.1f} mm below the thread, {aside:.2f} mm beside its line"
    )
    return at_most("level", tilt, MOST_TILT_DEG, "deg", detail)
