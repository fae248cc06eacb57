"""Keep a time budget: refuse one that is too short, compute what is left, and cut the settings to fit."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS, SearchSettings

# shortest budgets, s: a part of one view, of several or a free view, and each frame of a sequence
_LEAST_S, _LEAST_SEVERAL_S, _LEAST_FRAME_S = 5.0, 12.0, 4.0
# below these seconds per view: the draft's settings, the sketch's settings
_SHORT_S, _SHORTEST_S = 6.0, 3.0
_SEARCH_VERTEX_S = 0.12e-3  # shortest useful search, s per vertex
_MOST = 4.0  # largest slowdown by other programs that is believed
_LESS = ("coarse_px", "fine_px", "depth_candidates", "radius_candidates", "mesh_sides")
_MORE = ("settle_edge_radii", "radius_give", "radius_from", "outline_px")


def require_budget(seconds: float, views: int, free: bool, frames: int = 0) -> None:
    """Require enough time to make and verify a part.

    Args:
        free: whether the view is searched for as well. frames: length of a sequence, 0 for a part.

    Raises:
        InputError: the budget is too short.
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
    """The time at which a build must be done, and the time that its steps after the search take.

    `ends` and `began`, the process's start, are readings of `time.perf_counter()`; without `began` the
    machine is taken to be idle. On an idle machine part, verification and report take `after_s` plus
    `after_vertex_s` for each vertex of the knots.
    """

    ends: float
    after_s: float = 0.0
    after_vertex_s: float = 0.0
    began: float | None = None

    def search_s(self, vertices: int) -> float:
        """Return the seconds left for a search whose knots end with this many vertices."""
        after = self.after_s + self.after_vertex_s * vertices
        return self.ends - time.perf_counter() - self._slower() * after

    def view_s(self, views: int) -> float:
        """Return the seconds left for the design of each view."""
        return self.search_s(2500 * views) / views  # a view has some 2500 vertices

    def thicker(self, give: float, vertices: Callable[[float], int]) -> float:
        """Return the IoU to give up for a thicker tube: `give`, or more if the build would end too late.

        Args:
            vertices: the number of vertices that giving up this much IoU leads to.
        """
        for more in (0.012, 0.03):
            count = vertices(give)
            if self.search_s(count) >= _SEARCH_VERTEX_S * count:
                break
            give = max(give, more)
        return give

    def _slower(self) -> float:
        """Return the slowdown by other programs so far: wall-clock time over CPU time, from 1 to `_MOST`."""
        if self.began is None:
            return 1.0
        return float(np.clip((time.perf_counter() - self.began) / time.process_time(), 1.0, _MOST))


def cut_settings(
    settings: SearchSettings, seconds: float, given: Collection[str] = ()
) -> SearchSettings:
    """Lower the settings to the draft's or the sketch's if there is little time for each view.

    Args:
        seconds: time for each view. given: keys that the scene sets, which stay.
    """
    if seconds >= _SHORT_S:
        return settings
    fewer = PRESETS["draft" if seconds >= _SHORTEST_S else "sketch"]
    spared = {key: min(getattr(settings, key), getattr(fewer, key)) for key in _LESS}
    spared |= {key: max(getattr(settings, key), getattr(fewer, key)) for key in _MORE}
    return settings.but(**{k: v for k, v in spared.items() if k not in given})


def resolve_iterations(settings: SearchSettings, iterations: Mapping[int, int]) -> SearchSettings:
    """Enter in the settings the iterations that a search by the clock ran, by phase (0 to 2)."""
    names = ("coarse_iterations", "fine_iterations", "settle_iterations")
    return settings.but(**{names[k]: n for k, n in iterations.items()})


def few_iterations(settings: SearchSettings) -> SearchSettings:
    """Return the settings with so few iterations that a search serves only to be timed."""
    return settings.but(
        coarse_iterations=6, fine_iterations=6, settle_iterations=3, network_iterations=6
    )


def scale_to_budget(seconds: float, settings: SearchSettings, few_s: float) -> SearchSettings:
    """Scale the iterations of a network search to the time available.

    Args:
        few_s: how long a search with `few_iterations` took.
    """
    each = few_s / few_iterations(settings).iterations
    factor = (seconds - 16 * each) / (each * settings.iterations)
    return settings.scaled(float(np.clip(factor, 0.2, 5.0)))
