"""Write docs/api.md, a line for each name that `import knotfab` offers, and docs/scene.toml, its keys with
their defaults: `python -m examples.api_page`.

As a hook of mkdocs it also gives the site what is made from code: each name's whole docstring, and the keys
of scene.toml with their defaults.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

import knotfab
from knotfab_formats.bounds import as_written, sentences_of, words_of
from knotfab_formats.read import list_tables
from knotfab_formats.search import OF_NO_PRESET

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, KEYS = DOCS / "api.md", DOCS / "scene.toml"
_WIDTH = 118
_POSE = """[pose]  # From print coordinates to the scene, written by a build.
matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"""
_HEAD = """# The public API

Everything here is `from knotfab import …`, loaded when it is first used. `help(knotfab.build)` prints
arguments, results and errors of each name; the site (`make docs`) shows them on this page.
`examples/stages.py` uses nothing else.

```python
import knotfab

result = knotfab.build("cat.png", "out", mount="wall")
print(result.exit_code, result.folder, result.report["views"][0]["iou"])
```

`progress=` takes a function, which is called with each `Event` of a build, such as
`lambda event: print(f"{event.stage}: {event.share:.0%}, {event.left_s} s left")`. What it raises ends the
build, as Ctrl-C does, and nothing stays half-written.
"""


def api_page(entry: Callable[[str, object], str] | None = None) -> str:
    """Return the page in Markdown: functions first, then data, then errors.

    Args:
        entry: what stands for each name; by default a row of a table.
    """
    found = {name: getattr(knotfab, name) for name in knotfab.__all__}
    functions = {n: f for n, f in found.items() if inspect.isfunction(f)}
    errors = {n: e for n, e in found.items() if isinstance(e, type) and issubclass(e, Exception)}
    data = {n: d for n, d in found.items() if n not in functions and n not in errors}
    parts = [_HEAD]
    for title, group in (("Functions", functions), ("Data", data), ("Errors", errors)):
        parts.append(f"## {title}\n" if entry else f"| {title} | |\n|---|---|")
        parts += [(entry or _row)(name, thing) for name, thing in group.items()]
        parts += [] if entry else [""]
    return "\n".join(parts)


def _row(name: str, thing: object) -> str:
    """Return one function or class: its parameters, and the first sentence of its docstring."""
    call = ""
    if inspect.isfunction(thing):
        plain = [
            p.replace(annotation=p.empty) for p in inspect.signature(thing).parameters.values()
        ]
        call = str(inspect.Signature(plain))
    first = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")
    return f"| `{name}{call}` | {first.replace('|', chr(92) + '|')} |"


def _entry(name: str, thing: object) -> str:
    """Return one function or class: its signature and its docstring as it stands."""
    lines = [f"### {name}\n"]
    if inspect.isfunction(thing):
        lines.append(f"```python\n{name}{inspect.signature(thing)}\n```\n")
    elif dataclasses.is_dataclass(thing):
        fields = "\n".join(f"    {f.name}: {f.type}" for f in dataclasses.fields(thing))
        lines.append(f"```python\nclass {name}:\n{fields}\n```\n")
    lines.append(f"```text\n{inspect.getdoc(thing)}\n```\n")
    return "\n".join(lines)


def list_keys() -> str:
    """List every key with its default and its sentence, as TOML."""
    tables = [
        "\n".join(_list_table(name, model))
        for name, model in list_tables().items()
        if name != "pose"
    ]
    return "\n\n".join(["schema = 1", *tables, _POSE]) + "\n"


def _list_table(name: str, model: type[BaseModel]) -> Iterator[str]:
    head = "[[views]]" if name == "views" else f"[{name}]"
    yield f"{head}  # {(model.__doc__ or '').strip().splitlines()[0]}"
    said = sentences_of(model)
    for key, field in model.model_fields.items():
        if name == "search" and key not in OF_NO_PRESET:  # the schema lists them
            continue
        words, told = words_of(model, key), said[key]
        default = as_written(model, key, field.default)
        value = json.dumps(default, ensure_ascii=False)
        shown = f"# {key} = …" if default is None else f"{key} = {value}"
        if len(words) > 1 and not all(word in told for word in words):
            told = f"{' | '.join(map(json.dumps, words))}. {told}"
        yield from textwrap.wrap(
            f"{shown}  # {told}", _WIDTH, subsequent_indent="    # ", break_long_words=False
        )


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return what mkdocs shows of a page: here the two that are made from code have all of it."""
    if page.file.src_uri == PAGE.name:
        return api_page(_entry)
    if page.file.src_uri == "conventions.md":
        return f"{markdown}\n```toml\n{KEYS.read_text('utf-8')}```\n"
    return markdown


def main() -> None:
    """Write both."""
    PAGE.write_text(api_page(), encoding="utf-8")
    KEYS.write_text(list_keys(), encoding="utf-8")


if __name__ == "__main__":
    main()
