"""The points that a trade-off measures: presets, one knob at a time around the middle, combinations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from knotfab_formats.search import PRESETS, SearchSettings

__all__ = ["KNOBS", "PRESET", "Effect", "Knob", "Point", "combine", "list_changes", "points"]

PRESET = "preset"
COMBINED = "combined"
_TRIED = 4000  # combinations whose cost and error are foretold
_LEFT = 0.5  # share of the knobs that a combination leaves as they are

Effect = tuple[float, float]  # logarithms of seconds and of the error, over those of the middle


@dataclass(frozen=True)
class Point:
    """Settings to be measured; `knob` names what is turned, "preset" for the presets themselves."""

    knob: str
    label: str
    settings: SearchSettings


@dataclass(frozen=True)
class Knob:
    """A setting, or several that go together, and the values tried, cheapest first.

    Without `keys` it is the number of iterations of all phases, times a value. `alike`: values that
    stand beside each other, so that each is a step from the middle's own.
    """

    name: str
    unit: str
    keys: tuple[str, ...]
    values: tuple[Any, ...]
    alike: bool = False

    def own(self, settings: SearchSettings) -> Any:
        """Return the value that settings have."""
        if not self.keys:
            return 1.0
        found = tuple(getattr(settings, key) for key in self.keys)
        return found if len(found) > 1 else found[0]

    def turn(self, settings: SearchSettings, value: Any) -> SearchSettings:
        """Return the settings with this value."""
        if not self.keys:
            return settings if value == 1.0 else settings.scaled(value)
        given = value if len(self.keys) > 1 else (value,)
        return settings.but(**dict(zip(self.keys, given, strict=True)))

    def label(self, value: Any) -> str:
        """Return the value in words."""
        parts = value if isinstance(value, tuple) else (value,)
        return "flow" if parts[0] == "flow" else self.unit.format(*parts)

    def ordered(self, settings: SearchSettings) -> list[Any]:
        """Sort all values, the settings' own among them, cheapest first; `alike` ones in that order."""
        own = self.own(settings)
        others = [v for v in self.values if v != own]
        if self.alike:
            return [own, *others]
        return sorted([own, *others], reverse=self.values[0] > self.values[-1])


KNOBS = (
    Knob("iterations", "× {:g}", (), (0.125, 0.25, 0.5, 0.75, 1.5)),
    Knob("picture size", "{:g} px", ("fine_px",), (256, 384, 512, 1024)),
    Knob("coarse picture", "{:g} px coarse", ("coarse_px",), (128, 256)),
    Knob("vertex spacing", "{:g} r", ("edge_radii",), (0.6, 0.45)),
    Knob("last spacing", "{:g} r last", ("settle_edge_radii",), (0.6, 0.3)),
    Knob("winner search", "winners every {:g}", ("winners_every",), (8, 1)),
    Knob("sharpness", "τ {:g}", ("tau",), (6.0, 12.0, 36.0)),
    Knob("precision", "{} precision", ("precision",), ("double",), alike=True),
    Knob("renderer", "{} distance", ("renderer",), ("capsule", "ellipse"), alike=True),
    Knob("depth candidates", "{:g} depths", ("depth_candidates",), (100, 600)),
    Knob("radius candidates", "{:g} radii", ("radius_candidates",), (4, 16)),
    Knob("thicker tube", "{:g} given", ("radius_give",), (0.02, 0.008, 0.0)),
    Knob("thinner tube", "from {:g} of the usual radius", ("radius_from",), (0.75, 0.6)),
    Knob("effect tolerance", "effects {:g} px", ("tolerance_px",), (1.0, 0.1)),
    Knob(
        "mesh",
        "outline within {:g} px, {:g} sides",
        ("outline_px", "mesh_sides"),
        ((1.0, 18), (0.25, 48)),
    ),
    Knob("grace", "grace {:g}", ("grace",), (0.05, 0.0), alike=True),
    Knob(
        "search",
        "{} {:g} × {:g}",
        ("method", "network_depth", "network_width"),
        (("inn", 4, 32), ("inn", 8, 128), ("inn+flow", 4, 32), ("inn+flow", 8, 128)),
        alike=True,
    ),
)


def points(own: SearchSettings | None = None) -> list[Point]:
    """Return the presets, and one knob at a time turned around `own` (`standard` by default)."""
    middle = own or PRESETS["standard"]
    found = [Point(PRESET, name, settings) for name, settings in PRESETS.items()]
    if middle not in PRESETS.values():
        found.append(Point(PRESET, "the scene's", middle))
    for knob in KNOBS:
        for value in knob.values:
            if value != knob.own(middle):
                found.append(Point(knob.name, knob.label(value), knob.turn(middle, value)))
    return found


def combine(
    middle: SearchSettings,
    effects: Mapping[str, Mapping[Any, Effect]],
    known: Sequence[Point],
    count: int,
    seed: int = 0,
) -> list[Point]:
    """Return combinations of values worth trying, spread over what they are expected to take.

    Of many random ones, deterministic by the seed, the most promising for their cost: what single knobs did
    to seconds and error is taken to multiply. That is a guess, which measuring then corrects.

    Args:
        effects: by knob, of the values that were on or near the front.
        known: that are measured already.
        count: at most so many.
    """
    turned = [knob for knob in KNOBS if effects.get(knob.name)]
    if not (turned and count):
        return []
    random = np.random.default_rng(seed)
    # 0: the knob stays as it is
    sizes = [len(effects[knob.name]) for knob in turned]
    chosen = random.integers(1, 1 + np.array(sizes), (_TRIED, len(turned)))
    chosen = np.unique(chosen * (random.random(chosen.shape) >= _LEFT), axis=0)
    logs = [np.array([(0.0, 0.0), *effects[knob.name].values()]) for knob in turned]
    foretold = sum(log[choice] for log, choice in zip(logs, chosen.T, strict=True))
    costs, errors = np.asarray(foretold).T
    bins = np.linspace(costs.min(), costs.max(), count + 1)[1:-1]
    number = np.searchsorted(bins, costs)
    seen, found = {point.settings for point in known} | {middle}, []
    for one in range(count):
        members = np.flatnonzero(number == one)
        for row in members[np.argsort(errors[members], kind="stable")]:
            point = _combined(middle, turned, effects, chosen[row].tolist())
            if point.settings not in seen:
                seen.add(point.settings)
                found.append(point)
                break
    return found


def _combined(
    middle: SearchSettings,
    turned: Sequence[Knob],
    effects: Mapping[str, Mapping[Any, Effect]],
    chosen: Sequence[int],
) -> Point:
    """Return the middle with the values of these numbers, from 1; 0 leaves a knob as it is."""
    settings, labels = middle, []
    for knob, choice in zip(turned, chosen, strict=True):
        if choice:
            value = list(effects[knob.name])[choice - 1]
            settings = knob.turn(settings, value)
            labels.append(knob.label(value))
    return Point(COMBINED, ", ".join(labels), settings)


def list_changes(settings: SearchSettings, other: SearchSettings) -> dict[str, tuple[Any, Any]]:
    """List differences from other settings: (theirs, these), by key."""
    theirs, these = other.model_dump(), settings.model_dump()
    return {key: (theirs[key], these[key]) for key in these if these[key] != theirs[key]}
