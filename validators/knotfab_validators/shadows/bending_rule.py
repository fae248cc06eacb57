"""What a bent picture may be called: a row of the verdict for its bending."""

from __future__ import annotations

from typing import Any

from knotfab_validators.files.bent import Bent
from knotfab_validators.shadows.recognition import UNKNOWN, WORDS

__all__ = ["BENT", "judge_bending"]

# rms and most, in shares of the picture's height, up to which a person gives a bent picture the word
# (docs/verdict.md: pictures bent by 0 to 20 %, looked at)
BENT = {"faithful": (0.03, 0.08), "good": (0.06, 0.15), "coarse": (0.12, 0.25)}


def judge_bending(verdict: dict[str, Any], bent: Bent) -> dict[str, Any]:
    """The verdict on a view with what its bending allows: the worse of the two words, and why."""
    allowed = next(
        (word for word, (rms, most) in BENT.items() if bent.rms <= rms and bent.most <= most),
        UNKNOWN,
    )
    if allowed == WORDS[0]:
        return verdict
    better = WORDS[WORDS.index(allowed) - 1]
    rms, most = BENT[better]
    why = (
        f"picture bent by {bent.rms:.1%} on average and {bent.most:.1%} at most, "
        f"above {rms:.0%} or {most:.0%}"
    )
    word = max(verdict["word"], allowed, key=WORDS.index)
    return {**verdict, "word": word, "reasons": [*verdict["reasons"], why]}
