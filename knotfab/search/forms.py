"""The forms in torch, as a search takes them: each loads torch when it is first used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab.base.errors import needs_extra
from knotfab.problem import Report, ViewNumbers
from knotfab.render.image import DrawnImage, Forms
from knotfab.render.silhouette import Frame
from knotfab.search.state import SearchState
from knotfab_formats.search import Renderer

if TYPE_CHECKING:
    from knotfab.search.free_pose import FreePose


@dataclass(frozen=True)
class TorchForms(Forms):
    """Pictures on a device or by the paper's renderers, the network, a free pose."""

    device: str = "cpu"

    def draw(
        self, frame: Frame, target: NDArray[np.floating[Any]], renderer: Renderer
    ) -> DrawnImage | None:
        if renderer == "ray" and self.device == "cpu":
            return None
        with needs_extra(f"the renderer {renderer} on {self.device}", "torch"):
            from knotfab.render.device import DeviceImage

        if renderer != "ray":
            from knotfab.apps.paper.outlines import OutlineImage

            there = DeviceImage.of(frame, target.astype(np.float64), self.device)
            return OutlineImage(there.frame, there.target, renderer)
        return DeviceImage.of(frame, target, self.device)

    def search_network(self, state: SearchState, report: Report | None) -> None:
        with needs_extra("the network (--search inn)", "torch"):
            from knotfab.apps.paper.network_search import search_network

        search_network(state, report)

    def free_pose(self, start: ViewNumbers, given: bool, least_radius_mm: float) -> FreePose:
        with needs_extra("a free view (--free view)", "torch"):
            from knotfab.search.free_pose import ALL, Bounds, FreePose

        free = tuple(name for name in ALL if name != "radius" or not given)
        return FreePose(start, Bounds(free, least_radius_mm=least_radius_mm), device=self.device)
