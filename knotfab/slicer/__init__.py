"""The written 3MF through PrusaSlicer, and what its answer proves."""
