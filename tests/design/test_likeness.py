"""What no tube can draw is told from pixels alone, and what tubes can draw never is."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy import ndimage

from benchmarks.hard.pictures import hard_pictures
from knotfab.base.arrays import Mask
from knotfab.base.errors import SceneError
from knotfab.design import survey as survey_module
from knotfab.design.likeness import compare_lines, estimate_likeness, recognisable_radius
from knotfab.design.sentence import describe, list_figures
from knotfab.design.survey import require_drawable, survey
from knotfab.picture.opening import opening_iou
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import opened_share, trace_polygon
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Accuracy, Piece
from knotfab_formats.scene import Scene
from knotfab_formats.views import View

HARD = {case.name: case for case in hard_pictures()}
RADIUS_PX = 256 * 0.8 * 1.2 / 180  # px of the thinnest tube's shadow, in a picture of 256 px


def noise(side: int, cell: int = 1) -> Mask:
    """Squares of so many px, each by the toss of a coin."""
    few = np.random.default_rng(6).random((side // cell, side // cell)) < 0.5
    return np.pad(np.kron(few, np.ones((cell, cell), dtype=bool)), 16)


def checks(count: int, side: int = 256) -> Mask:
    """A board of count x count squares."""
    v, u = np.mgrid[:side, :side] * count // side
    return np.pad((u + v) % 2 == 0, 16)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mask",
    [
        pytest.param(noise(256), id="noise-256"),
        pytest.param(noise(512), id="noise-512", marks=pytest.mark.study),
        pytest.param(HARD["checkerboard"].draw(), id="checks"),
        pytest.param(HARD["carpet"].draw(), id="carpet"),
    ],
)
def test_what_no_tube_can_draw_is_not_recognisable(mask: Mask) -> None:
    found = estimate_likeness(mask, RADIUS_PX * max(mask.shape) / 256)
    assert found is not None and not found.recognisable


@pytest.mark.slow
def test_a_finer_tube_that_is_named_draws_it() -> None:
    mask = noise(96, 2)
    radius = recognisable_radius(mask, 5.0)
    assert radius is not None and radius < 2.0
    again = estimate_likeness(mask, radius)
    assert again is None or (again.recognisable and opened_share(mask, radius / 96, 1024) > 0.9)


@given(seed=st.integers(0, 999), count=st.integers(1, 30), radius=st.floats(5.0, 9.0))
@settings(max_examples=12)
def test_a_union_of_discs_is_never_refused(seed: int, count: int, radius: float) -> None:
    middles = np.zeros((160, 200), dtype=bool)
    places = np.random.default_rng(seed).integers(12, (148, 188), (count, 2))
    middles[tuple(places.T)] = True
    mask = ndimage.distance_transform_edt(~middles) <= radius
    found = estimate_likeness(mask, 0.8 * radius)
    assert found is None or found.recognisable
    assert opened_share(mask, 0.8 * radius / 200) > 0.6  # there are few pixels


@given(seed=st.integers(0, 999), cell=st.integers(1, 12), cut=st.floats(-1.0, 1.0))
@settings(max_examples=12)
def test_what_is_wider_than_two_tubes_is_half_drawn(seed: int, cell: int, cut: float) -> None:
    """A build need not open its polygon to know that."""
    levels = np.random.default_rng(seed).normal(size=(96, 128))
    mask = np.asarray(ndimage.gaussian_filter(levels, cell) * cell > 0.3 * cut)
    if mask.any() and estimate_likeness(mask, 2.0) is None:
        assert opening_iou(trace_polygon(mask), 2.0) > 0.5


def strokes(side: int, width: int) -> Mask:
    """A closed curve in five lobes, so many px wide."""
    t = np.linspace(0, 2 * np.pi, 20 * side)
    out = side * (0.3 + 0.08 * np.cos(5 * t))
    mask = np.zeros((side, side), dtype=bool)
    for k in range(width * width):
        at = [(side / 2 + out * f(t)).astype(int) for f in (np.sin, np.cos)]
        mask[at[0] + k // width, at[1] + k % width] = True
    return mask


def widen(mask: Mask, radius: float) -> Mask:
    return np.asarray(ndimage.distance_transform_edt(~mask) <= radius)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, pytest.param(2, marks=pytest.mark.study), 3])
def test_a_stroke_of_few_px_is_one_stroke_to_every_radius(width: int) -> None:
    mask = strokes(1400, width)
    for radius in (8.0, 40.0):
        found = compare_lines(mask, widen(mask, radius), radius)
        assert found.recognisable and found.changes == 0, radius


@given(apart=st.integers(8, 40), width=st.integers(1, 4), across=st.booleans())
@settings(max_examples=6)
def test_lines_closer_than_the_tube_is_wide_are_no_drawing(
    apart: int, width: int, across: bool
) -> None:
    mask = np.zeros((600, 600), dtype=bool)
    inner = mask[16:-16, 16:-16]
    for k in range(width):
        inner[k::apart] = True
        if across:
            inner[:, k::apart] = True
    radius = 0.6 * apart
    assert not compare_lines(mask, widen(mask, radius), radius).recognisable


def test_the_finest_meshes_are_no_specks() -> None:
    mask = strokes(512, 2)
    mask[40:-40:8, 40:-40] = mask[40:-40, 40:-40:8] = True
    for radius in (12.0, 20.0, 40.0):
        assert not compare_lines(mask, widen(mask, radius), radius).recognisable


@pytest.mark.slow
def test_noise_is_refused_without_a_polygon_being_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Image.fromarray(np.where(noise(224), 0, 255).astype(np.uint8)).save(tmp_path / "noise.png")
    opened: list[str] = []
    for where, name in (
        (survey_module, "find_losses"),
        (survey_module, "ask"),
        (survey_module, "drawing_radius"),
    ):
        monkeypatch.setattr(where, name, lambda *_, name=name: opened.append(name))
    scene = Scene()
    target = read_target(tmp_path / "noise.png")
    found = survey(resolve(scene), [target])
    with pytest.raises(SceneError, match=r"nobody would know .* pieces and holes") as caught:
        require_drawable(found)
    assert opened == [] and caught.value.exit_code == 1
    for remedy in ("px of ", "--accept unrecognisable"):
        assert remedy in caught.value.remedy
    assert "would refuse" in describe(found)[-1]
    assert list_figures(found)["refusal"]


@pytest.mark.slow
def test_who_accepts_it_may_build_it(tmp_path: Path) -> None:
    Image.fromarray(np.where(noise(64, 2), 0, 255).astype(np.uint8)).save(tmp_path / "few.png")
    view, target = View(frame_width_mm=40.0), read_target(tmp_path / "few.png")
    asked = Scene(views=(view,), accuracy=Accuracy(accept=("unrecognisable",)))
    found = survey(resolve(asked), [target])
    assert found.views[0].likeness is not None and not found.views[0].likeness.recognisable
    with pytest.raises(SceneError, match="nobody would know"):
        require_drawable(survey(resolve(Scene(views=(view,))), [target]))
    try:
        require_drawable(found)
    except SceneError as refused:  # thin lines, which none accepts
        assert "nobody would know" not in str(refused)


@pytest.mark.slow
def test_a_radius_that_is_given_is_asked_for_a_thinner_one(tmp_path: Path) -> None:
    Image.fromarray(np.where(checks(16), 0, 255).astype(np.uint8)).save(tmp_path / "checks.png")
    target = read_target(tmp_path / "checks.png")
    thick = Scene(piece=Piece(tube_radius_mm=9.0))
    with pytest.raises(SceneError, match="18 mm thick") as caught:
        require_drawable(survey(resolve(thick), [target]))
    assert "--tube-radius" in caught.value.remedy
    require_drawable(survey(resolve(Scene()), [target], choose=False))
