"""The word for a shadow follows from what was done to it; what is lost is named in its place."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw
from reports import recognition, view_of_report
from validator_parts import PlainView

from knotfab_formats.piece import Piece
from knotfab_formats.verdict import Recognition, View
from knotfab_validators.arrays import Mask
from knotfab_validators.check import BadFile
from knotfab_validators.files.picture import Bent
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.part_view import count_bridged
from knotfab_validators.shadows.recognition import recognise
from knotfab_validators.shadows.topology import count_repeated, find_changes
from knotfab_validators.shadows.verdict_rules import (
    BENT,
    RULES,
    UNKNOWN,
    WORDS,
    check_recognisable,
    judge_bending,
    worst_verdict,
)
from knotfab_validators.shadows.view import view_geometry
from tests.corpus import harmed_shadows
from tests.corpus.harmed_shadows import SIXTY

SIZE = 512  # px of the picture, 180 mm on the wall
RADIUS_PX = 7.0  # the tube's shadow, in the picture's pixels


def draw(*discs: tuple[float, float, float], strokes: tuple[tuple[float, ...], ...] = ()) -> Mask:
    image = Image.new("1", (SIZE, SIZE))
    pen = ImageDraw.Draw(image)
    pen.ellipse((60, 60, 300, 300), fill=1)
    pen.ellipse((150, 150, 210, 210), fill=0)
    for x, y, r in discs:
        pen.ellipse((x - r, y - r, x + r, y + r), fill=1)
    for x0, y0, x1, y1, width in strokes:
        pen.line((x0, y0, x1, y1), fill=1, width=round(width))
    return np.asarray(image)


def judge(shadow: Mask, target: Mask, outlined: Mask | None = None, **scene: Any) -> Recognition:
    frame = working_frame(SIZE, SIZE, SIZE)
    seen, wanted = padded_mask(shadow, frame), padded_mask(target, frame)
    geometry = view_geometry(PlainView(frame_width_mm=180.0), SIZE, SIZE)
    iou = overlap(seen, wanted).iou
    own = None if outlined is None else padded_mask(outlined, frame)
    return recognise(seen, wanted, iou, RADIUS_PX, frame, geometry, outlined=own, **scene)


SMALL, LARGE = (430, 400, 5), (420, 420, 55)
LETTERS = tuple((80 + 24 * k, 440, 6) for k in range(12))


def test_a_picture_shifted_by_a_pixel_is_faithful() -> None:
    target = draw(LARGE, *LETTERS)
    for shadow in (target, np.roll(target, 1, axis=0)):
        found = judge(shadow, target)
        assert found.word == "faithful" and not found.reasons and not found.lost
        assert found.outline_p95_radii <= 1.5 / RADIUS_PX


def test_a_lost_piece_is_never_good() -> None:
    small = judge(draw(), draw(SMALL))
    assert small.word == "coarse" and small.lost_pieces == 1
    (loss,) = small.lost
    assert loss.what == "piece"
    np.testing.assert_allclose(loss.at_px, (430, 400), atol=4)
    np.testing.assert_allclose(loss.at_mm, np.array([430, 400]) * 180 / SIZE, atol=1.5)
    assert loss.size_mm == pytest.approx(11 * 180 / SIZE, abs=1.2)
    assert loss.needed_mm == pytest.approx(2 * RADIUS_PX * 180 / SIZE, abs=0.05)
    large = judge(draw(), draw(LARGE))
    # one of three parts, a tenth of the picture
    assert judge(draw(), draw((420, 420, 40))).word == "coarse"
    assert large.word == UNKNOWN and large.lost[0].size_mm > large.lost[0].needed_mm


def test_a_filled_hole_counts_as_a_lost_piece_does() -> None:
    filled = draw((180, 180, 40))
    found = judge(filled, draw())
    assert found.word == UNKNOWN and found.filled_holes == 1
    narrow = draw((180, 180, 28))  # what is left of the hole is a slit all round
    assert judge(narrow, narrow).word == "faithful"


def test_one_gap_bridged_is_good_and_many_are_not() -> None:
    apart = [(80 + 45 * k, 420, 16) for k in range(8)]
    target = draw(*apart)
    one = draw(*apart, strokes=((80, 420, 125, 420, 14),))
    assert judge(one, target).word == "good"
    every = draw(*apart, strokes=((80, 420, 395, 420, 14),))
    found = judge(every, target)
    assert found.bridged_gaps == 7 and WORDS.index(found.word) >= 2


def test_a_hole_that_many_strands_cross_is_one_thing_to_see() -> None:
    def plate(*crossed: float, parts: int = 1) -> Mask:
        image = Image.fromarray(draw())
        pen = ImageDraw.Draw(image)
        pen.rectangle((40, 340, 480, 480), fill=1)
        for k in range(parts):  # one long slot, or as many short ones
            wide = 400 / parts
            pen.rectangle((60 + k * wide, 395, 60 + (k + 1) * wide - 12, 425), fill=0)
        for x in crossed:
            pen.rectangle((x, 395, x + 14, 425), fill=1)
        return np.asarray(image)

    places = [72 + 50 * k for k in range(8)]
    slot = judge(plate(*places), plate())
    assert slot.bridged_gaps == 8 and slot.word == "coarse"
    assert "8 changes to its 4 pieces and holes" in slot.reasons  # that it is not good
    # as many holes crossed once each are as many things
    for parts, repeated in ((1, 7), (2, 6), (8, 0)):
        gaps = find_changes(plate(*places, parts=parts), plate(parts=parts), 2.0)
        assert [gap.kind for gap in gaps] == 8 * ["gap"]
        assert count_repeated(gaps, plate(parts=parts)) == repeated


def lit(mask: Mask, *boxes: tuple[int, int, int, int], dark: bool = False) -> Mask:
    image = Image.fromarray(mask)
    for box in boxes:
        ImageDraw.Draw(image).rectangle(box, fill=dark)
    return np.asarray(image)


@pytest.mark.parametrize(("wide", "word"), [(36, "coarse"), (26, "coarse"), (14, "good")])
@pytest.mark.parametrize("dark", [False, True])
def test_a_part_that_hangs_on_another_is_lost_where_it_is_wider_than_a_strand(
    wide: int, word: str, dark: bool
) -> None:
    # a notch in the disc, or a lug on it
    top = 298 if dark else 301 - wide
    box = (180 - wide // 2, top, 180 + wide // 2, top + wide)
    target = lit(draw(LARGE), box, dark=dark)
    found = judge(draw(LARGE), target)
    assert WORDS.index(found.word) <= WORDS.index(word)
    assert (found.word == "coarse") == (word == "coarse")
    assert any("patch" in reason for reason in found.reasons) == (word == "coarse")


def test_a_part_out_of_place_is_no_patch_besides() -> None:
    moved = judge(draw((424, 432, 30)), draw((408, 412, 30)))
    assert moved.word == "good" and moved.misshapen == 1


def test_a_strand_across_a_hole_is_a_bridged_gap_and_one_in_the_open_leads_off() -> None:
    open_ = lit(draw(), (110, 110, 250, 250))
    crossed = judge(lit(open_, (140, 110, 153, 250), dark=True), open_)
    assert crossed.word == "good" and crossed.bridged_gaps == 1
    astray = judge(lit(open_, (290, 180, 360, 193), dark=True), open_)
    assert astray.word == "coarse" and astray.bridged_gaps == 0
    dangling = judge(lit(open_, (180, 110, 193, 200), dark=True), open_)
    assert dangling.word == "coarse" and not dangling.bridged_gaps


@pytest.mark.parametrize(
    ("parts", "gone", "word"),
    [(4, 1, "coarse"), (5, 1, "coarse"), (8, 2, "coarse"), (3, 1, UNKNOWN), (8, 3, UNKNOWN)],
)
def test_a_row_of_equals_is_known_without_one_in_four(parts: int, gone: int, word: str) -> None:
    image = Image.new("1", (SIZE, SIZE))
    for k in range(parts):
        x = 40 + 56 * k
        ImageDraw.Draw(image).ellipse((x - 24, 230, x + 24, 278), fill=1)
    target = np.asarray(image)
    assert judge(lit(target, (0, 0, 12 + 56 * gone, SIZE)), target).word == word


def test_a_small_piece_turned_is_good_and_named() -> None:
    def eye(a: int, b: int) -> Mask:
        image = Image.fromarray(draw())
        ImageDraw.Draw(image).ellipse((420 - a, 420 - b, 420 + a, 420 + b), fill=1)
        return np.asarray(image)

    target = eye(17, 9)
    assert judge(eye(18, 9), target).word == "faithful"
    found = judge(eye(9, 17), target)
    # the outline says nothing of it
    assert found.outline_p95_radii < RULES["faithful"].outline_radii
    assert found.word == "good" and found.misshapen == 1
    (loss,) = found.lost
    assert loss.what == "shape" and loss.sentence.startswith("a piece is drawn out of shape")
    np.testing.assert_allclose(loss.at_px, (420, 420), atol=4)
    assert loss.size_mm == pytest.approx(19 * 180 / SIZE, abs=1.2)
    assert any("alike, below" in reason for reason in found.reasons)


@pytest.mark.slow
def test_one_piece_out_of_shape_is_good_and_most_of_them_coarse() -> None:
    places = [(340 + 50 * (k % 4), 60 + 65 * (k // 4)) for k in range(24)]

    def dots(*changed: tuple[int, int]) -> Mask:
        image = Image.fromarray(draw())
        pen = ImageDraw.Draw(image)
        for (x, y), (a, b) in zip(places, [*changed, *[(18, 18)] * 24], strict=False):
            pen.ellipse((x - a, y - b, x + a, y + b), fill=1)
        return np.asarray(image)

    target, dented, thin = dots(), (14, 18), (10, 18)
    for shadow, word, misshapen in (
        (dots(), "faithful", 0),
        (dots(dented), "good", 1),
        (dots(dented, dented), "good", 2),
        (dots(thin), "good", 1),
        (dots(*[thin] * 24), "coarse", 24),
    ):
        found = judge(shadow, target)
        assert (found.word, found.misshapen) == (word, misshapen)


def test_the_dust_of_a_scan_is_no_outline() -> None:
    clean = draw(LARGE)
    dust = clean.copy()
    for k in range(150):
        x, y = 7 + 40 * (k % 12), 3 + 40 * (k // 12)
        dust[y : y + 2, x : x + 2] = True
    found = judge(clean, dust)
    assert found.word == "faithful" and found.cut_tips == 0
    assert found.outline_p95_radii < 0.1
    # pieces that a person sees are
    assert judge(clean, draw(LARGE, (430, 260, 7))).lost_pieces == 1


@pytest.mark.slow
def test_the_leg_of_a_stand_bridges_what_it_crosses() -> None:
    target = draw(LARGE)
    leg = draw(LARGE, strokes=((180, 299, 170, 480, 8),))
    assert judge(leg, target).word == "coarse"  # as a strand that strays so far
    found = judge(leg, target, target)
    assert found.word == "good" and found.outline_p95_radii < 0.1  # the leg takes of its IoU
    across = judge(draw(LARGE, strokes=((250, 250, 420, 420, 8),)), target, target)
    assert across.bridged_gaps == 1 and across.word == "good"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("foot", "thick", "word"),
    [
        (400, 8, "good"),  # it crosses
        (123, 8, "faithful"),  # hardly leaves
        (470, 8, "good"),
    ],
)
def test_a_leg_between_two_columns_is_counted(foot: int, thick: int, word: str) -> None:
    gate = np.zeros((SIZE, SIZE), dtype=np.bool_)
    gate[40:120, 40:440], gate[40:420, 40:120], gate[40:420, 360:440] = True, True, True
    legs = gate.copy()
    legs[100:foot, 240 : 240 + thick] = True
    found = judge(legs, gate, gate)
    assert found.word == word and found.bridged_gaps == 0
    assert any("leg of the mount" in reason for reason in found.reasons) == (word == "good")
    beside = gate.copy()
    beside[420:470, 70:80] = True  # below the picture's foot
    assert judge(beside, gate, gate).word == "faithful"


@pytest.mark.slow
def test_small_letters_that_are_lost_are_text_in_its_place() -> None:
    found = judge(draw(LARGE), draw(LARGE, *LETTERS))
    assert found.word == "coarse" and found.lost_pieces == len(LETTERS)
    (loss,) = found.lost  # beads are no letters
    assert loss.what == "piece" and "a row of 12 small shapes" in loss.sentence
    assert "a row of small shapes is damaged or lost" in found.reasons
    bars = tuple((86 + 48 * k, 434, 74 + 48 * k, 446, 4) for k in range(6))
    letters = draw(LARGE, *LETTERS[1::2], strokes=bars)
    found = judge(draw(LARGE), letters)
    (loss,) = found.lost
    assert loss.what == "text" and "12 pieces" in loss.sentence
    assert "a row of text is damaged or lost" in found.reasons
    np.testing.assert_allclose(loss.at_px, (80 + 24 * 5.5, 440), atol=4)
    blobs = draw(LARGE, *LETTERS[1::2], strokes=(*bars, (70, 440, 350, 440, 14)))
    assert [loss.what for loss in judge(blobs, letters).lost] == ["text"]


@pytest.mark.slow
def test_a_shadow_of_something_else_is_not_recognisable() -> None:
    target = draw(LARGE)
    for shadow in (
        np.zeros_like(target),
        ~target,
        target[::-1],
        target & (np.indices(target.shape)[0] < 150),
    ):
        assert judge(shadow, target).word == UNKNOWN


def test_the_rules_grow_laxer_from_word_to_word() -> None:
    rules = list(RULES.values())
    for strict, lax in pairwise(rules):
        assert strict.iou > lax.iou and strict.outline_radii < lax.outline_radii
        assert strict.changed <= lax.changed and strict.lost_tubes <= lax.lost_tubes
        assert strict.shape >= lax.shape
        assert (
            strict.specks < lax.specks and strict.speck_share < lax.speck_share
        ) or lax is rules[-1]
    assert rules[0].lost_tubes == 0.0


def test_of_several_views_the_worst_counts() -> None:
    def view(name: str, verdict: Recognition | None) -> View:
        return replace(view_of_report(name=name), verdict=verdict)

    target = draw(SMALL)
    good, coarse = judge(target, target), judge(draw(), target)
    worst = worst_verdict([view("a", good), view("b", coarse)])
    assert worst is not None and worst.word == "coarse" and worst.lost_pieces == 1
    assert worst.lost[0].view == "b" and "(view b)" in worst.reasons[0]
    worse = replace(coarse, outline_p95_radii=coarse.outline_p95_radii + 1.0)
    for order in ((coarse, worse), (worse, coarse)):  # both have the same word
        told = worst_verdict([view("a", order[0]), view("b", order[1])])
        assert told is not None and told.outline_p95_radii == worse.outline_p95_radii
    assert worst_verdict([view("a", None)]) is None
    alone = worst_verdict([view("b", coarse)])
    assert alone is not None and alone.reasons == coarse.reasons


def test_the_check_rejects_what_nobody_would_know() -> None:
    target = draw(LARGE)
    unknown = worst_verdict([replace(view_of_report(), verdict=judge(draw(), target))])
    assert unknown is not None
    check = check_recognisable(unknown, accepted=False)
    assert (check.status, check.required) == ("fail", True) and "--accept" in check.detail
    kept = check_recognisable(unknown, accepted=True)
    assert (kept.status, kept.required) == ("fail", False)
    for word in RULES:
        assert check_recognisable(replace(unknown, word=word), accepted=False).status == "pass"
    assert check_recognisable(None, accepted=False).status == "skipped"


def draw_star(length: float) -> Mask:
    """A disc with a thin spike of this length, px."""
    image = Image.new("1", (SIZE, SIZE))
    pen = ImageDraw.Draw(image)
    pen.ellipse((150, 150, 350, 350), fill=1)
    pen.polygon([(240, 160), (260, 160), (250, 152 - length)], fill=1)
    return np.asarray(image)


def test_a_tip_cut_short_by_more_than_a_tube_is_good() -> None:
    target = draw_star(100)
    words = {}
    for radii in (1.0, 3.5):
        shadow = target.copy()
        shadow[: 52 + round(radii * RADIUS_PX)] = False
        found = judge(shadow, target)
        words[radii] = found.word, found.cut_tips
    assert words == {1.0: ("faithful", 0), 3.5: ("good", 1)}
    # among many pieces one is not seen
    many = np.zeros((SIZE, SIZE), dtype=bool)
    for i in range(12):
        many[450:490, 20 + 40 * i : 45 + 40 * i] = True
    assert judge(shadow | many, target | many).word == "faithful"


def test_pieces_that_just_touch_are_good_and_not_faithful() -> None:
    board = np.zeros((SIZE, SIZE), dtype=bool)
    for i in range(4):
        for j in range(4):
            board[100 + 60 * i :, 100 + 60 * j :][:60, :60] = (i + j) % 2 == 0
    found = judge(board, board)
    assert found.touching > 0 and found.broken_strokes == 0
    assert found.word == "good" and "touch" in found.reasons[0]


def spotted(count: int, radius: float, slit: int = 0) -> Mask:
    """A large disc with specks of light of this radius, px, and as many slits of this length."""
    rng = np.random.default_rng(3)
    image = Image.new("1", (SIZE, SIZE))
    pen = ImageDraw.Draw(image)
    pen.ellipse((56, 56, 456, 456), fill=1)
    for a, b in zip(rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 170, count), strict=True):
        x, y = 256 + b * np.cos(a), 256 + b * np.sin(a)
        pen.ellipse((x - radius, y - radius, x + radius + slit, y + radius), fill=0)
    return np.asarray(image)


@pytest.mark.slow
def test_one_speck_never_lowers_the_word_and_fifty_do() -> None:
    clean = spotted(0, 0)
    for count, radius, word in ((1, 2, "faithful"), (50, 2, "good"), (200, 3, "coarse")):
        found = judge(spotted(count, radius), clean, blur_px=5.7)
        assert found.word == word
        assert ("specks" in {loss.what for loss in found.lost}) == (count > 1)
        assert count != 50 or "specks of light" in found.reasons[0]
    assert judge(spotted(40, 1, slit=40), clean, blur_px=5.7).word != "faithful"
    # a wide lamp washes out what a small one shows
    assert judge(spotted(50, 2), clean, blur_px=60.0).word == "faithful"
    assert judge(spotted(1, 2), spotted(1, 2)).specks == 0  # the picture's own


@pytest.mark.slow
def test_more_damage_never_gives_a_better_word() -> None:
    clean = spotted(0, 0)
    words = [
        WORDS.index(judge(spotted(n, 2.5), clean, blur_px=5.7).word) for n in (0, 1, 20, 80, 300)
    ]
    assert words == sorted(words) and words[-1] >= 2


def test_a_stray_strand_is_coarse_and_half_a_picture_is_unknown() -> None:
    target = draw(LARGE)
    stray = draw(LARGE, strokes=((250, 250, 470, 100, 14),))
    assert judge(stray, target).word == "coarse"
    half = target & (np.indices(target.shape)[1] > 180)
    assert judge(half, target).word == UNKNOWN


@pytest.mark.slow
def test_a_short_stray_strand_is_coarse_too() -> None:
    """It is a twentieth of the outline, so that 95 % of that lie right; a stub of a tube's width is none."""
    target = draw(LARGE)
    stray, stub = (draw(LARGE, strokes=((180, 290, 180, y, 14),)) for y in (340, 318))
    assert judge(stray, target).word == "coarse" and judge(stub, target).word != "coarse"
    (reason,) = [r for r in judge(stray, target).reasons if "leads off" in r]
    off_mm = float(reason.split(" mm")[0].split()[-1])
    assert off_mm == pytest.approx(40 * 180 / SIZE, rel=0.1)


def test_what_is_lost_comes_by_its_length_and_tips_are_among_it() -> None:
    target = draw_star(100)
    shadow = target.copy()
    shadow[:115] = False
    target = target | draw((430, 430, 5)) & (np.indices(target.shape)[0] > 400)
    found = judge(shadow, target)
    assert [loss.what for loss in found.lost] == ["tip", "piece"]
    assert found.lost[0].length_mm == pytest.approx(63 * 180 / SIZE, abs=3)
    assert "mm long is cut off" in found.lost[0].sentence
    assert [reason for reason in found.reasons if "tip" in reason] == ["1 tip is cut off"]


def test_windows_are_one_line_and_no_text() -> None:
    house = np.zeros((SIZE, SIZE), dtype=bool)
    house[100:400, 60:450] = True
    shadow = house.copy()
    for k in range(8):
        house[150:170, 80 + 34 * k : 98 + 34 * k] = False
    (loss,) = judge(shadow, house).lost
    assert loss.what == "hole" and "8 holes are filled" in loss.sentence


def test_a_bridge_that_was_asked_for_is_no_loss() -> None:
    apart = [(120, 420, 30), (240, 420, 30)]
    bridged = draw(*apart, strokes=((120, 420, 240, 420, 14),))
    assert judge(bridged, draw(*apart)).lost
    found = judge(bridged, draw(*apart), bridged=1)
    assert not found.lost and found.word in ("faithful", "good")


def test_a_wide_bridge_that_was_asked_for_costs_no_likeness() -> None:
    apart = [(70, 420, 40), (440, 420, 40)]
    bridged = draw(*apart, strokes=((70, 420, 440, 420, 28),))
    assert judge(bridged, draw(*apart)).word not in ("faithful", "good")
    found = judge(bridged, draw(*apart), bridged=1)
    assert found.word in ("faithful", "good"), found.reasons


REQUESTED = {  # keys of [piece], and gaps of three pieces that were to be bridged
    "nobody asked": ({}, 0),
    "one knot": ({"knots": 1}, 2),
    "two knots": ({"knots": 2}, 1),
    "a build's own count": ({"knots": 1, "knots_asked": False}, 0),
    "more knots than pieces": ({"knots": 9}, 0),
}


@pytest.mark.parametrize("kind", REQUESTED)
def test_only_what_was_asked_for_is_a_requested_bridge(kind: str) -> None:
    keys, bridges = REQUESTED[kind]
    assert count_bridged(Piece(**keys), draw((420, 420, 30), (430, 100, 30))) == bridges


# A person's word on most of a hundred shadows, and never off by two words.


@pytest.mark.study
def test_the_word_is_a_persons() -> None:
    off = [
        abs(WORDS.index(harmed_shadows.judge(wanted, shadow)[0]) - WORDS.index(person))
        for _, person, wanted, shadow in harmed_shadows.harmed()
    ]
    assert off[: len(SIXTY)].count(0) >= 56
    assert off[len(SIXTY) :].count(0) >= 37
    assert max(off) == 1


# The word that a bending allows: it lowers a verdict, never raises one, and says why.


SQUARE = np.ones((4, 4), dtype=bool)


def bent(rms: float, most: float, stretch: float) -> Bent:
    return Bent(SQUARE, rms, most, stretch, mirrored=False)


@pytest.mark.parametrize("number", range(3))
def test_each_figure_alone_lowers_the_word(number: int) -> None:
    for word, limits in BENT.items():
        at = judge_bending(recognition(word="faithful", reasons=[]), bent(*limits))
        assert at.word == word
        above = list(limits)
        above[number] *= 1.01
        lower = judge_bending(recognition(word="faithful", reasons=[]), bent(*above))
        assert WORDS.index(lower.word) == WORDS.index(word) + 1
        assert "picture bent by" in lower.reasons[-1]


def test_no_bending_makes_a_verdict_better() -> None:
    assert judge_bending(recognition(word=UNKNOWN, reasons=[]), bent(0, 0, 1)).word == UNKNOWN
    assert (
        judge_bending(recognition(word="coarse", reasons=[]), bent(0.03, 0.1, 2.5)).word == "coarse"
    )
    assert (
        judge_bending(recognition(word="good", reasons=[]), bent(0.01, 0.02, np.inf)).word
        == UNKNOWN
    )


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"mirrored": 1}, "true or false"),
        ({"bend_points": "0,0"}, "a list of as many"),
        ({"bend_points": ["0,0 " * 10 + "0,0"] * 14}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0"] * 15}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0,nan"] * 15}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0,99999"] * 15}, "15 rows of 11 pairs"),
    ],
)
def test_what_no_build_writes_is_refused(keys: dict[str, object], why: str) -> None:
    with pytest.raises(BadFile, match=why):
        parse_scene({"views": [keys]})
