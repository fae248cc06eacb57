"""Knots on the cubic lattice, from which curves of a chosen type grow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import permutations, product

import numpy as np

from knotfab.base.arrays import Indices
from knotfab.start.grow import Growth, grow_curves
from knotfab.start.lattice import Lattice
from knotfab_formats.knots import BRAIDS, Factor

_ROOM = 3  # margin around the braid while it is shortened, in edges
_SHRINK = Growth(edge=1.0, corner=0.05, least=1.0, heat=0.6, rounds=2, moves=150)


@cache
def lattice_knot(factors: tuple[Factor, ...]) -> Indices:
    """Return a short closed lattice polygon that is the connected sum of knots of the table, nodes (n, 3)."""
    word: list[int] = []
    strands = 1
    for factor in factors:
        letters = [-k if factor.mirrored else k for k in BRAIDS[factor.name]]
        word += [k + (strands - 1) * (1 if k > 0 else -1) for k in letters]
        strands += max(abs(k) for k in letters)
    nodes = _close_braid(word, strands)
    nodes += _ROOM - nodes.min(0)
    shape = tuple((nodes.max(0) + 1 + _ROOM).tolist())
    free = _free_lattice(shape)
    seed = np.ravel_multi_index(tuple(nodes.T), shape)
    (curve,) = grow_curves(free, np.zeros(1), 1.0, [seed], _SHRINK)
    short = np.stack(np.unravel_index(curve, shape), 1)
    return np.asarray(short - short.min(0))


def find_place(lattice: Lattice, edges: Indices, knot: Indices) -> Indices | None:
    """Place a lattice knot within these edges so that it spills least; return its nodes (n,).

    All 24 rotations are tried. None means that it fits nowhere.
    """
    opened = np.zeros(len(lattice.open), dtype=bool)
    opened[edges] = True
    best: tuple[float, Indices] | None = None
    strides = lattice.strides
    for turn in _turns():
        nodes = knot @ turn.T
        nodes = nodes - nodes.min(0)
        room = np.array(lattice.shape) - nodes.max(0)
        if (room < 1).any():
            continue
        corner = np.stack(np.meshgrid(*map(np.arange, room), indexing="ij"), -1).reshape(-1, 3)
        base, along = corner @ strides, nodes @ strides
        ahead = np.roll(along, -1)
        axis = (np.abs(ahead - along)[:, None] == strides).argmax(1)
        for edge in (3 * np.minimum(along, ahead) + axis).tolist():
            base = base[opened[3 * base + edge]]
        if len(base):
            spill = lattice.spill[base[:, None] + along].sum(1)
            if best is None or spill.min() < best[0]:
                best = float(spill.min()), base[spill.argmin()] + along
    return None if best is None else best[1]


def _turns() -> list[Indices]:
    """Return the 24 rotations (3, 3) of the lattice."""
    found = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.zeros((3, 3), dtype=np.int64)
        turn[np.arange(3), order] = signs
        if round(float(np.linalg.det(turn))) == 1:
            found.append(turn)
    return found


def _close_braid(word: Sequence[int], strands: int) -> Indices:
    """Return the nodes (n, 3) of a closed braid, x along and y across it; a letter takes 3 edges of x."""
    paths: list[list[tuple[int, int, int]]] = []
    end, row = 3 * len(word), 0
    while True:  # until the strand closes
        path = [(0, row, 0)]
        for n, letter in enumerate(word):
            x, low = 3 * n, abs(letter) - 1
            if row in (low, low + 1):
                other = 2 * low + 1 - row
                if (letter > 0) != (row == low):  # over the other strand
                    path += [(x, row, 1), (x, other, 1), (x + 2, other, 1), (x + 2, other, 0)]
                else:
                    path += [(x + 1, row, 0), (x + 1, other, 0)]
                row = other
            path.append((x + 3, row, 0))
        far, back = strands - row, 2 * strands - 1 - row
        path += [(end + far, row, 0), (end + far, back, 0), (-far, back, 0), (-far, row, 0)]
        paths.append(path)
        if row == 0:
            break
    corners = np.array([corner for path in paths for corner in path])
    nodes = [corners[:1]]
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = int(np.abs(there - here).sum())
        nodes.append(here + np.outer(np.arange(1, count + 1), np.sign(there - here)))
    return np.asarray(np.concatenate(nodes)[:-1])


def _free_lattice(shape: tuple[int, ...]) -> Lattice:
    """Return a padded box of nodes whose inner edges are all open and draw nothing."""
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    inner = np.asarray(((nodes > 0) & (nodes < np.array(shape) - 1)).all(1))
    opened = np.zeros((len(nodes), 3), dtype=bool)
    for axis in range(3):
        ahead = nodes.copy()
        ahead[:, axis] += 1
        opened[:, axis] = inner & (ahead[:, axis] < shape[axis] - 1)
    count = len(nodes)
    return Lattice(
        nodes.astype(np.float64),
        shape,
        np.eye(3),
        1.0,
        np.zeros(count),
        inner,
        opened.ravel(),
        np.zeros(3 * count + 1, dtype=np.int64),
        np.zeros(0, dtype=np.int32),
    )
