"""Runs of points that nothing searched for: what they take and reach follows from their settings alone."""

import base64
import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from PIL import Image

from knotfab.apps.tradeoff.bench import WantedRun
from knotfab.apps.tradeoff.measure import Run
from knotfab.apps.tradeoff.points import Measured, Point
from knotfab_formats.search import SearchSettings

_FILE = io.BytesIO()
Image.new("L", (1, 1)).save(_FILE, "PNG")
DOT = base64.b64encode(_FILE.getvalue()).decode()


def make_run(cpu_s: float, iou: float, feasible: bool = True, curvature: float = 0.2) -> Run:
    return Run(
        radius_mm=2.0,
        radius_s=0.1,
        search_s=cpu_s,
        sweep_s=0.1,
        cpu_s=cpu_s,
        feasible=feasible,
        repairs=0,
        faces=100,
        facet_px=0.1,
        iou=iou,
        outline_px=1.0,
        curvature=curvature,
        legible=0.4,
        shadow=DOT,
    )


def make_measured(iou: float, seconds: float, feasible: bool = True, **more: float) -> Measured:
    """One picture's; the settings differ by the seed."""
    seed = int(1e6 * iou) + 10**7 * int(1e3 * seconds)
    point = Point("iterations", f"{iou} in {seconds}", SearchSettings(seed=seed))
    return Measured(point, (make_run(seconds, iou, feasible, **more),))


@dataclass(frozen=True)
class FakeStudy:
    """A picture by name; runs are kept under what they were asked for."""

    name: str
    content: str = ""
    device: str = "cpu"

    def key(self, settings: SearchSettings, turn: int = 0) -> str:
        told = f"{self.name}{self.content}{settings}{turn}"
        return hashlib.sha256(told.encode()).hexdigest()


@dataclass
class FakeRunner:
    """Takes a request at a time, each so many seconds of its own clock; breaks off after `most`."""

    seconds: float = 10.0
    most: int = 10**9
    now: float = 0.0
    asked: list[WantedRun] = field(default_factory=list)

    def clock(self) -> float:
        return self.now

    def __call__(self, requests: Iterator[WantedRun]) -> Iterator[tuple[WantedRun, Run]]:
        for request in requests:
            if len(self.asked) == self.most:
                raise KeyboardInterrupt
            self.asked.append(request)
            self.now += self.seconds
            settings = request.settings
            work = settings.iterations * settings.fine_px**2 / settings.edge_radii / 1e7
            # more of anything is better, but for luck; a picture is as hard as it is
            luck = int(hashlib.sha256(str(settings).encode()).hexdigest()[:4], 16) / 0xFFFF
            missing = 0.002 * (1 + request.picture) + (0.01 + 0.01 * luck) / (1 + work)
            yield request, make_run(1.0 + work, 1.0 - missing)


def beaten_by(one: Measured, others: Sequence[Measured]) -> float:
    """The factor by which another point is faster at no more error, or better in no more time; 1: none is."""
    factor = 1.0
    for other in others:
        if other.error <= one.error:
            factor = max(factor, one.seconds / other.seconds)
        if other.seconds <= one.seconds:
            factor = max(factor, one.error / other.error)
    return factor
