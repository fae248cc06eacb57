"""A time budget: the least there may be, what of it is left for the search, and what is spared for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS, SearchSettings

_LEAST_S, _LEAST_SEVERAL_S, _LEAST_FRAME_S = 5.0, 12.0, 4.0
# seconds for a view's design, below which it takes the draft's trials, pictures, spacing, or the sketch's
_SHORT_S, _SHORTEST_S = 6.0, 3.0
_SEARCH_VERTEX_S = 0.12e-3  # seconds of the least search, for each vertex
_MOST = 4.0  # a larger factor of slowness is no measure of anything
_LESS = ("coarse_px", "fine_px", "depth_candidates", "radius_candidates", "mesh_sides")
_MORE = ("settle_edge_radii", "radius_give", "radius_from", "outline_px")


def require_budget(seconds: float, views: int, free: bool, frames: int = 0) -> None:
    """Refuse a budget in which no part can be made and verified.

    Args:
        free: whether the view is looked for as well. frames: frames of a sequence.

    Raises:
        InputError: it is below the least.
    """
    least, why = _LEAST_S, "a part of one view"
    if frames:
        least, why = _LEAST_FRAME_S * frames, f"a sequence of {frames} frames"
    elif views > 1 or free:
        least = _LEAST_SEVERAL_S
        why = f"a part of {views} views" if views > 1 else "a part whose view is free"
    if seconds < least:
        raise InputError(
            f"--time-budget {seconds:g}",
            f"{why} takes at least {least:g} s, its verification among them",
            f"Give {least:g} or more, or leave it out.",
        )


@dataclass(frozen=True)
class Budget:
    """Until when a build is to be done, and what follows its search.

    `ends`: by `time.perf_counter()`. What follows takes `after_s`, and `after_vertex_s` for each vertex of
    the knots, on a machine that has nothing else to do: the part, its verification, which is most of it, and
    the report. `began`: the process's start, by the same clock; None: it does not matter.
    """

    ends: float
    after_s: float = 0.0
    after_vertex_s: float = 0.0
    began: float | None = None

    def search_s(self, vertices: int) -> float:
        """Return seconds that are left for a search that ends with so many vertices."""
        after = self.after_s + self.after_vertex_s * vertices
        return self.ends - time.perf_counter() - self._slower() * after

    def view_s(self, views: int) -> float:
        """Return seconds for the design of each view."""
        return self.search_s(2500 * views) / views  # a view has some 2500 vertices

    def thicker(self, give: float, vertices: Callable[[float], int]) -> float:
        """Return the IoU to give so that what follows fits: at least `give`, and more as long as it does not.

        Args:
            vertices: vertices of the knots that some IoU given leads to.
        """
        for more in (0.012, 0.03):  # IoU given where what follows would not fit otherwise
            count = vertices(give)
            if self.search_s(count) >= _SEARCH_VERTEX_S * count:
                break
            give = max(give, more)
        return give

    def _slower(self) -> float:
        """Return how many times longer work for one core has taken so far, beside other programs."""
        if self.began is None:
            return 1.0
        return float(np.clip((time.perf_counter() - self.began) / time.process_time(), 1.0, _MOST))


def spare(settings: SearchSettings, seconds: float, given: Collection[str] = ()) -> SearchSettings:
    """Make pictures smaller, trials fewer and the tube thicker if the seconds for a view are few.

    Args:
        given: keys that the scene gives, which stay.
    """
    if seconds >= _SHORT_S:
        return settings
    fewer = PRESETS["draft" if seconds >= _SHORTEST_S else "sketch"]
    spared = {key: min(getattr(settings, key), getattr(fewer, key)) for key in _LESS}
    spared |= {key: max(getattr(settings, key), getattr(fewer, key)) for key in _MORE}
    return settings.but(**{k: v for k, v in spared.items() if k not in given})


def resolve_iterations(settings: SearchSettings, iterations: Mapping[int, int]) -> SearchSettings:
    """Return the settings with the iterations that the phases of a search by the clock came to."""
    names = ("coarse_iterations", "fine_iterations", "settle_iterations")
    return settings.but(**{names[k]: n for k, n in iterations.items()})


def scale_to_budget(
    seconds: float, settings: SearchSettings, trial: Callable[[SearchSettings], object]
) -> SearchSettings:
    """Scale the iterations of a search by the network to the seconds, by one short run.

    Args:
        trial: searches by the few iterations that it is given.
    """
    few = settings.but(
        coarse_iterations=6, fine_iterations=6, settle_iterations=3, network_iterations=6
    )
    begun = time.perf_counter()
    trial(few)
    each = (time.perf_counter() - begun) / few.iterations
    factor = (seconds - 16 * each) / (each * settings.iterations)
    return settings.scaled(float(np.clip(factor, 0.2, 5.0)))
