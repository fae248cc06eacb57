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
from knotfab_validators.shadows.winding import Linework, wound_mask

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
        # the next picture asks for nearly the faces of the last
        self._seen = np.ones(len(self._faces), dtype=bool), self._table

    def lines(self, geometry: ViewGeometry) -> Linework:
        """Return `shadow_lines` of the mesh.

        Raises:
            ShadowError: the part reaches the light or lies behind it.
        """
        return shadow_lines(self._vertices, self._faces, geometry, self._table)

    def _render_flat(self, geometry: ViewGeometry, behind: bool) -> Mask:
        h, faces = geometry.lift(self._vertices), self._faces
        limit = np.inf if behind else geometry.w_of_receiver
        seen = (h[:, 2] > NEAREST) & (h[:, 2] < limit)
        every = bool(seen.all())
        whole = np.ones(len(faces), dtype=bool) if every else np.asarray(seen[faces].all(axis=1))
        table = self._table if every else self._find_table(whole)
        lines = table.find_silhouette(on_page(h))
        if not whole.all():  # winding numbers add up, and the edges between the two cancel
            pieces = faces[~whole]
            # a part nearer to the light is clipped away, as by a camera
            for sign, bound in ((-1.0, -NEAREST), (1.0, limit)):
                turned = h * [1.0, 1.0, sign]
                turned, pieces = cut_before(turned, pieces, bound) or (turned, pieces)
                h = turned * [1.0, 1.0, sign]
            cut = EdgeTable(pieces, len(h)).find_silhouette(on_page(h))
            lines = Linework(
                np.concatenate([lines.start, cut.start]),
                np.concatenate([lines.end, cut.end]),
                np.concatenate([lines.weight, cut.weight]),
            )
        return wound_mask([lines], geometry.width, geometry.height)

    def _find_table(self, whole: Mask) -> EdgeTable:
        """Make the table of faces that are seen whole: one for all places of the light before a receiver."""
        known, table = self._seen
        if not np.array_equal(known, whole):
            table = EdgeTable(self._faces[whole], len(self._vertices))
            self._seen = whole, table
        return table
