"""The solids of a stand: tubes, posts, struts and base as one body."""

from __future__ import annotations

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.geometry.meshes import Mesh, as_manifold, as_mesh
from knotfab.mount.plinth import CHAMFER_MM, CORNER_MM, Base
from knotfab.mount.solids import Fixture, along, strut
from knotfab.mount.stand import StandMount
from knotfab.mount.struts import GROUND, ROOT_SHARE
from knotfab_fixtures.peg import peg
from knotfab_fixtures.stand import plinth

__all__ = ["stand_bodies", "stand_fixtures"]

ROOT_HEIGHT_MM = 3.0  # a post widens to its root over so much
OVERLAP_MM = 0.5  # a post goes so much deeper into the base than its root needs


def stand_bodies(tubes: list[Mesh], mount: StandMount) -> list[Mesh]:
    """Return tubes, posts, struts and base as one watertight body, scene coordinates.

    Raises:
        SceneError: the union is not what the members predict: something else touches.
    """
    from manifold3d import Manifold, OpType

    solids = [as_manifold(tube) for tube in tubes]
    solids += [fixture.solid() for fixture in stand_fixtures(mount)]
    solid = Manifold.batch_boolean(solids, OpType.Add)
    parts, genus = len(solid.decompose()), len(mount.members)
    if parts != 1 or solid.genus() != genus:
        raise SceneError(
            "the stand",
            f"the part came out as {parts} bodies of genus {solid.genus()}, not one of {genus}",
            "Use --mount none, or report this scene",
        )
    return [as_mesh(solid)]


def stand_fixtures(mount: StandMount) -> list[Fixture]:
    """Return posts, struts and base, scene coordinates."""
    normal, members = mount.base.slope.normal, mount.members
    found = []
    for i in range(len(members)):
        top, foot = members.start[i], members.end[i]
        length, radius = float(np.linalg.norm(top - foot)), float(members.radius[i])
        if members.second[i] != GROUND:
            found.append(strut(top, foot, radius))
            continue
        axis = (top - foot) / length
        cosine = float(axis @ normal)
        root = ROOT_SHARE * radius
        sink = root * float(np.sqrt(max(0.0, 1 - cosine**2))) / cosine
        named = {
            "root_radius_mm": root,
            "root_height_mm": ROOT_HEIGHT_MM,
            "sink_mm": sink + OVERLAP_MM,
        }
        # a slanting root must not come out of the underside
        above = np.array([0.0, 1.0, 0.0]), mount.base.bottom + 1.0
        sizes = length, radius, radius
        found.append(Fixture("post", peg, sizes, along(axis, foot), named, above))
    return [*found, _base(mount.base)]


def _base(base: Base) -> Fixture:
    right, up, out = base.slope.axes
    middle = (base.left + base.right) / 2 * right + (base.back + base.front) / 2 * out
    motion = np.column_stack([right, -out, up, middle + base.bottom * up])
    named = {"corner_radius_mm": CORNER_MM, "chamfer_mm": CHAMFER_MM}
    return Fixture("base", plinth, base.size_mm, motion, named)
