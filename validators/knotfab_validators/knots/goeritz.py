"""Signature and determinant of a knot's diagram, from its checkerboard colouring.

Gordon and Litherland, "On the signature of a link", Invent. Math. 47, 1978: the signature is that of
Goeritz' matrix less a correction from the crossings of one kind. The determinant is |det| of the
same matrix: a second opinion on Alexander's polynomial at -1.
"""

from __future__ import annotations

from fractions import Fraction

from knotfab_validators.knots.planar_diagram import PlanarDiagram, faces

__all__ = ["determinant_and_signature"]

Corner = tuple[int, int]  # (crossing, side): the face between that side and the next


def determinant_and_signature(diagram: PlanarDiagram) -> tuple[int, int]:
    """Return the determinant and signature of a knot's diagram: (3, -2) for the right-handed trefoil."""
    if not diagram.crossings:
        return 1, 0
    face = faces(diagram)
    # faces that meet across an arc have different colours: sides 0 and 2 of a crossing are alike
    shaded = _colour(diagram, face)
    number = {f: k for k, f in enumerate(sorted({f for f in face.values() if not shaded[f]}))}
    size = len(number)
    matrix = [[0] * size for _ in range(size)]
    correction = 0
    for i, sign in enumerate(diagram.signs):
        # the regions that are not shaded lie at corners `k` and `k + 2`
        k = 0 if not shaded[face[i, 0]] else 1
        one, other = number[face[i, k]], number[face[i, k + 2]]
        # turning the strand above counter-clockwise sweeps corners 1 and 3, the shaded ones if k = 0
        eta = 1 if k == 0 else -1
        if one != other:
            for p, q in ((one, other), (other, one)):
                matrix[p][q] -= eta
                matrix[p][p] += eta
        # the shaded surface's half twist does not follow the knot's orientation there
        if (sign > 0) == (eta > 0):
            correction += eta
    return _inertia([row[1:] for row in matrix[1:]], correction)


def _inertia(matrix: list[list[int]], correction: int) -> tuple[int, int]:
    """Return |det| and signature, less the correction, by exact symmetric elimination."""
    rows = [[Fraction(x) for x in row] for row in matrix]
    size, determinant, signature = len(rows), Fraction(1), 0
    for k in range(size):
        if not rows[k][k]:
            _make_pivot(rows, k)
        pivot = rows[k][k]
        if not pivot:
            return 0, 0
        determinant *= pivot
        signature += 1 if pivot > 0 else -1
        for i in range(k + 1, size):
            if rows[i][k]:
                factor = rows[i][k] / pivot
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    return abs(int(determinant)), signature - correction


def _make_pivot(rows: list[list[Fraction]], k: int) -> None:
    """Change the basis so that entry (k, k) of a symmetric matrix is not 0, if it can be."""
    for j in range(k + 1, len(rows)):
        if rows[j][j]:
            rows[k], rows[j] = rows[j], rows[k]
            for row in rows:
                row[k], row[j] = row[j], row[k]
            return
    for j in range(k + 1, len(rows)):
        if rows[k][j]:
            rows[k] = [x + y for x, y in zip(rows[k], rows[j], strict=True)]
            for row in rows:
                row[k] += row[j]
            return


def _colour(diagram: PlanarDiagram, face: dict[Corner, int]) -> dict[int, bool]:
    colour = {face[0, 0]: True}
    waiting = [face[0, 0]]
    neighbours: dict[int, set[int]] = {}
    for i in range(len(diagram.crossings)):
        for side in range(4):
            one, other = face[i, side], face[i, (side + 1) % 4]
            neighbours.setdefault(one, set()).add(other)
            neighbours.setdefault(other, set()).add(one)
    while waiting:
        here = waiting.pop()
        for there in neighbours[here]:
            if there not in colour:
                colour[there] = not colour[here]
                waiting.append(there)
    return colour
