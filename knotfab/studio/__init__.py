"""The studio: a local page on which a picture becomes a part before one's eyes (docs/studio.md)."""
