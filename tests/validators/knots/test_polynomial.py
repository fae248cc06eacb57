"""Laurent polynomials: their text, and what is done with them."""

import itertools

from diagrams import powers

from knotfab_validators.knots.polynomial import Laurent, laurent


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
