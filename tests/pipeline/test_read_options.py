"""The options of a call and the keys of the scene that they stand for."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from command import knotfab
from numpy.typing import NDArray
from PIL import Image
from questions import QUICK

from knotfab.base.folder import OutputFolder
from knotfab.cli.commands import app
from knotfab.pipeline.film import write_scene
from knotfab.pipeline.options import options_from
from knotfab.pipeline.prepare import survey_pictures
from knotfab.pipeline.read_options import read_scene
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.search import OF_NO_PRESET, PRESETS

KEYS = {
    "ink": ("red", "ink", "#ff0000"),
    "threshold": (0.3, "threshold", 0.3),
    "invert": (True, "invert", True),
    "crop": ("10, 20,30,40", "crop_px", (10, 20, 30, 40)),
    "keep_largest": (2, "keep_largest", 2),
    "specks": (9, "speck_px", 9),
    "smooth": (1.5, "smooth_px", 1.5),
    "thicken": ("3mm", "thicken_mm", 3.0),
    "width": (240.0, "frame_width_mm", 240.0),
    "height": (90, "frame_height_mm", 90),
    "lamp_distance": (800.0, "light_distance_mm", 800.0),
    "wall_distance": (50.0, "wall_distance_mm", 50.0),
    "lamp_diameter": (0.0, "light_diameter_mm", 0.0),
}


@pytest.mark.parametrize("name", KEYS)
def test_an_option_is_a_key_of_every_view_and_survives_the_file(tmp_path: Path, name: str) -> None:
    value, key, expected = KEYS[name]
    two = '[[views]]\nname = "a"\n[[views]]\nname = "b"\nazimuth_deg = 90.0\n'
    (tmp_path / "two.toml").write_text(two)
    scene, _ = read_scene(options_from({name: value, "scene": tmp_path / "two.toml"}))
    assert [getattr(view, key) for view in scene.views] == [expected] * 2
    again = parse_scene(dump_scene(scene))
    assert [getattr(view, key) for view in again.views] == [expected] * 2


def test_a_place_may_be_a_text_and_must_have_a_name(tmp_path: Path) -> None:
    assert (
        options_from({"out": str(tmp_path)}).out == tmp_path == options_from({"out": tmp_path}).out
    )
    for nowhere in ("", "  "):
        with pytest.raises(InputError, match="names no place"):
            options_from({"out": nowhere})


@pytest.mark.parametrize(
    ("text", "mm"),
    [("180", 180.0), ("180mm", 180.0), ("18cm", 180.0), ("0.18 m", 180.0), ("7in", 177.8),
     ('7"', 177.8), ("12,5", 12.5), ("1.5 mm", 1.5), (" 1,5 CM ", 15.0), (".5in", 12.7), ("0,125", 0.125),
     ("2 inches", 50.8)],
)  # fmt: skip
def test_lengths_are_read_as_people_write_them(text: str, mm: float) -> None:
    typed = app.parse_args(["build", "a.png", "--size", text, "--wall-distance", text])
    for options in (
        typed[1].arguments["options"],
        options_from({"size": text, "wall_distance": text}),
    ):
        assert options.size == options.wall_distance == pytest.approx(mm)
    scene, _ = read_scene(options_from({"thicken": text, "lamp_distance": 9000}))
    assert scene.views[0].thicken_mm == pytest.approx(mm)


@pytest.mark.parametrize(
    ("text", "why"),
    [("1,500", "1,500 may be 1.5 or 1500"), ("18 q", "no unit q"), ("mm", "no length"),
     ("1.2.3", "no length"),
     ("", "no length"), ("1e400", "no length"), ("nan", "no length"),
     ("5 ft", "no unit ft")],
)  # fmt: skip
def test_what_is_no_length_is_refused_by_the_name_that_was_typed(text: str, why: str) -> None:
    for name in ("--size", "--lamp-distance"):
        with pytest.raises(InputError, match=why) as refused:
            app.parse_args(["build", "a.png", name, text])
        assert str(refused.value).startswith(name) and str(refused.value).endswith(".")
    for key in ("tube_radius", "thicken"):
        with pytest.raises(InputError, match=why):
            read_scene(options_from({key: text}))


def test_shares_take_a_comma() -> None:
    assert read_scene(options_from({"threshold": "0,3"}))[0].views[0].threshold == 0.3
    with pytest.raises(InputError, match="no number"):
        options_from({"threshold": "3mm"})


def test_another_accuracy_keeps_what_no_preset_decides(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        '[search]\nseed = 3\ngrace = 0.1\nmethod = "inn"\nfree_view = true\ncoarse_iterations = 11\n'
    )
    given = {"seed": 3, "grace": 0.1, "method": "inn", "free_view": True}
    sketch = {"scene": own, "accuracy": "sketch"}
    scene, _ = read_scene(options_from(sketch))  # as a person wrote it
    assert scene.search == {**given, "coarse_iterations": 11} and scene.accuracy.name == "sketch"
    same, _ = read_scene(options_from({"scene": own, "accuracy": "standard", "seed": 4}))
    assert same.search == {**given, "seed": 4, "coarse_iterations": 11}
    written = PRESETS["standard"].model_dump() | given | {"coarse_iterations": 11}
    own.write_text(f"[search]\n{tomli_w.dumps(written)}")  # as a build writes it, with every key
    scene, _ = read_scene(options_from(sketch))
    assert scene.search == {key: written[key] for key in OF_NO_PRESET}
    presets = [preset.model_dump() for preset in PRESETS.values()]
    assert all(len({preset[key] for preset in presets}) == 1 for key in OF_NO_PRESET)
    own.write_text("[search]\nfoo = 1\n")
    with pytest.raises(InputError, match="foo: there is no such setting"):
        read_scene(options_from({"scene": own, "accuracy": "sketch"}))


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"mount": "ceiling"}, "--mount ceiling: .* Choose from auto, wall, stand, hang, none"),
        ({"free": "pose"}, "'view'"),
        ({"accuracy": "sketchy"}, "Choose from sketch, draft, standard, fine"),
        ({"lines": "maybe"}, "Choose from auto, on, off"),
        ({"size": "big"}, "--size big: it is no length"),
        ({"seed": "x"}, "--seed x: it is no whole number"),
        ({"seed": 1.5}, "no whole number"),
        ({"invert": "perhaps"}, "neither True nor False"),
        ({"depth": True}, "--depth True: it is no number"),
        ({"scene": 3}, "the option scene=3: .*path"),
        ({"skip": 3}, "the option skip=3: .*tuple"),
    ],
)
def test_what_an_option_cannot_be_is_refused(given: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        options_from(given)


def test_numbers_and_paths_may_be_of_any_type() -> None:
    given = {"seed": np.int64(3), "size": np.float32(90), "tube_radius": np.float64(2.5)}
    found = options_from(
        {**given, "scene": "a.toml", "printer": Path("b.toml"), "skip": ["slicer"]}
    )
    assert (found.seed, found.size, found.tube_radius) == (3, 90.0, 2.5)
    assert (found.scene, found.printer, found.skip) == (Path("a.toml"), "b.toml", ("slicer",))
    assert type(found.seed) is int and type(found.size) is float
    assert options_from({"print": True, "mount": None, "knots": 2}).knots == 2


def test_a_sequence_that_need_not_close_is_repeated_by_its_scene(tmp_path: Path) -> None:
    asked, _ = read_scene(options_from({"sequence": True, "no_loop": True}))
    with OutputFolder(tmp_path) as folder:
        write_scene(folder, asked, resolve(asked))
        folder.commit()
    again, _ = read_scene(options_from({"sequence": True, "scene": tmp_path / "scene.toml"}))
    assert asked.sequence.loop is again.sequence.loop is False
    assert read_scene(options_from({"sequence": True}))[0].sequence.loop


@pytest.mark.parametrize("key", ["width", "height"])
def test_one_side_of_a_frame_frees_the_other(tmp_path: Path, key: str) -> None:
    (tmp_path / "a.toml").write_text("[[views]]\nframe_width_mm = 180.0\nframe_height_mm = 90.0\n")
    scene, _ = read_scene(options_from({key: 60.0, "scene": tmp_path / "a.toml"}))
    sides = {"width": scene.views[0].frame_width_mm, "height": scene.views[0].frame_height_mm}
    assert sides.pop(key) == 60.0 and list(sides.values()) == [None]


@pytest.mark.parametrize(
    ("name", "value"),
    [("threshold", 1.0), ("threshold", 0.0), ("smooth", -1.0), ("keep_largest", 0), ("specks", -1),
     ("width", 0.0), ("height", float("nan")), ("lamp_distance", -5.0), ("lamp_diameter", -1.0),
     ("size", 0.0), ("ink", "plaid"), ("crop", "1,2,3"), ("crop", "1,2,0,4"), ("thicken", "-2")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_by_the_options_name(name: str, value: object) -> None:
    with pytest.raises(InputError, match="--" + name.replace("_", "-")):
        read_scene(options_from({name: value}))


def test_size_is_one_of_three() -> None:
    for other in ("width", "height"):
        with pytest.raises(InputError, match=f"--size 100: --{other} is given too"):
            read_scene(options_from({"size": 100.0, other: 50.0}))


@pytest.mark.slow
@pytest.mark.parametrize(("text", "longer"), [("text:l", 1), ("text:—", 0)])
def test_size_is_that_of_the_longer_side(text: str, longer: int) -> None:
    found = survey_pictures([text], options_from({"size": 90.0})).views[0].view
    sides = found.frame_width_mm, found.frame_height_mm
    assert sides[longer] == pytest.approx(90.0) and sides[1 - longer] < 90.0
    usual = survey_pictures([text], options_from({})).views[0].view
    assert usual.frame_width_mm / usual.frame_height_mm == pytest.approx(sides[0] / sides[1])


def test_effects_are_switched_by_name_and_the_last_word_counts(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[effects]\npenumbra = 'off'\n")
    scene, _ = read_scene(options_from({"scene": tmp_path / "a.toml"}))
    assert scene.effects.penumbra is False
    given = {"scene": tmp_path / "a.toml", "effect": ["penumbra=on", "Penumbra = auto"]}
    scene, _ = read_scene(options_from(given))
    assert scene.effects.penumbra is None
    scene, _ = read_scene(options_from({"effect": "penumbra=on"}))
    assert parse_scene(dump_scene(scene)).effects.penumbra is True
    read_scene(options_from({"effect": "contrast=auto"}))  # struck, and it asks for nothing


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("perspective=off", "--effect perspective=off: there is no such effect. Known: penumbra"),
        ("hiding=on", "hiding: knotfab 2 does not have it. Leave it out"),
        ("penumbra", "--effect penumbra: it is neither on, off nor auto"),
        ("penumbra=yes", "Write --effect penumbra=on, penumbra=off or penumbra=auto"),
    ],
)
def test_an_effect_that_there_is_not_is_refused_in_one_sentence(text: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        read_scene(options_from({"effect": (text,)}))
    assert words in str(refused.value) and refused.value.exit_code == 2


def test_what_a_file_says_of_itself_survives_the_scene() -> None:
    told = {"title": "Cat", "designer": "Ada", "licence": "CC BY 4.0"}
    scene, _ = read_scene(options_from(told))
    assert parse_scene(dump_scene(scene)).about.model_dump() == told
    for key in told:
        for text in ("two\nlines", "x" * 201, "\x01"):
            with pytest.raises(InputError, match=f"--{key} .*it is no line of text"):
                read_scene(options_from({key: text}))


# --- builds with them ---


@pytest.fixture
def quick(tmp_path: Path) -> list[str | Path]:
    """A scene that searches for a second."""
    scene = tmp_path / "quick.toml"
    scene.write_text(QUICK)
    return ["--scene", scene, "--skip", "shadow-render"]


def two_pieces(size: int = 96) -> NDArray[np.bool_]:
    ink = np.zeros((size, size), dtype=bool)
    ink[16:80, 12:40] = True
    ink[16:80, 56:84] = True
    return ink


@pytest.mark.build
@pytest.mark.study
def test_two_pieces_of_a_drawing_become_two_flat_knots(
    tmp_path: Path, quick: list[str | Path]
) -> None:
    svg = tmp_path / "two.svg"
    svg.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="96" height="96">'
        '<path d="M12 16h28v64h-28z M56 16h28v64h-28z"/></svg>'
    )
    out = tmp_path / "out"
    done = knotfab("build", svg, *quick, "--tube-radius", "3", "--depth", "flat", "--out", out)
    assert done.code == 0, done
    knots = json.loads((out / "knots.json").read_text())["knots"]
    report = json.loads((out / "report.json").read_text())
    assert len(knots) == len(report["knots"]) == 2
    page = (out / "report.html").read_bytes()  # it needs nothing but the folder
    (out / "report.html").unlink()
    assert knotfab("report", out).code == 0 and (out / "report.html").read_bytes() == page
    assert report["print"]["depth_ratio"] < 0.15
    assert any("loose pieces" in row["text"] for row in report["rows"] if row["name"] == "mount")
    assert tomllib.loads((out / "scene.toml").read_text())["piece"]["depth"] == "flat"
    assert next(c for c in report["checks"] if c["name"] == "mesh_bodies")["measured"] == 2
    assert not list(out.glob("setup.*")) and report["print"]["drawings"] == []  # without --print


@pytest.mark.build
@pytest.mark.study
def test_two_pieces_bridged_into_one_of_a_given_depth(
    tmp_path: Path, quick: list[str | Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The picture is light on dark, in 16 bits of grey."""
    modelled: list[object] = []
    monkeypatch.setattr("knotfab.hold.solids.model_fixture", lambda *a, **_: modelled.append(a))
    png = tmp_path / "deep.png"
    Image.fromarray(np.where(two_pieces(), 60000, 300).astype(np.uint16)).save(png)
    out = tmp_path / "out"
    done = knotfab(
        "build", png, *quick, "--tube-radius", "5", "--knots", "1", "--depth", "40", "--out", out
    )
    assert done.code == 0, done
    (knot,) = json.loads((out / "knots.json").read_text())["knots"]
    scene = tomllib.loads((out / "scene.toml").read_text())
    matrix = np.array(scene["pose"]["matrix"])
    along = np.array(knot["points"]) @ matrix[2, :3]
    assert 30 < np.ptp(along) < 44
    assert scene["piece"]["depth"] == 40.0 and scene["piece"]["knots"] == 1
    # who did what: neither told nor asked is a stage left out, or a mount that is not there
    assert not modelled
    settings = json.loads((out / "report.json").read_text())["settings"]
    left = {"cadquery", "matplotlib", "pyvista", "resvg-py", "knot_floer_homology"}
    assert not left & (set(settings["parts"]) | set(settings["versions"]))
    assert settings["parts"]["manifold3d"] == "swept the tubes"
    assert settings["parts"]["trimesh"] == "wrote part.glb"
