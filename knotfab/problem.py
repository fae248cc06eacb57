"""The question put to a search, and its start; and the bars of what prints without supports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from shapely import MultiPolygon

from knotfab.base.arrays import Array, Mask
from knotfab.effects.base import Decision, World
from knotfab.geometry.legs import MOST_BAR_MM, Bar, Leg, find_legs, hide_behind, plan_bars
from knotfab.knots import Knots
from knotfab.limits.terms import Limits
from knotfab.render.image import ViewImage, image_at
from knotfab.scene.camera import camera_of, view_axes, walls_of
from knotfab_formats.scene import ResolvedView, SettledRegion
from knotfab_formats.search import Precision, Renderer
from knotfab_formats.views import Switch

Report = Callable[[float, float | None], None]  # (fraction done, IoU)
# (the knots as they stand, made where they are looked at; whether certified steps led there)
Watch = Callable[[Callable[[], Knots], bool], None]


@dataclass(frozen=True)
class TargetView:
    """One view and its target silhouette."""

    view: ResolvedView
    mask: Mask  # (H, W)
    # the silhouette in the plane through the origin, along the view's axes, mm
    polygon: MultiPolygon
    # the part that the other views' pictures leave of it; None: all
    left: MultiPolygon | None = None
    lines: tuple[Array, ...] = ()  # centre lines in that plane, where strokes are drawn along them
    # whether the screen ends at the frame, so that shadows beside it do not count
    ends: bool = False

    def image_at(
        self,
        radius: float,
        pixels: int,
        precision: Precision = "single",
        renderer: Renderer = "ray",
    ) -> ViewImage:
        """Return the picture, `pixels` on its longer side, for a tube of `radius` mm."""
        given = (radius, pixels, precision, renderer)
        if renderer != "ray":
            return image_at(self.view, self.mask, *given, ends=self.ends)
        if given not in self._images:  # each phase of a search asks for the same
            self._images[given] = image_at(self.view, self.mask, *given, ends=self.ends)
        return self._images[given]

    @cached_property
    def _images(self) -> dict[tuple[object, ...], ViewImage]:
        return {}

    @cached_property
    def hides(self) -> Callable[[Array], bool]:
        """Whether the picture hides the shadows of all points (n, 3), which are in the view's axes."""
        projection = camera_of(self.view, *self.mask.shape[::-1]).projection
        turned = np.column_stack([projection[:, :3] @ self.axes.T, projection[:, 3]])
        return hide_behind(self.mask, turned)

    @cached_property
    def axes(self) -> Array:
        """The view's right, up and towards its light in the scene, as rows (3, 3)."""
        return view_axes(self.view)


@dataclass(frozen=True)
class Braced:
    """The legs of knots that print without supports, with the light's axis up, and the bars that brace them.

    All are in the view's `axes` (3, 3). `lacking` (k, 3): the places that lack a bar.
    """

    axes: Array
    legs: list[Leg]
    bars: list[Bar]
    lacking: Array


def brace(knots: Knots, target: TargetView, world: World) -> Braced:
    """Plan the bars of knots in the scene that a view's picture hides."""
    axes = target.axes
    legs = find_legs([knot.points @ axes.T for knot in knots.knots])
    how = world.leg_modulus_mpa(knots.radius_mm), target.hides
    longest = MOST_BAR_MM * world.material.shrinks_to  # as it is printed
    planned = plan_bars(legs, knots.radius_mm, *how, longest_mm=longest, thrifty=True)
    return Braced(axes, legs, *planned)


@dataclass(frozen=True)
class Problem:
    """The pictures of one view or several, and the limits of the knots that draw them. Lengths in mm.

    With `goals`, the IoU that each view should reach, a view that falls short of its goal counts for more.
    """

    views: tuple[TargetView, ...]
    clearance: float
    bend_radius: float | None  # None: the tube radius plus half the clearance
    length: float
    region: SettledRegion
    # the extent of the centre lines along one view's axis; None: flat
    depth_mm: float | None = None
    depth_open: bool = False  # whether less depth will do where the scene calls for that
    # for lamps before one screen: the depth of the pieces with which each draws its mask, while the others
    # throw these beside the screen; None: views share all pieces
    apart_mm: float | None = None
    # steepest that prints without supports; None: they cost nothing
    overhang_deg: float | None = None
    # strands stand in arches on a floor behind the piece, and print with the light's axis up without supports
    arched: bool = False
    knot: str = "unknot"  # tied into the longest curve
    goals: tuple[float, ...] | None = None
    switches: Mapping[str, Switch] = field(default_factory=dict)  # by the effect's name
    world: World = field(default_factory=World)

    def limits(self, radius: float) -> Limits:
        """Return the hard limits of a tube of this radius."""
        bend = max(self.bend_radius or 0.0, radius + 0.5 * self.clearance)
        # with one view the region ends before the wall
        walls = walls_of([v.view for v in self.views]) if len(self.views) > 1 else ()
        return Limits(radius, self.clearance, bend, self.length, self.region, walls)

    @property
    def polygons(self) -> list[MultiPolygon]:
        """The silhouette of each view, as polygons."""
        return [v.polygon for v in self.views]


@dataclass(frozen=True)
class DepthChoice:
    """The chosen depth of each template vertex, mm towards the light, and what its legibility costs.

    `extent_mm`: the best distance from the deepest vertex to the highest, without what lanes add; it may be
    less than that of `depths`. None: flat.
    """

    depths: tuple[Array, ...]
    legibility: float
    extent_mm: float | None


@dataclass(frozen=True, repr=False)
class Start:
    """Start curves [(n, 3) mm] of known knot type, and why it is known.

    `far`: they are nowhere near the pictures yet. `facing`: the view in which they are simple; None: a
    direction between two views. `ious`: the IoU with each of several pictures, on a coarse image.
    """

    curves: tuple[Array, ...]
    why: str
    types: tuple[str, ...] = ()
    depth: DepthChoice | None = None
    far: bool = False
    facing: int | None = 0
    ious: tuple[float, ...] = ()
    # effects called for so far
    effects: Mapping[str, Decision] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.types:
            object.__setattr__(self, "types", ("unknot",) * len(self.curves))


@dataclass(frozen=True)
class ViewNumbers:
    """A view's pose and distances, and the tube's radius."""

    light_distance_mm: float
    wall_distance_mm: float
    radius_mm: float
    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0  # the light's, above the horizon
    roll_deg: float = 0.0  # the picture's, counter-clockwise seen from the light


@dataclass
class CertificateLog:
    """The record of a search's certificates, for its report."""

    template: str = ""
    types: tuple[str, ...] = ()  # the knots' types
    accepted: int = 0
    shortened: int = 0
    refused: int = 0
    resamplings: int = 0
    resamplings_refused: int = 0
    least_margin_mm: float = float("inf")
    repairs: int = 0

    @property
    def certified(self) -> bool:
        """True if every step from the template to the end is a proved isotopy."""
        return bool(self.template) and self.least_margin_mm > 0

    def add_margin(self, margin_mm: float) -> None:
        """Record the margin of a granted certificate."""
        self.least_margin_mm = min(self.least_margin_mm, margin_mm)
