"""The points that a trade-off measures: the presets, and one knob at a time around the standard one."""

from __future__ import annotations

from dataclasses import dataclass

from knotfab.scene.settings import PRESETS, SearchSettings

__all__ = ["Point", "points"]


@dataclass(frozen=True)
class Point:
    """Settings to be measured; `knob` names what is turned, "preset" for the presets themselves."""

    knob: str
    label: str
    settings: SearchSettings


_KNOBS: dict[str, tuple[str, tuple[float, ...]]] = {
    "picture size": ("fine_px", (192, 256, 512)),
    "vertex spacing": ("edge_radii", (0.3, 0.45, 0.75)),
    "grace": ("grace", (0.0, 0.05)),
    "winner search": ("winners_every", (1, 8)),
    "effect tolerance": ("tolerance_px", (0.05, 2.0)),
    "mesh facets": ("mesh_sides", (12, 48, 96)),
}
_UNITS = {
    "fine_px": "{:g} px",
    "edge_radii": "{:g} r",
    "grace": "weight {:g}",
    "winners_every": "every {:g} iterations",
    "tolerance_px": "{:g} px",
    "mesh_sides": "{:g} sides",
}
_ITERATIONS = (0.25, 0.5, 0.75, 1.5)


def points(own: SearchSettings | None = None) -> list[Point]:
    """The presets, one knob at a time turned around `own` (`standard` by default)."""
    middle = own or PRESETS["standard"]
    found = [Point("preset", name, settings) for name, settings in PRESETS.items()]
    if own is not None and own not in PRESETS.values():
        found.append(Point("preset", "the scene's", own))
    found += [Point("iterations", f"{f:g} times", middle.scaled(f)) for f in _ITERATIONS]
    for knob, (key, values) in _KNOBS.items():
        for value in values:
            given = round(value) if isinstance(getattr(middle, key), int) else value
            changed = middle.model_copy(update={key: given})
            found.append(Point(knob, _UNITS[key].format(value), changed))
    return found
