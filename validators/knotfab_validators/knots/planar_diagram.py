"""Planar diagrams of knots and links: crossings and arcs, simplified by Reidemeister moves.

A crossing is (a, b, c, d): the arc that comes in below, then the others counter-clockwise as seen
from above (the planar diagram code of KnotTheory and KnotInfo). Each arc leads from one crossing to
the next and appears twice in the code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

Quad = tuple[int, int, int, int]


@dataclass(frozen=True)
class Passage:
    """One pass of a component through a crossing, above or below."""

    crossing: int
    above: bool


@dataclass(frozen=True)
class PlanarDiagram:
    """A diagram on the sphere.

    `crossings` have `signs` (+1: right-handed). Arcs are numbered 0, 1, ... along each component in turn;
    `component` gives each arc's. `loops` are the components without a crossing.
    """

    crossings: tuple[Quad, ...]
    signs: tuple[int, ...]
    component: tuple[int, ...]
    loops: tuple[int, ...] = ()

    @property
    def components(self) -> tuple[int, ...]:
        """The numbers of the components."""
        return tuple(sorted({*self.component, *self.loops}))

    @property
    def writhe(self) -> int:
        """The sum of the signs."""
        return sum(self.signs)

    def mirror(self) -> PlanarDiagram:
        """Return the mirror image: above and below change places."""
        turned = [
            (d, a, b, c) if sign > 0 else (b, c, d, a)
            for (a, b, c, d), sign in zip(self.crossings, self.signs, strict=True)
        ]
        return PlanarDiagram(
            tuple(turned), tuple(-s for s in self.signs), self.component, self.loops
        )

    def linking_numbers(self) -> dict[tuple[int, int], int]:
        """Return each pair's linking number, half the sum of signs (Gauss), if not 0."""
        twice: dict[tuple[int, int], int] = {}
        for (a, b, _, _), sign in zip(self.crossings, self.signs, strict=True):
            i, j = sorted((self.component[a], self.component[b]))
            if i != j:
                twice[i, j] = twice.get((i, j), 0) + sign
        return {pair: number // 2 for pair, number in sorted(twice.items()) if number}

    def pieces(self) -> tuple[tuple[int, ...], ...]:
        """Group the components that cross each other; different groups are split links."""
        group = {k: k for k in self.components}

        def root(k: int) -> int:
            while group[k] != k:
                k = group[k]
            return k

        for a, b, _, _ in self.crossings:
            group[root(self.component[a])] = root(self.component[b])
        found: dict[int, list[int]] = {}
        for k in self.components:
            found.setdefault(root(k), []).append(k)
        return tuple(tuple(piece) for piece in sorted(found.values()))

    def ends(self) -> tuple[tuple[int, int], ...]:
        """Return the crossings where each arc begins and ends."""
        begin, end = [0] * len(self.component), [0] * len(self.component)
        for i, ((a, b, c, d), sign) in enumerate(zip(self.crossings, self.signs, strict=True)):
            end[a] = begin[c] = i
            coming, going = (d, b) if sign > 0 else (b, d)
            end[coming] = begin[going] = i
        return tuple(zip(begin, end, strict=True))


def from_passages(
    components: Mapping[int, Sequence[Passage]], signs: Sequence[int]
) -> PlanarDiagram:
    """Build the diagram of components, each given by its passages in order (a signed Gauss code)."""
    under: dict[int, tuple[int, int]] = {}
    over: dict[int, tuple[int, int]] = {}
    of_arc: list[int] = []
    loops: list[int] = []
    for number, passages in components.items():
        first, count = len(of_arc), len(passages)
        if not count:
            loops.append(number)
        for k, passage in enumerate(passages):
            arcs = first + (k - 1) % count, first + k
            (over if passage.above else under)[passage.crossing] = arcs
        of_arc += [number] * count
    crossings: list[Quad] = []
    for i, sign in enumerate(signs):
        (a, c), (coming, going) = under[i], over[i]
        crossings.append((a, going, c, coming) if sign > 0 else (a, coming, c, going))
    return PlanarDiagram(tuple(crossings), tuple(signs), tuple(of_arc), tuple(loops))


def closed_braid(word: Iterable[int], strands: int | None = None) -> PlanarDiagram:
    """Return the closure of a braid: letter i > 0 is a right-handed crossing of strands i and i + 1.

    Components are numbered by their lowest strand.
    """
    letters = list(word)
    count = max([strands or 1, *(abs(k) + 1 for k in letters)])
    # strands run upwards; in a right-handed crossing the one from the lower left passes over
    rows: list[list[tuple[int, bool, int]]] = [[] for _ in range(count)]
    for i, letter in enumerate(letters):
        k = abs(letter) - 1
        rows[k].append((i, letter > 0, k + 1))
        rows[k + 1].append((i, letter < 0, k))
    at = [{i: (above, to) for i, above, to in row} for row in rows]
    seen = [False] * count
    components: dict[int, list[Passage]] = {}
    for start in range(count):
        if seen[start]:
            continue
        passages: list[Passage] = []
        place = start
        while True:
            seen[place] = True
            for i in range(len(letters)):
                if i in at[place]:
                    above, place = at[place][i]
                    passages.append(Passage(i, above))
            if place == start:
                break
        components[len(components)] = passages
    return from_passages(components, [1 if letter > 0 else -1 for letter in letters])


def simplify(diagram: PlanarDiagram) -> PlanarDiagram:
    """Simplify a diagram without search.

    Removes loops and bigons with one strand above the other (Reidemeister's first and second moves), and
    crossings at which the diagram falls in two.
    """
    while True:
        work = _Untangling(diagram)
        while work.untwist() or work.pull_apart():
            pass
        diagram = work.diagram()
        face = faces(diagram)
        for i in range(len(diagram.crossings)):
            if face[i, 0] == face[i, 2] or face[i, 1] == face[i, 3]:
                diagram = work.without_isthmus(i)
                break
        else:
            return diagram


def faces(diagram: PlanarDiagram) -> dict[tuple[int, int], int]:
    """Number the face at each corner (crossing, k), the one between sides k and k + 1."""
    ends: dict[int, list[tuple[int, int]]] = {}
    for i, quad in enumerate(diagram.crossings):
        for side, arc in enumerate(quad):
            ends.setdefault(arc, []).append((i, side))
    face: dict[tuple[int, int], int] = {}
    count = 0
    for i in range(len(diagram.crossings)):
        for k in range(4):
            corner = i, k
            if corner in face:
                continue
            while corner not in face:
                face[corner] = count
                # follow the corner's last side: at its end the face begins at that side
                here = corner[0], (corner[1] + 1) % 4
                one, other = ends[diagram.crossings[here[0]][here[1]]]
                corner = other if here == one else one
            count += 1
    return face


class _Untangling:
    """A diagram being simplified: the crossings left, and the new number of each arc."""

    def __init__(self, diagram: PlanarDiagram) -> None:
        self.quads = {i: list(quad) for i, quad in enumerate(diagram.crossings)}
        self.signs = dict(enumerate(diagram.signs))
        self.component = dict(enumerate(diagram.component))
        self.loops = list(diagram.loops)
        self.places: dict[int, list[int]] = {}
        for i, quad in self.quads.items():
            for arc in quad:
                self.places.setdefault(arc, []).append(i)

    def untwist(self) -> bool:
        """Apply Reidemeister's first move wherever possible."""
        found = False
        waiting = list(self.quads)
        while waiting:
            i = waiting.pop()
            quad = self.quads.get(i)
            if quad is None:
                continue
            for k in range(4):
                if quad[k] == quad[(k + 1) % 4]:
                    one, other = quad[(k + 2) % 4], quad[(k + 3) % 4]
                    self._drop(i)
                    self._join(one, other)
                    waiting += [j for arc in (one, other) for j in self.places.get(arc, [])]
                    found = True
                    break
        return found

    def pull_apart(self) -> bool:
        """Apply Reidemeister's second move wherever one strand lies above the other."""
        found = False
        for i in list(self.quads):
            while i in self.quads and self._pull_apart_at(i):
                found = True
        return found

    def _pull_apart_at(self, i: int) -> bool:
        quad = self.quads[i]
        for k in range(4):
            # the face on the left of arc p, which leaves crossing i, has q as its last side
            p, q = quad[k], quad[(k + 1) % 4]
            j = self._other_end(p, i)
            if j is None or j != self._other_end(q, i):
                continue
            there = self.quads[j]
            m = there.index(q)
            if there[(m + 1) % 4] != p or (m + 1) % 2 != k % 2:
                continue
            beyond_p = quad[(k + 2) % 4], there[(m + 3) % 4]
            beyond_q = quad[(k + 3) % 4], there[(m + 2) % 4]
            self._drop(i)
            self._drop(j)
            kept = self._join(*beyond_p)
            gone = beyond_p[0] if kept == beyond_p[1] else beyond_p[1]
            one, other = (kept if arc == gone else arc for arc in beyond_q)
            self._join(one, other)
            return True
        return False

    def _other_end(self, arc: int, i: int) -> int | None:
        """Return the crossing at the other end of an arc from i; None if that is i again."""
        rest = [j for j in self.places[arc] if j != i]
        return rest[0] if len(rest) == 1 else None

    def _drop(self, i: int) -> None:
        for arc in self.quads.pop(i):
            self.places[arc].remove(i)
        del self.signs[i]

    def _join(self, one: int, other: int) -> int:
        """Merge two arcs and return the result; an arc that meets its own end is a loop, and vanishes."""
        if one == other:
            self.loops.append(self.component[one])
            return one
        for i in self.places.pop(other):
            self.quads[i] = [one if arc == other else arc for arc in self.quads[i]]
            self.places[one].append(i)
        return one

    def without_isthmus(self, number: int) -> PlanarDiagram:
        """Remove the crossing of that number in `diagram()`, which is an isthmus.

        A circle through an isthmus meets the diagram nowhere else. Turning over what is inside removes the
        crossing and leaves the sum of both sides; their signed Gauss codes stay as they are.
        """
        i = list(self.quads)[number]
        a, b, c, d = self.quads[i]
        self._drop(i)
        kept = self._join(a, c)
        self._join(*(kept if arc in (a, c) else arc for arc in (b, d)))
        return self.diagram()

    def diagram(self) -> PlanarDiagram:
        """Return the diagram that is left, with arcs renumbered along each component."""
        going: dict[int, tuple[int, bool, int]] = {}  # arc -> crossing at its end, above, next arc
        for i, (a, b, c, d) in self.quads.items():
            going[a] = (i, False, c)
            coming, leaving = (d, b) if self.signs[i] > 0 else (b, d)
            going[coming] = (i, True, leaving)
        number = {i: n for n, i in enumerate(self.quads)}
        passages: dict[int, list[Passage]] = {}
        for arc in sorted(going):
            if self.component[arc] in passages:
                continue
            run: list[Passage] = []
            here = arc
            while not run or here != arc:
                i, above, here = going[here]
                run.append(Passage(number[i], above))
            passages[self.component[arc]] = run
        loops = {k: () for k in self.loops}
        ordered: dict[int, Sequence[Passage]] = dict(sorted({**loops, **passages}.items()))
        return from_passages(ordered, list(self.signs.values()))


# Laurent polynomials in one variable with integer coefficients, exact at any size.


@dataclass(frozen=True)
class Laurent:
    """The sum of coefficients[k] * t ** (lowest + k). Use `laurent` to strip zeros at the ends."""

    lowest: int
    coefficients: tuple[int, ...]

    @property
    def highest(self) -> int:
        """The largest exponent (-1 below the lowest for 0)."""
        return self.lowest + len(self.coefficients) - 1

    def __bool__(self) -> bool:
        return bool(self.coefficients)

    def __mul__(self, other: Laurent) -> Laurent:
        if not self or not other:
            return Laurent(0, ())
        product = [0] * (len(self.coefficients) + len(other.coefficients) - 1)
        for i, a in enumerate(self.coefficients):
            for j, b in enumerate(other.coefficients):
                product[i + j] += a * b
        return laurent(self.lowest + other.lowest, product)

    def reverse(self) -> Laurent:
        """Substitute 1/t for t."""
        return Laurent(-self.highest if self else 0, self.coefficients[::-1])

    def shift(self, by: int) -> Laurent:
        """Multiply by t ** by."""
        return Laurent(self.lowest + by if self else 0, self.coefficients)

    def negate(self) -> Laurent:
        """Multiply by -1."""
        return Laurent(self.lowest, tuple(-c for c in self.coefficients))

    def at_minus_one(self) -> int:
        """Evaluate at t = -1."""
        value = sum(c if k % 2 == 0 else -c for k, c in enumerate(self.coefficients))
        return -value if self.lowest % 2 else value

    def at_one(self) -> int:
        """Evaluate at t = 1."""
        return sum(self.coefficients)

    def text(self, variable: str = "t", half: bool = False) -> str:
        """Write the polynomial, highest power first; with `half` the exponents count half powers."""
        terms = []
        for k in range(len(self.coefficients) - 1, -1, -1):
            c, power = self.coefficients[k], self.lowest + k
            if not c:
                continue
            size = "" if abs(c) == 1 and power else str(abs(c))
            if half:
                exponent = str(power // 2) if power % 2 == 0 else f"({power}/2)"
            else:
                exponent = str(power)
            factor = "" if not power else variable if exponent == "1" else f"{variable}^{exponent}"
            terms.append(("-" if c < 0 else "+") + size + factor)
        joined = " ".join(f"{term[0]} {term[1:]}" for term in terms)
        return (
            joined.removeprefix("+ ").replace("- ", "-", 1)
            if joined[:1] == "-"
            else joined[2:] or "0"
        )


def laurent(lowest: int, coefficients: Iterable[int]) -> Laurent:
    """Build the polynomial, with zeros at both ends stripped."""
    kept = list(coefficients)
    while kept and not kept[-1]:
        kept.pop()
    start = 0
    while start < len(kept) and not kept[start]:
        start += 1
    return Laurent(lowest + start, tuple(kept[start:])) if kept else Laurent(0, ())
