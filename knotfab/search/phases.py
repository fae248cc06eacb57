"""The plan of a search: the phases that it goes through, and the repairs while a limit is violated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from knotfab.search.flow import FlowSettings
from knotfab.search.objective import Weights
from knotfab_formats.search import SearchSettings

__all__ = ["SETTLE", "Phase", "Plan", "plan_of", "repair_phase", "three_phases"]

SETTLE = Weights(clearance=20.0, bend=5.0, region=50.0)  # weights of the phase that ends feasible


@dataclass(frozen=True)
class Phase:
    """One walk of the flow: the picture's longer side, the steps, the weights, and tau from start to end.

    tau is in units of one over the projected tube radius. `spill`: strands that stand outside a silhouette
    are drawn to it; `balanced`: views that fall short of their goals count for more.
    """

    pixels: int
    walk: FlowSettings
    weights: Weights
    tau: tuple[float, float]
    spill: bool = False
    balanced: bool = True

    @property
    def iterations(self) -> int:
        return self.walk.iterations


@dataclass(frozen=True)
class Plan:
    """The phases of a search; `repair` gives the repair of a number, from 0.

    `network`: the paper's network moves the curves first.
    """

    phases: tuple[Phase, ...]
    repair: Callable[[int], Phase]
    repairs: int = 8  # repairs of the whole curve; each round gives the picture less weight
    mendings: int = 4  # repairs of single stretches, before those
    keep_vertices: bool = False  # their number and order stay: no resampling
    network: bool = False


def plan_of(settings: SearchSettings, views: int = 1) -> Plan:
    """Return the plan of a search from a template for so many views; without phases for the network alone."""
    phases: tuple[Phase, ...] = ()
    if settings.method != "inn":
        phases = three_phases(settings, views)
    network = settings.method != "flow"
    return Plan(phases, lambda number: repair_phase(settings, number), network=network)


def three_phases(
    settings: SearchSettings, views: int = 1, rates: tuple[float, float, float] | None = None
) -> tuple[Phase, Phase, Phase]:
    """Return a coarse picture, a fine one, and one that weighs the limits most.

    Args:
        views: several begin softer and with longer steps, for there is further to go, and first pull in what
            stands outside a silhouette (later a spill may stay that draws as much elsewhere).
        rates: rates of the steps, in tube radii, at the start of the coarse phase, between the two, and at
            the end of the fine one; None: by the number of views.
    """
    several = views > 1
    # smooth first, what the picture asks for comes in later; several ask for more than that leaves them
    smooth = (1.0, 1.0) if several else (4.0, 2.0)
    start, middle, end = rates or ((0.2, 0.08, 0.03) if several else (0.15, 0.06, 0.02))
    return (
        Phase(
            settings.coarse_px,
            FlowSettings(iterations=settings.coarse_iterations, rate=start, rate_end=middle),
            Weights(grace=smooth[0]),
            (1.0 if several else 1.5, 3.0),
            spill=several,
            balanced=False,  # the coarse picture is too soft to say what a view falls short of
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.fine_iterations, rate=middle, rate_end=end),
            Weights(clearance=3.0, bend=0.5, grace=smooth[1]),
            (3.0, settings.tau),
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.settle_iterations, rate=0.03, rate_end=0.01),
            SETTLE,
            (settings.tau, settings.tau),
        ),
    )


def repair_phase(settings: SearchSettings, number: int) -> Phase:
    """Return the repair of this number, from 0; every second one gives the picture less weight."""
    weights = Weights(
        image=0.3 ** (number // 2),
        clearance=40.0,
        bend=40.0,
        region=100.0,
        length=20.0,
        hold=160.0,
    )
    walk = FlowSettings(iterations=60, rate=0.02 if number < 2 else 0.04, rate_end=0.005)
    return Phase(settings.fine_px, walk, weights, (settings.tau, settings.tau))
