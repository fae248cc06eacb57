"""Greys by the spacing of one line: the spread of points, the tour, and the drawing."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from scipy import ndimage

from knotfab.design.frames import widen_targets
from knotfab.picture.read import Target
from knotfab.scene.catalogue import asked_for, resolve
from knotfab.start.filling import simple_curves
from knotfab.start.tone import draw_tones, shortest_tour, spread_points
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material
from knotfab_formats.scene import Scene
from knotfab_formats.views import View

WIDTH, GAP = 8.0, 2.0  # px


def blob(size: int = 260) -> np.ndarray:
    """A dark disc, soft, off the middle of a grey ground."""
    y, x = np.mgrid[0:size, 0:size] / size
    return 0.3 + 0.7 / (1 + np.exp(40 * (np.hypot(x - 0.4, y - 0.55) - 0.2)))


def length(points: np.ndarray) -> float:
    return float(np.hypot(*(np.roll(points, -1, axis=0) - points).T).sum())


def test_points_are_as_dense_as_they_are_asked_to_be() -> None:
    density = np.ones((60, 80))
    density[:, 40:] = 4.0
    points = spread_points(density, 500)
    assert len(points) == pytest.approx(500, abs=5)
    right = (points[:, 0] > 40).sum()
    assert right / (len(points) - right) == pytest.approx(4.0, rel=0.1)


def test_a_tour_is_short_and_simple() -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        few = rng.random((7, 2))
        best = min(length(few[[0, *p]]) for p in permutations(range(1, 7)))
        assert length(few[shortest_tour(few)]) <= 1.05 * best
    many = rng.random((400, 2))
    tour = shortest_tour(many)
    assert sorted(tour) == list(range(400))
    assert simple_curves([many[tour]])
    # times the best length, as it is for many points
    assert length(many[tour]) < 0.7124 * np.sqrt(400) * 1.2


@pytest.mark.slow
@pytest.mark.parametrize("dark", [0.3, 0.7])
def test_an_even_grey_is_as_dark_as_it_is_asked_to_be(dark: float) -> None:
    mask, line = draw_tones(np.full((220, 220), dark), WIDTH, GAP)
    zoom = mask.shape[0] / 220
    drawn = length(line) * WIDTH * zoom / mask.size
    assert drawn == pytest.approx(dark * WIDTH / (WIDTH + GAP), rel=0.1)


def test_greys_are_there_once_they_are_seen_through_a_gaussian() -> None:
    dark = blob()
    mask, line = draw_tones(dark, WIDTH, GAP)
    assert simple_curves([line])
    assert ndimage.label(mask)[1] == 1
    zoom = mask.shape[0] / len(dark)
    seen = ndimage.gaussian_filter(mask.astype(float), 1.5 * WIDTH * zoom)
    asked = ndimage.gaussian_filter(ndimage.zoom(dark, zoom, order=1), 1.5 * WIDTH * zoom)
    asked *= WIDTH / (WIDTH + GAP)
    inner = np.s_[50:-50, 50:-50]
    off = np.sqrt(((seen - asked)[inner] ** 2).mean())
    assert off < 0.5 * asked[inner].std()


def test_a_white_picture_has_no_line() -> None:
    mask, line = draw_tones(np.zeros((100, 100)), WIDTH, GAP)
    assert not mask.any() and len(line) == 0


@pytest.mark.parametrize("pale", [0.001, 0.05, 0.0999])
def test_a_picture_that_is_pale_all_over_has_no_line(pale: float) -> None:
    assert spread_points(np.full((300, 300), pale**2), 900).shape == (0, 2)
    mask, line = draw_tones(np.full((1500, 1500), pale), WIDTH, GAP)
    assert not mask.any() and line.shape == (0, 2)


def test_greys_are_for_one_picture() -> None:
    scene = resolve(Scene(views=(View(tone="lines"), View(name="side", tone="lines"))))
    target = Target("x", np.eye(20, dtype=bool), b"", 20, 20)
    for targets, sequence in (([target, target], False), ([target], True)):
        with pytest.raises(InputError, match="for one picture"):
            widen_targets(scene, targets, sequence)
    one = scene.model_copy(
        update={"views": scene.views[:1], "material": asked_for(Material, "steel-wire-2mm")}
    )
    with pytest.raises(InputError, match="no wire is bent"):
        widen_targets(resolve(one), [target])
