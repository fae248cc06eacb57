"""The search: from a template to knots whose shadow is the picture, every step certified."""
