"""Check the tube around the centre lines: its thickness and clearance, and that the part is that tube."""
