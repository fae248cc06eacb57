"""What searches are asked in tests: a heart, silhouettes from several sides, quick scenes, lit designs."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.design.question import ask
from knotfab.effects.base import EffectContext, World
from knotfab.effects.survey import survey
from knotfab.knots import Knot, Knots
from knotfab.picture.read import read_target
from knotfab.problem import Problem, Start, TargetView
from knotfab.scene.catalogue import resolve
from knotfab.search.flow import plan_of
from knotfab.search.search import search
from knotfab.search.state import SearchResult
from knotfab.start.start import make_start
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView, Scene, SettledRegion
from knotfab_formats.search import SearchSettings


def ask_heart(scene: Scene | None = None) -> Problem:
    """The problem of a heart in a scene's one view."""
    return ask(resolve(scene or Scene()), [read_target("text:♥")]).problem


def draw_mask(polygon: MultiPolygon, side_mm: float, pixels: int = 200) -> NDArray[np.bool_]:
    """What of a square in the middle of the piece the polygon covers."""
    at = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side_mm
    x, y = np.meshgrid(at, -at)
    return np.asarray(shapely.contains_xy(polygon, x, y))


def see_from(azimuth_deg: float, side_mm: float = 100.0, name: str = "front") -> ResolvedView:
    """A view whose square frame stands for so many mm in the middle of the piece."""
    frame = 1.2 * side_mm  # on a wall 100 mm behind it, of a light 500 mm before it
    return ResolvedView(
        name=name, frame_width_mm=frame, frame_height_mm=frame, azimuth_deg=azimuth_deg
    )


def ask_views(
    polygons: Sequence[MultiPolygon],
    *azimuths_deg: float,
    side_mm: float = 100.0,
    pixels: int = 200,
    length: float = 1e5,
    goals: tuple[float, ...] | None = None,
) -> Problem:
    """The problem of these silhouettes, one a view."""
    views = tuple(
        TargetView(
            see_from(azimuth, side_mm, f"v{n}"), draw_mask(polygon, side_mm, pixels), polygon
        )
        for n, (azimuth, polygon) in enumerate(zip(azimuths_deg, polygons, strict=True))
    )
    room = SettledRegion(size_mm=(1.6 * side_mm,) * 3)
    return Problem(views, 0.4, None, length, room, goals=goals)


def start_and_search(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    start: Start | None = None,
    repairs: int | None = None,
    **more: Any,
) -> SearchResult:
    """A search from the problem's own start, or from one that is given; `repairs` of the whole curve."""
    plan = plan_of(settings, len(problem.views))
    if repairs is not None:
        plan = replace(plan, repairs=repairs)
    start = start or make_start(problem, radius, settings)
    return search(problem, start, radius, settings, plan=plan, **more)


QUICK = """
schema = 1
[accuracy]
name = "draft"
[search]
coarse_px = 96
fine_px = 160
coarse_iterations = 25
fine_iterations = 20
settle_iterations = 20
depth_candidates = 8
"""


def ask_quick(**accuracy: float) -> str:
    """The same, with more asked of its accuracy."""
    more = "".join(f"{key} = {value}\n" for key, value in accuracy.items())
    return QUICK.replace("[search]", f"{more}[search]")


def view(**keys: Any) -> ResolvedView:
    frame = {"frame_width_mm": 180.0, "frame_height_mm": 180.0}
    return ResolvedView.model_validate({**frame, **keys})


def design_under(world: World, points: Array) -> Any:
    """A design of a tube of 2 mm radius about points (n, 3), with a tolerance of a quarter of a pixel."""
    scene = SimpleNamespace(
        views=(view(),),
        placing=world.placing,
        printer=world.printer,
        material=world.material,
        mount=Mount(),
        on_wall=lambda knots: False,
    )
    effects = survey(EffectContext((view(),), points, 2.0, 0.25, world), {})
    return SimpleNamespace(
        result=SimpleNamespace(effects=effects),
        settings=SimpleNamespace(tolerance_px=0.25, mesh_sides=24),
        scene=scene,
        knots=Knots((Knot(points),), 2.0),
    )
