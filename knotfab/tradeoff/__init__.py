"""Measure on this machine what accuracy costs in time, and draw it."""
