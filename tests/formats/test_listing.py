"""What is told of a scene's keys: each has a sentence, and docs/scene.toml lists what the models declare."""

import tomllib
from pathlib import Path

import pytest

from knotfab_formats.bounds import option_of, sentences_of, values_of
from knotfab_formats.read import list_keys, list_tables
from knotfab_formats.scene import Scene

LISTED = Path(__file__).parents[2] / "docs" / "scene.toml"
LIST = "from knotfab_formats.read import list_keys; print(list_keys(), end='')"


def test_the_keys_are_listed_as_they_are_declared() -> None:
    assert LISTED.read_text("utf-8") == list_keys(), f'run python -c "{LIST}" > docs/scene.toml'


def test_the_listing_is_a_scene_with_every_default() -> None:
    raw = tomllib.loads(list_keys())
    assert Scene.model_validate({**raw, "pose": None, "search": {}}) == Scene()


@pytest.mark.parametrize("table", [t for t in list_tables() if t not in ("pose", "search")])
def test_a_word_beside_numbers_is_read_as_no_text_and_written_as_that_word(table: str) -> None:
    model = list_tables()[table]
    for key in model.model_fields:
        for word in values_of(model, key):
            read = model.model_validate({key: word})
            assert not isinstance(getattr(read, key), str)
            assert model.model_validate({key: getattr(read, key)}) == read
            assert read.model_dump()[key] == read.model_dump(mode="json")[key] == word


@pytest.mark.parametrize("table", [t for t in list_tables() if t != "pose"])
def test_every_key_has_a_sentence(table: str) -> None:
    model = list_tables()[table]
    assert set(sentences_of(model)) == set(model.model_fields)
    assert all(said[0] != " " and said.endswith(".") for said in sentences_of(model).values())


def test_no_two_keys_have_one_option() -> None:
    options = [option_of(m, key) for m in list_tables().values() for key in m.model_fields]
    given = [one for one in options if one is not None]
    assert len(given) == len(set(given)) > 30
