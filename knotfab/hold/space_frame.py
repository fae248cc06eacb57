"""A space frame of straight beams under its own weight: how far each joint moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab_formats.slicer_ini import FLANK_DEG

GRAVITY_M_S2 = 9.81
POISSON = 0.35  # Poisson's ratio of filament plastics; it enters through the twist alone


@dataclass(frozen=True)
class Beams:
    """Euler-Bernoulli beams of one material between joints.

    Attributes:
        joints: (n, 3) mm. ends: (m, 2) joints of each beam.
        area: (m,) mm². inertia: (m,) second moment of area, mm⁴, the same about every axis of the
            section (round or square). twist: (m,) torsion constant, mm⁴.
        flat: (3,) unit normal of a plane in which strips lie. edgewise: (m,) the second moment that resists
            bending within it; `inertia` then resists bending out of it.
    """

    joints: Array
    ends: Indices
    area: Array
    inertia: Array
    twist: Array
    flat: Array | None = None
    edgewise: Array | None = None


def round_beams(joints: Array, ends: Indices, radius: Array, wall_mm: float = np.inf) -> Beams:
    """Make beams of round section, `radius` (m,) mm, as stiff as a flank with such a wall about a core.

    Each counts as stiff as about its weaker axis, and as heavy as an upright one (`stiffness_share`).
    """
    beside = np.maximum(radius - wall_mm, 0.0)
    above = np.maximum(radius - wall_mm * np.sin(np.radians(FLANK_DEG)), 0.0)
    inertia = np.pi / 4 * (radius**4 - beside * above**3)
    return Beams(joints, ends, np.pi * (radius**2 - beside**2), inertia, 2 * inertia)


@dataclass(frozen=True)
class SpaceFrame:
    """A frame with its stiffness factored: forces in, displacements and turns out.

    Each joint has six unknowns: three displacements in mm, three turns in radians. `loose` numbers
    the free ones, `weight` (6 n,) is the frame's own load.
    """

    joints: int
    loose: Indices
    weight: Array
    factor: Any

    def displacements(self) -> Array:
        """Return the joints' displacements and turns under the frame's own weight, (n, 6)."""
        return self._solve(self.weight[:, None]).reshape(self.joints, 6)

    def flexibility(self, joints: Indices) -> Array:
        """Return all moves and turns under a unit force or couple on each of c joints, (6 n, c, 6)."""
        pushed = (6 * np.asarray(joints)[:, None] + np.arange(6)).ravel()
        return self.moves_under(pushed).reshape(6 * self.joints, len(joints), 6)

    def moves_under(self, unknowns: Indices) -> Array:
        """Return all moves and turns under a unit force or couple on each of c unknowns, (6 n, c)."""
        unit = np.zeros((6 * self.joints, len(unknowns)))
        unit[unknowns, np.arange(len(unknowns))] = 1.0
        return self._solve(unit)

    def response(self, force: Array) -> Array:
        """Return moves and turns (n, 6) under forces and couples (n, 6), without the weight."""
        return self._solve(force.reshape(-1, 1)).reshape(self.joints, 6)

    def _solve(self, force: Array) -> Array:
        moved = np.zeros_like(force)
        moved[self.loose] = self.factor.solve(np.ascontiguousarray(force[self.loose]))
        return moved


def assemble_frame(
    beams: Beams,
    fixed: Indices,
    young_mpa: float,
    density_g_cm3: float,
    down: Array,
    held: Mask | None = None,
) -> SpaceFrame:
    """Assemble and factor the frame of these beams, loaded by their own weight.

    The direct stiffness method with 12 x 12 element matrices and consistent loads (Przemieniecki,
    "Theory of Matrix Structural Analysis", 1968, ch. 5): exact at the joints for small
    displacements of slender beams, however long they are. Shear is left out.

    Args:
        fixed: joints that neither move nor turn. down: (3,) unit vector of gravity. held: (6 n,) which
            unknowns are held, in place of all of the fixed joints.

    Raises:
        ValueError: something is not held (the stiffness is singular), or a beam has no length.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    n = len(beams.joints)
    if not (_lengths_and_axes(beams)[0] > 0).all():
        raise ValueError("a beam has no length")
    load = loads_of(beams, density_g_cm3, down)
    freedom = (6 * beams.ends[:, :, None] + np.arange(6)).reshape(len(load), 12)
    force = np.zeros(6 * n)
    np.add.at(force, freedom.ravel(), load.ravel())
    rows, columns = np.repeat(freedom, 12, axis=1).ravel(), np.tile(freedom, (1, 12)).ravel()
    values = stiffness_of(beams, young_mpa).ravel()
    if held is None:
        held = np.zeros(6 * n, dtype=bool)
        held[(6 * np.asarray(fixed, dtype=np.int64)[:, None] + np.arange(6)).ravel()] = True
    if not held.any():
        raise ValueError("nothing is held")
    matrix = coo_matrix((values, (rows, columns)), shape=(6 * n, 6 * n)).tocsc()
    loose = np.flatnonzero(~held)
    try:
        # symmetric and positive: other pivots fill the factors four times as much
        how = {"diag_pivot_thresh": 0.001, "options": {"SymmetricMode": True}}
        factor = splu(matrix[loose][:, loose], permc_spec="MMD_AT_PLUS_A", **how)
    except RuntimeError as error:
        raise ValueError("a joint is not held") from error
    return SpaceFrame(n, loose, force, factor)


def stiffness_of(beams: Beams, young_mpa: float) -> Array:
    """Return stiffness matrices in common axes, for six unknowns of each end, (m, 12, 12)."""
    length, axes = _lengths_and_axes(beams)
    turn = _turns(axes)
    found: Array = np.swapaxes(turn, 1, 2) @ _stiffness(beams, length, young_mpa) @ turn
    return found


def _turns(axes: Array) -> Array:
    """Return rotations from common axes to the beams' (m, 3, 3), for both ends: (m, 12, 12)."""
    turn = np.zeros((len(axes), 12, 12))
    for block in range(4):
        turn[:, 3 * block : 3 * block + 3, 3 * block : 3 * block + 3] = axes
    return turn


def _lengths_and_axes(beams: Beams) -> tuple[Array, Array]:
    """Return the beams' lengths (m,), mm, and axes (m, 3, 3) in rows: along, and two across.

    Of beams that lie in a plane, the second lies there, too.
    """
    along = beams.joints[beams.ends[:, 1]] - beams.joints[beams.ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, 1e-300)[:, None]
    helper = np.zeros_like(unit)
    helper[np.arange(len(unit)), np.abs(unit).argmin(axis=1)] = 1.0
    if beams.flat is not None:
        helper[np.abs(unit @ beams.flat) < 0.9] = beams.flat
    second = np.cross(unit, helper)
    second /= np.maximum(np.linalg.norm(second, axis=1), 1e-300)[:, None]
    return length, np.stack([unit, second, np.cross(unit, second)], axis=1)


def _stiffness(beams: Beams, length: Array, young: float) -> Array:
    """Return the element matrices in the beams' own axes, (m, 12, 12)."""
    shear = young / (2 * (1 + POISSON))
    k = np.zeros((len(length), 12, 12))
    stretch, twist = young * beams.area / length, shear * beams.twist / length
    for i, j, sign in ((0, 0, 1), (6, 6, 1), (0, 6, -1), (6, 0, -1)):
        k[:, i, j] = sign * stretch
        k[:, i + 3, j + 3] = sign * twist
    edgewise = beams.inertia if beams.edgewise is None else beams.edgewise
    for move, rotate, s, inertia in ((1, 5, 1.0, edgewise), (2, 4, -1.0, beams.inertia)):
        bend = young * inertia
        a, b = 12 * bend / length**3, s * 6 * bend / length**2
        c, d = 4 * bend / length, 2 * bend / length
        at = [move, rotate, move + 6, rotate + 6]
        block = [[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]]
        for p, row in enumerate(block):
            for q, value in enumerate(row):
                k[:, at[p], at[q]] = value
    return k


def loads_of(beams: Beams, density_g_cm3: float, down: Array) -> Array:
    """Return the consistent loads of the beams' weight at their ends, in common axes, (m, 12)."""
    length, axes = _lengths_and_axes(beams)
    weight = beams.area * density_g_cm3 * 1e-6 * GRAVITY_M_S2  # N/mm
    q = axes @ down * weight[:, None]  # (m, 3) along the beams' own axes
    f = np.zeros((len(length), 12))
    for axis in range(3):
        f[:, axis] = f[:, axis + 6] = q[:, axis] * length / 2
    f[:, 5] = q[:, 1] * length**2 / 12
    f[:, 11] = -f[:, 5]
    f[:, 4] = -q[:, 2] * length**2 / 12
    f[:, 10] = -f[:, 4]
    loads: Array = np.einsum("mij,mi->mj", _turns(axes), f)
    return loads
