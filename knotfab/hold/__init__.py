"""Holders: what keeps a piece where it casts its shadow."""
