"""Invariants of diagrams: exact values, agreement of independent ways, and what never changes them."""

import itertools
from itertools import combinations

import numpy as np
import pytest
from knot_curves import (
    TREFOIL,
    WHITEHEAD,
    WORDS,
    Array,
    braid,
    diagram,
    figure_eight,
    mirror,
    move_randomly,
    powers,
    random_markov,
    ring,
    rotate,
    torus_knot,
)
from validator_parts import circle, tangle, trefoil

from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    colouring_remainder,
    jones_polynomial,
)
from knotfab_validators.knots.identity import identify
from knotfab_validators.knots.invariants import (
    UNKNOT,
    Disagreement,
    Floer,
    Invariants,
    determinant_and_signature,
    floer_homology,
    invariants,
)
from knotfab_validators.knots.names import (
    Factor,
    braid_of,
    braid_word,
    candidates,
    known_knot,
    prime_names,
)
from knotfab_validators.knots.planar_diagram import (
    Laurent,
    Passage,
    PlanarDiagram,
    closed_braid,
    faces,
    from_passages,
    laurent,
    simplify,
)
from knotfab_validators.knots.projection import PRIMES, cusp_counts, diagram_of, seen_from
from knotfab_validators.knots.reduction import (
    Budget,
    Reduced,
    TooTangled,
    general_position,
    may_pierce,
    nearest_approach,
    orientation,
    reduce_polygons,
    touching_place,
)
from knotfab_validators.knots.rerouting import reroute, summands


def test_values_of_the_trefoils_and_the_figure_eight() -> None:
    right = invariants(closed_braid(TREFOIL))
    assert powers(right.alexander) == {-1: 1, 0: -1, 1: 1}
    assert powers(right.jones) == {2: 1, 6: 1, 8: -1}  # t + t^3 - t^4, exponents doubled
    assert right.signature == -2 and right.hand == 1 and right.determinant == 3
    assert right.floer == Floer((((-1, -2), 1), ((0, -1), 1), ((1, 0), 1)))
    assert right.floer.genus == 1 and right.floer.fibred and right.floer.total == 3
    left = invariants(closed_braid([-1, -1, -1]))
    assert left == right.mirror() and left.hand == -1 and not left.fits(right)
    eight = invariants(closed_braid([1, -2, 1, -2]))
    assert powers(eight.alexander) == {-1: -1, 0: 3, 1: -1}
    assert powers(eight.jones) == {-4: 1, -2: -1, 0: 1, 2: -1, 4: 1}
    assert eight.hand == 0 and eight.mirror() == eight and eight.signature == 0


@pytest.mark.parametrize(("p", "q"), [(2, 7), (2, 13), (3, 4), (3, 5), (3, 10), (4, 5), (5, 6)])
def test_torus_knots_have_their_closed_forms(p: int, q: int) -> None:
    found = invariants(closed_braid(list(range(1, p)) * q))
    top = Laurent(0, (-1, *[0] * (p * q - 1), 1)) * Laurent(0, (-1, 1))
    bottom = Laurent(0, (-1, *[0] * (p - 1), 1)) * Laurent(0, (-1, *[0] * (q - 1), 1))
    assert found.alexander.shift((p - 1) * (q - 1) // 2) * bottom == top
    # t^((p-1)(q-1)/2) (1 - t^(p+1) - t^(q+1) + t^(p+q)) / (1 - t^2)
    assert found.jones is not None
    left = found.jones.shift(-(p - 1) * (q - 1)) * Laurent(0, (1, 0, 0, 0, -1))
    terms = {0: 1, 2 * (p + 1): -1, 2 * (q + 1): -1}
    terms[2 * (p + q)] = terms.get(2 * (p + q), 0) + 1
    assert powers(left) == terms
    assert found.floer is not None and found.floer.genus == (p - 1) * (q - 1) // 2


def test_links() -> None:
    hopf = closed_braid([1, 1])
    assert hopf.linking_numbers() == {(0, 1): 1} and powers(jones_polynomial(hopf)) == {
        1: -1,
        5: -1,
    }
    assert closed_braid([-1, -1]).linking_numbers() == {(0, 1): -1}
    whitehead = closed_braid(WHITEHEAD)
    assert whitehead.linking_numbers() == {}
    assert powers(alexander_polynomial(whitehead)) == {0: 1, 1: -3, 2: 3, 3: -1}
    assert colouring_number(whitehead) == 8
    rings = closed_braid([1, -2] * 3)
    assert rings.linking_numbers() == {} and colouring_number(rings) == 16
    assert powers(alexander_polynomial(rings)) == {0: 1, 1: -4, 2: 6, 3: -4, 4: 1}
    apart = closed_braid([1, 1, 1, 3, 3, 3])
    assert apart.pieces() == ((0,), (1,)) and not alexander_polynomial(apart)
    assert colouring_number(apart) == 0
    two = closed_braid([], strands=2)
    assert two.loops == (0, 1) and powers(jones_polynomial(two)) == {-1: -1, 1: -1}
    assert not alexander_polynomial(two) and colouring_number(two) == 0


@pytest.mark.parametrize("word", [TREFOIL, (1, -2, 1, -2), (1,), WORDS[-1]])
@pytest.mark.parametrize("seed", range(3))
def test_markov_moves_change_nothing(word: tuple[int, ...], seed: int) -> None:
    moved = random_markov(word, 60, seed)
    assert invariants(closed_braid(moved)) == invariants(closed_braid(word))
    (polygon,) = braid(moved)
    found = invariants(diagram(rotate(polygon, seed)))
    assert found == invariants(closed_braid(word))


def test_polygons_have_the_invariants_of_their_braids() -> None:
    for word in (TREFOIL, (-1, -1, -1), (1, -2, 1, -2), (1, 1, 1, 2, -1, 2), WORDS[-1]):
        (polygon,) = braid(word)
        for seed in range(3):
            assert invariants(diagram(rotate(polygon, seed))) == invariants(closed_braid(word))
        assert invariants(diagram(mirror(polygon))) == invariants(closed_braid(word)).mirror()
    for word in ((1, 1), (-1, -1), WHITEHEAD, (1, -2, 1, -2, 1, -2)):
        found = diagram(*braid(word))
        assert found.linking_numbers() == closed_braid(word).linking_numbers()
        assert colouring_number(found) == colouring_number(closed_braid(word))


def test_known_curves() -> None:
    assert invariants(diagram(torus_knot(2, 3))).hand == -1
    assert invariants(diagram(figure_eight())).determinant == 5
    assert invariants(diagram(torus_knot(3, 4))).determinant == 3
    assert invariants(diagram(ring())) == UNKNOT


def test_a_disagreement_is_never_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Floer((((-1, -1), 1), ((0, 0), 3), ((1, 1), 1)))
    module = "knotfab_validators.knots.invariants"
    monkeypatch.setattr(f"{module}.floer_homology", lambda *_: wrong)
    with pytest.raises(Disagreement, match="Floer"):
        invariants(closed_braid(TREFOIL))
    lopsided = Floer((((-1, -2), 1), ((0, -1), 1), ((1, 2), 1)))
    monkeypatch.setattr(f"{module}.floer_homology", lambda *_: lopsided)
    with pytest.raises(Disagreement, match="symmetric"):
        invariants(closed_braid(TREFOIL))
    monkeypatch.setattr(f"{module}.determinant_and_signature", lambda *_: (5, -2))
    with pytest.raises(Disagreement, match="Goeritz"):
        invariants(closed_braid(TREFOIL))


def test_sums_multiply() -> None:
    right, left = invariants(closed_braid(TREFOIL)), invariants(closed_braid([-1] * 3))
    granny, square = invariants(closed_braid([1] * 3 + [2] * 3)), right * left
    assert right * right == granny and not granny.fits(square)
    assert invariants(closed_braid([1] * 3 + [-2] * 3)) == square
    unknown = Invariants(granny.alexander, granny.signature, None, None)
    assert unknown.fits(granny) and granny.fits(unknown) and (unknown * right).jones is None


# Knot Floer homology is left out where its program cannot answer.


def test_floer_homology_is_left_out_where_it_would_take_too_long() -> None:
    one, much = Laurent(0, (1,)), Laurent(0, (2000,))
    assert floer_homology(closed_braid([1] * 25), much) is not None
    assert floer_homology(closed_braid([1] * 25), Laurent(0, (-2001,))) is None
    assert floer_homology(closed_braid([1] * 27), much) is None
    assert floer_homology(closed_braid([1] * 31), one) is not None
    assert floer_homology(closed_braid([1] * 33), one) is None
    assert floer_homology(closed_braid([1, 1]), one) is None  # a link
    assert floer_homology(closed_braid([1]), one) is None  # which the program refuses


# The Alexander polynomial by primes, against the same determinant over the rationals.


def test_the_polynomial_is_that_of_the_rational_matrix() -> None:
    """Modular arithmetic finds what plain expansion does, with large coefficients."""
    for word in (WORDS[0], WORDS[3], (1, 1, 1, -2, 1, -2, -2, 3, -2, 3)):
        plain = closed_braid(word)
        if len(plain.components) == 1:
            found = alexander_polynomial(plain)
            # Burau: det(1 - B(t)) (1 - t) / (1 - t^n) is Δ(t), checked at t = 2 up to sign and 2^k
            value = abs(burau(word, 2.0))
            exact = abs(
                sum(c * 2.0 ** (found.lowest + k) for k, c in enumerate(found.coefficients))
            )
            ratio = np.log2(value / exact)
            assert ratio == pytest.approx(round(ratio), abs=1e-9)


def burau(word: tuple[int, ...], t: float) -> float:
    n = max(map(abs, word)) + 1
    whole = np.eye(n)
    for letter in word:
        k = abs(letter) - 1
        step = np.eye(n)
        step[k : k + 2, k : k + 2] = [[1 - t, t], [1, 0]]
        whole = whole @ (step if letter > 0 else np.linalg.inv(step))
    minor = (np.eye(n) - whole)[1:, 1:]
    return float(np.linalg.det(minor) * (1 - t) / (1 - t**n))


# Representations in PSL(2, p): known values, and what they tell apart.


def diagram_of_invariants(name: str) -> PlanarDiagram:
    return reroute(closed_braid(braid_word(name)), enough=10)


def test_the_trefoils_longitude_is_its_meridian_to_minus_six() -> None:
    """This holds beside the one representation that commutes, where it is central but for its meridians."""
    for prime in PRIMES:
        found = cusp_counts(diagram_of_invariants("3_1"), prime)
        assert found is not None and found[0] == 1
        assert {k for k, n in enumerate(found) if n and k} == {6}


@pytest.mark.parametrize("name", ["4_1", "8_16", "9_35", "10_103"])
def test_counts_depend_on_the_knot_and_turn_in_a_mirror(name: str) -> None:
    tangled = reroute(closed_braid(random_markov(list(braid_word(name)), 30, seed=2)), enough=11)
    for prime in PRIMES:
        one = cusp_counts(diagram_of_invariants(name), prime)
        assert one is not None and one == cusp_counts(tangled, prime)
        assert cusp_counts(diagram_of_invariants(name).mirror(), prime) == (one[0], *one[:0:-1])


@pytest.mark.parametrize(
    "name", ["8_8", "8_16", "10_25", "10_40", "4_1#5_2", "10_48", "10_71", "10_91", "10_104"]
)
def test_what_all_other_invariants_take_for_one_is_told_apart(name: str) -> None:
    numbers = [tuple(map(int, factor.split("_"))) for factor in name.split("#")]
    factors = tuple(Factor(n, k, 0 if (n, k) == (4, 1) else 1) for n, k in numbers)
    knots = [k for k in candidates(known_knot(factors).invariants) if k.crossings <= 10]
    assert len(knots) == 2
    counts = [
        [cusp_counts(reroute(closed_braid(braid_of(knot)), enough=10), p) for p in PRIMES]
        for knot in knots
    ]
    assert all(one != other for one, other in combinations(counts, 2))


# Diagrams: mirror images and simplifying change what they must, and nothing else.


@pytest.mark.parametrize("word", WORDS)
def test_a_mirror_reverses_and_simplifying_changes_nothing(word: tuple[int, ...]) -> None:
    plain = closed_braid(word)
    small = simplify(plain)
    assert len(small.crossings) <= len(plain.crossings)
    assert small.components == plain.components
    assert small.linking_numbers() == plain.linking_numbers()
    value = jones_polynomial(plain)
    assert value is not None and jones_polynomial(small) == value
    assert jones_polynomial(plain.mirror()) == value.reverse()
    assert plain.mirror() == closed_braid([-k for k in word])
    assert colouring_number(plain) == colouring_number(small)
    assert alexander_polynomial(plain) == alexander_polynomial(small)
    if len(plain.components) == 1:
        found = invariants(plain)  # raises if Floer homology or Goeritz' matrix disagree
        assert invariants(plain.mirror()) == found.mirror()
        assert determinant_and_signature(plain) == (found.determinant, found.signature)
        assert colouring_number(plain) == colouring_remainder(found.determinant)


def test_a_crossing_where_the_diagram_falls_in_two_goes() -> None:
    """The program for Floer homology gives a wrong answer there."""
    # an isthmus joins one trefoil to the other
    over = [Passage(k, k % 2 == 0) for k in range(3)]
    under = [Passage(k, k % 2 == 1) for k in range(3)]
    one = [*over, *under]
    other = [Passage(p.crossing + 4, p.above) for p in one]
    joined = from_passages({0: [*one, Passage(3, True), *other, Passage(3, False)]}, [1] * 7)
    face = faces(joined)
    assert face[3, 0] == face[3, 2] or face[3, 1] == face[3, 3]
    small = simplify(joined)
    assert len(small.crossings) == 6
    right = invariants(closed_braid(TREFOIL))
    assert jones_polynomial(small) == jones_polynomial(joined)
    assert invariants(joined) == right * right


# Laurent polynomials: their text, and what is done with them.


def test_polynomials() -> None:
    one = laurent(-2, [0, 0, 1, -3, 1, 0])
    assert one == Laurent(0, (1, -3, 1)) and not laurent(3, [0, 0])
    assert one.text() == "t^2 - 3t + 1" and Laurent(-1, (-1, 3, -1)).text() == "-t + 3 - t^-1"
    assert Laurent(1, (-1, 0, 0, 0, -1)).text(half=True) == "-t^(5/2) - t^(1/2)"
    assert Laurent(0, ()).text() == "0" and Laurent(0, (1,)).text() == "1"
    assert Laurent(-1, (-1, 3, -1)).at_minus_one() == 5 and one.at_one() == -1
    for i, j in itertools.product(range(-2, 3), repeat=2):
        product = one.shift(i) * Laurent(0, (2, 1)).shift(j)
        assert powers(product) == {i + j: 2, i + j + 1: -5, i + j + 2: -1, i + j + 3: 1}


@pytest.mark.slow
def test_floer_homology_proves_an_unknot_that_was_not_reduced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    placed = general_position([move_randomly(ring(24, 2.0), 16, 1)])
    assert placed is not None
    monkeypatch.setattr(
        "knotfab_validators.knots.identity.reduce_polygons",
        lambda polygons, **_: reduce_polygons([]) if not polygons else Unreduced(polygons),
    )
    monkeypatch.setattr("knotfab_validators.knots.projection.simplify", lambda diagram: diagram)
    monkeypatch.setattr("knotfab_validators.knots.identity.reroute", lambda diagram, **_: diagram)
    found = identify(placed[0])
    assert [knot.name for knot in found.knots] == ["unknot"] and found.proved
    assert found.reason == "knot Floer homology of rank 1"


class Unreduced:
    def __init__(self, polygons: list[Array]) -> None:
        self.polygons, self.vertices = tuple(polygons), sum(map(len, polygons))


# Reduction: every removal is an isotopy, so unknots vanish and knots stay; diagrams and linking
# numbers.


def reduce_placed(*polygons: Array, shakes: int = 0) -> Reduced:
    placed = general_position(polygons)
    assert placed is not None
    return reduce_polygons(placed, shakes=shakes)


def determinant(polygon: Array) -> int:
    """Modulo 2^31 - 1, up to sign."""
    found = diagram_of([polygon], most=5000)
    assert found is not None
    return colouring_number(found)


def linking_number(one: Array, other: Array) -> int:
    found = diagram_of([one, other], most=5000)
    assert found is not None
    return found.linking_numbers().get((0, 1), 0)


def depth(n: int, rng: np.random.Generator, size: float = 30.0) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    terms = [rng.normal() * np.cos(k * t) + rng.normal() * np.sin(k * t) for k in range(1, 17)]
    return np.asarray(size / 4 * np.sum(terms, axis=0))


def spiral(n: int, turns: int, rng: np.random.Generator) -> Array:
    """A band wound up: simple seen along z, at random depths."""
    t = np.linspace(0.0, 1.0, n // 2)
    sides = []
    for inner in (0.0, 24.0 / turns):
        radius = 10 + 60 * t - inner
        angle = 2 * np.pi * turns * t
        sides.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    flat = np.concatenate([sides[0], sides[1][::-1]])
    return np.column_stack([flat, depth(len(flat), rng)])


@pytest.mark.parametrize("seed", range(6))
def test_a_simple_curve_at_random_depths_is_an_unknot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert reduce_placed(spiral(600 + 400 * seed, 4 + seed, rng), shakes=40).vertices == 0


@pytest.mark.parametrize("sides", [3, 4, 5, 100])
def test_a_plane_polygon_is_an_unknot_though_all_its_signs_are_0(sides: int) -> None:
    assert reduce_placed(circle(sides)).vertices == 0
    # many vertices lie on each side of a square
    s = np.linspace(0, 1, 20, endpoint=False)[:, None]
    corner = np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]])
    square = np.concatenate([a + s * (corner[(i + 1) % 4] - a) for i, a in enumerate(corner)])
    assert reduce_placed(square).vertices == 0


def test_random_smooth_curves_vanish_or_keep_their_determinant() -> None:
    for seed in range(8):
        curve = tangle(300, seed)
        rest = reduce_placed(curve)
        assert determinant(rest.polygons[0] if rest.vertices else circle(5)) == determinant(curve)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_tangled_polygons_keep_their_determinant(seed: int) -> None:
    """Polygons of random vertices: some are knotted; no wrong move may change the invariant."""
    curve = np.random.default_rng(seed).normal(size=(30, 3))
    rest = reduce_placed(curve, shakes=5)
    assert determinant(rest.polygons[0] if rest.vertices else circle(5)) == determinant(curve)


@pytest.mark.parametrize("seed", range(12))
def test_random_links_keep_their_linking_number(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(2, 12, 3))
    rest = reduce_placed(one, other)
    left = dict(zip(rest.components, rest.polygons, strict=True))
    now = linking_number(left[0], left[1]) if len(left) == 2 else 0
    assert now == linking_number(one, other)


def test_knots_do_not_vanish() -> None:
    assert 6 <= reduce_placed(trefoil(400), shakes=10).vertices < 20
    assert 6 <= reduce_placed(trefoil(400) @ np.diag([1, 1, -1]), shakes=10).vertices < 20


def test_links_do_not_vanish_and_unlinks_do() -> None:
    ring = circle(60, 10.0)
    through = ring[:, [2, 0, 1]] + [0.0, 10.0, 0.0]
    assert reduce_placed(ring, through, shakes=3).components == (0, 1)
    assert reduce_placed(ring, through + [0.0, 10.5, 0.0]).vertices == 0
    assert reduce_placed(ring, 2 * ring, 3 * ring).vertices == 0
    # the one that is apart goes, whatever its number
    assert reduce_placed(ring, ring + 50, through).components == (0, 2)


def test_borromean_rings_do_not_vanish() -> None:
    t = 2 * np.pi * np.arange(80) / 80
    oval = np.column_stack([3 * np.cos(t), 1.5 * np.sin(t), np.zeros(80)])
    rings = [oval, oval[:, [2, 0, 1]], oval[:, [1, 2, 0]]]
    pairs = [(0, 1), (1, 2), (2, 0)]
    assert all(linking_number(rings[i], rings[j]) == 0 for i, j in pairs)
    assert reduce_placed(*rings, shakes=5).components == (0, 1, 2)
    assert all(reduce_placed(rings[i], rings[j]).vertices == 0 for i, j in pairs)


def test_polygons_that_touch_have_no_general_position() -> None:
    cross = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0]])
    assert general_position([cross]) is None
    assert general_position([circle(40), circle(40) + [80.0, 0, 0]]) is None
    fold = np.array([[0.0, 0, 0], [5, 0, 0], [2, 1e-9, 0], [2, 3, 0]])
    assert general_position([fold]) is None
    near = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 1e-8], [-1, 1, 1e-8]])
    assert general_position([near]) is not None  # not quite: a smaller shift will do
    repeated = np.array([[0.0, 0, 0], [5, 0, 0], [5, 0, 0], [2, 3, 0]])
    assert general_position([repeated]) is None


def test_general_position_moves_little() -> None:
    curve = trefoil(200)
    edge = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1).min()
    placed = general_position([curve, curve + 200])
    assert placed is not None and len(placed) == 2
    moved = np.linalg.norm(placed[0] - curve, axis=1)
    assert 0 < moved.max() <= 1e-5 * edge * (1 + 1e-9)


def test_orientation_is_sure_or_says_0() -> None:
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 500, 3))
    weights = rng.dirichlet([1, 1, 1], 500).T[:, :, None]
    on_plane = weights[0] * a + weights[1] * b + weights[2] * c
    assert (orientation(a, b, c, on_plane) == 0).mean() > 0.9
    normal = np.cross(b - a, c - a)
    above, below = orientation(a, b, c, a + normal), orientation(a, b, c, a - normal)
    assert (above == -below).all() and (above == above[0]).all() and above[0] != 0


def test_a_segment_is_told_from_one_that_pierces() -> None:
    a, b, c = (np.array([p]) for p in ([0.0, 0, 0], [1.0, 2, 0], [2.0, 0, 0]))

    def meets(p: list[float], q: list[float]) -> bool:
        return bool(may_pierce(a, b, c, np.array([p], float), np.array([q], float))[0])

    assert meets([1, 0.5, -1], [1, 0.5, 1])
    assert not meets([1, 0.5, 0.1], [1, 0.5, 1])
    assert not meets([3, 3, -1], [3, 3, 1])
    assert meets([1, 0, -1], [1, 0, 1])  # through the side
    assert meets([1, 0.5, 0], [3, 3, 0])  # in its plane: not certain, so it counts
    assert not meets([2, 0, 0], [3, 0.1, 0.2])  # leaves from a corner
    assert meets([2, 0, 0], [1, 0.5, 0])  # leaves from a corner into the triangle


def test_where_polygons_touch_and_are_nearest() -> None:
    cross = np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0]])
    assert touching_place([cross]) == pytest.approx([0, 0, 0], abs=1e-9)
    two = [circle(40), circle(40) + [80.0, 0, 0]]
    assert touching_place(two) == pytest.approx([40, 0, 0], abs=1e-9)
    fold = np.array([[0.0, 0, 0], [5, 0, 0], [2, 1e-9, 0], [2, 3, 0]])
    place = touching_place([fold])
    assert 2 <= place[0] <= 5 and place[1:] == pytest.approx([0, 0], abs=1e-8)
    repeated = np.array([[0.0, 0, 0], [5, 0, 0], [5, 0, 0], [2, 3, 0]])
    assert touching_place([repeated]) == pytest.approx([5, 0, 0])
    assert nearest_approach(circle(40), circle(40) + [90.0, 0, 0]) == pytest.approx([45, 0, 0])
    above = np.array([[-9.0, 0, 4], [9, 0, 4], [0, 0, 30]])
    below = np.array([[0.0, -9, 2], [0, 9, 2], [0, 0, -30]])
    assert nearest_approach(above, below) == pytest.approx([0, 0, 3], abs=1e-9)


def test_a_spent_budget_ends_the_work_and_not_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    rest = reduce_polygons([trefoil(400)], budget=Budget(2000))
    assert 20 < rest.vertices <= 400 and determinant(rest.polygons[0]) == 3
    budget = Budget(10)
    budget.spend(10)
    with pytest.raises(TooTangled):
        budget.spend(1)
    tangled = np.random.default_rng(0).normal(size=(300, 3))
    assert general_position([tangled]) is not None
    monkeypatch.setattr("knotfab_validators.knots.reduction.Budget", lambda: Budget(1000))
    with pytest.raises(TooTangled):
        general_position([tangled])


# Runs laid elsewhere: fewer crossings, and the same knot.


@pytest.mark.parametrize("name", [*prime_names()[5:80:9], *prime_names()[90::12]])
def test_braids_come_down_to_the_crossings_of_the_table(name: str) -> None:
    diagram = closed_braid(random_markov(list(braid_word(name)), 12, seed=1))
    least = int(name.split("_")[0])
    found = reroute(diagram, enough=least)
    assert len(found.crossings) == least
    assert invariants(found) == invariants(closed_braid(braid_word(name)))


def test_unknots_come_down_to_nothing() -> None:
    for seed in range(4):
        assert not reroute(closed_braid(random_markov([1, -2, 3], 60, seed))).crossings


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize(("p", "q"), [(2, 11), (3, 7)])
def test_no_diagram_has_fewer_crossings_than_its_knot(p: int, q: int) -> None:
    """A torus knot, drawn as the closed braid that no diagram has fewer crossings than."""
    assert len(reroute(closed_braid([*range(1, p)] * q)).crossings) == (p - 1) * q


@pytest.mark.usefixtures("brief")
def test_sums_fall_into_their_summands_and_prime_diagrams_do_not() -> None:
    knot = known_knot((Factor(3, 1, 1), Factor(4, 1, 0), Factor(5, 2, -1)))
    parts = summands(reroute(closed_braid(braid_of(knot)), enough=12))
    assert sorted(len(part.crossings) for part in parts) == [3, 4, 5]
    product = invariants(parts[0]) * invariants(parts[1]) * invariants(parts[2])
    assert product == knot.invariants
    (alone,) = summands(reroute(closed_braid(braid_word("10_123"))))
    assert len(alone.crossings) == 10


def test_linking_numbers_agree_with_gauss_integral() -> None:
    found = []
    for seed in range(20):
        one, other = np.random.default_rng(seed).normal(size=(2, 14, 3))
        found.append(diagram(one, other).linking_numbers().get((0, 1), 0))
        assert found[-1] == pytest.approx(gauss(one, other), abs=1e-9)
    assert min(found) < 0 < max(found)


def gauss(one: Array, other: Array) -> float:
    """Gauss' double integral over all pairs of edges, each in closed form as a solid angle."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    normals = [np.cross(c - a, d - a), np.cross(d - a, d - b)]
    normals += [np.cross(d - b, c - b), np.cross(c - b, c - a)]
    unit = [n / np.linalg.norm(n, axis=2, keepdims=True) for n in normals]
    angle = sum(
        np.arcsin(np.clip((unit[k] * unit[(k + 1) % 4]).sum(axis=2), -1, 1)) for k in range(4)
    )
    sign = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=2))
    return float((angle * sign).sum() / (4 * np.pi))


def test_a_direction_in_which_a_sign_is_uncertain_is_left_aside() -> None:
    cross = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 1], [0, 2, 1], [0, -2, 1], [-1, -2, 0.5]])
    assert seen_from([cross], np.array([0.0, 0.0, 1.0])) is not None
    for hit in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):  # along an edge
        assert seen_from([cross], np.array(hit)) is None
    over = cross.copy()
    over[3:5, 0] = 1.0  # three edges through one point of the picture
    assert seen_from([over], np.array([0.0, 0.0, 1.0])) is None
    assert diagram_of([np.random.default_rng(0).normal(size=(200, 3))], most=100) is None
