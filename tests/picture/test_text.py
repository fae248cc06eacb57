"""Text as a picture: as large as its ink, in every script, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from knotfab.picture.read import read_target
from knotfab.picture.silhouette import holes_of, mask_iou, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading
from tests.picture.test_read import again


@pytest.mark.usefixtures("large")
@pytest.mark.slow
@pytest.mark.parametrize("text", ["♞", "abc", "∮", "-"])
def test_text_hugs_the_ink(tmp_path: Path, text: str) -> None:
    target = read_target(f"text:{text}")
    rows, columns = target.mask.any(axis=1).nonzero()[0], target.mask.any(axis=0).nonzero()[0]
    assert max(target.width, target.height) == 2048
    margin = 0.06 * 2048
    gaps = [columns[0], target.width - 1 - columns[-1], rows[0], target.height - 1 - rows[-1]]
    assert gaps == pytest.approx([margin] * 4, abs=1.5)
    assert target.suffix == ".png"
    assert (again(tmp_path, target).mask == target.mask).all()
    inverted = read_target(f"text:{text}", Reading(invert=True))
    assert (inverted.mask == ~target.mask).all()
    assert (again(tmp_path, inverted, invert=True).mask == inverted.mask).all()


def test_text_is_upright_and_reads_from_left_to_right() -> None:
    mask = read_target("text:L.").mask  # the stem is on the left, the foot below, the dot right
    assert mask[:, : mask.shape[1] // 2].sum() > mask[:, mask.shape[1] // 2 :].sum()
    assert mask[mask.shape[0] // 2 :].sum() > mask[: mask.shape[0] // 2].sum()


@pytest.mark.slow
def test_text_of_every_script_is_shaped() -> None:
    hebrew = read_target(
        "text:שלום"
    ).mask  # its last letter alone has a hole, and stands at the left
    _, columns = (holes_of(hebrew)[0] > 0).nonzero()
    assert 0 < columns.mean() < 0.3 * hebrew.shape[1]
    assert len(pieces_of(read_target("text:ممم").mask)[1]) == 1  # three letters in one stroke
    placed, whole = (read_target(f"text:{e}").mask[:, :325] for e in ("e\u0301", "é"))
    assert mask_iou(placed, whole) > 0.97
    mixed = read_target("text:א l").mask  # the first letter at the right, and the l at the left
    assert mixed[:, : mixed.shape[1] // 4].sum() < mixed[:, -mixed.shape[1] // 2 :].sum()
    rows, across = mixed.any(axis=1).nonzero()[0], mixed.any(axis=0).nonzero()[0]
    gaps = [across[0], mixed.shape[1] - 1 - across[-1], rows[0], mixed.shape[0] - 1 - rows[-1]]
    assert gaps == pytest.approx([0.06 * 512] * 4, abs=2.5)


@pytest.mark.slow
def test_text_keeps_holes_and_kerning() -> None:
    def holes(text: str) -> int:
        return len(holes_of(read_target(f"text:{text}").mask)[1])

    assert (holes("8"), holes("O"), holes("R"), holes("l"), holes("B8")) == (2, 1, 1, 0, 4)
    wide, tight = read_target("text:HH"), read_target("text:AV")
    assert tight.mask.any(axis=0)[50:-50].all()  # A and V overlap from left to right
    assert not wide.mask.any(axis=0)[50:-50].all()


@pytest.mark.slow
def test_text_with_a_variation_selector_or_another_font() -> None:
    plain, styled = read_target("text:☺"), read_target("text:☺\ufe0f")
    assert (plain.mask == styled.mask).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no visible character"),
        ("   ", "no visible character"),
        ("\ufe0f", "no visible character"),
        ("a\nb", r"U\+000A"),
        ("x" * 300, "300 characters"),
    ],
)
def test_text_that_cannot_be_drawn(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_target(f"text:{text}")
    assert "\n" not in str(caught.value)
