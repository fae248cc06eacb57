"""A photograph of the real shadow against the picture."""
