"""What the studio knows: pictures, settings, the build that runs. Every tab shows it, none owns it."""

from __future__ import annotations

import asyncio
import hashlib
import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotfab.batch.tasks import list_arguments
from knotfab.batch.worker import read_report
from knotfab.errors import InputError, KnotfabError
from knotfab.files.folder import REJECTED
from knotfab.files.whole import write_whole
from knotfab.options import BuildOptions, options_from
from knotfab.prepare import check_options, survey_pictures
from knotfab.scene.catalogue import materials, printers
from knotfab.studio.live_build import Event, LiveBuild, Spare
from knotfab.studio.pictures import StudioPicture

__all__ = ["BUILDS", "SHOWN_FILES", "Listener", "Studio", "child_of"]

BUILDS = "builds"
_STARTS, _PICTURES = "starts", "pictures"
_MOST_PICTURES = 4
_LONGEST_NAME = 80  # characters of a build's folder
# the options of `knotfab build` that the page sets; none of them names a file
SETTINGS = (
    "width", "height", "lamp_distance", "wall_distance", "lamp_diameter", "tube_radius", "depth",
    "knots", "knot", "mount", "printer", "material", "accuracy", "time_budget", "ink", "invert",
    "threshold", "thicken", "lines", "tone", "smooth", "keep_largest", "seed", "print",
)  # fmt: skip
_DEFAULTS: dict[str, Any] = {"print": True, "mount": "auto", "accuracy": "standard"}
# of a build's folder, in the order in which a person wants them
SHOWN_FILES = (
    "part.3mf", "part.stl", "part.glb", "part-colours.3mf", "coupon.3mf", "setup.pdf",
    "report.html", "report.json", "scene.toml", "knots.json", "slicer.ini",
)  # fmt: skip


@dataclass(eq=False)
class Listener:
    """What is to be sent to one tab: every message in its order, but of the frames only the latest."""

    messages: deque[str] = field(default_factory=deque)
    frame: str | None = None
    woken: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, text: str, frame: bool = False) -> None:
        if frame:
            self.frame = text
        else:
            self.messages.append(text)
        self.woken.set()

    async def next(self) -> list[str]:
        """Wait until there is something to send."""
        await self.woken.wait()
        self.woken.clear()
        found = [*self.messages, *([] if self.frame is None else [self.frame])]
        self.messages.clear()
        self.frame = None
        return found


class Studio:
    """The state of a studio whose files lie in `folder`; all of it is changed in the event loop's thread."""

    watching = False  # it may be changed from the page

    def __init__(self, folder: Path, warm: bool = True) -> None:
        self.folder = folder
        self.pictures: dict[str, StudioPicture] = {}
        self.chosen: tuple[str, ...] = ()
        self.settings: dict[str, Any] = dict(_DEFAULTS)
        self.preview: dict[str, Any] = {"lines": [], "error": ""}
        self.preview_png = b""
        self.build: LiveBuild | None = None
        self.builds = folder / BUILDS
        self.out = self.builds  # of the build that runs, or ran last
        self.status: dict[str, Any] = {"phase": "idle"}
        self.scene: str | None = None  # the last event of its kind, for a tab that comes later
        self.frame: str | None = None
        self.start = ""  # knots to go on from
        self.spare = Spare(warm)
        self.listeners: set[Listener] = set()
        self._previews = 0
        self._pressed = 0.0
        self._reported = False  # the build got as far as its report

    async def open(self) -> None:
        """Make the folder, and a process that waits for the first build."""
        await asyncio.to_thread(self.spare.prepare)

    async def close(self) -> None:
        """End every process."""
        self.spare.warm = False
        self.spare.close()
        if self.running and self.build is not None:
            await asyncio.to_thread(self.build.kill)

    @property
    def running(self) -> bool:
        return self.status["phase"] in ("running", "stopping")

    @property
    def picture_folder(self) -> Path:
        return self.folder / _PICTURES

    def describe(self) -> dict[str, Any]:
        """All of it, for a page that was opened or loaded anew."""
        return {
            "pictures": [
                {"name": p.name, "text": p.source.startswith("text:"), "size": [p.width, p.height]}
                for p in self.pictures.values()
            ],
            "chosen": self.chosen,
            "settings": self.settings,
            "preview": self.preview,
            "build": {**self.status, "can_go_on": bool(self.start)},
            "builds": self.list_builds(),
            "watching": self.watching,
        }

    def folder_of(self, where: str) -> Path | None:
        """The folder of a build, found by the names of what is really there; None where there is none."""
        return child_of(self.builds, where)

    def listen(self) -> Listener:
        """A listener, which is told at once how things stand."""
        listener = Listener()
        listener.put(json.dumps({"event": "state", **self.describe()}))
        if self.scene is not None:
            listener.put(self.scene)
        if self.frame is not None:
            listener.put(self.frame, frame=True)
        self.listeners.add(listener)
        return listener

    def add_picture(self, picture: StudioPicture, beside: bool = False) -> None:
        """Take a picture in and choose it, in place of the others or beside them as a further view."""
        names = [*self.chosen, picture.name] if beside else [picture.name]
        if len(set(names)) > _MOST_PICTURES:
            raise InputError("the pictures", f"there are {len(names)}", "Take up to 4 views.")
        self.pictures[picture.name] = picture
        self.choose(names)

    def choose(self, names: Sequence[str]) -> None:
        """Choose the pictures, one a view.

        Raises:
            InputError: there is none of such a name.
        """
        names = tuple(dict.fromkeys(names))[:_MOST_PICTURES]
        for name in names:
            if name not in self.pictures:
                raise InputError(
                    f"the picture {name}", "there is none of that name", "Drop it again."
                )
        self.chosen = names
        self.renew()

    def set(self, given: Mapping[str, Any]) -> None:
        """Change settings; None or "" takes one back.

        Raises:
            InputError: there is no such setting, or its value is wrong.
        """
        wanted = dict(self.settings)
        for name, value in given.items():
            if name not in SETTINGS or not isinstance(value, str | int | float | bool | None):
                raise InputError(
                    f"the setting {name}", "there is none of that name", "Leave it out."
                )
            if value is None or value == "":
                wanted.pop(name, None)
            else:
                wanted[name] = value
        for name, known in (("printer", printers()), ("material", materials())):
            if name in wanted and wanted[name] not in known:
                raise InputError(f"the {name} {wanted[name]}", "it is not known", "Choose another.")
        check_options(options_from(wanted))
        self.settings = wanted
        self.renew()

    def renew(self) -> None:
        """Tell all tabs how things stand, and look at the pictures anew."""
        self._previews += 1
        if self.chosen:
            asyncio.get_running_loop().create_task(self._look(self._previews))
        else:
            self.preview, self.preview_png = {"lines": [], "error": ""}, b""
        self.tell_state()

    async def _look(self, number: int) -> None:
        """The preview of what is chosen; of several in a row only the last is made."""
        await asyncio.sleep(0.15)
        if number != self._previews:
            return
        sources, options = self._sources(), options_from(self.settings)
        try:
            found, png = await asyncio.to_thread(_preview, sources, options)
        except KnotfabError as error:
            found, png = {"lines": [], "error": self._plain(str(error))}, b""
        if number == self._previews:
            self.preview, self.preview_png = {**found, "number": number}, png
            self.tell_state()

    def _sources(self) -> list[str]:
        return [self.pictures[name].source for name in self.chosen]

    def press(self, go_on: bool = False) -> None:
        """Build what is chosen; `go_on`: from where the knots of the last build stood.

        Raises:
            InputError: a build runs already, nothing is chosen, or there are no knots to go on from.
        """
        if self.running:
            raise InputError("the build", "one runs already", "Stop it first, or wait for it.")
        if not self.chosen:
            raise InputError("the build", "no picture is chosen", "Drop one, or type a text.")
        if go_on and not self.start:
            raise InputError("the build", "there are no knots to go on from", "Build it anew.")
        name = "-and-".join(self.chosen)
        if len(name) > _LONGEST_NAME or tuple(name.split("-and-")) != self.chosen:
            digest = hashlib.sha256(repr(self.chosen).encode()).hexdigest()[:8]
            name = f"{name[:_LONGEST_NAME]}-{digest}"
        arguments = [*self._sources(), *list_arguments(options_from(self.settings))]
        if go_on:
            start = self.folder / _STARTS / f"{name}.json"
            write_whole(start, self.start.encode())
            arguments.append(f"--start={start}")
        loop = asyncio.get_running_loop()

        def tell(event: Event) -> None:
            loop.call_soon_threadsafe(self._hear, event)

        self.scene = self.frame = None
        self._pressed = time.monotonic()
        self.status = {
            "phase": "running",
            "name": name,
            "stage": "start",
            "share": 0.0,
            "notes": [],
        }
        self._reported = False
        self.out = self.builds / name
        try:
            self.build = LiveBuild(self.spare, arguments, self.out, tell)
        except OSError as error:
            why = f"The build cannot be started ({error.strerror}): try again."
            self.status |= {"phase": "failed", "exit_code": 3, "sentence": why, "left_s": 0}
        self.tell_state()

    def stop(self) -> None:
        """Stop the build that runs; where its knots stand is kept."""
        # a second signal would break into its tidying up
        if self.status["phase"] == "running" and self.build is not None:
            self.status["phase"] = "stopping"
            self.build.stop()
            self.tell_state()

    def _hear(self, event: Event) -> None:
        """Take note of an event of the build, and pass it on."""
        kind = event["event"]
        if kind == "standing":
            self.start = event["start"]
            return
        if kind == "ended":
            self._end(event["code"], event["sentence"])
            return
        text = json.dumps(event)
        if kind == "end":
            self._reported = True
        if kind == "knots":
            if self.frame is None:
                self.status["first_frame_s"] = round(time.monotonic() - self._pressed, 3)
            self.frame = text
        elif kind == "scene":
            self.scene = text
        elif kind == "stage":
            self.status |= {"stage": event["name"], "left_s": event["left_s"]}
        elif kind == "progress":
            kept = {k: event[k] for k in ("stage", "share", "left_s") if event[k] is not None}
            self.status |= kept
            if event["iou"] is not None:
                self.status["iou"] = event["iou"]
        elif kind == "say":
            self.status["notes"] = [*self.status["notes"], event["text"]][-40:]
        self._send(text, frame=kind == "knots")

    def _end(self, code: int, sentence: str) -> None:
        """How a build ended, in a word and a sentence."""
        # before it could tidy up, or after
        if self.status["phase"] == "stopping" and not self._reported and (code >= 128 or code == 1):
            code = 130
        phases = {0: "done", 1: "rejected", 130: "stopped"}
        self.status["phase"] = phases.get(code, "failed")
        self.status |= {"exit_code": code, "sentence": self._plain(sentence), "left_s": 0}
        if code == 130:
            self.status["sentence"] = "Stopped; what was built before is as it was."
        report = self.out / ("" if code == 0 else REJECTED) / "report.json"
        # a report that this build did not write is an earlier one's
        if code == 0 or (code == 1 and self._reported and report.is_file()):
            self.status["share"] = 1.0
            where = self.out.name + ("" if code == 0 else f"/{REJECTED}")
            self.status["result"] = self._result(where)
        elif code == 1:
            self.status["phase"] = "failed"
        self.tell_state()
        asyncio.get_running_loop().create_task(asyncio.to_thread(self.spare.prepare))

    def _plain(self, sentence: str) -> str:
        """A sentence without this machine's folders."""
        return sentence.replace(f"{self.picture_folder}/", "").replace(f"{self.folder}/", "")

    def list_builds(self) -> list[dict[str, Any]]:
        """The builds that passed, the newest first."""
        try:
            found = sorted(self.builds.glob("*/report.json"), key=lambda p: -p.stat().st_mtime)
        except OSError:
            return []
        return [self._result(path.parent.name) for path in found[:24]]

    def _result(self, where: str) -> dict[str, Any]:
        """A folder of a build: what it holds, and the figures that a person asks for first."""
        folder = self.builds / where
        held = {p.name for p in folder.iterdir() if p.is_file()}
        rest = sorted(n for n in held if n.endswith((".pdf", ".csv")) or n.startswith("plate-"))
        report = read_report(folder) or {}
        views, piece = report.get("views", []), report.get("print", {})
        return {
            "where": where,
            "verdict": (report.get("verdict") or {}).get("word"),
            "reasons": (report.get("verdict") or {}).get("reasons", []),
            "ious": [view.get("iou") for view in views],
            "hours": None if piece.get("time_s") is None else piece["time_s"] / 3600,
            "mass_g": piece.get("filament_g") or piece.get("mass_g"),
            "size_mm": piece.get("bounding_box_mm"),
            "files": list(dict.fromkeys([*(n for n in SHOWN_FILES if n in held), *rest])),
            "compare": sorted(n for n in held if n.startswith("compare-") and n.endswith(".png")),
        }

    def tell_state(self) -> None:
        """Send the state to every tab."""
        self._send(json.dumps({"event": "state", **self.describe()}))

    def _send(self, text: str, frame: bool = False) -> None:
        for listener in self.listeners:
            listener.put(text, frame)


def child_of(folder: Path, name: str) -> Path | None:
    """What is really there by that name, so that no path leads elsewhere: no link, nothing hidden."""
    try:
        names = {path.name for path in folder.iterdir() if not path.is_symlink()}
    except OSError:
        return None
    return folder / name if name in names and not name.startswith(".") else None


def _preview(sources: Sequence[str], options: BuildOptions) -> tuple[dict[str, Any], bytes]:
    """The figures, and the picture of what tubes lose."""
    from knotfab.preview.draw import draw_survey
    from knotfab.preview.sentence import list_figures

    found = survey_pictures(sources, options)
    return {**list_figures(found), "error": ""}, draw_survey(found)
