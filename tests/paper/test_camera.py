"""The paper's cameras: upright about a middle, and refused where they are impossible."""

import math

import pytest
import torch

from paper.camera import camera_around, paper_camera


def test_cameras_around_a_middle_see_it_upright() -> None:
    middle = torch.tensor([0.3, -0.2, 2.0], dtype=torch.float64)
    for azimuth, elevation in ((0, 0), (90, 0), (-135, 30), (10, -80)):
        camera = camera_around(middle.tolist(), 3.0, azimuth, elevation)
        local = camera.local(torch.stack([middle, middle + torch.tensor([0.0, -0.1, 0.0])]))
        assert torch.allclose(local[0], torch.tensor([0.0, 0.0, 3.0]).double(), atol=1e-12)
        # up in the world (y is down) is up in the picture
        assert float(local[1, 1]) < 0 and abs(float(local[1, 0])) < 1e-12
    high = camera_around((0.0, 0.0, 3.0), 3.0, 0.0, 30.0)
    eye = torch.tensor([0.0, -1.5, 3.0 - 3.0 * math.cos(math.radians(30.0))]).double()
    assert torch.allclose(high.local(eye), torch.zeros(3).double(), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"focal": (1.0, 0.0, 2.0)}, "positive"),
        ({"near": 2.0, "far": 1.0}, "near before far"),
        ({"width": 1}, "2 x 2"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        paper_camera(**change)  # type: ignore[arg-type]
