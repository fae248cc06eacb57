"""Choose the tube radius: the largest that still draws the pictures well."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.design.budget import Budget
from knotfab.design.candidates import drawing_radius, line_radius, range_of, too_fine, usual_radii
from knotfab.design.question import Question
from knotfab.design.small import SmallParts, missed_alone, weigh_small
from knotfab.geometry.polylines import arc_lengths
from knotfab.knots import Knot, Knots
from knotfab.picture.opening import Small, find_missed, find_small
from knotfab.picture.silhouette import trace_polygon
from knotfab.problem import Report, Start, Watch
from knotfab.scene.require import require_radius
from knotfab.start.filling import Template, enlarge_loops, fill, simple_curves, template_iou
from knotfab.start.start import make_start, make_template
from knotfab_formats.search import SearchSettings

_NOTHING = 0.5  # IoU below which nothing of the picture is drawn
# IoU of a start for several views that needs no thinner tube: the search brings it some six times nearer
_ENOUGH = 0.86
# IoU of a filling of several pieces, such as letters, from which a search at standard ended faithful: a loop
# is no narrower than two tubes, and thicker ones draw a letter bold, with knobs
_CLEAR = 0.958
_WORSE = 0.03  # IoU that the start of a thinner tube may lack, which the search regains
_THINNER = 0.75  # ratio of the next radius to the thinnest so far
_SPECK = 0.5  # side of the largest square that nobody misses, in radii of the thinnest tube
_WORKERS = 2  # radii tried in parallel; the result does not depend on it
# length of knots with depth over their template's; measured on examples: 1.42 to 1.46
_LONGER = 1.4
_FEW = 4  # depth profiles to try if only a feasible start is needed
_KEPT: dict[str, _Trials] = {}  # trials of the last question, which a build shares with its preview


@dataclass(frozen=True)
class RadiusTrial:
    """One radius: the IoU that it can reach, and the IoU of its start (NaN if none was made)."""

    radius_mm: float
    template_iou: float
    trial_iou: float


@dataclass(frozen=True)
class RadiusChoice:
    """The radius chosen, all trials, and the template and start if they were made."""

    radius_mm: float
    trials: tuple[RadiusTrial, ...]
    template: Template | None = None
    start: Start | None = None
    small: SmallParts | None = None  # None where no small part is lost


@dataclass
class _Trials:
    """Templates, scores and starts of the radii tried so far."""

    question: Question
    settings: SearchSettings
    knots: int | None
    templates: dict[float, Template] = field(default_factory=dict)
    starts: dict[float, Start] = field(default_factory=dict)
    failures: dict[float, SceneError] = field(default_factory=dict)
    scores: dict[float, float] = field(default_factory=dict)
    begun: dict[float, float] = field(default_factory=dict)
    drawn: dict[float, list[Template]] = field(default_factory=dict)  # with loops that close
    watch: Watch | None = None

    @property
    def one_view(self) -> bool:
        return len(self.question.problem.views) == 1

    @property
    def filled(self) -> bool:
        """Whether each picture is filled by itself, as a single one is."""
        return self.one_view or self.question.problem.apart_mm is not None

    @property
    def thinnest(self) -> float:
        """The thinnest radius that is tried, mm."""
        views, printed = self.question.views, self.question.scene.printer.min_tube_radius_mm
        side = 0.0 if self.filled else max(view.longer_mm for view in views)
        return max(printed, range_of(len(views)).least * side)

    def score(self, radius: float) -> float:
        """Return the IoU that a tube of this radius can reach in its worst view; -inf without a template."""
        if radius not in self.scores:
            self.scores[radius] = self._score(radius)
        return self.scores[radius]

    def _score(self, radius: float) -> float:
        if not self.filled:
            return self.question.opening(radius)
        drawn = self.drawn[radius] = self._fill(radius)
        if not all(simple_curves(list(template.curves)) for template in drawn):
            return -np.inf
        return min(
            template_iou(template, view.polygon)
            for template, view in zip(drawn, self.question.problem.views, strict=True)
        )

    def _fill(self, radius: float) -> list[Template]:
        """Return the filling of each mask, with loops as large as a tube can close."""
        views = self.question.problem.views
        if self.one_view:
            template = self.templates[radius] = make_template(views[0], radius, self.knots)
            if self.watch is not None:
                self.watch(lambda: _flat_knots(template), False)
            found = [template]
        else:
            found = [fill(view.polygon, radius) for view in views]
        bend = self.question.problem.limits(radius).bend_radius
        flat = self.one_view and self.question.scene.piece.depth == 0
        return [enlarge_loops(template, bend, flat) for template in found]

    @cached_property
    def small(self) -> list[list[Small]]:
        """The small parts of each picture that count."""
        least = (_SPECK * self.question.scene.printer.min_tube_radius_mm) ** 2
        return [find_small(polygon, least) for polygon in self.question.problem.polygons]

    def missed(self, radius: float) -> list[tuple[int, Small]]:
        """Return the small parts that a tube of this radius loses, each with the number of its view."""
        problem, found = self.question.problem, list[tuple[int, Small]]()
        bend = problem.limits(radius).bend_radius
        if self.filled and any(self.small) and radius not in self.drawn:
            self.drawn[radius] = self._fill(radius)
        for n, (small, polygon) in enumerate(zip(self.small, problem.polygons, strict=True)):
            if not small:
                continue
            if self.filled:
                lost = find_missed(small, polygon, self.drawn[radius][n].tube, radius)
            else:
                lost = missed_alone(small, polygon, radius, bend)
            found += [(n, one) for one in lost]
        return found

    def weigh(self, usual: float) -> SmallParts | None:
        """Weigh the small parts that the usual radius loses."""
        problem = self.question.problem
        if problem.views[0].lines:
            return None
        thinnest = self.question.scene.printer.min_tube_radius_mm
        bend = problem.limits(thinnest).bend_radius
        return weigh_small(self.missed, usual, thinnest, bend, problem.polygons)

    def vertices(self, radius: float) -> int:
        """Estimate the number of vertices that knots of this radius will have, from the template."""
        length = sum(arc_lengths(curve)[-1] for curve in self.templates[radius].curves)
        return int(_LONGER * length / (self.settings.settle_edge_radii * radius))

    def begin(self, radius: float) -> float:
        """Make a start; return its IoU in the worst view (1 if the template rates it), 0 if there is none."""
        if radius not in self.begun:
            self.begun[radius] = self._begin(radius)
        return self.begun[radius]

    def _begin(self, radius: float) -> float:
        problem = self.question.with_depth(radius).problem
        filling = self.settings.network_start == "filling"
        settings = self.settings
        if not filling:
            few = {"depth_candidates": _FEW} if self.filled else {}
            settings = settings.but(network_start="filling", **few)
        template = self.templates.get(radius)
        try:
            start = make_start(problem, radius, settings, self.knots, template=template)
        except SceneError as error:  # no place for the knot that is asked for, or no such curve
            self.failures[radius] = error
            return 0.0
        if filling:
            self.starts[radius] = start
        return 1.0 if self.filled else min(start.ious)


def choose_radius(
    question: Question,
    settings: SearchSettings,
    knots: int | None = None,
    report: Report | None = None,
    watch: Watch | None = None,
    budget: Budget | None = None,
    placed: bool = True,
) -> RadiusChoice:
    """Choose the largest tube radius that draws the pictures nearly as well as the best one.

    For one view, radii are compared by the IoU of their flat templates, in which loops too small for a closed
    tube count as the smallest ring. That is a better guide than short searches, and four times as fast: over
    19 pictures and 16 glyphs at up to five radii, the template gave up 0.0009 IoU on average against the best
    radius (at most 0.010), a short search 0.0018 (0.019). For several views, the starts are compared.

    Args:
        knots: as for `fill`.
        report: called with (share done, best IoU).
        watch: called with each filling that is tried.
        budget: gives up more IoU for a thicker tube if the build would end too late.
        placed: whether to find depths for the knots of one view, which a preview need not.

    Raises:
        SceneError: no printable radius draws anything of the pictures.
    """
    trials = _recall(question, settings, knots)
    trials.watch = watch
    span = range_of(1 if trials.filled else len(question.views))
    give = max(span.give, settings.radius_give)
    radii, thin = _candidates(trials)
    with ThreadPoolExecutor(_WORKERS) as pool:
        scores = dict(zip(radii, pool.map(trials.score, radii), strict=True))
        usual = max(scores.values())
        parted = trials.one_view and len(question.problem.views[0].polygon.geoms) > 1
        clear = _CLEAR if parted else span.drawn
        if usual < clear:  # the picture forbids the usual thickness
            scores |= dict(zip(thin, pool.map(trials.score, thin), strict=True))
    scores = {r: s for r, s in scores.items() if np.isfinite(s)}
    if not scores:
        raise SceneError(
            "the picture",
            "no tube radius gives a template whose curves keep clear of each other",
            "Smooth its outline (--smooth 5), or use a simpler picture.",
        )
    if report is not None:
        report(0.2, None)
    if trials.filled:
        _require_picture(question, scores)
        if budget is not None and trials.one_view and "radius_give" not in question.scene.search:
            give = budget.thicker(give, lambda less: trials.vertices(_thickest(scores, less)))
        well = max(scores.values()) - give
        if span.drawn <= usual < clear:  # somewhat thinner will do
            well = min(well, clear)
        # the thickest that draws the picture well comes first, then the others, best first
        order = sorted(scores, key=lambda r: (min(scores[r], well), r), reverse=True)
        small = trials.weigh(order[0])
        if small is not None and small.taken and small.keeping_mm is not None:
            scores[small.keeping_mm] = trials.score(small.keeping_mm)
            order.insert(0, small.keeping_mm)
        found = _begin_one(trials, order, placed)
        chosen = _thickest(found, give)
    else:
        found = _begin_many(trials, scores, radii, report)
        chosen = _thickest(found, give)
        small = trials.weigh(chosen)
        if small is not None and small.taken and small.keeping_mm is not None:
            scores[small.keeping_mm] = trials.score(small.keeping_mm)
            found[small.keeping_mm] = trials.begin(small.keeping_mm)
            if found[small.keeping_mm] > found[chosen] - _WORSE:
                chosen = small.keeping_mm
    if max(found.values()) == 0 and trials.failures:
        raise next(iter(trials.failures.values()))
    drawn = {} if trials.filled else found
    return RadiusChoice(
        chosen,
        tuple(RadiusTrial(r, scores[r], drawn.get(r, float("nan"))) for r in sorted(scores)),
        trials.templates.get(chosen),
        trials.starts.get(chosen),
        small,
    )


def take_radius(
    question: Question, settings: SearchSettings, knots: int | None, radius: float, placed: bool
) -> RadiusChoice:
    """Take a radius that is given, mm, with its template for one view and, if `placed`, its start.

    Raises:
        SceneError: there is no such start.
    """
    trials = _recall(question, settings, knots)
    templates, starts = trials.templates, trials.starts
    if trials.one_view and radius not in templates:
        templates[radius] = make_template(question.problem.views[0], radius, knots)
    template = templates.get(radius)
    if placed and radius not in starts:
        problem = question.with_depth(radius).problem
        starts[radius] = make_start(problem, radius, settings, knots, template=template)
    return RadiusChoice(radius, (), template, starts[radius] if placed else None)


def _candidates(trials: _Trials) -> tuple[list[float], list[float]]:
    """Return the radii to try at once, and thinner ones for pictures too fine for these, mm."""
    question, settings = trials.question, trials.settings
    views, printer = question.views, question.scene.printer
    if question.problem.views[0].lines:  # strokes are as wide as one tube
        radius = line_radius(views[0])
        require_radius(radius, printer, "the radius of one tube along its strokes (--thicken)")
        return [radius], []
    least, alike = settings.radius_from, views
    if trials.filled and not trials.one_view:
        # as thick on the screen as the tube of a single view at the usual magnification, 1.2
        least, alike = least * 1.2 / views[0].magnification, views[:1]
    return usual_radii(alike, trials.thinnest, settings.radius_candidates, least)


def _begin_one(trials: _Trials, order: Sequence[float], placed: bool) -> dict[float, float]:
    """Try starts in this order of radii until one succeeds; return 1 or 0 by radius.

    Without `placed` the first one is taken to succeed.
    """
    found: dict[float, float] = {}
    for radius in order:
        found[radius] = trials.begin(radius) if placed else 1.0
        if found[radius]:
            break
    return found


def _begin_many(
    trials: _Trials, scores: dict[float, float], radii: list[float], report: Report | None
) -> dict[float, float]:
    """Return the IoU of starts for several views, by radius; thinner ones are tried until one is enough."""
    found: dict[float, float] = {}
    span, thinnest = range_of(len(trials.question.views)), trials.thinnest
    best = max(scores.values())
    few = sorted((r for r in scores if scores[r] > best - span.hopeless), reverse=True)

    def begin(radius: float) -> None:
        found[radius] = trials.begin(radius)
        if report is not None:
            report(0.2 + 0.8 * len(found) / len(scores), max(found.values()))

    with ThreadPoolExecutor(_WORKERS) as pool:
        list(pool.map(begin, [r for r in few if r in radii]))
    few = [r for r in few if r not in radii]
    while not found or (max(found.values()) < _ENOUGH and min(found) > thinnest):
        thinner = few.pop(0) if few else max(thinnest, _THINNER * min(found))
        if thinner not in scores:
            scores[thinner] = trials.score(thinner)
        begin(thinner)
    return found


def _recall(question: Question, settings: SearchSettings, knots: int | None) -> _Trials:
    """Return the last question's trials if this one is equal (but for `printed`), or else new ones."""
    piece = question.scene.piece.but(printed=False)
    scene = question.scene.but(piece=piece)
    parts = [repr((scene, settings, knots, question.views)).encode()]
    for view in question.problem.views:
        parts += [view.mask.tobytes(), view.polygon.wkb, *(line.tobytes() for line in view.lines)]
    key = hashlib.sha256(b"|".join(parts)).hexdigest()
    trials = _KEPT.get(key)
    if trials is None:
        trials = _Trials(question, settings, knots)
        _KEPT.clear()
        _KEPT[key] = trials
    return trials


def _thickest(scores: Mapping[float, float], give: float) -> float:
    """Return the largest radius whose score is at most `give` below the best."""
    return max(radius for radius, score in scores.items() if score >= max(scores.values()) - give)


def _require_picture(question: Question, scores: dict[float, float]) -> None:
    """Refuse a picture that no printable tube draws."""
    top = max(scores.values())
    if top >= _NOTHING:
        return
    view = question.problem.views[0]
    if view.lines:
        raise SceneError(
            "the picture",
            f"one tube of {min(scores):.2f} mm radius along each of its strokes reaches an IoU of "
            f"{top:.2f} with them: they are wider than that, or run together",
            "Fill it instead (--lines off), or give the width of its strokes (--thicken MM).",
        )
    height, width = view.mask.shape
    least = question.scene.printer.min_tube_radius_mm * view.view.px_per_mm(width)
    raise too_fine(
        drawing_radius(trace_polygon(view.mask), least),
        view.view,
        (width, height),
        question.scene.printer,
        f"it is too fine for any printable tube: at a radius of {min(scores):.2f} mm the shadow "
        f"reaches an IoU of {top:.2f}",
    )


def _flat_knots(template: Template) -> Knots:
    """Return the filling as flat knots in the plane z = 0."""
    laid = (np.pad(curve, ((0, 0), (0, 1))) for curve in template.curves)
    return Knots(tuple(Knot(curve) for curve in laid), template.radius)
