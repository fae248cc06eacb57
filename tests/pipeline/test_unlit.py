"""What a preview says that a piece tells unlit."""

from typing import Any

import numpy as np
import pytest

from knotfab.hold.roots import Roots
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import survey_pictures
from knotfab.pipeline.unlit import _draw_roots, _draw_strands


def told(picture: str, **options: Any) -> float | None:
    return survey_pictures([picture], BuildOptions(accuracy="sketch", **options)).guess.told


@pytest.mark.slow
def test_a_flat_word_is_read_from_aside_and_a_deep_sign_is_not() -> None:
    flat, deep, hidden = (
        told("text:LOVE", plate="rounded"),
        told("text:8", plate="rounded"),
        told("text:8", plate="roots"),
    )
    assert flat is not None and deep is not None and hidden is not None
    assert flat > 0.85 > 0.6 > deep
    assert hidden != deep  # its roots are looked at as well
    assert told("text:8", supports="slicer") is None and told("text:8", plate="outline") is None


def test_each_prism_is_closed_and_lies_about_its_edge() -> None:
    rng = np.random.default_rng(2)
    curve = rng.normal(0, 30, (9, 3))
    corners, faces = _draw_strands([curve, curve + 200], 2.0)
    assert len(corners) == 2 * 9 * 12 and len(faces) == 2 * 9 * 12
    edges = np.concatenate([np.roll(c, -1, axis=0) - c for c in (curve, curve + 200)])
    ends = corners.reshape(2, 6, 18, 3)
    assert np.allclose(ends.mean(axis=1)[0], np.concatenate([curve, curve + 200]))
    assert np.allclose(ends[1] - ends[0], edges)
    away = ends[0] - np.concatenate([curve, curve + 200])
    assert np.allclose(np.linalg.norm(away, axis=-1), 2.0)
    assert np.allclose((away * edges).sum(axis=-1), 0.0, atol=1e-9)
    sides = np.linalg.norm(
        np.cross(
            corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]]
        ),
        axis=1,
    )
    # six sides, each as wide as the radius
    assert sides.sum() / 2 == pytest.approx(6 * 2.0 * np.linalg.norm(edges, axis=1).sum())


def test_strips_lie_on_the_wall_where_they_are_in_the_picture() -> None:
    """From the left half of a frame of 100 × 60 mm, 10 mm below its upper edge, straight down."""
    strip = np.array([[20.0, 10.0], [20.0, 40.0]])
    roots = Roots(None, np.zeros((0, 2)), strip, np.array([[0, 1]]), np.array([7.0]))  # type: ignore[arg-type]
    corners, faces = _draw_roots(roots, (100.0, 60.0), -50.0)
    assert np.allclose(corners.min(axis=0), (-33.5, -10, -50))
    assert np.allclose(corners.max(axis=0), (-26.5, 20, -50))
    a, b, c = (corners[faces[:, k], :2] for k in range(3))
    ab, ac = b - a, c - a
    assert abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]).sum() / 2 == pytest.approx(7 * 30)
