"""The visual hull of several pictures: what matter may stand without spilling in any of them."""
