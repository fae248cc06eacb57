"""The pictures that a report shows, found in its folder."""

from __future__ import annotations

from pathlib import Path

from knotfab.report.report_html import Picture
from knotfab.report.turning import TURN_FILE

__all__ = ["find_pictures"]


def find_pictures(folder: Path) -> list[Picture]:
    """Find the report's pictures that lie in a folder, with their captions."""
    found = []
    part = folder / "part.png"
    for path in sorted(folder.glob("failures*.png")):
        name = path.stem.replace("failures-", "part-").replace("failures", "the part")
        found.append(Picture(path, "part", f"where {name} fails its checks"))
    for path in folder.glob("sequence.gif"):
        found.append(
            Picture(path, "moving", "the verified shadows of all frames, one after the other")
        )
    colours = folder / "compare-colours.png"
    if colours.is_file():
        caption = "the picture, the colours that the lamps can mix of it, what is seen, and where it is wrong"
        found.append(Picture(colours, "colours", caption))
        for path in sorted(folder.glob("shadow-*.png")):
            found.append(Picture(path, "alone", "", path.stem.removeprefix("shadow-")))
    for path in sorted(set(folder.glob("compare-*.png")) - {colours}):
        caption = "target, shadow of the written file, and where they differ"
        found.append(Picture(path, "compare", caption, path.stem.removeprefix("compare-")))
    for path in sorted(folder.glob("bent-*.png")):
        caption = "the picture as it came, as it is bent, and what all pictures leave of it"
        found.append(Picture(path, "bent", caption, path.stem.removeprefix("bent-")))
    for path in sorted(folder.glob("soft-*.png")):
        caption = "the shadow as a lamp of this size throws it"
        found.append(Picture(path, "shadow", caption, path.stem.removeprefix("soft-")))
    turn = folder / TURN_FILE
    if turn.is_file():
        found.append(Picture(turn, "turn", "the shadow under one lamp, over a full turn"))
    if part.is_file():
        found.append(
            Picture(part, "part", "from the light of each view, then turned about the vertical")
        )
    return found
