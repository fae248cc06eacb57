"""What a tube cannot draw of a silhouette: openings that are known, and small parts lost, filled or bent."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw
from scipy import ndimage
from shapely import LinearRing, MultiPolygon, Point, Polygon, box, unary_union
from shapely.affinity import rotate, scale, translate

from knotfab.base.arrays import Mask
from knotfab.design.frames import widen_targets
from knotfab.picture.opening import (
    Loss,
    find_losses,
    find_missed,
    find_small,
    is_row,
    is_thin,
    least_ring,
    open_by,
    opening_iou,
    thicken,
    thickest_radius,
)
from knotfab.picture.read import Target
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene
from knotfab_formats.views import View
from knotfab_validators.files.picture import widen_strokes


def shape(*parts: object) -> MultiPolygon:
    """Polygons as one silhouette."""
    joined = unary_union(parts)
    return joined if isinstance(joined, MultiPolygon) else MultiPolygon([joined])


def losses(polygon: MultiPolygon, radius: float) -> list[Loss]:
    return find_losses(polygon, open_by(polygon, radius), radius)


BAR = 6.0  # thickness of the arm that sticks out of a disc
PAN = shape(Point(0, 0).buffer(40), box(0, -BAR / 2, 120, BAR / 2))


@given(st.floats(3.5, 15.0))
@settings(max_examples=20)
def test_a_thin_arm_is_lost_with_its_place_and_size(radius: float) -> None:
    (loss,) = losses(PAN, radius)
    assert loss.thickness == pytest.approx(BAR, rel=0.05)
    assert loss.extent == pytest.approx(80, abs=radius)
    assert loss.shape.buffer(1e-6).contains(Point(loss.at)) and loss.at[0] > 40 - radius


def test_nothing_is_lost_where_the_tube_fits_nor_at_corners() -> None:
    assert losses(PAN, 2.5) == []
    assert losses(shape(box(0, 0, 60, 40)), 15.0) == []


def test_a_small_piece_is_lost_whole() -> None:
    two = shape(box(0, 0, 60, 40), box(80, 0, 86, 6))
    (loss,) = losses(two, 4.0)
    assert loss.shape.symmetric_difference(box(80, 0, 86, 6)).area < 0.1
    assert loss.thickness == pytest.approx(6, rel=0.05)
    assert losses(shape(box(80, 0, 86, 6)), 4.0)[0].extent == pytest.approx(6)


def test_corners_that_are_lost_are_not_one_loss() -> None:
    """What circles of straight sides leave along an edge joins no two of them."""
    roof = shape(Polygon([(10, 90), (50, 10), (90, 90)]))
    (loss,) = losses(roof, 3.0)
    assert loss.extent < 12.0 and loss.at[1] < 20.0


PLATE = 30.0  # width of the second piece of a picture of two


def _change_by_opening_first(radius: float, times: float) -> float:
    """The share of two pieces that differs where an opening is taken of a smaller one."""
    two = shape(PAN, box(60, 20, 60 + PLATE, 20 + PLATE))
    once, twice = (open_by(s, radius * times) for s in (two, open_by(two, radius)))
    return float(once.symmetric_difference(twice).area / two.area)


@given(st.floats(1.0, 8.0), st.floats(1.0, 3.0))
@settings(max_examples=20)
def test_an_opening_may_be_taken_of_an_opening(radius: float, times: float) -> None:
    # as wide as a part, to the fiftieth that is promised, a disc may fit or not (7.875, 1.8984375: the plate)
    assume(all(abs(2.0 * radius * times / width - 1.0) > 1 / 50 for width in (BAR, PLATE)))
    assert _change_by_opening_first(radius, times) < 0.01


@pytest.mark.parametrize(
    ("radius", "times"), [(2.0, 1.49), (2.0, 1.51), (7.875, 1.86), (7.875, 1.96)]
)
def test_so_it_may_where_a_disc_is_nearly_as_wide_as_a_part(radius: float, times: float) -> None:
    assert _change_by_opening_first(radius, times) < 0.01


@pytest.mark.slow
@given(st.floats(0.5, 50.0))
@settings(max_examples=20)
def test_the_thickest_tube_of_a_disc_is_the_disc(radius: float) -> None:
    disc = shape(Point(3, 4).buffer(radius, quad_segs=64))
    assert thickest_radius(disc, 0.9, 0.01, 400.0) == pytest.approx(radius, rel=0.02)
    assert thickest_radius(disc, 0.9, 2 * radius, 400.0) is None
    assert thickest_radius(disc, 0.9, 0.01, 0.5 * radius) == 0.5 * radius
    assert opening_iou(disc, 0.5 * radius) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("px", [1, 2, 5])
def test_a_line_however_thin_is_lost(px: int) -> None:
    disc = Point(0, 0).buffer(350)
    lost = losses(shape(disc, box(500, 0, 500 + px, 700)), 30.0)
    assert [round(loss.extent) for loss in lost] == [700]


@given(st.floats(1.0, 3.0), st.floats(0.2, 8.0), st.floats(0.2, 8.0), st.floats(0.0, 180.0))
@settings(max_examples=30)
def test_the_least_ring_is_a_circle_at_most(
    bend: float, wide: float, high: float, turn: float
) -> None:
    place = rotate(box(3 - wide, 5 - high, 3 + wide, 5 + high), turn, origin=(3.0, 5.0))
    ring = LinearRing(least_ring(place, 0.5, bend))
    assert ring.buffer(1e-3).contains(ring) and ring.centroid.distance(Point(3, 5)) < 1e-6
    longest = max(Point(3, 5).distance(Point(p)) for p in ring.coords)
    assert longest == pytest.approx(bend)
    least = min(max(min(wide, high) - 0.5, 0.01 * bend), bend)
    assert Polygon(ring).area == pytest.approx(3.1416 * bend * least, rel=0.01)
    flat = LinearRing(least_ring(place, 0.5, bend, flat=True))
    assert Polygon(flat).area == pytest.approx(3.1416 * bend**2, rel=0.01)


# Widened strokes are as wide as asked along their lines, and what is thick stays as it is.


def drawn(*points: tuple[int, int], width: int, body: bool = False) -> Mask:
    """A line, and a thick square beside it."""
    image = Image.new("1", (200, 160))
    draw = ImageDraw.Draw(image)
    draw.line(points, fill=1, width=width, joint="curve")
    if body:
        draw.rectangle((130, 40, 180, 120), fill=1)
    return np.asarray(image).copy()


def disc_fits(mask: Mask, radius: float) -> Mask:
    """The opening by a disc."""
    inside = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] > radius
    return np.asarray(ndimage.distance_transform_edt(~inside) <= radius)


LINES = {
    "level": ((20, 80), (110, 80)),
    "steep": ((20, 20), (60, 140)),
    "bent": ((20, 130), (60, 30), (110, 120)),
}


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_strokes_become_as_wide_as_asked(name: str, width: int) -> None:
    thin, wanted = drawn(*LINES[name], width=width), 12
    wide = thicken(thin, wanted)
    assert (thin & ~wide).sum() == 0
    assert (wide & ~disc_fits(wide, 0.5 * wanted - 1)).sum() < 0.03 * wide.sum()
    line = drawn(*LINES[name], width=wanted)
    away = ndimage.distance_transform_edt(~line)
    assert away[wide].max() < 0.5 * wanted + 1  # round ends reach a radius further
    middle = (away == 0) & (np.abs(np.indices(line.shape)[1] - 65) < 25)
    assert (middle & ~wide).sum() < 0.08 * middle.sum()
    # it is no wider either, but for a pixel and its round ends
    assert wide.sum() < 1.2 * line.sum() + wanted**2
    assert ndimage.distance_transform_edt(~thin)[wide].max() <= 0.5 * wanted


def test_what_is_thick_stays_with_its_corners() -> None:
    body = drawn((0, 0), (0, 0), width=1, body=True)
    body[0, 0] = False
    assert (thicken(body, 12) == body).all()
    both = drawn((20, 80), (131, 80), width=3, body=True)
    wide = thicken(both, 12)
    assert ((wide ^ both)[:, 137:]).sum() == 0
    assert ndimage.label(wide)[1] == 1


def test_nothing_is_widened_twice() -> None:
    once = thicken(drawn(*LINES["bent"], width=3), 12)
    assert (thicken(once, 10) ^ once).sum() < 0.01 * once.sum()


@given(st.integers(0, 10**6), st.floats(4.0, 16.0))
@settings(max_examples=15)
def test_the_validators_widen_alike(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    points = [(int(x), int(y)) for x, y in rng.integers(10, 120, (4, 2))]
    mask = drawn(*points, width=int(rng.integers(1, 8)), body=bool(seed % 2))
    np.testing.assert_array_equal(thicken(mask, width), widen_strokes(mask, width))


@pytest.mark.parametrize("sequence", [False, True])
def test_what_the_scene_asks_for_is_drawn_and_the_picture_kept(sequence: bool) -> None:
    mask = drawn(*LINES["bent"], width=2)
    targets = [Target("line", mask)] * (3 if sequence else 1)
    scene = resolve(Scene(views=(View(thicken_mm="auto"),)))
    changed, found = widen_targets(scene, targets, sequence)
    # 1.1 times the shadow of a 1.6 mm tube falls on a wall 100 mm behind a piece 500 mm from the lamp
    assert changed.views[0].thicken_mm == pytest.approx(1.1 * 1.6 * 1.2)
    assert len(found) == len(targets)
    for target in found:
        assert (target.asked == mask).all() and "widened" in target.rule
        assert (target.mask == thicken(mask, 1.1 * 1.6 * 1.2 * 200 / 180)).all()
    assert widen_targets(scene.model_copy(update={"views": (View(lines=False),)}), targets[:1])[
        1
    ] == (targets[0],)


@pytest.mark.parametrize("width", [2, 5, 9, 14])
@pytest.mark.parametrize("body", [False, True])
def test_a_drawing_of_lines_is_one_whose_lines_are_thinner(width: int, body: bool) -> None:
    shape = drawn((10, 20), (90, 130), (110, 20), width=width, body=body)
    for asked in (3.0, 6.0, 12.0):
        # the square's area is more than a fifth, and its middle lines are less than half
        assert is_thin(shape, asked) == (width < asked - 0.5 and not body)


EYE = Point(30, 0).buffer(4.0)
HOLE = Point(-30, 0).buffer(4.0)
HEAD = Point(0, 0).buffer(60.0)


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
