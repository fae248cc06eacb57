"""A photograph of the real shadow against the picture: how alike, where not, and where to move the lamp."""
