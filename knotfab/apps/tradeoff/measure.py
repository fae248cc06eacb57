"""Measure one run: its cost, and how near the round tube's shadow comes to the picture."""

from __future__ import annotations

import base64
import hashlib
import json
import time
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from PIL import Image
from scipy.ndimage import binary_closing, binary_erosion
from scipy.spatial import cKDTree

from knotfab.base.apps import VERSION
from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube, refine_settings
from knotfab.design.question import Question
from knotfab.geometry.measures import measure_curvature
from knotfab.geometry.tube import sweep
from knotfab.knots import Knots
from knotfab.picture.raster import encode_image
from knotfab.picture.silhouette import fit_size, mask_iou
from knotfab.plan import Search
from knotfab.problem import Problem
from knotfab.start.legibility import legibility, stretch_mask
from knotfab_formats.scene import VERIFIED_PX
from knotfab_formats.search import SearchSettings

_SHOWN_PX = 160  # longer side of the small pictures
_WRONG = 0.25  # a cell with this share of wrong pixels is drawn as too much or missing
# RGB of background, right, too much, missing
_COLOURS = (250, 248, 244, 36, 38, 43, 196, 61, 38, 47, 111, 196)


@dataclass(frozen=True)
class Study:
    """A picture, and the piece to be made from it."""

    name: str
    question: Question

    @cached_property
    def _digest(self) -> str:
        """A digest of everything a run depends on except its settings."""
        scene = self.question.scene
        same = {"search": {}, "accuracy": scene.accuracy.but(name="standard")}
        digest = hashlib.sha256(scene.but(**same).model_dump_json().encode())
        for target in self.question.problem.views:
            digest.update(repr(target.mask.shape).encode() + np.packbits(target.mask).tobytes())
        return digest.hexdigest()

    def key(self, settings: SearchSettings, turn: int = 0) -> str:
        """Return a name for the run that is unique to picture, scene, settings, version and turn."""
        given = settings.model_dump(exclude={"iou_slack"})
        text = json.dumps([self._digest, given, VERSION, turn])
        return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Run:
    """The cost and result of one search. Seconds are wall-clock time, except `cpu_s`.

    Repeated runs give the same knots, so their quality is not measured again and is None.
    """

    radius_mm: float
    radius_s: float
    search_s: float  # the start included
    sweep_s: float
    cpu_s: float
    feasible: bool
    repairs: int
    faces: int
    facet_px: float  # largest distance of the mesh's facets from the round tube, at 1024 px
    iou: float | None = None  # of the round tube at 1024 px, whatever resolution was searched at
    outline_px: float | None = None  # symmetric 95 % Hausdorff distance of the outlines, at 1024 px
    curvature: float | None = None  # mean, times the tube radius
    legible: float | None = None  # at 45 degrees; None for several views
    shadow: str = ""  # a small PNG, in base64

    def to_dict(self) -> dict[str, Any]:
        """Return the run as a JSON object."""
        return asdict(self)


def find_shadows(
    problem: Problem, knots: Knots, pixels: int = VERIFIED_PX
) -> list[tuple[Mask, Mask]]:
    """Render the round tube's shadow in each view. Returns (shadow, picture), `pixels` on the longer side."""
    found = []
    for view in problem.views:
        image = view.image_at(knots.radius_mm, pixels)
        seen = image.seen(knots.points, knots.rings, knots.radius_mm)
        found.append((seen, image.target > 0.5))
    return found


def outline_error_px(seen: Mask, wanted: Mask, slit_px: float = 0.0) -> float:
    """Return the symmetric 95 % Hausdorff distance of the two outlines, in px.

    Slits of the shadow no wider than `slit_px`, which nobody sees, are closed first. An outline is the
    innermost boundary pixels, so the distance is good to a pixel. If one mask is empty and the other is
    not, it is the picture's diagonal.
    """
    if not (seen.any() and wanted.any()):
        return 0.0 if seen.any() == wanted.any() else float(np.hypot(*seen.shape))
    half = int(0.5 * slit_px)
    seen, wanted = np.pad(seen, half + 1), np.pad(wanted, half + 1)
    if half:
        v, u = np.mgrid[-half : half + 1, -half : half + 1]
        seen = binary_closing(seen, np.hypot(u, v) <= 0.5 * slit_px)
    one, other = (np.argwhere(mask & ~binary_erosion(mask)) for mask in (seen, wanted))
    ways = ((one, other), (other, one))
    return max(float(np.quantile(cKDTree(to).query(at)[0], 0.95)) for at, to in ways)


def facet_error_px(problem: Problem, radius: float, sides: int) -> float:
    """Return how far the corners of a ring with the circle's area stick out beyond it, in px at 1024 px.

    That is r a² / 12 with a = 2 pi / sides, magnified as at the piece's middle.
    """
    corner_mm = radius * (2 * np.pi / sides) ** 2 / 12
    views = (v.view for v in problem.views)
    return max(corner_mm * v.magnification / v.pixel_mm for v in views)


def run_point(study: Study, settings: SearchSettings, judge: bool = True) -> Run:
    """Choose the radius, search and sweep for one picture, as a build would, and measure it.

    Raises:
        SceneError: no tube can draw the picture.
    """
    progress = Progress("quiet")
    begun, cpu = time.perf_counter(), time.process_time()
    question, radius, start, _ = choose_tube(study.question, settings, progress)
    problem, radius_s = question.problem, progress.timings.get("radius", 0.0)
    settings = refine_settings(question, settings, radius)
    result = Search("a study", problem, start, radius, settings).make()
    feasible = result.feasible
    searched = time.perf_counter()
    faces = 0
    for knot in result.knots.knots:
        try:
            faces += len(sweep(knot.points, radius, settings.mesh_sides)[1])
        except SceneError:
            feasible = False  # too sharp a bend for a tube of this radius
    swept, cpu = time.perf_counter(), time.process_time() - cpu
    search_s, sweep_s = searched - begun - radius_s, swept - searched
    facets, repairs = facet_error_px(problem, radius, settings.mesh_sides), result.log.repairs
    run = Run(radius, radius_s, search_s, sweep_s, cpu, feasible, repairs, faces, facets)
    return _add_quality(run, problem, result.knots) if judge else run


def _add_quality(run: Run, problem: Problem, knots: Knots) -> Run:
    """Add the quality of the knots to a run, as seen in the view that they draw worst."""
    shadows = find_shadows(problem, knots)
    number = min(range(len(shadows)), key=lambda k: mask_iou(*shadows[k]))
    worst, drawn = shadows[number], problem.views[number].view
    # nobody sees a gap between strands of half a tube radius or less
    slit_px = 0.5 * knots.radius_mm * drawn.magnification / drawn.pixel_mm
    lengths = [knot.length_mm for knot in knots.knots]
    bends = [measure_curvature(knot.points, knots.radius_mm).mean for knot in knots.knots]
    legible = None
    if len(problem.views) == 1:
        view = problem.views[0]
        light_mm, mask = view.view.light_distance_mm, stretch_mask(view.mask)
        legible = legibility(knots.points @ view.axes.T, knots.radius_mm, light_mm, mask, 45.0)
    return replace(
        run,
        iou=mask_iou(*worst),
        outline_px=outline_error_px(*worst, slit_px),
        curvature=float(np.average(bends, weights=lengths)),
        legible=legible,
        shadow=_draw_thumbnail(*worst),
    )


def _draw_thumbnail(seen: Mask, wanted: Mask) -> str:
    """Draw shadow and picture as one small PNG in four colours, in base64."""
    height, width = seen.shape
    size = fit_size(width, height, _SHOWN_PX)

    def cover(mask: Mask) -> Array:
        image = Image.fromarray(mask.astype(np.float32))
        return np.asarray(image.resize(size, Image.Resampling.BOX))

    one, other = cover(seen), cover(wanted)
    index = np.where(one > 0.5, 1, 0)
    index[one - other > _WRONG], index[other - one > _WRONG] = 2, 3
    image = Image.fromarray(index.astype(np.uint8), mode="P")
    image.putpalette(_COLOURS)
    return base64.b64encode(encode_image(image, optimize=True, bits=2)).decode("ascii")


def warm_up(study: Study, settings: SearchSettings) -> None:
    """Run a few iterations, so that no measured run includes the time for imports and compiling."""
    few: dict[str, Any] = {"coarse_iterations": 2, "fine_iterations": 2, "settle_iterations": 2}
    few |= {"method": "flow", "depth_candidates": 2, "radius_candidates": 2}
    run_point(study, settings.but(**few))
