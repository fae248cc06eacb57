"""Grow curves on a lattice by moves over empty unit squares, each of which is an isotopy.

A closed lattice curve begins as a unit square. A move replaces one side of an empty unit square by the other
three, two by the other two, or three by the fourth (Berg and Foerster 1981; Aragao de Carvalho and Caracciolo
1983). Strands run along edges, so none meets the square's interior, and the nodes entered lie on no curve. So
a curve stays an unknot, and disjoint squares grow into an unlink, whatever the hull's topology.

First the curves reach for undrawn places by the shortest paths. Then they are annealed (Kirkpatrick, Gelatt
and Vecchi 1983), which removes stretches that draw less than their length and corners cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.start.lattice import Lattice


@dataclass(frozen=True)
class Growth:
    """Settings of growth. Prices are in units of the worth of an edge that draws its length in one view.

    `edge` and `corner` are prices; `least` is the least worth of an edge to reach for; `heat` is the
    initial temperature. Each of `rounds` reaches out and then tries `moves` moves per node.
    """

    edge: float = 0.05
    corner: float = 0.1
    least: float = 0.3
    heat: float = 0.3
    rounds: int = 3
    moves: int = 40
    seed: int = 0


def grow_curves(
    lattice: Lattice, worth: Array, unit: float, seeds: Sequence[Indices], how: Growth
) -> list[Indices]:
    """Grow a closed lattice curve from each seed, keeping its knot type; return their nodes, (n,) each.

    Args:
        worth: worth of drawing each cell. unit: the worth that is 1 for `Growth`.
        seeds: disjoint unit squares (4,) or knots (n,), as nodes.

    Raises:
        ValueError: two seeds share a node.
    """
    if len(np.unique(np.concatenate(seeds))) < sum(map(len, seeds)):
        raise ValueError("two curves begin at one node")
    count = len(lattice.nodes)
    curve, place = np.zeros(count, dtype=np.int64), np.full(count, -1)
    after, before, owner = (np.full(count, -1) for _ in range(3))
    for k, seed in enumerate(seeds):
        after[seed], before[seed], owner[seed] = np.roll(seed, -1), np.roll(seed, 1), k
    size = sum(map(len, seeds))
    curve[:size] = np.concatenate(seeds)
    place[curve[:size]] = np.arange(size)
    loops = (curve, place, after, before, np.zeros(len(worth), dtype=np.int64), owner)
    drawing = (lattice.strides, lattice.open, lattice.starts, lattice.cells, worth)
    prices = np.array([how.edge, how.corner, how.least, how.heat]) * unit
    used = len(np.unique(np.concatenate(lattice.ends(np.flatnonzero(lattice.open)))))
    _grow(loops, size, drawing, prices, how.rounds, how.moves * used, how.seed)
    found = []
    for k in range(len(seeds)):
        loop = [int(np.flatnonzero((owner == k) & (after >= 0))[0])]
        while after[loop[-1]] != loop[0]:
            loop.append(int(after[loop[-1]]))
        found.append(np.array(loop))
    return found


@compiled
def _edge(a: int, b: int, strides: Indices) -> int:
    """Return the number of the edge between neighbouring nodes."""
    apart = abs(b - a)
    axis = 0 if apart == strides[0] else 1 if apart == strides[1] else 2
    return 3 * min(a, b) + axis


@compiled
def _count(edge: Any, sign: int, drawing: Any, drawn: Indices) -> float:
    """Draw an edge (sign 1), erase it (-1) or only look (0); return the gain in worth."""
    _, _, starts, cells, worth = drawing
    gain = 0.0
    for k in range(starts[edge], starts[edge + 1]):
        cell = cells[k]
        if sign < 0:
            drawn[cell] -= 1
        if drawn[cell] == 0:
            gain += worth[cell]
        if sign > 0:
            drawn[cell] += 1
    return gain if sign >= 0 else -gain


@compiled
def _plan(
    a: int, u: int, loops: Any, drawing: Any, old: Indices, new: Indices, path: Indices
) -> int:
    """Plan the move over the square on the `u` side of the edge after node a; fill `old`, `new` and `path`.

    `old` and `new` are edges, `path` the nodes that the curve would run through. Return the number of
    these nodes; 0 if the square is not empty.
    """
    strides, opened, _, _, _ = drawing
    _, _, after, before, _, _ = loops
    b = after[a]
    c, d = a + u, b + u
    back, on = before[a] == c, after[b] == d
    if not ((after[c] < 0 or back) and (after[d] < 0 or on)) or (back and on and after[d] == c):
        return 0
    n = 0
    if not back:
        path[n] = a
        n += 1
    path[n] = c
    path[n + 1] = d
    n += 2
    if not on:
        path[n] = b
        n += 1
    old[:], new[:] = -1, -1
    old[0] = _edge(a, b, strides)
    if back:
        old[1] = _edge(c, a, strides)
    if on:
        old[2] = _edge(b, d, strides)
    for k in range(n - 1):
        new[k] = _edge(path[k], path[k + 1], strides)
        if not opened[new[k]]:
            return 0
    return n


@compiled
def _corners(path: Indices, n: int, loops: Any) -> int:
    """Count the corners that a curve gains by running along the path."""
    _, _, after, before, _, _ = loops
    first, last = path[0], path[n - 1]
    come, count = first - before[first], 0
    for k in range(n):
        go = path[k + 1] - path[k] if k < n - 1 else after[last] - last
        count += int(go != come)
        come = go
    node = first
    while True:
        count -= int(after[node] - node != node - before[node])
        if node == last:
            return count
        node = after[node]


@compiled
def _run(path: Indices, n: int, a: int, loops: Any, size: int) -> int:
    """Reroute the curve along the path, in place of the edge after a; return the new size."""
    curve, place, after, before, _, owner = loops
    for node in (a, after[a]):
        if path[0] != node and path[n - 1] != node:
            after[node] = before[node] = -1
            size -= 1
            curve[place[node]] = curve[size]
            place[curve[size]] = place[node]
            place[node] = -1
    for k in range(n):
        if place[path[k]] < 0:
            curve[size] = path[k]
            place[path[k]] = size
            owner[path[k]] = owner[a]
            size += 1
        if k > 0:
            after[path[k - 1]] = path[k]
            before[path[k]] = path[k - 1]
    return size


@compiled
def _extrude(f: int, came: Indices, way: Indices, loops: Any, size: int, drawing: Any) -> int:
    """Grow a finger towards edge f along `came` and `way` until it is blocked; return the new size."""
    strides, after, drawn = drawing[0], loops[2], loops[4]
    old, new, path = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(4, np.int64)
    trail = [f]
    while came[came[trail[-1]]] >= 0:
        trail.append(came[trail[-1]])
    for k in range(len(trail) - 1, -1, -1):
        e, u = came[trail[k]], way[trail[k]]
        a, b = e // 3, e // 3 + strides[e % 3]
        if after[a] != b:
            a, b = b, a
        if after[a] != b or after[a + u] >= 0 or after[b + u] >= 0:
            break
        n = _plan(a, u, loops, drawing, old, new, path)
        if n == 0:
            break
        _count(old[0], -1, drawing, drawn)
        for edge in new:
            _count(edge, 1, drawing, drawn)
        size = _run(path, n, a, loops, size)
    return size


@compiled
def _reach(least: float, loops: Any, size: int, drawing: Any) -> int:
    """Grow fingers to every edge whose worth is `least` or more, nearest first; return the new size."""
    strides, opened, _, _, _ = drawing
    curve, _, after, _, drawn, _ = loops
    # the edge from which each edge is reached (-1: it is on a curve, -2: not reached yet), and the direction
    came, way = np.full(len(opened), -2), np.zeros(len(opened), np.int64)
    queue = np.empty(2 * len(opened), np.int64)
    head, tail = 0, 0
    for k in range(size):
        queue[tail] = _edge(curve[k], after[curve[k]], strides)
        came[queue[tail]] = -1
        tail += 1
    while head < tail:
        e = queue[head]
        head += 1
        p, q = e // 3, e // 3 + strides[e % 3]
        for side in range(6):
            u = strides[side // 2] * (1 if side % 2 else -1)
            if side // 2 == e % 3 or after[p + u] >= 0 or after[q + u] >= 0:
                continue
            sides = (
                _edge(p + u, q + u, strides),
                _edge(p, p + u, strides),
                _edge(q, q + u, strides),
            )
            if not (opened[sides[0]] and opened[sides[1]] and opened[sides[2]]):
                continue
            for f in sides:
                if came[f] != -2:
                    continue
                came[f], way[f] = e, u
                queue[tail] = f
                tail += 1
                if _count(f, 0, drawing, drawn) >= least:
                    grown = _extrude(f, came, way, loops, size, drawing)
                    for k in range(size, grown):
                        for g in (
                            _edge(curve[k], after[curve[k]], strides),
                            _edge(curve[k], loops[3][curve[k]], strides),
                        ):
                            if came[g] != -1:
                                came[g] = -1
                                queue[tail] = g
                                tail += 1
                    size = grown
                    break
    return size


@compiled
def _random(state: Any) -> Any:
    """Advance a linear congruential generator (Knuth 1997) to its next state."""
    return state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)


@compiled
def _grow(
    loops: Any, size: int, drawing: Any, prices: Array, rounds: int, moves: int, seed: int
) -> int:
    """Grow and anneal curves in place; return the number of nodes on them.

    Args:
        loops: the nodes on curves, `size` of them; each node's index among them; the nodes after and before
            each (-1 if free); the count of draws of each cell, 0 at first; the curve that each node is on.
        drawing: strides, open edges, starts and cells of what edges draw, and the worth of each cell.
        prices: (4,) prices of an edge and a corner, worth from which an edge is reached for, temperature.
    """
    price, bend, least, heat = prices
    strides = drawing[0]
    curve, _, after, _, drawn, _ = loops
    for k in range(size):
        _count(_edge(curve[k], after[curve[k]], strides), 1, drawing, drawn)
    old, new, path = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(4, np.int64)
    state = np.uint64(2 * seed + 1)
    for turn in range(rounds):
        reached = -1
        while reached != size:
            reached = size
            size = _reach(least, loops, size, drawing)
        for step in range(moves):
            warm = heat * (1.0 - (turn + step / moves) / rounds) ** 2
            state = _random(state)
            pick = int(state >> np.uint64(33))
            a, side = curve[pick % size], pick // size % 6
            u = strides[side // 2] * (1 if side % 2 else -1)
            if abs(after[a] - a) == abs(u):
                continue
            n = _plan(a, u, loops, drawing, old, new, path)
            if n == 0:
                continue
            gain = -bend * _corners(path, n, loops)
            for edge in old:
                if edge >= 0:
                    gain += price + _count(edge, -1, drawing, drawn)
            for edge in new:
                if edge >= 0:
                    gain += _count(edge, 1, drawing, drawn) - price
            state = _random(state)
            if gain < 0.0 and float(state >> np.uint64(11)) / 2.0**53 >= np.exp(gain / warm):
                for edge in new:
                    if edge >= 0:
                        _count(edge, -1, drawing, drawn)
                for edge in old:
                    if edge >= 0:
                        _count(edge, 1, drawing, drawn)
            else:
                size = _run(path, n, a, loops, size)
    return size
