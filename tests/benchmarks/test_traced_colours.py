"""The colours that the validators mix, against paths that Mitsuba traces through the same scene."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from validator_parts import circle, tube

from benchmarks.traced_colours import light_and_mix, measure_rms, trace_colours, use_mitsuba
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.view import view_geometry

PX, PATHS = 40, 196


@pytest.mark.slow
def test_what_lamps_mix_is_what_a_path_tracer_sees() -> None:
    pytest.importorskip("mitsuba")
    assert use_mitsuba()
    base = {"frame_width_mm": 80.0, "frame_height_mm": 80.0, "wall_distance_mm": 60.0}
    places = {"red": (-60.0, 0.0), "green": (10.0, 50.0), "blue": (60.0, -20.0)}
    views: list[dict[str, Any]] = [
        {**base, "name": name, "light_right_mm": x, "light_up_mm": y, "lamp_colour": colour}
        for (name, (x, y)), colour in zip(places.items(), np.eye(3).tolist(), strict=True)
    ]
    views = [views[0], *({**view, "wall": "red"} for view in views[1:])]
    scene = parse_scene({"views": views})
    mesh = Mesh(*tube(circle(80, 20.0), 4.0, 24))
    seen = [view_geometry(view, PX, PX) for view in scene.views]
    _, ours = light_and_mix(mesh, scene, seen)
    traced = trace_colours(mesh, scene.views, seen, PATHS)
    assert measure_rms(ours, traced).max() < 0.03
    assert ours.min() < 0.05 and (ours > 0.9).all(axis=2).mean() > 0.3
    # a lamp elsewhere is another picture, in its own channel
    moved = replace(seen[2], light=seen[2].light + 40 * seen[2].up)
    off = measure_rms(ours, trace_colours(mesh, scene.views, [*seen[:2], moved], PATHS))
    assert off[2] > 0.1 > 0.03 > off[:2].max()
