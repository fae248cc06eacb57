"""Fixtures where they belong: what mounts are united from, and what STEP holds as true solids."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.meshes import Mesh, as_manifold
from knotfab.mount.modeller import model
from knotfab_fixtures.peg import peg

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["Fixture", "along", "place_along", "strut"]


@dataclass(frozen=True)
class Fixture:
    """One solid of a mount: a function of `knotfab_fixtures` with its arguments, and where it belongs.

    `motion` (3, 4) takes it there. Of `above`, a plane's normal (3,) and offset, only what is beyond stays.
    """

    kind: str
    of: Callable[..., Mesh]
    sizes: tuple[float, ...]
    motion: Array
    named: Mapping[str, float] = field(default_factory=dict)
    above: tuple[Array, float] | None = None

    def solid(self) -> Manifold:
        """Return the solid as facets, ready to be united."""
        solid = as_manifold(model(self.of, *self.sizes, **self.named)).transform(self.motion)
        return solid if self.above is None else solid.trim_by_plane(*self.above)

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as `knotfab_fixtures.step.write_solids` takes it."""
        return {
            "module": self.of.__module__,
            "fixture": self.of.__name__,
            "sizes": [float(size) for size in self.sizes],
            "named": {name: float(size) for name, size in self.named.items()},
            "motion": self.motion.tolist(),
            "above": self.above and (self.above[0].tolist(), float(self.above[1])),
        }


def along(axis: Array, point: Array, helper: Array | None = None) -> Array:
    """Return (3, 4) the motion that takes the origin to a point (3,), and z to the unit vector `axis`.

    Args:
        helper: (3,) not along the axis; x comes to lie square to both.
    """
    beside = np.eye(3)[np.abs(axis).argmin()] if helper is None else helper
    across = np.cross(beside, axis)
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis, point])


def place_along(solid: Manifold, axis: Array, point: Array) -> Manifold:
    """Return a solid moved `along` an axis to a point."""
    return solid.transform(along(axis, point))


def strut(start: Array, end: Array, radius_mm: float) -> Fixture:
    """Return a round bar between two points (3,) mm."""
    length = float(np.linalg.norm(start - end))
    return Fixture("strut", peg, (length, radius_mm, radius_mm), along((start - end) / length, end))
