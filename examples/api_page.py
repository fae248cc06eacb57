"""Write docs/api.md from the docstrings of what `import knotfab` offers: `python -m examples.api_page`."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path

import knotfab

PAGE = Path(__file__).resolve().parents[1] / "docs" / "api.md"
_HEAD = """# The public API

Made from the docstrings by `python -m examples.api_page`. Everything here is `from knotfab import …`, loaded
when it is first used. `examples/stages.py` is a script that uses nothing else.

```python
import knotfab

result = knotfab.build("cat.png", "out", mount="wall")
print(result.exit_code, result.folder, result.report["views"][0]["iou"])
```

In a notebook a result shows itself: the words of its verdict, picture and shadow, and the part from four
sides. So does what each stage returns. `progress=` takes a function, which is called with each `Event` of a
build, such as `lambda event: print(f"{event.stage}: {event.share:.0%}, {event.left_s} s left")`. What it
raises ends the build, as Ctrl-C does, and nothing stays half-written.
"""


def api_page() -> str:
    """The page in Markdown: functions first, then data, then errors."""
    found = {name: getattr(knotfab, name) for name in knotfab.__all__}
    functions = {n: f for n, f in found.items() if inspect.isfunction(f)}
    errors = {n: e for n, e in found.items() if isinstance(e, type) and issubclass(e, Exception)}
    data = {n: d for n, d in found.items() if n not in functions and n not in errors}
    parts = [_HEAD]
    for title, group in (("Functions", functions), ("Data", data), ("Errors", errors)):
        parts.append(f"## {title}\n")
        parts += [_entry(name, thing) for name, thing in group.items()]
    return "\n".join(parts)


def _entry(name: str, thing: object) -> str:
    """One function or class: its signature and its docstring as it stands."""
    lines = [f"### {name}\n"]
    if inspect.isfunction(thing):
        lines.append(f"```python\n{name}{inspect.signature(thing)}\n```\n")
    elif dataclasses.is_dataclass(thing):
        fields = "\n".join(f"    {f.name}: {f.type}" for f in dataclasses.fields(thing))
        lines.append(f"```python\nclass {name}:\n{fields}\n```\n")
    lines.append(f"```text\n{inspect.getdoc(thing)}\n```\n")
    return "\n".join(lines)


def main() -> None:
    """Write the page."""
    PAGE.write_text(api_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
