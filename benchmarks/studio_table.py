"""What the studio costs: the first frame after the press, builds beside the command line's, frames a second.

    python -m benchmarks.studio_table [--repeats 3] [--picture examples/knight.png] [--accuracy draft]

Only ratios count where other work runs on the machine: builds take turns, and their medians are compared.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from urllib.request import Request, urlopen

import uvicorn
from websockets.sync.client import ClientConnection, connect

from benchmarks.measurement import run_study
from knotfab.knots import read_start
from knotfab.report.report_html import VIEWER
from knotfab.scene.load import load_scene
from knotfab.studio.server import make_app
from knotfab.studio.session import Studio

TOKEN = "a-token"
SETTINGS = {"print": True, "mount": "auto"}
FPS_S = 4.0


@contextmanager
def serve(folder: Path) -> Iterator[tuple[Studio, str]]:
    """A studio that runs, and where."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        host = f"127.0.0.1:{listening.getsockname()[1]}"
        studio = Studio(folder)
        config = uvicorn.Config(make_app(studio, TOKEN, (host,)), log_level="error")
        server = uvicorn.Server(config)
        serving = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
        serving.start()
        while not server.started:
            time.sleep(0.05)
        try:
            yield studio, host
        finally:
            server.should_exit = True
            serving.join()


def post(host: str, path: str, body: bytes) -> None:
    headers = {"origin": f"http://{host}", "cookie": cookie(host)}
    with urlopen(Request(f"http://{host}{path}", body, headers)) as answer:
        answer.read()


def cookie(host: str) -> str:
    return f"knotfab-{host.rpartition(':')[2]}={TOKEN}"


def build_in_studio(host: str, live: ClientConnection) -> tuple[float, float, int]:
    """Seconds to the first frame and to the end, and the frames that came."""
    pressed, first, frames = time.perf_counter(), 0.0, 0
    post(host, "/api/build", b"{}")
    while True:
        event = json.loads(live.recv())
        if event["event"] == "knots":
            frames += 1
            first = first or time.perf_counter() - pressed
        if event["event"] == "state" and event["build"]["phase"] in ("done", "rejected"):
            return first, time.perf_counter() - pressed, frames
        if event["event"] == "state" and event["build"]["phase"] == "failed":
            raise SystemExit(event["build"]["sentence"])


def build_by_command(picture: Path, accuracy: str, out: Path) -> float:
    call = [sys.executable, "-m", "knotfab", "build", str(picture), "--print", "--mount=auto"]
    begun = time.perf_counter()
    subprocess.run([*call, f"--accuracy={accuracy}", f"--out={out}", "--quiet"], check=False)
    return time.perf_counter() - begun


# what draws: a processor alone (SwiftShader, llvmpipe) or a graphics card
RENDERER = """() => {
  const context = document.createElement("canvas").getContext("webgl2");
  const told = context.getExtension("WEBGL_debug_renderer_info");
  return context.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : context.RENDERER);
}"""


def frames_a_second(start: Path, scene: Path) -> str:
    """Of the viewer in a browser without a build beside it: turned, its lamp moved, its curves set anew."""
    chromium = shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return "no playwright here"
    if chromium is None:
        return "no chromium here"
    knots = read_start(start)
    curves = [knot.points.round(3).tolist() for knot in knots.knots]
    views = [view.model_dump(mode="json", exclude={"picture"}) for view in load_scene(scene).views]
    data = {"unit": "mm", "radius": knots.radius_mm, "curves": curves, "views": views}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.set_content("<div id=here style='height:560px'></div>")
        page.add_script_tag(path=str(VIEWER))
        renderer = str(page.evaluate(RENDERER))
        found = page.evaluate(
            """async ([data, seconds]) => {
                 const viewer = KnotfabViewer.mount(document.getElementById("here"), data);
                 const count = (act) => new Promise((done) => {
                   const begun = performance.now();
                   let frames = 0;
                   const step = () => {
                     act(frames++);
                     const took = (performance.now() - begun) / 1000;
                     took < seconds ? requestAnimationFrame(step) : done(frames / took);
                   };
                   requestAnimationFrame(step);
                 });
                 const key = () => document.getElementById("here").shadowRoot.querySelector("canvas")
                   .dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", cancelable: true }));
                 return [await count(key), await count(() => viewer.setLamp({ height: 20 * Math.random() })),
                   await count(() => viewer.setCurves(data.curves, data.radius))];
               }""",
            [data, FPS_S],
        )
        browser.close()
    turned, lit, anew = found
    software = any(word in renderer.lower() for word in ("swiftshader", "llvmpipe", "softpipe"))
    return (
        f"turned {turned:.1f}, its lamp moved {lit:.1f}, its curves set anew {anew:.1f}, with "
        f"{len(knots.points)} vertices, drawn in {'software' if software else 'hardware'} ({renderer})"
    )


def main(
    *, repeats: int = 3, picture: Path = Path("examples/knight.png"), accuracy: str = "draft"
) -> None:
    firsts, studios, commands, counts = [], [], [], []
    with tempfile.TemporaryDirectory(prefix="knotfab-studio-") as place:
        here = Path(place)
        with serve(here / "studio") as (studio, host):
            name = picture.name
            post(host, f"/api/pictures?name={name}", picture.read_bytes())
            post(host, "/api/settings", json.dumps({**SETTINGS, "accuracy": accuracy}).encode())
            origin = f"http://{host}"
            with connect(
                f"ws://{host}/live",
                origin=origin,
                additional_headers={"cookie": cookie(host)},
                max_size=None,
            ) as live:
                live.recv()
                for _ in range(repeats):
                    time.sleep(15)  # the next process has loaded
                    first, whole, frames = build_in_studio(host, live)
                    firsts.append(first)
                    studios.append(whole)
                    counts.append(frames)
                    commands.append(build_by_command(picture, accuracy, here / "out"))
            start = here / "start.json"
            found = studio.builds.start_of(studio.current)
            assert found is not None
            shutil.copyfile(found, start)
        folder = here / "studio" / "builds" / picture.stem
        same = [
            (folder / n).read_bytes() == (here / "out" / n).read_bytes()
            for n in ("part.stl", "part.3mf", "knots.json")
        ]
        fps = frames_a_second(start, folder / "scene.toml")
    print(f"first frame after the press, s: {', '.join(f'{s:.2f}' for s in firsts)}")
    print(f"frames of a build: {median(counts):.0f}")
    print(f"a build in the studio, s: {', '.join(f'{s:.1f}' for s in studios)}")
    print(f"by the command line, s: {', '.join(f'{s:.1f}' for s in commands)}")
    ratio = median(s / c for s, c in zip(studios, commands, strict=True))
    print(f"studio over command line, median of pairs: {ratio:.3f}")
    print(f"the same part.stl, part.3mf and knots.json: {all(same)}")
    print(f"frames a second of the viewer: {fps}")


if __name__ == "__main__":
    run_study(main)
