"""A sequence of pictures: one knot that moves smoothly from each picture to the next."""
