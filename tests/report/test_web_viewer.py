"""The viewer in a browser: its shadow against the validators', what hands and keys do, the whole report."""

import base64
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import open_browser
from pieces import (
    RADIUS,
    VIEWS,
    bodies_of,
    geometry_at,
    lit_scene,
    post,
    ring,
    scene_of,
    setup,
    validated_shadow,
    view_of,
    wavy_knots,
)
from PIL import Image, ImageDraw
from reports import LOSS, VERDICT, report_with

from knotfab.report.for_maker import draw_setup, list_files, tell_setup
from knotfab.report.page import VIEWER, Picture, render_html
from knotfab.report.setup import write_setup
from knotfab.report.viewer import viewer_data
from knotfab.scene.camera import camera_of
from knotfab_formats.errors import plain
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.lamp import lamp_points
from tests.report.test_page import SLICED, WALL

pytestmark = pytest.mark.slow

PX = 1024  # px of a frame's longer side, where shadows are compared
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
MASK = np.zeros((120, 150), dtype=bool)
MASK[20:100, 35:115] = True
PAGE = """<!DOCTYPE html><html lang="en"><title>viewer</title>
<div id="at" style="width: 0"></div><script>%s</script>"""
READ = """(args) => {
  const [moved, longer, soft] = args;
  viewer.setLamp(moved);
  const { width, height, data } = viewer.readShadow(longer, soft);
  let text = "";
  for (const value of data) text += String.fromCharCode(value);
  return [width, height, btoa(text)];
}"""

READ_MIXED = """([longer]) => {
  const { width, height, data } = viewer.readMixed(longer);
  let text = "";
  for (const value of data) text += String.fromCharCode(value);
  return [width, height, btoa(text)];
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def bench(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A page with the bundle as a classic script, opened as a file."""
    path = tmp_path_factory.mktemp("bench") / "page.html"
    path.write_text(PAGE % VIEWER.read_text(encoding="utf-8"), encoding="utf-8")
    page = browser.new_page(reduced_motion="reduce")
    page.goto(path.as_uri())
    page.evaluate("""() => { window.viewer = KnotfabViewer.mount(document.getElementById("at"),
        {unit: "mm", radius: 1, curves: [], views: [{name: "a", kind: "shadow", frame_width_mm: 10,
         frame_height_mm: 10, light_distance_mm: 100, wall_distance_mm: 10}]}); }""")
    yield page
    page.close()


def shadow(bench: Any, longer: int = PX, soft: bool = False, **moved: float) -> np.ndarray:
    """(H, W) 0 to 255 as the viewer casts it, its lamp moved."""
    width, height, text = bench.evaluate(READ, [moved, longer, soft])
    return np.frombuffer(base64.b64decode(text), dtype=np.uint8).reshape(height, width)


@pytest.mark.parametrize("kind", VIEWS)
def test_the_shadow_is_the_validators(bench: Any, kind: str) -> None:
    """Tubes swept in the browser, a post cut off at the wall, lamps and eyes anywhere; and moved by hand."""
    view, knots = view_of(**VIEWS[kind]), wavy_knots()
    bodies = bodies_of(knots, post(view))
    data = viewer_data(scene_of([view], "stand"), knots, bodies, [MASK])
    bench.evaluate("(data) => viewer.setScene(data)", data)
    geometry = geometry_at(view, PX)
    wanted = validated_shadow(bodies, geometry)
    assert 0.02 < wanted.mean() < 0.5
    assert overlap(shadow(bench) > 127, wanted).iou > 0.99
    light = geometry.light + 25.0 * geometry.up - 40.0 * geometry.right
    moved = shadow(bench, height=25.0, side=-40.0) > 127
    assert overlap(moved, validated_shadow(bodies, replace(geometry, light=light))).iou > 0.99
    assert overlap(moved, wanted).iou < 0.8
    far = view.model_copy(update={"wall_tilt_deg": view.wall_tilt_deg - 15.0})
    tilted = shadow(bench, height=0.0, side=0.0, tilt=far.wall_tilt_deg) > 127
    assert overlap(tilted, validated_shadow(bodies, geometry_at(far, PX))).iou > 0.99


def test_the_sun_is_a_lamp_far_away_and_a_large_lamp_blurs(bench: Any) -> None:
    view = view_of(wall_distance_mm=80.0, light_distance_mm=400.0)
    data = viewer_data(scene_of([view], "none"), wavy_knots(), [], [MASK])
    bench.evaluate("(data) => viewer.setScene(data)", data)
    hard, soft = shadow(bench), shadow(bench, soft=True, diameter=40.0)
    blurred = (soft > 12) & (soft < 243)
    assert set(np.unique(hard)) == {0, 255} and blurred.mean() > 0.1
    assert soft.mean() == pytest.approx(hard.mean(), rel=0.1)  # the light is only spread
    far = view.model_copy(update={"light_distance_mm": 1e6})
    exact = validated_shadow(bodies_of(wavy_knots()), geometry_at(far, PX))
    bench.evaluate("viewer.setLamp({distance: Infinity})")
    assert overlap(shadow(bench) > 127, exact).iou > 0.99


def test_a_piece_on_the_wall_tilts_with_it_and_another_turns(bench: Any) -> None:
    """Tilted together, wall and piece see the lamp move; turned by a right angle, a ring is a bar."""
    view, knots = view_of(), wavy_knots()
    data = viewer_data(scene_of([view], "wall"), knots, [], [MASK])
    bench.evaluate("(data) => viewer.setScene(data)", data)
    angle, far = np.radians(10.0), view.light_distance_mm + view.wall_distance_mm
    moved = {"height": far * np.sin(angle)}
    moved["distance"] = far * np.cos(angle) - view.wall_distance_mm
    tilted = shadow(bench, tilt=10.0) > 127
    level = shadow(bench, tilt=0.0, **moved) > 127
    assert overlap(tilted, level).iou > 0.99
    bench.evaluate("(data) => viewer.setScene(data)", {**data, "wall_mounted": False})
    turned = shadow(bench, turn=90.0) > 127
    wide, high = (np.ptp(np.flatnonzero(turned.any(axis=k))) for k in (0, 1))
    assert wide < 0.5 * high


def test_the_iou_is_that_of_picture_and_shadow(bench: Any) -> None:
    view, knots = view_of(), wavy_knots()
    asked = validated_shadow(bodies_of(knots), geometry_at(view, 600))[120:-120, 150:-150]
    data = viewer_data(scene_of([view], "none"), knots, [], [asked])
    bench.evaluate("(data) => viewer.setScene(data)", data)
    bench.wait_for_function("viewer.iou() !== null")
    assert bench.evaluate("viewer.iou()") > 0.97
    bench.evaluate("viewer.setLamp({height: 60})")
    assert bench.evaluate("viewer.iou()") < 0.6


def test_lamps_mix_their_colours_and_are_switched_and_moved(bench: Any) -> None:
    """What is seen on the wall's own pixels, and the share of the picture that has its right colour."""
    scene, knots = lit_scene(), wavy_knots()
    bodies = bodies_of(knots)
    asked = [validated_shadow(bodies, geometry_at(view, 600)) for view in scene.views]
    masks = [mask[120:-120, 150:-150] for mask in asked]
    data = viewer_data(scene, knots, [], masks)
    bench.evaluate("(data) => viewer.setScene(data)", data)
    bench.wait_for_function("viewer.right() !== null")
    assert bench.evaluate("viewer.right()") > 0.98
    seen = mixed(bench)
    # the lamp's own channel is dark there
    hidden = np.stack([mask[::20, ::20] for mask in masks], axis=2)
    rows = np.arange(0, masks[0].shape[0], 20)
    columns = np.arange(0, masks[0].shape[1], 20)
    there = seen[
        np.ix_(
            _at(rows, masks[0].shape[0], len(seen)), _at(columns, masks[0].shape[1], seen.shape[1])
        )
    ]
    assert ((there > 127) != hidden).mean() > 0.98
    assert 0.02 < hidden.mean() < 0.5 and len(np.unique(hidden.reshape(-1, 3), axis=0)) >= 5
    bench.evaluate("viewer.setLit([false, true, false])")
    assert mixed(bench).reshape(-1, 3).max(axis=0).tolist() == [0, 255, 0]
    bench.evaluate("viewer.setLit([false, false, false])")
    assert mixed(bench).max() == 0
    bench.evaluate("viewer.setLit([true, true, true]); viewer.setLamp({side: -50})")
    assert bench.evaluate("viewer.right()") < 0.95
    bench.evaluate(
        "(data) => viewer.setScene(data)", viewer_data(lit_scene("switch"), knots, [], masks)
    )
    bench.wait_for_function("viewer.iou() !== null")
    assert bench.evaluate("viewer.iou()") > 0.97 and bench.evaluate("viewer.right()") is None


def mixed(bench: Any) -> np.ndarray:
    """(H, W, 3) 0 to 255, linear, what all lamps throw together into the frame."""
    width, height, text = bench.evaluate(READ_MIXED, [300])
    return np.frombuffer(base64.b64decode(text), dtype=np.uint8).reshape(height, width, 3)


def _at(places: np.ndarray, pixels: int, wanted: int) -> np.ndarray:
    return np.floor((places + 0.5) / pixels * wanted).astype(int)


def test_tubes_are_replaced_while_one_looks(bench: Any) -> None:
    """Live: other numbers of curves and vertices, none at all, and points that stand on one another."""
    view = view_of()
    bench.evaluate(
        "(data) => viewer.setScene(data)",
        viewer_data(scene_of([view], "none"), wavy_knots(), [], [MASK]),
    )
    for radius, sizes in ((35.0, (90,)), (40.0, (90,)), (30.0, (50, 70)), (20.0, ())):
        curves = [ring(radius - 9 * k, n=n).tolist() for k, n in enumerate(sizes)]
        curves = [[*curve, curve[-1], curve[0]] for curve in curves]
        bench.evaluate("(args) => viewer.setCurves(...args)", [curves, 1.5])
        bodies = [body for k, n in enumerate(sizes) for body in tube(radius - 9 * k, n)]
        wanted = validated_shadow(bodies, geometry_at(view, PX))
        assert overlap(shadow(bench) > 127, wanted).iou > 0.985


def tube(radius: float, n: int) -> list[Any]:
    from knotfab.geometry.tube import sweep

    return [sweep(ring(radius, n=n), 1.5, 24)]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """report.html as a build writes it, of a piece on a plate."""
    folder = tmp_path_factory.mktemp("report")
    mounted, scene, camera = setup("plate")
    write_setup(folder, mounted, scene, [camera])
    strip = Image.new("RGB", (1330, 544), "#faf8f4")
    ImageDraw.Draw(strip).ellipse((60, 60, 380, 480), fill="#2b2d33")
    strip.save(folder / "compare-front.png")
    evil = "a </script><script>alert(1)</script> piece"
    verdict = {**VERDICT, "lost": [{**LOSS, "sentence": evil}]}
    printed = {
        "mount": WALL, "time_s": 81399.0, "filament_m": 75.9, "filament_g": 226.0, "support_g": 89.5,
        "drawings": ["setup.pdf", "setup.svg"], "setup": plain(tell_setup(mounted, [camera], RADIUS)),
    }  # fmt: skip
    notes = ["A finger reaches 24% of its supports, a cutter 55%."] * 3
    views = [{"verdict": verdict}]
    record = report_with(views=views, print=printed, notes=notes, slicer=SLICED)
    view, knots = view_of(), wavy_knots()
    bodies = bodies_of(knots, post(view))
    asked = validated_shadow(bodies, geometry_at(view, 600))[120:-120, 150:-150]
    shown = viewer_data(scene_of([view], "wall"), knots, bodies, [asked])
    shown["views"][0]["name"] = evil
    page = render_html(
        record,
        [Picture(folder / "compare-front.png", "compare", view="front")],
        evil,
        shown=shown,
        drawings=draw_setup(folder),
        files=list_files(
            ["part.3mf", "part.stl", "part.glb", "setup.pdf", "scene.toml", "knots.json"]
        ),
    )
    (folder / "report.html").write_text(page, "utf-8")
    return folder / "report.html"


def open_report(browser: Any, report: Path, width: int, scheme: str) -> Iterator[Any]:
    """The report as a file in a window of some width and scheme; it must say and load nothing."""
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion="reduce",
        has_touch=width < 500,
    )  # fmt: skip
    page = context.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("dialog", lambda dialog: said.append(dialog.message))
    page.on("request", lambda asked: said.append(asked.url))
    page.goto(report.as_uri())
    page.locator("canvas").wait_for()
    yield page
    loaded = [line for line in said if not line.startswith("data:")]
    assert loaded == [report.as_uri()]
    context.close()


@pytest.fixture(scope="module")
def desk(browser: Any, report: Path) -> Iterator[Any]:
    yield from open_report(browser, report, 1280, "light")


@pytest.fixture(scope="module")
def phone(browser: Any, report: Path) -> Iterator[Any]:
    yield from open_report(browser, report, 390, "dark")


def violations(page: Any) -> list[Any]:
    """What axe-core finds, with everything unfolded."""
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (make browser, or npm ci in web/)")
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.evaluate(AXE.read_text(encoding="utf-8"))
    return page.evaluate(  # type: ignore[no-any-return]
        "axe.run(document).then((r) => r.violations.map((v) => [v.id, v.nodes.map((n) => n.html)]))"
    )


def test_the_report_is_short_small_and_silent(desk: Any, report: Path) -> None:
    assert report.stat().st_size < 1.5e6
    assert desk.evaluate("document.documentElement.scrollHeight") <= 2500
    assert desk.locator("details[open]").count() == 0
    text = desk.inner_text("main")
    for words in (
        "Verified.",
        "22 h 37 min",
        "226 g",
        "Hang it",
        "phone's torch",
        "spill",
        "part.3mf",
    ):
        assert words in text
    assert "Tightest" not in text and "mesh" not in text.split("The files")[0]
    desk.get_by_text("Everything that was measured").click()
    assert "precision" not in desk.inner_text("main")  # each table is folded itself
    desk.locator("summary", has_text="The shadow").click()
    assert "precision" in desk.inner_text("main")


@pytest.mark.study
def test_the_report_of_a_tall_picture_is_short_too(browser: Any, report: Path) -> None:
    """Tall frames side by side, and tall drawings."""
    for page in open_report(browser, report, 1280, "light"):
        page.evaluate(
            """() => Promise.all([...document.querySelectorAll(".compare img, .drawing img")].map((image) => {
              const sheet = Object.assign(document.createElement("canvas"), { width: 900, height: 1100 });
              image.src = sheet.toDataURL();
              return image.decode();
            }))"""
        )
        assert page.evaluate("document.documentElement.scrollHeight") <= 2700


def test_the_report_fits_a_phone(phone: Any) -> None:
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    canvas = phone.locator("canvas")
    # the page scrolls on
    assert canvas.evaluate("(c) => getComputedStyle(c).touchAction") == "pan-y"
    box = canvas.bounding_box()
    before = canvas.screenshot()
    phone.mouse.move(box["x"] + 60, box["y"] + 150)
    phone.mouse.down()
    phone.mouse.move(box["x"] + 200, box["y"] + 150)
    phone.mouse.up()
    assert canvas.screenshot() != before


@pytest.mark.parametrize("which", ["desk", "phone"])
def test_contrast_names_and_alt_texts(which: str, request: pytest.FixtureRequest) -> None:
    assert violations(request.getfixturevalue(which)) == []


@pytest.mark.study
def test_it_is_turned_zoomed_and_lit_by_keys(desk: Any) -> None:
    canvas = desk.locator("canvas")
    assert "shadow on the wall" in canvas.get_attribute("aria-label")
    canvas.focus()
    seen = [canvas.screenshot()]
    for key in ("ArrowRight", "ArrowUp", "+"):
        desk.keyboard.press(key)
        seen.append(canvas.screenshot())
    assert len(set(seen)) == len(seen)
    told = desk.locator("[role=status] b")
    assert told.inner_text() in ("97 %", "98 %", "99 %")
    slider = desk.get_by_label("Lamp height")
    slider.focus()
    desk.keyboard.press("ArrowRight")
    assert slider.get_attribute("aria-valuetext") == "+1 mm"
    slider.fill("60")
    assert slider.get_attribute("aria-valuetext") == "+60 mm"
    told.filter(has_not_text="9").wait_for()
    desk.get_by_role("button", name="Put back").click()
    assert slider.get_attribute("aria-valuetext") == "0 mm"
    desk.get_by_role("button", name="As printed").click()
    assert "printed" in canvas.get_attribute("aria-label") and not slider.is_visible()


LAMPS: dict[str, dict[str, Any]] = {
    "disc": {"light_diameter_mm": 36.0},
    "rectangle": {"light_shape": "rectangle", "light_width_mm": 60.0, "light_height_mm": 6.0},
    "upright": {"light_shape": "rectangle", "light_width_mm": 6.0, "light_height_mm": 60.0},
    "LEDs": {
        "light_shape": "leds", "light_width_mm": 50.0, "light_height_mm": 30.0,
        "light_leds": (3, 2), "light_diameter_mm": 5.0,
    },
    "many LEDs": {
        "light_shape": "leds", "light_width_mm": 50.0, "light_height_mm": 50.0,
        "light_leds": (12, 11), "light_diameter_mm": 1.0,
    },
}  # fmt: skip


@pytest.mark.study
def test_lamps_of_every_shape_blur_as_they_do(bench: Any) -> None:
    """Each blur is the average over the validators' points of the same lamp, and that of no other."""
    knots, seen, wanted = wavy_knots(), {}, {}
    for name, lamp in LAMPS.items():
        view = view_of(wall_distance_mm=80.0, light_distance_mm=400.0, **lamp)
        data = viewer_data(scene_of([view], "none"), knots, [], [MASK])
        bench.evaluate("(data) => viewer.setScene(data)", data)
        geometry = geometry_at(view, 128)
        points = lamp_points(view, 5.0, 0.3)
        points = points if len(points) < 100 else points[::5]
        hidden = [
            validated_shadow(
                bodies_of(knots),
                replace(geometry, light=geometry.light + x * geometry.right + y * geometry.up),
            )
            for x, y in points
        ]
        wanted[name] = np.mean(hidden, axis=0)
        seen[name] = shadow(bench, 128, soft=True) / 255
    for name, one in seen.items():
        off = {other: float(np.abs(one - two).mean()) for other, two in wanted.items()}
        assert off[name] < 0.012 and min(off, key=lambda k: off[k]) == name, (name, off)


def test_the_pinhole_is_that_of_the_scene(bench: Any) -> None:
    points = wavy_knots().points[::7]
    for keys in VIEWS.values():
        view = view_of(**keys)
        camera = camera_of(view, 150, 120)
        u, v = camera.project(points).T
        told = bench.evaluate(
            "([view, points]) => points.map(KnotfabViewer.pinholeOf(view))",
            [view.model_dump(mode="json"), points.tolist()],
        )
        assert np.allclose(np.array(told)[:, :2], np.stack([u - 74.5, 59.5 - v], axis=1), atol=1e-6)
        height = points @ camera.receiver[:3] + camera.receiver[3]
        above = camera.receiver[:3] @ camera.eye + camera.receiver[3]
        assert np.allclose(np.array(told)[:, 2], above / (above - height))
