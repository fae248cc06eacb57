"""The axes of a view that is turned by an azimuth and raised by an elevation: a view, or a region."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array

__all__ = ["view_axes"]


def view_axes(azimuth_deg: float, elevation_deg: float) -> Array:
    """Give (3, 3) rows right, up and towards the light, in the scene; x, y and z where both angles are 0."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    return np.array(
        [
            [np.cos(a), 0.0, -np.sin(a)],
            [-np.sin(a) * np.sin(e), np.cos(e), -np.cos(a) * np.sin(e)],
            [np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)],
        ]
    )
