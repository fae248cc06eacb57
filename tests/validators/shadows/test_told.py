"""How much of a picture is told: the same for two seeds, 1 for the picture itself, little for a tangle."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.read_aside import WORDS, read_views, tell_apart
from knotfab.geometry.tube import as_mesh
from knotfab_validators.shadows import told
from knotfab_validators.shadows.told import DOOR, SIDES, tell, tell_flat


@pytest.fixture(autouse=True)
def _look_from_all_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(told, "SIDES", SIDES)


def ell(size: int = 60) -> NDArray[np.bool_]:
    found = np.zeros((size, size), dtype=bool)
    found[:, : size // 4] = found[-size // 4 :] = True
    return found


def solid_of(
    mask: NDArray[np.bool_], thick: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    from manifold3d import CrossSection, Manifold

    high = len(mask)
    boxes = [
        CrossSection.square((1, 1)).translate((float(x), float(high - 1 - y)))
        for y, x in np.argwhere(mask)
    ]
    sheet = sum(boxes[1:], boxes[0])
    vertices, faces = as_mesh(Manifold.extrude(sheet, thick))
    return vertices, faces


def test_a_plate_of_the_picture_tells_it_from_all_sides_but_its_edge() -> None:
    vertices, faces = solid_of(ell(), 2.0)
    found, named = tell(vertices, {"holder": faces, "knots": faces[:0]}, np.eye(3), ell()) or (
        None,
        {},
    )
    assert found is not None and found.of == "holder"
    ((angle, rank),) = named.items()
    assert (
        rank.first
        and rank.z > 3
        and int(angle) in np.abs([found.worst.azimuth, found.worst.elevation])
    )
    assert found.worst.share == 1.0 and found.door == 1.0
    assert (found.worst.azimuth, found.worst.elevation) in SIDES


def test_a_box_tells_little_of_an_ell_and_nothing_tells_nothing() -> None:
    vertices, faces = solid_of(np.ones((60, 60), dtype=bool), 2.0)
    found, named = tell(vertices, {"whole": faces}, np.eye(3), ell()) or (None, {})
    assert found is not None and found.worst.share < 0.5 and found.door <= found.worst.share
    assert not any(rank.first for rank in named.values())
    assert tell(vertices, {"whole": faces[:0]}, np.eye(3), ell()) is None
    assert tell(vertices, {"whole": faces}, np.eye(3), np.zeros((9, 9), dtype=bool)) is None
    assert len(SIDES) == 12 and set(DOOR) <= set(SIDES)


@pytest.mark.parametrize(
    ("mask", "low", "high"), [(ell(), 1, 1), (np.ones((60, 60), bool), 0, 0.5)]
)
def test_a_flat_sheet_tells_what_it_is(mask: NDArray[np.bool_], low: float, high: float) -> None:
    assert low <= tell_flat(mask, ell()) <= high


@pytest.mark.parametrize("number", [0, 7, 16, 23])
def test_the_gain_of_a_foreign_sign_is_its_mean_fit_to_the_others(number: int) -> None:
    signs = told._foreign()
    fits = [told._fit(signs[number], [sign] * len(told.SEEDS)) for sign in signs]
    others = np.delete(fits, number)
    assert others.mean() == pytest.approx(told.GAINS[number], abs=2e-6)


@pytest.mark.parametrize("thick", [2.0, 25.0])
@pytest.mark.slow
def test_what_cannot_tell_most_is_left_out_and_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, thick: float
) -> None:
    vertices, faces = solid_of(ell() | np.eye(60, dtype=bool), thick)
    parts = {"whole": faces, "knots": faces[: len(faces) // 3], "holder": faces[len(faces) // 2 :]}
    ring = np.hypot(*np.indices((60, 60)) - 30.0) < 28
    fit, fits = told._fit, list[int]()
    monkeypatch.setattr(told, "SIDES", SIDES[::3])
    monkeypatch.setattr(told, "_fit", lambda *asked: fits.append(len(asked)) or fit(*asked))
    for target in (ell(), ell()[:, ::-1], ring):
        fits.clear()
        found, few = tell(vertices, parts, np.eye(3), target), fits.count(2)
        with monkeypatch.context() as every:
            every.setattr(told, "_ROUNDING", np.inf)  # nothing is surely less
            assert tell(vertices, parts, np.eye(3), target) == found
        assert found is not None and few < fits.count(2) - few


@pytest.mark.study
def test_the_share_follows_what_a_person_named_and_not_the_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    views = read_views()
    shares = []
    for seeds in (told.SEEDS, (11, 22, 33)):
        monkeypatch.setattr(told, "SEEDS", seeds)
        shares.append(np.array([tell_flat(seen, picture) for seen, picture in views]))
    assert np.corrcoef(*shares)[0, 1] >= 0.9
    assert tell_apart(shares[0], WORDS == 2) > 0.8
    assert np.median(shares[0][WORDS == 2]) > 0.5 > shares[0][WORDS == 0].max()
