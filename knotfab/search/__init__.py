"""Search from a start to knots whose shadow is the picture, every step certified."""
