"""What tests of several validators leave out."""

import pytest


@pytest.fixture
def unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give no name to what is seen from the side, which takes half the time of verifying a view.

    No required check asks for it; test_compare and a whole verdict of test_validate do.
    """
    monkeypatch.setattr("knotfab_validators.shadows.verify_view.name_piece", lambda *_: None)
