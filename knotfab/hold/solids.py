"""The solids of which mounts are united, each in its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.hold.modeller import model_fixture
from knotfab.hold.plinth import CHAMFER_MM, CORNER_MM, Base
from knotfab.hold.stand import StandMount
from knotfab.hold.struts import GROUND, ROOT_SHARE
from knotfab_fixtures.holders import plinth
from knotfab_fixtures.solids import peg
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    from manifold3d import Manifold


@dataclass(frozen=True)
class Fixture:
    """One solid of a mount: a function of `knotfab_fixtures`, its arguments, and its place.

    `motion` (3, 4) takes it there. Given `above`, a plane's normal (3,) and offset, only what lies
    beyond the plane stays.
    """

    kind: str
    of: Callable[..., Mesh]
    sizes: tuple[Any, ...]
    motion: Array
    named: Mapping[str, float] = field(default_factory=dict)
    above: tuple[Array, float] | None = None

    def solid(self) -> Manifold:
        """Make the solid of facets, ready to be united."""
        solid = as_manifold(model_fixture(self.of, *self.sizes, **self.named)).transform(
            self.motion
        )
        return solid if self.above is None else solid.trim_by_plane(*self.above)


def motion_along(axis: Array, point: Array, helper: Array | None = None) -> Array:
    """Return the motion (3, 4) that takes the origin to `point` and z to the unit vector `axis`.

    Args:
        helper: (3,) not along the axis; x comes to lie square to both.
    """
    beside = np.eye(3)[np.abs(axis).argmin()] if helper is None else helper
    across = np.cross(beside, axis)
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis, point])


def strut(start: Array, end: Array, radius_mm: float) -> Fixture:
    """Make a round bar between two points (3,) mm."""
    length = float(np.linalg.norm(start - end))
    return Fixture(
        "strut", peg, (length, radius_mm, radius_mm), motion_along((start - end) / length, end)
    )


def unite(tubes: list[Mesh], fixtures: list[Fixture], genus: int, what: str) -> list[Mesh]:
    """Unite tubes and fixtures to one watertight body with `genus` handles, as `fuse` does."""
    solids = [as_manifold(tube) for tube in tubes] + [fixture.solid() for fixture in fixtures]
    return [fuse(solids, genus, what)]


def fuse(solids: list[Manifold], genus: int, what: str, part: str = "the part") -> Mesh:
    """Fuse solids to one watertight body with `genus` handles.

    Raises:
        SceneError: it has more or fewer, since something else touches; `what` names the mount.
    """
    from manifold3d import Manifold, OpType

    took_part("manifold3d", "joined tubes and mount")
    solid = Manifold.batch_boolean(solids, OpType.Add)
    parts = len(solid.decompose())
    if parts != 1 or solid.genus() != genus:
        raise SceneError(
            what,
            f"{part} came out as {parts} bodies of genus {solid.genus()}, not one of {genus}",
            "Use --mount none, or report this scene",
        )
    return as_mesh(solid)


# The solids of a stand: tubes, posts, struts and base as one body.

ROOT_HEIGHT_MM = 3.0  # a post widens to its root over so much
OVERLAP_MM = 0.5  # a post goes so much deeper into the base than its root needs


def stand_bodies(tubes: list[Mesh], mount: StandMount) -> list[Mesh]:
    """Unite tubes, posts, struts and base to one watertight body, in scene coordinates."""
    return unite(tubes, stand_fixtures(mount), len(mount.members), "the stand")


def stand_fixtures(mount: StandMount) -> list[Fixture]:
    """List posts, struts and base as fixtures, in scene coordinates."""
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
        found.append(Fixture("post", peg, sizes, motion_along(axis, foot), named, above))
    return [*found, _base_fixture(mount.base)]


def _base_fixture(base: Base) -> Fixture:
    right, up, out = base.slope.axes
    middle = (base.left + base.right) / 2 * right + (base.back + base.front) / 2 * out
    motion = np.column_stack([right, -out, up, middle + base.bottom * up])
    named = {"corner_radius_mm": CORNER_MM, "chamfer_mm": CHAMFER_MM}
    return Fixture("base", plinth, base.size_mm, motion, named)
