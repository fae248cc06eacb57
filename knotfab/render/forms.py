"""The forms that a search is handed: those that draw its pictures, and those that move beside vertices."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Real
from knotfab.geometry.polylines import Polylines
from knotfab.render.frame import Frame
from knotfab_formats.search import Renderer

__all__ = ["COMPILED", "DrawnImage", "Forms"]


class DrawnImage(Protocol):
    """A view's picture that something else than the compiled loops draws; arrays in, arrays out."""

    def from_frame(self, frame: Frame) -> DrawnImage:
        """Return the same picture, seen from another frame."""

    def squared_error(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float, won: Any
    ) -> tuple[float, Array]:
        """Return the squared difference of tube and picture, and its gradient in the vertices (N, 3)."""

    def find_winners(self, points: Real, rings: Polylines, radius: float, reach_px: float) -> Any:
        """Find the capsule that colours each pixel, for `squared_error` of vertices that moved little."""

    def render(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float
    ) -> Real:
        """Render the image (H, W) of the tube about vertices (N, 3)."""


class Forms:
    """The forms of a search. These are the core's own: compiled loops draw, vertices move.

    `torch_forms.forms.TorchForms` has the others: devices, the paper's renderers, the network, a free pose.
    """

    device = "cpu"

    def draw(
        self, frame: Frame, target: NDArray[np.floating[Any]], renderer: Renderer
    ) -> DrawnImage | None:
        """Return the form that draws this picture; None: the compiled loops do."""
        if renderer != "ray":
            raise ValueError(f"the renderer {renderer} needs forms=TorchForms()")
        return None

    def search_network(self, state: Any, report: Any) -> None:
        """Search the weights of a network that moves the curves of a `SearchState`."""
        raise ValueError("a search of the network needs forms=TorchForms()")

    def free_pose(self, start: Any, given: bool, least_radius_mm: float) -> Any:
        """Return the pose of one view as an unknown, from `ViewNumbers`; a `given` tube radius is none."""
        raise ValueError("a free view needs forms=TorchForms()")


COMPILED = Forms()
