"""The public API: what it lists, that it loads nothing heavy, and that its names survive every import."""

import importlib
import inspect
import pkgutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from reports import report_with

import knotfab
from examples.api_page import PAGE, api_page
from knotfab.pipeline.options import BuildOptions, options_from
from knotfab_formats.errors import InputError

PUBLIC = [
    *("Design", "Event", "InputError", "Knot", "KnotfabError", "Knots", "MachineError", "Outcome", "Part"),
    *("Problem", "Question", "ResolvedScene", "Scene", "SceneError", "SearchResult", "SettledScene",
     "Start", "Target", "TorchTerm"),
    *("assemble_part", "build", "choose_tube", "design_knots", "pose_question", "read_picture"),
    *("search_knots", "settle_design", "sweep_tube", "validate_part", "write_files"),
]  # fmt: skip


def test_the_public_names_are_these() -> None:
    assert knotfab.__all__ == PUBLIC
    assert dir(knotfab) == sorted([*PUBLIC, "__version__"])
    with pytest.raises(AttributeError, match="no attribute 'serch'"):
        knotfab.serch  # noqa: B018


@pytest.mark.slow
def test_no_module_takes_the_place_of_a_public_name() -> None:
    """Importing a submodule sets an attribute of its package: none may bear the name of a function."""
    for module in pkgutil.walk_packages(knotfab.__path__, "knotfab."):
        if module.name != "knotfab.__main__":
            importlib.import_module(module.name)
    for name in PUBLIC:
        thing = getattr(knotfab, name)
        assert callable(thing), name
        assert not inspect.ismodule(thing), name
        assert inspect.getdoc(thing), name


def test_options_take_a_librarys_own_types(tmp_path: Path) -> None:
    given = options_from(
        {"tube_radius": 2.5, "time_budget": 30, "scene": "a.toml", "skip": "slicer", "print": True}
    )
    assert given == BuildOptions(
        tube_radius=2.5, time_budget="30", scene=Path("a.toml"), skip=("slicer",), print_=True
    )
    with pytest.raises(knotfab.InputError, match="option mout") as error:
        knotfab.build("text:o", tmp_path / "out", mout="wall")
    assert error.value.exit_code == 2 and "mount" in str(error.value)
    with pytest.raises(knotfab.InputError, match=r"^tube_radius=-1: .*, such as tube_radius=2"):
        knotfab.build("text:o", tmp_path / "out", tube_radius=-1)
    assert not (tmp_path / "out").exists()


def test_the_page_is_made_from_the_docstrings() -> None:
    assert PAGE.read_text(encoding="utf-8") == api_page(), "run python -m examples.api_page"


def test_the_packages_are_typed() -> None:
    for package in ("knotfab", "knotfab_validators", "knotfab_fixtures"):
        root = importlib.import_module(package).__path__[0]
        assert (Path(root) / "py.typed").is_file()


def test_pil_images_and_arrays_are_pictures_others_refused(tmp_path: Path) -> None:
    square = np.pad(np.ones((60, 60), dtype=bool), 20)
    grey = np.where(square, 0, 255).astype(np.uint8)
    Image.fromarray(grey).save(tmp_path / "square.png")
    for picture in (square, grey, Image.fromarray(grey), np.stack([grey] * 3, axis=-1)):
        np.testing.assert_array_equal(knotfab.read_picture(picture).mask, square)
    np.testing.assert_array_equal(knotfab.read_picture(tmp_path / "square.png").mask, square)
    with pytest.raises(knotfab.InputError, match=r"^the picture: it is all one colour"):
        knotfab.read_picture(np.zeros_like(grey))
    for none in (7, np.zeros((2, 2, 2, 2)), object(), [1]):
        with pytest.raises(knotfab.InputError, match=r"the picture: a .* Give a path"):
            knotfab.read_picture(none)
    with pytest.raises(knotfab.InputError, match="the picture: a int"):
        knotfab.build(7)


def test_a_wrong_key_is_told_in_a_sentence() -> None:
    with pytest.raises(knotfab.InputError, match=r'read_picture: ink is "redd".*colour such as "#'):
        knotfab.read_picture("text:A", ink="redd")
    with pytest.raises(knotfab.InputError, match=r"no key 'inc'. Did you mean 'ink'"):
        knotfab.read_picture("text:A", inc="red")
    with pytest.raises(knotfab.InputError, match=r"acuracy: .* Did you mean accuracy"):
        knotfab.build("text:A", acuracy="fine")


def test_a_result_is_short_to_look_at(tmp_path: Path) -> None:
    shown = repr(knotfab.Outcome(0, report_with(notes=["x"] * 1000), tmp_path))
    assert len(shown) < 200 and str(tmp_path) in shown


@pytest.mark.slow
def test_what_a_callable_raises_ends_a_build_and_leaves_nothing(tmp_path: Path) -> None:
    """This holds for any error, even one whose kind is handled elsewhere in a build."""
    for error in (ZeroDivisionError, KeyboardInterrupt, lambda: knotfab.SceneError("a", "b", "c")):
        heard: list[knotfab.Event] = []

        def fail(event: knotfab.Event, error=error, heard=heard) -> None:  # type: ignore[no-untyped-def]
            heard.append(event)
            if event.stage == "question":  # the folder is open by now
                raise error()

        with pytest.raises((ZeroDivisionError, KeyboardInterrupt, knotfab.SceneError)) as raised:
            knotfab.build("text:I", tmp_path / "out", progress=fail, accuracy="sketch")
        assert isinstance(raised.value, type(error()))
        assert [event.stage for event in heard][-1] == "question" and heard[0].stage == "picture"
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("radius", [0.0, -1.0, float("nan")])
def test_a_tube_has_a_radius(radius: float) -> None:
    ring = knotfab.Knot(np.array([[10.0, 0, 0], [0, 10, 0], [-10, 0, 0]]), "unknot")
    with pytest.raises(InputError, match="above 0"):
        knotfab.sweep_tube(ring, radius)
