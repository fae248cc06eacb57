"""What tests of several validators leave out."""

import pytest


@pytest.fixture
def unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give no name to what is seen from the side, which takes half the time of verifying a view.

    No required check asks for it; test_compare and a whole verdict of test_validate do.
    """
    monkeypatch.setattr("knotfab_validators.shadows.verify_view.name_piece", lambda *_: None)


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search for fewer crossings no longer than finds them in the diagrams that have more than they need."""
    monkeypatch.setattr("knotfab_validators.knots.rerouting.WORK", 10_000)
