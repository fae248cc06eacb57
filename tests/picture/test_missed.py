"""Small parts of a silhouette count one by one: what is lost, filled, or drawn as another shape."""

from __future__ import annotations

import pytest
from shapely import MultiPolygon, Point, Polygon, box, unary_union
from shapely.affinity import scale, translate

from knotfab.picture.opening import find_missed, find_small, is_row

EYE = Point(30, 0).buffer(4.0)
HOLE = Point(-30, 0).buffer(4.0)
HEAD = Point(0, 0).buffer(60.0)


def shape(*parts: Polygon | MultiPolygon) -> MultiPolygon:
    joined = unary_union(parts)
    return joined if isinstance(joined, MultiPolygon) else MultiPolygon([joined])


# a pale ring about the eye, and a hole
FACE = shape(HEAD.difference(Point(30, 0).buffer(12.0)).difference(HOLE), EYE)


@pytest.mark.parametrize(
    ("drawn", "kinds"),
    [
        (FACE, []),
        (FACE.buffer(-0.3), []),  # thinner all around, and as it was
        (FACE.difference(EYE), ["piece"]),
        (shape(FACE, HOLE), ["hole"]),
        (shape(FACE, scale(EYE, 2.2, 1.0)), ["piece"]),  # the ring of a tube too thick for it
        (shape(FACE.difference(EYE), HOLE), ["hole", "piece"]),
        (FACE.difference(box(-60, 20, 60, 60)), []),  # no small part
    ],
)
def test_a_small_part_is_missed_where_it_is_lost_or_another_shape(
    drawn: MultiPolygon, kinds: list[str]
) -> None:
    small = find_small(FACE, 1.0)
    assert sorted(one.kind for one in small) == ["hole", "hole", "piece"]
    assert sorted(one.kind for one in find_missed(small, FACE, drawn, 1.5)) == kinds


def test_specks_are_no_parts_and_neither_is_what_is_large() -> None:
    assert [one.kind for one in find_small(FACE, 60.0)] == ["hole"]
    assert [one.kind for one in find_small(shape(HEAD, translate(HEAD, 200)), 1.0)] == []


def test_letters_stand_in_a_row() -> None:
    letters = [translate(box(0, 0, 6, 10 + k % 2 * 4), 9 * k) for k in range(5)]
    assert is_row(letters) and is_row(letters[::-1])
    assert not is_row(letters[:2])
    assert not is_row([*letters, translate(letters[0], 0, 30)])
    assert not is_row([translate(one, 30 * k) for k, one in enumerate(letters)])
