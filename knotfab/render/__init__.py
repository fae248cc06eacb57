"""Differentiable silhouettes of capsules: by ray distance, tiled and dense, and by outlines on a plane."""
