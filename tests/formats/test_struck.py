"""Old words end with one sentence that tells the way out, or are read past where they asked for nothing."""

import pytest

from knotfab_formats import struck
from knotfab_formats.errors import InputError
from knotfab_formats.struck import Struck

OLD = {"--old": Struck("Do that", ("off",)), "--flag": Struck("Do this", flag=True)}


@pytest.fixture(autouse=True)
def _words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(struck, "OPTIONS", OLD)
    keys = {("views", "old"): OLD["--old"], ("gone", ""): Struck("Leave it out", ({},))}
    monkeypatch.setattr(struck, "KEYS", keys)
    monkeypatch.setattr(struck, "COMMANDS", {"serve": Struck("Use build")})


@pytest.mark.parametrize(
    ("given", "left"),
    {
        ("build", "a.png", "--old", "off"): ["build", "a.png"],
        ("build", "--old=off", "a.png"): ["build", "a.png"],
        ("build", "--", "--old"): ["build", "--", "--old"],
        ("build", "--older", "x"): ["build", "--older", "x"],
        ("build", "--old", "on"): None,
        ("build", "--old"): None,
        ("build", "--flag", "a.png"): None,
    }.items(),
)
def test_options(given: tuple[str, ...], left: list[str] | None) -> None:
    if left is not None:
        assert struck.pass_options(given) == left
        return
    with pytest.raises(InputError, match=r"knotfab 2 does not have it\. Do th"):
        struck.pass_options(given)


def test_options_by_name() -> None:
    assert struck.pass_given({"old": "off", "flag": False, "size": 3}) == {"size": 3}
    with pytest.raises(InputError, match="the option old: knotfab 2"):
        struck.pass_given({"old": "on"})


def test_keys() -> None:
    raw = {"views": [{"old": "off", "name": "a"}, {"name": "b"}], "gone": {}, "piece": {}}
    assert struck.pass_keys(raw, "s") == {"views": [{"name": "a"}, {"name": "b"}], "piece": {}}
    assert raw["views"][0]["old"] == "off"  # what was given stays as it was
    for wrong in ({"views": [{}, {"old": "on"}]}, {"gone": {"a": 1}}):
        with pytest.raises(InputError, match=r"s: \[(views\] old|gone\]): knotfab 2"):
            struck.pass_keys(wrong, "s")
    assert struck.pass_keys({"views": 3}, "s") == {"views": 3}  # for the reader to refuse


def test_commands() -> None:
    with pytest.raises(InputError, match=r"knotfab serve: knotfab 2 does not have it\. Use build"):
        struck.refuse_command(["serve", "--port"])
    struck.refuse_command(["build", "serve"])
    struck.refuse_command([])
