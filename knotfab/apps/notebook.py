"""Show a build or a stage in a notebook: words and pictures as one piece of HTML."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import singledispatch
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.design import Design
from knotfab.design.question import Question
from knotfab.geometry.tube import Mesh, join_meshes, sweep
from knotfab.knots import Knots
from knotfab.part.assemble import Part
from knotfab.picture.raster import image_uri, silhouette_uri
from knotfab.picture.read import Target
from knotfab.problem import SearchResult, Start
from knotfab.render.part_picture import draw_part, place_eyes
from knotfab.report.page import VERDICTS, make_environment
from knotfab.report.pictures import find_pictures
from knotfab.report.summary import conclude, tell_knots
from knotfab.request import Outcome
from knotfab_formats.errors import spelled
from knotfab_formats.scene import ResolvedView

_MOST = 1_000_000  # characters of pictures
_PANEL_PX, _SIDES = 240, 16
_START_PX = 360  # longer side of the drawn start
_SEEN = "from the light of each view, then turned about the vertical"
_ROLES = ("moving", "compare", "bent", "part")
Pictures = Sequence[tuple[str, str]]  # data URI and caption


@singledispatch
def show(result: object) -> str | None:
    """Render the result of a public function; None for others, which show their `repr`."""
    return None


@show.register
def _(result: Outcome) -> str:
    report = result.found
    word = "" if report.verdict is None else report.verdict.word
    passed = "Verified." if result.exit_code == 0 else "Not ready."
    title = f"{passed} {' '.join(VERDICTS.get(word, ()))}"
    found, room, pictures = find_pictures(result.folder), _MOST, []
    for picture in sorted(
        (p for p in found if p.role in _ROLES), key=lambda p: _ROLES.index(p.role)
    ):
        try:
            uri = picture.data_uri
        except OSError:  # the folder is another build's by now
            continue
        if (room := room - len(uri)) < 0:
            break
        pictures.append((uri, picture.caption or picture.role))
    return _page(title, [*conclude(report), f"All of it: {result.folder}/report.html"], pictures)


@show.register
def _(target: Target) -> str:
    said = [f"{target.width} × {target.height} px, {target.pieces} piece(s)", *target.notes]
    return _page(
        f"{target.shown}: {target.rule}", said, [(silhouette_uri(target.mask), "what is drawn")]
    )


@show.register
def _(question: Question) -> str:
    problem = question.problem
    said = [f"clearance {problem.clearance:.2f} mm, knots of type {problem.knot}"]
    drawn = [(silhouette_uri(v.mask), f"{v.view.name}: what is drawn") for v in problem.views]
    return _page("What a search is asked", said, drawn)


@show.register
def _(start: Start) -> str:
    points = np.concatenate(start.curves)[:, :2]
    low, scale = (
        points.min(axis=0),
        (_START_PX - 2) / max(float(np.ptp(points, axis=0).max()), 1e-9),
    )
    wide, high = np.ptp(points, axis=0) * scale + 2
    sheet = Image.new("L", (int(wide) + 1, int(high) + 1), 255)
    for curve in start.curves:
        at = (np.concatenate([curve, curve[:1]])[:, :2] - low) * scale + 1
        ImageDraw.Draw(sheet).line([(x, high - y) for x, y in at], fill=60)
    count = f"{len(start.curves)} closed curve(s) to start from"
    return _page(count, [start.why], [(image_uri(sheet), "along z")])


@show.register
def _(found: SearchResult) -> str:
    ious = ", ".join(f"{iou:.4f}" for iou in found.ious)
    said = [f"IoU {ious}, as the search sees it", *found.feasibility.violations]
    title = "Every limit holds" if found.feasible else "A limit is broken"
    knots = found.knots
    said = [*said, tell_knots(len(knots.knots), knots.radius_mm)]
    return _page(title, said, _draw_knots(knots, found.views))


@show.register
def _(design: Design) -> str:
    bound = [price.sentence for price in design.binding]
    unmet = [] if design.unmet is None else design.unmet.violations
    said = [tell_knots(len(design.knots.knots), design.knots.radius_mm), *unmet, *bound]
    return _page("A design", said, _draw_knots(design.knots, design.scene.views))


@show.register
def _(part: Part) -> str:
    scene, (vertices, faces) = part.mounted.scene, join_meshes(part.bodies)
    pose = part.pose.matrix
    seen = vertices @ pose[:3, :3].T + pose[:3, 3]
    size = " × ".join(f"{side:.0f}" for side in np.ptp(vertices, axis=0))
    mount = "no mount" if part.mounted.holder is None else f"mount: {scene.mount.kind}"
    return _page(
        "A part", [f"{size} mm as it is printed, {mount}"], _draw((seen, faces), scene.views)
    )


def _page(title: str, lines: Sequence[str], pictures: Pictures) -> str:
    template = make_environment(Path(__file__).parent).get_template("notebook.html.j2")
    return spelled(template.render(title=title, lines=lines, pictures=pictures))


def _draw_knots(knots: Knots, views: Sequence[ResolvedView]) -> Pictures:
    """Draw the tubes; nothing if a knot bends too tightly to be swept."""
    try:
        tubes = [sweep(knot.points, knots.radius_mm, _SIDES) for knot in knots.knots]
    except SceneError:
        return []
    return _draw(join_meshes(tubes), views)


def _draw(mesh: Mesh, views: Sequence[ResolvedView]) -> Pictures:
    """Draw a mesh, in scene coordinates, from four sides."""
    eyes: Array = place_eyes(views)
    with io.BytesIO() as file:
        draw_part(*mesh, file, eyes, _PANEL_PX)
        return [(image_uri(Image.open(file), "webp", quality=85), _SEEN)]
