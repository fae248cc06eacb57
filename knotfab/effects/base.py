"""Effects: a bound on the magnitude, a threshold, and code that runs only above it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from knotfab.base.arrays import Array
from knotfab.scene.camera import camera_of
from knotfab_formats.piece import Material, Printer
from knotfab_formats.scene import ResolvedScene, ResolvedView
from knotfab_formats.slicer_ini import stiffness_share
from knotfab_formats.views import Placing, Switch


@dataclass(frozen=True)
class World:
    """What a scene says of how exactly people place the piece, and of printer and material.

    `turns`: whether a piece of one knot can turn against its wall, as one mounted on it cannot;
    `loose_turns`: whether a piece of several knots can.
    """

    placing: Placing = field(default_factory=Placing)
    printer: Printer = field(default_factory=Printer)
    material: Material = field(default_factory=Material)
    turns: bool = True
    loose_turns: bool = True

    @staticmethod
    def from_scene(scene: ResolvedScene) -> World:
        """Return the world of a scene, taking its piece to be one knot."""
        found = scene.mount.turns
        turns, loose = (not scene.on_wall(n) if found is None else found for n in (1, 2))
        return World(scene.placing, scene.printer, scene.material, turns, loose)

    def holding(self, knots: int) -> World:
        """Return the world for a piece of this many knots."""
        return replace(self, turns=self.turns and self.loose_turns) if knots > 1 else self

    def leg_modulus_mpa(self, radius: float) -> float:
        """Return the modulus that a full leg of this radius would need to be as stiff as the printed one."""
        return self.material.young_modulus_mpa * stiffness_share(self.printer, radius)


@dataclass(frozen=True)
class EffectContext:
    """The views and curves from which an effect's magnitude is judged.

    `points` (N, 3), mm: vertices of the centre lines, or places at least as near to the light as any strand
    will be. `tolerance_px`: tolerance of the accuracy setting. `moves` (N, 3): how far a mount lets the
    points sag, mm. `upwards` (3,): the printer's, once the piece lies on its bed.
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

        return tuple(Shadows.from_points(view, self.points) for view in self.views)


@dataclass(frozen=True)
class Effect:
    """One physical effect that a scene may call for.

    `magnitude` bounds the effect, in `unit`, beforehand; it is simulated above
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

    `forced`: whether the scene switches it on or off; None if its magnitude decides.
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
        """True if the effect is simulated."""
        return self.called_for if self.forced is None else self.forced

    @property
    def excess(self) -> float:
        """The strength of the effect in a design: it grows from 0 at the threshold to 1 far above it.

        1 - threshold / magnitude. An effect that is forced on below its threshold has 0: it is measured, and
        changes nothing.
        """
        if not self.simulated or not self.called_for:
            return 0.0
        return 1.0 - self.threshold / self.magnitude

    def count(self, stage: str, calls: int, seconds: float) -> None:
        """Record calls of the effect's code in a stage, and their seconds."""
        self.calls += calls
        self.seconds += seconds
        if calls and stage not in self.where:
            self.where.append(stage)

    @contextmanager
    def called(self, stage: str) -> Iterator[None]:
        """Record one call and its duration."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.count(stage, 1, time.perf_counter() - begun)

    def add(self, earlier: Decision) -> None:
        """Add the calls and seconds of an earlier search."""
        self.keep_largest(earlier)
        self.calls += earlier.calls
        self.seconds += earlier.seconds
        self.where = list(dict.fromkeys([*earlier.where, *self.where]))

    def keep_largest(self, fresh: Decision) -> None:
        """Keep the larger magnitude of two decisions, so that nothing simulated is taken back."""
        if fresh.magnitude > self.magnitude:
            self.magnitude, self.threshold = fresh.magnitude, fresh.threshold

    @property
    def warning(self) -> str | None:
        """A warning where the scene's own setting contradicts the magnitude, else None."""
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
        """The reason for simulating it or not, in one line."""
        if self.forced is not None:
            word = "on" if self.forced else "off"
            return f"{self.effect.name}: {word} by the scene's own word; {self._words}"
        why = self.effect.reason if self.simulated else self.effect.name
        return f"{why}: {self._words}"


def decide(effect: Effect, context: EffectContext, switches: Mapping[str, Switch]) -> Decision:
    """Decide whether an effect is simulated; `switches` are the scene's own settings by name."""
    threshold = effect.threshold(context.tolerance_px)
    return Decision(effect, effect.magnitude(context), threshold, switches.get(effect.name))


# The shadows of strands, from which the magnitudes of all effects are computed.


@dataclass(frozen=True)
class OnWall:
    """A view in its wall's axes: rows right, up and normal (3, 3), with the lamp at `lamp`.

    `middle` (3,): the frame's, in these axes.
    """

    axes: Array
    foot: Array  # the origin of the wall's axes, in the scene
    lamp: Array
    middle: Array

    @staticmethod
    @lru_cache(maxsize=8)  # the same views are asked for many times
    def from_view(view: ResolvedView) -> OnWall:
        """Return a view's light and wall."""
        camera = camera_of(view, 1, 1)
        axes = np.stack([camera.du, -camera.dv, camera.receiver[:3]])
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        foot = -camera.receiver[3] * camera.receiver[:3]
        lamp, middle = axes @ (camera.eye - foot), axes @ (camera.corner - foot)
        return OnWall(axes, foot, lamp, middle)

    def place(self, points: Array) -> Array:
        """Return points (n, 3) of the scene in the wall's axes, (n, 3)."""
        return np.asarray((points - self.foot) @ self.axes.T)

    def cast(self, places: Array) -> Array:
        """Cast points (n, 3), in the wall's axes, onto the wall, (n, 2)."""
        share = self.lamp[2] / (self.lamp[2] - places[:, 2:])
        return np.asarray(self.lamp[:2] + share * (places[:, :2] - self.lamp[:2]))


@dataclass(frozen=True)
class Shadows:
    """Shadows of `places` (n, 3), which are in the axes of the wall."""

    view: ResolvedView
    wall: OnWall
    places: Array

    @staticmethod
    def from_points(view: ResolvedView, points: Array) -> Shadows:
        """Return the shadows of points (n, 3) of the scene."""
        wall = OnWall.from_view(view)
        return Shadows(view, wall, wall.place(points))

    def of_places(self, places: Array) -> Shadows:
        """Return the shadows of other places (n, 3) before the same wall."""
        return Shadows(self.view, self.wall, places)

    @cached_property
    def span(self) -> tuple[Array, float]:
        """The middle of the places' box (3,), and their largest distance from it, mm."""
        middle = 0.5 * (self.places.min(axis=0) + self.places.max(axis=0))
        return middle, float(np.sqrt(((self.places - middle) ** 2).sum(axis=1).max()))
