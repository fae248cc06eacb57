"""Build the pictures that people bring and hold the verdict's word against a person's.

`python -m benchmarks.verdict_table [--accuracy NAME] [--limit SECONDS] [--out DIR] [NAME ...]`: the
word that a person gave each picture, the verdict's on the written files, IoU, how far the outline is off, and
why it is no better, or rejected; of QR codes whether their shadow is read. Builds have the command's own
options, its accuracy too. With --out, those that are done are not made again, but verified again. The NAME
`own` stands for the project's own pictures, which are to be faithful.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.brought import OVERTAKEN, WORDS, draw_brought
from benchmarks.measurement import build_apart, make_folder, read_report, run_study, save_pictures
from examples.pictures import pictures
from knotfab_validators import validate
from knotfab_validators.shadows.verdict_rules import UNKNOWN, worst_verdict

REFUSED = "refused"
GOOD = ("faithful", "good")
OWN = "own"
CAMERA_PX = 4.0  # px of the shadow's 1024: 0.7 mm of 180, less than the default lamp's penumbra


def verify(folder: Path) -> Mapping[str, Any] | None:
    """Return the verdict on a build's files, measured anew without rendering; None where there are none."""
    for place in (folder, folder / "rejected"):
        if (place / "part.stl").is_file():
            files = (place / name for name in ("part.stl", "knots.json", "scene.toml"))
            found = validate(*files, skip={"shadow-render"}, only="shadows")
            verdict = worst_verdict(found.views)
            return None if verdict is None else {**verdict, "iou": found.views[0]["iou"]}
    return None


def reads_qr(picture: Path) -> bool:
    """Tell whether a QR code is read from a picture of its shadow, as soft as a camera sees it from afar."""
    import zxingcpp
    from PIL import Image, ImageFilter, ImageOps

    seen = ImageOps.expand(Image.open(picture).convert("L"), 80, 255)
    seen = seen.filter(ImageFilter.GaussianBlur(CAMERA_PX))
    return bool(zxingcpp.read_barcodes(seen, formats=zxingcpp.BarcodeFormat.QRCode))


def _build(path: Path, folder: Path, accuracy: str | None, limit_s: float) -> str:
    """Build what is not built yet; what it said that wrote nothing."""
    said = folder / "said.txt"
    if not said.is_file():
        other = () if accuracy is None else ("--accuracy", accuracy)
        built = build_apart(path, folder, *other, "--skip", "slicer", limit_s=limit_s)
        if built.code not in (0, 1, 2):  # stopped, or killed: to be tried again
            return built.said or f"ended with code {built.code}"
        folder.mkdir(exist_ok=True)
        said.write_text("" if built.report else built.said, encoding="utf-8")
    return said.read_text(encoding="utf-8")


def _rejected_by(folder: Path) -> str:
    """Return the required checks that a build failed, in words, besides the one that gives the word."""
    report = read_report(folder) or {"checks": []}
    failed = [c["name"] for c in report["checks"] if c["required"] and c["status"] == "fail"]
    others = [name for name in failed if name != "recognisable"]
    return f"rejected by {', '.join(others)}" if others else ""


def _row(name: str, expected: str, folder: Path, said: str) -> tuple[str, bool, Mapping[str, Any]]:
    """Return a line of the table, whether it is as expected, and the verdict."""
    verdict, rejected = verify(folder), _rejected_by(folder)
    if verdict is None:
        line = f"{name:<20} {expected:<9} {REFUSED:<17}  -               {said or rejected}"
        return line, expected == REFUSED and bool(said), {"word": REFUSED, "lost_pieces": 0}
    word = verdict["word"]
    read = ""
    if name.startswith("qr-"):
        (shadow,) = folder.rglob("shadow-front.png")
        read = "decoded; " if reads_qr(shadow) else "not decoded; "
    why = read + "; ".join(verdict["reasons"])
    line = (
        f"{name:<20} {expected:<9} {word:<17} {verdict['iou']:.4f}  "
        f"{verdict['outline_p95_radii']:5.2f}  {why}"
    )
    if rejected:
        return f"{line}{'; ' if why else ''}{rejected}", False, verdict
    agrees = word == expected or (word, expected) == (UNKNOWN, REFUSED)
    now, rule = OVERTAKEN.get(name, ("", ""))
    if not agrees and word == now:
        return f"{line}{'; ' if why else ''}another rule than the person's: {rule}", False, verdict
    return line, agrees, verdict


def main(
    *names: str, accuracy: str | None = None, limit: float = 900.0, out: Path | None = None
) -> None:
    """Print the table and what it comes to."""
    folder = make_folder(out, "verdict")
    own = pictures() if OWN in names else {}
    names = [n for n in WORDS if not names or n in names]
    drawn = {n: draw_brought(n) for n in names} | own
    expected = WORDS | dict.fromkeys(own, "faithful")
    agreed, good, rows, overtaken, wrong = 0, 0, 0, 0, []
    print(f"{'picture':<20} {'person':<9} {'verdict':<17} IoU    off, radii  why it is no better")
    for name, path in save_pictures(drawn, folder).items():
        said = _build(path, folder / name, accuracy, limit)
        line, agrees, verdict = _row(name, expected[name], folder / name, said)
        changed = verdict["word"] == OVERTAKEN.get(name, ("",))[0]
        print(("  " if agrees else "* " if changed else "! ") + line, flush=True)
        rows, agreed, good = rows + 1, agreed + agrees, good + (verdict["word"] in GOOD)
        overtaken += changed
        if verdict["word"] in GOOD and verdict["lost_pieces"]:
            wrong.append(name)
    print(
        f"\n{rows} pictures: {agreed} with the person's word, {overtaken} with another by a rule made "
        f"since (*), {good} good or better; good or better with a lost piece: {', '.join(wrong) or 'none'}"
    )


if __name__ == "__main__":
    run_study(main)
