"""The studio's state: pictures, settings, builds. All tabs share it, and it survives a restart."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from knotfab.apps.batch.worker import list_arguments
from knotfab.apps.studio.broadcast import Event, Listener, LiveBuild
from knotfab.apps.studio.builds import Builds, Record, child_of, describe_folder
from knotfab.apps.studio.fields import DEFAULTS, FIELDS, Settings, Value, in_page_words
from knotfab.apps.studio.pictures import StudioPicture, preview
from knotfab.base.disk import write_whole
from knotfab.base.errors import explain_error, keep_traceback
from knotfab.base.moves import REJECTED
from knotfab.base.pool import Workers
from knotfab.pipeline.options import BuildOptions
from knotfab_formats.errors import InputError

_PICTURES, _MEMORY = "pictures", "studio.json"
_NO_PREVIEW: dict[str, Any] = {"lines": [], "error": "", "panels": []}

_PHASES = {0: "done", 1: "rejected", 130: "stopped"}
_STOPPED = "Stopped; nothing was saved."


class _Memory(BaseModel):
    """What a studio finds again after a restart."""

    model_config = ConfigDict(extra="ignore")

    picture: StudioPicture | None = None
    settings: dict[str, Value] = dict(DEFAULTS)
    current: str = ""


class Studio:
    """The state of a studio whose files are in `folder`. It is changed only in the event loop's thread."""

    def __init__(self, folder: Path, warm: bool = True) -> None:
        self.status: dict[str, Any] = {"phase": "idle"}
        self.out = Path()  # the folder of the current or last build
        self.scene: str | None = None  # the last events of these kinds, for a tab opened later
        self.frame: str | None = None
        self.listeners: set[Listener] = set()
        self._reported = False  # whether the build wrote its report
        self.folder = folder
        self.builds = Builds(folder)
        self.picture: StudioPicture | None = None
        self.settings = Settings()
        self.current = ""  # the build that is shown
        self.preview: dict[str, Any] = dict(_NO_PREVIEW)
        self.panels: list[bytes] = []
        self.build: LiveBuild | None = None
        # a `warm` studio starts its process before the first build
        self.warm, self.builder = warm, Workers("knotfab.apps.builder", early=False)
        # pictures are added one by one, so that names stay unique
        self.adding = asyncio.Lock()
        self._previews = 0

    async def open(self) -> None:
        """Restore the state, and start a process for the first build."""
        self._remember()
        if self.picture is not None:
            self.renew()
        await asyncio.to_thread(self._prepare)

    async def close(self) -> None:
        """End every process."""
        if self.running and self.build is not None:
            await asyncio.to_thread(self.build.kill)
        await asyncio.to_thread(self.builder.__exit__)

    @property
    def picture_folder(self) -> Path:
        return self.folder / _PICTURES

    @property
    def running(self) -> bool:
        return self.status["phase"] in ("running", "stopping")

    def describe(self) -> dict[str, Any]:
        return {
            "build": self.status,
            "picture": self.picture and self.picture.model_dump(exclude={"file"}),
            "settings": self.settings.values,
            "wrong": self.settings.wrong,
            "preview": self.preview,
            "builds": self.builds.listed(),
            "current": self.current,
        }

    def folder_of(self, where: str) -> Path | None:
        return child_of(self.builds.folder, where)

    def plain(self, sentence: str) -> str:
        """Remove the studio's folders from a sentence, and put labels of fields in place of options."""
        for folder in (self.picture_folder, self.builds.folder, self.folder):
            sentence = sentence.replace(f"{folder}/", "")
        return in_page_words(sentence)

    def listen(self) -> Listener:
        """Add a listener, with the current state as its first message."""
        listener = Listener()
        listener.put(json.dumps({"event": "state", **self.describe()}))
        if self.scene is not None:
            listener.put(self.scene)
        if self.frame is not None:
            listener.put(self.frame, frame=True)
        self.listeners.add(listener)
        return listener

    def tell_state(self) -> None:
        """Send the state to every tab."""
        self.send(json.dumps({"event": "state", **self.describe()}))

    def send(self, text: str, frame: bool = False) -> None:
        for listener in self.listeners:
            listener.put(text, frame)

    def add_picture(self, picture: StudioPicture) -> None:
        """Show a picture in place of the one before, of which nothing stays."""
        if picture != self.picture:
            self.settings.forget_reading()
            self.picture, self.preview, self.panels = picture, dict(_NO_PREVIEW), []
        self.renew()

    def set(self, given: Mapping[str, Any]) -> None:
        """Change settings; None or "" resets one. A wrong one is marked, and its old value stays.

        Raises:
            InputError: there is no such setting, or a value is wrong.
        """
        changed = self.settings.change(given)
        if changed:
            self.renew()
        else:
            self.tell_state()  # marks may have changed
        for name in given:
            if name in self.settings.wrong:
                why = self.settings.wrong[name]["why"].rstrip(".")
                raise InputError(FIELDS[name], why, "")

    def _options(self) -> BuildOptions:
        return self.settings.options(self.picture is not None and self.picture.text is not None)

    def renew(self) -> None:
        """Save the state, send it to all tabs, and make a new preview."""
        self._previews += 1
        if self.picture is not None:
            self.preview = {**self.preview, "looking": True}
            asyncio.get_running_loop().create_task(self._look(self._previews))
        else:
            self.preview, self.panels = dict(_NO_PREVIEW), []
        self.keep()
        self.tell_state()

    async def _look(self, number: int) -> None:
        """Preview the chosen pictures, unless another preview was requested meanwhile."""
        await asyncio.sleep(0.15)
        if number != self._previews:
            return
        panels: list[bytes] = []
        sources, options = self._sources(), self._options()
        try:
            found, panels = await asyncio.to_thread(preview, sources, options)
        except Exception as error:
            told = explain_error(error) or keep_traceback(error)
            found = {**_NO_PREVIEW, "error": self.plain(str(told))}
        if number != self._previews:
            return
        found["lines"] = [self.plain(line) for line in found["lines"]]
        self._show_preview({**found, "number": number}, panels)

    def _show_preview(self, found: dict[str, Any], panels: list[bytes]) -> None:
        self.preview, self.panels = found, panels
        self.tell_state()

    def _sources(self) -> list[str]:
        return [] if self.picture is None else [self.picture.source(self.picture_folder)]

    def _prepare(self) -> None:
        if self.warm and not self.builder.ended.is_set():
            self.builder.start()

    def press(self) -> None:
        """Build the chosen picture.

        Raises:
            InputError: a build runs, nothing is chosen, or a field is wrong.
        """
        if self.running:
            raise InputError("the build", "one runs already", "Stop it first, or wait for it.")
        picture = self.picture
        if picture is None:
            raise InputError("the build", "no picture is chosen", "Drop one, or type a text.")
        if self.settings.wrong:
            fields = ", ".join(FIELDS[name] for name in self.settings.wrong)
            raise InputError(fields, "this is not right yet", "Correct what is marked, then build.")
        record = Record(title=picture.title, picture=picture, settings=dict(self.settings.values))
        # behind "--" nothing is taken for an option
        arguments = [*list_arguments(self._options()), "--", *self._sources()]
        name = self.builds.begin(picture.name, record)
        loop = asyncio.get_running_loop()
        out = self.builds.folder / name
        self.begin(out, self.builds.title_of(name))
        self.current = name

        def tell(event: Event) -> None:
            loop.call_soon_threadsafe(self.hear, event)

        self.build = LiveBuild(self.builder, arguments, out, tell)
        self.keep()
        self.tell_state()

    def stop(self) -> None:
        """Stop the running build."""
        # a second signal would interrupt its cleanup
        if self.status["phase"] == "running" and self.build is not None:
            self.status["phase"] = "stopping"
            self.build.stop()
            self.tell_state()

    def open_build(self, name: str) -> None:
        """Show an earlier build with its pictures and settings.

        Raises:
            InputError: a build runs, there is no such build, or its pictures are gone.
        """
        if self.running:
            raise InputError("the build", "one runs", "Stop it first, or wait for it.")
        record = self.builds.records.get(self.builds.require(name))
        self._show(name)
        if record is not None and record.picture is not None:
            picture = record.picture
            if not (self.picture_folder / picture.file).is_file():
                raise InputError(
                    f"the picture {picture.title}", "its file is gone", "Drop it again."
                )
            self.picture, self.settings = picture, Settings(record.settings)
        self.renew()

    def _show(self, name: str) -> None:
        found, record = self.builds.describe(name), self.builds.records.get(name)
        self.current, self.scene, self.frame = name, None, None
        self.status = {
            "phase": found["phase"], "name": name, "title": found["title"], "notes": [],
            "sentence": record.sentence if record else "", "share": 1.0, "left_s": 0,
        }  # fmt: skip
        if found["result"]:
            self.status["result"] = found["result"]

    def begin(self, out: Path, title: str) -> None:
        """Set the status to that of a build that starts, which will write the folder `out`."""
        self.scene = self.frame = None
        self.out, self._reported = out, False
        self.status = {
            "phase": "running", "name": out.name, "title": title, "stage": "start", "share": 0.0, "notes": [],
        }  # fmt: skip

    def hear(self, event: Event) -> None:
        """Update the status by an event of the build, and pass it on to all tabs."""
        kind, text = event["event"], json.dumps(event)
        if kind == "ended":
            self.end(event["code"], event["sentence"])
            return
        if kind == "end":
            self._reported = True
        elif kind == "knots":
            self.frame = text
        elif kind == "scene":
            self.scene = text
        elif kind == "stage":
            self.status |= {"stage": event["name"], "left_s": event["left_s"], "late": False}
            self.status.pop("fraction", None)
        elif kind == "progress":
            told = ("stage", "share", "left_s", "iou", "fraction", "late")
            self.status |= {key: event[key] for key in told if event.get(key) is not None}
        elif kind == "say":
            self.status["notes"] = [*self.status["notes"], self.plain(event["text"])][-40:]
        self.send(text, frame=kind == "knots")

    def end(self, code: int, sentence: str) -> None:
        """Set the status to that of a build that ended."""
        # stopped before it could tidy up, or after
        if self.status["phase"] == "stopping" and not self._reported and (code >= 128 or code == 1):
            code = 130
        self.status |= {"phase": _PHASES.get(code, "failed"), "exit_code": code, "left_s": 0}
        self.status["sentence"] = self.plain(sentence)
        if code == 130:
            self.status["sentence"] = _STOPPED
        report = self.out / ("" if code == 0 else REJECTED) / "report.json"
        # a report that this build did not write is an earlier one's
        if code == 0 or (code == 1 and self._reported and report.is_file()):
            self.status["share"] = 1.0
            self.status["result"] = describe_folder(self.out, code == 1)
        elif code == 1:
            self.status["phase"] = "failed"
        self.builds.end(self.current, self.status["phase"], self.status["sentence"])
        if self.current not in self.builds.names():
            self.current = ""
        self.keep()
        self.tell_state()
        asyncio.get_running_loop().create_task(asyncio.to_thread(self._prepare))

    def keep(self) -> None:
        """Save the state for a restart, if the disk has room."""
        memory = _Memory(
            picture=self.picture, settings=self.settings.values, current=self.current,
        )  # fmt: skip
        with contextlib.suppress(InputError):
            write_whole(self.folder / _MEMORY, memory.model_dump_json(indent=1).encode())

    def _remember(self) -> None:
        """Restore what `keep` saved, as far as its files are still there."""
        try:
            memory = _Memory.model_validate_json((self.folder / _MEMORY).read_bytes())
        except (OSError, ValueError):
            return
        picture = memory.picture
        if picture is not None and (self.picture_folder / Path(picture.file).name).is_file():
            self.picture = picture
        self.settings = Settings(memory.settings)
        if memory.current in self.builds.names():
            self._show(memory.current)
