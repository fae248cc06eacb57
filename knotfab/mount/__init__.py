"""Mounts hold a piece: pegs along light rays, placed so that it does not sag, stands and eyelets."""
