"""Geometry of meshes, curves, segments and triangles; it knows neither files nor checks."""
