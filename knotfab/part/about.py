"""The words of a piece's files about the piece: its title, how to light it, and a small picture of it."""

from __future__ import annotations

import io
from collections.abc import Sequence

from knotfab.drawing.dimensions import length
from knotfab.drawing.part_picture import draw_part, place_eyes
from knotfab.files.threemf import About
from knotfab.geometry.meshes import join_meshes
from knotfab.knots import count_in_words
from knotfab.part.assemble import Part
from knotfab.picture.read import Target
from knotfab_formats.scene import ResolvedView, SettledScene

__all__ = ["GCODE_PX", "THUMBNAIL_PX", "about_part", "draw_thumbnail"]

THUMBNAIL_PX = 300  # side of the picture in part.3mf
GCODE_PX = 480  # G-code has smaller copies of this picture


def about_part(part: Part, scene: SettledScene, targets: Sequence[Target]) -> About:
    """Return the words of the part's 3MF files: the scene's [about], and what follows from the piece itself.

    Without a title it is the pictures' names; without a designer, knotfab. Terms of a licence are left out
    where nobody gave them: whose the picture is, no file says.
    """
    names = " and ".join(target.shown for target in targets)
    return About(
        title=scene.about.title or names,
        designer=scene.about.designer or "knotfab",
        description=_describe(part, scene.views, names),
        licence=scene.about.licence,
        thumbnail_png=draw_thumbnail(part, scene.views, THUMBNAIL_PX),
    )


def draw_thumbnail(part: Part, views: Sequence[ResolvedView], pixels: int) -> bytes:
    """Draw the part as the first view's light sees it, so that its picture shows: a PNG, square."""
    vertices, faces = join_meshes(part.bodies)
    seen = vertices @ part.pose.matrix[:3, :3].T + part.pose.matrix[:3, 3]
    found = io.BytesIO()
    draw_part(seen, faces, found, place_eyes(views)[:1], pixels)
    return found.getvalue()


def _describe(part: Part, views: Sequence[ResolvedView], names: str) -> str:
    """Say what the piece is and how to light it, in a sentence; setup.pdf says more."""
    view, knots = views[0], part.pose.knots
    tube = f"{count_in_words(len(knots.knots))} of a tube {length(2 * knots.radius_mm)} mm thick"
    tube = tube[:1].upper() + tube[1:]
    if len(views) > 1:
        return (
            f"{tube} with {len(views)} shadows: {names}; scene.toml says where lamps and walls are."
        )
    off = f"{length(view.light_distance_mm)} mm from its middle"
    if view.kind == "eye":
        return f"{tube} that an eye {off} sees as {names}."
    lamp = f"a lamp {length(view.light_size_mm)} mm wide" if view.light_size_mm else "a small lamp"
    size = " × ".join(length(side) for side in view.frame_mm)
    wall = f"the wall {length(view.wall_distance_mm)} mm behind"
    return f"{tube} whose shadow is {names}: {size} mm on {wall}, by {lamp}, {off}."
