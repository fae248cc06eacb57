"""Bending plans of pieces made of wire."""
