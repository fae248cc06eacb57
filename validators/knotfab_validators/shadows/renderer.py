"""Draw silhouettes of a mesh, for each place of the light, on a flat receiver or a curved one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.view import ViewGeometry

__all__ = ["Renderer"]

FINER = 4  # pixels of the flat receiver to one of a curved one, each way


class Renderer(ABC):
    """One mesh, for as many views of it as wanted: a pixel is dark where the ray through its centre meets it.

    Args:
        vertices: (n, 3) mm, of the mesh.
    """

    def __init__(self, vertices: Array) -> None:
        self._vertices = np.asarray(vertices, dtype=np.float64)
        self._known: tuple[tuple[object, ...], Array, Array] | None = None

    @abstractmethod
    def _render_flat(self, geometry: ViewGeometry, behind: bool) -> Mask:
        """Render `render` on a flat receiver."""

    def render(self, geometry: ViewGeometry, *, behind: bool = False, finer: int = FINER) -> Mask:
        """Render the silhouette (height, width) on the pixels of `geometry`, in the mesh's coordinates.

        Matter on or behind the receiver plane is clipped away unless `behind`. Before a cylinder that is
        done for the flat receiver, on pixels so many times `finer`; each of the curved one's is dark where
        the ray to it is.
        """
        if geometry.cylinder is None:
            return self._render_flat(geometry, behind)
        at, normal = self._places(geometry)
        lit = ((geometry.light - at) * normal).sum(axis=1) > 0
        flat = geometry.flat
        pixels, w = flat.project(at)
        lit &= w > 0
        cast = flat.lift(self._vertices)
        # a part that reaches past the light throws a shadow without bounds
        if (cast[:, 2] > 0).all():
            cast = cast[:, :2] / cast[:, 2:]
            low, high = np.floor(cast.min(axis=0)) - 1, np.ceil(cast.max(axis=0)) + 1
            lit &= (pixels >= low).all(axis=1) & (pixels <= high).all(axis=1)
        shadow = np.zeros(len(at), dtype=bool)
        if lit.any():
            low, high = np.floor(pixels[lit].min(axis=0)), np.ceil(pixels[lit].max(axis=0))
            wide, tall = (finer * (high - low + 1)).astype(int)
            first = low - 0.5 + 0.5 / finer
            origin = flat.origin + first[0] * flat.du + first[1] * flat.dv
            du, dv = flat.du / finer, flat.dv / finer
            window = replace(flat, origin=origin, du=du, dv=dv, width=int(wide), height=int(tall))
            column, row = np.rint(finer * (pixels[lit] - first)).astype(np.int64).T
            mask = self._render_flat(window, behind)
            shadow[lit] = mask[np.clip(row, 0, tall - 1), np.clip(column, 0, wide - 1)]
        return shadow.reshape(geometry.height, geometry.width)

    def _places(self, geometry: ViewGeometry) -> tuple[Array, Array]:
        """Find the receiver's points under all pixels, and its normals; kept, for many lamps see the same."""
        wall = geometry.cylinder
        assert wall is not None
        lattice = (
            geometry.origin,
            geometry.du,
            geometry.dv,
            geometry.normal,
            wall.foot,
            wall.along,
        )
        key = (geometry.width, geometry.height, wall.radius, *(x.tobytes() for x in lattice))
        if self._known is None or self._known[0] != key:
            v, u = np.mgrid[: geometry.height, : geometry.width]
            pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
            self._known = key, *geometry.touching(pixels)
        return self._known[1:]
