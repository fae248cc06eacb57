"""What a scene by hand gets wrong is told with the line as it should be."""

import pytest

from knotfab_formats.errors import InputError
from knotfab_formats.read import parse_toml


@pytest.mark.parametrize(
    ("line", "mended"),
    [
        ("size_mm = 200,5", "size_mm = 200.5"),
        ("name = “mk4”", 'name = "mk4"'),
        (r'picture = "C:\Users\a.png"', r"picture = 'C:\Users\a.png'"),
        ("size_mm = 200 mm", "size_mm = 200"),
        ("lines = True", "lines = true"),
        ("ink = dark", 'ink = "dark"'),
        ("size_mm = –3", "size_mm = -3"),
    ],
)
def test_the_remedy_is_the_line_as_it_should_be(line: str, mended: str) -> None:
    with pytest.raises(InputError, match="not valid TOML") as caught:
        parse_toml(f"[a]\n{line}\nb = 1\n", "scene.toml")
    assert mended in str(caught.value)
