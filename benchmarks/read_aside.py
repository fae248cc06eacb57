"""Compare what is told of 40 pieces seen from aside with what a person said of them first.

`python -m benchmarks.read_aside`: how much of its picture each silhouette tells, and the z of the search's
onlooker, then how each follows the words. The silhouettes, seen from 45° on one of four sides
drawn by lot, stand shuffled in read_aside.png, each behind its picture: the project's 19 pictures built at
standard both ways of supports, and two more sides. The words were written down before anything was measured,
without names beside the silhouettes: 2, the picture can be named; 1, it can be guessed; 0, a tangle.
`told` was chosen by these. strangers.json has 60 other looks (`benchmarks.strangers --views 60`), from
twelve sides, at ten builds in roots or a rounded plate: what `told` says of all that is seen in each, and the
words of one who knew what was built.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.stats import rankdata, spearmanr

from benchmarks.measurement import run_study
from knotfab.start.legibility import onlooker_for, stretch_mask
from knotfab_validators.shadows.told import tell_flat

WORDS = np.array(
    [int(word) for word in "2000110200 0101010010 0002022100 2002102220".replace(" ", "")]
)


def read_views() -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Read each view's silhouette and picture, both stretched to their boxes."""
    with Image.open(Path(__file__).with_suffix(".png")) as image:
        rows = ~np.asarray(image)
    return [(pair[:, len(pair) :], pair[:, : len(pair)]) for pair in np.split(rows, len(WORDS))]


def measure_views() -> dict[str, NDArray[np.float64]]:
    """Return what each measure says of each view: `told`, and the `onlooker`'s z."""
    found: dict[str, list[float]] = {"told": [], "onlooker": []}
    for seen, picture in read_views():
        found["told"].append(tell_flat(seen, picture))
        found["onlooker"].append(onlooker_for(stretch_mask(picture)).stand_out(stretch_mask(seen)))
    return {name: np.array(values) for name, values in found.items()}


def tell_apart(values: NDArray[np.float64], named: NDArray[np.bool_]) -> float:
    """Return how often a view that was named has the larger value of two (area under the ROC curve)."""
    ranks, count = rankdata(values), int(named.sum())
    return float((ranks[named].sum() - count * (count + 1) / 2) / (count * (~named).sum()))


def main() -> int:
    """Print the table."""
    found = measure_views()
    print("view  word   told  onlooker")
    for n, (word, told, onlooker) in enumerate(zip(WORDS, *found.values(), strict=True)):
        print(f"{n:4}  {word:4}  {told:5.2f}  {onlooker:8.2f}")
    for name, values in found.items():
        middles = ", ".join(f"{np.median(values[word == WORDS]):.2f}" for word in (0, 1, 2))
        print(
            f"{name}: medians {middles} for words 0, 1, 2; rank correlation with the words "
            f"{spearmanr(values, WORDS)[0]:.2f}; of a view that was named and one that was not, the "
            f"named one is higher in {100 * tell_apart(values, WORDS == 2):.0f} %"
        )
    looks = json.loads(Path(__file__).with_name("strangers.json").read_text())
    told, words = (np.array([look[key] for look in looks]) for key in ("told", "word"))
    middles = ", ".join(f"{np.median(told[words == word]):.2f}" for word in (0, 1, 2))
    named, follows = tell_apart(told, words == 2), spearmanr(told, words)[0]
    print(
        f"told of {len(looks)} other looks: medians {middles}; rank correlation {follows:.2f}; "
        f"of a named look and another the named one is higher in {100 * named:.0f} %"
    )
    return 0


if __name__ == "__main__":
    sys.exit(run_study(main))
