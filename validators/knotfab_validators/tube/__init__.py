"""The tube about the centre lines: thickness, clearance, and whether a part is that tube where it may be."""
