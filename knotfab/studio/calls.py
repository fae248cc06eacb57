"""Calls of the page: the body of each, and what the studio does with it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from knotfab.studio.builds import Kind
from knotfab.studio.pictures import keep_text
from knotfab.studio.session import Studio

__all__ = ["CALLS", "Call"]

_Name = Annotated[str, Field(max_length=200)]


class Call(BaseModel):
    """The body of a call, as JSON; what else stands in it is refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    async def do(self, studio: Studio) -> dict[str, Any]:
        """Change the studio, and return what the page needs to know."""
        raise NotImplementedError


class _Text(Call):
    text: str

    async def do(self, studio: Studio) -> dict[str, Any]:
        async with studio.adding:
            font = str(studio.settings.values.get("font", "")) or None
            kept = await asyncio.to_thread(keep_text, self.text, studio.picture_folder, font)
            studio.add_picture(kept)
        return {"name": kept.name}


class _Choose(Call):
    names: Annotated[tuple[_Name, ...], Field(strict=False)]
    kind: Kind | None = None

    async def do(self, studio: Studio) -> dict[str, Any]:
        studio.choose(self.names, self.kind)
        return {}


class _Build(Call):
    go_on: bool = False

    async def do(self, studio: Studio) -> dict[str, Any]:
        studio.press(self.go_on)
        return {}


class _Named(Call):
    """A call about one picture or one build."""

    name: _Name


def _of_name(act: Callable[[Studio, str], None]) -> type[Call]:
    class Act(_Named):
        async def do(self, studio: Studio) -> dict[str, Any]:
            act(studio, self.name)
            return {}

    return Act


class _Cut(_Named):
    """A try of a subject: it changes nothing."""

    subject: str
    keep: str = ""
    drop: str = ""

    async def do(self, studio: Studio) -> dict[str, Any]:
        return await studio.cut(self.name, self.subject, self.keep, self.drop)


class _Rename(_Named):
    title: _Name

    async def do(self, studio: Studio) -> dict[str, Any]:
        studio.rename(self.name, self.title)
        return {}


class _Stop(Call):
    async def do(self, studio: Studio) -> dict[str, Any]:
        studio.stop()
        return {}


class _Settings(Call):
    model_config = ConfigDict(extra="allow", strict=True)

    async def do(self, studio: Studio) -> dict[str, Any]:
        studio.set(self.model_extra or {})
        return {}


# The page asks these below /api/.
CALLS: dict[str, type[Call]] = {
    "text": _Text,
    "choose": _Choose,
    "settings": _Settings,
    "cut": _Cut,
    "build": _Build,
    "stop": _Stop,
    "open": _of_name(Studio.open_build),
    "rename": _Rename,
    "delete": _of_name(Studio.delete),
    "remove": _of_name(Studio.remove_picture),
}
