"""Drawings to measure from: pages of an exact size, and dimensions."""
