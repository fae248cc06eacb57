"""Limit the verdict on a view by how far its picture was bent."""

from __future__ import annotations

from dataclasses import replace

from knotfab_formats.verdict import Recognition
from knotfab_validators.files.colours import Bent
from knotfab_validators.shadows.recognition import UNKNOWN, WORDS

# the largest rms and maximum displacement (shares of the picture's height) and stretch for each word, as
# judged by a person on pictures bent by 0 to 38 % (docs/verdict.md)
BENT = {"faithful": (0.02, 0.06, 2.0), "good": (0.05, 0.125, 4.0), "coarse": (0.08, 0.2, 10.0)}


def judge_bending(verdict: Recognition, bent: Bent) -> Recognition:
    """Return the verdict on a view, lowered to what its bending allows, with the reason."""
    found = (bent.rms, bent.most, bent.stretch)
    allowed = next(
        (
            word
            for word, most in BENT.items()
            if all(f <= m for f, m in zip(found, most, strict=True))
        ),
        UNKNOWN,
    )
    if allowed == WORDS[0]:
        return verdict
    rms, most, stretch = BENT[WORDS[WORDS.index(allowed) - 1]]
    why = (
        f"picture bent by {bent.rms:.1%} on average, {bent.most:.1%} at most, lengths changed up to "
        f"{bent.stretch:.1f} times: above {rms:.0%}, {most:.0%} or {stretch:g}"
    )
    word = max(verdict.word, allowed, key=WORDS.index)
    return replace(verdict, word=word, reasons=(*verdict.reasons, why))
