"""Check the shadows of a part, rendered and by exact polygons, against their pictures."""
