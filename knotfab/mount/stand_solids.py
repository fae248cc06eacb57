"""The solids of a stand: tubes, posts, struts and base as one body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab.errors import SceneError
from knotfab.geometry.meshes import Mesh, as_manifold, as_mesh
from knotfab.mount.modeller import model
from knotfab.mount.plinth import CHAMFER_MM, CORNER_MM, Base
from knotfab.mount.solids import place_along, strut_solid
from knotfab.mount.stand import StandMount
from knotfab.mount.struts import GROUND, ROOT_SHARE
from knotfab_fixtures.peg import peg
from knotfab_fixtures.stand import plinth

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = ["stand_bodies"]

ROOT_HEIGHT_MM = 3.0
OVERLAP_MM = 0.5


def stand_bodies(tubes: list[Mesh], mount: StandMount) -> list[Mesh]:
    """Tubes, posts, struts and base as one watertight body, scene coordinates.

    Raises:
        SceneError: the union is not what the members predict: something else touches.
    """
    from manifold3d import Manifold, OpType

    solids = [as_manifold(tube) for tube in tubes]
    solids += _member_solids(mount)
    solids.append(_base_solid(mount.base))
    solid = Manifold.batch_boolean(solids, OpType.Add)
    parts, genus = len(solid.decompose()), len(mount.members)
    if parts != 1 or solid.genus() != genus:
        raise SceneError(
            "the stand",
            f"the part came out as {parts} bodies of genus {solid.genus()}, not one of {genus}",
            "Use --mount none, or report this scene",
        )
    return [as_mesh(solid)]


def _member_solids(mount: StandMount) -> list[Manifold]:
    normal, members = mount.base.slope.normal, mount.members
    found = []
    for i in range(len(members)):
        top, foot = members.start[i], members.end[i]
        length, radius = float(np.linalg.norm(top - foot)), float(members.radius[i])
        if members.second[i] != GROUND:
            found.append(strut_solid(top, foot, radius))
            continue
        axis = (top - foot) / length
        cosine = float(axis @ normal)
        root = ROOT_SHARE * radius
        sink = root * float(np.sqrt(max(0.0, 1 - cosine**2))) / cosine
        mesh = model(
            peg,
            length,
            radius,
            radius,
            root_radius_mm=root,
            root_height_mm=ROOT_HEIGHT_MM,
            sink_mm=sink + OVERLAP_MM,
        )
        solid = place_along(as_manifold(mesh), axis, foot)
        # what the slant needs must not come out of the underside
        found.append(solid.trim_by_plane([0.0, 1.0, 0.0], mount.base.bottom + 1.0))
    return found


def _base_solid(base: Base) -> Manifold:
    width, depth, front, back = base.size_mm
    mesh = model(
        plinth, width, depth, front, back, corner_radius_mm=CORNER_MM, chamfer_mm=CHAMFER_MM
    )
    right, up, out = base.slope.axes
    middle = (base.left + base.right) / 2 * right + (base.back + base.front) / 2 * out
    turn = np.column_stack([right, -out, up])
    return as_manifold(mesh).transform(np.column_stack([turn, middle + base.bottom * up]))
