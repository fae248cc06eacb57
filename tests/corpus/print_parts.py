"""Block-built parts for the printer's checks: walls, slots, arches, islands and stands."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .case import with_scene
from .files import Part
from .parts import Body, blocks, drum


def plain(
    body: Body,
    format: str = "stl",
    printer: Mapping[str, Any] | None = None,
    lying: bool = False,
    **tables: Mapping[str, Any],
) -> Part:
    """A part without knots in a scene that asks nothing of its shadow."""
    asked = {"printer": printer or {}, "accuracy": {"iou_floor": "auto"}, **tables}
    part = with_scene(Part(body), lying, **asked)
    return replace(part, format=format)


def slab(thick: float) -> Body:
    """A foot of 10 x 30 x 3 mm with an upright wall of `thick` mm along its middle."""
    cells = np.zeros((3, 1, 2), dtype=bool)
    cells[:, :, 0] = True
    cells[1] = True
    x = (2.0, 7.0 - thick / 2, 7.0 + thick / 2, 12.0)
    return blocks(cells, x, (2.0, 32.0), (0.0, 3.0, 18.0))


def slot(wide: float) -> Body:
    """A block of about 20 x 30 x 15 mm with a slot of `wide` mm from above."""
    cells = np.ones((3, 1, 2), dtype=bool)
    cells[1, :, 1] = False
    x = (2.0, 12.0, 12.0 + wide, 22.0 + wide)
    return blocks(cells, x, (2.0, 32.0), (0.0, 3.0, 15.0))


def arch(span: float) -> Body:
    """Two pillars `span` mm apart with a beam over them."""
    cells = np.ones((3, 1, 2), dtype=bool)
    cells[1, :, 0] = False
    return blocks(cells, (2.0, 10.0, 10.0 + span, 18.0 + span), (2.0, 12.0), (0.0, 15.0, 20.0))


def table() -> Body:
    """A plate of 30 x 30 mm on four legs."""
    cells = np.zeros((3, 3, 2), dtype=bool)
    cells[:, :, 1] = True
    cells[::2, ::2, 0] = True
    sides = (2.0, 8.0, 26.0, 32.0)
    return blocks(cells, sides, sides, (0.0, 15.0, 20.0))


def island() -> Body:
    """A gallows with a block that hangs down from its arm: the block begins in the air."""
    cells = np.zeros((3, 1, 4), dtype=bool)
    cells[0] = True
    cells[:, :, 2] = True
    cells[2, :, 1:3] = True
    cells[:, :, 3] = True
    return blocks(cells, (2.0, 12.0, 20.0, 28.0), (2.0, 12.0), (0.0, 8.0, 16.0, 22.0, 26.0))


def gallows(reach: float) -> Body:
    """A post on a foot of 8 x 10 mm with an arm that reaches out by `reach` mm."""
    cells = np.zeros((2, 1, 2), dtype=bool)
    cells[0] = True
    cells[1, :, 1] = True
    return blocks(cells, (2.0, 10.0, 10.0 + reach), (2.0, 12.0), (0.0, 20.0, 28.0))


def on_its_side(body: Body) -> Body:
    """The body as it is printed when what was upright (its z) lies along y."""
    turned = body.vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    low = turned.min(axis=0)
    return Body(turned - low + (2.0, 2.0, 0.0), body.faces)


def funnel(degrees: float) -> Body:
    """A round body that widens upwards, by so much from the vertical."""
    body = drum(10.0, 12.0, 48)
    wide = 1 + 12.0 * np.tan(np.radians(degrees)) / 10.0
    scale = np.where(body.vertices[:, 2] > 6, wide, 1.0)[:, None]
    vertices = body.vertices * np.concatenate([scale, scale, np.ones_like(scale)], axis=1)
    return Body(vertices, body.faces).move((40, 40, 0))
