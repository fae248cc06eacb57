"""The knot types of polygons, and how they are linked."""
