"""Meshes, curves, segments and triangles: plain geometry, which knows neither files nor checks."""
