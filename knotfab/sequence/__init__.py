"""A sequence of pictures: knots that move smoothly from each picture to the next."""
