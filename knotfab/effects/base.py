"""An effect: a bound known beforehand, a threshold, and code that runs only above it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from knotfab.base.arrays import Array
from knotfab_formats.scene import (
    VERIFIED_PX,
    Material,
    Placing,
    Printer,
    ResolvedScene,
    ResolvedView,
    Room,
    Switch,
)

if TYPE_CHECKING:
    from knotfab.effects.shadows import Shadows

__all__ = ["VERIFIED_PX", "Decision", "Effect", "EffectContext", "World", "decide"]


@dataclass(frozen=True)
class World:
    """A scene's words on people, room and matter.

    `turns`: whether the piece can turn against its wall: not one that is mounted on it, as of an open mount
    one of several loose knots is (`loose_turns`).
    """

    placing: Placing = field(default_factory=Placing)
    room: Room = field(default_factory=Room)
    material: Material = field(default_factory=Material)
    printer: Printer = field(default_factory=Printer)
    turns: bool = True
    loose_turns: bool = True

    @staticmethod
    def of(scene: ResolvedScene) -> World:
        """Return the world of a scene, as long as its piece is taken to be one knot."""
        turns, loose = (not scene.hangs(knots) for knots in (1, 2))
        return World(scene.placing, scene.room, scene.material, scene.printer, turns, loose)

    def holding(self, knots: int) -> World:
        """Return the same world once it is known of how many knots its piece is."""
        return replace(self, turns=self.turns and self.loose_turns) if knots > 1 else self


@dataclass(frozen=True)
class EffectContext:
    """The views and curves from which an effect's magnitude is judged.

    `points` (N, 3), mm: vertices of the centre lines, or places that no strand will stand nearer to the light
    than. `tolerance_px`: tolerance of the accuracy setting. `moves` (N, 3): how far a mount lets the points
        sag, mm.
    `upwards` (3,): the printer's, once the piece lies on its bed.
    """

    views: tuple[ResolvedView, ...]
    points: Array
    radius: float  # the tube's, mm
    tolerance_px: float
    world: World = field(default_factory=World)
    moves: Array | None = None
    upwards: Array | None = None

    @cached_property
    def shadows(self) -> tuple[Shadows, ...]:
        """The shadows of the points, in each view."""
        from knotfab.effects.shadows import Shadows  # compiled: not for who only names effects

        return tuple(Shadows.of(view, self.points) for view in self.views)


@dataclass(frozen=True)
class Effect:
    """One effect of the world that a scene may or may not call for.

    `magnitude` bounds what it does, in `unit`, before anything is simulated; it is simulated above
    `tolerances` times the tolerance of the accuracy setting.
    """

    name: str
    unit: str
    magnitude: Callable[[EffectContext], float]
    tolerances: float
    reason: str  # the sentence that says why it is simulated

    def threshold(self, tolerance_px: float) -> float:
        """Return the magnitude above which the effect is simulated."""
        return self.tolerances * tolerance_px


@dataclass
class Decision:
    """The decision whether an effect is simulated, its reason, and its cost.

    `forced`: whether it is on by the scene's own word; None: by its magnitude.
    """

    effect: Effect
    magnitude: float
    threshold: float
    forced: Switch = None
    calls: int = 0
    seconds: float = 0.0
    where: list[str] = field(default_factory=list)  # the stages that called it

    @property
    def called_for(self) -> bool:
        """True if the magnitude exceeds the threshold."""
        return self.magnitude > self.threshold

    @property
    def simulated(self) -> bool:
        """True if its code runs."""
        return self.called_for if self.forced is None else self.forced

    @property
    def excess(self) -> float:
        """The strength of the effect in a design: it grows from 0 at the threshold to 1 far above it.

        1 - threshold / magnitude; of one that is forced on below its threshold 0: it is measured, and
        changes nothing.
        """
        if not self.simulated or not self.called_for:
            return 0.0
        return 1.0 - self.threshold / self.magnitude

    def count(self, stage: str, calls: int, seconds: float) -> None:
        """Enter so many calls of the effect's code in a stage, and the seconds that they took."""
        self.calls += calls
        self.seconds += seconds
        if calls and stage not in self.where:
            self.where.append(stage)

    @contextmanager
    def called(self, stage: str) -> Iterator[None]:
        """Count one call, and the time that it takes."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.count(stage, 1, time.perf_counter() - begun)

    def add(self, earlier: Decision) -> None:
        """Enter what an earlier search spent on it, before this one took over."""
        self.keep_largest(earlier)
        self.calls += earlier.calls
        self.seconds += earlier.seconds
        self.where = list(dict.fromkeys([*earlier.where, *self.where]))

    def keep_largest(self, fresh: Decision) -> None:
        """Judge it anew: the larger magnitude counts, for nothing that was simulated is taken back."""
        if fresh.magnitude > self.magnitude:
            self.magnitude, self.threshold = fresh.magnitude, fresh.threshold

    @property
    def warning(self) -> str | None:
        """A sentence where the scene's own word goes against the magnitude; None where it does not."""
        if self.forced is not False or not self.called_for:
            return None
        return (
            f"The effect {self.effect.name} is switched off, though its {self._words}: what is printed "
            "will show it, and nothing here says how much."
        )

    @property
    def _words(self) -> str:
        unit, side = self.effect.unit, "exceeds" if self.called_for else "stays below"
        return f"{self.magnitude:.3g} {unit} {side} {self.threshold:.3g} {unit}"

    @property
    def reason(self) -> str:
        """The reason why it is simulated or not, in a line."""
        if self.forced is not None:
            word = "on" if self.forced else "off"
            return f"{self.effect.name}: {word} by the scene's own word; {self._words}"
        why = self.effect.reason if self.simulated else self.effect.name
        return f"{why}: {self._words}"


def decide(effect: Effect, context: EffectContext, switches: Mapping[str, Switch]) -> Decision:
    """Tell whether an effect is simulated; `switches` are the scene's own words, by name."""
    threshold = effect.threshold(context.tolerance_px)
    return Decision(effect, effect.magnitude(context), threshold, switches.get(effect.name))
