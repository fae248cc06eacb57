"""Setting up in words: steps with their figures, and what it costs to be off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from setups import OFF, setup

from knotfab.hold.placement import placement_of
from knotfab.report.for_maker import advise_lamp
from knotfab.report.setup_words import costs_of, lamp_facts, lamp_name, steps_of


def test_steps_name_the_figures() -> None:
    words = {}
    for kind in ("none", "plate", "dowel", "stand"):
        mounted, scene, camera = setup(kind)
        place = placement_of(mounted, camera)
        words[kind] = " ".join(steps_of(mounted, place, scene.views[0]))
    assert "two holes 166 mm apart" in words["plate"] and "arrow up" in words["plate"]
    assert "600 mm off the plate's face" in words["plate"]
    assert "opposite the middle of the frame" in words["plate"]
    assert "603.8 mm from the upper and lower edges of the plate" in words["plate"]
    assert "606.4 mm from the left and right edges of the plate" in words["plate"]
    assert "the 3 numbered holes" in words["dowel"] and "11 mm deep" in words["dowel"]
    assert f"{np.hypot(600, 100):.1f} mm from every corner of the frame" in words["dowel"]
    assert "52 mm below to 52 mm above" in words["none"]
    # the lamp is at (0, 0, 500), the base at x -30 to 32, z -20 to 25, on a desk at -75
    assert "80 mm before the wall" in words["stand"] and "75 mm above the desk" in words["stand"]
    assert "475 mm in front" in words["stand"] and "1 mm to the left" in words["stand"]


def test_a_plate_without_room_for_marks_promises_none() -> None:
    mounted, scene, camera = setup("plate", margin_mm=2.4)
    said = " ".join(steps_of(mounted, placement_of(mounted, camera), scene.views[0]))
    assert "notch" not in said and "arrow" not in said


def test_costs_are_those_of_the_report() -> None:
    _, scene, _ = setup("none")
    view = scene.views[0]
    lines = costs_of(OFF, view, on_wall=False)
    assert lines[0] == "Lamp 10 mm to the side: about 0.14 IoU (the shadow moves 2 mm)"
    assert lines[2] == "Lamp 10 mm nearer or farther: less than 0.01 IoU"
    assert lines[3] == "Piece turned by 1° left or right: about 0.25 IoU"
    assert lines[4] == "Piece turned by 1° forward or back: about 0.50 IoU"
    assert len(lines) == 6
    fixed = costs_of(OFF, view, on_wall=True)
    # the lamp moves by 600 mm sin 1° = 10.47 mm
    assert fixed[3:] == [
        "Wall and piece turned by 1° left or right: about 0.15 IoU",
        "Wall and piece leaning by 1° forward or back: about 0.09 IoU",
    ]
    assert costs_of(None, view, on_wall=True) == [
        "Not measured: too little to see, or nothing rendered."
    ]
    least = replace(OFF, lamp_iou_per_mm={"right": 0.0005, "up": 0.00049, "towards": 5.0})
    told = costs_of(least, view, on_wall=False)
    assert "about 0.01" in told[0] and "less than" in told[1] and "about 1.00" in told[2]


def test_the_lamps_size_is_told_with_its_blur() -> None:
    _, scene, _ = setup("none")
    view = scene.views[0].model_copy(update={"light_diameter_mm": 20.0})
    assert "a spot of 20 mm; outlines blur by 4 mm" in " ".join(lamp_facts(view))
    point = view.model_copy(update={"light_diameter_mm": 0.0})
    assert "point" in " ".join(lamp_facts(point))
    # 300 x 200 mm are 360.6 mm across, of which a fifth blurs
    keys = {"light_shape": "rectangle", "light_width_mm": 300.0, "light_height_mm": 200.0}
    panel = scene.views[0].model_copy(update=keys)
    told = " ".join(lamp_facts(panel))
    assert "a rectangle of 300 x 200 mm; outlines blur by 72.1 mm" in told
    assert lamp_name(panel) == "lamp, 360.6 mm"
    leds = panel.model_copy(update={"light_shape": "leds", "light_leds": (3, 2)})
    assert "3 x 2 LEDs of 5 mm over 300 x 200 mm" in " ".join(lamp_facts(leds))
    # and neither a torch nor a bulb stands in for it
    for view in (panel, leds):
        assert "torch" not in " ".join(advise_lamp(view, 2.0))
    assert "torch" in " ".join(advise_lamp(scene.views[0], 2.0))
