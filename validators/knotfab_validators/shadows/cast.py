"""The silhouettes of a mesh for many lights, by a compiled scan of its silhouette edges."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.shadows.exact_shadow import (
    NEAREST,
    EdgeTable,
    cut_before,
    on_page,
    shadow_lines,
)
from knotfab_validators.shadows.renderer import Renderer
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.shadows.winding import Linework, winding_raster

__all__ = ["ShadowCaster"]


class ShadowCaster(Renderer):
    """A mesh whose edges are sorted once: `shadow_lines` and `shadow_mask` for light after light.

    It draws what the renderer draws (`SilhouetteRenderer` is another way to the same), so that a shadow which
    is verified by both need not be drawn by both for each place of a lamp.

    Args:
        vertices: (n, 3) mm. faces: (m, 3).
    """

    def __init__(self, vertices: Array, faces: Ints) -> None:
        super().__init__(vertices)
        self._faces = np.asarray(faces, dtype=np.int64)
        self._table = EdgeTable(self._faces, len(vertices))

    def lines(self, geometry: ViewGeometry) -> Linework:
        """`shadow_lines` of the mesh.

        Raises:
            ShadowError: the part reaches the light or lies behind it.
        """
        return shadow_lines(self._vertices, self._faces, geometry, self._table)

    def _render_flat(self, geometry: ViewGeometry, behind: bool) -> Mask:
        h, faces, table = geometry.lift(self._vertices), self._faces, self._table
        limit = np.inf if behind else geometry.w_of_receiver
        far = h[:, 2] >= NEAREST  # what is nearer to the light is clipped away, as by a camera
        if not far.all():
            faces = faces[far[faces].all(axis=1)]
        cut = cut_before(h, faces, limit)
        if cut is not None:
            h, faces = cut
        if faces is not self._faces:
            table = EdgeTable(faces, len(h))
        lines = table.find_silhouette(on_page(h))
        return np.asarray(winding_raster(lines, geometry.width, geometry.height) != 0)
