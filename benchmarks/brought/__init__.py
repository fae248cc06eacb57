"""Thirty pictures in the manner of those that people bring, and the word that a person gives each."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PIL import Image

from benchmarks.brought import drawings, photos, writing
from benchmarks.brought import drawings as logos
from benchmarks.brought import drawings as maps

# Each with the word that a person gives it who looks at its silhouette beside the silhouette's opening by the
# thinnest tube that the default printer prints (a radius of 0.8 mm): written before the rules of
# `knotfab_validators` were, and not to be changed to suit them. "refused": nobody would know it.
_DRAWN: dict[str, tuple[str, Callable[[], Image.Image]]] = {
    "logo-peak": ("faithful", logos.peak),
    "logo-leaf": ("faithful", logos.leaf),
    "logo-mug": ("faithful", logos.mug),
    "logo-word": ("good", logos.word),
    "logo-subtitle": ("coarse", logos.subtitle),
    "badge-tick": ("faithful", logos.tick),
    "badge-star": ("faithful", logos.star),
    "badge-rosette": ("faithful", logos.rosette),
    "badge-seal": ("coarse", logos.seal),
    "signature-marker": ("faithful", writing.marker),
    "signature-initials": ("faithful", writing.initials),
    "signature-pen": ("refused", writing.pen),
    "lines-house": ("faithful", drawings.house),
    "lines-cat": ("faithful", drawings.cat),
    "lines-boat": ("faithful", drawings.boat),
    "lines-fine": ("refused", drawings.fine),
    "map-island": ("faithful", maps.island),
    "map-metro": ("faithful", maps.metro),
    "map-streets": ("faithful", maps.streets),
    "map-archipelago": ("coarse", maps.archipelago),
    "qr-word": ("good", partial(writing.qr, "KNOT", 1)),
    "qr-link": ("good", partial(writing.qr, "https://example.org", 2)),
    "qr-card": (
        "good",
        partial(writing.qr, "MECARD:N:Ada Byron;TEL:+441234567890;EMAIL:ada@example.org;;", 6),
    ),
    "text-word": ("faithful", writing.large_word),
    "text-lines": ("good", writing.two_lines),
    "text-card": ("coarse", writing.card),
    "text-page": ("refused", writing.page),
    "photo-backlit": ("faithful", photos.backlit),
    "photo-jug": ("faithful", photos.jug),
    "photo-portrait": ("coarse", photos.portrait),
}
# Words that a rule made since has overtaken; the person's stays as it was given. A drawing of thin lines is
# no longer filled, which is what the person judged, but drawn along its centre lines (docs/silhouette.md).
_LINES = "drawn along its lines now, not filled"
OVERTAKEN = {"signature-pen": ("good", _LINES), "lines-fine": ("good", _LINES)}
WORDS = {name: word for name, (word, _) in _DRAWN.items()}
KINDS = tuple(dict.fromkeys(name.split("-")[0] for name in _DRAWN))


def draw_brought(name: str) -> Image.Image:
    """Draw one of the pictures, by name: in colour, in grey or with transparency, 1024 px long."""
    return _DRAWN[name][1]()
