"""The knot type of polygons, and how they are linked."""
