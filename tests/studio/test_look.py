"""What the page makes of readings of a picture."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from knotfab.options import BuildOptions
from knotfab.studio import look


def test_a_reading_that_the_page_has_no_field_for_is_not_offered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def reading(**keys: Any) -> Any:
        return SimpleNamespace(keys=keys, refusal=None, thumbnail=lambda: b"picture")

    found = [reading(ink="dark", speck_px=9), reading(subject_px=(1, 2, 30, 40))]
    monkeypatch.setattr(look, "list_readings", lambda *_: found)
    ways, thumbnails = look.list_ways(["photo.jpg"], BuildOptions(), {"smooth": "2"})
    assert len(ways) == len(thumbnails) == 1
    assert ways[0]["settings"]["ink"] == "dark" and ways[0]["settings"]["specks"] == 9
