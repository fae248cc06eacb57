"""Differentiable silhouettes of capsules: an exact tiled renderer and the dense formula beside it."""
